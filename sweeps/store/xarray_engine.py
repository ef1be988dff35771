"""`open_sweep` of a complete file or of blocks, read lazily; an engine of xarray.

They are read from the complete file, or from the blocks while the sweep is incomplete. The class of
the arrays implements the interface of an xarray backend
(https://docs.xarray.dev/en/stable/internals/how-to-add-new-backend.html). The engine ``h5netcdf``
opens the same file, too, but asks HDF5 for the metadata of each variable some forty times.

xarray imports this module when it first opens any file, and asks the engine whether a file is its
own: so what takes long to import is imported only for a sweep.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray, BackendEntrypoint, CachingFileManager
from xarray.core import indexing

from sweeps.errors import Refused, StoreError
from sweeps.store.paths import SCHEMA, has_file, open_regular, parts_path
from sweeps.store.replacing import TRAILER, UnreadableError, identity, reason
from sweeps.store.variables import VARIABLES, attributes_of
from vibroimpact.inputs import FLAG, PATH
from vibroimpact.oscillator import PARAMETERS

if TYPE_CHECKING:
    from sweeps.store.parts import Parts
    from sweeps.store.schema import Schema


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
    >>> ds = sweeps.open_sweep("flip.h5")  # of the example of `run_sweep`
    >>> ds["period"].values
    array([1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 2, 2, 2, 2, 2, 2, 2])
    """
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
        PATH.checked("filename_or_obj", filename_or_obj, Refused)
        FLAG.checked("verify", verify, Refused)
        dataset = _open(Path(filename_or_obj), verify)
        names = [drop_variables] if isinstance(drop_variables, str) else [*(drop_variables or ())]
        return dataset.drop_vars(names, errors="ignore") if names else dataset

    def guess_can_open(self, filename_or_obj: Any) -> bool:
        """Whether a path is that of a sweep of this format: its last bytes say so."""
        if not isinstance(filename_or_obj, str | os.PathLike):
            return False
        try:
            path = Path(filename_or_obj)
            if not has_file(path):
                path = parts_path(path) / SCHEMA
            with open_regular(path) as file:
                file.seek(-len(TRAILER), os.SEEK_END)
                return file.read() == TRAILER
        except (OSError, ValueError, StoreError):
            return False


#: What selects values along each dimension; at most one array.
Index = tuple[int | slice | np.ndarray, ...]


def _open(path: Path, verify: bool) -> xr.Dataset:
    """Return the Dataset of `open_sweep`, whose arrays are read each time they are used."""
    from sweeps.store.complete_file import check_file
    from sweeps.store.parts import Parts
    from sweeps.store.schema import of_this_form

    try:
        folder = parts_path(path)
        while True:  # a run may complete the file, or begin another one, between two steps
            if has_file(path) or identity(folder / SCHEMA) is None:
                return _open_complete(path, check_file(path, verify=verify))
            try:
                parts = Parts(folder, verify=verify)
                if not has_file(path):
                    with of_this_form(folder / SCHEMA):
                        return _open_blocks(parts)
            except StoreError:
                if not has_file(path):
                    raise
    except (OSError, ValueError) as error:
        raise StoreError(f"{str(path)!r} cannot be read: {reason(error)}") from error


def _open_complete(path: Path, digest: str) -> xr.Dataset:
    """Open a complete file for the arrays of the Dataset, and again if xarray has closed it."""
    from sweeps.store.complete_file import open_file
    from sweeps.store.schema import of_this_form, schema_in

    manager = CachingFileManager(open_file, path.absolute(), digest, mode="r")
    file = manager.acquire()
    with of_this_form(path):
        schema, duration = schema_in(file), float(file.attrs["duration"])
        chunks = {name: file[name].chunks or () for name in schema.variables}
        dataset = _lazy(schema, duration, partial(_in_file, path, manager), chunks)
    dataset.set_close(manager.close)
    return dataset


def _in_file(path: Path, manager: CachingFileManager, name: str, key: Index) -> np.ndarray:
    """Return the values of a variable that a key selects."""
    try:
        return np.asarray(manager.acquire()[name][key])
    except OSError as error:
        raise UnreadableError(path, error) from error


def _open_blocks(parts: Parts) -> xr.Dataset:
    """Open the finished blocks of a sweep as a Dataset."""
    schema = parts.file_schema
    box = schema.blocks[0]
    chunks = {name: tuple(schema.sizes(name, box).values()) for name in schema.variables}
    return _lazy(schema, parts.seconds, partial(_in_blocks, parts), chunks)


def _in_blocks(parts: Parts, name: str, key: Index) -> np.ndarray:
    """Return the values that a key selects, from all blocks that overlap them."""
    box: list[slice] = []
    within: list[int | slice | np.ndarray] = []
    for cut, values in zip(key, parts.schema.axes.values(), strict=False):
        indices = range(len(values))[cut] if isinstance(cut, slice) else np.atleast_1d(cut)
        first, last = (int(indices[0]), int(indices[-1])) if len(indices) else (0, -1)
        box.append(slice(first, last + 1))
        within.append(slice(None, None, cut.step) if isinstance(cut, slice) else cut - first)
    array = parts.values(tuple(box), [name], parts.entries)[name]
    # One axis at a time, the last first: an array would move to the front beside an integer.
    for axis, index in reversed(list(enumerate([*within, *key[len(within) :]]))):
        array = array[(slice(None),) * axis + (index,)]
    return array


def _lazy(
    schema: Schema,
    duration: float,
    read: Callable[[str, Index], np.ndarray],
    chunks: Mapping[str, tuple[int, ...]],
) -> xr.Dataset:
    """Return a sweep whose variables are read by `read(name, key)`, best in such `chunks`."""
    from sweeps.yaml_text import yaml_mapping

    data = {}
    for name in sorted(schema.variables):  # as in HDF5
        sizes, dtype = schema.sizes(name), np.dtype(VARIABLES[name].dtype)
        array = _Array(tuple(sizes.values()), dtype, partial(read, name))
        data[name] = tuple(sizes), indexing.LazilyIndexedArray(array)
    # A file of an earlier version lacks the parameters that came later.
    coordinates: dict[str, Any] = {name: ((), each.default) for name, each in PARAMETERS.items()}
    coordinates |= schema.coordinates()
    yaml_mapping(schema.attributes["computation"], "the computation")  # or refused
    dataset = xr.Dataset(data, coordinates, {**schema.attributes, "duration": duration})
    for called, variable in dataset.variables.items():
        variable.attrs = attributes_of(str(called), schema.attributes, schema.column_units)
    for name, lengths in chunks.items():
        pairs = zip(dataset[name].dims, lengths, strict=False)
        dataset.variables[name].encoding["preferred_chunks"] = dict(pairs)
    return dataset


@dataclass(eq=False)
class _Array(BackendArray):
    """A variable of a sweep."""

    shape: tuple[int, ...]
    dtype: np.dtype
    read: Callable[[Index], np.ndarray]

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        support = indexing.IndexingSupport.OUTER_1VECTOR
        return indexing.explicit_indexing_adapter(key, self.shape, support, self.read)
