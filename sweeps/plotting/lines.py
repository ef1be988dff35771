"""The line and the coordinate that a bifurcation diagram shows, or why there is none."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

import numpy as np
import xarray as xr

from sweeps.errors import Refused
from sweeps.opened.coordinates import COORDINATES
from sweeps.opened.cuts import Selection, chosen_axes, cut_at
from sweeps.plotting.numbers import numbers_of
from sweeps.store import DIRECTION
from sweeps.text import choice_of, listed
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
    return cut_at(dataset, at, free=[axis, DIRECTION]), axis, coordinate


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
