"""Judges where each motion goes: first by its record, then by passages (`Memory`).

With exact impacts, the first of these that applies decides:

1. The motion has no impact any more: ``FREE``, which is a proof.
2. The motion came back to the same bits while it was recorded: ``REPEATS``. The computed motion is
   then periodic for ever.
3. The record repeats, with a rest or without any dissipation: ``REPEATS``. A rest erases the past,
   so such a motion repeats exactly; without dissipation no motion approaches another.
4. The record repeats, and the last section is on an orbit whose multipliers are clearly inside the
   unit circle: ``REPEATS``.
5. Newton's method finds a periodic orbit near the last section, the orbit is stable, and the motion
   shows that it goes there: ``CAPTURED`` or ``FALLING``. The orbit has impacts, and no rest.

An orbit whose multipliers say that it is unstable is no class: rounding alone kept the motion on
it. Nor is a repetition with rest of which rounding decides the length, see ``repetition.py``. A
rest counts only if the motion rests again in the next repetition; one at the start of the record
does not.

With another impact rule, a record that repeats is all the other evidence, to the same bits or
nearly.

``RELEASED`` takes the place of ``REPEATS`` where the mass rested in the record, but not in the
repetition.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.destination.free_motion import excess, free_multiplier, stays_free
from vibroimpact.destination.nearby_orbit import (
    GREATEST_STABLE,
    Orbit,
    correction,
    distance,
    doubled,
    evidence,
    greatest_multiplier,
    nearby_orbit,
)
from vibroimpact.destination.repetition import (
    MOST_REPETITIONS,
    TOLERANCE,
    last_return,
    near_repetitions,
    repetition,
    repetition_of_cycle,
    rests_alike,
    rests_alike_exactly,
    size_of,
)
from vibroimpact.destination.section_map import (
    Flow,
    derivative_over,
    follow,
    replay,
    section_state,
)
from vibroimpact.jit import inlined, jit
from vibroimpact.status import Evidence, Status
from vibroimpact.step.contact import Scratch
from vibroimpact.step.propagator import from_dimensionless, steady_response
from vibroimpact.step.scheme import COS, SIN, Scheme
from vibroimpact.step.stepper import prepare_exact

#: Where the motion of a point goes. Without a class, m and q are 0 and the other numbers NaN,
#: except that ``UNREACHED`` has those of the stable orbit near by.
DESTINATION = np.dtype(
    [
        ("m", np.int64),
        ("q", np.int64),  # -1: not counted yet, of other rules than exact
        ("x", float),  # state of the orbit at the last section of the record
        ("v", float),
        # Greatest |multiplier|, at the last section if a record repeats; NaN where it is not known.
        ("multiplier", float),
        ("distance", float),  # from the orbit at the last section, in units of the record's size
        ("evidence", np.int64),
    ]
)
#: The destination of a point before it is found.
NO_DESTINATION = np.array((0, 0, np.nan, np.nan, np.nan, np.nan, 0), DESTINATION)

_UNSTABLE, _UNREACHED = int(Evidence.UNSTABLE), int(Evidence.UNREACHED)
_UNRESOLVED = int(Status.UNRESOLVED)
_REPEATS, _FREE, _RELEASED = int(Evidence.REPEATS), int(Evidence.FREE), int(Evidence.RELEASED)

#: A multiplier below this shows without a proof of its own that a record is on a stable orbit, and
#: one above the second number that the orbit is unstable, rounding included.
_CLEARLY_STABLE, _CLEARLY_UNSTABLE = 1.0 - 1e-4, 1.0 + 1e-6
#: A size below this share of the clearance has lost four of its digits; some roundings of it.
_COARSE, _ROUNDINGS = 1e-4, 1e-15
# Kinds of records: without impact, with impacts, with rests.
_NO_IMPACT, _IMPACTS, _RESTS = range(3)


class Memory(NamedTuple):
    """The memory in which destinations are found; one per thread."""

    scratch: Scratch
    passed: np.ndarray  #: That of a ``Flow``.
    tried: np.ndarray  #: Receives the ``near_repetitions`` of a record, shape (MOST_REPETITIONS,).
    beside: np.ndarray  #: Receives a point beside another, shape (1,).


class Motion(NamedTuple):
    """The motion of one point: its record, and what it takes to follow it further."""

    pt: np.void
    sections: np.ndarray  #: x and v, shape (periods, 2).
    sums: np.void  #: Of dtype ``SUMS``.
    scheme: Scheme
    memory: Memory


@inlined
def is_resolved(sums):
    """Whether a record has a result, given its sums."""
    return 0 <= sums.status < _UNRESOLVED


@inlined
def kind_of(sums):
    """Return the kind of a record that has a result, given its sums."""
    if sums.rested > 0.0 or sums.chatters > 0:
        return _RESTS
    return _IMPACTS if sums.impacts > 0 else _NO_IMPACT


@inlined
def put(destination, proof, m, q, x, v, multiplier, off):
    """Write a destination."""
    destination.m, destination.q, destination.x, destination.v = m, q, x, v
    destination.multiplier, destination.distance, destination.evidence = multiplier, off, proof


@jit
def put_repetition(destination, proof, sections, m, q, multiplier, off):
    """Write that a record repeats after m periods."""
    x, v = sections[sections.shape[0] - 1, 0], sections[sections.shape[0] - 1, 1]
    put(destination, proof, m, q, x, v, multiplier, off)


@jit
def judge(flow, y, w, m, size, destination):
    """Judge the orbit of m periods near a motion; return whether the motion goes there.

    To the free oscillation goes only a motion of which that is proved.
    """
    orbit = nearby_orbit(flow, y, w, m, size)
    if orbit.m == 0:
        return False
    if not greatest_multiplier(orbit.J)[0] < GREATEST_STABLE:
        destination.evidence = max(destination.evidence, _UNSTABLE)
        orbit = nearer_section(flow, doubled(flow, orbit, size), y, w, size)
        if orbit.m == 0:
            return False
    proof = evidence(flow, orbit, y, w, size) if orbit.q > 0 else _UNREACHED
    if proof > destination.evidence:
        off, pt = distance(y, w, orbit, size), flow.pt
        x, v = from_dimensionless(orbit.y, orbit.w, pt.clearance, pt.omega)
        put(destination, proof, orbit.m, orbit.q, x, v, greatest_multiplier(orbit.J)[0], off)
    return proof > _UNREACHED


@jit
def nearer_section(flow, orbit, y, w, size):
    """Return a doubled orbit from that of its two sections which is nearer to a state."""
    if orbit.m == 0:
        return orbit
    end = follow(flow, orbit.y, orbit.w, orbit.m // 2, False)
    other = Orbit(orbit.m, orbit.q, end.y, end.w, orbit.J)
    if distance(y, w, orbit, size) <= distance(y, w, other, size):
        return orbit
    J = correction(flow, end.y, end.w, orbit.m, size)[2]
    return Orbit(orbit.m, orbit.q, end.y, end.w, J)


@jit
def judge_cycle(motion, destination):
    """Judge a motion that came back to the same bits by its record alone; return whether that does.

    Its multiplier is NaN: it is not computed, not even 0 after a rest or 1 without dissipation.
    """
    pt, sections, sums = motion.pt, motion.sections, motion.sums
    m = repetition_of_cycle(sections, sums.cycle, pt)
    rests = kind_of(sums) == _RESTS
    sure = sums.cycle_rests if rests else not stayed(sections, pt)
    if m == 0 or not sure or is_coarse(sections, pt):
        return False
    if rests and not rests_alike_exactly(motion, m):
        destination.evidence = _UNSTABLE
        return True
    q = sums.cycle_impacts * m // sums.cycle
    put_repetition(destination, _REPEATS, sections, m, q, math.nan, 0.0)
    return True


@inlined
def stayed(sections, pt):
    """Whether a motion is where it started, to ``TOLERANCE``: maybe on an unstable orbit."""
    last, rate = sections.shape[0] - 1, max(pt.omega, pt.p)
    x, v = sections[last, 0], sections[last, 1]
    size = max(abs(x - pt.clearance), abs(v) / rate)
    return max(abs(x - pt.x0), abs(v - pt.v0) / rate) <= TOLERANCE * size


@inlined
def is_coarse(sections, pt):
    """Whether a displacement has few digits for the motion at the stop, which is far away."""
    last, stop = sections.shape[0] - 1, pt.clearance
    y, v = abs(sections[last, 0] - stop), abs(sections[last, 1])
    size = max(max(y, v / max(pt.omega, pt.p)), pt.f / (pt.omega * pt.omega + pt.p * pt.p))
    return size <= _COARSE * abs(stop)


@jit
def is_replayed(flow, y, w, m, size):
    """Whether a motion repeats after m periods also if it is not rounded at the sections."""
    end_y, end_w, _, _ = replay(flow, y, w, m, False)
    tolerance = TOLERANCE + _ROUNDINGS * abs(flow.pt.clearance) / size[0]
    return max(abs(end_y - y) / size[0], abs(end_w - w) / size[1]) <= tolerance


@inlined
def is_neutral(pt, kind):
    """Whether a motion is without any dissipation."""
    return pt.h == 0.0 and (pt.R == 1.0 or kind == _NO_IMPACT)


@jit
def judge_exact_repetition(flow, motion, m, off, size, destination):
    """Judge a motion that repeats exactly after m periods: it is neutral, rests, or came back.

    It came back to the same bits if it is `off` by nothing.
    """
    pt, sections, sums = motion.pt, motion.sections, motion.sums
    kind = kind_of(sums)
    neutral = is_neutral(pt, kind)
    y, w = section_state(pt, sections, sections.shape[0] - 1)
    J, smooth = (0.0, 0.0, 0.0, 0.0), False  # as after a rest
    if not sums.cycle_rests:
        J, smooth = derivative_over(flow, sections, m)
    if smooth:
        stable = greatest_multiplier(J)[0] <= _CLEARLY_UNSTABLE
    else:
        if is_coarse(sections, pt) and not is_replayed(flow, y, w, m, size):
            return
        stable = neutral or rests_alike_exactly(motion, m)
    if not stable:
        destination.evidence = _UNSTABLE
        return
    released = smooth and kind == _RESTS
    if released and judge(flow, y, w, m, size, destination):
        return
    if off == 0.0:
        q, proof = sums.cycle_impacts * m // sums.cycle, _RELEASED if released else _REPEATS
        put_repetition(destination, proof, sections, m, q, math.nan, off)
    elif neutral or not smooth:
        q = replay(flow, y, w, m, True)[2]
        multiplier = 1.0 if neutral else 0.0
        put_repetition(destination, _REPEATS, sections, m, q, multiplier, off)


@jit
def judge_repetition(flow, sections, m, size, destination):
    """Judge a dissipative motion whose record repeats after m periods, without rests."""
    y, w = section_state(flow.pt, sections, sections.shape[0] - 1)
    dy, dw, J, q = correction(flow, y, w, m, size)
    greatest, _ = greatest_multiplier(J)
    off = max(abs(dy), abs(dw))
    if q > 0 and greatest < _CLEARLY_STABLE and off <= TOLERANCE:
        put_repetition(destination, _REPEATS, sections, m, q, greatest, off)
    else:
        judge(flow, y, w, m, size, destination)


@jit
def find_exact(motion, destination):
    """Find the destination of one motion with exact impacts."""
    pt, sections, sums, scheme, memory = motion
    kind, grid = kind_of(sums), scheme.grid
    last = sections.shape[0] - 1
    x, v = sections[last, 0], sections[last, 1]
    steady = steady_response(pt, grid.table[SIN, 0], grid.table[COS, 0])
    bounded = pt.h > 0.0 and steady[2] < pt.clearance
    free = bounded and excess(pt, x, v, steady) < 0.0
    if not free and judge_cycle(motion, destination):
        return
    size = size_of(sections, pt, False)
    eq, propagators = prepare_exact(grid, pt, memory.scratch)
    flow = Flow(pt, eq, propagators, grid, memory.scratch, memory.passed)
    if bounded and stays_free(flow, x, v, steady):
        off = max(abs(x - steady[0]) / size[0], abs(v - steady[1]) / size[1])
        put(destination, _FREE, 1, 0, steady[0], steady[1], free_multiplier(pt), off)
        return
    near_repetitions(sections, size, memory.tried)
    cycle = sums.cycle if sums.cycle > 0 else last_return(sections)
    y, w = section_state(pt, sections, last)
    if cycle > sums.cycle:
        sums.cycle = cycle
        _, _, sums.cycle_impacts, sums.cycle_rests = replay(flow, y, w, cycle, True)
    m, off = repetition_of_cycle(sections, sums.cycle, pt), 0.0
    if m == 0:
        m, off = repetition(sections, size)
    units = size[0], size[1] / pt.omega
    neutral = is_neutral(pt, kind)
    if m > 0 and (off == 0.0 or kind == _RESTS or neutral):
        judge_exact_repetition(flow, motion, m, off, units, destination)
    elif m > 0:
        judge_repetition(flow, sections, m, units, destination)
    elif not neutral:
        for k in range(MOST_REPETITIONS):
            m = memory.tried[k]
            if m > 0 and judge(flow, y, w, m, units, destination):
                return


@jit
def find_repetition(motion, destination):
    """Find after how many periods a record repeats, which is all that other rules show."""
    pt, sections, sums = motion.pt, motion.sections, motion.sums
    kind = kind_of(sums)
    cycle = sums.cycle if sums.cycle > 0 else last_return(sections)
    m, off = repetition_of_cycle(sections, cycle, pt), 0.0
    q = sums.cycle_impacts * m // cycle if sums.cycle > 0 else -1
    if m == 0:
        m, off = repetition(sections, size_of(sections, pt, True))
        q = -1
    if m == 0:
        return
    released = q >= 0 and kind == _RESTS and not sums.cycle_rests
    if kind == _RESTS and not released:
        if not rests_alike(motion, m, False):
            destination.evidence = _UNSTABLE
            return
    proof = _RELEASED if released else _REPEATS
    put_repetition(destination, proof, sections, m, q, math.nan, off)
