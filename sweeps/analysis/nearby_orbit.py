"""The stable periodic orbit that a motion goes to, where it settles too slowly for its record.

Beside a bifurcation motions settle ever more slowly, and a record shows a class that is not the
attractor's, or none. Newton's method (`vibroimpact.orbits.periodic`) finds the periodic orbit near
the last section of the record all the same. The motion goes to that orbit if the orbit is stable,
and the motion is near it throughout the record and in the second half no farther than in the first.
"""

from __future__ import annotations

import numpy as np

from sweeps.analysis.selection import oscillator_of
from vibroimpact.orbits.periodic import OrbitError, PeriodicOrbit, doubled, periodic_orbit
from vibroimpact.oscillator import Oscillator
from vibroimpact.points.period_class import LONGEST_PERIOD

#: A motion is near an orbit if no section is off by more than this share of the record's size.
_NEARNESS = 0.2
#: A motion may be farther from its orbit in the second half of its record by this share: rounding.
_ROUNDING = 1e-6
#: So many periods are tried where the record does not repeat: those after which it nearly does.
_TRIED_PERIODS = 4


def orbit_at(point: np.void, m: int, phase: float) -> PeriodicOrbit:
    """Return the orbit near a point, of dtype POINT, whose start is its state at the section.

    An impact rule may let it pass the stop. Raises OrbitError if none is found.
    """
    oscillator = oscillator_of(point)
    x, v = point["x0"].item(), point["v0"].item()
    return periodic_orbit(oscillator, min(x, oscillator.clearance), v, m, phase)


def nearby_orbit(
    oscillator: Oscillator, record: np.ndarray, phase: float, m: int | None = None
) -> PeriodicOrbit | None:
    """Find the stable periodic orbit that a motion goes to; None if none is found.

    The record has x and v at sections of the phase, shape (periods, 2). Without m, after which it
    repeats, those are tried after which it nearly does.
    """
    if not np.isfinite(record).all():
        return None
    x, v = record[-1].tolist()
    for periods in _nearly_repeats(record) if m is None else [m]:
        try:
            orbit = periodic_orbit(oscillator, x, v, periods, phase)
            # The motion may not have left an orbit that has flipped.
            orbit = orbit if orbit.stable else doubled(orbit)
        except OrbitError:
            continue
        if goes_to(record, orbit.sections(phase)):
            return orbit
    return None


def goes_to(record: np.ndarray, orbit: np.ndarray) -> bool:
    """Whether a motion is near an orbit throughout its record, and does not leave it.

    Both are x and v at sections, shapes (periods, 2) and (m, 2), the orbit's in time order.
    """
    size = np.abs(record).max(axis=0)
    size[size == 0.0] = 1.0
    last = np.argmin((np.abs(orbit - record[-1]) / size).max(axis=1))
    beside = orbit[(last + np.arange(1 - len(record), 1)) % len(orbit)]
    apart = (np.abs(record - beside) / size).max(axis=1)
    first, second = np.array_split(apart, 2)
    return bool(apart.max() <= _NEARNESS and second.max() <= first.max() + _ROUNDING)


def _nearly_repeats(record: np.ndarray) -> list[int]:
    """Return the numbers of periods after which a record nearly repeats, in increasing order."""
    most = min(LONGEST_PERIOD, len(record) // 2)
    size = np.abs(record).max(axis=0)
    apart = [(np.abs(record[-m:] - record[-2 * m : -m]) / size).max() for m in range(1, most + 1)]
    best = np.argsort(apart, kind="stable")[:_TRIED_PERIODS]
    return sorted(int(i) + 1 for i in best if apart[i] < _NEARNESS)
