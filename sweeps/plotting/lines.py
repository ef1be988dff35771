"""The line of points that a bifurcation diagram shows, and the coordinate over it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

import numpy as np
import xarray as xr

from sweeps.analysis.coordinates import COORDINATES
from sweeps.analysis.motion import has_result
from sweeps.analysis.selection import Cut, chosen_axes, directions, listed, select
from sweeps.errors import Refused
from sweeps.store import DIRECTION, VARIABLES
from vibroimpact.status import Status


def select_line(
    dataset: xr.Dataset,
    axes: Sequence[str] = (),
    at: Cut | None = None,
    coordinate: str | None = None,
) -> tuple[xr.Dataset, str, str]:
    """Return the line that a `sweeps.plotting.bifurcation` shows, its axis and its coordinate.

    Raises
    ------
    Refused
        If the file has no such axis or coordinate.
    """
    (axis,) = chosen_axes(dataset, axes, 1, "bifurcation")
    coordinate = choose_coordinate(dataset, coordinate)
    return select(dataset, at, free=[axis, DIRECTION]), axis, coordinate


def choose_coordinate(dataset: xr.Dataset, coordinate: str | None) -> str:
    """Return the coordinate asked for, by default the first that the file has.

    Raises
    ------
    Refused
        If the file has no such coordinate.
    """
    available = [name for name, about in COORDINATES.items() if about.record in dataset.dims]
    if coordinate is None:
        coordinate = next(iter([*available, *COORDINATES]))
    if coordinate in available:
        return coordinate
    choice = f"choose from: {listed(available) or 'none'}"
    if coordinate not in dataset:
        raise Refused(f"the file has no {coordinate or repr(coordinate)} to draw; {choice}")
    if coordinate in scalars(dataset):
        choice += f"; --below {coordinate} draws it in a panel below the diagram"
    raise Refused(f"{coordinate} is no coordinate of the motion; {choice}")


def scalars(dataset: xr.Dataset) -> list[str]:
    """List the variables with one number, or the Lyapunov exponents, per point."""
    return [
        name
        for name, variable in VARIABLES.items()
        if name in dataset and variable.record in (None, "exponent") and name != "status"
    ]


def refuse_empty(line: xr.Dataset, coordinate: str) -> NoReturn:
    """Say why a line has no value of a coordinate.

    Raises
    ------
    Refused
    """
    status = line["status"].values
    if has_result(status).any():
        raise Refused(
            f"there is nothing to draw: no impact was recorded, so no point has {coordinate}; "
            "--coordinate poincare_x shows the motion"
        )
    reasons = [
        f"{Status(outcome).meaning} ({count:,})"
        for outcome, count in zip(*np.unique(status, return_counts=True), strict=True)
    ]
    raise Refused(f"there is nothing to draw, no point has a result: {listed(reasons)}")


def split_directions(line: xr.Dataset) -> list[xr.Dataset]:
    """Return a line once for each direction in which it was followed, or the line itself."""
    return [line.sel({DIRECTION: direction}) for direction in directions(line)] or [line]
