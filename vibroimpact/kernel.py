"""The stepping kernel: blocks of lanes over the threads.

Every lane is advanced by its affine map, a stride of steps at a time, as if there were no stop.
A lane that may have met it stays at the step before, and is taken through the rest of the stride
alone, step by step and with the impact rule, as a single orbit is. Only the rule ``plain`` has a
loop of its own, in ``plain_lanes.py``. ``prange`` runs over the blocks.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from vibroimpact.exact_impacts import Lane
from vibroimpact.flight import TERMS
from vibroimpact.impacts import EXACT, PLAIN
from vibroimpact.jit import jit, widest_vectors
from vibroimpact.lanes import (
    ALONG_F,
    ALONG_V,
    ALONG_X,
    LANES,
    LEVEL,
    SAFE,
    STRIDE,
    TANGENTS,
    WAKE,
    V,
    X,
    glide_step,
    glide_stride,
    glide_tangents,
    map_of,
    new_workspace,
    set_maps,
    set_start,
)
from vibroimpact.lyapunov import carry_tangents, orthonormalise
from vibroimpact.phases import COS, SIN, THETA, sine_at_start
from vibroimpact.plain_lanes import advance_plain, sum_up_plain
from vibroimpact.status import Status
from vibroimpact.stepping import take_step
from vibroimpact.stop import (
    DISPLACEMENT,
    IMPACT,
    KIND,
    REST,
    SPEED,
    TIME,
    new_scratch,
    time_to_release,
)

_UNRESOLVED, _NON_FINITE = int(Status.UNRESOLVED), int(Status.NON_FINITE)


#: What is summed up over the recorded periods of a point, beside its last status.
SUMS = np.dtype(
    [
        ("impacts", np.int64),
        ("slowest_impact", float),
        ("max_penetration", float),
        ("rested", float),
        ("chatters", np.int64),
        ("near_grazes", np.int64),
        ("growth_1", float),
        ("growth_2", float),
        ("status", np.int64),
    ]
)


class Tally(NamedTuple):
    """What is kept of the recorded periods, one row per point.

    Attributes
    ----------
    sections : ndarray, shape (n, periods, 2)
        x and v at the end of each period.
    impacts : ndarray, shape (n, capacity, 2)
        Phase and speed of the last impacts: a ring, put into time order at the end.
    sums : ndarray of dtype ``SUMS``, shape (n,)
    """

    sections: np.ndarray
    impacts: np.ndarray
    sums: np.ndarray


@jit(inline=True)
def record_step(events, n, x_T, rested, grazes, theta, pt, row, tally):
    """Add the events of one mended step to the tally of the lane in that row."""
    sums = tally.sums[row]
    depth = x_T - pt.clearance
    capacity = tally.impacts.shape[1]
    for k in range(n):
        kind = events[k, KIND]
        if kind == IMPACT:
            depth = max(depth, events[k, DISPLACEMENT] - pt.clearance)
            speed = events[k, SPEED]
            sums.slowest_impact = min(sums.slowest_impact, speed)
            if capacity > 0:
                slot = sums.impacts % capacity
                at = theta + pt.omega * events[k, TIME]
                while at >= 2.0 * math.pi:  # twice at the most
                    at -= 2.0 * math.pi
                tally.impacts[row, slot, 0] = at
                tally.impacts[row, slot, 1] = speed
            sums.impacts += 1
        elif kind == REST:
            sums.chatters += 1
    sums.rested += rested
    sums.near_grazes += grazes
    sums.max_penetration = max(sums.max_penetration, depth)


@jit(leaf=True)
def stretch(tangents, sums, always):
    """Orthonormalise the tangent vectors of a lane and add up their growth.

    Where not `always`, only those that would soon be too short, too long or too parallel for their
    digits.
    """
    ax, av, bx, bv = tangents[0], tangents[1], tangents[2], tangents[3]
    size = ax * ax + av * av + bx * bx + bv * bv
    if always or abs(ax * bv - av * bx) < 1e-4 * size or not 1e-100 < size < 1e100:
        growth_1, growth_2 = orthonormalise(tangents)
        sums.growth_1 += growth_1
        sums.growth_2 += growth_2


@jit(inline=True)
def tangents_of(w, i):
    """Return the view of the two tangent vectors of lane `i`, shape (4,)."""
    return w[TANGENTS + i : TANGENTS + 4 * LANES : LANES]


@jit(inline=True)
def finish(
    w, i, taylor, rule, integrator, n, end, grid, pt, row, recording, lyapunov, tally, scratch
):
    """Take lane `i` through the steps from `n` to before `end`, with every impact in them."""
    T = grid.step / pt.omega
    lane = Lane(taylor, w[ALONG_X + i], w[ALONG_V + i], w[ALONG_F + i])
    to_x, to_v = map_of(w, i)
    sums = tally.sums[row]
    x, v, resting = w[X + i], w[V + i], w[LEVEL + i] < pt.clearance
    for k in range(n, end):
        theta, s, c = grid.table[THETA, k], grid.table[SIN, k], grid.table[COS, k]
        if resting and recording and lyapunov:
            tangents_of(w, i)[:] = 0.0
        if theta + grid.step < w[WAKE + i] - 1e-9:  # asleep
            if recording:
                sums.rested += T
            continue
        x, v, resting, n_events, rested, status, grazes = take_step(
            rule, integrator, to_x, to_v, x, v, resting, theta, s, c, grid.step, pt, lane, scratch
        )
        w[WAKE + i] = -math.inf
        if resting:
            w[WAKE + i] = theta + grid.step + pt.omega * time_to_release(theta + grid.step, pt)
        sums.status = max(sums.status, status)
        if recording and (n_events > 0 or rested > 0.0 or grazes > 0):
            record_step(scratch.events, n_events, x, rested, grazes, theta, pt, row, tally)
        if recording and lyapunov:
            carry_tangents(
                tangents_of(w, i), to_x, to_v, scratch.events, n_events, theta, T, taylor, pt
            )
            stretch(tangents_of(w, i), sums, False)
    w[X + i], w[V + i] = x, v
    w[LEVEL + i] = -math.inf if resting else pt.clearance


@jit(leaf=True)
def advance(w, taylor, first, points, rule, integrator, grid, recording, lyapunov, tally, scratch):
    """Steps over `grid`, stride by stride, and the rest of them singly."""
    widest_vectors()
    size = grid.table.shape[1]
    whole = size // STRIDE * STRIDE
    n = 0
    while n < size:
        steps = STRIDE if n < whole else 1
        if steps == STRIDE:
            met = glide_stride(w, grid.table, n, rule == EXACT)
        else:
            met = glide_step(w, grid.table, n, rule == EXACT)
        if recording and lyapunov:
            glide_tangents(w, steps)
        if met:
            for i in range(points.size):
                taken = int(w[SAFE + i])
                if taken < steps:
                    finish(
                        w, i, taylor[i], rule, integrator, n + taken, n + steps, grid, points[i],
                        first + i, recording, lyapunov, tally, scratch,
                    )  # fmt: skip
        if recording and lyapunov:
            for i in range(points.size):
                stretch(tangents_of(w, i), tally.sums[first + i], False)
        n += steps


@jit(inline=True)
def record_section(w, first, n, k, tally):
    """Store the state of `n` lanes as section `k`, NaN where it overflowed."""
    for i in range(n):
        x, v, sums = w[X + i], w[V + i], tally.sums[first + i]
        finite = math.isfinite(x) and math.isfinite(v)
        tally.sections[first + i, k, 0] = x if finite else math.nan
        tally.sections[first + i, k, 1] = v if finite else math.nan
        if not finite and sums.status < _UNRESOLVED:
            sums.status = _NON_FINITE


@jit(inline=True)
def reverse(ring, lo, hi):
    """Turn the rows of `ring` from `lo` to before `hi` around."""
    while hi - lo > 1:
        hi -= 1
        for k in range(2):
            ring[lo, k], ring[hi, k] = ring[hi, k], ring[lo, k]
        lo += 1


@jit(leaf=True)
def put_in_order(ring, count):
    """Unroll a ring that received `count` impacts into time order."""
    size = ring.shape[0]
    if count > size > 0:
        oldest = count % size
        reverse(ring, 0, oldest)
        reverse(ring, oldest, size)
        reverse(ring, 0, size)


@jit(leaf=True)
def run_block(
    w, taylor, scratch, first, points, rule, integrator, lead, grid, transient, periods, lyapunov,
    tally,
):  # fmt: skip
    """Run one block of at most ``LANES`` points from its start to the end of the record."""
    widest_vectors()
    set_start(w, points, rule, sine_at_start(lead, grid))
    for k in range(-1, transient + periods):
        steps = lead if k < 0 else grid
        if k <= 0:
            set_maps(w, taylor, points, rule, integrator, steps)
        if rule == PLAIN and k < transient:
            advance_plain(w, first, points.size, steps, False, tally)
        elif rule == PLAIN:
            advance_plain(w, first, points.size, steps, True, tally)
        else:
            advance(
                w, taylor, first, points, rule, integrator, steps, k >= transient, lyapunov, tally,
                scratch,
            )  # fmt: skip
        if k >= transient:
            record_section(w, first, points.size, k - transient, tally)
        for i in range(LANES):
            w[WAKE + i] -= 2.0 * math.pi if k >= 0 else 0.0  # the grid's phases begin again
    if lyapunov:
        for i in range(points.size):
            stretch(tangents_of(w, i), tally.sums[first + i], True)
    if rule == PLAIN:
        sum_up_plain(w, first, points.size, tally)
    for i in range(first, first + points.size):
        put_in_order(tally.impacts[i], tally.sums[i].impacts)


@jit(parallel=True)
def run_blocks(points, rule, integrator, lead, grid, transient, periods, lyapunov, tally):
    """Run every point, block by block over the threads."""
    for b in prange((points.size + LANES - 1) // LANES):
        lo, hi = b * LANES, min((b + 1) * LANES, points.size)
        run_block(
            new_workspace(), np.empty((LANES, 4, TERMS)), new_scratch(), lo,
            points[lo:hi], rule, integrator, lead, grid, transient, periods, lyapunov, tally,
        )  # fmt: skip
