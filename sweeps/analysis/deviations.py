"""How far computed points are from the stable exact orbits that they are on."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from sweeps.analysis.exact_branches import MOST_PERIODS, Line, lines_of
from sweeps.analysis.selection import Selection, orbit_coordinates, recorded_coordinate
from sweeps.store.variables import DIRECTION
from sweeps.text import shown_count
from vibroimpact.orbits.periodic import OrbitError

if TYPE_CHECKING:
    import pandas as pd


def compare(
    dataset: xr.Dataset,
    axis: str,
    at: Selection | None = None,
    coordinate: str = "poincare_x",
    classes: Collection[tuple[int, int]] = (),
) -> list[str]:
    """Say in lines, for each direction and class, how far points are from their exact orbits.

    The `classes` are those that are compared, by default all.
    """
    texts = []
    for line in lines_of(dataset, axis, at):
        way = f"{line.dataset[DIRECTION].item()}: " if DIRECTION in line.dataset.coords else ""
        said = [
            _said(f"{m}/{q}", axis, points)
            for (m, q), points in deviations(line, coordinate).groupby(["m", "q"])
            if not classes or (m, q) in classes
        ]
        texts += [way + text for text in said or ["no point follows a stable exact orbit"]]
    return texts


def deviations(line: Line, coordinate: str) -> pd.DataFrame:
    """Compare the periodic points of a line with the stable orbits that they are on.

    A row for each point with such an orbit of its own class has ``m``, ``q``, the axis, ``size``
    (the largest deviation in its record, in the unit of the coordinate), and ``settled`` (whether
    the multipliers reduce a deviation to rounding within the transient).
    """
    import pandas as pd

    records = recorded_coordinate(line.dataset, coordinate).values
    transient = int(line.dataset["section"].values[0]) - 1
    rows = []
    for i in np.flatnonzero((line.q > 0) & (line.m <= MOST_PERIODS)).tolist():
        try:
            orbit = line.orbit(i)
        except OrbitError:
            continue
        if orbit.stable and (orbit.m, orbit.q) == (line.m[i], line.q[i]):
            exact = orbit_coordinates(orbit, line.phase)[coordinate]
            size = _distance(records[i], exact, coordinate)
            decay = float(np.abs(orbit.multipliers).max()) ** (transient / orbit.m)
            settled = decay < np.finfo(float).eps
            rows.append((orbit.m, orbit.q, float(line.values[i]), size, settled))
    return pd.DataFrame(rows, columns=["m", "q", line.axis, "size", "settled"])


def _said(name: str, axis: str, points: pd.DataFrame) -> str:
    """Say in one line how far points of one class are from their orbits."""
    worst, settled = points.loc[points["size"].idxmax()], points["size"][points["settled"]]
    text = (
        f"{name}: {shown_count(len(points), 'point')} on a stable orbit; largest deviation "
        f"{worst['size']:.1e} at {axis} = {worst[axis]:g}"
    )
    if len(settled) == len(points):
        return text
    if not len(settled):
        return f"{text}; the transient has died out at none of them"
    return (
        f"{text}, and {settled.max():.1e} at the {len(settled):,} where the transient has died out"
    )


def _distance(record: np.ndarray, orbit: np.ndarray, coordinate: str) -> float:
    """Return the largest distance of a record from an orbit that starts at any of its points."""
    record = record[np.isfinite(record)]
    starts = [np.resize(np.roll(orbit, -k), record.shape) for k in range(len(orbit))]
    apart = np.abs(record - np.array(starts))
    if coordinate == "impact_phase":
        apart %= 2.0 * np.pi
        apart = np.minimum(apart, 2.0 * np.pi - apart)
    return float(apart.max(axis=1, initial=0.0).min())
