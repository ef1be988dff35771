"""The two directions of a followed axis, and where a motion jumps."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting.contents import Wanted
from sweeps.plotting.style import ink
from sweeps.store import DIRECTION

#: Values of both directions are one if they differ by less than this share of the panel. Motions
#: differ if their values are farther apart on the mean, and a jump with an arrow is longer.
_SAME, _APART, _JUMP = 0.004, 0.01, 0.04


def colours_directions(sweep: OpenedSweep, color: Wanted) -> bool:
    """Whether colours are to tell apart the two directions in which an axis was followed."""
    return bool(sweep.directions) and isinstance(color, str) and color == DIRECTION


def direction_names(sweep: OpenedSweep) -> tuple[str, str]:
    """Return the names of the two directions for a legend, with the symbol of the followed axis."""
    symbol = sweep.followed_symbol
    return rf"up, ${symbol} \rightarrow$", rf"down, ${symbol} \leftarrow$"


def nearest_distances(one: np.ndarray, other: np.ndarray, size: float) -> np.ndarray:
    """Return the distance of each value from the nearest in the same row of the other, in `size`.

    The arrays have the shapes (n, k) and (n, l), with NaN for no value; the result has the shape of
    `one`. The distance is 2 if the other has no value in the row, and NaN for no value.
    """
    row = 5.0 * np.arange(len(one))[:, None]  # more than any distance
    low = np.fmin(*(np.min(each[np.isfinite(each)], initial=np.inf) for each in (one, other)))
    # Without an exponent of -inf, that of a motion with rest.
    finite = (np.where(np.isfinite(each), each, np.nan) for each in (one, other))
    keys, there = (row + (each - low) / size for each in finite)
    there = np.concatenate([[-np.inf], np.sort(there[np.isfinite(there)]), [np.inf]])
    after = np.searchsorted(there, keys).clip(1, len(there) - 1)
    return np.minimum(np.minimum(keys - there[after - 1], there[after] - keys), 2.0)


def _extent(*values: np.ndarray) -> float:
    """Return the range of all finite values."""
    every = np.concatenate([each[np.isfinite(each)] for each in values])
    return float(np.ptp(every)) if every.size else 0.0


def agreeing(up: np.ndarray, down: np.ndarray) -> list[np.ndarray]:
    """Return the masks of the values of each direction that the other has, too."""
    size = _extent(up, down) or 1.0
    return [nearest_distances(up, down, size) < _SAME, nearest_distances(down, up, size) < _SAME]


def in_both(columns: np.ndarray, axis: int) -> np.ndarray:
    """Return the mask of the values of both directions, which are along an axis of the points.

    `columns` are the coordinates of points in a panel, shape (2, ..., k), with NaN for no value;
    the result has the shape (..., k).
    """
    from scipy.spatial import cKDTree

    low, high = (of(columns.reshape(2, -1), axis=1) for of in (np.nanmin, np.nanmax))
    size = np.where(high > low, high - low, 1.0)
    ways = np.moveaxis(np.moveaxis(columns, 0, -1) / size, axis, 0)  # (direction, ..., k, 2)
    both = np.zeros(ways.shape[:-1], bool)
    for point in np.ndindex(ways.shape[1:-2]):
        finite = [np.isfinite(way[point]).all(axis=-1) for way in ways]
        up, down = (way[point][kept] for way, kept in zip(ways, finite, strict=True))
        if len(up) and len(down):
            for number, (own, other) in enumerate(((up, down), (down, up))):
                away, _ = cKDTree(other).query(own, p=np.inf)
                both[(number, *point)][finite[number]] = away < _SAME
    return np.moveaxis(both, 0, axis)


def _motions_differ(one: np.ndarray, other: np.ndarray, size: float) -> np.ndarray:
    """Whether the motions in each row differ, shape (n,)."""
    away = [nearest_distances(a, b, size) for a, b in ((one, other), (other, one))]
    means = [
        np.nan_to_num(each).sum(axis=1) / np.maximum(np.isfinite(each).sum(axis=1), 1)
        for each in away
    ]
    return np.maximum(*means) > _APART


def draw_jumps(
    panel: Axes, x: np.ndarray, up: np.ndarray, down: np.ndarray, colours: tuple[str, str]
) -> list[Artist]:
    """Draw an arrow where the motion of a direction ends, to the one that it jumps to.

    Return a handle for the legend if there is an arrow.

    This is the last value, in this direction, of a range in which both directions differ. `x`,
    shape (n,), increases; `up` and `down` are values of the points, shape (n, k).
    """
    size, handles = _extent(up, down) or 1.0, list[Artist]()
    for start, stop in _ranges(_motions_differ(up, down, size)):
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
            look = {"arrowstyle": "-|>", "color": colour, "lw": 0.8, "mutation_scale": 7.0}
            panel.annotate(
                "", (x[j], end), (x[i], begin), arrowprops={**look, "shrinkA": 0, "shrinkB": 0}
            )
            shape: dict[str, Any] = {"linestyle": "", "marker": r"$\rightarrow$", "markersize": 8.0}
            handles = [Line2D([], [], color=ink(), markeredgewidth=0, label="jump", **shape)]
    return handles


def _ranges(mask: np.ndarray) -> Iterator[tuple[int, int]]:
    """Yield the runs of True: the first index, and the one after the last."""
    ends = np.flatnonzero(np.diff(np.pad(mask, 1).astype(np.int8)))
    yield from zip(ends[::2].tolist(), ends[1::2].tolist(), strict=True)
