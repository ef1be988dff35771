"""A sweep as an ``xarray.Dataset``, whose variables are read when they are used.

The class of its arrays implements the interface of an xarray backend
(https://docs.xarray.dev/en/stable/internals/how-to-add-new-backend.html). The engine ``h5netcdf``
opens the same file, too, but asks HDF5 for the metadata of each variable some forty times.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing

from sweeps.grid import TABLE
from sweeps.store.schema import Schema, attributes_of
from sweeps.store.variables import VARIABLES
from vibroimpact.oscillator import PARAMETERS

#: What selects values along each dimension; at most one array.
Key = tuple[int | slice | np.ndarray, ...]


def lazy_dataset(
    schema: Schema,
    duration: float,
    read: Callable[[str, Key], np.ndarray],
    chunks: Mapping[str, tuple[int, ...]],
) -> xr.Dataset:
    """Return a sweep whose variables are read by `read(name, key)`, best in such `chunks`."""
    data = {
        name: (schema.dimensions(name), indexing.LazilyIndexedArray(_Array(schema, name, read)))
        for name in sorted(schema.variables)  # as in HDF5
    }
    coordinates: dict[str, Any] = {name: ((), value) for name, value in schema.fixed.items()}
    for name, values in (*schema.axes.items(), *schema.records.items()):
        coordinates[name] = (name, 1 + np.arange(len(values)) if name == TABLE else values)
        for column in (name == TABLE and values.dtype.names) or ():
            coordinates[column] = (name, values[column])
    # A file of an earlier version lacks the parameters that came later.
    lacking = PARAMETERS.keys() - coordinates.keys()
    coordinates |= {name: ((), PARAMETERS[name].default) for name in lacking}
    dataset = xr.Dataset(data, coordinates, {**schema.attributes, "duration": duration})
    for called, variable in dataset.variables.items():
        variable.attrs = attributes_of(schema, str(called))
        if called in chunks:
            pairs = zip(variable.dims, chunks[str(called)], strict=True)
            variable.encoding["preferred_chunks"] = dict(pairs)
    return dataset


class _Array(BackendArray):
    """A variable of a sweep."""

    def __init__(self, schema: Schema, name: str, read: Callable[[str, Key], np.ndarray]) -> None:
        self._name, self._read = name, read
        self.shape, self.dtype = schema.shape_of(name), np.dtype(VARIABLES[name].dtype)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        support = indexing.IndexingSupport.OUTER_1VECTOR
        return indexing.explicit_indexing_adapter(key, self.shape, support, self._selected)

    def _selected(self, key: Key) -> np.ndarray:
        return self._read(self._name, key)
