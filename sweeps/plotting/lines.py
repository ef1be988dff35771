"""The line of points that a bifurcation diagram shows, and the coordinate over it."""

from __future__ import annotations

from collections.abc import Sequence

import xarray as xr

from sweeps.analysis.selection import Cut, chosen_axes, directions, listed, select
from sweeps.errors import Refused
from sweeps.store import DIRECTION

#: What a bifurcation diagram can show over the swept axis.
COORDINATES = ("poincare_x", "poincare_v", "impact_v", "impact_phase")


def select_line(
    dataset: xr.Dataset,
    axes: Sequence[str] = (),
    at: Cut | None = None,
    coordinate: str | None = None,
) -> tuple[xr.Dataset, str, str]:
    """Return the line that a diagram shows, with its axis and its coordinate.

    Parameters
    ----------
    dataset, axes, at, coordinate
        As for `sweeps.plotting.bifurcation`.

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
    available = [name for name in COORDINATES if name in dataset]
    if coordinate is None:
        coordinate = next(iter(available), COORDINATES[0])
    if coordinate not in available:
        name = coordinate or repr(coordinate)
        raise Refused(f"the file has no {name} to draw; it has {listed(available) or 'none'}")
    return coordinate


def split_directions(line: xr.Dataset) -> list[xr.Dataset]:
    """Return a line once for each direction in which it was followed, or the line itself."""
    return [line.sel({DIRECTION: direction}) for direction in directions(line)] or [line]
