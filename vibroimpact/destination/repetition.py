"""Finds after how many periods a record repeats or nearly does; what rounding decides.

After a rest a motion depends on nothing before its release, which always has the same phase. So a
computed motion that rests again after m periods repeats for ever, to the same bits, however much
its rounding errors have grown in between. No multiplier says whether others go there. The motion
has a class only if those beside it also rest again after m periods: one with a slightly smaller p
as long as the motion itself, or it and one with a slightly larger p about as long as each other.
With exact impacts this is asked only where m is greater than ``_SURE``: it changed no name of fewer
periods in 24,000 random motions.
"""

from __future__ import annotations

import math

from vibroimpact.jit import jit, specialised
from vibroimpact.status import TOLERANCE
from vibroimpact.step.contact import KIND, RELEASE, REST, TIME, is_held
from vibroimpact.step.elementary import asin
from vibroimpact.step.scheme import THETA
from vibroimpact.step.stepper import prepare, prepare_exact, take_grid_step, take_next_step

#: It does so after m periods only if its deviation from that is less than this share of its
#: deviation from every divisor of m.
_LESS_THAN_DIVISORS = 0.01
#: Sections below this share of what was rounded are measured by that: they may be rounding, and a
#: motion with exact impacts is not certified.
_LEAST_SIZE = 1e-8
#: Nor is a size in x or v below this share of what the other one makes of it: sections beside an
#: impact are all on the stop, and those at a turning point have no speed.
_LEAST_SHARE = 1e-3
#: Longest repetition that is looked for [forcing periods].
LONGEST_PERIOD = 64
#: Sections of a motion that came back to the same bits agree if they differ by less than this share
#: of the size of its record, which is rounding; they do not if they differ by ``TOLERANCE``.
_SAME_SECTIONS = 1e-10
#: Largest deviation from a repetition at the end of a record that nearly repeats.
_NEARLY = 0.1
#: How many repetitions of a record that nearly repeats are tried.
MOST_REPETITIONS = 3


@jit
def size_of(sections, pt, stepped):
    """Return the size of a record in x and in v, never 0.

    These are the greatest distance from the rest position or, if it is less, from the stop, and the
    greatest |v|, neither of which may be rounding. It is the clearance that is rounded, but a
    `stepped` motion, by time stepping, does not know a stop that it is far from. Only a motion that
    damping alone brings to rest has no other size; the start is not that of the whole run.
    """
    size_x, size_y, size_v = 0.0, 0.0, 0.0
    for k in range(sections.shape[0]):
        size_x = max(size_x, abs(sections[k, 0]))
        size_y = max(size_y, abs(sections[k, 0] - pt.clearance))
        size_v = max(size_v, abs(sections[k, 1]))
    least = _LEAST_SIZE * abs(pt.clearance)
    if stepped and (pt.f > 0.0 or pt.h == 0.0):
        least = min(least, _LEAST_SIZE * size_x)
    size_x = min(size_x, size_y)
    size_x, size_v = max(size_x, least), max(size_v, pt.p * least)
    size_x = max(size_x, _LEAST_SHARE * size_v / max(pt.omega, pt.p))
    size_v = max(size_v, _LEAST_SHARE * size_x * min(pt.omega, pt.p))
    return size_x if size_x > 0.0 else 1.0, size_v if size_v > 0.0 else 1.0


@jit
def apart(sections, j, k, size):
    """Return the distance between two sections, relative to the size of the record."""
    return max(
        abs(sections[j, 0] - sections[k, 0]) / size[0],
        abs(sections[j, 1] - sections[k, 1]) / size[1],
    )


@jit
def _deviation(sections, m, size, most):
    """Return how far a record deviates from repeating its first m sections, inf beyond `most`."""
    worst = 0.0
    for k in range(m, sections.shape[0]):
        off = apart(sections, k, k % m, size)
        if not off <= most:
            return math.inf
        worst = max(worst, off)
    return worst


@jit
def repetition(sections, size):
    """Return the least m after which the whole record repeats, 0 if there is none, and how well.

    A motion repeats after m periods if the whole record repeats its first m sections to within
    ``TOLERANCE``. It is not enough that each section equals the one m periods before: near a flip
    a motion of period m settles from alternating sides, so slowly that it would seem to have
    period 2 m. It may also approach an orbit of period d in turns of m periods, with deviations
    that are already within the tolerance. So they must be a hundred times less for m than for every
    divisor of m.
    """
    for m in range(1, min(LONGEST_PERIOD, sections.shape[0] // 2) + 1):
        off = _deviation(sections, m, size, TOLERANCE)
        if off == math.inf:
            continue
        repeats = True
        for divisor in range(1, m):
            if m % divisor == 0:
                limit = off / _LESS_THAN_DIVISORS
                repeats &= limit == 0.0 or _deviation(sections, divisor, size, limit) == math.inf
        if repeats:
            return m, off
    return 0, math.inf


@jit
def last_return(sections):
    """Return how many periods before its last section a motion had the same bits, or 0."""
    last = sections.shape[0] - 1
    x, v = sections[last, 0], sections[last, 1]
    for k in range(1, min(LONGEST_PERIOD, last) + 1):
        if sections[last - k, 0] == x and sections[last - k, 1] == v:
            return k
    return 0


@jit
def repetition_of_cycle(sections, cycle, pt):
    """Return after how many periods a motion repeats that came back to the same bits, or 0.

    That is the least divisor of the `cycle` after which its sections agree: near a slow orbit the
    last bits wander. A cycle of more than ``LONGEST_PERIOD`` periods gives 0, and so do sections of
    which it is not clear whether they agree.
    """
    if cycle == 0 or cycle > LONGEST_PERIOD:
        return 0
    if cycle == 1:
        return 1
    size, last = size_of(sections, pt, False), sections[sections.shape[0] - cycle :]
    for m in range(1, cycle):
        if cycle % m == 0:
            off = _deviation(last, m, size, TOLERANCE)
            if off < math.inf:
                return m if off <= _SAME_SECTIONS else 0
    return cycle


@jit
def near_repetitions(sections, size, periods):
    """List in `periods`, shape (MOST_REPETITIONS,), the m of near repetitions; 0 for none.

    Listed are numbers of periods for which the last sections deviate by less than half as much as
    for every smaller number: of these the best, in increasing order.
    """
    periods[:] = 0
    last, least = sections.shape[0] - 1, 2.0 * _NEARLY
    for m in range(1, min(LONGEST_PERIOD, last) + 1):
        off = 0.0
        for k in range(min(m, sections.shape[0] - m)):
            off = max(off, apart(sections, last - k, last - k - m, size))
            if not off < 0.5 * least:
                break
        if off < 0.5 * least:
            least = off
            for i in range(MOST_REPETITIONS - 1):
                periods[i] = periods[i + 1]
            periods[MOST_REPETITIONS - 1] = m


#: The motions beside another have a p that differs by this share: some ten times its rounding.
_BESIDE = 2.0**-48
#: Most periods in which rounding has never been seen to grow enough to decide a rest.
_SURE = 12
#: Rests are about as long as each other if they differ by less than the first share, and as long as
#: each other if they differ by less than the second.
_ALIKE, _EQUAL = 0.5, 1e-3


@specialised
def rest_after(pt, scheme, m, scratch, exactly):
    """Return how long a mass that is released rests before the m-th release after it, as a phase.

    It is 0 if there is no rest then, or one before.
    """
    (method, grid), events = scheme, scratch.events
    if exactly:
        prepared, state = prepare_exact(grid, pt, scratch), (0.0, 0.0, True)
    else:
        prepared, state = prepare(method, grid, pt), (pt.clearance, 0.0, True)
    release = -asin(pt.p * pt.p * pt.clearance / pt.f) - grid.table[THETA, 0]
    first, begun = int(release % (2.0 * math.pi) / grid.phase_step), 0.0
    for k in range(m * grid.size + 2):
        n = (first + k) % grid.size
        if exactly:
            state, n_events, _ = take_next_step(prepared, state, grid, n, pt, scratch)
        else:
            state, n_events, _ = take_grid_step(method, prepared, state, grid, n, pt, scratch)
        for j in range(n_events):
            at = k * grid.phase_step + events[j, TIME] * pt.omega
            if events[j, KIND] == REST:
                begun = at
            elif events[j, KIND] == RELEASE and at > math.pi:
                return at - begun if at > (2 * m - 1) * math.pi else 0.0
    return 0.0


@specialised
def rests_alike(motion, m, exactly):
    """Whether motions beside one that rests again after m periods do so, too.

    The second is not asked if the first rests as long as the motion itself.
    """
    pt, _, sums, scheme, memory = motion
    if is_held(pt):
        return True
    beside, rest = memory.beside[0], sums.cycle_rested * pt.omega * m / max(sums.cycle, 1)
    memory.beside[0], first, length = pt, 0.0, 0.0
    for share in (-_BESIDE, _BESIDE):
        beside.p = pt.p * (1.0 + share)
        length = rest_after(beside, scheme, m, memory.scratch, exactly)
        if length == 0.0 or (first == 0.0 and abs(length - rest) < _EQUAL * rest):
            return length > 0.0
        first = first if first > 0.0 else length
    return abs(first - length) < _ALIKE * min(first, length)


@jit
def rests_alike_exactly(motion, m):
    """Do what ``rests_alike`` does, with the rule ``exact``, where m is not small."""
    return m <= _SURE or rests_alike(motion, m, True)
