"""Follows branches from seeds, across each flip and graze: `BranchSet`; shortens chords.

At a flip the orbits of twice the period begin; at a graze an orbit with q impacts becomes one with
q - 1 or q + 1. So a set grows from a few orbits. Where motions are chaotic it would grow for ever.
So there are limits on the length of its orbits, on the number of its branches, and on unstable
branches that lead to unstable ones.

A continuation steps as far as its corrector and its test functions allow. Between two of its points
the plotted curve may bend, and may jump where an impact passes the section.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from sweeps.opened.motions import same_orbit
from vibroimpact.orbits.branches import (
    Branch,
    branch,
    doubled_branch,
    grazing_branch,
    without_touch,
)
from vibroimpact.orbits.family import ContinuationParameter, OrbitFamily
from vibroimpact.orbits.orbit import Orbits, PeriodicOrbit, doubled_orbit
from vibroimpact.orbits.periodic import OrbitError

#: A branch begins at a point of another one if their values agree within this share of the range.
_VALUE_TOLERANCE = 1e-8
#: How to follow a branch from its start, by the kind of that point.
_FOLLOW = {"": branch, "flip": doubled_branch, "graze": grazing_branch}


@dataclass
class BranchSet:
    """Branches over a range of a parameter, each only once."""

    parameter: str
    low: float
    high: float
    phase: float  # of the section at which orbits are compared
    most_branches: int = 100  # of the chosen classes, and as many of all others
    most_periods: int = 64  # longest orbits that are followed, unless their class is chosen
    classes: Collection[tuple[int, int]] = ()  # m and q of the chosen orbits; if empty, all
    check: Callable[[], object] = lambda: None  # is called before each branch; may raise
    branches: list[Branch] = field(default_factory=list)
    given_up: Counter[str] = field(default_factory=Counter)  # what, in words, and how often
    _queue: list[tuple[int, int, int, int, int, str, PeriodicOrbit]] = field(default_factory=list)

    def add(self, orbit: PeriodicOrbit) -> bool:
        """Add the branch of an orbit; return False if there was no room for it."""
        if not self.holds(orbit):
            if not self._has_room(orbit.m, orbit.q):
                return False
            self._follow("", orbit, 0)
        return True

    def is_chosen(self, m: int, q: int) -> bool:
        """Whether a class is chosen; others are followed as chosen ones may begin there."""
        return not self.classes or (m, q) in self.classes

    def _has_room(self, m: int, q: int) -> bool:
        chosen = self.is_chosen(m, q)
        count = sum(self.is_chosen(grown.m, grown.q) == chosen for grown in self.branches)
        return count < self.most_branches

    def grow(self) -> None:
        """Add all branches that the branches lead to, shorter orbits first."""
        while self._queue:
            *_, depth, kind, start = heapq.heappop(self._queue)
            if self._has(start, kind):
                continue
            m, q = _class_from(start, kind)
            if self._has_room(m, q):
                self._follow(kind, start, depth)
            else:
                self._give_up(f"beyond the first {self.most_branches}", m, q)

    def _follow(self, kind: str, start: PeriodicOrbit, depth: int) -> None:
        """Add the branch that begins at an orbit, and queue the orbits where others begin."""
        self.check()
        try:
            grown = _FOLLOW[kind](start, self.parameter, self.low, self.high)
        except OrbitError as error:
            self._give_up(str(error), *_class_from(start, kind))
            return
        self.branches.append(grown)
        depth = 0 if grown.stable.any() else depth + 1
        for number, (kind_, onward) in enumerate(_onward(grown)):
            m, q = _class_from(onward, kind_)
            if m > self.most_periods and (m, q) not in self.classes:
                self._give_up(f"of more than {self.most_periods} periods", m, q)
            elif depth > 1:
                self._give_up("between unstable ones", m, q)
            else:
                order = m, onward.q, len(self.branches), number
                heapq.heappush(self._queue, (*order, depth, kind_, onward))

    def _give_up(self, what: str, m: int, q: int) -> None:
        if self.is_chosen(m, q):
            self.given_up[what] += 1

    def holds(self, orbit: PeriodicOrbit) -> bool:
        """Whether an orbit is on one of the branches."""
        value = float(getattr(orbit.oscillator, self.parameter))
        return any(
            same_orbit(orbit, there, self.phase)
            for grown in self._of_class(orbit.m, orbit.q)
            for there in grown.at(value)
        )

    def _has(self, orbit: PeriodicOrbit, kind: str) -> bool:
        """Whether a branch of the class that would begin at an orbit already has a point there."""
        first = doubled_orbit(orbit) if kind == "flip" else orbit
        near = _VALUE_TOLERANCE * (self.high - self.low)
        value = float(getattr(orbit.oscillator, self.parameter))
        return any(
            same_orbit(first, grown.orbit(i), self.phase)
            for grown in self._of_class(first.m, first.q)
            for i in np.flatnonzero(np.abs(grown.values - value) < near).tolist()
        )

    def _of_class(self, m: int, q: int) -> Iterator[Branch]:
        return (grown for grown in self.branches if (grown.m, grown.q) == (m, q))


def _class_from(orbit: PeriodicOrbit, kind: str) -> tuple[int, int]:
    """Return m and q of the branch that begins at an orbit, by a key of ``_FOLLOW``."""
    turns = 2 if kind == "flip" else 1
    return turns * orbit.m, turns * orbit.q


def _onward(grown: Branch) -> Iterator[tuple[str, PeriodicOrbit]]:
    """Yield the orbits at which other branches begin, and how: a key of ``_FOLLOW``."""
    for special in grown.special:
        orbit = special.orbit
        if special.kind == "flip":
            yield ("flip" if orbit.m == grown.m else ""), orbit
        elif special.kind == "graze":
            yield "graze", without_touch(orbit) if orbit.q == grown.q else orbit


#: A chord is close to the branch if its middle is, and the middles of its halves: one middle alone
#: may be a point of inflection.
_CHECKS = 2


def with_short_chords(
    path: Branch, low: float, high: float, y_of: Callable[[Orbits], np.ndarray], tolerance: float
) -> Branch:
    """Return a branch with enough points that its plotted curve stays close to their chords.

    `y_of` returns the ordinates of n orbits in the plot over the parameter, as shares of the
    plotted ranges, shape (n, k). They stay within `tolerance` of a chord, and a jump lies between
    two points that are as close together. Between such points nothing is looked for.
    """
    (name,) = path.parameters
    osc = replace(path.oscillator, **{name: float(path.values[0])})
    orbit = PeriodicOrbit(osc, path.m, path.phases[0], path.speeds[0])
    family = OrbitFamily(orbit, (ContinuationParameter(name, low, high),))
    X = family.unknowns(path.phases, path.speeds, path.values[:, None])
    y = y_of(path.orbits)
    position = np.arange(len(X), dtype=float)  # along the branch
    begin, end = np.arange(len(X) - 1), np.arange(1, len(X))
    checks = np.full(len(begin), _CHECKS)  # of each chord that are left
    while begin.size:
        middle, converged = _middles(family, X[begin], X[end])
        begin, end, checks = begin[converged], end[converged], checks[converged]
        new = len(X) + np.arange(len(begin))
        X, y = np.concatenate([X, middle]), np.concatenate([y, y_of(family.orbits(middle))])
        position = np.append(position, 0.5 * (position[begin] + position[end]))
        off = _are_off(X[:, -1], y, (begin, new, end), tolerance)
        checks = np.where(off, _CHECKS, checks - 1)
        going = checks > 0
        begin, end = np.append(begin[going], new[going]), np.append(new[going], end[going])
        checks = np.tile(checks[going], 2)
    count = len(path.values)
    if len(X) == count:
        return path
    added = family.orbits(X[count:])
    # Not as their neighbours: a fold and a flip in one step have stable orbits between them.
    stable = (np.abs(added.multipliers) < 1.0).all(axis=1)
    order = np.argsort(position)
    return replace(
        path,
        values=np.append(path.values, family.within(X[count:]))[order],
        stable=np.append(path.stable, stable)[order],
        phases=np.append(path.phases, added.phases, axis=0)[order],
        speeds=np.append(path.speeds, added.speeds, axis=0)[order],
    )


def _middles(
    family: OrbitFamily, begin: np.ndarray, end: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the orbits that are found halfway between orbits of a branch, and which these are."""
    chord = end - begin
    guess = begin + 0.5 * chord
    X, converged = guess, np.ones(len(guess), bool)
    if family.q:
        X, converged = family.corrected_each(guess, chord)
    weights = np.append(np.full(2 * family.q, 1.0 / max(family.q, 1)), 1.0)  # of `inner`
    moved, half = ((weights * step**2).sum(axis=1) for step in (X - guess, guess - begin))
    low, high = family.bounds[0]
    converged &= (moved <= half) & (low <= X[:, -1]) & (X[:, -1] <= high)
    return X[converged], converged


def _are_off(
    x: np.ndarray,
    y: np.ndarray,
    chords: tuple[np.ndarray, np.ndarray, np.ndarray],
    tolerance: float,
) -> np.ndarray:
    """Whether an ordinate of the middle is too far from the chord, for begins, middles and ends."""
    begin, middle, end = chords
    across, up = (x[end] - x[begin])[:, None], y[end] - y[begin]
    x_off, y_off = (x[middle] - x[begin])[:, None], y[middle] - y[begin]
    off = np.abs(across * y_off - up * x_off) > tolerance * np.hypot(across, up)
    # A jump, or ordinates that are rounding only, never come nearer.
    off &= np.maximum(np.abs(across), np.abs(x_off)) > tolerance
    return off.any(axis=1)
