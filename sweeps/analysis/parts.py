"""The points of a sweep read in parts, so that a record of any size fits into memory."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr

from sweeps.analysis.coordinates import COORDINATES, recorded_coordinate
from sweeps.grid import Grid, block_points

#: Number of section states read at a time.
_PART = 500_000


def records(dataset: xr.Dataset, name: str, at: np.ndarray) -> np.ndarray:
    """Return a coordinate at points given in C order, shape (k, record), reading in parts."""
    width = dataset.sizes[COORDINATES[name].dimension]
    result = np.empty((len(at), width))
    for part, cut in in_parts(dataset, _PART // width):
        wanted = np.flatnonzero((at >= cut.start) & (at < cut.stop))
        if len(wanted):
            values = recorded_coordinate(part, name).values.reshape(-1, width)
            result[wanted] = values[at[wanted] - cut.start]
    return result


def in_parts(dataset: xr.Dataset, size: int) -> Iterator[tuple[xr.Dataset, slice]]:
    """Yield parts of at most `size` points (at least 1), each with its slice of all in C order."""
    sizes, stop = dataset["status"].sizes, 0
    grid = Grid({str(name): np.empty(length) for name, length in sizes.items()}, {})
    for block in grid.blocks(max(1, size)):
        start, stop = stop, stop + block_points(block)
        yield dataset.isel(dict(zip(sizes, block, strict=True))), slice(start, stop)
