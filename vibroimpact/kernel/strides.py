"""The loop of time stepping, its force from a table; lanes that met the stop repeat a stride.

A stride is a few steps. Every lane is taken over it by its affine map as if there were no stop. A
lane that may meet the stop in a stride stays at its start, and is then taken through the stride
alone, step by step, as a single orbit is. With ``reduced-step`` most of these lanes are first tried
side by side, see ``reduced_step_impacts.py``. The rule ``plain`` needs only selects.
"""

from __future__ import annotations

import math

from vibroimpact.jit import fma, inlined, jit, select, specialised, widest_vectors
from vibroimpact.kernel.record import list_impact, record_step
from vibroimpact.kernel.reduced_step_impacts import (
    C_0,
    OF_CLEARANCE,
    OF_F,
    OF_H,
    OF_OMEGA,
    OF_P,
    OF_R,
    REMAINDER,
    S_0,
    SINGLE,
    STEP,
    T_R,
    THETA_0,
    V_0,
    V_T,
    V_TR,
    X_0,
    X_T,
    shorten_steps,
    take_remainders,
)
from vibroimpact.kernel.workspace import (
    AT_REST,
    CLEARANCE,
    COLUMNS,
    GREATEST,
    GUARD,
    LEAST,
    LEVEL,
    MAP,
    MOST,
    OMEGA,
    PERIOD,
    POSITION,
    RESTITUTION,
    ROW,
    SPEEDS,
    THIRD,
    VELOCITY,
    any_exceeds,
    list_lanes,
    set_rest,
    sleeps_until,
    whole_vectors,
)
from vibroimpact.step.integrators import affine_map, apply_map
from vibroimpact.step.scheme import COS, PLAIN, REDUCED_STEP, SIN, THETA
from vibroimpact.step.stepper import take_step
from vibroimpact.step.turning_points import widen_by_step

#: The GUARD of a lane that may widen its extremes.
WIDENS = 2.0
#: Steps in a stride; the numbers of a lane stay in registers meanwhile.
STRIDE = 4


@specialised
def set_map(workspace, i, integrator, grid):
    """Give lane `i` its affine map of one step of `grid`."""
    pt = workspace.points[i]
    rows = affine_map(integrator, grid.phase_step / pt.omega, pt)
    workspace.lanes[THIRD + i] = grid.phase_step / pt.omega * (1.0 / 3.0)
    for k in range(8):
        workspace.lanes[MAP + k * ROW + i] = rows[k]


@jit
def map_of(lanes, i):
    """Return the two rows of the affine map of lane `i`."""
    m = MAP + i
    return (
        (lanes[m], lanes[m + ROW], lanes[m + 2 * ROW], lanes[m + 3 * ROW]),
        (lanes[m + 4 * ROW], lanes[m + 5 * ROW], lanes[m + 6 * ROW], lanes[m + 7 * ROW]),
    )


@jit
def step_lane(lanes, i, x, v, s, c):
    """Take lane `i` from (x, v) over a step; return the state, and whether x is below its LEVEL."""
    to_x, to_v = map_of(lanes, i)
    x_T, v_T = apply_map(to_x, x, v, s, c), apply_map(to_v, x, v, s, c)
    return x_T, v_T, x_T < lanes[LEVEL + i]  # False for a NaN


@inlined
def _bounded(extremes, start, end, third):
    """Return bounds that hold for another step, too, from (x, v) to (x, v); see ``bounds``."""
    P, Q = fma(start[1], third, start[0]), fma(-end[1], third, end[0])
    return min(min(extremes[0], P), Q), max(max(extremes[1], P), Q)


@inlined
def _is_within(lanes, i, bounds):
    """Whether the extremes of lane `i` include others."""
    return (bounds[0] >= lanes[LEAST + i]) & (bounds[1] <= lanes[MOST + i])


@specialised
def _step_span(lanes, size, table, n, span, watching):
    for i in range(whole_vectors(size)):
        x, v, safe = lanes[POSITION + i], lanes[VELOCITY + i], True
        bounds = math.inf, -math.inf
        for q in range(span):
            start = x, v
            x, v, below = step_lane(lanes, i, x, v, table[SIN, n + q], table[COS, n + q])
            safe &= below
            if watching:
                bounds = _bounded(bounds, start, (x, v), lanes[THIRD + i])
        guard = select(safe, -1.0, 1.0)
        if watching:
            within = _is_within(lanes, i, bounds)
            safe &= within
            guard = select(within, guard, WIDENS)
        lanes[POSITION + i] = select(safe, x, lanes[POSITION + i])
        lanes[VELOCITY + i] = select(safe, v, lanes[VELOCITY + i])
        lanes[GUARD + i] = guard


@jit
def step_lanes(lanes, size, table, n, span, turning):
    """Take the first lanes over a stride from step `n`, or over a single step.

    A lane that may meet its stop stays where it is, and its GUARD is not negative. If `turning` is
    not None, so does a lane that may widen its extremes, with the GUARD ``WIDENS``.
    """
    widest_vectors()
    watching = turning is not None
    if span == STRIDE:
        _step_span(lanes, size, table, n, STRIDE, watching)
    else:
        _step_span(lanes, size, table, n, 1, watching)


@jit
def plain_step(lanes, i, x, v, table, n, row, recording):
    """Take lane `i` from (x, v) over step `n` with the rule (2)-(5): selects instead of branches.

    Returns the states after and before an impact. Its speed goes to the `row`. A displacement that
    overflowed counts as an impact, too. If the speed did not overflow, the state after it is right;
    only the penetration, inf, is lost, so a record with this step has failed.
    """
    to_x, to_v = map_of(lanes, i)
    s, c = table[SIN, n], table[COS, n]
    x_T, v_T = apply_map(to_x, x, v, s, c), apply_map(to_v, x, v, s, c)
    # Loaded in every lane: a processor without masked loads takes no vectors otherwise.
    stop, R = lanes[CLEARANCE + i], lanes[RESTITUTION + i]
    impact = (x_T >= stop) & (v_T > 0.0)
    if recording:
        lanes[row] = select(impact, v_T, math.inf)
        lanes[GUARD + i] = select(impact, 1.0, lanes[GUARD + i])
        lanes[GREATEST + i] = select(x_T > lanes[GREATEST + i], x_T, lanes[GREATEST + i])
    return (select(impact, stop, x_T), select(impact, -R * v_T, v_T)), (x_T, v_T)


@specialised
def _plain_span(lanes, size, table, n, span, recording, watching):
    for i in range(whole_vectors(size)):
        x, v = lanes[POSITION + i], lanes[VELOCITY + i]
        if recording:
            lanes[GUARD + i] = -1.0
        now, third, bounds = (x, v), lanes[THIRD + i], (math.inf, -math.inf)
        for q in range(span):
            start, row = now, i + SPEEDS + q * ROW
            now, end = plain_step(lanes, i, *start, table, n + q, row, recording)
            bounds = _bounded(bounds, start, end, third)
        if watching:
            within = _is_within(lanes, i, bounds)
            now = select(within, now[0], x), select(within, now[1], v)
            lanes[GUARD + i] = select(within, lanes[GUARD + i], WIDENS)
        lanes[POSITION + i], lanes[VELOCITY + i] = now


@jit
def plain_lanes(lanes, size, table, n, span, recording, turning):
    """Take the first lanes over a stride from step `n`, or a single step, with the rule ``plain``.

    While recording, the GUARD of lanes with an impact is not negative. If `turning` is not None, a
    lane that may widen its extremes stays where it is, with the GUARD ``WIDENS``.
    """
    widest_vectors()
    watching = turning is not None
    if not recording:
        if span < STRIDE:
            _plain_span(lanes, size, table, n, 1, False, False)
        else:
            _plain_span(lanes, size, table, n, STRIDE, False, False)
    elif span < STRIDE:
        _plain_span(lanes, size, table, n, 1, True, watching)
    else:
        _plain_span(lanes, size, table, n, STRIDE, True, watching)


@jit
def list_plain_impacts(batch, listed, grid, n, span):
    """Record the impacts of the listed lanes in a stride from step `n`."""
    workspace, record, _ = batch
    lanes = workspace.lanes
    for j in range(listed):
        i = workspace.met[j]
        if lanes[PERIOD + i] >= 0.0:
            ring = record.impacts[workspace.rows[i]]
            for q in range(span):
                speed = lanes[SPEEDS + q * ROW + i]
                if speed < math.inf:
                    phase = grid.table[THETA, n + q] + grid.phase_step
                    list_impact(ring, workspace.sums[i], phase, speed)


@jit
def gather(batch, lo, count, table, n):
    """Fill the columns: take each lane from step `n` to the step that may take it to its stop."""
    workspace = batch.workspace
    lanes, columns = workspace.lanes, workspace.columns
    for j in range(count):
        i = workspace.met[lo + j]
        x, v, safe, k = lanes[POSITION + i], lanes[VELOCITY + i], True, n
        for q in range(n, n + STRIDE - 1):
            x_T, v_T, below = step_lane(lanes, i, x, v, table[SIN, q], table[COS, q])
            safe &= below
            x, v, k = select(safe, x_T, x), select(safe, v_T, v), k + safe
        s, c, pt = table[SIN, k], table[COS, k], workspace.points[i]
        columns[X_T + j], columns[V_T + j], _ = step_lane(lanes, i, x, v, s, c)
        columns[STEP + j], columns[THETA_0 + j] = k, table[THETA, k]
        columns[S_0 + j], columns[C_0 + j] = s, c
        columns[X_0 + j], columns[V_0 + j] = x, v
        columns[OF_H + j], columns[OF_R + j], columns[OF_OMEGA + j] = pt.h, pt.R, pt.omega
        columns[OF_F + j], columns[OF_P + j], columns[OF_CLEARANCE + j] = pt.f, pt.p, pt.clearance


@inlined
def _bounds_of_impact(c, j):
    """Return bounds of the step of column `j`, before and after its impact."""
    stop, v_Tr = c[OF_CLEARANCE + j], c[V_TR + j]
    start, end, launch = (c[X_0 + j], c[V_0 + j]), (stop, v_Tr), (stop, -c[OF_R + j] * v_Tr)
    bounds = _bounded((math.inf, -math.inf), start, end, c[T_R + j] * (1.0 / 3.0))
    return _bounded(bounds, launch, (c[X_T + j], c[V_T + j]), c[REMAINDER + j] * (1.0 / 3.0))


@jit
def correct_stepped_lanes(batch, lo, count, left, integrator, grid, n, turning):
    """Take `count` listed lanes, from index `lo` on, over the stride from step `n`.

    A lane for which a single impact is not certain is not moved; it is listed again, after the
    `left` lanes that are listed again so far. Returns the new number of such lanes.
    """
    workspace, record, _ = batch
    lanes, met, c, table = workspace.lanes, workspace.met, workspace.columns, grid.table
    gather(batch, lo, count, table, n)
    shorten_steps(c, count, grid.phase_step)
    take_remainders(c, count, integrator)
    for j in range(count):
        i = met[lo + j]
        x, v, single = c[X_T + j], c[V_T + j], c[SINGLE + j] > 0.0
        if turning is not None:
            single &= lanes[GUARD + i] < WIDENS and _is_within(lanes, i, _bounds_of_impact(c, j))
        for q in range(n + 1, n + STRIDE):
            x_T, v_T, safe = step_lane(lanes, i, x, v, table[SIN, q], table[COS, q])
            later = q > c[STEP + j]
            if turning is not None:
                bounds = _bounded((math.inf, -math.inf), (x, v), (x_T, v_T), lanes[THIRD + i])
                safe &= _is_within(lanes, i, bounds)
            x, v = select(later, x_T, x), select(later, v_T, v)
            single &= safe | (not later)
        if not single:
            met[left] = i
            left += 1
            continue
        lanes[POSITION + i], lanes[VELOCITY + i] = x, v
        if lanes[PERIOD + i] >= 0.0:
            lanes[MOST + i] = math.inf
            phase = c[THETA_0 + j] + lanes[OMEGA + i] * c[T_R + j]
            list_impact(record.impacts[workspace.rows[i]], workspace.sums[i], phase, c[V_TR + j])
    return left


@jit
def resolve_stepped_lane(batch, i, method, grid, n, span, turning):
    """Take lane `i` over `span` steps from step `n`; impacts of ``plain`` are already recorded."""
    workspace, record, _ = batch
    lanes, scratch = workspace.lanes, workspace.scratch
    pt, sums = workspace.points[i], workspace.sums[i]
    table, phase_step = grid.table, grid.phase_step
    recording, ring = lanes[PERIOD + i] >= 0.0, record.impacts[workspace.rows[i]]
    rows = map_of(lanes, i)
    state = lanes[POSITION + i], lanes[VELOCITY + i], lanes[LEVEL + i] == AT_REST
    for k in range(n, n + span):
        theta = table[THETA, k]
        if sleeps_until(lanes, i, theta + phase_step):
            if recording:
                sums.rested += phase_step / pt.omega
            continue
        phase, start = (theta, table[SIN, k], table[COS, k]), state
        x, v, resting, n_events, rested, status = take_step(
            method, rows, state, phase, phase_step, pt, scratch
        )
        state = x, v, resting
        if turning is not None and recording:
            pair = lanes[LEAST + i], lanes[MOST + i]
            least, most = widen_by_step(start, state, n_events, grid, k, pt, scratch.events, pair)
            lanes[LEAST + i], lanes[MOST + i] = least, most if most < pt.clearance else math.inf
        set_rest(lanes, i, resting, theta + phase_step, pt)
        sums.status = max(sums.status, status)
        if recording and method[0] != PLAIN:
            record_step(scratch.events, n_events, rested, theta, pt, ring, sums)
    lanes[POSITION + i], lanes[VELOCITY + i] = state[0], state[1]


@specialised
def take_strides(batch, method, plain, grid, turning):
    """Take all lanes over the steps of `grid` stride by stride, and singly over those left over.

    `plain` says whether the rule is ``plain``. It is a literal, so only that loop is compiled.
    """
    workspace, _, size = batch
    lanes, met = workspace.lanes, workspace.met
    rule, integrator = method
    strides = grid.size // STRIDE
    recording = any_exceeds(lanes, PERIOD, -1.0, size)
    for k in range(strides + grid.size % STRIDE):
        n = k + min(k, strides) * (STRIDE - 1)
        span = STRIDE if k < strides else 1
        if plain:
            plain_lanes(lanes, size, grid.table, n, span, recording, turning)
            if recording:
                listed = list_lanes(lanes, met, size)
                list_plain_impacts(batch, listed, grid, n, span)
                if turning is not None:
                    for j in range(listed):
                        if lanes[GUARD + met[j]] == WIDENS:
                            resolve_stepped_lane(batch, met[j], method, grid, n, span, turning)
            continue
        if turning is not None and recording:
            step_lanes(lanes, size, grid.table, n, span, turning)
        else:
            step_lanes(lanes, size, grid.table, n, span, None)
        listed = list_lanes(lanes, met, size)
        if rule == REDUCED_STEP and span == STRIDE:
            left = 0
            for lo in range(0, listed, COLUMNS):
                count = min(COLUMNS, listed - lo)
                left = correct_stepped_lanes(batch, lo, count, left, integrator, grid, n, turning)
            listed = left
        for j in range(listed):
            resolve_stepped_lane(batch, met[j], method, grid, n, span, turning)
