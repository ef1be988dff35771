"""Read a sweep: its complete file, or the folder of its blocks while it is incomplete."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from sweeps.arguments import FLAG, PATH, require
from sweeps.errors import StoreError
from sweeps.store.file import check_file, opened
from sweeps.store.parts import Parts
from sweeps.store.paths import (
    SCHEMA,
    Content,
    content,
    identity,
    parts_path,
    reason,
    refuse_parts,
)
from sweeps.text import in_units
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status

if TYPE_CHECKING:
    import xarray as xr


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
    import xarray as xr  # slow to import

    require("path", path, PATH)
    require("verify", verify, FLAG)
    path = Path(path)
    try:
        refuse_parts(path)
        if _is_missing(path) and identity(parts_path(path) / SCHEMA):
            from sweeps.store.partial import open_parts

            try:
                parts = Parts(parts_path(path), verify=verify)
                if _is_missing(path):  # otherwise a run has just completed the file
                    return _with_all_parameters(open_parts(parts))
            except StoreError:
                if _is_missing(path):
                    raise
        check_file(path, verify=verify)
        return _with_all_parameters(
            opened(lambda options: xr.open_dataset(path, engine="h5netcdf", driver_kwds=options))
        )
    except (OSError, ValueError) as error:
        raise StoreError(f"{str(path)!r} cannot be read: {reason(error)}") from error


def _with_all_parameters(dataset: xr.Dataset) -> xr.Dataset:
    """Add the parameters that a file of an earlier version lacks, with their defaults."""
    lacking = {name: about for name, about in PARAMETERS.items() if name not in dataset}
    units = {key: dataset.attrs.get(f"{key}_unit", key) for key in ("length", "time")}
    return dataset.assign_coords(
        {
            name: (
                (),
                about.default,
                {
                    "long_name": about.meaning,
                    "units": in_units(about.unit, units),
                    "symbol": about.symbol,
                },
            )
            for name, about in lacking.items()
        }
    )


def _is_missing(path: Path) -> bool:
    return content(path) in (None, Content.NOTHING)


def per_point(path: Path, names: Iterable[str]) -> tuple[dict[str, np.ndarray], float]:
    """Return those of the variables, with a single value per point, that the file has.

    Also returns the duration of the run [s].
    """
    check_file(path, verify=False)
    with opened(lambda options: h5py.File(path, "r", **options)) as file:
        held = {name: file[name][()] for name in names if name in file}
        return held, float(file.attrs["duration"])


def status_counts(variables: Mapping[Any, Any]) -> dict[Status, int]:
    """Count the points of a sweep with each outcome, including the outcomes without points."""
    values = np.asarray(variables["status"])
    return {status: int(np.count_nonzero(values == status)) for status in Status}
