"""The stepping kernel: blocks of lanes over the threads.

Every lane is advanced by its affine map, a stride of steps at a time, as if there were no stop.
A lane that may have met it stays at the start of the stride, and is taken through it alone, step by
step and with the impact rule, as a single orbit is; with the rule ``reduced-step`` this is left for
what ``lanes/reduced_step.py`` does not mend. Only the rule ``plain`` has a loop of its own, in
``lanes/plain.py``. Each thread takes block after block, and lets go of Python while it does.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import numpy as np

from vibroimpact.jit import claim, compiled, is_set, jit, widest_vectors
from vibroimpact.lanes.plain import advance_plain, sum_up_plain
from vibroimpact.lanes.reduced_step import mend_side_by_side
from vibroimpact.lanes.tally import put_in_order, record_step
from vibroimpact.lanes.workspace import (
    ALONG_F,
    ALONG_V,
    ALONG_X,
    LANES,
    LEVEL,
    MET,
    STRIDE,
    TANGENTS,
    WAKE,
    V,
    X,
    glide_step,
    glide_stride,
    glide_tangents,
    list_met,
    map_of,
    new_workspace,
    set_maps,
    set_start,
)
from vibroimpact.status import Status
from vibroimpact.step.exact import Lane
from vibroimpact.step.flight import TERMS
from vibroimpact.step.one_step import take_step
from vibroimpact.step.phases import COS, SIN, THETA, sine_at_start
from vibroimpact.step.reduced_step import REDUCED_STEP
from vibroimpact.step.rules import EXACT, PLAIN
from vibroimpact.step.stop import new_scratch, time_to_release
from vibroimpact.step.tangents import carry_tangents, orthonormalise

_UNRESOLVED, _NON_FINITE = int(Status.UNRESOLVED), int(Status.NON_FINITE)
_PENDING = int(Status.PENDING)


@jit(leaf=True, internal=True)
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


@jit(inline=True)
def glide_on(w, n, steps, guarded, table):
    """Take the lanes over one step or a stride; return the bits of those that may meet the stop."""
    if steps == 1:
        return glide_step(w, table, n, guarded)
    if guarded:
        return glide_stride(w, table, n, True)
    return glide_stride(w, table, n, False)


@jit(leaf=True, internal=True)
def advance(w, taylor, first, points, rule, integrator, grid, recording, lyapunov, tally, scratch):
    """Steps over `grid`, stride by stride, and the rest of them singly."""
    widest_vectors()
    size = grid.table.shape[1]
    strides = size // STRIDE
    for k in range(strides + size % STRIDE):
        n = k + min(k, strides) * (STRIDE - 1)
        steps = STRIDE if k < strides else 1
        met = list_met(w, points.size, glide_on(w, n, steps, rule == EXACT, grid.table))
        if recording and lyapunov:
            glide_tangents(w, steps)
        if rule == REDUCED_STEP and steps == STRIDE and met > 0:
            met = mend_side_by_side(w, met, first, points, integrator, grid, n, recording, tally)
        for j in range(met):
            i = int(w[MET + j])
            finish(
                w, i, taylor[i], rule, integrator, n, n + steps, grid, points[i], first + i,
                recording, lyapunov, tally, scratch,
            )  # fmt: skip
        if recording and lyapunov:
            for i in range(points.size):
                stretch(tangents_of(w, i), tally.sums[first + i], False)


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
def close_records(first, size, given_up, tally):
    """Put the impacts of a block's points in order; points that were given up are ``PENDING``."""
    for i in range(first, first + size):
        put_in_order(tally.impacts[i], tally.sums[i].impacts)
        if given_up:
            tally.sums[i].status = _PENDING


@jit(inline=True)
def run_block(
    w, taylor, scratch, first, points, plain, rule, integrator, lead, grid, transient, periods,
    lyapunov, tally, interrupt,
):  # fmt: skip
    """Run one block of at most ``LANES`` points from its start to the end of the record.

    `plain` says if the rule is: as a literal, so that one of the two loops is not compiled. Once
    `interrupt` is set the points are given up: ``PENDING``.
    """
    set_start(w, points, rule, sine_at_start(lead, grid))
    given_up = False
    for k in range(-1, transient + periods):
        given_up = is_set(interrupt)
        if given_up:
            break
        steps = lead if k < 0 else grid
        if k <= 0:
            set_maps(w, taylor, points, rule, integrator, steps)
        if plain:
            if k < transient:
                advance_plain(w, first, points.size, steps, False, tally)
            else:
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
    if plain:
        sum_up_plain(w, first, points.size, tally)
    close_records(first, points.size, given_up, tally)


@jit(inline=True)
def take_blocks(
    claimed, points, plain, rule, integrator, lead, grid, transient, periods, lyapunov, tally,
    interrupt,
):  # fmt: skip
    """Run block after block, as long as there are any that no thread has taken yet."""
    widest_vectors()
    w, taylor, scratch = new_workspace(), np.empty((LANES, 4, TERMS)), new_scratch()
    lo = LANES * claim(claimed)
    while lo < points.size:  # ends: the counter only rises
        run_block(
            w, taylor, scratch, lo, points[lo : lo + LANES], plain, rule, integrator, lead, grid,
            transient, periods, lyapunov, tally, interrupt,
        )  # fmt: skip
        lo = LANES * claim(claimed)


@jit
def take_plain(
    claimed, points, rule, integrator, lead, grid, transient, periods, lyapunov, tally, interrupt
):
    """The work of one thread with the rule ``plain``."""
    take_blocks(
        claimed, points, True, rule, integrator, lead, grid, transient, periods, lyapunov, tally,
        interrupt,
    )  # fmt: skip


@jit
def take_mended(
    claimed, points, rule, integrator, lead, grid, transient, periods, lyapunov, tally, interrupt
):
    """The work of one thread with any other rule."""
    take_blocks(
        claimed, points, False, rule, integrator, lead, grid, transient, periods, lyapunov, tally,
        interrupt,
    )  # fmt: skip


def run_blocks(threads, points, rule, *others):
    """Run every point on so many threads, the caller's among them.

    Threads of Python that last as long as the call: a forked process misses none of them, and
    callers in several threads do not meet.

    Parameters
    ----------
    threads : int
    points, rule, *others
        As for ``take_blocks``.
    """
    arguments = (np.zeros(1, np.int64), points, rule, *others)
    work = compiled(take_plain if rule == PLAIN else take_mended, *arguments)
    helpers = []
    with ThreadPoolExecutor(threads) as pool:
        with suppress(RuntimeError):  # where no more can be started, those there are do the work
            for _ in range(threads - 1):
                helpers.append(pool.submit(work, *arguments))
        work(*arguments)
    for helper in helpers:
        helper.result()
