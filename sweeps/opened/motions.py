"""A row per motion: regime, class, point; finds its orbit, continues it, compares `Cycles`.

Orbits are compared as cycles. A cycle consists of the states of a motion at m passages of the
section, in time order. It may begin at any of the m states, because a motion of m forcing periods
can be reached at m phases. The distance of two cycles compares the states at matching places, for
the best rotation of one against the other. So states that nearly agree in one coordinate cannot be
confused.

If the phase of an impact passes the phase of the section along an axis, the state at the section
jumps from before the impact to after it, although the motion changes continuously. Therefore a
state just before an impact counts as near a state just after it: their distance is the distance of
both from the impact (Biemond, van de Wouw, Heemels & Nijmeijer 2013, IEEE Trans. Autom. Control 58,
876-890).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import reduce
from itertools import product

import numpy as np

from sweeps.errors import Refused
from vibroimpact.orbits.branches import SpecialPoint, branch
from vibroimpact.orbits.periodic import MOST_IMPACTS, OrbitError, PeriodicOrbit, periodic_orbit
from vibroimpact.oscillator import POINT, oscillator_of
from vibroimpact.points.computation import classified_later, compute_points
from vibroimpact.points.regimes import Regime, regimes_of, repetitions
from vibroimpact.points.stages import RunSpec
from vibroimpact.step.scheme import MOST_RECORDED

#: Cycles closer than this, relative to their greatest coordinate, are the same motion.
ORBIT_TOLERANCE = 1e-3
#: Number of values compared at a time, so that they stay in the cache.
_VALUES_AT_ONCE = 25_000


#: The motion of a point. The start of its `point` is the state of its orbit at the last section,
#: NaN without one. m and q are the forcing periods and impacts per repetition, as `repetitions`.
MOTION = np.dtype([("point", POINT), ("regime", np.int64), ("m", np.int64), ("q", np.int64)])


def motions_from(
    spec: RunSpec, points: np.ndarray, results: Mapping[str, np.ndarray]
) -> np.ndarray:
    """Return the motions of points, of dtype ``MOTION``, shape (n,), given the results of a run."""
    if "period" not in results:
        results = classified_later(spec, points, results)
    motions = np.empty(len(points), MOTION)
    motions["point"] = points
    motions["point"]["x0"], motions["point"]["v0"] = results["orbit_x"], results["orbit_v"]
    motions["point"]["phase"] = spec.phase
    regimes = regimes_of(results, points["omega"], spec.periods)
    m, q = repetitions(regimes, results["period"], results["period_impacts"])
    motions["regime"], motions["m"], motions["q"] = regimes, m, q
    states = np.where(regimes == Regime.PERIODIC, [results["orbit_x"], results["orbit_v"]], 0.0)
    within = (m >= 0) & (m <= MOST_IMPACTS) & (q >= 0) & (q <= MOST_RECORDED)
    if not (within & np.isfinite(states)).all():  # another program made the file
        raise Refused("a point has an orbit that is no motion of this program: run the sweep again")
    return motions


def run_on(
    spec: RunSpec, points: np.ndarray, periods: int, impacts: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Continue motions from their states at the section, with the method of a sweep.

    Returns the states at the next sections, shape (n, periods, 2), and the phases and speeds of the
    last impacts, shape (n, impacts, 2).
    """
    spec = replace(spec.stage(0, periods, impacts, False), period=False)
    points = points.copy()
    points["phase"] = spec.phase
    results = compute_points(spec, points, None)
    pairs = ("poincare_x", "poincare_v"), ("impact_phase", "impact_v")
    sections, hits = (np.stack([results[name] for name in pair], axis=2) for pair in pairs)
    return sections, hits


@dataclass(frozen=True)
class Cycles:
    """Periodic motions, each with its states at the section in a repetition."""

    #: x - clearance and v in the same unit, for example v / omega. Tolerances are thus relative to
    #: the distance from the stop, wherever the stop is. Shape (n, greatest m, 2); NaN beyond m.
    states: np.ndarray
    m: np.ndarray  # forcing periods; int, shape (n,)
    R: np.ndarray  # coefficient of restitution; shape (n,)


def section_distance(
    states: np.ndarray,
    states_0: np.ndarray,
    clearance: np.ndarray | float,
    R: np.ndarray | float,
    scale: np.ndarray | tuple[float, float] = (1.0, 1.0),
) -> np.ndarray:
    """Return the distance of states at a section, directly or through an impact, if that is less.

    States are x and v, shape (..., 2), and `scale` gives their units. The clearance and R are
    broadcast against x. The distance is the larger of the distances in x and in v, in these units.
    """
    (x, v), (x_0, v_0) = np.moveaxis(states, -1, 0), np.moveaxis(states_0, -1, 0)
    X, V = np.moveaxis(np.asarray(scale), -1, 0)
    direct = np.maximum(np.abs(x - x_0) / X, np.abs(v - v_0) / V)
    to_stop = np.maximum(np.abs(x - clearance), np.abs(x_0 - clearance)) / X
    rebound = np.abs(np.minimum(v, v_0) + R * np.maximum(v, v_0)) / V
    return np.minimum(direct, np.maximum(to_stop, rebound))


def distances(cycles: Cycles, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the distances of pairs of cycles, given their indices `a` and `b`, shape (n,).

    A cycle of 2 m periods is compared with two turns of one of m periods; cycles of other different
    periods are infinitely far apart. The distance is the largest difference of a coordinate, for
    the rotation that makes it least, divided by the greatest absolute coordinate of both cycles.
    """
    m = cycles.m
    a, b = np.where(m[a] > m[b], b, a), np.where(m[a] > m[b], a, b)
    result = np.full(len(a), np.inf)
    for periods, turns in product(np.unique(m[a]).tolist(), (1, 2)):
        rows = np.flatnonzero((m[a] == periods) & (m[b] == turns * periods))
        size = max(1, _VALUES_AT_ONCE // (turns * periods))
        for chunk in (rows[start : start + size] for start in range(0, rows.size, size)):
            first = np.tile(cycles.states[a[chunk], :periods], (1, turns, 1))
            second, R = cycles.states[b[chunk], : turns * periods], cycles.R[b[chunk], None]
            turned = (np.roll(first, turn, axis=1) for turn in range(periods))
            apart = [section_distance(cycle, second, 0.0, R) for cycle in turned]
            both = np.concatenate([first, second], axis=1).reshape(len(chunk), -1)
            # Column by column: many short rows have their maxima sooner than by `max`.
            *far, greatest = (reduce(np.maximum, cycle.T) for cycle in (*apart, np.abs(both)))
            result[chunk] = reduce(np.minimum, far) / np.where(greatest > 0.0, greatest, 1.0)
    return result


def cycles_of(spec: RunSpec, motions: np.ndarray) -> Cycles:
    """Return the orbits of periodic motions as cycles of states at the section."""
    points, m = motions["point"], motions["m"]
    states = np.full((len(m), m.max(initial=1), 2), np.nan)
    states[:, 0, 0], states[:, 0, 1] = points["x0"], points["v0"]
    for periods in np.unique(m[m > 1]).tolist():
        rows = np.flatnonzero(m == periods)
        states[rows, 1:periods] = run_on(spec, points[rows], periods - 1)[0]
    states[..., 0] -= points["clearance"][:, None]
    states[..., 1] /= points["omega"][:, None]
    return Cycles(states, m, points["R"])


def orbit_at(motion: np.void, phase: float) -> PeriodicOrbit:
    """Return the orbit near a periodic motion, whose section is at `phase`.

    A state beyond the stop, which some impact rules allow, is moved to the stop. Raises OrbitError
    if no orbit is found.
    """
    oscillator = oscillator_of(motion["point"])
    x, v = motion["point"]["x0"].item(), motion["point"]["v0"].item()
    return periodic_orbit(oscillator, min(x, oscillator.clearance), v, int(motion["m"]), phase)


def orbit_of_motion(motion: np.void, phase: float) -> PeriodicOrbit:
    """Return the orbit of a periodic motion as `orbit_at`; OrbitError if its class is another."""
    orbit = orbit_at(motion, phase)
    if (orbit.m, orbit.q) != (motion["m"], motion["q"]):
        raise OrbitError("a motion is not near its orbit: the orbit there is of another class")
    return orbit


def first_special_point(orbit: PeriodicOrbit, parameter: str, value: float) -> SpecialPoint:
    """Return the first special point on the branch of an orbit towards a value of a parameter."""
    start = float(getattr(orbit.oscillator, parameter))
    special = branch(orbit, parameter, *sorted((start, value))).special
    # The branch begins at an end of the range, so it continues in one direction only.
    return special[1] if start < value else special[-2]


def same_orbit(first: PeriodicOrbit, second: PeriodicOrbit, phase: float) -> bool:
    """Whether two orbits of one oscillator have the same class and, within tolerance, states."""
    if (first.m, first.q) != (second.m, second.q):
        return False
    o = first.oscillator
    states = np.stack([orbit.sections(phase) for orbit in (first, second)]) - [o.clearance, 0.0]
    cycles = Cycles(states / [1.0, o.omega], np.full(2, first.m), np.full(2, o.R))
    return bool(distances(cycles, np.array([0]), np.array([1]))[0] <= ORBIT_TOLERANCE)
