"""An incomplete sweep as an ``xarray.Dataset``, read from its blocks.

Its arrays are read when they are used, like those of a complete file. The classes implement the
interface of an xarray backend
(https://docs.xarray.dev/en/stable/internals/how-to-add-new-backend.html).
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import h5py
import numpy as np
import xarray as xr
from xarray.backends import BackendArray, BackendEntrypoint
from xarray.core import indexing

from sweeps.grid import box_shape
from sweeps.store.parts import Parts
from sweeps.store.schema import describe
from sweeps.store.variables import VARIABLES


def open_parts(parts: Parts) -> xr.Dataset:
    """Open the finished blocks of a sweep as a Dataset.

    Points that are not computed yet have the status ``PENDING`` and the values NaN or -1.
    """
    return xr.open_dataset(parts, engine=_PartsBackend)  # type: ignore[arg-type]


class _PartsBackend(BackendEntrypoint):
    """Opens the finished blocks of a sweep for xarray."""

    def open_dataset(self, filename_or_obj: Any, *, drop_variables: Any = None) -> xr.Dataset:
        parts: Parts = filename_or_obj
        schema, image = parts.schema.with_samples(parts.samples), io.BytesIO()
        with h5py.File(image, "w") as file:
            describe(file, schema)
            file.attrs["duration"] = parts.seconds
        with xr.open_dataset(image, engine="h5netcdf") as empty:
            dataset = empty.drop_vars(schema.variables).load()
            for name in schema.variables:
                data = indexing.LazilyIndexedArray(_Array(parts, name, schema.shape_of(name)))
                dataset[name] = xr.Variable(empty[name].dims, data, empty[name].attrs)
        return dataset


class _Array(BackendArray):
    """A variable of the finished blocks."""

    def __init__(self, parts: Parts, name: str, shape: tuple[int, ...]) -> None:
        self._parts, self._name = parts, name
        self.shape, self.dtype = shape, np.dtype(VARIABLES[name].dtype)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        support = indexing.IndexingSupport.BASIC
        return indexing.explicit_indexing_adapter(key, self.shape, support, self._read)

    def _read(self, key: tuple[int | slice, ...]) -> np.ndarray:
        """Return the values that integers and slices select, from all blocks that overlap them."""
        chosen = [
            range(n)[cut if isinstance(cut, slice) else slice(cut, cut + 1)]
            for cut, n in zip(key, self.shape, strict=True)
        ]
        window = [slice(one[0], one[-1] + 1) if one else slice(0, 0) for one in chosen]
        found = np.full(box_shape(tuple(window)), VARIABLES[self._name].fill_value)
        for number in self._parts.entries:
            box = self._parts.box(number, self._name)
            common = [
                slice(max(a.start, b.start), min(a.stop, b.stop))
                for a, b in zip(box, window, strict=True)
            ]
            if all(cut.start < cut.stop for cut in common):
                array = self._parts.read(number, [self._name])[self._name]
                found[_within(window, common)] = array[_within(box, common)]
        steps = (slice(None, None, c.step) if isinstance(c, slice) else 0 for c in key)
        return found[tuple(steps)]


def _within(box: Sequence[slice], part: Sequence[slice]) -> tuple[slice, ...]:
    """Return the slices of a part relative to the start of its box."""
    pairs = zip(part, box, strict=True)
    return tuple(slice(cut.start - of.start, cut.stop - of.start) for cut, of in pairs)
