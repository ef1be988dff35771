"""The stable periodic orbit to which a motion converges, if it settles too slowly for its record.

Near a bifurcation motions settle ever more slowly, and a record shows no class, or another class
than that of the attractor. Newton's method (`vibroimpact.orbits.periodic`) still finds the periodic
orbit near the last section of the record. The motion is taken to converge to this orbit if the
orbit is stable, and if the motion is near it throughout the record, in the second half no farther
than in the first.
"""

from __future__ import annotations

import numpy as np

from sweeps.analysis.selection import oscillator_of
from vibroimpact.orbits.periodic import OrbitError, PeriodicOrbit, doubled, periodic_orbit
from vibroimpact.oscillator import Oscillator
from vibroimpact.points.period_class import LONGEST_PERIOD

#: Largest distance of a motion from a nearby orbit at any section, relative to the record's size.
_NEARNESS = 0.2
#: Allowance for rounding when the distances in both halves of a record are compared.
_ROUNDING = 1e-6
#: Number of periods that are tried for a record that does not repeat, but nearly does after them.
_TRIED_PERIODS = 4


def orbit_at(point: np.void, m: int, phase: float) -> PeriodicOrbit:
    """Return the orbit near a point, of dtype POINT, whose start is its state at the section.

    A state beyond the stop, which some impact rules allow, is moved to the stop. Raises OrbitError
    if no orbit is found.
    """
    oscillator = oscillator_of(point)
    x, v = point["x0"].item(), point["v0"].item()
    return periodic_orbit(oscillator, min(x, oscillator.clearance), v, m, phase)


def nearby_orbit(
    oscillator: Oscillator, record: np.ndarray, phase: float, m: int | None = None
) -> PeriodicOrbit | None:
    """Find the stable periodic orbit to which a motion converges; None if none is found.

    `record` has x and v at sections of this phase, shape (periods, 2). It repeats after m periods;
    without m, several numbers of periods after which it nearly repeats are tried.
    """
    if not np.isfinite(record).all():
        return None
    x, v = record[-1].tolist()
    for periods in _nearly_repeats(record) if m is None else [m]:
        try:
            orbit = periodic_orbit(oscillator, x, v, periods, phase)
            # The motion may still be near the unstable orbit beyond a flip.
            orbit = orbit if orbit.stable else doubled(orbit)
        except OrbitError:
            continue
        if goes_to(record, orbit.sections(phase)):
            return orbit
    return None


def goes_to(record: np.ndarray, orbit: np.ndarray) -> bool:
    """Whether a motion is near an orbit throughout its record, and does not leave it.

    Both are given by x and v at sections, with the shapes (periods, 2) and (m, 2), in time order.
    """
    size = _size(record)
    last = np.argmin((np.abs(orbit - record[-1]) / size).max(axis=1))
    beside = orbit[(last + np.arange(1 - len(record), 1)) % len(orbit)]
    apart = (np.abs(record - beside) / size).max(axis=1)
    first, second = np.array_split(apart, 2)
    return bool(apart.max() <= _NEARNESS and second.max() <= first.max() + _ROUNDING)


def _nearly_repeats(record: np.ndarray) -> list[int]:
    """Return the numbers of periods after which a record nearly repeats, in increasing order."""
    most = min(LONGEST_PERIOD, len(record) // 2)
    size = _size(record)
    apart = [(np.abs(record[-m:] - record[-2 * m : -m]) / size).max() for m in range(1, most + 1)]
    best = np.argsort(apart, kind="stable")[:_TRIED_PERIODS]
    return sorted(int(i) + 1 for i in best if apart[i] < _NEARNESS)


def _size(record: np.ndarray) -> np.ndarray:
    """Return the greatest |x| and |v| of a record, 1 where they are 0."""
    size = np.abs(record).max(axis=0)
    return np.where(size == 0.0, 1.0, size)
