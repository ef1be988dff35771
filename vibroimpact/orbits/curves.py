"""`bifurcation_curve`: finds the flip, fold or graze near an orbit, follows it.

A curve is a branch with one more condition and two free parameters (``corrector.py``), continued in
both directions like a branch.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vibroimpact.inputs import input_text, one_of, refuse_other
from vibroimpact.orbits.branches import (
    STILL,
    Branch,
    as_branch,
    branch,
    refuse_natural,
    without_touch,
)
from vibroimpact.orbits.continuation import cannot_leave
from vibroimpact.orbits.corrector import CONDITIONS
from vibroimpact.orbits.family import ContinuationParameter, OrbitFamily
from vibroimpact.orbits.orbit import PeriodicOrbit, orbit_of
from vibroimpact.orbits.periodic import OrbitError, refuse_long
from vibroimpact.orbits.singular_ends import doubling, starts_degenerate
from vibroimpact.orbits.special_points import both_ways
from vibroimpact.orbits.unknowns import ROUNDING, impact_rows, speeds

#: The kinds of curves.
CURVE_KINDS = tuple(filter(None, CONDITIONS))
#: A bifurcation that was found belongs to the orbit if it is closer to it than this, in scaled
#: unknowns.
_NEAR_ORBIT = 0.2
#: Sizes of the orbits of twice the period that are tried beside a degenerate flip, and the most
#: iterations for each. Large ones may belong to another flip, the small ones may be rounding.
_SIZES, _MOST_PER_SIZE = (0.02, 0.01, 0.005, 0.1, 0.05, 0.2), 30
#: A curve is begun this far beside a start where impacts meet, in scaled unknowns.
_BESIDE = 5e-3


def bifurcation_curve(
    orbit: PeriodicOrbit,
    kind: str,
    first: tuple[str, float, float],
    second: tuple[str, float, float],
) -> Branch:
    """Follow a bifurcation of an orbit in two parameters, as far as `branch` follows an orbit.

    A curve of folds also ends where the two halves of its orbit become equal: the orbit of half the
    period has a degenerate flip there, at which its flips change their criticality.

    Parameters
    ----------
    orbit : PeriodicOrbit
        An orbit near its bifurcation, which is searched along the first parameter, then the second;
        one that is known to be there (its `kind`) is taken as it is. At a degenerate flip the folds
        are those of the orbits of twice the period, which begin there.
    kind : str
        ``flip``, ``fold`` or ``graze``.
    first, second : tuple of str, float, float
        Name of a parameter of the oscillator, and its range.

    Returns
    -------
    Branch
        A curve of that `kind`, with two parameters. Where the bifurcation was found, the first
        parameter increases from point to point; if it stays the same, the second one does.

    Raises
    ------
    OrbitError
        If no such bifurcation is found near the orbit, or it is outside a range; if a flip is
        degenerate and no fold is found beside it; if a graze is one of any natural vibration,
        without damping; if impacts meet in the orbit, at the end of a curve, and no other is found
        beside it; or if a repetition of the orbit is too long to be solved for, as in
        `periodic_orbit`.
    TypeError, ValueError
        If an argument is not valid.

    Examples
    --------
    >>> from vibroimpact import Oscillator, one_impact_orbit
    >>> orbit = one_impact_orbit(Oscillator(h=0.1, R=0.8, omega=2.66, f=1.0))
    >>> curve = bifurcation_curve(orbit, "flip", ("omega", 2.2, 3.2), ("R", 0.6, 0.95))
    >>> curve.values[[0, -1]].round(6)  # omega and R at both ends
    array([[2.654507, 0.95    ],
           [2.68076 , 0.6     ]])
    """
    refuse_other("orbit", orbit, PeriodicOrbit)
    refuse_long(orbit.oscillator, orbit.m, orbit.q)
    one_of(CURVE_KINDS).checked("kind", kind)
    ranges: tuple[object, object] = (first, second)
    for bounds in ranges:
        if not isinstance(bounds, (tuple, list)) or len(bounds) != 3:
            raise ValueError(f"a parameter needs (name, low, high), not {input_text(bounds)}")
    axes = [ContinuationParameter.of(orbit.oscillator, *bounds) for bounds in (first, second)]
    if axes[0].name == axes[1].name:
        raise ValueError(f"a curve needs two parameters, not {axes[0].name} twice")
    start = orbit
    if orbit.kind != kind:
        if (orbit.kind, kind) == ("flip", "fold") and starts_degenerate(orbit, axes):
            start = _fold_of_twice(orbit, axes)
        else:
            start = _bifurcation(orbit, kind, axes)
        if kind == "graze":
            start = _least_graze(start, axes)
            refuse_natural(start)
    for axis in axes:
        value = getattr(start.oscillator, axis.name)
        if not axis.holds(value):
            raise OrbitError(
                f"the {kind} is at {axis.name} = {value:g}, outside {axis.low:g} to {axis.high:g}"
            )
    for graze in np.flatnonzero(start.speeds == start.speeds.min()).tolist():
        curve = _follow(OrbitFamily(start, axes, kind, graze))
        if len(curve.values) > 1:  # where two impacts graze, one of two curves may be in the ranges
            break
    return curve


def _follow(family: OrbitFamily) -> Branch:
    """Follow a curve from its start both ways."""
    if cannot_leave(family, family.start):
        family.start = _beside(family)
    tangent = family.tangent(family.start)
    first_along, second_along = tangent[-2:].tolist()
    sign = first_along if abs(first_along) > ROUNDING else second_along
    return as_branch(both_ways(family, math.copysign(1.0, sign) * tangent))


def _beside(family: OrbitFamily) -> np.ndarray:
    """Return a point of a curve beside its start, where impacts meet: it is singular there."""
    tangent = family.tangent(family.start)
    for length in (_BESIDE, -_BESIDE):
        guess = family.start + length * tangent
        X = family.corrected(guess, tangent[None, :], _MOST_PER_SIZE)
        if X is not None and family.inadmissible(X)[0] is None:
            return X
    raise OrbitError(f"impacts meet at the {family.kind}, and no other is found beside it")


def _fold_of_twice(orbit: PeriodicOrbit, axes: Sequence[ContinuationParameter]) -> PeriodicOrbit:
    """Return a fold of orbits of twice the period beside a degenerate flip."""
    flips = OrbitFamily(orbit, axes, "flip")
    X, along = doubling(flips, flips.start)
    m, q = 2 * flips.m, 2 * flips.q
    folds = flips.related(impact_rows(X, q), m, "fold")
    for size in _SIZES:
        Y = folds.corrected(X + size * along, along[None, :], _MOST_PER_SIZE)
        if Y is not None and folds.inadmissible(Y)[0] is None:
            return folds.orbit(Y)
    raise OrbitError(f"no fold of the orbits of {m}/{q} is found beside the degenerate flip")


def _bifurcation(
    orbit: PeriodicOrbit, kind: str, axes: Sequence[ContinuationParameter]
) -> PeriodicOrbit:
    """Return the bifurcation near an orbit, found along one parameter."""
    grazes = orbit.q > 0 and orbit.speeds.min() <= 1e-6 * orbit.speeds.max(initial=0.0)
    if orbit.q > 0 and (kind != "graze" or grazes):
        for axis in axes:
            family = OrbitFamily(orbit, (axis,))
            X = family.bifurcation(family.start, kind, int(np.argmin(orbit.speeds)))
            if X is not None and family.distance(X, family.start) < _NEAR_ORBIT:
                if family.inadmissible(X)[0] is None:
                    return family.orbit(X)
    said = f"no {kind} is found on the branches of the orbit"
    for axis in axes:
        value = getattr(orbit.oscillator, axis.name)
        if not axis.low <= value <= axis.high:
            said = axis.outside(value)
            continue
        candidates = [
            point
            for point in branch(orbit, axis.name, axis.low, axis.high).special
            if point.kind == kind
        ]
        if candidates:
            return min(candidates, key=lambda point: abs(point.value - value)).orbit
    raise OrbitError(said)


def _least_graze(orbit: PeriodicOrbit, axes: Sequence[ContinuationParameter]) -> PeriodicOrbit:
    """Return the same graze with the fewest impacts; with more its equations are singular."""
    osc = orbit.oscillator
    if orbit.q > 1 and not speeds(orbit.equations[1], orbit.q).max() > STILL:
        touch = PeriodicOrbit(osc, orbit.m, orbit.phases[:1], np.zeros(1))
        return _bifurcation(touch, "graze", axes)
    shorter = without_touch(orbit)
    if shorter.q == 0 or shorter.m == orbit.m:
        return orbit
    phases = np.append(shorter.phases, orbit.phases[np.argmin(orbit.speeds)])
    return orbit_of(osc, shorter.m, phases, np.append(shorter.speeds, 0.0))
