"""The loop of time stepping: all lanes take a stride, and lanes that met the stop repeat it.

A stride is a few steps. Every lane is taken over it by its affine map as if there were no stop. A
lane that may meet the stop in a stride stays at its start, and is then taken through the stride
alone, step by step, as a single orbit is. With ``reduced-step`` most of these lanes are first tried
side by side, see ``reduced_step_impacts.py``. The rule ``plain`` needs only selects.
"""

from __future__ import annotations

import math

from vibroimpact.jit import jit, select, specialised, widest_vectors
from vibroimpact.kernel.record import list_impact, record_step
from vibroimpact.kernel.reduced_step_impacts import (
    C_0,
    OF_CLEARANCE,
    OF_F,
    OF_H,
    OF_OMEGA,
    OF_P,
    OF_R,
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
    LEVEL,
    MAP,
    OMEGA,
    PERIOD,
    POSITION,
    RESTITUTION,
    ROW,
    SPEEDS,
    VELOCITY,
    any_is_recorded,
    list_lanes,
    set_rest,
    sleeps_until,
    whole_vectors,
)
from vibroimpact.step.integrators import affine_map, apply_map
from vibroimpact.step.scheme import COS, REDUCED_STEP, SIN, THETA
from vibroimpact.step.stepper import take_step

#: Steps in a stride; the numbers of a lane stay in registers meanwhile.
STRIDE = 4


@specialised
def set_map(workspace, i, integrator, grid):
    """Give lane `i` its affine map of one step of `grid`."""
    pt = workspace.points[i]
    rows = affine_map(integrator, grid.phase_step / pt.omega, pt)
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


@specialised
def _step_span(lanes, size, table, n, span):
    for i in range(whole_vectors(size)):
        x, v, safe = lanes[POSITION + i], lanes[VELOCITY + i], True
        for q in range(span):
            x, v, below = step_lane(lanes, i, x, v, table[SIN, n + q], table[COS, n + q])
            safe &= below
        lanes[POSITION + i] = select(safe, x, lanes[POSITION + i])
        lanes[VELOCITY + i] = select(safe, v, lanes[VELOCITY + i])
        lanes[GUARD + i] = select(safe, -1.0, 1.0)


@jit
def step_lanes(lanes, size, table, n, span):
    """Take the first lanes over a stride from step `n`, or over a single step.

    A lane that may meet its stop stays where it is, and its GUARD is not negative.
    """
    widest_vectors()
    if span == STRIDE:
        _step_span(lanes, size, table, n, STRIDE)
    else:
        _step_span(lanes, size, table, n, 1)


@jit
def plain_step(lanes, i, x, v, table, n, place, recording):
    """Take lane `i` from (x, v) over step `n` with the rule (2)-(5): selects instead of branches.

    The speed of its impact goes to `place`. A displacement that overflowed counts as an impact,
    too. If the speed did not overflow, the state after it is right; only the penetration, inf, is
    lost, so a record with this step has failed.
    """
    to_x, to_v = map_of(lanes, i)
    s, c = table[SIN, n], table[COS, n]
    x_T, v_T = apply_map(to_x, x, v, s, c), apply_map(to_v, x, v, s, c)
    # Loaded in every lane: a processor without masked loads takes no vectors otherwise.
    stop, R = lanes[CLEARANCE + i], lanes[RESTITUTION + i]
    impact = (x_T >= stop) & (v_T > 0.0)
    if recording:
        lanes[place] = select(impact, v_T, math.inf)
        lanes[GUARD + i] = select(impact, 1.0, lanes[GUARD + i])
        lanes[GREATEST + i] = select(x_T > lanes[GREATEST + i], x_T, lanes[GREATEST + i])
    return select(impact, stop, x_T), select(impact, -R * v_T, v_T)


@specialised
def _plain_span(lanes, size, table, n, span, recording):
    for i in range(whole_vectors(size)):
        x, v = lanes[POSITION + i], lanes[VELOCITY + i]
        if recording:
            lanes[GUARD + i] = -1.0
        x, v = plain_step(lanes, i, x, v, table, n, i + SPEEDS, recording)
        if span == STRIDE:
            x, v = plain_step(lanes, i, x, v, table, n + 1, i + SPEEDS + ROW, recording)
            x, v = plain_step(lanes, i, x, v, table, n + 2, i + SPEEDS + 2 * ROW, recording)
            x, v = plain_step(lanes, i, x, v, table, n + 3, i + SPEEDS + 3 * ROW, recording)
        lanes[POSITION + i], lanes[VELOCITY + i] = x, v


@jit
def plain_lanes(lanes, size, table, n, span, recording):
    """Take the first lanes over a stride from step `n`, or a single step, with the rule ``plain``.

    While recording, the GUARD of lanes with an impact is not negative.
    """
    widest_vectors()
    if span < STRIDE:
        _plain_span(lanes, size, table, n, 1, recording)
    elif recording:
        _plain_span(lanes, size, table, n, STRIDE, True)
    else:
        _plain_span(lanes, size, table, n, STRIDE, False)


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


@jit
def correct_stepped_lanes(batch, lo, count, left, integrator, grid, n):
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
        for q in range(n + 1, n + STRIDE):
            x_T, v_T, safe = step_lane(lanes, i, x, v, table[SIN, q], table[COS, q])
            later = q > c[STEP + j]
            x, v = select(later, x_T, x), select(later, v_T, v)
            single &= safe | (not later)
        if not single:
            met[left] = i
            left += 1
            continue
        lanes[POSITION + i], lanes[VELOCITY + i] = x, v
        if lanes[PERIOD + i] >= 0.0:
            phase = c[THETA_0 + j] + lanes[OMEGA + i] * c[T_R + j]
            list_impact(record.impacts[workspace.rows[i]], workspace.sums[i], phase, c[V_TR + j])
    return left


@jit
def resolve_stepped_lane(batch, i, method, grid, n, span):
    """Take lane `i` over `span` steps from step `n` with every impact in them."""
    workspace, record, _ = batch
    lanes, scratch = workspace.lanes, workspace.scratch
    pt, sums, table, phase_step = (
        workspace.points[i],
        workspace.sums[i],
        grid.table,
        grid.phase_step,
    )
    recording, ring = lanes[PERIOD + i] >= 0.0, record.impacts[workspace.rows[i]]
    rows = map_of(lanes, i)
    state = lanes[POSITION + i], lanes[VELOCITY + i], lanes[LEVEL + i] == AT_REST
    for k in range(n, n + span):
        theta = table[THETA, k]
        if sleeps_until(lanes, i, theta + phase_step):
            if recording:
                sums.rested += phase_step / pt.omega
            continue
        phase = theta, table[SIN, k], table[COS, k]
        x, v, resting, n_events, rested, status = take_step(
            method, rows, state, phase, phase_step, pt, scratch
        )
        state = x, v, resting
        set_rest(lanes, i, resting, theta + phase_step, pt)
        sums.status = max(sums.status, status)
        if recording:
            record_step(scratch.events, n_events, rested, theta, pt, ring, sums)
    lanes[POSITION + i], lanes[VELOCITY + i] = state[0], state[1]


@specialised
def take_strides(batch, method, plain, grid):
    """Take all lanes over the steps of `grid` stride by stride, and singly over those left over.

    `plain` says whether the rule is ``plain``. It is a literal, so only that loop is compiled.
    """
    workspace, _, size = batch
    lanes, met = workspace.lanes, workspace.met
    rule, integrator = method
    strides = grid.size // STRIDE
    recording = plain and any_is_recorded(lanes, size)
    for k in range(strides + grid.size % STRIDE):
        n = k + min(k, strides) * (STRIDE - 1)
        span = STRIDE if k < strides else 1
        if plain:
            plain_lanes(lanes, size, grid.table, n, span, recording)
            if recording:
                list_plain_impacts(batch, list_lanes(lanes, met, size), grid, n, span)
            continue
        step_lanes(lanes, size, grid.table, n, span)
        listed = list_lanes(lanes, met, size)
        if rule == REDUCED_STEP and span == STRIDE:
            left = 0
            for lo in range(0, listed, COLUMNS):
                count = min(COLUMNS, listed - lo)
                left = correct_stepped_lanes(batch, lo, count, left, integrator, grid, n)
            listed = left
        for j in range(listed):
            resolve_stepped_lane(batch, met[j], method, grid, n, span)
