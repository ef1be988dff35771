"""The loop of exact impacts: all lanes take a step, and lanes that met the stop are corrected.

All lanes take a step as if there were no stop; the results go to their second rows. Lanes that may
have met the stop are listed and corrected side by side, in columns. A lane for which this proves
nothing goes through ``exact_step`` alone, as a single orbit does.
"""

from __future__ import annotations

from vibroimpact.jit import jit, lowest_bit, not_negative, select, specialised, widest_vectors
from vibroimpact.kernel.exact_impacts import (
    BOUND,
    COLUMN_COEFFICIENTS,
    COLUMN_ROW,
    PROVED,
    W_0,
    W_I,
    W_T,
    Y_0,
    Y_T,
    U,
    coefficients_in,
    correct_exact_lanes,
)
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
    LEVEL,
    OMEGA,
    PERIOD,
    POSITION,
    PROPAGATOR,
    ROW,
    SLEPT,
    TANGENTS,
    VELOCITY,
    W,
    Y,
    list_lanes,
    pair_in,
    put_pair,
    set_rest,
    sleeps_until,
    whole_vectors,
)
from vibroimpact.step.exact import exact_step
from vibroimpact.step.impact import ONLY, FreeEnd, Impact
from vibroimpact.step.propagator import (
    Forcing,
    Propagator,
    coefficients_of,
    forced,
    from_dimensionless,
    propagate,
    propagator_of,
    to_dimensionless,
)
from vibroimpact.step.scheme import COS, SIN, THETA
from vibroimpact.step.variational import carry_tangents, orthonormalise, propagate_tangents

# Steps between two checks of the tangent vectors.
_CHECKED_EVERY = 4


@specialised
def propagator_in(lanes, i):
    """Return the ``Propagator`` of lane `i`."""
    f = PROPAGATOR + i
    return Propagator(
        lanes[f], lanes[f + ROW], lanes[f + 2 * ROW], lanes[f + 3 * ROW], lanes[f + 4 * ROW],
        lanes[f + 5 * ROW], lanes[f + 6 * ROW],
    )  # fmt: skip


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


@jit
def place_of_added(workspace, grid, n):
    """Return the index in ``Workspace.added`` of what step `n` of `grid` adds to each lane.

    If the grid has too many steps to keep, the values are computed now, at index 0.
    """
    if grid.size <= KEPT:
        return n
    force_lanes(workspace.lanes, workspace.added[0], grid.table[SIN, n], grid.table[COS, n])
    return 0


@jit
def propagate_lanes(lanes, size, added, phase_step, n):
    """Take the first lanes over step `n`; a GUARD below 0 proves that there was no impact.

    A lane at rest has y = w = 0, so its GUARD is not negative, and it is listed at every step.
    """
    widest_vectors()
    old_row, new_row = (n & 1) * ROW, (~n & 1) * ROW
    for i in range(whole_vectors(size)):
        y, w = lanes[Y + old_row + i], lanes[W + old_row + i]
        y, w, _, lanes[GUARD + i] = propagate(
            propagator_in(lanes, i), y, w, (added[0, i], added[1, i]), phase_step
        )
        lanes[Y + new_row + i], lanes[W + new_row + i] = y, w


@jit
def propagate_all_tangents(lanes, size, n):
    """Take the tangent vectors of the first lanes over step `n`."""
    widest_vectors()
    old_row, new_row = (n & 1) * ROW, (~n & 1) * ROW
    for i in range(whole_vectors(size)):
        pair = propagate_tangents(
            propagator_in(lanes, i), pair_in(lanes, TANGENTS + old_row + i, 2 * ROW)
        )
        put_pair(lanes, TANGENTS + new_row + i, 2 * ROW, pair)


@jit
def list_exact_impacts(batch, lo, count, grid, n, carrying):
    """List the impacts of these columns; a lane whose single impact is not proved goes alone."""
    workspace, record, _ = batch
    lanes, columns = workspace.lanes, workspace.columns
    theta, new_row = grid.table[THETA, n], (~n & 1) * ROW
    for j in range(count):
        if columns[PROVED + j] == ONLY:
            i = workspace.met[lo + j] & (LANES - 1)
            if lanes[PERIOD + i] >= 0.0:
                ring, speed = record.impacts[workspace.rows[i]], columns[W_I + j] * lanes[OMEGA + i]
                list_impact(ring, workspace.sums[i], theta + columns[U + j], speed)
    bits = ~not_negative(columns, PROVED) & ((1 << count) - 1)
    while bits != 0:  # terminates: one bit less each time
        j = lowest_bit(bits)
        bits &= bits - 1
        i = workspace.met[lo + j] & (LANES - 1)
        if sleeps_until(lanes, i, theta + grid.phase_step):
            lanes[Y + new_row + i] = lanes[W + new_row + i] = 0.0
            lanes[SLEPT + i] += 1.0
        else:
            resolve_exact_lane(batch, i, j, grid, n, carrying)


@jit
def resolve_exact_lane(batch, i, j, grid, n, carrying):
    """Take lane `i`, which is in column `j`, over step `n` with every impact in it."""
    workspace, record, _ = batch
    lanes, c, scratch = workspace.lanes, workspace.columns, workspace.scratch
    old_row, new_row = (n & 1) * ROW, (~n & 1) * ROW
    pt, sums, table = workspace.points[i], workspace.sums[i], grid.table
    theta, phase_step = table[THETA, n], grid.phase_step
    was_resting = lanes[LEVEL + i] == AT_REST
    eq = coefficients_in(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW)
    y, w, resting, n_events, rested, status, grazes = exact_step(
        eq, pt, (c[Y_0 + j], c[W_0 + j], was_resting),
        FreeEnd(c[Y_T + j], c[W_T + j], c[BOUND + j]),
        Impact(0.0, 0.0, c[U + j], c[W_I + j], c[PROVED + j]),
        (theta, table[SIN, n], table[COS, n]), phase_step, scratch,
    )  # fmt: skip
    lanes[Y + new_row + i], lanes[W + new_row + i] = y, w
    set_rest(lanes, i, resting, theta + phase_step, pt)
    sums.status = max(sums.status, status)
    if lanes[PERIOD + i] >= 0.0:
        ring = record.impacts[workspace.rows[i]]
        record_step(scratch.events, n_events, rested / pt.omega, theta, pt, ring, sums)
        sums.near_grazes += grazes
    if carrying:
        pair = pair_in(lanes, TANGENTS + old_row + i, 2 * ROW)
        if was_resting:
            pair = 0.0, 0.0, 0.0, 0.0
        pair = carry_tangents(
            (eq, propagator_in(lanes, i)),
            pair,
            scratch.events,
            n_events,
            theta,
            phase_step,
            pt.omega,
        )
        put_pair(lanes, TANGENTS + new_row + i, 2 * ROW, pair)


@jit
def stretch(pair, sums):
    """Orthonormalise two tangent vectors, and add up their growth."""
    pair, growth_1, growth_2 = orthonormalise(pair)
    sums.growth_1 += growth_1
    sums.growth_2 += growth_2
    return pair


@jit
def judge_tangents(lanes, size, row):
    """Find tangent vectors that would soon be too short, too long or too parallel.

    The GUARD of a lane with such vectors is not negative.
    """
    widest_vectors()
    for i in range(whole_vectors(size)):
        ay, aw, by, bw = pair_in(lanes, row + i, 2 * ROW)
        size_2 = ay * ay + aw * aw + by * by + bw * bw
        fit = (abs(ay * bw - aw * by) >= 1e-4 * size_2) & (size_2 > 1e-100) & (size_2 < 1e100)
        lanes[GUARD + i] = select(fit, -1.0, 1.0)


@jit
def stretch_lanes(batch, n):
    """Orthonormalise the tangent vectors that need it, before step `n`."""
    workspace, _, size = batch
    lanes, met = workspace.lanes, workspace.met
    row = TANGENTS + (n & 1) * ROW
    judge_tangents(lanes, size, row)
    for j in range(list_lanes(lanes, met, size)):
        a = row + met[j]
        put_pair(lanes, a, 2 * ROW, stretch(pair_in(lanes, a, 2 * ROW), workspace.sums[met[j]]))


@jit
def take_exact_steps(batch, grid, carrying):
    """Take all lanes over the steps of `grid`."""
    workspace, _, size = batch
    lanes = workspace.lanes
    for n in range(grid.size):
        added = workspace.added[place_of_added(workspace, grid, n)]
        propagate_lanes(lanes, size, added, grid.phase_step, n)
        listed = list_lanes(lanes, workspace.met, size)
        if carrying:
            propagate_all_tangents(lanes, size, n)
        for lo in range(0, listed, COLUMNS):
            count = min(COLUMNS, listed - lo)
            correct_exact_lanes(workspace, lo, count, grid, n, carrying)
            list_exact_impacts(batch, lo, count, grid, n, carrying)
        if carrying and ((n + 1) % _CHECKED_EVERY == 0 or n + 1 == grid.size):
            stretch_lanes(batch, n + 1)
    if grid.size & 1:
        for a in range(0, GUARD if carrying else TANGENTS, 2 * ROW):  # the next step has number 0
            for i in range(a, a + LANES):
                lanes[i] = lanes[i + ROW]


@jit
def round_states(lanes, size):
    """Round the states to (x, v), which go to the rows for odd steps, for the record."""
    widest_vectors()
    for i in range(whole_vectors(size)):
        clearance, omega = lanes[CLEARANCE + i], lanes[OMEGA + i]
        x, v = from_dimensionless(lanes[Y + i], lanes[W + i], clearance, omega)
        lanes[POSITION + ROW + i], lanes[VELOCITY + ROW + i] = x, v
        lanes[Y + i], lanes[W + i] = to_dimensionless(x, v, clearance, omega)


@jit
def sum_up_tangents(workspace, i):
    """Add up the growth that remains in the tangent vectors of lane `i`, in dx^2 + (dv / p)^2."""
    ay, aw, by, bw = pair_in(workspace.lanes, TANGENTS + i, 2 * ROW)
    unit = workspace.points[i].omega / workspace.points[i].p
    stretch((ay, aw * unit, by, bw * unit), workspace.sums[i])
