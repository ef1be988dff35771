"""The density of very many points over an axis, read and counted a part at a time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure

from sweeps.plotting_marks import BLUE, cell_edges

# Starts well away from white, so that a pixel met once is still seen.
COLOURS = LinearSegmentedColormap.from_list("density", ["#A6CBE3", BLUE, "#00263D"])

NORM = LogNorm(1e-3, 1.0, clip=True)

#: Numbers of a record that are read at a time.
_PART = 1_000_000


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


def extent(record: xr.DataArray, good: np.ndarray) -> tuple[float, float]:
    """Return the least and the greatest value of a record; inf, -inf where there is none."""
    low, high = np.inf, -np.inf
    for _, values in parts(record, good):
        values = values[np.isfinite(values)]
        low, high = values.min(initial=low), values.max(initial=high)
    return float(low), float(high)


def add_bar(figure: Figure, panel: Axes) -> None:
    """Put the colour bar of a density beside a panel."""
    bar = figure.colorbar(ScalarMappable(NORM, COLOURS), ax=panel, pad=0.01, aspect=40)
    bar.set_label("share of the points of a column")


def draw_density(
    figure: Figure,
    panel: Axes,
    values: np.ndarray,
    record: xr.DataArray,
    good: np.ndarray,
    dpi: int,
) -> None:
    """Draw the share of each column's points that fall into each of its pixels.

    Everything else must be in its place, as the pixels are those of the finished panel at `dpi`. A
    column is one value of the axis, or one pixel where there are more values than pixels.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Along the axis.
    record : DataArray, shape (n, record)
    good : ndarray of bool, shape (n,)
        Which points to draw.
    """
    figure.draw_without_rendering()  # lays the figure out
    box = panel.get_window_extent()
    columns, rows = (round(size * dpi / figure.dpi) for size in (box.width, box.height))
    low, high = panel.get_ylim()
    across = cell_edges(np.sort(values), panel.get_xscale() == "log")
    if len(values) > columns:
        space = np.geomspace if panel.get_xscale() == "log" else np.linspace
        across = space(values.min(), values.max(), columns + 1)
    counts = np.zeros((len(across) - 1, rows))
    column = np.clip(np.searchsorted(across, values, side="right") - 1, 0, len(counts) - 1)
    for indices, y in parts(record, good):
        finite = np.isfinite(y)
        row = ((y[finite] - low) * (rows / (high - low))).astype(np.int64)
        flat = np.repeat(column[indices], finite.sum(axis=1)) * rows + row
        counts += np.bincount(flat, minlength=counts.size).reshape(counts.shape)
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    panel.pcolormesh(
        across,
        np.linspace(low, high, rows + 1),
        np.ma.masked_equal(share, 0.0).T,
        norm=NORM,
        cmap=COLOURS,
        rasterized=True,
    )
