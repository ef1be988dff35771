"""The rule ``exact`` in the lanes: impacts mended side by side, in vectors.

All lanes glide over a step, into a second row of states. Those that may have met the stop are
listed, and mended in columns side by side by ``single_impact``. If that proves nothing, the
lane goes through ``exact_step`` alone, as a single orbit does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import bit, is_set, jit, lowest_bit, widest_vectors
from vibroimpact.lanes.tally import list_impact, record_section, record_step
from vibroimpact.lanes.workspace import aligned
from vibroimpact.step.exact import exact_step
from vibroimpact.step.flow import Equation, Flow, enter, equation_of, flow_of, glide, leave
from vibroimpact.step.phases import COS, SIN, THETA, sine_at_start
from vibroimpact.step.single_impact import ONLY, single_impact
from vibroimpact.step.stop import Scratch, new_scratch, start, time_to_release
from vibroimpact.step.tangents import (
    carry_tangents,
    glide_tangents,
    orthonormalise,
    tangents_through_impact,
)

#: Points per block at the most; a power of 2.
EXACT_LANES = 256
# Lanes that one integer has a bit for; columns that are mended at a time; steps between two looks
# at the tangent vectors.
WORD, _COLUMNS, _STRIDE = 64, 8, 4
# The distance of rows; not a power of two, which would put them all into one set of the cache.
_ROW = EXACT_LANES + 24

# Where the rows of a block's workspace begin; row + i belongs to lane i, or to column i. The
# states, and the tangent vectors, have two rows: for the starts of even steps, and of odd ones.
_Y, _W, _TANGENTS = 0, 2 * _ROW, 4 * _ROW
_FLOW = _TANGENTS + 8 * _ROW
_EQUATION = _FLOW + 12 * _ROW
_RESTING, _WAKE, _SLEPT = range(_EQUATION + 8 * _ROW, _EQUATION + 11 * _ROW, _ROW)
# Of the columns: the equation, the states at both ends of the step, the tangent vectors, the
# impact, and what is proved of it.
_COLUMN = _SLEPT + _ROW
_Y_0, _W_0, _Y_T, _W_T, _PAIR = range(_COLUMN + 8 * _ROW, _COLUMN + 13 * _ROW, _ROW)
_U, _W_I, _PROVED = range(_PAIR + 4 * _ROW, _PAIR + 7 * _ROW, _ROW)
_SIZE = _PROVED + _ROW


class Block(NamedTuple):
    """The memory of a block of points: the rows, the list of lanes, and that of one step."""

    w: np.ndarray
    met: np.ndarray
    scratch: Scratch


@jit
def new_block():
    """Return the memory of a block; one per thread."""
    return Block(aligned(_SIZE), np.zeros(EXACT_LANES + _COLUMNS, np.int64), new_scratch())


@jit(inline=True)
def flow_in(w, i):
    """Return the ``Flow`` of lane `i`."""
    f = _FLOW + i
    return Flow(
        w[f], w[f + _ROW], w[f + 2 * _ROW], w[f + 3 * _ROW], w[f + 4 * _ROW], w[f + 5 * _ROW],
        w[f + 6 * _ROW], w[f + 7 * _ROW], w[f + 8 * _ROW], w[f + 9 * _ROW], w[f + 10 * _ROW],
        w[f + 11 * _ROW],
    )  # fmt: skip


@jit(inline=True)
def equation_in(w, e):
    """Return the ``Equation`` in the rows that begin at `e`."""
    return Equation(
        w[e], w[e + _ROW], w[e + 2 * _ROW], w[e + 3 * _ROW], w[e + 4 * _ROW], w[e + 5 * _ROW],
        w[e + 6 * _ROW], w[e + 7 * _ROW],
    )  # fmt: skip


@jit(inline=True)
def pair_in(w, a, distance):
    """Return two tangent vectors, whose rows begin at `a` and are so far apart."""
    return w[a], w[a + distance], w[a + 2 * distance], w[a + 3 * distance]


@jit(inline=True)
def put_pair(w, a, distance, pair):
    """Set two tangent vectors, as ``pair_in``."""
    w[a], w[a + distance], w[a + 2 * distance], w[a + 3 * distance] = pair


@jit
def set_start(w, points, s):
    """Put every lane at its start, at a phase with the sine `s`."""
    for i in range(EXACT_LANES):
        pt = points[min(i, points.size - 1)]  # a short block repeats its last point
        x, v, resting = start(pt, s)
        w[_Y + i], w[_W + i] = enter(x, v, pt)
        w[_RESTING + i], w[_WAKE + i], w[_SLEPT + i] = 1.0 if resting else 0.0, -math.inf, 0.0
        put_pair(w, _TANGENTS + i, 2 * _ROW, (1.0, 0.0, 0.0, 1.0 / pt.omega))


@jit
def set_equations(w, points, step, coefficients):
    """Give every lane its equation and its flow for steps of that length."""
    for i in range(EXACT_LANES):
        k = min(i, points.size - 1)
        if i == k:
            eq = equation_of(points[k], step)
            flow = flow_of(eq, step, coefficients)
        for q in range(12):
            w[_FLOW + q * _ROW + i] = flow[q]
        for q in range(8):
            w[_EQUATION + q * _ROW + i] = eq[q]


@jit(refcounts=False)
def glide_lanes(w, met, size, grid, n):
    """Take all lanes over step `n`; list those that may have met the stop, and return how many.

    A lane that is at rest throughout the step is not listed.
    """
    widest_vectors()
    old_row, new_row, third = (n & 1) * _ROW, (~n & 1) * _ROW, grid.step / 3.0
    s, c, theta = grid.table[SIN, n], grid.table[COS, n], grid.table[THETA, n] + grid.step
    listed = 0
    for q in range((size + WORD - 1) // WORD):
        first, bits = WORD * q, 0
        for i in range(first, first + WORD):
            y, v, high = glide(flow_in(w, i), w[_Y + old_row + i], w[_W + old_row + i], s, c, third)
            w[_Y + new_row + i], w[_W + new_row + i] = y, v
            bits |= bit(not high < 0.0, i - first)
        if first + WORD > size:
            bits &= (1 << (size - first)) - 1
        while bits != 0:  # ends: one bit less each time
            i = first + lowest_bit(bits)
            bits &= bits - 1
            if theta < w[_WAKE + i] - 1e-9:
                w[_Y + new_row + i] = w[_W + new_row + i] = 0.0
                w[_SLEPT + i] += 1.0
            else:
                met[listed] = i
                listed += 1
    return listed


@jit(refcounts=False)
def glide_all_tangents(w, n):
    """Take the tangent vectors of all lanes over step `n`."""
    widest_vectors()
    old_row, new_row = (n & 1) * _ROW, (~n & 1) * _ROW
    for i in range(EXACT_LANES):
        pair = glide_tangents(flow_in(w, i), pair_in(w, _TANGENTS + old_row + i, 2 * _ROW))
        put_pair(w, _TANGENTS + new_row + i, 2 * _ROW, pair)


@jit(refcounts=False)
def mend_columns(w, waves, step):
    """Mend the first columns of `w`, side by side."""
    widest_vectors()
    for j in range(_COLUMNS):
        begin, end = (w[_Y_0 + j], w[_W_0 + j]), (w[_Y_T + j], w[_W_T + j])
        w[_Y_T + j], w[_W_T + j], w[_U + j], w[_W_I + j], w[_PROVED + j] = single_impact(
            equation_in(w, _COLUMN + j), begin, end, waves, step, 1
        )


@jit(refcounts=False)
def carry_columns(w, wave, step):
    """Carry the tangent vectors of the first columns of `w` through their impacts."""
    widest_vectors()
    for j in range(_COLUMNS):
        pair, u, w_i = pair_in(w, _PAIR + j, _ROW), w[_U + j], w[_W_I + j]
        pair = tangents_through_impact(equation_in(w, _COLUMN + j), pair, u, w_i, wave, step)
        put_pair(w, _PAIR + j, _ROW, pair)


@jit(refcounts=False)
def mend_side_by_side(block, listed, grid, n):
    """Find the impact, if any, of each listed lane in step `n`."""
    w, met, table = block.w, block.met, grid.table
    old_row, new_row = (n & 1) * _ROW, (~n & 1) * _ROW
    for j in range(listed):
        i = met[j] & (EXACT_LANES - 1)  # so that LLVM sees that it is not negative
        for q in range(8):
            w[_COLUMN + q * _ROW + j] = w[_EQUATION + q * _ROW + i]
        w[_Y_0 + j], w[_W_0 + j] = w[_Y + old_row + i], w[_W + old_row + i]
        w[_Y_T + j], w[_W_T + j] = w[_Y + new_row + i], w[_W + new_row + i]
    waves = table[SIN, n], table[COS, n], table[SIN, n + 1], table[COS, n + 1]
    for lo in range(0, listed, _COLUMNS):
        mend_columns(w[lo:], waves, grid.step)


@jit(refcounts=False)
def mend_tangents(block, listed, grid, n):
    """Carry the tangent vectors of each listed lane with a single impact through that impact."""
    w, met, _ = block
    old_row, new_row = (n & 1) * _ROW, (~n & 1) * _ROW
    for j in range(listed):
        pair = pair_in(w, _TANGENTS + old_row + (met[j] & (EXACT_LANES - 1)), 2 * _ROW)
        put_pair(w, _PAIR + j, _ROW, pair)
    for lo in range(0, listed, _COLUMNS):
        carry_columns(w[lo:], (grid.table[SIN, n], grid.table[COS, n]), grid.step)
    for j in range(listed):
        if w[_PROVED + j] == ONLY:
            a = _TANGENTS + new_row + (met[j] & (EXACT_LANES - 1))
            put_pair(w, a, 2 * _ROW, pair_in(w, _PAIR + j, _ROW))


@jit(refcounts=False)
def settle_columns(block, listed, points, grid, n, recording, tally):
    """Take the lanes with a single impact to the end of step `n`, and record the impact.

    Returns how many lanes are left. They are moved to the front of the list, and their first
    impacts to the front of the columns.
    """
    w, met, _ = block
    theta, new_row, left = grid.table[THETA, n], (~n & 1) * _ROW, 0
    for j in range(listed):
        i = met[j] & (EXACT_LANES - 1)
        if w[_PROVED + j] == ONLY:
            w[_Y + new_row + i], w[_W + new_row + i] = w[_Y_T + j], w[_W_T + j]
            if recording:
                speed = w[_W_I + j] * points[i].omega
                list_impact(tally.impacts[i], tally.sums[i], theta + w[_U + j], speed)
        else:
            met[left], w[_U + left], w[_W_I + left] = i, w[_U + j], w[_W_I + j]
            w[_PROVED + left] = w[_PROVED + j]
            left += 1
    return left


@jit(refcounts=False)
def stretch(pair, sums):
    """Orthonormalise two tangent vectors, and add up their growth."""
    pair, growth_1, growth_2 = orthonormalise(pair)
    sums.growth_1 += growth_1
    sums.growth_2 += growth_2
    return pair


@jit(refcounts=False)
def stretch_lanes(w, points, parity, tally):
    """Orthonormalise the tangent vectors that would soon be too short, too long or too parallel."""
    for i in range(points.size):
        a = _TANGENTS + (parity & 1) * _ROW + i
        ay, aw, by, bw = pair_in(w, a, 2 * _ROW)
        size = ay * ay + aw * aw + by * by + bw * bw
        if abs(ay * bw - aw * by) < 1e-4 * size or not 1e-100 < size < 1e100:
            put_pair(w, a, 2 * _ROW, stretch((ay, aw, by, bw), tally.sums[i]))


@jit(refcounts=False)
def take_carefully(block, j, points, grid, n, recording, carrying, tally):
    """Take the lane at place `j` of the list over step `n`, with every impact in it."""
    w, met, scratch = block
    i, old_row, new_row = met[j] & (EXACT_LANES - 1), (n & 1) * _ROW, (~n & 1) * _ROW
    pt, sums, table, step = points[i], tally.sums[i], grid.table, grid.step
    theta = table[THETA, n]
    eq, was_resting = equation_in(w, _EQUATION + i), w[_RESTING + i] > 0.0
    y, v, resting, n_events, rested, status, grazes = exact_step(
        eq, pt, (w[_Y + old_row + i], w[_W + old_row + i], was_resting),
        (w[_Y + new_row + i], w[_W + new_row + i]),
        (0.0, 0.0, w[_U + j], w[_W_I + j], w[_PROVED + j]),
        (theta, table[SIN, n], table[COS, n]), step, scratch,
    )  # fmt: skip
    w[_Y + new_row + i], w[_W + new_row + i], w[_RESTING + i] = y, v, 1.0 if resting else 0.0
    w[_WAKE + i] = -math.inf
    if resting:
        w[_WAKE + i] = theta + step + pt.omega * time_to_release(theta + step, pt)
    sums.status = max(sums.status, status)
    if recording:
        rested /= pt.omega
        record_step(scratch.events, n_events, pt.clearance, rested, theta, pt, i, tally)
        sums.near_grazes += grazes
    if carrying:
        pair = pair_in(w, _TANGENTS + old_row + i, 2 * _ROW)
        if was_resting:
            pair = 0.0, 0.0, 0.0, 0.0
        pair = carry_tangents(
            (eq, flow_in(w, i)), pair, scratch.events, n_events, theta, step, pt.omega
        )
        put_pair(w, _TANGENTS + new_row + i, 2 * _ROW, pair)


@jit(refcounts=False)
def advance(block, points, grid, recording, carrying, tally):
    """Take a block over the steps of `grid`, step by step."""
    w, count = block.w, grid.size
    for n in range(count):
        listed = glide_lanes(w, block.met, points.size, grid, n)
        if carrying:
            glide_all_tangents(w, n)
        if listed > 0:
            mend_side_by_side(block, listed, grid, n)
            if carrying:
                mend_tangents(block, listed, grid, n)
            left = settle_columns(block, listed, points, grid, n, recording, tally)
            for j in range(left):
                take_carefully(block, j, points, grid, n, recording, carrying, tally)
        if carrying and ((n + 1) % _STRIDE == 0 or n + 1 == count):
            stretch_lanes(w, points, n + 1, tally)
    if count & 1:
        for a in range(0, _FLOW if carrying else _TANGENTS, 2 * _ROW):  # the next step is even
            for i in range(a, a + EXACT_LANES):
                w[i] = w[i + _ROW]


@jit(refcounts=False)
def pass_section(w, points, k, step, tally):
    """Round the states to (x, v), and store them as section `k` if it is not negative."""
    for i in range(points.size):
        pt = points[i]
        x, v = leave(w[_Y + i], w[_W + i], pt)
        w[_Y + i], w[_W + i] = enter(x, v, pt)
        w[_WAKE + i] -= 2.0 * math.pi  # the grid's phases begin again
        if k >= 0:
            tally.sums[i].rested += w[_SLEPT + i] * step / pt.omega
            record_section(x, v, i, k, tally)
        w[_SLEPT + i] = 0.0


@jit
def run_exact(block, points, run, tally):
    """Run a block of at most ``EXACT_LANES`` points from its start to the end of the record."""
    w, transient, (_, lead, grid) = block.w, run.transient, run.stepping
    set_start(w, points, sine_at_start(lead, grid))
    # The lead-in is the period before the transient: `advance` is called, and compiled, once.
    for k in range(-transient - 1, run.periods):
        if is_set(run.interrupt):
            break
        steps = lead if k < -transient else grid
        if k <= -transient:
            set_equations(w, points, steps.step, block.scratch.coefficients)
        if k == 0:
            for i in range(points.size):
                if w[_RESTING + i] > 0.0:  # nothing is left of its past
                    put_pair(w, _TANGENTS + i, 2 * _ROW, (0.0, 0.0, 0.0, 0.0))
        advance(block, points, steps, k >= 0, k >= 0 and run.lyapunov, tally)
        if k >= -transient:
            pass_section(w, points, k, steps.step, tally)
    if run.lyapunov:
        for i in range(points.size):
            ay, aw, by, bw = pair_in(w, _TANGENTS + i, 2 * _ROW)
            omega = points[i].omega
            stretch((ay, aw * omega, by, bw * omega), tally.sums[i])
