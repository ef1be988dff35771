"""The density of very many points over an axis, read and counted a part at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure

from sweeps.plotting.marks import BLUE, ORANGE, cell_edges

#: The colours of the directions in which an axis was followed, the first that of every sweep, and
#: of what is met in both.
DIRECTION_COLOURS = (BLUE, ORANGE)
BOTH_COLOUR = "#222222"

# All start well away from white, so that a pixel met once is still seen. Of two directions, the
# ramps end at full colours: darker ones could not be told apart where the motion is periodic.
_RAMP = LinearSegmentedColormap.from_list("density", ["#A6CBE3", BLUE, "#00263D"])
_RAMPS = [
    LinearSegmentedColormap.from_list("density", colours)
    for colours in (
        ["#A6CBE3", DIRECTION_COLOURS[0]],
        ["#F5D79A", DIRECTION_COLOURS[1]],
        ["#CCCCCC", BOTH_COLOUR],
    )
]

NORM = LogNorm(1e-3, 1.0, clip=True)

#: Numbers of a record that are read at a time.
_PART = 1_000_000


class Drawn(Protocol):
    """A record of shape (axis, record), and which of its points are to be drawn."""

    @property
    def record(self) -> xr.DataArray: ...

    @property
    def good(self) -> np.ndarray: ...


def parts(record: xr.DataArray, good: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Read a record of shape (axis, record) a part at a time, without the points that are not good.

    Yields
    ------
    indices : ndarray of int, shape (k,)
        Along the axis.
    values : ndarray, shape (k, record)
    """
    rows = max(1, _PART // record.shape[1])
    for start in range(0, len(good), rows):
        keep = np.flatnonzero(good[start : start + rows])
        if len(keep):
            yield start + keep, record[start : start + rows].values[keep]


def extent(drawn: Sequence[Drawn]) -> tuple[float, float]:
    """Return the least and the greatest value of records; inf, -inf where there is none."""
    low, high = np.inf, -np.inf
    for one in drawn:
        for _, values in parts(one.record, one.good):
            values = values[np.isfinite(values)]
            low, high = values.min(initial=low), values.max(initial=high)
    return float(low), float(high)


def add_bar(figure: Figure, panel: Axes, directions: int) -> None:
    """Put the colour bar of a density beside a panel: of two directions, that of what is in both.

    The ramps of either direction run alike.
    """
    ramp = _RAMP if directions == 1 else _RAMPS[2]
    bar = figure.colorbar(ScalarMappable(NORM, ramp), ax=panel, pad=0.01, aspect=40)
    bar.set_label("share of the points of a column")


def draw_density(
    figure: Figure, panel: Axes, values: np.ndarray, drawn: Sequence[Drawn], dpi: int
) -> None:
    """Draw the share of each column's points that fall into each of its pixels.

    Everything else must be in its place, as the pixels are those of the finished panel at `dpi`. A
    column is one value of the axis, or one pixel where there are more values than pixels. Of two
    directions, a pixel has the colour of the one that meets it, or that of both.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Along the axis.
    drawn : sequence of Drawn
        One, or one for each direction.
    """
    figure.draw_without_rendering()  # lays the figure out
    box = panel.get_window_extent()
    columns, rows = (round(size * dpi / figure.dpi) for size in (box.width, box.height))
    low, high = panel.get_ylim()
    across = cell_edges(np.sort(values), panel.get_xscale() == "log")
    if len(values) > columns:
        space = np.geomspace if panel.get_xscale() == "log" else np.linspace
        across = space(values.min(), values.max(), columns + 1)
    up = np.linspace(low, high, rows + 1)
    shares = [_share(one, values, across, up) for one in drawn]
    if len(shares) == 2:
        met = (shares[0] > 0.0) & (shares[1] > 0.0)
        both = np.where(met, 0.5 * (shares[0] + shares[1]), 0.0)
        shares = [*(np.where(met, 0.0, share) for share in shares), both]
    for share, ramp in zip(shares, _RAMPS if len(shares) > 1 else [_RAMP], strict=True):
        cells = np.ma.masked_equal(share, 0.0).T
        panel.pcolormesh(across, up, cells, norm=NORM, cmap=ramp, rasterized=True)


def _share(one: Drawn, values: np.ndarray, across: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return the share of each column's points in each of its pixels, shape (columns, rows)."""
    rows = len(up) - 1
    counts = np.zeros((len(across) - 1, rows))
    column = np.clip(np.searchsorted(across, values, side="right") - 1, 0, len(counts) - 1)
    for indices, y in parts(one.record, one.good):
        finite = np.isfinite(y)
        row = ((y[finite] - up[0]) * (rows / (up[-1] - up[0]))).astype(np.int64)
        flat = np.repeat(column[indices], finite.sum(axis=1)) * rows + row
        counts += np.bincount(flat, minlength=counts.size).reshape(counts.shape)
    return counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
