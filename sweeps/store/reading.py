"""A sweep as an ``xarray.Dataset`` whose variables are read when used.

They are read from the complete file, or from the blocks while the sweep is incomplete. The class of
the arrays implements the interface of an xarray backend
(https://docs.xarray.dev/en/stable/internals/how-to-add-new-backend.html). The engine ``h5netcdf``
opens the same file, too, but asks HDF5 for the metadata of each variable some forty times.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray, CachingFileManager
from xarray.core import indexing

from sweeps.errors import StoreError
from sweeps.store.complete_file import check_file, open_file, schema_of
from sweeps.store.parts import Parts
from sweeps.store.paths import SCHEMA, Content, content, parts_path
from sweeps.store.replacing import UnreadableError, identity, reason
from sweeps.store.schema import Schema, attributes_of, of_this_form, schema_in
from sweeps.store.variables import VARIABLES
from sweeps.yaml_text import yaml_mapping
from vibroimpact.oscillator import PARAMETERS

#: What selects values along each dimension; at most one array.
Index = tuple[int | slice | np.ndarray, ...]

_MISSING = (None, Content.NOTHING)


def read_sweep(path: Path, verify: bool) -> xr.Dataset:
    """Return the Dataset of `open_sweep`, whose arrays are read each time they are used."""
    try:
        folder = parts_path(path)
        while True:  # a run may complete the file, or begin another one, between two steps
            if content(path) not in _MISSING or identity(folder / SCHEMA) is None:
                return _opened(path, check_file(path, verify=verify))
            try:
                parts = Parts(folder, schema_of(folder / SCHEMA), verify=verify)
                if content(path) in _MISSING:
                    with of_this_form(folder / SCHEMA):
                        return _incomplete(parts)
            except StoreError:
                if content(path) in _MISSING:
                    raise
    except (OSError, ValueError) as error:
        raise StoreError(f"{str(path)!r} cannot be read: {reason(error)}") from error


def _opened(path: Path, digest: str) -> xr.Dataset:
    """Open a complete file for the arrays of the Dataset, and again if xarray has closed it."""
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


def _incomplete(parts: Parts) -> xr.Dataset:
    """Open the finished blocks of a sweep as a Dataset.

    Points that are not computed yet have the status ``PENDING`` and the values NaN or -1.
    """
    schema = parts.file_schema
    box = schema.blocks[0]
    chunks = {name: tuple(schema.sizes(name, box).values()) for name in schema.variables}
    return _lazy(schema, parts.seconds, partial(_in_blocks, parts), chunks)


def _in_blocks(parts: Parts, name: str, key: Index) -> np.ndarray:
    """Return the values that a key selects, from all blocks that overlap them."""
    box: list[slice] = []
    rest: list[int | slice | np.ndarray] = []
    for cut, values in zip(key, parts.schema.axes.values(), strict=False):
        chosen = range(len(values))[cut] if isinstance(cut, slice) else np.atleast_1d(cut)
        first, last = (int(chosen[0]), int(chosen[-1])) if len(chosen) else (0, -1)
        box.append(slice(first, last + 1))
        rest.append(slice(None, None, cut.step) if isinstance(cut, slice) else cut - first)
    array = parts.values(tuple(box), [name], parts.entries)[name]
    # One axis at a time, the last first: an array would move to the front beside an integer.
    for axis, index in reversed(list(enumerate([*rest, *key[len(rest) :]]))):
        array = array[(slice(None),) * axis + (index,)]
    return array


def _lazy(
    schema: Schema,
    duration: float,
    read: Callable[[str, Index], np.ndarray],
    chunks: Mapping[str, tuple[int, ...]],
) -> xr.Dataset:
    """Return a sweep whose variables are read by `read(name, key)`, best in such `chunks`."""
    data = {}
    for name in sorted(schema.variables):  # as in HDF5
        sizes, dtype = schema.sizes(name), np.dtype(VARIABLES[name].dtype)
        array = _Array(tuple(sizes.values()), dtype, partial(read, name))
        data[name] = tuple(sizes), indexing.LazilyIndexedArray(array)
    # A file of an earlier version lacks the parameters that came later.
    coordinates: dict[str, Any] = {name: ((), one.default) for name, one in PARAMETERS.items()}
    coordinates |= schema.coordinates()
    yaml_mapping(schema.attributes.get("computation", "{}"), "the computation")  # or refused
    dataset = xr.Dataset(data, coordinates, {**schema.attributes, "duration": duration})
    for called, variable in dataset.variables.items():
        variable.attrs = attributes_of(schema, str(called))
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
