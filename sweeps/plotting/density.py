"""The density of very many points over an axis. The file is read and counted in parts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, LogNorm

from sweeps.analysis.coordinates import COORDINATES, recorded_coordinate
from sweeps.plotting.canvas import figure_of
from sweeps.plotting.palette import BOTH_COLOUR, DENSITY, DIRECTION_COLOURS, LEAST_SHARE
from sweeps.plotting.pixels import cell_edges, count_pixels
from sweeps.plotting.style import dots_per_inch

# Those of two directions end at full colours: darker colours look the same where the motion is
# periodic.
_ONE_RAMP = LinearSegmentedColormap.from_list("density", DENSITY)
_DIRECTION_RAMPS = [
    LinearSegmentedColormap.from_list("density", colours)
    for colours in (
        ["#A6CBE3", DIRECTION_COLOURS[0]],
        ["#F5D79A", DIRECTION_COLOURS[1]],
        ["#CCCCCC", BOTH_COLOUR],
    )
]

_NORM = LogNorm(LEAST_SHARE, 1.0, clip=True)

#: How many numbers of a record are read at a time.
_PART_SIZE = 1_000_000


@dataclass(frozen=True)
class Record:
    """What is drawn of one direction: a `coordinate` of the points of a `line` that are `computed`.

    The last has the shape (n,).
    """

    line: xr.Dataset
    coordinate: str
    computed: np.ndarray

    @property
    def values(self) -> xr.DataArray:
        """Those of all points, shape (n, width), padded with NaN."""
        return recorded_coordinate(self.line, self.coordinate)

    @property
    def width(self) -> int:
        """How many values a point has at most."""
        return self.line.sizes[COORDINATES[self.coordinate].record]

    @property
    def size(self) -> int:
        """How many values there are at most."""
        return int(np.count_nonzero(self.computed)) * self.width

    def parts(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Read the computed points, some at a time: their indices, (k,), and values, (k, width)."""
        (axis,) = self.line["status"].dims
        rows = max(1, _PART_SIZE // self.width)
        for start in range(0, len(self.computed), rows):
            kept = np.flatnonzero(self.computed[start : start + rows])
            if len(kept):
                part = self.line.isel({axis: slice(start, start + rows)})
                yield start + kept, recorded_coordinate(part, self.coordinate).values[kept]


def value_range(records: Sequence[Record]) -> tuple[float, float]:
    """Return the least and the greatest value of records; inf, -inf where there is none."""
    low, high = np.inf, -np.inf
    for record in records:
        for _, values in record.parts():
            values = values[np.isfinite(values)]
            low, high = values.min(initial=low), values.max(initial=high)
    return float(low), float(high)


def add_density_bar(panel: Axes, directions: int) -> None:
    """Put the colour bar of a density beside a panel.

    The ramps of two directions and of both have the same scale; the bar shows that of both.
    """
    ramp = _ONE_RAMP if directions == 1 else _DIRECTION_RAMPS[2]
    bar = figure_of(panel).colorbar(ScalarMappable(_NORM, ramp), ax=panel, pad=0.01, aspect=40)
    bar.set_label("share of the points of a column")


def draw_density(panel: Axes, values: np.ndarray, records: Sequence[Record]) -> None:
    """Draw the share of each column's points that fall into each of its pixels.

    Call it last: the pixels are those of the finished panel in a PNG. A column is one of the
    `values` of the axis, or one pixel where there are more values than pixels. Of the records of
    two directions, a pixel has the colour of the direction that meets it, or that of both.
    """
    figure, dpi = figure_of(panel), dots_per_inch()
    figure.draw_without_rendering()  # lays the figure out
    box = panel.get_window_extent()
    columns, rows = (round(size * dpi / figure.dpi) for size in (box.width, box.height))
    low, high = panel.get_ylim()
    log = panel.get_xscale() == "log"
    left, right = sorted(panel.get_xlim())
    in_view = np.sort(values[(values >= left) & (values <= right)])
    in_view = in_view if len(in_view) > 1 else np.sort(values)
    x_edges = cell_edges(in_view, log)
    if len(in_view) > columns:
        x_edges = (np.geomspace if log else np.linspace)(in_view[0], in_view[-1], columns + 1)
    y_edges = np.linspace(low, high, rows + 1)
    shares = [_column_shares(record, values, x_edges, y_edges) for record in records]
    if len(shares) == 2:
        in_both = (shares[0] > 0.0) & (shares[1] > 0.0)
        mean = np.where(in_both, 0.5 * (shares[0] + shares[1]), 0.0)
        shares = [*(np.where(in_both, 0.0, share) for share in shares), mean]
    ramps = _DIRECTION_RAMPS if len(shares) > 1 else [_ONE_RAMP]
    for share, ramp in zip(shares, ramps, strict=True):
        cells = np.ma.masked_equal(share, 0.0).T
        panel.pcolormesh(x_edges, y_edges, cells, norm=_NORM, cmap=ramp, rasterized=True)


def _column_shares(
    record: Record, values: np.ndarray, x_edges: np.ndarray, y_edges: np.ndarray
) -> np.ndarray:
    """Return the share of each column's points in each of its pixels, shape (columns, rows)."""
    low, high, rows = y_edges[0], y_edges[-1], len(y_edges) - 1
    counts = np.zeros((len(x_edges) - 1, rows))
    column = np.searchsorted(x_edges, values, side="right") - 1
    column[values == x_edges[-1]] = len(counts) - 1
    in_view = (column >= 0) & (column < len(counts))
    for indices, y in record.parts():
        indices, y = indices[in_view[indices]], y[in_view[indices]]
        counts += count_pixels(column[indices], y, (len(counts), rows), low, high)
    return counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
