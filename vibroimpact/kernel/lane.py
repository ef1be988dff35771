"""Fills a lane with point after point; runs the lanes of a thread over their periods.

Every forcing period takes the same steps, and the state at the section determines what they do: x,
v and whether the mass rests. So once it equals that at an earlier section to the last bit, the
motion repeats what came between them for ever. Each lane keeps one earlier state, its mark, which
it renews when its periods have grown by a quarter. A motion that has come back to its mark skips
whole cycles of its transient. Of its record, one cycle is computed, and whole cycles are copied.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

from vibroimpact.jit import claim, is_set, jit, select, specialised, widest_vectors
from vibroimpact.kernel.exact_lanes import (
    round_states,
    set_propagator,
    sum_up_tangents,
    take_exact_steps,
)
from vibroimpact.kernel.extremes import begin_period, set_steady
from vibroimpact.kernel.record import (
    add_cycles,
    begin_sums,
    put_in_order,
    record_section,
    repeat_impacts,
)
from vibroimpact.kernel.strides import set_map, take_strides
from vibroimpact.kernel.workspace import (
    AT_REST,
    AWAKE,
    CLEARANCE,
    COEFFICIENTS,
    COEFFICIENTS_SIZE,
    DUE,
    GREATEST,
    GUARD,
    KEPT,
    LEAST,
    LEVEL,
    MARK_LEVEL,
    MARK_PERIOD,
    MARK_V,
    MARK_X,
    MOST,
    OMEGA,
    PERIOD,
    POSITION,
    RESTITUTION,
    ROW,
    SLEPT,
    TANGENT,
    VELOCITY,
    WAKE,
    WATCHED,
    Batch,
    any_exceeds,
    list_lanes,
    put_tangent,
    whole_vectors,
)
from vibroimpact.step.contact import RELEASE_MARGIN, time_to_release
from vibroimpact.step.scheme import THETA
from vibroimpact.step.stepper import first_section
from vibroimpact.step.turning_points import EVERYTHING, extremes_of_x


@specialised
def fill_lane(workspace, job, i, exactly):
    """Put the next point that no thread has taken into lane `i`; return whether there was one."""
    row = claim(job.claimed)
    if row >= job.points.size:
        return False
    lanes, (method, grid) = workspace.lanes, job.scheme
    workspace.rows[i], workspace.points[i] = row, job.points[row]
    workspace.sums[i].skipped = workspace.sums[i].alone = 0
    pt = workspace.points[i]
    # With exact impacts these rows are Y and W.
    (lanes[POSITION + i], lanes[VELOCITY + i], resting), workspace.sums[i].status = first_section(
        method, grid, pt, workspace.scratch, False, exactly
    )
    lanes[CLEARANCE + i], lanes[OMEGA + i], lanes[RESTITUTION + i] = pt.clearance, pt.omega, pt.R
    lanes[LEVEL + i], lanes[WAKE + i] = AT_REST if resting else pt.clearance, AWAKE
    if exactly:
        set_propagator(workspace, i, grid)
    else:
        set_map(workspace, i, method[1], grid)
    lanes[PERIOD + i], lanes[DUE + i] = -job.transient, 1 - job.transient
    # The start is not marked: after a lead-in it is not rounded, as sections are.
    lanes[MARK_X + i] = math.nan
    lanes[LEAST + i], lanes[MOST + i] = EVERYTHING
    lanes[WATCHED + i] = -1.0
    if job.transient == 0:
        x = lanes[POSITION + i] + (pt.clearance if exactly else 0.0)
        if pt.phase == grid.table[THETA, 0]:
            x = pt.x0
        begin_record(workspace, job, i, x)
    return True


@jit
def fill_exact_lane(workspace, job, i):
    """Fill lane `i` for the rule ``exact``."""
    return fill_lane(workspace, job, i, True)


@jit
def fill_stepped_lane(workspace, job, i):
    """Fill lane `i` for a rule of time stepping."""
    return fill_lane(workspace, job, i, False)


@specialised
def fill_next_lane(workspace, job, i, exactly, turning):
    """Fill lane `i`, with what turning points need if `turning` is not None."""
    if not exactly:
        return fill_stepped_lane(workspace, job, i)
    filled = fill_exact_lane(workspace, job, i)
    if turning is not None and filled:
        set_steady(workspace.lanes, i, workspace.points[i], job.scheme.grid)
    return filled


@jit
def move_lane(workspace, source, target, exactly):
    """Move a lane, and leave zeros: numbers that become subnormal would slow all lanes down."""
    lanes = workspace.lanes
    for a in range(0, COEFFICIENTS, ROW):
        lanes[a + target] = lanes[a + source]
        lanes[a + source] = 0.0
    if exactly:
        for q in range(COEFFICIENTS_SIZE):
            a = COEFFICIENTS + q
            lanes[a + COEFFICIENTS_SIZE * target] = lanes[a + COEFFICIENTS_SIZE * source]
        for n in range(KEPT):
            for q in range(2):
                workspace.added[n, q, target] = workspace.added[n, q, source]
                workspace.added[n, q, source] = 0.0
    workspace.rows[target] = workspace.rows[source]
    workspace.points[target] = workspace.points[source]
    workspace.sums[target] = workspace.sums[source]
    workspace.sums_at_mark[target] = workspace.sums_at_mark[source]


@jit
def begin_record(workspace, job, i, x):
    """Begin the record of lane `i` at the displacement `x`."""
    lanes, pt, theta = workspace.lanes, workspace.points[i], job.scheme.grid.table[THETA, 0]
    extremes = job.record.extremes
    lanes[LEAST + i] = lanes[MOST + i] = lanes[POSITION + i]
    lanes[WATCHED + i] = 1.0
    if extremes.size > 0:
        extremes[workspace.rows[i], 0] = extremes[workspace.rows[i], 1] = x
    begin_sums(workspace.sums[i])
    lanes[SLEPT + i], lanes[GREATEST + i] = 0.0, max(x, pt.clearance)
    # A rest leaves no tangent vector, unless it ends now.
    rests = lanes[LEVEL + i] == AT_REST and pt.omega * time_to_release(theta, pt) > RELEASE_MARGIN
    put_tangent(lanes, TANGENT + i, 2 * ROW, (0.0 if rests else 1.0, 0.0))


@jit
def find_due(lanes, size, offset):
    """Go on to the next period; the GUARD of a lane that came back or is due is not negative."""
    widest_vectors()
    for i in range(whole_vectors(size)):
        lanes[WAKE + i] -= 2.0 * math.pi  # the phases of the grid begin again
        period = lanes[PERIOD + i] + 1.0
        lanes[PERIOD + i] = period
        back = (
            (lanes[POSITION + offset + i] == lanes[MARK_X + i])
            & (lanes[VELOCITY + offset + i] == lanes[MARK_V + i])
            & (lanes[LEVEL + i] == lanes[MARK_LEVEL + i])
        )
        lanes[GUARD + i] = select(back | (period >= lanes[DUE + i]), 1.0, -1.0)


@jit
def end_period(batch, offset, phase_step):
    """Store the states at the section, which lie 0 or ROW numbers on: the `offset`."""
    workspace, record, size = batch
    lanes = workspace.lanes
    for i in range(size):
        if lanes[PERIOD + i] >= 0.0:
            x, v = lanes[POSITION + offset + i], lanes[VELOCITY + offset + i]
            sections, sums = record.sections[workspace.rows[i]], workspace.sums[i]
            record_section(x, v, sections, int(lanes[PERIOD + i]), sums)
            if lanes[SLEPT + i] > 0.0:
                sums.rested += lanes[SLEPT + i] * phase_step / lanes[OMEGA + i]
                lanes[SLEPT + i] = 0.0
    find_due(lanes, size, offset)


@jit
def skip_cycles(batch, i, periods, only_transient):
    """Skip whole cycles of lane `i`, which has come back to its mark; copy them in its record."""
    workspace, record, _ = batch
    lanes, row, sums = workspace.lanes, workspace.rows[i], workspace.sums[i]
    marked = workspace.sums_at_mark[i]
    period = int(lanes[PERIOD + i])
    cycle = period - int(lanes[MARK_PERIOD + i])
    if period <= 0:
        lanes[PERIOD + i] += -period // cycle * cycle
        sums.skipped += -period // cycle * cycle
        return
    if sums.cycle > 0:  # with exponents, no cycle is skipped, and the motion comes back again
        return
    impacts = sums.impacts - marked.impacts
    sums.cycle, sums.cycle_impacts = cycle, impacts
    sums.cycle_rested = sums.rested - marked.rested
    sums.cycle_rests = sums.chatters > marked.chatters or sums.cycle_rested > 0.0
    times = (periods - period) // cycle
    if times > 0 and not only_transient:
        sections = record.sections[row]
        for k in range(period, period + times * cycle):
            sections[k, 0], sections[k, 1] = sections[k - cycle, 0], sections[k - cycle, 1]
        repeat_impacts(record.impacts[row], sums, impacts, times)
        add_cycles(sums, marked, times)
        lanes[PERIOD + i] += times * cycle
        sums.skipped += times * cycle


@jit
def attend_lane(batch, i, offset, job):
    """Do what is due in lane `i` at a section: skip cycles, begin the record, renew the mark."""
    workspace, record, _ = batch
    lanes, periods = workspace.lanes, job.periods
    x, v, level = lanes[POSITION + offset + i], lanes[VELOCITY + offset + i], lanes[LEVEL + i]
    same = x == lanes[MARK_X + i] and v == lanes[MARK_V + i]
    if same and level == lanes[MARK_LEVEL + i]:
        skip_cycles(batch, i, periods, job.lyapunov)
    period = lanes[PERIOD + i]
    end = 0.0 if period < 0.0 else float(periods)
    if period == 0.0:
        begin_record(workspace, job, i, x)
        begun = record.begun[workspace.rows[i]]
        begun[0], begun[1] = x, v
    elif period < lanes[DUE + i]:
        return
    lanes[MARK_X + i], lanes[MARK_V + i], lanes[MARK_LEVEL + i] = x, v, level
    lanes[MARK_PERIOD + i] = period
    workspace.sums_at_mark[i] = workspace.sums[i]
    lanes[DUE + i] = min(period + 1.0 + math.floor(0.25 * (period + job.transient)), end)


@jit
def compare_ends(x, v, sections, sums):
    """Note in the sums whether a record is one cycle that ends where it began, at (x, v)."""
    last = sections.shape[0] - 1
    if sums.cycle == 0 and x == sections[last, 0] and v == sections[last, 1]:
        sums.cycle, sums.cycle_impacts = last + 1, sums.impacts
        sums.cycle_rested = sums.rested
        sums.cycle_rests = sums.chatters > 0 or sums.rested > 0.0


@specialised
def close_lane(workspace, job, i, exactly, plain, exponents):
    """End the record of lane `i`."""
    row, sums, lanes = workspace.rows[i], workspace.sums[i], workspace.lanes
    if job.transient > 0:
        begun = job.record.begun[row]
        compare_ends(begun[0], begun[1], job.record.sections[row], sums)
    elif workspace.points[i].phase == job.scheme.grid.table[THETA, 0]:
        pt = workspace.points[i]  # else the record does not begin at the start
        compare_ends(pt.x0, pt.v0, job.record.sections[row], sums)
    if exponents:
        sum_up_tangents(workspace, i)
    if plain:
        sums.max_penetration = lanes[GREATEST + i] - lanes[CLEARANCE + i]
    if job.record.extremes.size > 0:
        pair, last = job.record.extremes[row], job.record.sections[row, job.periods - 1, 0]
        least, most = lanes[LEAST + i], lanes[MOST + i]
        if not exactly and (most == math.inf or sums.impacts > 0):  # at the stop, or beyond
            most = lanes[GREATEST + i]
        pair[0], pair[1] = extremes_of_x(
            (least, most), min(pair[0], last), max(pair[1], last), lanes[CLEARANCE + i], exactly
        )
    put_in_order(job.record.impacts[row], sums.listed)
    job.record.sums[row] = sums


@cache
def loop_of(exactly: bool, plain: bool, exponents: bool, watching: bool) -> Any:
    """Return the loop of a thread for a rule; what these constants exclude is not compiled."""

    def run(workspace, job):
        lanes, met, record = workspace.lanes, workspace.met, job.record
        (method, grid), size, offset = job.scheme, 0, ROW if exactly else 0
        turning = workspace.turning if watching else None
        while size < job.lanes and fill_next_lane(workspace, job, size, exactly, turning):
            size += 1
        while size > 0 and not is_set(job.interrupt):
            batch = Batch(workspace, record, size)
            if exactly:
                carrying = watched = None
                if exponents:
                    carrying = any_exceeds(lanes, PERIOD, -1.0, size)
                if watching:
                    watched = any_exceeds(lanes, WATCHED, -1.0, size)
                    watched = watched and begin_period(workspace, size, grid)
                take_exact_steps(batch, grid, carrying, watched)
                round_states(lanes, size)
            else:
                take_strides(batch, method, plain, grid, turning)
            end_period(batch, offset, grid.phase_step)
            # From the last lane on: a lane that takes the place of a complete one is done already.
            for j in range(list_lanes(lanes, met, size) - 1, -1, -1):
                i = met[j]
                attend_lane(batch, i, offset, job)
                if lanes[PERIOD + i] >= job.periods:
                    close_lane(workspace, job, i, exactly, plain, exponents)
                    if not fill_next_lane(workspace, job, i, exactly, turning):
                        size -= 1
                        move_lane(workspace, size, i, exactly)

    # The name tells watchers the rule. Each loop has its own: numba's cache keeps functions of one
    # name in one index, which two processes may write at once.
    name = "run_exact" if exactly else "run_plain" if plain else "run_shortened"
    name += "_with_exponents" * exponents + "_with_extremes" * watching
    run.__name__ = run.__qualname__ = name
    return jit(run)
