"""Curves of bifurcations in two parameters: flips, folds and grazes of periodic orbits.

A curve is a branch with one condition more and two free parameters (``corrector.py``), walked in
both directions like a branch. On a curve of folds, cusps are where the parameters turn back
together. A curve of grazes meets curves of flips and of folds where the middle coefficient of
det(S + mu T) vanishes; these end there, and wherever else their orbit grazes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from vibroimpact.orbits.branches import branch
from vibroimpact.orbits.continuation import End, Segment, Track, both_directions, walk
from vibroimpact.orbits.corrector import FLIP, FOLD, GRAZE
from vibroimpact.orbits.detection import HEADING
from vibroimpact.orbits.family import Axis, Orbits
from vibroimpact.orbits.orbit import PeriodicOrbit, orbit_of
from vibroimpact.orbits.periodic import OrbitError, refuse_long
from vibroimpact.orbits.special_points import crossing, ending
from vibroimpact.orbits.switching import without_touch
from vibroimpact.oscillator import refuse_other

#: Kinds of curves, with their condition.
KINDS = {"flip": FLIP, "fold": FOLD, "graze": GRAZE}
#: A bifurcation that was found belongs to the orbit if it is closer to it than this, in scaled
#: unknowns.
_BESIDE = 0.2


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
    start = _least_graze(_onto(orbit, kind, axes)) if kind == "graze" else _onto(orbit, kind, axes)
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


def _least_graze(orbit: PeriodicOrbit) -> PeriodicOrbit:
    """Return the graze of a shorter orbit that an orbit repeats, at which it is singular."""
    shorter = without_touch(orbit)
    if shorter.q == 0 or shorter.m == orbit.m:
        return orbit
    phases = np.append(shorter.phases, orbit.phases[np.argmin(orbit.speeds)])
    return orbit_of(orbit.oscillator, shorter.m, phases, np.append(shorter.speeds, 0.0))


def _walked(orbits: Orbits, kind: str, tangent: np.ndarray) -> Track:
    """Walk in one direction from the start."""
    track = Track([orbits.start], [], False)
    for part in walk(orbits, orbits.point(orbits.start, tangent)):
        if isinstance(part, End):
            if part.closed:
                return track._replace(closed=True)
            name, X, orbit = ending(orbits, part)
            track.special.append(CurvePoint(name, orbits.kept(X), orbit))
            return track
        for name, X in _meetings(part, kind):
            track.special.append(CurvePoint(name, orbits.kept(X), orbits.orbit(X)))
        track.points.append(part.end.X)
    return track


def _meetings(step: Segment, kind: str) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the points of codimension two within a step."""
    if kind == "graze":
        # Without damping the coefficient may be zero along the whole curve; then only rounding
        # decides its sign.
        if crossing(step, -2) is not None:
            X = step.root(partial(step.orbits.test, -2))
            if X is not None:
                yield from (("flip", X), ("fold", X))
    elif kind == "fold":
        before, after = (_heading(step, point.X) for point in (step.begin, step.end))
        if before @ after < 0.0 and max(np.abs(before).max(), np.abs(after).max()) > HEADING:
            turn = after - before
            X = step.root(lambda X: float(_heading(step, X) @ turn))
            if X is not None:
                yield "cusp", X


def _heading(step: Segment, X: np.ndarray) -> np.ndarray:
    """Return the direction of the parameters at a point of a step."""
    tangent = step.orbits.tangent(X)
    forward = step.orbits.inner(tangent, step.begin.tangent) > 0.0
    return tangent[-2:] if forward else -tangent[-2:]
