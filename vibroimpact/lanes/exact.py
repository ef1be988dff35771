"""The rule ``exact`` in the lanes: impacts mended side by side, in vectors.

All lanes glide over a step, into a second row of states. Those that may have met the stop are
listed, and mended in columns side by side. Where that proves nothing, the lane goes through
``exact_step`` alone, as a single orbit does.
"""

from __future__ import annotations

import math

from vibroimpact.jit import is_set, jit, lowest_bit, not_negative, select, widest_vectors
from vibroimpact.lanes.columns import (
    COLUMNS,
    EQUATION,
    PAIR,
    PROVED,
    ROW,
    VECTOR,
    W_0,
    W_I,
    W_T,
    Y_0,
    Y_T,
    E,
    U,
    carry_columns,
    equation_in,
    mend_columns,
    pair_in,
    put_pair,
)
from vibroimpact.lanes.exact_block import (
    EQUATION_SIZE,
    EXACT_LANES,
    FLOW,
    HIGH,
    LANE_E,
    LANE_EQUATION,
    LANE_ROW,
    RESTING,
    SLEPT,
    TANGENTS,
    WAKE,
    Block,
    W,
    Y,
    flow_in,
    place_of_added,
    round_states,
    set_equations,
    set_start,
)
from vibroimpact.lanes.tally import list_impact, record_section, record_step
from vibroimpact.step.exact import exact_step
from vibroimpact.step.flow import glide
from vibroimpact.step.phases import COS, SIN, THETA, sine_at_start
from vibroimpact.step.single_impact import ONLY
from vibroimpact.step.stop import time_to_release
from vibroimpact.step.tangents import carry_tangents, glide_tangents, orthonormalise

# Steps between two looks at the tangent vectors.
_STRIDE = 4
# Lanes that ``not_negative`` has a bit for.
_WORD = 64


@jit(refcounts=False)
def list_lanes(w, met, size):
    """List the first lanes whose number in the row HIGH is not negative; return how many."""
    listed = 0
    for first in range(0, size, _WORD):
        bits = not_negative(w, HIGH + first)
        if first + _WORD > size:
            bits &= (1 << (size - first)) - 1
        while bits != 0:  # ends: one bit less each time
            met[listed] = first + lowest_bit(bits)
            bits &= bits - 1
            listed += 1
    return listed


@jit(refcounts=False)
def glide_lanes(w, size, added, step, n):
    """Take the first lanes over step `n`; HIGH is below 0 where they cannot have met the stop."""
    widest_vectors()
    old_row, new_row = (n & 1) * LANE_ROW, (~n & 1) * LANE_ROW
    for i in range((size + VECTOR - 1) // VECTOR * VECTOR):
        y, v, w[LANE_E + i], w[HIGH + i] = glide(
            flow_in(w, i), w[Y + old_row + i], w[W + old_row + i], (added[0, i], added[1, i]), step
        )
        w[Y + new_row + i], w[W + new_row + i] = y, v


@jit(refcounts=False)
def glide_all_tangents(w, size, n):
    """Take the tangent vectors of the first lanes over step `n`."""
    widest_vectors()
    old_row, new_row = (n & 1) * LANE_ROW, (~n & 1) * LANE_ROW
    for i in range((size + VECTOR - 1) // VECTOR * VECTOR):
        pair = glide_tangents(flow_in(w, i), pair_in(w, TANGENTS + old_row + i, 2 * LANE_ROW))
        put_pair(w, TANGENTS + new_row + i, 2 * LANE_ROW, pair)


@jit(refcounts=False)
def mend_side_by_side(memory, lo, count, grid, n, carrying):
    """Copy `count` listed lanes, from place `lo` on, into columns, and mend step `n` there."""
    w, met, c, _, _ = memory
    table, old_row, new_row = grid.table, (n & 1) * LANE_ROW, (~n & 1) * LANE_ROW
    for j in range(count):
        i = met[lo + j] & (EXACT_LANES - 1)  # so that LLVM sees that it is not negative
        for q in range(5):
            c[EQUATION + q * ROW + j] = w[LANE_EQUATION + EQUATION_SIZE * i + q]
        c[Y_0 + j], c[W_0 + j] = w[Y + old_row + i], w[W + old_row + i]
        c[Y_T + j], c[W_T + j] = w[Y + new_row + i], w[W + new_row + i]
        c[E + j] = w[LANE_E + i]
        if carrying:
            put_pair(c, PAIR + j, ROW, pair_in(w, TANGENTS + old_row + i, 2 * LANE_ROW))
    wave, vectors = (table[SIN, n], table[COS, n]), (count + VECTOR - 1) // VECTOR
    mend_columns(c, vectors, (*wave, table[SIN, n + 1], table[COS, n + 1]), grid.step)
    if carrying:
        carry_columns(c, vectors, wave, grid.step)


@jit(refcounts=False)
def settle(block, lo, count, grid, n, recording, carrying):
    """Take the lanes of these columns to the end of step `n`.

    A lane without a proved single impact is taken there by itself.
    """
    (w, met, c, _, _), points, tally = block
    theta, new_row = grid.table[THETA, n], (~n & 1) * LANE_ROW
    for j in range(count):
        i = met[lo + j] & (EXACT_LANES - 1)
        if c[PROVED + j] != ONLY:
            if theta + grid.step < w[WAKE + i] - 1e-9:  # at rest throughout the step
                w[Y + new_row + i] = w[W + new_row + i] = 0.0
                if recording:
                    w[SLEPT + i] += 1.0
            else:
                take_carefully(block, i, j, grid, n, recording, carrying)
            continue
        w[Y + new_row + i], w[W + new_row + i] = c[Y_T + j], c[W_T + j]
        if carrying:
            put_pair(w, TANGENTS + new_row + i, 2 * LANE_ROW, pair_in(c, PAIR + j, ROW))
        if recording:
            speed = c[W_I + j] * points[i].omega
            list_impact(tally.impacts[i], tally.sums[i], theta + c[U + j], speed)


@jit(refcounts=False)
def stretch(pair, sums):
    """Orthonormalise two tangent vectors, and add up their growth."""
    pair, growth_1, growth_2 = orthonormalise(pair)
    sums.growth_1 += growth_1
    sums.growth_2 += growth_2
    return pair


@jit(refcounts=False)
def judge_tangents(w, size, parity):
    """Look for tangent vectors that would soon be too short, too long or too parallel.

    In the row HIGH a lane that has such vectors is not negative.
    """
    widest_vectors()
    row = TANGENTS + (parity & 1) * LANE_ROW
    for i in range((size + VECTOR - 1) // VECTOR * VECTOR):
        ay, aw, by, bw = pair_in(w, row + i, 2 * LANE_ROW)
        size_2 = ay * ay + aw * aw + by * by + bw * bw
        fit = (abs(ay * bw - aw * by) >= 1e-4 * size_2) & (size_2 > 1e-100) & (size_2 < 1e100)
        w[HIGH + i] = select(fit, -1.0, 1.0)


@jit(refcounts=False)
def stretch_lanes(memory, points, parity, tally):
    """Orthonormalise the tangent vectors that need it."""
    w, met, _, _, _ = memory
    judge_tangents(w, points.size, parity)
    for j in range(list_lanes(w, met, points.size)):
        a = TANGENTS + (parity & 1) * LANE_ROW + met[j]
        pair = stretch(pair_in(w, a, 2 * LANE_ROW), tally.sums[met[j]])
        put_pair(w, a, 2 * LANE_ROW, pair)


@jit(refcounts=False)
def take_carefully(block, i, j, grid, n, recording, carrying):
    """Take lane `i`, which is in column `j`, over step `n`, with every impact in it."""
    (w, _, c, _, scratch), points, tally = block
    old_row, new_row = (n & 1) * LANE_ROW, (~n & 1) * LANE_ROW
    pt, sums, table, step = points[i], tally.sums[i], grid.table, grid.step
    theta = table[THETA, n]
    eq, was_resting = equation_in(w, LANE_EQUATION + EQUATION_SIZE * i, 1), w[RESTING + i] > 0.0
    y, v, resting, n_events, rested, status, grazes = exact_step(
        eq, pt, (w[Y + old_row + i], w[W + old_row + i], was_resting),
        (w[Y + new_row + i], w[W + new_row + i], w[LANE_E + i]),
        (0.0, 0.0, c[U + j], c[W_I + j], c[PROVED + j]),
        (theta, table[SIN, n], table[COS, n]), step, scratch,
    )  # fmt: skip
    w[Y + new_row + i], w[W + new_row + i], w[RESTING + i] = y, v, 1.0 if resting else 0.0
    w[WAKE + i] = -math.inf
    if resting:
        w[WAKE + i] = theta + step + pt.omega * time_to_release(theta + step, pt)
    sums.status = max(sums.status, status)
    if recording:
        rested /= pt.omega
        record_step(scratch.events, n_events, pt.clearance, rested, theta, pt, i, tally)
        sums.near_grazes += grazes
    if carrying:
        pair = pair_in(w, TANGENTS + old_row + i, 2 * LANE_ROW)
        if was_resting:
            pair = 0.0, 0.0, 0.0, 0.0
        pair = carry_tangents(
            (eq, flow_in(w, i)), pair, scratch.events, n_events, theta, step, pt.omega
        )
        put_pair(w, TANGENTS + new_row + i, 2 * LANE_ROW, pair)


@jit(refcounts=False)
def advance(block, grid, recording, carrying):
    """Take a block over the steps of `grid`, step by step."""
    memory, points, tally = block
    w, size = memory.w, grid.size
    for n in range(size):
        added = memory.added[place_of_added(memory, grid, n)]
        glide_lanes(w, points.size, added, grid.step, n)
        listed = list_lanes(w, memory.met, points.size)
        if carrying:
            glide_all_tangents(w, points.size, n)
        for lo in range(0, listed, COLUMNS):
            count = min(COLUMNS, listed - lo)
            mend_side_by_side(memory, lo, count, grid, n, carrying)
            settle(block, lo, count, grid, n, recording, carrying)
        if carrying and ((n + 1) % _STRIDE == 0 or n + 1 == size):
            stretch_lanes(memory, points, n + 1, tally)
    if size & 1:
        for a in range(0, FLOW if carrying else TANGENTS, 2 * LANE_ROW):  # the next step is even
            for i in range(a, a + EXACT_LANES):
                w[i] = w[i + LANE_ROW]


@jit(refcounts=False)
def pass_section(block, k, step):
    """Round the states to (x, v), and store them as section `k` if it is not negative."""
    (w, _, _, _, _), points, tally = block
    round_states(w)
    if k >= 0:
        for i in range(points.size):
            record_section(w[Y + LANE_ROW + i], w[W + LANE_ROW + i], i, k, tally)
            if w[SLEPT + i] > 0.0:
                tally.sums[i].rested += w[SLEPT + i] * step / points[i].omega
                w[SLEPT + i] = 0.0


@jit(refcounts=False)
def run_exact(memory, points, run, tally):
    """Run a block of at most ``EXACT_LANES`` points from its start to the end of the record."""
    w, transient, (_, lead, grid) = memory.w, run.transient, run.stepping
    block = Block(memory, points, tally)
    set_start(w, points, sine_at_start(lead, grid))
    # The lead-in is the period before the transient: `advance` is called, and compiled, once.
    for k in range(-transient - 1, run.periods):
        if is_set(run.interrupt):
            break
        steps = lead if k < -transient else grid
        if steps.size > 0 and k <= -transient:
            set_equations(memory, points, steps)
        if k == 0:
            for i in range(points.size):
                if w[RESTING + i] > 0.0:  # nothing is left of its past
                    put_pair(w, TANGENTS + i, 2 * LANE_ROW, (0.0, 0.0, 0.0, 0.0))
        advance(block, steps, k >= 0, k >= 0 and run.lyapunov)
        if k >= -transient:
            pass_section(block, k, steps.step)
    if run.lyapunov:
        for i in range(points.size):
            ay, aw, by, bw = pair_in(w, TANGENTS + i, 2 * LANE_ROW)
            omega = points[i].omega
            stretch((ay, aw * omega, by, bw * omega), tally.sums[i])
