"""Branches of periodic orbits in one parameter, with every bifurcation on them.

A branch is continued from an orbit in both directions (``continuation.py``). On the way its flips
and folds are located (``special_points.py``). It ends in a graze; in a flip of an orbit of half the
period; at the edge of the range; or where the mass would rest. Other branches begin at its flips
and at its grazes.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from vibroimpact.orbits.continuation import continue_branch
from vibroimpact.orbits.detection import ROUNDING
from vibroimpact.orbits.family import ContinuationParameter, OrbitFamily
from vibroimpact.orbits.orbit import PeriodicOrbit, free_orbit, orbit_of, steady_response
from vibroimpact.orbits.periodic import OrbitError, least, refuse_long, solved
from vibroimpact.orbits.special_points import (
    NEARBY_DISTANCE,
    doubling,
    ending,
    halving,
    special_points,
)
from vibroimpact.oscillator import Oscillator, refuse_other

#: Values of the parameter at which the free oscillation is looked at.
_FREE_VALUES = 201


class SpecialPoint(NamedTuple):
    """A special point of a branch or a curve.

    Attributes
    ----------
    kind : str
        ``flip``, ``fold``, ``graze``, ``cusp``, and on a curve of grazes ``flip`` and ``fold``,
        which meet it there. The ends are ``graze`` (an impact has no speed, on a curve another one
        and to 1e-5 of the unit of speed, or a flight touches the stop), ``penetration`` (a flight
        crosses it, and no touch is found), ``rest`` (the mass cannot leave it), ``edge`` of a
        range, and ``lost`` where Newton's method fails or the path is too long.
    value : float, or ndarray of shape (2,)
        Of the parameter; of a curve's two.
    orbit : PeriodicOrbit
        At the graze of a branch it has the impact of speed zero; at the flip in which a branch
        ends, it is the orbit of half the period.
    """

    kind: str
    value: Any
    orbit: PeriodicOrbit


@dataclass(frozen=True, eq=False)
class Branch:
    """A branch of periodic orbits, or a curve of bifurcations, in the order of its points.

    Attributes
    ----------
    kind : str
        ``flip``, ``fold`` or ``graze`` of a curve; empty of a branch.
    parameters : tuple of str
        The one of a branch, the two of a curve.
    m, q : int
        Of the orbits; on a curve of grazes with the impact of speed zero.
    values : ndarray, shape (n,) or (n, 2)
        Of the parameters.
    stable : ndarray of bool, shape (n,)
        Whether both multipliers are inside the unit circle: nowhere on a curve.
    phases, speeds : ndarray, shape (n, q)
        Of the impacts; phases are continuous along the branch.
    special : list of SpecialPoint
        In the order of the branch.
    oscillator : Oscillator
        With the other parameters.
    """

    kind: str
    parameters: tuple[str, ...]
    m: int
    q: int
    values: np.ndarray
    stable: np.ndarray
    phases: np.ndarray
    speeds: np.ndarray
    special: list[SpecialPoint]
    oscillator: Oscillator

    def oscillator_at(self, value: Any) -> Oscillator:
        """Return the oscillator at a value of the parameter, or at two of a curve."""
        values = np.atleast_1d(value).tolist()
        return replace(self.oscillator, **dict(zip(self.parameters, values, strict=True)))

    def orbit(self, i: int) -> PeriodicOrbit:
        """Return the orbit at a point of the branch."""
        osc = self.oscillator_at(self.values[i])
        if self.q == 0:
            return free_orbit(osc)
        return orbit_of(osc, self.m, self.phases[i], self.speeds[i])

    def at(self, value: float) -> list[PeriodicOrbit]:
        """Return the orbits of a branch at a value of its parameter, in the order of the branch."""
        osc, orbits_there = self.oscillator_at(value), []
        away = self.values - value
        crossed = (away[:-1] * away[1:] < 0.0) | (away[:-1] == 0.0)
        crossed[-1:] |= away[-1:] == 0.0
        for i in np.flatnonzero(crossed).tolist():
            share = away[i] / (away[i] - away[i + 1]) if away[i] else 0.0
            between = [
                (1.0 - share) * column[i] + share * column[i + 1]
                for column in (self.phases, self.speeds)
            ]
            try:
                orbit = solved(osc, self.m, *between)
            except OrbitError:  # beside a fold, or a point where the branch ends
                continue
            if (orbit.m, orbit.q) == (self.m, self.q):
                orbits_there.append(orbit)
        return orbits_there


def branch(orbit: PeriodicOrbit, parameter: str, low: float, high: float) -> Branch:
    """Follow a periodic orbit along a parameter, through its folds, in both directions.

    A direction ends ``lost`` after ``MOST_POINTS`` points, or ``MOST_WORK`` time steps of all its
    orbits together.

    Parameters
    ----------
    orbit : PeriodicOrbit
        With its parameter in the range.
    parameter : str
        Name of a parameter of the oscillator.
    low, high : float
        The range, low < high.

    Returns
    -------
    Branch

    Raises
    ------
    OrbitError
        If a repetition of the orbit is more than is solved for, as in `periodic_orbit`.
    TypeError, ValueError
        If an argument is not of its kind, a range is not valid, or the orbit outside it.
    """
    refuse_other("orbit", orbit, PeriodicOrbit)
    refuse_long(orbit.oscillator, orbit.m, orbit.q)
    axis = ContinuationParameter.of(orbit.oscillator, parameter, low, high)
    value = getattr(orbit.oscillator, parameter)
    if not low <= value <= high:
        raise ValueError(f"the orbit is at {parameter} = {value!r}, outside {low!r} to {high!r}")
    if orbit.q == 0:
        return _free_branch(orbit, axis)
    family = OrbitFamily(orbit, (axis,))
    tangent = family.tangent(family.start)
    return both_directions(family, -tangent if tangent[-1] < 0.0 else tangent)


def doubled_branch(orbit: PeriodicOrbit, parameter: str, low: float, high: float) -> Branch:
    """Follow the orbits of twice the period that begin at the flip of an orbit; as `branch`."""
    axis = ContinuationParameter.of(orbit.oscillator, parameter, low, high)
    single = OrbitFamily(orbit, (axis,))
    phases = np.concatenate([orbit.phases, orbit.phases + 2.0 * math.pi * orbit.m])
    twice = PeriodicOrbit(orbit.oscillator, 2 * orbit.m, phases, np.tile(orbit.speeds, 2))
    family = OrbitFamily(twice, (axis,))
    return _as_branch(family, _path(family, *doubling(single, single.start, family.speed)))


def grazing_branch(orbit: PeriodicOrbit, parameter: str, low: float, high: float) -> Branch:
    """Follow the orbits that begin at a graze, which has the impact of speed zero or not.

    OrbitError if none begin there.
    """
    axis = ContinuationParameter.of(orbit.oscillator, parameter, low, high)
    if orbit.q == 0:
        return _free_branch(orbit, axis)
    family = OrbitFamily(orbit, (axis,))
    tangent = family.tangent(family.start)
    for along in (tangent, -tangent):
        X = family.corrected(family.start + NEARBY_DISTANCE * along, along[None, :])
        if X is not None and family.violation(X)[0] is None:
            return _as_branch(family, _path(family, family.start, along))
    raise OrbitError(f"no orbits of {orbit.m}/{orbit.q} begin at the graze")


def without_touch(orbit: PeriodicOrbit) -> PeriodicOrbit:
    """Return an orbit at its graze without the impact of speed zero."""
    kept = np.arange(orbit.q) != np.argmin(orbit.speeds)
    if orbit.q == 1:
        return free_orbit(orbit.oscillator)
    return least(PeriodicOrbit(orbit.oscillator, orbit.m, orbit.phases[kept], orbit.speeds[kept]))


class Path(NamedTuple):
    """The points of a path and whether they are stable, its special points, and if it is closed."""

    points: list[tuple[np.ndarray, bool]]
    special: list[SpecialPoint]
    closed: bool


def both_directions(family: OrbitFamily, tangent: np.ndarray) -> Branch:
    """Continue a family from its start along a tangent and, unless that closes, against it."""
    forward = _path(family, family.start, tangent)
    if forward.closed:
        return _as_branch(family, forward)
    points, special, _ = _path(family, family.start, -tangent)
    points, special = points[::-1] + forward.points[1:], special[::-1] + forward.special
    return _as_branch(family, Path(points, special, closed=False))


def _path(family: OrbitFamily, X: np.ndarray, tangent: np.ndarray) -> Path:
    """Continue a family in one direction."""
    family.system.work[0] = 0.0  # a direction without an end leaves the other one its own

    def note(kind: str, orbit: PeriodicOrbit) -> None:
        value = np.array([getattr(orbit.oscillator, name) for name in family.names])
        special.append(SpecialPoint(kind, value if family.kind else value.item(), orbit))

    start = family.point(X, tangent)
    if family.slowest(X) == 0.0:  # zeros at a graze are there, not after it
        start.tests[0, np.abs(start.tests[0]) < ROUNDING] = math.nan
    points: list[tuple[np.ndarray, bool]] = [(X, family.stable(start))]
    special: list[SpecialPoint] = []
    for step in continue_branch(family, start):
        if step.length > 0.0:
            half = halving(step)
            if half is not None:
                points.append((half[0], False))
                note("flip", half[1])
                break
            for kind, X in special_points(step):
                if not family.kind:  # where a branch may change its stability
                    points.append((X, False))
                note(kind, family.orbit(X))
            points.append((step.end.X, family.stable(step.end)))
        if step.closed:
            return Path(points, special, closed=True)
        if step.last:
            kind, X, orbit = ending(step)
            points[-1] = X, kind == "edge" and family.stable(family.point(X, tangent))
            note(kind, orbit)
    return Path(points, special, closed=False)


def _as_branch(family: OrbitFamily, path: Path) -> Branch:
    X, stable = (np.array(column) for column in zip(*path.points, strict=True))
    values = family.kept(X) if family.kind else family.kept(X)[:, 0]
    return Branch(
        family.kind, family.names, family.m, family.q, values, stable, *family.impacts(X),
        path.special, family.osc,
    )  # fmt: skip


def _free_branch(orbit: PeriodicOrbit, axis: ContinuationParameter) -> Branch:
    """Follow the free oscillation from an orbit to where its amplitude is the clearance."""
    from scipy.optimize import brentq

    def at(value: float) -> Oscillator:
        return replace(orbit.oscillator, **{axis.name: value})

    def gap_left(value: float) -> float:
        osc = at(value)
        return osc.clearance - min(abs(steady_response(osc)), 1e300)

    def end(side: np.ndarray) -> SpecialPoint:
        """Return the last point towards one side."""
        last = start
        for value in side.tolist():
            if not gap_left(value) > 0.0:
                if gap_left(last) > 0.0:  # else it grazes at the start, to rounding
                    last = float(brentq(gap_left, *sorted((last, value)), xtol=1e-15, rtol=1e-15))
                return SpecialPoint("graze", last, _free_graze(at(last)))
            last = value
        return SpecialPoint("edge", last, free_orbit(at(last)))

    start, osc = float(getattr(orbit.oscillator, axis.name)), orbit.oscillator
    # The amplitude has one maximum, in resonance, and no other: it is monotone between these.
    resonance = {"omega": math.sqrt(max(osc.p**2 - 2.0 * osc.h**2, 0.0)), "p": osc.omega}
    values = np.linspace(axis.low, axis.high, _FREE_VALUES)
    values = np.union1d(values, np.clip(resonance.get(axis.name, start), axis.low, axis.high))
    special = [end(values[values < start][::-1]), end(values[values > start])]
    low, high = (point.value for point in special)
    values = np.unique(np.concatenate([[low], values[(values > low) & (values < high)], [high]]))
    stable = np.full(values.size, osc.h > 0.0 or axis.name == "h")
    stable[[i for i in (0, -1) if special[i].kind == "graze"]] = False
    none = np.empty((values.size, 0))
    return Branch("", (axis.name,), 1, 0, values, stable, none, none, special, osc)


def _free_graze(osc: Oscillator) -> PeriodicOrbit:
    """Return the free oscillation that touches the stop, as an orbit with an impact of speed 0."""
    phase = 0.5 * math.pi - cmath.phase(steady_response(osc))  # of the greatest Im A exp(i phase)
    return PeriodicOrbit(osc, 1, np.array([phase % (2.0 * math.pi)]), np.zeros(1))
