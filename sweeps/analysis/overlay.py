"""The closed-form one-impact orbits beside a line of computed points, and how far these are off."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np
import xarray as xr

from sweeps.analysis.selection import Setting
from sweeps.errors import Refused
from vibroimpact.orbits.one_impact import OneImpactOrbit, one_impact_orbit
from vibroimpact.orbits.one_impact_branches import Branches, one_impact_branches, sections
from vibroimpact.orbits.period_class import period_class
from vibroimpact.oscillator import Oscillator

#: Orbits of up to so many forcing periods are drawn and compared.
MOST_PERIODS = 4

#: A branch is drawn through at most so many values, and its bifurcations.
_MOST_VALUES = 400


@dataclass(frozen=True)
class Line:
    """A line of computed points along one axis.

    Attributes
    ----------
    dataset : Dataset
        A cut through an opened sweep, with `axis` as its only swept axis.
    axis : str
        A parameter of the oscillator.
    coordinate : str
        One of ``poincare_x``, ``poincare_v``, ``impact_v`` and ``impact_phase``.
    oscillator : Oscillator
        At the first point of the line.
    phase : float
        Of the section [rad].
    """

    dataset: xr.Dataset
    axis: str
    coordinate: str
    oscillator: Oscillator
    phase: float

    @classmethod
    def of(cls, dataset: xr.Dataset, axis: str, coordinate: str) -> Line:
        """Read what is fixed along a line from the configuration.

        Raises
        ------
        Refused
            If the closed-form orbits do not depend on `axis`.
        """
        names = [field.name for field in fields(Oscillator)]
        if axis not in names:
            raise Refused(f"the exact orbits do not depend on {axis}; draw it without them")
        setting, first = Setting.of(dataset), dataset.isel({axis: 0})
        oscillator = Oscillator(**{name: setting.value(name, first) for name in names})
        return cls(dataset, axis, coordinate, oscillator, setting.phase)

    def at(self, value: float) -> Oscillator:
        """Return the oscillator at a value of the axis."""
        return replace(self.oscillator, **{self.axis: value})

    def branches(self) -> list[Branches]:
        """Follow the orbits of 1 to ``MOST_PERIODS`` forcing periods along the axis."""
        values = np.unique(self.dataset[self.axis].values)
        if len(values) > _MOST_VALUES:
            values = values[np.linspace(0, len(values) - 1, _MOST_VALUES).astype(int)]
        return [
            one_impact_branches(self.oscillator, self.axis, values.tolist(), n)
            for n in range(1, MOST_PERIODS + 1)
        ]

    def coordinates(self, value: float, orbit: OneImpactOrbit) -> np.ndarray:
        """Return what the diagram shows of an orbit: n values of the section, or one of the impact.

        Those of the section are in the order after the impact.
        """
        if self.coordinate == "impact_v":
            return np.array([orbit.v])
        if self.coordinate == "impact_phase":
            return np.array([orbit.phase])
        states = sections(self.at(value), orbit, self.phase)
        return states[:, 0 if self.coordinate == "poincare_x" else 1]


@dataclass(frozen=True)
class Deviation:
    """How far the points that follow a stable branch are from it.

    Attributes
    ----------
    n : int
        Forcing periods per impact of the branch.
    values : ndarray, shape (k,)
        Of the axis, where a computed point repeats after `n` forcing periods and one impact.
    sizes : ndarray, shape (k,)
        The largest deviation in its record, in the unit of the coordinate.
    settled : ndarray of bool, shape (k,)
        Where the orbit's multipliers reduce a deviation to rounding within the transient.
    """

    n: int
    values: np.ndarray
    sizes: np.ndarray
    settled: np.ndarray

    def told(self, axis: str) -> str:
        """Say it in one line."""
        worst = int(np.argmax(self.sizes))
        text = (
            f"n = {self.n}: {len(self.sizes):,} points follow the stable branch; largest deviation "
            f"{self.sizes[worst]:.1e} at {axis} = {self.values[worst]:g}"
        )
        if self.settled.all():
            return text
        if not self.settled.any():
            return f"{text}; the transient has died out at none of them"
        return (
            f"{text}, and {self.sizes[self.settled].max():.1e} at the "
            f"{np.count_nonzero(self.settled):,} where the transient has died out"
        )


def deviations(line: Line) -> Iterator[Deviation]:
    """Compare computed points with the stable branches that they follow.

    A motion with one impact in n forcing periods can be on no other branch; if it rests after the
    impact, as with R = 0, there is no orbit.

    Yields
    ------
    Deviation
        For every n of which there is a point.
    """
    needed = ["poincare_x", "poincare_v", "impacts_per_period", line.coordinate]
    data = line.dataset[list(dict.fromkeys(needed))].load()
    x, v = data["poincare_x"].values, data["poincare_v"].values
    period, impacts = period_class(x, v, data["impacts_per_period"].values)
    transient = int(line.dataset["section"].values[0]) - 1
    for n in range(1, MOST_PERIODS + 1):
        follow = (period == n) & (impacts == 1)
        found = []
        for i in np.flatnonzero(follow):
            value = float(data[line.axis].values[i])
            orbit = one_impact_orbit(line.at(value), n)
            if orbit.stable:
                record = data[line.coordinate].values[i]
                size = _distance(record, line.coordinates(value, orbit), line.coordinate)
                decay = np.abs(orbit.multipliers).max() ** (transient / n)
                found.append((value, size, decay < np.finfo(float).eps))
        if found:
            values, sizes, settled = (np.array(column) for column in zip(*found, strict=True))
            yield Deviation(n, values, sizes, settled)


def _distance(record: np.ndarray, orbit: np.ndarray, coordinate: str) -> float:
    """Return the largest distance of a record from an orbit that starts at any of its points."""
    record = record[np.isfinite(record)]
    starts = [np.resize(np.roll(orbit, -k), record.shape) for k in range(len(orbit))]
    apart = np.abs(record - np.array(starts))
    if coordinate == "impact_phase":
        apart = np.minimum(apart, 2.0 * np.pi - apart)
    return float(apart.max(axis=1, initial=0.0).min())
