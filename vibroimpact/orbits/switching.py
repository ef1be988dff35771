"""The branches that begin at a flip or at a graze of an orbit."""

from __future__ import annotations

import math

import numpy as np

from vibroimpact.orbits.branches import Branch, branch_beyond, free_branch
from vibroimpact.orbits.family import Axis, Orbits
from vibroimpact.orbits.orbit import PeriodicOrbit, free_orbit
from vibroimpact.orbits.periodic import OrbitError, least
from vibroimpact.orbits.special_points import NEARBY_DISTANCE, doubling


def doubled_branch(orbit: PeriodicOrbit, parameter: str, low: float, high: float) -> Branch:
    """Follow the orbits of twice the period that begin at the flip of an orbit.

    Parameters
    ----------
    orbit : PeriodicOrbit
        At its flip: the orbit of a special point of that kind.
    parameter, low, high
        As of `branch`.
    """
    axis = Axis.of(orbit.oscillator, parameter, low, high)
    single = Orbits(orbit, (axis,))
    z = np.concatenate([orbit.phases, orbit.phases + 2.0 * math.pi * orbit.m])
    twice = PeriodicOrbit(orbit.oscillator, 2 * orbit.m, z, np.tile(orbit.speeds, 2))
    orbits = Orbits(twice, (axis,))
    X, along = doubling(single, single.start, orbits.speed)
    return branch_beyond(orbits, X, along, twice)


def grazing_branch(orbit: PeriodicOrbit, parameter: str, low: float, high: float) -> Branch:
    """Follow the orbits that begin at a graze.

    Parameters
    ----------
    orbit : PeriodicOrbit
        At its graze: with the impact of speed zero, or without it.
    parameter, low, high
        As of `branch`.

    Raises
    ------
    OrbitError
        If none begin there.
    """
    axis = Axis.of(orbit.oscillator, parameter, low, high)
    if orbit.q == 0:
        return free_branch(orbit, axis)
    orbits = Orbits(orbit, (axis,))
    tangent = orbits.tangent(orbits.start)
    for along in (tangent, -tangent):
        X = orbits.corrected(orbits.start + NEARBY_DISTANCE * along, along[None, :])
        if X is not None and orbits.objection(X) is None:
            return branch_beyond(orbits, orbits.start, along, orbit)
    raise OrbitError(f"no orbits of {orbit.m}/{orbit.q} begin at the graze")


def without_touch(orbit: PeriodicOrbit) -> PeriodicOrbit:
    """Return an orbit at its graze without the impact of speed zero."""
    kept = np.arange(orbit.q) != np.argmin(orbit.speeds)
    if orbit.q == 1:
        return free_orbit(orbit.oscillator)
    return least(PeriodicOrbit(orbit.oscillator, orbit.m, orbit.phases[kept], orbit.speeds[kept]))
