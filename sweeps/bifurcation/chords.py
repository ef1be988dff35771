"""Additional points on a branch, until straight lines between its points show it well.

A continuation steps as far as its corrector and its test functions allow. Between two of its points
the plotted curve may bend, and may jump where an impact passes the section.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from vibroimpact.orbits.branches import Branch
from vibroimpact.orbits.family import ContinuationParameter, OrbitFamily
from vibroimpact.orbits.orbit import Orbits, PeriodicOrbit

#: A chord is close to the branch if its middle is, and the middles of its halves: one middle alone
#: may be a point of inflection.
_CHECKS = 2


def with_short_chords(
    found: Branch,
    low: float,
    high: float,
    drawn: Callable[[Orbits], np.ndarray],
    tolerance: float,
) -> Branch:
    """Return a branch with enough points that its plotted curve stays close to their chords.

    `drawn` returns the ordinates of n orbits in the plot over the parameter, as shares of the
    plotted ranges, shape (n, k). They stay within `tolerance` of a chord, and a jump lies between
    two points that are as close together. Between such points nothing is looked for.
    """
    (name,) = found.parameters
    osc = replace(found.oscillator, **{name: float(found.values[0])})
    orbit = PeriodicOrbit(osc, found.m, found.phases[0], found.speeds[0])
    family = OrbitFamily(orbit, (ContinuationParameter(name, low, high),))
    X = family.unknowns(found.phases, found.speeds, found.values[:, None])
    y = drawn(found.orbits)
    place = np.arange(len(X), dtype=float)  # along the branch
    begin, end = np.arange(len(X) - 1), np.arange(1, len(X))
    checks = np.full(len(begin), _CHECKS)  # of each chord that are left
    while begin.size:
        middle, is_found = _middles(family, X[begin], X[end])
        begin, end, checks = begin[is_found], end[is_found], checks[is_found]
        new = len(X) + np.arange(len(begin))
        X, y = np.concatenate([X, middle]), np.concatenate([y, drawn(family.orbits(middle))])
        place = np.append(place, 0.5 * (place[begin] + place[end]))
        off = _are_off(X[:, -1], y, (begin, new, end), tolerance)
        checks = np.where(off, _CHECKS, checks - 1)
        going = checks > 0
        begin, end = np.append(begin[going], new[going]), np.append(new[going], end[going])
        checks = np.tile(checks[going], 2)
    count = len(found.values)
    if len(X) == count:
        return found
    added = family.orbits(X[count:])
    # Not as their neighbours: a fold and a flip in one step have stable orbits between them.
    stable = (np.abs(added.multipliers) < 1.0).all(axis=1)
    order = np.argsort(place)
    return replace(
        found,
        values=np.append(found.values, family.kept(X[count:]))[order],
        stable=np.append(found.stable, stable)[order],
        phases=np.append(found.phases, added.phases, axis=0)[order],
        speeds=np.append(found.speeds, added.speeds, axis=0)[order],
    )


def _middles(
    family: OrbitFamily, begin: np.ndarray, end: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the orbits that are found halfway between orbits of a branch, and which these are."""
    chord = end - begin
    guess = begin + 0.5 * chord
    X, is_found = guess, np.ones(len(guess), bool)
    if family.q:
        X, is_found = family.corrected_each(guess, chord)
    weights = np.append(np.full(2 * family.q, 1.0 / max(family.q, 1)), 1.0)  # of `inner`
    moved, half = ((weights * way**2).sum(axis=1) for way in (X - guess, guess - begin))
    low, high = family.bounds[0]
    is_found &= (moved <= half) & (low <= X[:, -1]) & (X[:, -1] <= high)
    return X[is_found], is_found


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
