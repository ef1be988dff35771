"""Draws dots of motions, marks of failed points, jumps between directions, the stop."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from sweeps.plotting.labels import equation, refuse_too_large, set_lim, status_name
from sweeps.plotting.pixels import figure_of, in_panel, in_view, runs, widened
from sweeps.plotting.style import MARKS, STATUS_COLOURS, data_colour, dot_colour, ground, ink

#: Height of the middle of the strip of marks, as a share of the panel.
_HEIGHT = 0.015
#: Most markers of one look along a side of a panel.
_PER_SIDE = 20
#: Values of both directions are one if they differ by less than this share of the panel. Motions
#: differ if their values are farther apart on the mean, and a jump with an arrow is longer.
_SAME, _APART, _JUMP = 0.004, 0.01, 0.04


def draw_points(
    panel: Axes,
    x: np.ndarray,
    y: np.ndarray,
    colour: str | np.ndarray | None = None,
    size: float | None = None,
    most: float = 3.5,
    marker: str = "o",
) -> None:
    """Draw markers in one colour or one each, at most so large, smaller the more they cover."""
    # The colours have the shape (n, 4); none is the plain one.
    if not len(y):
        return
    size = marker_size(x, y, 0.5, most) if size is None else size
    alpha = float(np.clip(1e5 / len(y), 0.15, 1.0))
    colour = data_colour() if colour is None else colour
    props: dict[str, Any] = {"alpha": alpha, "rasterized": True}
    if isinstance(colour, str):
        (points,) = panel.plot(x, y, marker, linestyle="", color=colour, **props)
        points.set(markersize=size, markeredgewidth=0)
    else:
        panel.scatter(x, y, size**2, colour, linewidths=0, **props)


def mark_some(panel: Axes, points: np.ndarray, marker: str, colour: str) -> None:
    """Mark some of the points, shape (n, 2), about evenly in a panel that has its limits."""
    panel.autoscale_view()  # matplotlib delays it, and the transformations do not ask for it
    points = points[np.isfinite(points).all(axis=1)]
    _, some = np.unique(np.floor(_PER_SIDE * in_panel(panel, points)), axis=0, return_index=True)
    (markers,) = panel.plot(*points[some].T, marker, color=colour, rasterized=True)
    markers.set(markersize=4.0, markeredgewidth=edge_of(marker), zorder=4.0)
    if edge_of(marker):
        markers.set_path_effects([withStroke(linewidth=2.0, foreground=ground())])


def edge_of(marker: str) -> float:
    """Return the width of the edge of a marker of data [pt], which only crosses have."""
    return 0.8 if marker in "+x" else 0.0


def marker_size(x: np.ndarray, y: np.ndarray, least: float, most: float) -> float:
    """Return the size [pt] of markers that leave parts of the panel around them visible."""
    counts, *_ = np.histogram2d(x, y, bins=(600, 300))
    return float(np.clip(70.0 / math.sqrt(max(1, int(np.count_nonzero(counts)))), least, most))


def draw_stop(
    draw_line: Callable[..., object], clearance: float, about: xr.DataArray | None = None
) -> None:
    """Draw the stop with a panel's `axhline` or `axvline`; `about` puts it into the legend."""
    refuse_too_large("clearance", clearance)
    text = None if about is None else f"stop, {equation(f'x={about.symbol}', about, clearance)}"
    draw_line(clearance, color=ink(), linewidth=0.8, linestyle="--", label=text)


def widen_if_constant(axis: Axis, low: float, high: float) -> None:
    """Widen an axis if the data are constant, so that it does not show rounding."""
    if (limits := widened(low, high)) != (low, high):
        set_lim(axis, *limits)


def mark_status(
    panel: Axes,
    values: np.ndarray,
    status: np.ndarray,
    masks: Mapping[str, np.ndarray] | None = None,
    grey: bool = False,
) -> None:
    """Mark failed and pending points, and `masks` by a name of ``MARKS``, in a strip below."""
    # The legend counts those within the limits of the abscissa, which must have been set, and those
    # without an abscissa. `values` are the abscissas, shape (n,); `status` and the `masks` have the
    # shape (n,) or (directions, n).
    kinds = [(status_name(s), colour, status == s) for s, colour in STATUS_COLOURS.items()]
    kinds += [(name, MARKS[name][grey], where) for name, where in (masks or {}).items()]
    kinds = [(name, dot_colour(colour), where) for name, colour, where in kinds if where.any()]
    if np.isin(status, list(STATUS_COLOURS)).any():
        low, high = panel.get_ylim()
        panel.set_ylim(low - 0.04 * (high - low), high)
    strip, x = panel.get_xaxis_transform(), np.broadcast_to(values, status.shape)
    for text, colour, where in kinds:
        marks, props = x[where], dict[str, Any](transform=strip, color=colour, rasterized=True)
        if text in MARKS:
            marks, is_beside = _spread(panel, x, where)
            pairs = np.stack([marks[:-1], marks[1:]], axis=1)[is_beside]
            bars = [[(left, _HEIGHT), (right, _HEIGHT)] for left, right in pairs.tolist()]
            if bars:
                panel.add_collection(LineCollection(bars, linewidth=6, **props), autolim=False)
        panel.plot(marks, np.full(marks.shape, _HEIGHT), "|", markersize=6, **props)
    left, right = panel.get_xbound()
    visible = ~((x < left) | (right < x))
    for text, colour, where in kinds:
        if count := np.count_nonzero(where & visible):
            text = f"{text} ({count:,} of {np.count_nonzero(visible):,})"
            panel.plot([], [], linewidth=5, solid_capstyle="butt", color=colour, label=text)


def _spread(panel: Axes, x: np.ndarray, where: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return abscissas of marks with the share of the points, and if the next one is beside."""
    # A mark is a point wide. Where several values are in it, those with most marked values have
    # one.
    values, index = np.unique(x, return_inverse=True)
    is_marked = np.bincount(index.ravel(), where.ravel()) > 0.0
    panel.get_xlim()  # matplotlib delays the limits
    across = panel.transData.transform(np.stack([values, values], axis=1))[:, 0]
    positions = np.floor(across * 72.0 / figure_of(panel).dpi)
    columns, column = np.unique(positions, return_inverse=True)
    counts = np.bincount(column, is_marked)
    sums = np.bincount(column, np.where(is_marked, values, 0.0))
    most = math.ceil(is_marked.mean() * len(counts))
    best = np.argsort(-counts / np.bincount(column), kind="stable")[:most]
    best = np.sort(best[counts[best] > 0.0])
    return sums[best] / counts[best], np.diff(columns[best]) == 1.0


def nearest_distances(values: np.ndarray, others: np.ndarray, size: float) -> np.ndarray:
    """Return the distance of each value from the nearest other in its row, in `size`, up to 2."""
    # The arrays have the shapes (n, k) and (n, l), with NaN for no value, as the result, shape (n,
    # k). The distance is 2 if there are no others in the row.
    row = 5.0 * np.arange(len(values))[:, None]  # more than any distance
    low = np.fmin(*(np.min(each[np.isfinite(each)], initial=np.inf) for each in (values, others)))
    # Without an exponent of -inf, that of a motion with rest.
    finite = (np.where(np.isfinite(each), each, np.nan) for each in (values, others))
    keys, there = (row + (each - low) / size for each in finite)
    there = np.concatenate([[-np.inf], np.sort(there[np.isfinite(there)]), [np.inf]])
    after = np.searchsorted(there, keys).clip(1, len(there) - 1)
    return np.minimum(np.minimum(keys - there[after - 1], there[after] - keys), 2.0)


def _extent(*values: np.ndarray) -> float:
    """Return the range of all finite values."""
    every = np.concatenate([each[np.isfinite(each)] for each in values])
    return float(np.ptp(every)) if every.size else 0.0


def agreeing(up: np.ndarray, down: np.ndarray, chaos: np.ndarray) -> list[np.ndarray]:
    """Return the masks of the values of each direction that the other, or the same chaos, has."""
    size = _extent(up, down) or 1.0
    near = np.where(chaos & ~_motions_differ(up, down, size), 2.0, _SAME)[:, None]
    return [nearest_distances(up, down, size) < near, nearest_distances(down, up, size) < near]


def in_both(columns: np.ndarray, axis: int) -> np.ndarray:
    """Return the mask of points, shape (2, ..., k), that both directions along an axis have."""
    # The points have NaN for no value; the mask has the shape (..., k).
    from scipy.spatial import cKDTree

    low, high = (extreme(columns.reshape(2, -1), axis=1) for extreme in (np.nanmin, np.nanmax))
    size = np.where(high > low, high - low, 1.0)
    points = np.moveaxis(np.moveaxis(columns, 0, -1) / size, axis, 0)  # (direction, ..., k, 2)
    number = np.arange(float(np.prod(points.shape[1:-2]))).reshape(*points.shape[1:-2], 1, 1)
    # A third coordinate keeps the values of different points apart.
    points = np.append(points, np.broadcast_to(number, points.shape)[..., :1], axis=-1)
    finite = np.asarray(np.isfinite(points).all(axis=-1))
    both = np.zeros(finite.shape, bool)
    up, down = (each[mask] for each, mask in zip(points, finite, strict=True))
    if len(up) and len(down):
        both[0][finite[0]] = cKDTree(down).query(up, p=np.inf)[0] < _SAME
        both[1][finite[1]] = cKDTree(up).query(down, p=np.inf)[0] < _SAME
    return np.moveaxis(both, 0, axis)


def _motions_differ(first: np.ndarray, second: np.ndarray, size: float) -> np.ndarray:
    """Whether the motions in each row differ, shape (n,)."""
    away = [nearest_distances(a, b, size) for a, b in ((first, second), (second, first))]
    means = [
        np.nan_to_num(each).sum(axis=1) / np.maximum(np.isfinite(each).sum(axis=1), 1)
        for each in away
    ]
    return np.maximum(*means) > _APART


def draw_jumps(
    panel: Axes, x: np.ndarray, up: np.ndarray, down: np.ndarray, colours: Sequence[str]
) -> list[Artist]:
    """Draw an arrow to the next motion at each end of a range of x in which directions differ."""
    # An end is the last value, in a direction, of such a range. `x`, shape (n,), increases; `up`
    # and `down` are values of the points, shape (n, k). The handle for the legend is of any arrow
    # in view.
    size, handles = _extent(up, down) or 1.0, list[Artist]()
    for start, stop, differ in runs(_motions_differ(up, down, size).tolist()):
        if not differ:
            continue
        for motion, i, j, colour in (
            (up, stop - 1, stop, colours[0]),
            (down, start, start - 1, colours[1]),
        ):
            if not 0 <= j < len(x):
                continue
            away = nearest_distances(motion[[i]], motion[[j]], size)[0]
            if not _JUMP < np.nanmax(away, initial=0.0) < 2.0:
                continue
            begin = motion[i, int(np.nanargmax(away))]
            end = motion[j, int(np.nanargmin(np.abs(motion[j] - begin)))]
            props = {"arrowstyle": "-|>", "color": colour, "lw": 0.8, "mutation_scale": 7.0}
            panel.annotate(
                "", (x[j], end), (x[i], begin), arrowprops={**props, "shrinkA": 0, "shrinkB": 0}
            )
            if not in_view(panel, x[j], end):  # nor is the arrow
                continue
            shape: dict[str, Any] = {"linestyle": "", "marker": r"$\rightarrow$", "markersize": 8.0}
            handles = [Line2D([], [], color=ink(), markeredgewidth=0, label="jump", **shape)]
    return handles
