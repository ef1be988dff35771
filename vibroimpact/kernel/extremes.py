"""Lanes whose steps may widen their extremes, found and evaluated side by side.

See ``turning_points.py``. A lane is watched while it is recorded, until it is proved that nothing
widens its reach again. Whole steps that may turn are collected over a period, so that even few of
them fill vectors.
"""

from __future__ import annotations

import math

from vibroimpact.destination.free_motion import steady_response
from vibroimpact.jit import inlined, jit, select, transpose, widest_vectors
from vibroimpact.kernel.exact_impacts import (
    AT,
    BEGIN,
    BOUND,
    C_0,
    C_T,
    COLUMN_COEFFICIENTS,
    COLUMN_ROW,
    EXTREME,
    PROVED,
    S_0,
    S_T,
    W_0,
    W_1,
    W_I,
    W_T,
    Y_0,
    Y_1,
    Y_T,
    coefficients_in,
    find_turns,
    flight_in,
)
from vibroimpact.kernel.workspace import (
    CLEARANCE,
    COEFFICIENTS,
    COEFFICIENTS_SIZE,
    COLUMNS,
    GUARD,
    LANES,
    LEAST,
    MOST,
    PERIOD,
    ROW,
    STEADY,
    VECTOR,
    W,
    Y,
    list_lanes,
    whole_vectors,
)
from vibroimpact.step.impact import FreeEnd, Impact
from vibroimpact.step.propagator import remainder_bound
from vibroimpact.step.scheme import COS, SIN
from vibroimpact.step.turning_points import (
    goes_one_way,
    reach_of_x,
    reach_with,
    widen_by_flight,
    widen_by_impact,
)

#: Rounding of a step, as a share of a displacement.
_ROUNDING = 2.0**-52


@jit
def set_steady(lanes, i, pt, grid):
    """Give lane `i` the free oscillation of its point."""
    x, v, amplitude = steady_response(pt, grid.table[SIN, 0], grid.table[COS, 0])
    # Each step may be wrong by a rounding error, which is damped from then on.
    periods, size = 1.0 + 0.2 * pt.omega / pt.h, amplitude + abs(pt.clearance)
    most, ratio = amplitude + _ROUNDING * grid.size * periods * size, pt.omega / pt.p
    lanes[STEADY + i], lanes[STEADY + ROW + i] = x - pt.clearance, v / pt.omega
    lanes[STEADY + 2 * ROW + i] = -most - pt.clearance
    lanes[STEADY + 3 * ROW + i] = most - pt.clearance
    lanes[STEADY + 4 * ROW + i] = ratio * ratio


@inlined
def stays_within(lanes, i):
    """Whether lane `i` never widens its reach again, given its free oscillation.

    In the norm hypot(y, omega w / p) a motion comes ever nearer to the free oscillation, as long as
    it is free; and it is free if its reach includes the free oscillation and this distance.
    """
    s = STEADY + i
    y, w = lanes[Y + i] - lanes[s], lanes[W + i] - lanes[s + ROW]
    room = min(lanes[s + 2 * ROW] - lanes[LEAST + i], lanes[MOST + i] - lanes[s + 3 * ROW])
    return (room > 0.0) & (room * room > y * y + lanes[s + 4 * ROW] * w * w)


@jit
def judge_reach(lanes, size):
    """Find watched lanes that never widen their reach again, or whose free oscillation is unknown.

    Their GUARD is not negative. The first period does not ask: most motions that are free in it
    repeat it to the same bits.
    """
    widest_vectors()
    for i in range(whole_vectors(size)):
        due = stays_within(lanes, i) | (lanes[STEADY + 4 * ROW + i] == 0.0)
        due = due & (lanes[PERIOD + i] >= 1.0) & (lanes[LEAST + i] > -math.inf)
        lanes[GUARD + i] = select(due, 1.0, -1.0)


@jit
def stop_watching(batch, grid):
    """Keep the reach of lanes that never widen it again, and watch them no longer."""
    workspace, record, size = batch
    lanes, met = workspace.lanes, workspace.met
    judge_reach(lanes, size)
    for j in range(list_lanes(lanes, GUARD, met, size)):
        i, reach = met[j], record.reach[workspace.rows[met[j]]]
        if lanes[STEADY + 4 * ROW + i] == 0.0:
            set_steady(lanes, i, workspace.points[i], grid)
        if stays_within(lanes, i):
            own = lanes[LEAST + i], lanes[MOST + i]
            reach[0], reach[1] = reach_of_x(own, reach[0], reach[1], lanes[CLEARANCE + i], True)
            lanes[LEAST + i], lanes[MOST + i] = -math.inf, 0.0


@jit
def widen_by_column(workspace, i, j, grid, n):
    """Widen the reach of lane `i` by the flight in column `j`."""
    lanes, c, table = workspace.lanes, workspace.columns, grid.table
    waves = (table[SIN, n], table[COS, n]), (table[SIN, n + 1], table[COS, n + 1])
    free = FreeEnd(c[Y_T + j], c[W_T + j], c[BOUND + j])
    impact = Impact(c[Y_1 + j], c[W_1 + j], c[AT + j], c[W_I + j], c[PROVED + j], free)
    lanes[LEAST + i], lanes[MOST + i] = widen_by_impact(
        coefficients_in(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW), flight_in(c, j), impact, waves,
        grid.phase_step, workspace.scratch.coefficients, (lanes[LEAST + i], lanes[MOST + i]),
    )  # fmt: skip


@jit
def widen_by_lane(workspace, i, grid, n):
    """Widen the reach of lane `i` by step `n`, without impact; list the step if it may turn."""
    lanes, c, turning, table = workspace.lanes, workspace.turns, workspace.turning, grid.table
    old, new = (n & 1) * ROW + i, (~n & 1) * ROW + i
    y, w, y_T, w_T = lanes[Y + old], lanes[W + old], lanes[Y + new], lanes[W + new]
    f = COEFFICIENTS + COEFFICIENTS_SIZE * i + 5
    bound = remainder_bound((lanes[f], lanes[f + 1], lanes[f + 2]), y, w)
    if goes_one_way(y, w, y_T, w_T, grid.phase_step, bound):
        lanes[LEAST + i], lanes[MOST + i] = min(lanes[LEAST + i], y_T), max(lanes[MOST + i], y_T)
        return
    j = turning[COLUMNS] & (COLUMNS - 1)
    turning[j], turning[COLUMNS] = i, j + 1
    c[Y_0 + j], c[W_0 + j], c[Y_T + j], c[W_T + j] = y, w, y_T, w_T
    c[S_0 + j], c[C_0 + j], c[BEGIN + j], c[BOUND + j] = table[SIN, n], table[COS, n], 0.0, bound
    c[S_T + j], c[C_T + j] = table[SIN, n + 1], table[COS, n + 1]
    if j + 1 == COLUMNS:
        widen_by_turns(workspace, grid.phase_step)


@jit
def widen_by_turns(workspace, phase_step):
    """Widen the reach of lanes by their listed steps, and empty the list."""
    lanes, c, turning = workspace.lanes, workspace.turns, workspace.turning
    count, turning[COLUMNS] = turning[COLUMNS], 0
    vectors = (count + VECTOR - 1) // VECTOR
    for vector in range(vectors):
        j = VECTOR * vector & (COLUMNS - 1)  # the mask shows LLVM that it is not negative
        transpose(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW, lanes, COEFFICIENTS, turning, j)
    find_turns(c, vectors, phase_step)
    for j in range(count):
        i, y, y_T = turning[j] & (LANES - 1), c[EXTREME + j], c[Y_T + j]
        reach = lanes[LEAST + i], lanes[MOST + i]
        if math.isnan(y):
            reach = widen_by_flight(
                coefficients_in(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW), flight_in(c, j),
                FreeEnd(y_T, c[W_T + j], c[BOUND + j]), (c[S_T + j], c[C_T + j]),
                (y_T, c[W_T + j], phase_step), phase_step, workspace.scratch.coefficients, reach,
            )  # fmt: skip
        else:
            reach = reach_with(reach, min(y, y_T), min(max(y, y_T), 0.0))
        lanes[LEAST + i], lanes[MOST + i] = reach
