"""The extremes of lanes with exact impacts.

See ``turning_points.py``. Nothing widens the reach of a lane that is not recorded.
"""

from __future__ import annotations

import math

from vibroimpact.jit import jit
from vibroimpact.kernel.exact_impacts import (
    AT,
    BOUND,
    COLUMN_COEFFICIENTS,
    COLUMN_ROW,
    EXTREME,
    FLOOR,
    PROVED,
    W_1,
    W_I,
    W_T,
    Y_1,
    Y_T,
    coefficients_in,
    fill_columns,
    find_turns,
    flight_in,
)
from vibroimpact.kernel.workspace import (
    COLUMNS,
    EXCESS,
    GUARD,
    LANES,
    LEAST,
    MOST,
    VECTOR,
    list_lanes,
)
from vibroimpact.step.impact import FREE, NOTHING, FreeEnd, Impact
from vibroimpact.step.scheme import COS, SIN
from vibroimpact.step.turning_points import reach_with, widen_by_impact


@jit
def widen_by_column(workspace, i, j, grid, n):
    """Widen the reach of lane `i` by the flight in column `j`, if its bounds say that it may."""
    lanes, c, table = workspace.lanes, workspace.columns, grid.table
    reach, proved = (lanes[LEAST + i], lanes[MOST + i]), c[PROVED + j]
    if proved == NOTHING:
        return
    if c[FLOOR + j] < reach[0] or (proved == FREE and reach[1] < 0.0):
        waves = (table[SIN, n], table[COS, n]), (table[SIN, n + 1], table[COS, n + 1])
        free = FreeEnd(c[Y_T + j], c[W_T + j], c[BOUND + j])
        impact = Impact(c[Y_1 + j], c[W_1 + j], c[AT + j], c[W_I + j], proved, free)
        eq = coefficients_in(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW)
        reach = widen_by_impact(
            eq, flight_in(c, j), impact, waves, grid.phase_step, workspace.scratch.coefficients,
            reach,
        )  # fmt: skip
        lanes[LEAST + i], lanes[MOST + i] = reach
    elif proved != FREE:
        lanes[MOST + i] = 0.0


@jit
def turn_lanes(workspace, size, grid, n):
    """Widen the reach of those of the first lanes that have no impact in step `n`."""
    lanes, c, turning, table = workspace.lanes, workspace.columns, workspace.turning, grid.table
    listed = 0
    for j in range(list_lanes(lanes, EXCESS, turning, size)):
        i = turning[j] & (LANES - 1)
        turning[listed] = i
        listed += lanes[GUARD + i] < 0.0
    waves = (table[SIN, n], table[COS, n]), (table[SIN, n + 1], table[COS, n + 1])
    for lo in range(0, listed, COLUMNS):
        count = min(COLUMNS, listed - lo)
        fill_columns(workspace, turning, lo, count, n, False)
        find_turns(c, (count + VECTOR - 1) // VECTOR, waves, grid.phase_step)
        for j in range(count):
            i = turning[lo + j] & (LANES - 1)
            reach, y, y_T = (lanes[LEAST + i], lanes[MOST + i]), c[EXTREME + j], c[Y_T + j]
            if math.isnan(y):
                eq = coefficients_in(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW)
                free = FreeEnd(y_T, c[W_T + j], c[BOUND + j])
                impact = Impact(y_T, c[W_T + j], 0.0, 0.0, FREE, free)
                reach = widen_by_impact(
                    eq, flight_in(c, j), impact, waves, grid.phase_step,
                    workspace.scratch.coefficients, reach,
                )  # fmt: skip
            else:
                reach = reach_with(reach, min(y, y_T), min(max(y, y_T), 0.0))
            lanes[LEAST + i], lanes[MOST + i] = reach
