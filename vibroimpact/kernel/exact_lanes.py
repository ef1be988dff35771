"""The loop of exact steps; flights of lanes go to columns, and back; tangent vectors, their growth.

All lanes take a step as if there were no stop; the results go to their second rows. Lanes that may
have met the stop are listed, and their flights are followed side by side, in columns. A flight for
which this proves nothing goes through ``exact_step`` alone, as that of a single orbit does.

`carrying` says whether tangent vectors are carried now, and `watching` whether the extremes of any
lane is watched. Either is None in a loop that is compiled without exponents or without extremes, so
that the code behind ``is not None`` is left out of it.
"""

from __future__ import annotations

import math

from vibroimpact.jit import jit, lowest_bit, not_negative, select, specialised, widest_vectors
from vibroimpact.kernel.exact_impacts import (
    AT,
    BEGIN,
    BOUND,
    COLUMN_COEFFICIENTS,
    COLUMN_ROW,
    FLOOR,
    PROVED,
    TANGENT_0,
    TANGENT_1,
    W_1,
    W_I,
    Y_1,
    begin_next_flight,
    bound_flights,
    carry_columns,
    coefficients_in,
    fill_columns,
    flight_in,
    follow_flights,
)
from vibroimpact.kernel.extremes import widen_by_column, widen_by_lane, widen_by_turns
from vibroimpact.kernel.record import list_impact, record_step
from vibroimpact.kernel.workspace import (
    AT_REST,
    CLEARANCE,
    COEFFICIENTS,
    COEFFICIENTS_SIZE,
    COLUMNS,
    FORCING,
    GUARD,
    KEPT,
    LANES,
    LEAST,
    LEVEL,
    MOST,
    OMEGA,
    PERIOD,
    POSITION,
    PROPAGATOR,
    ROW,
    SLEPT,
    TANGENT,
    VECTOR,
    VELOCITY,
    WATCHED,
    W,
    Y,
    list_lanes,
    propagator_in,
    put_tangent,
    set_rest,
    sleeps_until,
    tangent_in,
    whole_vectors,
)
from vibroimpact.step.contact import SIDE_BY_SIDE
from vibroimpact.step.elementary import hypot, log
from vibroimpact.step.exact_step import exact_step
from vibroimpact.step.impact import FIRST, FREE, NOTHING, ONLY
from vibroimpact.step.propagator import (
    Forcing,
    coefficients_of,
    forced,
    from_dimensionless,
    propagate,
    propagator_of,
    to_dimensionless,
)
from vibroimpact.step.scheme import COS, SIN, THETA
from vibroimpact.step.turning_points import widen_by_events
from vibroimpact.step.variational import carry_tangents, propagate_tangent

#: Steps between two checks of the tangent vectors.
_CHECKED_EVERY = 4
#: While watching, the GUARD of a lane that may have met the stop.
_MEETS = math.inf


@jit
def set_propagator(workspace, i, grid):
    """Give lane `i` its coefficients of (P), and its propagator over a step of `grid`."""
    lanes, added = workspace.lanes, workspace.added
    eq = coefficients_of(workspace.points[i])
    propagator, forcing = propagator_of(eq, grid.phase_step, workspace.scratch.coefficients)
    for q in range(7):
        lanes[PROPAGATOR + q * ROW + i] = propagator[q]
    for q in range(6):
        lanes[FORCING + q * ROW + i] = forcing[q]
    line = COEFFICIENTS + COEFFICIENTS_SIZE * i
    for q in range(5):
        lanes[line + q] = eq[q]
    for q in range(3):
        lanes[line + 5 + q] = propagator[4 + q]
    if grid.size <= KEPT:
        for n in range(grid.size):
            added[n, 0, i], added[n, 1, i] = forced(forcing, grid.table[SIN, n], grid.table[COS, n])


@jit
def force_lanes(lanes, added, s, c):
    """Set `added` to what a step adds to each lane, from a phase with sine `s` and cosine `c`."""
    widest_vectors()
    for i in range(LANES):
        f = FORCING + i
        forcing = Forcing(
            lanes[f], lanes[f + ROW], lanes[f + 2 * ROW], lanes[f + 3 * ROW], lanes[f + 4 * ROW],
            lanes[f + 5 * ROW],
        )  # fmt: skip
        added[0, i], added[1, i] = forced(forcing, s, c)


@specialised
def _propagate(lanes, size, added, phase_step, n, watching):
    old_row, new_row = (n & 1) * ROW, (~n & 1) * ROW
    for i in range(whole_vectors(size)):
        y, w = lanes[Y + old_row + i], lanes[W + old_row + i]
        y, w, _, guard, floor = propagate(
            propagator_in(lanes, i), y, w, (added[0, i], added[1, i]), phase_step
        )
        if watching:
            beyond = max(guard - lanes[MOST + i], lanes[LEAST + i] - floor)
            guard = select(guard < 0.0, min(beyond, lanes[WATCHED + i]), _MEETS)
        lanes[GUARD + i] = guard
        lanes[Y + new_row + i], lanes[W + new_row + i] = y, w


@jit
def propagate_lanes(lanes, size, added, phase_step, n, watching):
    """Take the first lanes over step `n`; a GUARD below 0 proves that there was no impact.

    A lane at rest has y = w = 0, so its GUARD is not negative, and it is listed at every step. If
    `watching`, that of a lane that may have met the stop is ``_MEETS``; that of any other is not
    negative if it is watched and its step may go beyond its extremes.
    """
    widest_vectors()
    if watching is not None and watching:
        _propagate(lanes, size, added, phase_step, n, True)
    else:
        _propagate(lanes, size, added, phase_step, n, False)


@jit
def end_flights(batch, lo, count, grid, n, carrying, last, watching):
    """List the impacts that end the flights of these columns, and end or go on with their steps.

    Return the number of flights that begin now, with rebounds, in the first columns; their lanes
    are listed from index `lo` on. If these are the `last` columns, they go alone.
    """
    workspace, record, _ = batch
    lanes, c, met = workspace.lanes, workspace.columns, workspace.met
    table, new_row = grid.table, (~n & 1) * ROW
    theta, wave = table[THETA, n], (table[SIN, n], table[COS, n])
    for j in range(count):
        i, proved = met[lo + j] & (LANES - 1), c[PROVED + j]
        lanes[Y + new_row + i], lanes[W + new_row + i] = c[Y_1 + j], c[W_1 + j]
        if (proved == ONLY or proved == FIRST) and lanes[PERIOD + i] >= 0.0:
            ring, speed = record.impacts[workspace.rows[i]], c[W_I + j] * lanes[OMEGA + i]
            list_impact(ring, workspace.sums[i], theta + c[AT + j], speed)
            if watching is not None:
                lanes[MOST + i] = 0.0
        if watching is not None and lanes[WATCHED + i] > 0.0 and proved != NOTHING:
            higher = proved == FREE and lanes[MOST + i] < 0.0
            if higher or c[FLOOR + j] < lanes[LEAST + i]:
                widen_by_column(workspace, i, j, grid, n)
        ended = proved == ONLY or (proved == FREE and c[BEGIN + j] > 0.0)
        if carrying is not None and carrying and ended:
            tangent = tangent_in(c, TANGENT_1 + j, COLUMN_ROW)
            put_tangent(lanes, TANGENT + new_row + i, 2 * ROW, tangent)
    bits, begun = ~not_negative(c, PROVED) & ((1 << count) - 1), 0
    while bits != 0:  # terminates: one bit less each time
        j = lowest_bit(bits)
        bits &= bits - 1
        i = met[lo + j] & (LANES - 1)
        if c[PROVED + j] == FIRST:
            slow = begin_next_flight(c, j, begun, wave)
            if not (slow or last):
                met[lo + begun] = i
                begun += 1
                continue
            j = begun
        resolve_exact_lane(batch, i, j, grid, n, carrying, watching)
    return begun


@jit
def resolve_exact_lane(batch, i, j, grid, n, carrying, watching):
    """Take lane `i` from the start of the flight in column `j` to the end of step `n`, alone."""
    workspace, record, _ = batch
    lanes, c, scratch = workspace.lanes, workspace.columns, workspace.scratch
    new_row = (~n & 1) * ROW
    pt, sums = workspace.points[i], workspace.sums[i]
    theta, phase_step, begin = grid.table[THETA, n], grid.phase_step, c[BEGIN + j]
    was_resting = lanes[LEVEL + i] == AT_REST
    eq = coefficients_in(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW)
    y, w, resting, n_events, rested, status, grazes = exact_step(
        eq, pt, flight_in(c, j), was_resting, c[BOUND + j], theta, phase_step, scratch, 0
    )
    lanes[Y + new_row + i], lanes[W + new_row + i] = y, w
    set_rest(lanes, i, resting, theta + phase_step, pt)
    sums.status = max(sums.status, status)
    sums.alone += 1
    if lanes[PERIOD + i] >= 0.0:
        ring = record.impacts[workspace.rows[i]]
        record_step(scratch.events, n_events, rested / pt.omega, theta, pt, ring, sums)
        sums.near_grazes += grazes
        if watching is not None and lanes[WATCHED + i] > 0.0:
            lanes[LEAST + i], lanes[MOST + i] = widen_by_events(
                eq, flight_in(c, j), was_resting, (y, w), (0, n_events), theta, c[BOUND + j],
                phase_step, pt, scratch, (lanes[LEAST + i], lanes[MOST + i]),
            )  # fmt: skip
    if carrying is not None and carrying:
        tangent = tangent_in(c, TANGENT_0 + j, COLUMN_ROW)
        tangent, _ = carry_tangents(
            (eq, propagator_in(lanes, i)), (tangent, tangent), scratch.events, n_events, begin,
            theta, phase_step, pt.omega,
        )  # fmt: skip
        put_tangent(lanes, TANGENT + new_row + i, 2 * ROW, tangent)


@jit
def take_flights(batch, lo, count, grid, n, carrying, watching):
    """Take `count` listed lanes, from index `lo` on, over step `n`, flight after flight."""
    workspace, table = batch.workspace, grid.table
    c, phase_step = workspace.columns, grid.phase_step
    wave, end_wave = (table[SIN, n], table[COS, n]), (table[SIN, n + 1], table[COS, n + 1])
    fill_columns(workspace, workspace.met, lo, count, n, carrying)
    for k in range(SIDE_BY_SIDE):
        vectors = (count + VECTOR - 1) // VECTOR
        follow_flights(c, vectors, (wave, end_wave), phase_step, k > 0)
        if carrying is not None and carrying:
            carry_columns(c, vectors, wave)
        if watching is not None and watching:
            bound_flights(c, vectors, phase_step)
        count = end_flights(batch, lo, count, grid, n, carrying, k + 1 == SIDE_BY_SIDE, watching)
        if count == 0:
            break


@jit
def list_awake(workspace, size, grid, n, watching):
    """List lanes that may have met the stop; others stay at rest, or may widen their extremes."""
    lanes, met, new_row = workspace.lanes, workspace.met, (~n & 1) * ROW
    awake, theta = 0, grid.table[THETA, n] + grid.phase_step
    for j in range(list_lanes(lanes, met, size)):
        i = met[j] & (LANES - 1)
        if watching is not None and watching and lanes[GUARD + i] < _MEETS:
            widen_by_lane(workspace, i, grid, n)
        elif sleeps_until(lanes, i, theta):
            lanes[Y + new_row + i] = lanes[W + new_row + i] = 0.0
            lanes[SLEPT + i] += 1.0
        else:
            met[awake] = i
            awake += 1
    return awake


@jit
def propagate_all_tangents(lanes, size, n):
    """Take the tangent vectors of the first lanes over step `n`."""
    widest_vectors()
    old_row, new_row = (n & 1) * ROW, (~n & 1) * ROW
    for i in range(whole_vectors(size)):
        tangent = tangent_in(lanes, TANGENT + old_row + i, 2 * ROW)
        tangent = propagate_tangent(propagator_in(lanes, i), tangent)
        put_tangent(lanes, TANGENT + new_row + i, 2 * ROW, tangent)


@jit
def normalise(tangent, sums):
    """Give a tangent vector the length 1, and add up its growth."""
    y, w = tangent
    length = hypot(y, w)
    if length == 0.0:  # after a rest
        sums.growth = -math.inf
        return tangent
    sums.growth += log(length)
    return y / length, w / length


@jit
def judge_tangents(lanes, size, row):
    """Find tangent vectors that would soon be too short or long: their GUARD is not negative."""
    widest_vectors()
    for i in range(whole_vectors(size)):
        y, w = tangent_in(lanes, row + i, 2 * ROW)
        square = y * y + w * w
        lanes[GUARD + i] = select((square > 1e-100) & (square < 1e100), -1.0, 1.0)


@jit
def normalise_lanes(batch, n):
    """Normalise the tangent vectors that need it, before step `n`."""
    workspace, _, size = batch
    lanes, met = workspace.lanes, workspace.met
    row = TANGENT + (n & 1) * ROW
    judge_tangents(lanes, size, row)
    for j in range(list_lanes(lanes, met, size)):
        a = row + met[j]
        tangent = normalise(tangent_in(lanes, a, 2 * ROW), workspace.sums[met[j]])
        put_tangent(lanes, a, 2 * ROW, tangent)


@jit
def sum_up_tangents(workspace, i):
    """Add up the growth that remains in lane `i`, in dx^2 + (dv / p)^2, and that of an area."""
    (y, w), pt = tangent_in(workspace.lanes, TANGENT + i, 2 * ROW), workspace.points[i]
    sums = workspace.sums[i]
    normalise((y, w * pt.omega / pt.p), sums)
    sums.area = 2.0 * sums.impacts * log(pt.R) if sums.impacts > 0 else 0.0


@jit
def take_exact_steps(batch, grid, carrying, watching):
    """Take all lanes over the steps of `grid`."""
    workspace, _, size = batch
    lanes = workspace.lanes
    for n in range(grid.size):
        if grid.size > KEPT:  # too many to keep: the values of this step are computed now
            force_lanes(lanes, workspace.added[0], grid.table[SIN, n], grid.table[COS, n])
        added = workspace.added[n if grid.size <= KEPT else 0]
        propagate_lanes(lanes, size, added, grid.phase_step, n, watching)
        listed = list_awake(workspace, size, grid, n, watching)
        if carrying is not None and carrying:
            propagate_all_tangents(lanes, size, n)
        for lo in range(0, listed, COLUMNS):
            take_flights(batch, lo, min(COLUMNS, listed - lo), grid, n, carrying, watching)
        due = (n + 1) % _CHECKED_EVERY == 0 or n + 1 == grid.size
        if carrying is not None and carrying and due:
            normalise_lanes(batch, n + 1)
    if grid.size & 1:
        for a in range(0, GUARD, 2 * ROW):  # the next step has number 0
            for i in range(a, a + LANES):
                lanes[i] = lanes[i + ROW]
    if watching is not None and watching:
        widen_by_turns(workspace, grid.phase_step)


@jit
def round_states(lanes, size):
    """Round the states to (x, v), which go to the rows for odd steps, for the record."""
    widest_vectors()
    for i in range(whole_vectors(size)):
        clearance, omega = lanes[CLEARANCE + i], lanes[OMEGA + i]
        x, v = from_dimensionless(lanes[Y + i], lanes[W + i], clearance, omega)
        lanes[POSITION + ROW + i], lanes[VELOCITY + ROW + i] = x, v
        lanes[Y + i], lanes[W + i] = to_dimensionless(x, v, clearance, omega)
