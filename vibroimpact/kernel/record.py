"""`Record` of each point: sums, sections, ring of impacts; results, as of unbounded motions.

**Motions that grow without bound**: resonance without dissipation, R = 1 and h = 0. A flight at a
great speed v lasts pi / p, so the force is in resonance if omega = 2 k p for an integer k. To the
first order in f / (p v), an impact at the phase phi and the next one differ by

    dv = C cos(phi),    dphi = omega (2 clearance - B sin(phi)) / v,

with C = 4 k f / (p (4 k^2 - 1)) and B = C / (2 k p). If 2 |clearance| < B, the phase goes to where
dphi = 0 and cos(phi) > 0, and the speed grows by C cos(phi) at every impact, for ever. Otherwise,
and off the resonance, the phase passes through all values, and the speed stays bounded.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import inlined, jit
from vibroimpact.status import Status
from vibroimpact.step.contact import IMPACT, KIND, REST, SPEED, TIME, impulse_and_loss
from vibroimpact.step.polynomial import SMALLEST_NORMAL

#: The sums and extremes over the recorded periods of a point, and its worst status.
SUMS = np.dtype(
    [
        ("impacts", np.int64),
        ("listed", np.int64),  # impacts put into the ring buffer
        ("slowest_impact", float),
        ("fastest_impact", float),
        ("speeds", float),  # sum of the speeds before the impacts; below, of their squares
        ("squared_speeds", float),
        ("max_penetration", float),
        ("rested", float),
        ("chatters", np.int64),
        ("near_grazes", np.int64),
        # Logarithms of the growth of a tangent vector, and of an area by the impacts.
        ("growth", float),
        ("area", float),
        ("status", np.int64),
        # Periods after which the motion came back to the same bits, 0 if it did not while it was
        # recorded; the impacts in them; whether there is a rest; and the time at rest.
        ("cycle", np.int64),
        ("cycle_impacts", np.int64),
        ("cycle_rests", np.int64),
        ("cycle_rested", float),
        # Of the whole run, with its transient: periods that were skipped or copied, and steps that
        # were followed alone.
        ("skipped", np.int64),
        ("alone", np.int64),
    ]
)

#: The least and the greatest displacement of a record.
EXTREMES = "x_min", "x_max"
#: Significant digits that the motion of a certified point keeps at the sections: half of all.
_FEWEST_DIGITS = 8
#: Least size of a forced motion of which no step becomes subnormal.
_SMALLEST = 1e-300
#: The share of time at rest of a mass that is always held may be less than 1 by so much: each of up
#: to 1e6 steps, and the length of the record, is rounded.
_HELD = 1e-9
#: Rounding of omega / (2 p), for parameters that come from a computation.
_ROUNDING_OF_RATIO = 1e-12
#: A motion grows if its speed does so at least at this share of the rate of the resonance. One that
#: is not in step with the force has less, or falls again.
_SHARE = 0.5
#: Fewest sections in a third of a record that is judged: the extremes of fewer rise by chance.
_FEWEST = 10

_UNRESOLVED, _NON_FINITE = int(Status.UNRESOLVED), int(Status.NON_FINITE)


class Record(NamedTuple):
    """The record of all points, one row per point."""

    #: x and v at the end of each period, shape (n, periods, 2).
    sections: np.ndarray
    #: Phase and speed of the last impacts, shape (n, capacity, 2): a ring buffer, put into time
    #: order at the end.
    impacts: np.ndarray
    begun: np.ndarray  #: x and v where the record begins after a transient, shape (n, 2).
    sums: np.ndarray  #: Of dtype ``SUMS``, shape (n,).
    extremes: np.ndarray  #: The least and the greatest x, shape (n, 2); (n, 0) if not asked for.


@inlined
def list_impact(ring, sums, phase, speed):
    """Count an impact, and write it into the ring buffer of its lane."""
    if ring.shape[0] > 0:
        slot = sums.listed % ring.shape[0]
        # Two subtractions are enough. A `while` would never end for an infinite phase.
        for _ in range(2):
            phase -= 2.0 * math.pi if phase >= 2.0 * math.pi else 0.0
        ring[slot, 0], ring[slot, 1] = phase, speed
        sums.listed += 1
    sums.slowest_impact = min(sums.slowest_impact, speed)
    sums.fastest_impact = max(sums.fastest_impact, speed)
    sums.speeds += speed
    sums.squared_speeds += speed * speed
    sums.impacts += 1


@inlined
def record_step(events, n, rested, theta, pt, ring, sums):
    """Add the events of one step to the record of a lane."""
    for k in range(n):
        kind = events[k, KIND]
        if kind == IMPACT:
            list_impact(ring, sums, theta + pt.omega * events[k, TIME], events[k, SPEED])
        elif kind == REST:  # the speeds of the summed impacts are a geometric series
            sums.chatters += 1
            speeds = events[k, SPEED]
            sums.speeds += speeds
            sums.squared_speeds += speeds * speeds * (1.0 - pt.R) / (1.0 + pt.R)
    sums.rested += rested


@inlined
def record_section(x, v, sections, k, sums):
    """Store the state of a point as section `k`, or NaN if it overflowed."""
    finite = math.isfinite(x) and math.isfinite(v)
    sections[k, 0] = x if finite else math.nan
    sections[k, 1] = v if finite else math.nan
    if not finite and sums.status < _UNRESOLVED:
        sums.status = _NON_FINITE


@inlined
def begin_sums(sums):
    """Set the sums to those of an empty record; the status stays."""
    sums.impacts = sums.listed = sums.chatters = sums.near_grazes = 0
    sums.slowest_impact, sums.fastest_impact = math.inf, 0.0
    sums.speeds = sums.squared_speeds = sums.max_penetration = sums.rested = 0.0
    sums.growth = sums.area = sums.cycle_rested = 0.0
    sums.cycle = sums.cycle_impacts = sums.cycle_rests = 0


@inlined
def _with_repetitions(total, before, times):
    """Return a sum to which what came since `before` is added again; one that overflowed stays."""
    return total + times * (total - before) if total < math.inf else total


@inlined
def add_cycles(sums, before, times):
    """Add the sums since `before` to the sums so many times again."""
    sums.impacts += times * (sums.impacts - before.impacts)
    sums.speeds = _with_repetitions(sums.speeds, before.speeds, times)
    sums.squared_speeds = _with_repetitions(sums.squared_speeds, before.squared_speeds, times)
    sums.rested = _with_repetitions(sums.rested, before.rested, times)
    sums.chatters += times * (sums.chatters - before.chatters)
    sums.near_grazes += times * (sums.near_grazes - before.near_grazes)


@inlined
def repeat_impacts(ring, sums, count, times):
    """List the last `count` impacts so many times again, as far as the ring buffer shows it."""
    size = ring.shape[0]
    if 0 < count <= size:  # else the ring buffer already holds what it will hold then
        end = sums.listed + count * min(times, -(-size // count))
        for n in range(sums.listed, end):
            ring[n % size, 0], ring[n % size, 1] = (
                ring[(n - count) % size, 0],
                ring[(n - count) % size, 1],
            )
        sums.listed = end


@inlined
def _reverse(ring, lo, hi):
    """Reverse the rows of a ring buffer from `lo` to before `hi`."""
    for k in range((hi - lo) // 2):
        a, b = lo + k, hi - 1 - k
        for q in range(2):
            ring[a, q], ring[b, q] = ring[b, q], ring[a, q]


@jit
def put_in_order(ring, listed):
    """Put a ring buffer that received `listed` impacts into time order, with NaN in unused rows."""
    size = ring.shape[0]
    for k in range(listed, size):
        ring[k, 0] = ring[k, 1] = math.nan
    if listed > size:  # a rotation is three reversals
        first = listed % size
        _reverse(ring, 0, first)
        _reverse(ring, first, size)
        _reverse(ring, 0, size)


def named_results(points: np.ndarray, record: Record) -> dict[str, np.ndarray]:
    """Name the results, and replace those of failed or interrupted points by NaN or 0."""
    sums, sections, periods = record.sums, record.sections, record.sections.shape[1]
    pending = sums["status"] == Status.PENDING
    if pending.any():
        for array in (sections, record.impacts, record.begun):
            array[pending] = np.nan
    sums["status"][_grows(points, sums["impacts"], sections) & ~pending] = Status.UNBOUNDED
    no_impact, R = sums["impacts"] == 0, points["R"]
    impulse, lost = impulse_and_loss(R, sums["speeds"], sums["squared_speeds"])
    # The period may overflow if omega is below the smallest normal number.
    with np.errstate(over="ignore", invalid="ignore"):
        duration = periods * 2.0 * np.pi / points["omega"]
        share = np.minimum(sums["rested"] / duration, 1.0)
    numbers = {
        "impacts_per_period": sums["impacts"] / periods,
        "slowest_impact": np.where(no_impact, np.nan, sums["slowest_impact"]),
        "fastest_impact": np.where(no_impact, np.nan, sums["fastest_impact"]),
        "impulse": impulse / periods,
        "energy_lost": lost / periods,
        "max_penetration": sums["max_penetration"],
        "rest_fraction": share,
    }
    always_finite = ("impulse", "energy_lost", "max_penetration", "rest_fraction")
    finite = np.logical_and.reduce([np.isfinite(numbers[name]) for name in always_finite])
    sums["status"][~finite & ~pending & (sums["status"] < Status.UNRESOLVED)] = Status.NON_FINITE
    failed = (sums["status"] >= Status.UNRESOLVED) | pending
    return {
        "poincare_x": sections[:, :, 0],
        "poincare_v": sections[:, :, 1],
        "impact_phase": record.impacts[:, :, 0],
        "impact_v": record.impacts[:, :, 1],
        **{name: np.where(failed, np.nan, values) for name, values in numbers.items()},
        "chatters": np.where(failed, 0, sums["chatters"]),
        "near_grazes": np.where(failed, 0, sums["near_grazes"]),
        "lyapunov": np.where(failed[:, None], np.nan, _exponents(points, sums, duration)),
        **{
            name: np.where(failed, np.nan, values)
            for name, values in zip(EXTREMES, record.extremes.T, strict=False)
        },
        "status": sums["status"].astype(np.int8),
        "begun": record.begun,
    }


def _exponents(points: np.ndarray, sums: np.ndarray, duration: np.ndarray) -> np.ndarray:
    """Return both Lyapunov exponents, (n, 2), the larger first, by their known sum."""
    with np.errstate(all="ignore"):  # infinite durations
        one = sums["growth"] / duration
        other = np.where(one == -np.inf, one, sums["area"] / duration - 2.0 * points["h"] - one)
    return np.stack([np.maximum(one, other), np.minimum(one, other)], axis=1)


def _grows(points: np.ndarray, impacts: np.ndarray, sections: np.ndarray) -> np.ndarray:
    """Whether each motion grew through its record as an unbounded motion does.

    `impacts` is their number, and `sections` has the shape (n, periods, 2). In each third of the
    record the smallest section and the largest one must exceed those of the third before by
    ``_SHARE`` of the growth of the resonance.
    """
    p, f, stop = points["p"], points["f"], points["clearance"]
    with np.errstate(all="ignore"):  # extreme values, whose rate is then NaN or 0
        ratio = points["omega"] / (2.0 * p)
        k = np.rint(ratio)
        resonant = (k >= 1.0) & (np.abs(ratio - k) <= _ROUNDING_OF_RATIO * k)
        sine = p * p * stop * (4.0 * k * k - 1.0) / f
        # The growth of the speed in a forcing period; from impact to impact there are k.
        rate = 4.0 * f / (p * (4.0 * k * k - 1.0)) * np.sqrt(1.0 - sine * sine)
    lossless = (points["R"] == 1.0) & (points["h"] == 0.0)
    rows = np.flatnonzero(lossless & resonant & (rate > 0.0) & (impacts > 0))
    third = sections.shape[1] // 3
    found = np.zeros(points.size, dtype=bool)
    if third >= _FEWEST and rows.size > 0:
        x, v = sections[rows, -3 * third :, 0], sections[rows, -3 * third :, 1]
        thirds = np.hypot(p[rows, None] * x, v).reshape(rows.size, 3, third)
        extremes = np.stack([thirds.min(axis=2), thirds.max(axis=2)])
        least = _SHARE * third * rate[rows, None]
        found[rows] = (np.diff(extremes, axis=2) > least).all(axis=(0, 2))
    return found


def loses_digits(points: np.ndarray, x: np.ndarray, rest_fraction: np.ndarray) -> np.ndarray:
    """Whether motions have fewer than ``_FEWEST_DIGITS`` at their sections `x`, (n, periods).

    There x - clearance is rounded, which is coarse for a small motion if the stop is far from the
    rest position. The size of a motion is the larger one of

    - its greatest distance from the rest position or, if it is less, from the stop; without a
      force, from the stop, since it ends at rest;
    - f / (omega^2 + 2 h omega + p^2), which no free oscillation is below. A force that exceeds a
      preload by a small share e of f lifts the mass from a rest by 9/2 e^2 f / omega^2; one that is
      less only delays its landing.

    A mass that is held all the time, or without a force at every section, keeps its digits. None
    has any where omega^2, of which the steps are made, overflows or is subnormal.
    """
    h, omega, f, p, stop = (points[name] for name in ("h", "omega", "f", "p", "clearance"))
    with np.errstate(all="ignore"):  # extreme values, whose size is then 0, inf or NaN
        # The least size that keeps digits.
        least = 0.5 * np.spacing(np.abs(stop)) * 10.0**_FEWEST_DIGITS
        least = np.maximum(least, np.where(f > 0.0, _SMALLEST, 0.0))  # a free decay ends at rest
        lift = np.minimum(np.abs(f + p * p * np.minimum(stop, 0.0)), f)
        share = np.minimum(4.5 * lift / np.maximum(f, SMALLEST_NORMAL), 1.0)
        square = omega * omega
        forced = lift * share / (square + 2.0 * h * omega + p * p)
    lost: np.ndarray = (forced < least) & (rest_fraction < 1.0 - _HELD)
    rows = np.flatnonzero(lost)
    size = np.abs(x[rows] - stop[rows, None])
    size = np.where(f[rows, None] > 0.0, np.minimum(size, np.abs(x[rows])), size).max(axis=1)
    lost[rows] = (size < least[rows]) & ((f[rows] > 0.0) | (size > 0.0))
    return lost | (square < SMALLEST_NORMAL) | (square == math.inf)
