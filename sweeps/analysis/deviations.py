"""The deviations of computed points from the stable exact orbits to which they belong."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from sweeps.analysis.exact_branches import LONGEST_ORBIT, PeriodicPoints, lines_of
from sweeps.analysis.rig import rig_of
from sweeps.analysis.selection import Selection, orbit_coordinates, recorded_coordinate
from sweeps.config.rig import si_name, si_values
from sweeps.store.variables import DIRECTION
from sweeps.text import table
from vibroimpact.orbits.periodic import OrbitError

if TYPE_CHECKING:
    import pandas as pd

#: Most rows of the table.
_MOST_ROWS = 12


def compare(
    dataset: xr.Dataset,
    axis: str,
    at: Selection | None = None,
    coordinate: str = "poincare_x",
    classes: Collection[tuple[int, int]] = (),
) -> str:
    """Write a table of the largest deviation of points from their exact orbits.

    It has a row for each class and direction; the rarest share a row. `classes` restricts the
    comparison to these classes; by default all classes of at most
    ``LONGEST_ORBIT`` periods are compared.
    """
    import pandas as pd

    parts, rig = [], rig_of(dataset)
    for line in lines_of(dataset, axis, at):
        way = f" {line[DIRECTION].item()}" if DIRECTION in line.coords else ""
        found = deviations(line, axis, coordinate, classes)
        found["name"] = [f"{m}/{q}{way}" for m, q in zip(found["m"], found["q"], strict=True)]
        parts.append(found)
    points = pd.concat(parts, ignore_index=True)
    if points.empty:
        return "no point follows a stable exact orbit"
    names = points["name"].value_counts().index.tolist()
    if len(names) > _MOST_ROWS:
        rare = names[_MOST_ROWS - 1 :]
        names = [*names[: _MOST_ROWS - 1], f"{len(rare)} more"]
        points["name"] = points["name"].where(~points["name"].isin(rare), names[-1])
    axis, points = si_name(axis, rig), points.assign(**si_values(points[[axis]], rig))
    head = ("class", "points", "deviation", f"at {axis}", "settled", "deviation")
    return (
        "Points on stable exact orbits, and their largest deviation; settled are those whose\n"
        "transient has died out\n\n"
        + table([head, *(_row(name, axis, points[points["name"] == name]) for name in names)], 1)
        + "\n"
    )


def deviations(
    line: xr.Dataset, axis: str, coordinate: str, classes: Collection[tuple[int, int]] = ()
) -> pd.DataFrame:
    """Compare the periodic points along an axis with the stable orbits of the same class.

    The `classes` are chosen as in `compare`. There is a row for each point with such an orbit:
    ``m``, ``q``, the axis, ``size`` (the largest deviation in its record, in the unit of the
    coordinate), and ``settled`` (whether the Floquet multipliers reduce a deviation to rounding
    within the transient).
    """
    import pandas as pd

    motions = PeriodicPoints.of(line)
    records = recorded_coordinate(line, coordinate).values
    transient = int(line["section"].values[0]) - 1
    rows = []
    for i in np.flatnonzero(motions.m > 0).tolist():
        mq = int(motions.m[i]), int(motions.q[i])
        if mq not in classes if classes else mq[0] > LONGEST_ORBIT:
            continue
        try:
            orbit = motions.orbit(i)
        except OrbitError:
            continue
        exact = orbit_coordinates(orbit, motions.phase)[coordinate]
        # The free oscillation has no impacts.
        if orbit.stable and (orbit.m, orbit.q) == mq and exact.size:
            size = _distance(records[i], exact, coordinate)
            decay = float(np.abs(orbit.multipliers).max()) ** (transient / orbit.m)
            settled = decay < np.finfo(float).eps
            rows.append((orbit.m, orbit.q, float(motions.points[axis][i]), size, settled))
    return pd.DataFrame(rows, columns=["m", "q", axis, "size", "settled"])


def _row(name: str, axis: str, points: pd.DataFrame) -> tuple[str, ...]:
    """Return the row of the table for the points of one class."""
    worst = points.iloc[int(points["size"].argmax())]
    settled = points["size"][points["settled"]]
    largest = f"{settled.max():.1e}" if len(settled) else ""
    shown = f"{len(points):,}", f"{worst['size']:.1e}", f"{worst[axis]:g}"
    return name, *shown, f"{len(settled):,}", largest


def _distance(record: np.ndarray, orbit: np.ndarray, coordinate: str) -> float:
    """Return the largest distance of a record from an orbit, for the best shift between them."""
    record = record[np.isfinite(record)]
    starts = [np.resize(np.roll(orbit, -k), record.shape) for k in range(len(orbit))]
    apart = np.abs(record - np.array(starts))
    if coordinate == "impact_phase":
        apart %= 2.0 * np.pi
        apart = np.minimum(apart, 2.0 * np.pi - apart)
    return float(apart.max(axis=1, initial=0.0).min())
