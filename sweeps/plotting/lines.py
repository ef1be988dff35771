"""The line of points and the coordinate that a bifurcation diagram shows, and their pixels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

import numpy as np
import xarray as xr

from sweeps.analysis.selection import COORDINATES, Selection, choice_of, chosen_axes, listed, select
from sweeps.errors import Refused
from sweeps.plotting.numbers import numbers_of
from sweeps.store import DIRECTION
from vibroimpact.points.regimes import has_result
from vibroimpact.status import Status


def select_line(
    dataset: xr.Dataset,
    axes: Sequence[str] = (),
    at: Selection | None = None,
    coordinate: str | None = None,
) -> tuple[xr.Dataset, str, str]:
    """Return the points that `sweeps.plotting.bifurcation` shows, their axis and coordinate."""
    (axis,) = chosen_axes(dataset, axes, at, 1, "bifurcation")
    coordinate = choose_coordinate(dataset, coordinate)
    return select(dataset, at, free=[axis, DIRECTION]), axis, coordinate


def choose_coordinate(dataset: xr.Dataset, coordinate: str | None) -> str:
    """Return the requested coordinate, by default the first in the file; refuse unknown ones."""
    available = [name for name, about in COORDINATES.items() if about.dimension in dataset.dims]
    if coordinate is None:
        coordinate = next(iter([*available, *COORDINATES]))
    if coordinate in available:
        return coordinate
    choice = choice_of(available, "coordinate")
    if coordinate not in dataset:
        raise Refused(f"the file has no {coordinate or repr(coordinate)} to draw; {choice}")
    if coordinate in numbers_of(dataset):
        choice += f"; {coordinate} can be drawn in a panel below the diagram"
    raise Refused(f"{coordinate} is not a coordinate of the motion; {choice}")


def refuse_empty(line: xr.Dataset, coordinate: str) -> NoReturn:
    """Refuse a line that has no value of a coordinate, and say why."""
    refuse_without_result(line["status"].values)
    raise Refused(
        f"there is nothing to draw: no impact was recorded, so no point has {coordinate}; "
        "the coordinate poincare_x shows the motion"
    )


def refuse_without_result(status: np.ndarray) -> None:
    """Refuse points of which none has a result, and say why."""
    if has_result(status).any():
        return
    reasons = [
        f"{Status(outcome).meaning} ({count:,})"
        for outcome, count in zip(*np.unique(status, return_counts=True), strict=True)
    ]
    raise Refused(f"there is nothing to draw, no point has a result: {listed(reasons)}")


def pixels_of(
    columns: np.ndarray, values: np.ndarray, rows: int, low: float, high: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the values within a panel of so many `rows`: the place in `columns`, and the pixel.

    `columns`, shape (k,), are the columns of k points, all within the panel; `values`, shape
    (k, width), are their ordinates, with NaN for missing ones. The ordinate ranges from `low` to
    `high`. The pixels are numbered column by column.
    """
    scaled = np.floor((values - low) * (rows / (high - low)))
    seen = (scaled >= 0.0) & (scaled < rows)  # False for NaN
    place = np.repeat(np.arange(len(columns)), seen.sum(axis=1))
    return place, columns[place] * rows + scaled[seen].astype(np.int64)


def count_pixels(
    columns: np.ndarray, values: np.ndarray, shape: tuple[int, int], low: float, high: float
) -> np.ndarray:
    """Count the values in each pixel of a panel of a `shape`; the others are of `pixels_of`."""
    _, pixels = pixels_of(columns, values, shape[1], low, high)
    return np.bincount(pixels, minlength=shape[0] * shape[1]).reshape(shape)


def widened(low: float, high: float) -> tuple[float, float]:
    """Return a range, widened to the size of its values if they differ only by rounding."""
    size = max(abs(low), abs(high))
    if not high - low < 1e-6 * size:  # this also excludes NaN and infinity
        return low, high
    middle = 0.5 * (low + high)
    return middle - 0.5 * size, middle + 0.5 * size


def cell_edges(values: np.ndarray, log: bool) -> np.ndarray:
    """Return the n + 1 edges of the cells around n >= 2 increasing values.

    The edges lie halfway between the values, with `log` on a logarithmic scale.
    """
    values = np.log(values) if log else values
    inner = 0.5 * (values[1:] + values[:-1])
    edges = np.array([2.0 * values[0] - inner[0], *inner, 2.0 * values[-1] - inner[-1]])
    return np.exp(edges) if log else edges
