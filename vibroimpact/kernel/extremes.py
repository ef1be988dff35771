"""Widens the extremes of lanes: finds steps that may, and turns, side by side.

See ``turning_points.py``. A lane is watched while it is recorded, but not in a period for which it
is near its free oscillation, or once it is proved that nothing widens its extremes again. Whole
steps that may turn are collected over a period, so that even few of them fill vectors.
"""

from __future__ import annotations

import math

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
    free_end_in,
)
from vibroimpact.kernel.workspace import (
    BOUND_BY_X,
    CLEARANCE,
    COEFFICIENTS,
    COEFFICIENTS_SIZE,
    COLUMNS,
    FORMS,
    GUARD,
    LANES,
    LEAST,
    MOST,
    ROW,
    STEADY,
    VECTOR,
    WATCHED,
    W,
    Y,
    any_exceeds,
    list_lanes,
    whole_vectors,
)
from vibroimpact.step.impact import Impact
from vibroimpact.step.propagator import (
    Steady,
    bound_factors,
    is_near,
    remainder_bound,
    stays_within,
    steady_of,
    turns_near,
)
from vibroimpact.step.scheme import COS, SIN
from vibroimpact.step.turning_points import (
    bounds,
    extremes_with,
    goes_one_way,
    may_widen,
    widen_by_flight,
    widen_by_impact,
    widen_near,
)


@jit
def set_steady(lanes, i, pt, grid):
    """Give lane `i` the ``Steady`` of its point, and the bound of its turning points."""
    steady = steady_of(pt, grid)
    for q in range(7):
        lanes[STEADY + q * ROW + i] = steady[q]
    lanes[FORMS + i] = 0.0
    eq = coefficients_in(lanes, COEFFICIENTS + COEFFICIENTS_SIZE * i, 1)
    _, _, lanes[BOUND_BY_X + i] = bound_factors(eq, 0.0, grid.phase_step)


@inlined
def steady_in(lanes, i):
    """Return the ``Steady`` of lane `i`."""
    s = STEADY + i
    return Steady(
        lanes[s], lanes[s + ROW], lanes[s + 2 * ROW], lanes[s + 3 * ROW], lanes[s + 4 * ROW],
        lanes[s + 5 * ROW], lanes[s + 6 * ROW],
    )  # fmt: skip


@jit
def find_watched(lanes, size):
    """Set the rows WATCHED, and GUARD of lanes that are near their free oscillation."""
    widest_vectors()
    for i in range(whole_vectors(size)):
        steady, y, w = steady_in(lanes, i), lanes[Y + i], lanes[W + i]
        settled = stays_within(steady, y, w, (lanes[LEAST + i], lanes[MOST + i]))
        near, done = is_near(steady, y, w), settled | (lanes[WATCHED + i] == -1.0)
        lanes[WATCHED + i] = select(done, -1.0, select(near, -0.5, 1.0))
        lanes[GUARD + i] = select(near & (not done), 1.0, -1.0)


@jit
def begin_period(workspace, size, grid):
    """Widen the extremes of lanes that are near by a period; return whether any are watched."""
    lanes, met = workspace.lanes, workspace.met
    find_watched(lanes, size)
    for j in range(list_lanes(lanes, met, size)):
        i = met[j] & (LANES - 1)
        steady, f = steady_in(lanes, i), FORMS + i
        if lanes[f] == 0.0:
            eq = coefficients_in(lanes, COEFFICIENTS + COEFFICIENTS_SIZE * i, 1)
            low, high = turns_near(eq, steady, grid.phase_step)
            lanes[f], lanes[f + ROW] = low
            lanes[f + 2 * ROW], lanes[f + 3 * ROW] = high
        forms = (lanes[f], lanes[f + ROW]), (lanes[f + 2 * ROW], lanes[f + 3 * ROW])
        lanes[LEAST + i], lanes[MOST + i] = widen_near(
            steady, forms, lanes[Y + i], lanes[W + i], (lanes[LEAST + i], lanes[MOST + i])
        )
    return any_exceeds(lanes, WATCHED, 0.0, size)


@jit
def widen_by_column(workspace, i, j, grid, n):
    """Widen the extremes of lane `i` by the flight in column `j`."""
    lanes, c, table = workspace.lanes, workspace.columns, grid.table
    waves = (table[SIN, n], table[COS, n]), (table[SIN, n + 1], table[COS, n + 1])
    free = free_end_in(c, j)
    impact = Impact(c[Y_1 + j], c[W_1 + j], c[AT + j], c[W_I + j], c[PROVED + j], free)
    lanes[LEAST + i], lanes[MOST + i] = widen_by_impact(
        coefficients_in(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW), flight_in(c, j), impact, waves,
        grid.phase_step, workspace.scratch.coefficients, (lanes[LEAST + i], lanes[MOST + i]),
    )  # fmt: skip


@jit
def widen_by_lane(workspace, i, grid, n):
    """Widen the extremes of lane `i` by step `n`, without impact; list the step if it may turn."""
    lanes, c, turning, table = workspace.lanes, workspace.turns, workspace.turning, grid.table
    old, new = (n & 1) * ROW + i, (~n & 1) * ROW + i
    y, w, y_T, w_T = lanes[Y + old], lanes[W + old], lanes[Y + new], lanes[W + new]
    f = COEFFICIENTS + COEFFICIENTS_SIZE * i + 5
    factors = lanes[f], lanes[f + 1], lanes[BOUND_BY_X + i]
    bound = remainder_bound(factors, y + lanes[CLEARANCE + i], w)
    extremes = lanes[LEAST + i], lanes[MOST + i]
    if goes_one_way(y, w, y_T, w_T, grid.phase_step, bound):
        lanes[LEAST + i], lanes[MOST + i] = extremes_with(extremes, y_T, y_T)
        return
    if not may_widen(extremes, bounds(y, w, y_T, w_T, grid.phase_step, bound)):
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
    """Widen the extremes of lanes by their listed steps, and empty the list."""
    lanes, c, turning = workspace.lanes, workspace.turns, workspace.turning
    count, turning[COLUMNS] = turning[COLUMNS], 0
    vectors = (count + VECTOR - 1) // VECTOR
    for vector in range(vectors):
        j = VECTOR * vector & (COLUMNS - 1)  # the mask shows LLVM that it is not negative
        transpose(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW, lanes, COEFFICIENTS, turning, j)
    find_turns(c, vectors, phase_step)
    for j in range(count):
        i, y, y_T = turning[j] & (LANES - 1), c[EXTREME + j], c[Y_T + j]
        extremes = lanes[LEAST + i], lanes[MOST + i]
        if math.isnan(y):
            extremes = widen_by_flight(
                coefficients_in(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW), flight_in(c, j),
                free_end_in(c, j), (c[S_T + j], c[C_T + j]),
                (y_T, c[W_T + j], phase_step), phase_step, workspace.scratch.coefficients, extremes,
            )  # fmt: skip
        else:
            extremes = extremes_with(extremes, min(y, y_T), min(max(y, y_T), 0.0))
        lanes[LEAST + i], lanes[MOST + i] = extremes
