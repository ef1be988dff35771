"""The record of each point over its recorded periods."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import inlined
from vibroimpact.status import Status
from vibroimpact.step.contact import IMPACT, KIND, REST, SPEED, TIME

#: The sums and extremes over the recorded periods of a point, and its worst status.
SUMS = np.dtype(
    [
        ("impacts", np.int64),
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
    sums: np.ndarray  #: Of dtype ``SUMS``, shape (n,).


@inlined
def list_impact(ring, sums, phase, speed):
    """Count an impact, and write it into the ring buffer of its lane."""
    if ring.shape[0] > 0:
        slot = sums.impacts % ring.shape[0]
        # Two subtractions are enough. A `while` would never end for an infinite phase.
        for _ in range(2):
            phase -= 2.0 * math.pi if phase >= 2.0 * math.pi else 0.0
        ring[slot, 0], ring[slot, 1] = phase, speed
    sums.slowest_impact = min(sums.slowest_impact, speed)
    sums.fastest_impact = max(sums.fastest_impact, speed)
    sums.speeds += speed
    sums.squared_speeds += speed * speed
    sums.impacts += 1


@inlined
def record_step(events, n, rested, theta, pt, row, record):
    """Add the events of one step to the record of the lane in that row."""
    sums = record.sums[row]
    for k in range(n):
        kind = events[k, KIND]
        if kind == IMPACT:
            speed = events[k, SPEED]
            list_impact(record.impacts[row], sums, theta + pt.omega * events[k, TIME], speed)
        elif kind == REST:  # the speeds of the summed impacts are a geometric series
            sums.chatters += 1
            speeds = events[k, SPEED]
            sums.speeds += speeds
            sums.squared_speeds += speeds * speeds * (1.0 - pt.R) / (1.0 + pt.R)
    sums.rested += rested


@inlined
def record_section(x, v, row, k, record):
    """Store the state of a point as section `k`, or NaN if it overflowed."""
    finite = math.isfinite(x) and math.isfinite(v)
    record.sections[row, k, 0] = x if finite else math.nan
    record.sections[row, k, 1] = v if finite else math.nan
    if not finite and record.sums[row].status < _UNRESOLVED:
        record.sums[row].status = _NON_FINITE


@inlined
def rows_of(record, lo, hi):
    """Return the rows from `lo` to before `hi` of a record."""
    return Record(record.sections[lo:hi], record.impacts[lo:hi], record.sums[lo:hi])
