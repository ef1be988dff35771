"""Finds the `crisis` at which `Chaos` ends as it touches an unstable orbit.

Beyond a crisis (Grebogi, Ott & Yorke 1983, Physica D 7, 181-200) motions leave the chaos through a
gap that the attractor has torn into the border, the stable manifold of an unstable orbit. The gap
closes at the crisis. So the last motions that leave there all follow this manifold to rounding, and
pass the orbit itself on their way. The value beyond which they leave is bisected; the grid enters
only by the places where this begins and by the states there.

An orbit that attracts them on both sides of this value was there before. So its birth in a fold, a
flip or a graze is no crisis, nor are the long transients of a sweep.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sweeps.opened.motions import run_on
from vibroimpact.orbits.periodic import OrbitError, PeriodicOrbit, periodic_orbit
from vibroimpact.oscillator import oscillator_of
from vibroimpact.points.stages import RunSpec

#: Most motions that sample an attractor.
MOST_MOTIONS = 50
#: Sections of a motion in a first look, during the bisection, and of those whose way is followed.
_FIRST, _ALL, _LONG = 2000, 10_000, 20_000
#: Places before the change, in steps of the axis, at which motions may still stay; they separate
#: from the single motion of the sweep only beside its value. Width to which they are bisected.
_DISTANCES, _WIDTH = (0.01, 1.0, 2.0, 4.0, 8.0, 16.0), 1e-5
#: Longest repetition of a motion that has left the chaos, and its error as a share of the ranges.
_LONGEST, _REPEATS = 64, 1e-7
#: Least number of motions that leave; the repetitions among which they pass the orbit, before they
#: last miss a repetition by the first share of the ranges of x and v; and the distance in passing.
_LEAST, _TURNS, _SETTLES, _PASSES = 2, 40, 1e-3, 2e-4


class Chaos(NamedTuple):
    """A chaotic attractor at the last value of an axis before it ends."""

    spec: RunSpec
    points: np.ndarray  # states of it at the section, of dtype POINT
    axis: str  # a parameter of the model
    first: float  # value of the axis back to which motions may be run
    next: float  # value of the axis at which the chaos has ended

    def at(self, distance: float) -> np.ndarray:
        """Return the points at a distance before the last value, in steps; not beyond the ends."""
        points, (low, high) = self.points.copy(), sorted((self.first, self.next))
        points[self.axis] -= distance * (self.next - points[self.axis])
        points[self.axis] = points[self.axis].clip(low, high)
        return points

    def run(self, distance: float, sections: int) -> tuple[np.ndarray, np.ndarray]:
        """Return states of motions, shape (n, sections, 2), and m of those that left, or 0."""
        states, _ = run_on(self.spec, self.at(distance), sections)
        turns = np.arange(1, _LONGEST + 1)
        error = _REPEATS * np.ptp(states[:, ::10], axis=(0, 1))
        once, twice = (states[:, -1 - k * turns] - states[:, -1:] for k in (1, 2))
        repeats = (np.maximum(np.abs(once), np.abs(twice)) < error).all(axis=2)
        return states, np.where(repeats.any(axis=1), turns[repeats.argmax(axis=1)], 0)

    def stays(self, distance: float, sections: int) -> bool:
        """Whether all motions stay in the chaos at a distance."""
        return not self.run(distance, sections)[1].any()

    def orbit(self, distance: float, state: np.ndarray, m: int) -> PeriodicOrbit | None:
        """Return the orbit near a state at a distance, or None."""
        osc = oscillator_of(self.at(distance)[0])
        try:
            return periodic_orbit(osc, min(state[0], osc.clearance), state[1], m, self.spec.phase)
        except OrbitError:
            return None

    def escapes(self, after: float, before: float, sections: int) -> list[tuple[np.ndarray, int]]:
        """Return motions that leave after the crisis, and m, if their orbit was there before."""
        states, periods = self.run(after, sections)
        gone = np.flatnonzero(periods)
        for distance in (after, before) if gone.size else ():
            orbit = self.orbit(distance, states[gone[0], -1], int(periods[gone[0]]))
            if orbit is None or not orbit.stable:
                return []
        return [(states[i], int(periods[i])) for i in gone]


def crisis(chaos: Chaos, report: Callable[[float], object] = lambda share: None) -> str:
    """Return the class of the orbit that an attractor touches as it ends, or "" if none."""
    after, last = -1.0, chaos.points[chaos.axis][0]
    room = (last - chaos.first) / (chaos.next - last)
    distances = (distance for distance in _DISTANCES if distance <= room)
    before = next((distance for distance in distances if chaos.stays(distance, _FIRST)), None)
    if before is None or not chaos.escapes(after, before, _FIRST):
        return ""
    while before - after > _WIDTH:
        report(0.0)
        middle = 0.5 * (before + after)
        stay = chaos.stays(middle, _FIRST) and chaos.stays(middle, _ALL)  # most leave at once
        before, after = (middle, after) if stay else (before, middle)
    motions = chaos.escapes(after, before, _LONG)
    orbits = {_orbit_passed(chaos, after, path, m) for path, m in motions}
    return orbits.pop() if len(orbits) == 1 and len(motions) >= _LEAST else ""


def _orbit_passed(chaos: Chaos, distance: float, path: np.ndarray, m: int) -> str:
    """Return the class of the unstable orbit that a motion passes before it repeats itself."""
    scale = np.ptp(path, axis=0)
    misses = np.abs((path[m:] - path[:-m]) / scale).max(axis=1)
    last = int(np.flatnonzero(misses > _SETTLES).max(initial=0))
    begin = max(0, last - _TURNS * m)
    if begin == last:
        return ""
    state = path[begin + int(misses[begin:last].argmin())]
    orbit = chaos.orbit(distance, state, m)
    if orbit is None or orbit.stable:
        return ""
    away = np.abs((orbit.sections(chaos.spec.phase) - state) / scale).max(axis=1).min()
    return f"{orbit.m}/{orbit.q}" if away < _PASSES else ""
