"""Branches of periodic orbits in one parameter, with every bifurcation on them.

A branch is walked from an orbit in both directions (``continuation.py``). On the way its flips and
folds are located (``special_points.py``). It ends in a graze; in a flip of an orbit of half the
period; at the edge of the range; or where the mass would rest.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from vibroimpact.orbits.continuation import End, Track, both_directions, walk
from vibroimpact.orbits.family import Axis, Orbits
from vibroimpact.orbits.orbit import PeriodicOrbit, free_orbit, orbit_of, steady_response
from vibroimpact.orbits.periodic import OrbitError, refuse_long, solved
from vibroimpact.orbits.special_points import bifurcations, ending, halving
from vibroimpact.oscillator import Oscillator, refuse_other

#: Values of the parameter at which the free oscillation is looked at.
_FREE_VALUES = 201


class Special(NamedTuple):
    """A special point of a branch.

    Attributes
    ----------
    kind : str
        ``flip``, ``fold``, ``graze``; and the ends ``penetration`` (a flight meets the stop),
        ``rest`` (the mass cannot leave it), ``edge`` of the range, and ``lost`` where Newton's
        method fails or the branch is too long.
    value : float
        Of the parameter.
    orbit : PeriodicOrbit
        At a graze it has the impact of speed zero; at the flip in which a branch ends, it is the
        orbit of half the period.
    """

    kind: str
    value: float
    orbit: PeriodicOrbit


@dataclass(frozen=True, eq=False)
class Branch:
    """A branch of periodic orbits, in the order of its points along it.

    Attributes
    ----------
    parameter : str
    m, q : int
    values : ndarray, shape (n,)
        Of the parameter.
    stable : ndarray of bool, shape (n,)
        Whether both multipliers are inside the unit circle.
    phases, speeds : ndarray, shape (n, q)
        Of the impacts; phases are continuous along the branch.
    special : list of Special
        In the order of the branch.
    """

    parameter: str
    m: int
    q: int
    values: np.ndarray
    stable: np.ndarray
    phases: np.ndarray
    speeds: np.ndarray
    special: list[Special]
    start: PeriodicOrbit

    def orbit(self, i: int) -> PeriodicOrbit:
        """Return the orbit at a point of the branch."""
        osc = replace(self.start.oscillator, **{self.parameter: float(self.values[i])})
        if self.q == 0:
            return free_orbit(osc)
        return orbit_of(osc, self.m, self.phases[i], self.speeds[i])

    def at(self, value: float) -> list[PeriodicOrbit]:
        """Return the orbits at a value of the parameter, in the order of the branch."""
        osc, orbits_there = replace(self.start.oscillator, **{self.parameter: float(value)}), []
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

    The branch ends ``lost`` after ``MOST_POINTS`` points in a direction, or ``MOST_WORK`` time
    steps of all its orbits together.

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
    axis = Axis.of(orbit.oscillator, parameter, low, high)
    value = getattr(orbit.oscillator, parameter)
    if not low <= value <= high:
        raise ValueError(f"the orbit is at {parameter} = {value!r}, outside {low!r} to {high!r}")
    if orbit.q == 0:
        return free_branch(orbit, axis)
    orbits = Orbits(orbit, (axis,))
    tangent = orbits.tangent(orbits.start)
    along = -tangent if tangent[-1] < 0.0 else tangent
    return _branch(orbits, both_directions(partial(_walked, orbits, orbits.start), along), orbit)


def branch_beyond(
    orbits: Orbits, X: np.ndarray, tangent: np.ndarray, start: PeriodicOrbit
) -> Branch:
    """Follow orbits in one direction from a point where their branch begins, `start`."""
    return _branch(orbits, _walked(orbits, X, tangent), start)


def _branch(orbits: Orbits, track: Track, start: PeriodicOrbit) -> Branch:
    points, stable = (np.array(column) for column in zip(*track.points, strict=True))
    axis, m, q = orbits.axes[0], orbits.m, orbits.q
    values, impacts = orbits.kept(points)[:, 0], orbits.impacts(points)
    return Branch(axis.name, m, q, values, stable, *impacts, track.special, start)


def _walked(orbits: Orbits, X: np.ndarray, tangent: np.ndarray) -> Track:
    """Walk in one direction, and note which points are stable."""

    def special(kind: str, orbit: PeriodicOrbit) -> Special:
        return Special(kind, float(getattr(orbit.oscillator, orbits.axes[0].name)), orbit)

    start = orbits.point(X, tangent)
    track = Track([(X, orbits.stable(start))], [], False)
    for part in walk(orbits, start):
        if isinstance(part, End):
            if part.closed:
                return track._replace(closed=True)
            kind, X, orbit = ending(orbits, part)
            stable = kind == "edge" and orbits.stable(orbits.point(X, tangent))
            track.points[-1] = X, stable
            track.special.append(special(kind, orbit))
            return track
        half = halving(part)
        if half is not None:
            track.points.append((half[0], False))
            track.special.append(special("flip", half[1]))
            return track
        for kind, X in bifurcations(part):
            track.points.append((X, False))
            track.special.append(special(kind, orbits.orbit(X)))
        track.points.append((part.end.X, orbits.stable(part.end)))
    return track


def free_branch(orbit: PeriodicOrbit, axis: Axis) -> Branch:
    """Follow the free oscillation from an orbit to where its amplitude is the clearance."""
    from scipy.optimize import brentq

    def gap_left(value: float) -> float:
        osc = replace(orbit.oscillator, **{axis.name: value})
        return osc.clearance - min(abs(steady_response(osc)), 1e300)

    def end(side: np.ndarray) -> Special:
        """Return the last point towards one side."""
        last = start
        for value in side.tolist():
            if not gap_left(value) > 0.0:
                if gap_left(last) > 0.0:  # else it grazes at the start, to rounding
                    last = float(brentq(gap_left, *sorted((last, value)), xtol=1e-15, rtol=1e-15))
                osc = replace(orbit.oscillator, **{axis.name: last})
                return Special("graze", last, _free_graze(osc))
            last = value
        return Special("edge", last, free_orbit(replace(orbit.oscillator, **{axis.name: last})))

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
    return Branch(axis.name, 1, 0, values, stable, none, none, special, orbit)


def _free_graze(osc: Oscillator) -> PeriodicOrbit:
    """Return the free oscillation that touches the stop, as an orbit with an impact of speed 0."""
    phase = 0.5 * math.pi - cmath.phase(steady_response(osc))  # of the greatest Im A exp(i phase)
    return PeriodicOrbit(osc, 1, np.array([phase % (2.0 * math.pi)]), np.zeros(1))
