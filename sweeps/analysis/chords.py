"""Additional points on a branch, until straight lines between its points show it well.

A continuation steps as far as its corrector and its test functions allow. Between two of its points
the plotted curve may bend, and may jump where an impact passes the section.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from vibroimpact.orbits.branches import Branch
from vibroimpact.orbits.family import ContinuationParameter, OrbitFamily
from vibroimpact.orbits.orbit import PeriodicOrbit
from vibroimpact.orbits.unknowns import unknowns

#: A chord is close to the branch if its middle is, and the middles of its halves: one middle alone
#: may be a point of inflection.
_CHECKS = 2


def with_short_chords(
    found: Branch,
    low: float,
    high: float,
    drawn: Callable[[PeriodicOrbit], np.ndarray],
    tolerance: float,
) -> Branch:
    """Return a branch with enough points that its plotted curve stays close to their chords.

    `drawn` returns the ordinates of an orbit in the plot over the parameter, as shares of the
    plotted ranges, shape (k,). They stay within `tolerance` of a chord, and a jump lies between two
    points that are as close together. Between such points nothing is looked for.
    """
    if len(found.values) < 2:
        return found
    (name,) = found.parameters
    osc = replace(found.oscillator, **{name: float(found.values[0])})
    orbit = PeriodicOrbit(osc, found.m, found.phases[0], found.speeds[0])
    family = OrbitFamily(orbit, (ContinuationParameter(name, low, high),))
    chords = _Chords(family, drawn, tolerance)
    z = np.stack([found.phases, found.speeds / family.speed], axis=2)
    places = [chords.place(X) for X in unknowns(z, found.values[:, None] / family.spans)]
    index, added = [], []
    for i, (begin, end) in enumerate(pairwise(places), 1):
        between = [place.X for place in chords.between(begin, end)]
        index += [i] * len(between)
        added += between
    if not added:
        return found
    X = np.array(added)
    phases, speeds = family.impacts(X)
    # Not as their neighbours: a fold and a flip in one step have stable orbits between them.
    stable = [chords.orbit(point).stable for point in added]
    return replace(
        found,
        values=np.insert(found.values, index, family.kept(X)[:, 0]),
        stable=np.insert(found.stable, index, stable),
        phases=np.insert(found.phases, index, phases, axis=0),
        speeds=np.insert(found.speeds, index, speeds, axis=0),
    )


class _Place(NamedTuple):
    """The unknowns of an orbit, (2 q + 1,), and its abscissa and ordinates in the plot."""

    X: np.ndarray
    x: float
    y: np.ndarray


@dataclass(frozen=True)
class _Chords:
    """The chords of a branch; attributes as in `with_short_chords`."""

    family: OrbitFamily
    drawn: Callable[[PeriodicOrbit], np.ndarray]
    tolerance: float

    def orbit(self, X: np.ndarray) -> PeriodicOrbit:
        """Return an orbit with its impacts numbered as on the branch."""
        return PeriodicOrbit(self.family.oscillator(X), self.family.m, *self.family.impacts(X))

    def place(self, X: np.ndarray) -> _Place:
        """Return the place of an orbit in the plot."""
        return _Place(X, float(X[-1]), self.drawn(self.orbit(X)))

    def between(self, begin: _Place, end: _Place, checks: int = _CHECKS) -> Iterator[_Place]:
        """Yield the points that are needed between two places, in order."""
        middle = self._middle(begin, end)
        if middle is None:
            return
        checks = _CHECKS if self._is_off(begin, middle, end) else checks - 1
        if checks:
            yield from self.between(begin, middle, checks)
        yield middle
        if checks:
            yield from self.between(middle, end, checks)

    def _middle(self, begin: _Place, end: _Place) -> _Place | None:
        """Return the orbit halfway between two orbits of a branch; None if none is found."""
        family, chord = self.family, end.X - begin.X
        guess = begin.X + 0.5 * chord
        X = family.corrected(guess, chord[None, :]) if family.q else guess
        if X is None or family.distance(X, guess) > family.distance(guess, begin.X):
            return None
        return self.place(X) if family.parameters[0].holds(family.values(X).item()) else None

    def _is_off(self, begin: _Place, middle: _Place, end: _Place) -> bool:
        """Whether an ordinate of the middle is too far from the chord."""
        across, up = end.x - begin.x, end.y - begin.y
        if max(abs(across), abs(middle.x - begin.x)) <= self.tolerance:
            return False  # a jump, or ordinates that are rounding only, never come nearer
        away = across * (middle.y - begin.y) - up * (middle.x - begin.x)
        return bool((np.abs(away) > self.tolerance * np.hypot(across, up)).any())
