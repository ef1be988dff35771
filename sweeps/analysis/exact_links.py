"""Whether an attractor goes on as another one at the next value of an axis, by exact branches.

The exact branch of the orbit (`vibroimpact.branch`) is followed from the one value to the other.
The attractors are the same if all of it is stable and it ends at the other orbit. They are the
same across a flip if the branches of m and of 2 m periods meet in it.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from sweeps.analysis.nearby_orbit import orbit_at
from vibroimpact.orbits.branches import Branch, branch
from vibroimpact.orbits.periodic import OrbitError, PeriodicOrbit

#: Orbits and flips are the same to this share: that of Newton's method, and a margin.
_TOLERANCE = 1e-6


class ExactLinks:
    """Tells whether periodic attractors are on one branch along an axis.

    Attractors are given by points with their states at a section of this phase, shape (n,), and by
    their periods m. The file was computed with exact impacts.
    """

    def __init__(self, axis: str, phase: float, points: np.ndarray, m: np.ndarray) -> None:
        self._axis, self._phase, self._points, self._m = axis, phase, points, m
        self._orbit = cache(self._find)

    def __call__(self, a: int, b: int) -> bool:
        """Return whether attractor `a` goes on as `b`."""
        first, second = self._orbit(a), self._orbit(b)
        if first is None or second is None:
            return False
        low, high = sorted(getattr(orbit.oscillator, self._axis) for orbit in (first, second))
        here, there = (branch(orbit, self._axis, low, high) for orbit in (first, second))
        if (first.m, first.q) == (second.m, second.q):
            value = getattr(second.oscillator, self._axis)
            ends = here.at(value) if here.stable.all() else []
            return any(_same(orbit, second) for orbit in ends)
        return any(
            math.isclose(flip, flip_there, rel_tol=_TOLERANCE)
            for flip in _flips(here)
            for flip_there in _flips(there)
        )

    def _find(self, a: int) -> PeriodicOrbit | None:
        m = int(self._m[a])
        try:
            orbit = orbit_at(self._points[a], m, self._phase)
        except OrbitError:
            return None
        return orbit if orbit.stable and orbit.m == m else None


def _same(first: PeriodicOrbit, second: PeriodicOrbit) -> bool:
    speeds = np.sort(second.speeds)
    return np.allclose(
        np.sort(first.speeds), speeds, rtol=0.0, atol=_TOLERANCE * speeds.max(initial=0.0)
    )


def _flips(line: Branch) -> list[float]:
    return [point.value for point in line.special if point.kind == "flip"]
