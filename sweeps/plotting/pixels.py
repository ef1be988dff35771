"""Converts points to shares of a panel, cells and pixels: those in view; draws their density."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PathCollection
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure

from sweeps.opened.coordinates import ORDINATES, coordinate_in, in_chunks
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting import style
from vibroimpact.points.regimes import has_result


def figure_of(artist: Artist) -> Figure:
    """Return the top-level figure of a panel or a text, also if it is in a subfigure."""
    figure = artist.get_figure(root=True)
    assert figure is not None
    return figure


def in_panel(panel: Axes, points: np.ndarray) -> np.ndarray:
    """Return points of a panel, shape (n, 2), as shares of its width and height."""
    shares: np.ndarray = panel.transAxes.inverted().transform(panel.transData.transform(points))
    return shares


def in_view(panel: Axes, x: Any, y: Any) -> np.ndarray:
    """Return which points are within the limits of a panel, or at them; False for NaN."""
    (left, right), (low, high) = panel.get_xbound(), panel.get_ybound()
    return np.asarray((left <= x) & (x <= right) & (low <= y) & (y <= high))


def points_in(panel: Axes) -> np.ndarray:
    """Return the points of the lines and the dots of a panel, shape (n, 2)."""
    data = panel.transData  # an `axhline` has another transform
    points = [line.get_xydata() for line in panel.lines if line.get_transform() == data]
    dots = (each for each in panel.collections if isinstance(each, PathCollection))
    points += [np.ma.filled(each.get_offsets(), np.nan) for each in dots]
    return np.concatenate([np.empty((0, 2)), *points])


def runs(values: Iterable[Any]) -> Iterator[tuple[int, int, Any]]:
    """Yield the runs of equal values: the first index, the one after the last, and the value."""
    start = 0
    for value, run in groupby(values):
        stop = start + len([*run])
        yield start, stop, value
        start = stop


def pixels_of(
    columns: np.ndarray, values: np.ndarray, rows: int, low: float, high: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the row of each of the `values` (k, width) that is in view, and its pixel."""
    # The `columns` of the points are all within the panel; `values` have NaN for missing ones. The
    # ordinate ranges from `low` to `high`. The pixels are numbered column by column.
    scaled = np.floor((values - low) * (rows / (high - low)))
    visible = (scaled >= 0.0) & (scaled < rows)  # False for NaN
    index = np.repeat(np.arange(len(columns)), visible.sum(axis=1))
    return index, columns[index] * rows + scaled[visible].astype(np.int64)


def widened(low: float, high: float) -> tuple[float, float]:
    """Return a range, widened to the size of its values if they differ only by rounding."""
    size = max(abs(low), abs(high))
    if not high - low < 1e-6 * size:  # this also excludes NaN and infinity
        return low, high
    middle = 0.5 * (low + high)
    return middle - 0.5 * size, middle + 0.5 * size


def cell_edges(values: np.ndarray, log: bool) -> np.ndarray:
    """Return the n + 1 edges halfway between n increasing values, or around a repeated one."""
    # With `log` halfway on a logarithmic scale. The cell of a single value is as wide as its
    # magnitude, or 1 at 0; if it is repeated, the cells share this.
    if values[0] == values[-1]:
        half = 0.5 * abs(values[0]) or 0.5
        return np.linspace(values[0] - half, values[0] + half, len(values) + 1)
    values = np.log(values) if log else values
    inner = 0.5 * (values[1:] + values[:-1])
    edges = np.array([2.0 * values[0] - inner[0], *inner, 2.0 * values[-1] - inner[-1]])
    return np.exp(edges) if log else edges


_SCALE_OF_SHARES = LogNorm(style.LEAST_SHARE, 1.0, clip=True)


def computed_chunks(line: OpenedSweep, coordinate: str) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield indices (k,) of computed points of a line and their values (k, record), in chunks."""
    computed = has_result(line["status"].values)
    for chunk, cut in in_chunks(line.data, line.sizes[ORDINATES[coordinate].dimension]):
        indices = np.flatnonzero(computed[cut])
        if len(indices):
            yield cut.start + indices, coordinate_in(chunk, coordinate).values[indices]


def value_ranges(lines: Sequence[OpenedSweep], coordinate: str) -> np.ndarray:
    """Return the least and the greatest value at each point of lines, (n, 2); NaN for none."""
    ranges = np.full((lines[0]["status"].size, 2), np.nan)
    for line in lines:
        for points, values in computed_chunks(line, coordinate):
            values = np.where(np.isfinite(values), values, np.nan)
            for column, least_or_most in enumerate((np.fmin, np.fmax)):
                extremes = least_or_most.reduce(values, axis=1)
                ranges[points, column] = least_or_most(ranges[points, column], extremes)
    return ranges


def _ramps(colours: Sequence[str]) -> list[LinearSegmentedColormap]:
    """Return the ramp of shares, from the least to 1: of one direction, or of up, down and both."""
    # Those of directions end at full colours: where all is periodic, dark ends would look the same.
    both = len(colours) > 0
    hues = [*colours, style.dot_colour(style.BOTH_COLOUR)] if both else [style.data_colour()]
    count, ramp = 2 if both else 3, LinearSegmentedColormap.from_list
    shades = (style.shades(colour, style.ground(), style.ink())[:count] for colour in hues)
    return [ramp("density", [*map(style.dot_colour, colours)]) for colours in shades]


def draw_density(
    panel: Axes,
    values: np.ndarray,
    directions: Sequence[OpenedSweep],
    coordinate: str,
    colours: Sequence[str],
    tint: np.ndarray | None = None,
) -> bool:
    """Draw the share of each column's points in each pixel, with a bar; return if there is any."""
    # Last, because the pixels are those of the finished panel in a PNG. A column is one of the
    # `values` of the axis, or one pixel wide if there are more values than pixels. With two
    # directions a pixel has the colour of the one with points in it, or of both; with a `tint` for
    # each point, shape (n, 4), that of one in it.
    figure = figure_of(panel)
    ramps = _ramps(colours if len(directions) > 1 else ())
    if tint is None:
        bar = figure.colorbar(
            ScalarMappable(_SCALE_OF_SHARES, ramps[-1]), ax=panel, pad=0.01, aspect=40
        )
        bar.set_label("share of the points of a column")
    figure.draw_without_rendering()  # computes the layout
    edges = _edges_of_pixels(panel, values, style.dots_per_inch() / figure.dpi)
    shape = len(edges[0]) - 1, len(edges[1]) - 1
    if tint is not None:
        point_in = np.full(shape, -1)
        for number, pixel in _pixels_in_view(directions[0], coordinate, values, *edges):
            point_in.reshape(-1)[pixel] = number
        image = np.append(tint, np.zeros((1, 4)), axis=0)[point_in]
        panel.pcolormesh(*edges, image.swapaxes(0, 1), rasterized=True)
        return bool((point_in >= 0).any())
    shares = []
    for direction in directions:
        counts = np.zeros(shape)
        for _, pixel in _pixels_in_view(direction, coordinate, values, *edges):
            counts += np.bincount(pixel, minlength=counts.size).reshape(counts.shape)
        shares.append(counts / np.maximum(counts.sum(axis=1, keepdims=True), 1))
    if len(shares) == 2:
        both = (shares[0] > 0.0) & (shares[1] > 0.0)
        mean = np.where(both, 0.5 * (shares[0] + shares[1]), 0.0)
        shares = [*(np.where(both, 0.0, share) for share in shares), mean]
    for share, ramp in zip(shares, ramps, strict=True):
        cells = np.ma.masked_equal(share, 0.0).T
        panel.pcolormesh(*edges, cells, norm=_SCALE_OF_SHARES, cmap=ramp, rasterized=True)
    return any(share.any() for share in shares)


def _edges_of_pixels(
    panel: Axes, values: np.ndarray, scale: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the edges of the columns and the rows of a panel whose pixels are a `scale` finer."""
    box, (low, high) = panel.get_window_extent(), panel.get_ylim()
    columns, rows = (round(size * scale) for size in (box.width, box.height))
    log = panel.get_xscale() == "log"
    left, right = sorted(panel.get_xlim())
    visible = np.sort(values[(values >= left) & (values <= right)])
    visible = visible if len(visible) > 1 else np.sort(values)
    x_edges = cell_edges(visible, log)
    if len(visible) > columns:
        x_edges = (np.geomspace if log else np.linspace)(visible[0], visible[-1], columns + 1)
    return x_edges, np.linspace(low, high, rows + 1)


def _pixels_in_view(
    line: OpenedSweep, coordinate: str, values: np.ndarray, x_edges: np.ndarray, y_edges: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the points of a line in a panel in parts: their number, the number of their pixel."""
    column = np.searchsorted(x_edges, values, side="right") - 1
    column[values == x_edges[-1]] = len(x_edges) - 2
    visible = (column >= 0) & (column < len(x_edges) - 1)
    for indices, y in computed_chunks(line, coordinate):
        indices, y = indices[visible[indices]], y[visible[indices]]
        index, pixel = pixels_of(column[indices], y, len(y_edges) - 1, *y_edges[[0, -1]])
        yield indices[index], pixel
