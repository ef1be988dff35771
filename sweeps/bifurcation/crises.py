"""Crises: a chaotic attractor ends as it touches an unstable orbit.

The attractor is sampled at values that approach a change from the side of the chaos, and its least
distance d from each unstable orbit of the exact branches is taken. From an orbit inside it d is
rounding at all values; beside others it keeps its distance. At a crisis (Grebogi, Ott & Yorke 1983,
Physica D 7, 181-200) it reaches the stable manifold of a saddle. A motion that passes this at a
distance e comes as near to the saddle as e^s, s = ln|mu_2| / (ln|mu_2| - ln|mu_1|). So d^(1/s)
falls to zero in proportion to the distance of the value from the crisis.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from sweeps.opened.motions import oscillator_of, run_on
from vibroimpact.orbits.periodic import OrbitError, PeriodicOrbit, periodic_orbit
from vibroimpact.points.stages import RunSpec

#: Most motions that sample an attractor.
MOST_MOTIONS = 50
#: Sections that a motion leaves out, those that it records in a first look, then, and beyond.
_TRANSIENT, _FIRST, _ALL, _LONG = 300, 500, 4000, 20_000
#: Places of the first look, in steps of the axis before the change; those of the second, of which
#: the attractor exists at least at so many; and how far beyond the change most motions leave it.
_FEW, _PLACES = (1.0, 16.0), (0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)
_COUNT, _BEYOND = 5, 2.0
#: d^(1/s) is in proportion but for this share of its range, as the attractor has many tips; is zero
#: at most so many steps beyond the change; and falls to this share of its greatest value.
_ERROR, _LATE, _FALLS = 0.2, 2.0, 0.2
#: Below this, d^(1/s) may be the rounding of a sample, in ranges of x and v.
_CLEAR = 1e-4
#: Longest repetition of a motion that has left the chaos, and its error.
_LONGEST, _REPEATS = 64, 1e-7

#: The number of a branch, and m and q of its orbits.
_Saddle = tuple[int, int, int]


class Chaos(NamedTuple):
    """A chaotic attractor at the last value of an axis before it ends."""

    spec: RunSpec
    points: np.ndarray  # states of it at the section, of dtype POINT
    axis: str  # a parameter of the model
    step: float  # from the last value towards the change
    orbits: xr.Dataset  # of `branches_of`, over the parameter

    def holds(self, place: float) -> bool:
        """Whether a place is within the range of the orbits."""
        values = self.orbits[self.axis].values
        return bool(values.min() <= self.points[self.axis][0] - place * self.step <= values.max())

    def states(self, place: float, sections: int) -> tuple[np.ndarray, float]:
        """Return states of motions from the attractor at a place, and the share that left it.

        The states have the shape (motions, sections, 2).
        """
        points = self.points.copy()
        points[self.axis] -= place * self.step
        states, _ = run_on(self.spec, points, _TRANSIENT + sections)
        turns = np.arange(2, _LONGEST + 2)
        repeats = np.abs(states[:, -turns] - states[:, -1:]).max(axis=2) < _REPEATS
        left = repeats.any(axis=1) | ~np.isfinite(states).all(axis=(1, 2))
        return states[:, _TRANSIENT:], float(left.mean())

    def unstable(self, place: float) -> Iterator[tuple[int, PeriodicOrbit]]:
        """Yield the unstable orbits at a place, with the number of their branch."""
        point = self.points[0].copy()
        point[self.axis] -= place * self.step
        osc, found = oscillator_of(point), self.orbits
        along, number, m, q = (found[name].values for name in (self.axis, "branch", "m", "q"))
        x, v = (found[name].values[:, 0] for name in ("poincare_x", "poincare_v"))
        plain, away = found["kind"].values == "", along - point[self.axis]
        within = plain[1:] & plain[:-1] & (number[1:] == number[:-1])
        for i in np.flatnonzero(within & (away[1:] * away[:-1] <= 0.0)).tolist():
            share = away[i] / (away[i] - away[i + 1]) if away[i] != away[i + 1] else 0.0
            near_x, near_v = (a[i] + share * (a[i + 1] - a[i]) for a in (x, v))
            try:
                near_x = min(near_x, osc.clearance)
                orbit = periodic_orbit(osc, near_x, near_v, int(m[i]), self.spec.phase)
            except OrbitError:
                continue
            if (orbit.m, orbit.q) == (m[i], q[i]) and not orbit.stable:
                yield int(number[i]), orbit

    def distances(
        self, places: Sequence[float], sections: int, chosen: Collection[_Saddle] = ()
    ) -> dict[_Saddle, dict[float, float]]:
        """Return d^(1/s) of the chosen saddles, or all, at those places where the attractor is."""
        found: dict[_Saddle, dict[float, float]] = {}
        for place in filter(self.holds, places):
            states, left = self.states(place, sections)
            if left > 0.0:
                continue
            scale = np.ptp(states, axis=(0, 1))
            samples = (states / scale).reshape(-1, 2).T
            for number, orbit in self.unstable(place):
                saddle = number, orbit.m, orbit.q
                if chosen and saddle not in chosen:
                    continue
                own = (orbit.sections(self.spec.phase) / scale)[:, :, None]
                distance = min(float(np.square(samples - state).sum(axis=0).min()) for state in own)
                first, second = np.log(np.abs(orbit.multipliers) + 1e-300)
                with np.errstate(over="ignore"):  # the second multiplier may be 1
                    power = distance ** (0.5 * (second - first) / second)
                found.setdefault(saddle, {})[place] = power
        return found


def crisis(chaos: Chaos) -> str:
    """Return the class of the orbit that an attractor touches as it ends; empty if none is seen."""
    if not chaos.holds(-_BEYOND):
        return ""
    first = chaos.distances(_FEW, _FIRST)
    falling = [saddle for saddle, values in first.items() if _falls(values)]
    ends = bool(falling) and chaos.states(-_BEYOND, _LONG)[1] > 0.5
    second = chaos.distances(_PLACES, _ALL, falling) if ends else {}
    for (_, m, q), values in second.items():
        if len(values) >= _COUNT and _falls(values):
            places, heights = np.array([*values]), np.array([*values.values()])
            slope, start = np.polyfit(places, heights, 1)
            off = np.abs(start + slope * places - heights).max()
            in_proportion = slope > 0.0 and off < _ERROR * np.ptp(heights)
            if in_proportion and -_LATE < -start / slope < places[0]:
                return f"{m}/{q}"
    return ""


def _falls(values: dict[float, float]) -> bool:
    """Whether the value at the nearest place is far below the greatest, which is no rounding."""
    greatest = max(values.values())
    return _CLEAR < greatest < np.inf and values[min(values)] < _FALLS * greatest
