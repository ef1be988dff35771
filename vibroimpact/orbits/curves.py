"""Curves of bifurcations in two parameters: flips, folds and grazes of periodic orbits.

A curve is a branch with one condition more and two free parameters (``newton.py``), walked in both
directions like a branch. On a curve of folds, cusps are where the parameters turn back together. A
curve of grazes meets curves of flips and of folds where the middle coefficient of det(S + mu T)
vanishes; these end there, and wherever else their orbit grazes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from vibroimpact.orbits import newton
from vibroimpact.orbits.branches import branch
from vibroimpact.orbits.continuation import End, Segment, Track, both_directions, walk
from vibroimpact.orbits.family import Axis, Objection, Orbits
from vibroimpact.orbits.flights import state_after, values_of
from vibroimpact.orbits.orbit import PeriodicOrbit
from vibroimpact.orbits.periodic import OrbitError, refuse_long
from vibroimpact.orbits.special_points import with_touch
from vibroimpact.oscillator import refuse_other

#: Kinds of curves, with their condition.
KINDS = {"flip": newton.FLIP, "fold": newton.FOLD, "graze": newton.GRAZE}
#: A bifurcation that was found belongs to the orbit if it is closer to it than this, in scaled
#: unknowns.
_BESIDE = 0.2
#: A flight whose top is closer to the stop than this touches it, in units of speed over frequency.
_TOUCHES = 1e-7
#: An impact that is slower than this where a walk ends grazes, in the unit of speed. Where all
#: impacts of a long orbit graze at once, Newton's method fails at 1e-6.
_GRAZES = 1e-5
#: Below this times (2h + p + omega) T exp(-h T), only rounding decides the sign of a coefficient of
#: det(S + mu T).
_ROUNDING = 1e3 * 2.0**-52


class CurvePoint(NamedTuple):
    """A special point of a curve.

    Attributes
    ----------
    kind : str
        ``cusp``; on a curve of grazes ``flip`` and ``fold``, which meet it there; and the ends
        ``graze`` (another impact has no speed, to 1e-5 of the unit of speed, or a flight touches
        the stop), ``rest``, ``edge`` and ``lost`` (Newton's method fails before any of these, or
        the curve is too long); ``penetration`` if a flight crosses the stop, but its touch is
        missed by more than rounding, because Newton's method fails where two halves of the orbit
        become equal.
    values : ndarray, shape (2,)
        Of the two parameters.
    orbit : PeriodicOrbit
    """

    kind: str
    values: np.ndarray
    orbit: PeriodicOrbit


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve of bifurcations, in the order of its points along it.

    Attributes
    ----------
    kind : str
        ``flip``, ``fold`` or ``graze``.
    parameters : tuple of str
    m, q : int
        Of the orbits; at a graze with the impact of speed zero.
    values : ndarray, shape (n, 2)
    phases, speeds : ndarray, shape (n, q)
    special : list of CurvePoint
    """

    kind: str
    parameters: tuple[str, str]
    m: int
    q: int
    values: np.ndarray
    phases: np.ndarray
    speeds: np.ndarray
    special: list[CurvePoint]


def bifurcation_curve(
    orbit: PeriodicOrbit,
    kind: str,
    first: tuple[str, float, float],
    second: tuple[str, float, float],
) -> Curve:
    """Follow a bifurcation of an orbit in two parameters, as far as a `branch` goes.

    Parameters
    ----------
    orbit : PeriodicOrbit
        Near its bifurcation, which is found along the first parameter, or else along the second.
    kind : str
        ``flip``, ``fold`` or ``graze``.
    first, second : tuple of str, float, float
        A parameter of the oscillator, and its range.

    Returns
    -------
    Curve

    Raises
    ------
    OrbitError
        If no such bifurcation is found beside the orbit, or it is outside a range; or if a
        repetition of the orbit is more than is solved for, as in `periodic_orbit`.
    TypeError, ValueError
        If an argument is not valid.
    """
    refuse_other("orbit", orbit, PeriodicOrbit)
    refuse_long(orbit.oscillator, orbit.m, orbit.q)
    if not isinstance(kind, str) or kind not in KINDS:
        raise ValueError(f"kind must be one of {', '.join(KINDS)}, not {kind!r}")
    for bounds in (first, second):
        if not isinstance(bounds, (tuple, list)) or len(bounds) != 3:
            raise ValueError(f"a parameter needs (name, low, high), not {bounds!r}")
    axes = tuple(Axis.of(orbit.oscillator, *bounds) for bounds in (first, second))
    if axes[0].name == axes[1].name:
        raise ValueError(f"a curve needs two parameters, not {axes[0].name} twice")
    start = _onto(orbit, kind, axes)
    for axis in axes:
        value = getattr(start.oscillator, axis.name)
        if not axis.low - axis.slack <= value <= axis.high + axis.slack:
            raise OrbitError(
                f"the {kind} is at {axis.name} = {value:g}, outside {axis.low:g} to {axis.high:g}"
            )
    index = int(np.argmin(start.speeds))
    orbits = Orbits(start, axes, KINDS[kind], index)
    tangent = orbits.tangent(orbits.start)
    if not np.isfinite(tangent).all():
        raise OrbitError(f"the {kind} does not go on in {first[0]} and {second[0]}")
    track = both_directions(partial(_walked, orbits, kind), tangent)
    X, names = np.array(track.points), (axes[0].name, axes[1].name)
    values, impacts = orbits.kept(X), orbits.impacts(X)
    return Curve(kind, names, orbits.m, orbits.q, values, *impacts, track.special)


def _onto(orbit: PeriodicOrbit, kind: str, axes: Sequence[Axis]) -> PeriodicOrbit:
    """Return the bifurcation beside an orbit, found along one parameter."""
    grazes = orbit.q > 0 and orbit.speeds.min() <= 1e-6 * orbit.speeds.max(initial=0.0)
    if orbit.q > 0 and (kind != "graze" or grazes):
        for axis in axes:
            orbits = Orbits(orbit, (axis,))
            X = orbits.start
            none = np.empty((0, X.size))
            Y = orbits.corrected(X, none, KINDS[kind], int(np.argmin(orbit.speeds)))
            if Y is None or not orbits.inner(Y - X, Y - X) < _BESIDE**2:
                continue
            if kind == "graze":
                Y[2 * int(np.argmin(orbit.speeds)) + 1] = 0.0
            if orbits.objection(Y) is None:
                return orbits.orbit(Y)
    for axis in axes:
        value = getattr(orbit.oscillator, axis.name)
        if not axis.low <= value <= axis.high:
            continue
        candidates = [
            point
            for point in branch(orbit, axis.name, axis.low, axis.high).special
            if point.kind == kind
        ]
        if candidates:
            return min(candidates, key=lambda point: abs(point.value - value)).orbit
    raise OrbitError(f"no {kind} is found on the branches of the orbit")


def _walked(orbits: Orbits, kind: str, tangent: np.ndarray) -> Track:
    """Walk in one direction from the start."""
    track = Track([orbits.start], [], False)
    for part in walk(orbits, orbits.start, tangent):
        if isinstance(part, End):
            if part.closed:
                return track._replace(closed=True)
            X, name = part.X, _end_kind(orbits, part)
            track.special.append(CurvePoint(name, orbits.kept(X), orbits.orbit(X)))
            return track
        for name, X in _meetings(part, kind):
            track.special.append(CurvePoint(name, orbits.kept(X), orbits.orbit(X)))
        track.points.append(part.Y)
    return track


def _meetings(step: Segment, kind: str) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the points of codimension two within a step."""
    orbits = step.orbits
    if kind == "graze":
        ends = [orbits.polynomial(X)[1] for X in (step.X, step.Y)]
        # Without damping the coefficient may be zero along the whole curve; then only rounding
        # decides its sign.
        if ends[0] * ends[1] < 0.0 and max(map(abs, ends)) > _rounding(orbits, step.X):
            X = step.root(lambda X: orbits.polynomial(X)[1])
            if X is not None:
                yield from (("flip", X), ("fold", X))
    elif kind == "fold":
        before, after = (_heading(step, X) for X in (step.X, step.Y))
        if before @ after < 0.0:
            turn = after - before
            X = step.root(lambda X: float(_heading(step, X) @ turn))
            if X is not None:
                yield "cusp", X


def _rounding(orbits: Orbits, X: np.ndarray) -> float:
    """Return a bound on the rounding of c1, which decays as the flow over the m periods does."""
    osc = orbits.oscillator(X)
    T = 2.0 * math.pi * orbits.m / osc.omega
    return _ROUNDING * (2.0 * osc.h + osc.p + osc.omega) * T * math.exp(-osc.h * T)


def _heading(step: Segment, X: np.ndarray) -> np.ndarray:
    """Return the direction of the parameters at a point of a step."""
    tangent = step.orbits.tangent(X)
    forward = step.orbits.inner(tangent, step.tangent) > 0.0
    return tangent[-2:] if forward else -tangent[-2:]


def _end_kind(orbits: Orbits, end: End) -> str:
    """Say how a walk that is not closed ends."""
    if end.objection is None:
        return "lost"
    if end.objection.kind == "speed":
        return "graze" if end.X[2 * end.objection.at + 1] < _GRAZES else "lost"
    if end.objection.kind == "pass":
        return "graze" if _touches(orbits, end.X, end.objection) else "penetration"
    return end.objection.kind


def _touches(orbits: Orbits, X: np.ndarray, objection: Objection) -> bool:
    """Whether a flight that crosses the stop only touches it, to rounding."""
    touching, Y = with_touch(orbits, X, objection)
    osc, at = touching.oscillator(Y), objection.at
    tau = (Y[2 * at + 2] - Y[2 * at]) / osc.omega
    height, *_ = state_after(values_of(osc), Y[2 * at], Y[2 * at + 1] * orbits.speed, tau)
    return abs(height) < _TOUCHES * orbits.speed / osc.omega
