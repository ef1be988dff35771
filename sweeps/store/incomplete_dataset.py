"""An incomplete sweep as an ``xarray.Dataset``, whose variables are read from its blocks."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import xarray as xr

from sweeps.grid import box_shape
from sweeps.store.lazy_dataset import Key, lazy_dataset
from sweeps.store.parts import Parts
from sweeps.store.variables import VARIABLES


def open_parts(parts: Parts) -> xr.Dataset:
    """Open the finished blocks of a sweep as a Dataset.

    Points that are not computed yet have the status ``PENDING`` and the values NaN or -1.
    """
    schema = parts.schema.with_samples(parts.samples)
    shapes = {name: schema.shape_of(name) for name in schema.variables}
    box = box_shape(schema.blocks[0])
    chunks = {name: schema.shape_of(name, box) for name in shapes}
    return lazy_dataset(schema, parts.seconds, partial(_selected, parts, shapes), chunks)


def _selected(parts: Parts, shapes: dict[str, tuple[int, ...]], name: str, key: Key) -> np.ndarray:
    """Return the values that a key selects, from all blocks that overlap them."""
    pairs = [_windowed(cut, n) for cut, n in zip(key, shapes[name], strict=True)]
    window = [cut for cut, _ in pairs]
    found = np.full(box_shape(tuple(window)), VARIABLES[name].fill_value)
    for number in parts.entries:
        box = parts.box(number, name)
        common = [
            slice(max(a.start, b.start), min(a.stop, b.stop))
            for a, b in zip(box, window, strict=True)
        ]
        if all(cut.start < cut.stop for cut in common):
            array = parts.read(number, [name])[name]
            found[_within(window, common)] = array[_within(box, common)]
    # One axis at a time, the last first: an array would move to the front beside an integer.
    for axis, (_, rest) in reversed(list(enumerate(pairs))):
        found = found[(slice(None),) * axis + (rest,)]
    return found


def _windowed(cut: int | slice | np.ndarray, length: int) -> tuple[slice, int | slice | np.ndarray]:
    """Return the slice that holds what an index selects, and the index within that slice."""
    chosen = range(length)[cut] if isinstance(cut, slice) else np.atleast_1d(cut)
    first, last = (chosen[0], chosen[-1]) if len(chosen) else (0, -1)
    rest = slice(None, None, cut.step) if isinstance(cut, slice) else cut - first
    return slice(int(first), int(last) + 1), rest


def _within(box: Sequence[slice], part: Sequence[slice]) -> tuple[slice, ...]:
    """Return the slices of a part relative to the start of its box."""
    pairs = zip(part, box, strict=True)
    return tuple(slice(cut.start - of.start, cut.stop - of.start) for cut, of in pairs)
