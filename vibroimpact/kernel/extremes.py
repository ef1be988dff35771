"""Lanes whose steps may widen their extremes, found and evaluated side by side.

See ``turning_points.py``. A lane is watched while it is recorded, but not in a period for which it
is near its free oscillation, or for which it is proved that nothing widens its reach again. Whole
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
)
from vibroimpact.kernel.workspace import (
    CLEARANCE,
    COEFFICIENTS,
    COEFFICIENTS_SIZE,
    COLUMNS,
    FORMS,
    GUARD,
    LANES,
    LEAST,
    LIMIT,
    MOST,
    PERIOD,
    ROW,
    STEADY,
    VECTOR,
    WATCHED,
    W,
    Y,
    any_listed,
    list_lanes,
    put_tangent,
    tangent_in,
    whole_vectors,
)
from vibroimpact.step.impact import FreeEnd, Impact
from vibroimpact.step.propagator import remainder_bound
from vibroimpact.step.scheme import COS, SIN
from vibroimpact.step.turning_points import (
    EVERYTHING,
    Steady,
    goes_one_way,
    is_near,
    reach_of_x,
    reach_with,
    steady_of,
    turns_near,
    widen_by_flight,
    widen_by_impact,
    widen_near,
)

#: After so many periods it is asked which lanes never widen their reach again; an answer that comes
#: later changes no bit.
_JUDGED_EVERY = 4


@inlined
def steady_in(lanes, i):
    """Return the ``Steady`` of lane `i`."""
    s = STEADY + i
    return Steady(
        lanes[s], lanes[s + ROW], lanes[s + 2 * ROW], lanes[s + 3 * ROW], lanes[s + 4 * ROW],
        lanes[s + 5 * ROW], lanes[s + 6 * ROW],
    )  # fmt: skip


@jit
def find_near(lanes, size):
    """Set the GUARD of lanes that may be near their free oscillation; the others are WATCHED."""
    widest_vectors()
    for i in range(whole_vectors(size)):
        recorded = lanes[LEAST + i] > -math.inf
        near = abs(lanes[W + i] - lanes[STEADY + ROW + i]) < lanes[LIMIT + i]
        lanes[GUARD + i] = select(recorded & near, 1.0, -1.0)
        lanes[WATCHED + i] = select(recorded & (not near), 1.0, -1.0)


@jit
def begin_period(workspace, i, grid):
    """Widen the reach of lane `i` by its next period, if it is near its free oscillation."""
    lanes, f, y, w = workspace.lanes, FORMS + i, workspace.lanes[Y + i], workspace.lanes[W + i]
    if lanes[LIMIT + i] == math.inf:
        steady = steady_of(workspace.points[i], grid)
        for q in range(7):
            lanes[STEADY + q * ROW + i] = steady[q]
        lanes[f] = math.nan
    steady = steady_in(lanes, i)
    if not is_near(steady, y, w):
        lanes[WATCHED + i] = 1.0
        return
    if math.isnan(lanes[f]):
        eq = coefficients_in(lanes, COEFFICIENTS + COEFFICIENTS_SIZE * i, 1)
        low, high = turns_near(eq, steady, grid.phase_step)
        put_tangent(lanes, f, ROW, low)
        put_tangent(lanes, f + 2 * ROW, ROW, high)
    forms = tangent_in(lanes, f, ROW), tangent_in(lanes, f + 2 * ROW, ROW)
    reach = lanes[LEAST + i], lanes[MOST + i]
    lanes[LEAST + i], lanes[MOST + i] = widen_near(steady, forms, y, w, reach)


@jit
def find_settled(lanes, size):
    """Set the GUARD of lanes that never widen their reach again.

    In the norm hypot(y, omega w / p) a motion comes ever nearer to the free oscillation, as long as
    it is free; and it is free if its reach includes the free oscillation and this distance.
    """
    widest_vectors()
    for i in range(whole_vectors(size)):
        steady, least = steady_in(lanes, i), lanes[LEAST + i]
        y, w = lanes[Y + i] - steady.y, steady.ratio * (lanes[W + i] - steady.w)
        room = min(steady.low - least, lanes[MOST + i] - steady.high) - steady.rounding
        settled = (room > 0.0) & (room * room > y * y + w * w) & (least > -math.inf)
        lanes[GUARD + i] = select(settled & (lanes[LIMIT + i] < math.inf), 1.0, -1.0)


@jit
def watch_period(batch, grid):
    """Return whether any lane is watched over the next period."""
    workspace, record, size = batch
    lanes, met = workspace.lanes, workspace.met
    if not any_listed(lanes, PERIOD, size):
        return False
    if int(lanes[PERIOD]) % _JUDGED_EVERY == 0:
        find_settled(lanes, size)
        for j in range(list_lanes(lanes, GUARD, met, size)):
            i, reach = met[j], record.reach[workspace.rows[met[j]]]
            own = lanes[LEAST + i], lanes[MOST + i]
            reach[0], reach[1] = reach_of_x(own, reach[0], reach[1], lanes[CLEARANCE + i], True)
            lanes[LEAST + i], lanes[MOST + i] = EVERYTHING
    find_near(lanes, size)
    for j in range(list_lanes(lanes, GUARD, met, size)):
        begin_period(workspace, met[j] & (LANES - 1), grid)
    return any_listed(lanes, WATCHED, size)


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
