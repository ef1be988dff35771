"""The record of each point: its sums, its sections and the ring buffer of its impacts."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import inlined, jit
from vibroimpact.status import Status
from vibroimpact.step.contact import IMPACT, KIND, REST, SPEED, TIME

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
        ("growth_1", float),
        ("growth_2", float),
        ("status", np.int64),
        # Periods after which the motion came back to the same bits, 0 if it did not while it was
        # recorded; the impacts in them; and whether there is a rest.
        ("cycle", np.int64),
        ("cycle_impacts", np.int64),
        ("cycle_rests", np.int64),
        # Of the whole run, with its transient: periods that were skipped or copied, and steps that
        # were followed alone.
        ("skipped", np.int64),
        ("alone", np.int64),
    ]
)

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
    sums.growth_1 = sums.growth_2 = 0.0
    sums.cycle = sums.cycle_impacts = 0


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
