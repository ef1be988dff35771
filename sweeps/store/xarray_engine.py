"""`open_sweep`, and the engine ``vibroimpact`` of xarray.

xarray imports this module when it first opens any file, and asks the engine whether a file is its
own: so what takes long to import is imported only for a sweep.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import xarray as xr
from xarray.backends import BackendEntrypoint

from sweeps.errors import Refused, StoreError
from sweeps.store.paths import SCHEMA, open_regular, parts_path
from sweeps.store.replacing import TRAILER


def open_sweep(path: str | Path, *, verify: bool = True) -> xr.Dataset:
    """Open the file of a sweep; its arrays are read when they are used.

    If the sweep is not complete, the blocks in the folder beside `path` are opened. Points that
    are not computed yet have the status ``PENDING``.

    Parameters
    ----------
    path : str or Path
        The file of the sweep, also while only the folder of its blocks exists.
    verify : bool
        Whether to compare the data with their checksums, which reads the whole file once. The rest
        of the file is always compared with its checksums.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    StoreError
        If the file does not exist, is not a readable sweep of this format, or is damaged.

    Examples
    --------
    >>> import sweeps
    >>> omega = {"start": 2.6, "stop": 2.7, "num": 20}
    >>> scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": omega, "f": 1.0}}
    >>> ds = sweeps.open_sweep(sweeps.run_sweep(scene, "flip.h5", overwrite=True))
    >>> ds["period"].values
    array([1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 2, 2, 2, 2, 2, 2, 2])
    """
    from vibroimpact.inputs import PATH

    PATH.checked("path", path, Refused)
    return xr.open_dataset(path, engine=SweepEngine, verify=verify)


class SweepEngine(BackendEntrypoint):
    """Opens sweeps, complete or not, for `xarray.open_dataset`."""

    description = "Open sweeps of vibroimpact, also incomplete ones"

    def open_dataset(
        self,
        filename_or_obj: Any,
        *,
        drop_variables: str | Iterable[str] | None = None,
        verify: bool = True,
    ) -> xr.Dataset:
        """Open a sweep as `open_sweep` does; xarray then caches it, or cuts it into chunks."""
        from sweeps.store.reading import read_sweep
        from vibroimpact.inputs import FLAG, PATH

        PATH.checked("filename_or_obj", filename_or_obj, Refused)
        FLAG.checked("verify", verify, Refused)
        dataset = read_sweep(Path(filename_or_obj), verify)
        dropped = [drop_variables] if isinstance(drop_variables, str) else [*(drop_variables or ())]
        return dataset.drop_vars(dropped, errors="ignore") if dropped else dataset

    def guess_can_open(self, filename_or_obj: Any) -> bool:
        """Whether a path is that of a sweep of this format: its last bytes say so."""
        if not isinstance(filename_or_obj, str | os.PathLike):
            return False
        try:
            path = Path(filename_or_obj)
            if not path.exists() or not path.stat().st_size:
                path = parts_path(path) / SCHEMA
            with open_regular(path) as file:
                file.seek(-len(TRAILER), os.SEEK_END)
                return file.read() == TRAILER
        except (OSError, ValueError, StoreError):
            return False
