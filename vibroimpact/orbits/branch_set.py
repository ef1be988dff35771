"""Sets of branches: from a few orbits to all orbits that their bifurcations lead to.

At a flip the orbits of twice the period begin; at a graze an orbit with q impacts becomes one with
q - 1 or q + 1. So a set grows from a few orbits. Where motions are chaotic it would grow for ever.
So there are limits on the length of its orbits, on the number of its branches, and on unstable
branches that lead to unstable ones.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field

import numpy as np

from vibroimpact.orbits.branches import (
    Branch,
    branch,
    doubled_branch,
    grazing_branch,
    without_touch,
)
from vibroimpact.orbits.orbit import PeriodicOrbit
from vibroimpact.orbits.periodic import OrbitError

#: Two points are the same if they agree within these shares of the range and the greatest speed.
_VALUE_TOLERANCE, _SPEED_TOLERANCE = 1e-8, 1e-5
#: How to follow a branch from its start, by the kind of that point.
_FOLLOW = {"": branch, "flip": doubled_branch, "graze": grazing_branch}


@dataclass
class BranchSet:
    """Branches over a range of a parameter, each only once."""

    parameter: str
    low: float
    high: float
    most_branches: int = 100
    most_periods: int = 64  # longest orbits that are followed
    classes: Collection[
        tuple[int, int]
    ] = ()  # m and q of the orbits that are followed; if empty, all
    check: Callable[[], object] = lambda: None  # is called before each branch; may raise
    branches: list[Branch] = field(default_factory=list)
    given_up: Counter[str] = field(default_factory=Counter)  # what, in words, and how often
    _queue: list[tuple[int, int, int, int, int, str, PeriodicOrbit]] = field(default_factory=list)

    def add(self, orbit: PeriodicOrbit) -> bool:
        """Add the branch of an orbit; return False if there was no room for it."""
        if not self.holds(orbit):
            if len(self.branches) >= self.most_branches:
                return False
            self._follow("", orbit, 0)
        return True

    def grow(self) -> None:
        """Add all branches that the branches lead to, shorter orbits first."""
        while self._queue:
            *_, depth, kind, start = heapq.heappop(self._queue)
            if self._has(start, kind):
                continue
            if len(self.branches) < self.most_branches:
                self._follow(kind, start, depth)
            else:
                self.given_up[f"branches beyond the first {self.most_branches}"] += 1

    def _follow(self, kind: str, start: PeriodicOrbit, depth: int) -> None:
        """Add the branch that begins at an orbit, and queue the orbits where others begin."""
        self.check()
        try:
            grown = _FOLLOW[kind](start, self.parameter, self.low, self.high)
        except OrbitError as error:
            self.given_up[str(error)] += 1
            return
        self.branches.append(grown)
        depth = 0 if grown.stable.any() else depth + 1
        for number, (kind_, onward) in enumerate(_onward(grown)):
            turns = 2 if kind_ == "flip" else 1
            m, q = turns * onward.m, turns * onward.q
            if self.classes and (m, q) not in self.classes:
                continue
            if m > self.most_periods:
                self.given_up[f"orbits of more than {self.most_periods} periods"] += 1
            elif depth > 1:
                self.given_up["branches between unstable ones"] += 1
            else:
                order = m, onward.q, len(self.branches), number
                heapq.heappush(self._queue, (*order, depth, kind_, onward))

    def holds(self, orbit: PeriodicOrbit) -> bool:
        """Whether an orbit is on one of the branches."""
        value = float(getattr(orbit.oscillator, self.parameter))
        return any(
            _alike(orbit.speeds, there.speeds)
            for grown in self._of_class(orbit.m, orbit.q)
            for there in grown.at(value)
        )

    def _has(self, orbit: PeriodicOrbit, kind: str) -> bool:
        """Whether a branch of the class that would begin at an orbit already has a point there."""
        turns = 2 if kind == "flip" else 1
        speeds, near = np.tile(orbit.speeds, turns), _VALUE_TOLERANCE * (self.high - self.low)
        value = float(getattr(orbit.oscillator, self.parameter))
        return any(
            _alike(speeds, there)
            for grown in self._of_class(turns * orbit.m, turns * orbit.q)
            for there in grown.speeds[np.abs(grown.values - value) < near]
        )

    def _of_class(self, m: int, q: int) -> Iterator[Branch]:
        return (grown for grown in self.branches if (grown.m, grown.q) == (m, q))


def _onward(grown: Branch) -> Iterator[tuple[str, PeriodicOrbit]]:
    """Yield the orbits at which other branches begin, and how: a key of ``_FOLLOW``."""
    for special in grown.special:
        orbit = special.orbit
        if special.kind == "flip":
            yield ("flip" if orbit.m == grown.m else ""), orbit
        elif special.kind == "graze":
            yield "graze", without_touch(orbit) if orbit.q == grown.q else orbit


def _alike(first: np.ndarray, second: np.ndarray) -> bool:
    size = max(float(first.max(initial=0.0)), float(second.max(initial=0.0)))
    return bool(
        np.abs(np.sort(first) - np.sort(second)).max(initial=0.0) <= _SPEED_TOLERANCE * size
    )
