"""The loop of a thread over forcing periods, for each impact rule."""

from __future__ import annotations

from vibroimpact.jit import is_set, jit, specialised
from vibroimpact.kernel.exact_lanes import round_states, take_exact_steps
from vibroimpact.kernel.lane import (
    attend_lane,
    close_lane,
    end_period,
    fill_exact_lane,
    fill_stepped_lane,
    move_lane,
)
from vibroimpact.kernel.strides import take_strides
from vibroimpact.kernel.workspace import (
    GUARD,
    PERIOD,
    ROW,
    Batch,
    any_is_recorded,
    any_is_watched,
    list_lanes,
)


@specialised
def run_lanes(workspace, job, fill, exactly, plain, exponents, turning):
    """Run point after point until the threads have taken all of them.

    `exactly` and `plain` say whether the rule is ``exact`` or ``plain``. They are literals, so only
    the loop of that rule is compiled; so is `exponents`, whether tangent vectors may be carried.
    `turning` is a list of lanes, or None without extremes.
    """
    lanes, met, record = workspace.lanes, workspace.met, job.record
    (method, grid), size, offset = job.scheme, 0, ROW if exactly else 0
    while size < job.lanes and fill(workspace, job, size):
        size += 1
    while size > 0 and not is_set(job.interrupt):
        batch = Batch(workspace, record, size)
        if exactly:
            carrying = watching = None
            if exponents:
                carrying = job.lyapunov and any_is_recorded(lanes, size)
            if turning is not None:
                watching = any_is_watched(lanes, size)
            take_exact_steps(batch, grid, carrying, watching)
            round_states(lanes, size)
        else:
            take_strides(batch, method, plain, grid, turning)
        end_period(batch, offset, grid.phase_step)
        # From the last lane on: a lane that takes the place of a complete one is done already.
        for j in range(list_lanes(lanes, GUARD, met, size) - 1, -1, -1):
            i = met[j]
            attend_lane(batch, i, offset, job)
            if lanes[PERIOD + i] >= job.periods:
                close_lane(workspace, job, i, exactly, plain, exponents)
                if not fill(workspace, job, i):
                    size -= 1
                    move_lane(workspace, size, i, exactly)


@jit
def run_exact(workspace, job):
    """Run the lanes of a thread with the rule ``exact``."""
    run_lanes(workspace, job, fill_exact_lane, True, False, False, None)


@jit
def run_exact_with_exponents(workspace, job):
    """Run the lanes of a thread with the rule ``exact``, and carry their tangent vectors."""
    run_lanes(workspace, job, fill_exact_lane, True, False, True, None)


@jit
def run_exact_with_extremes(workspace, job):
    """Run the lanes of a thread with the rule ``exact``, and find their extremes."""
    run_lanes(workspace, job, fill_exact_lane, True, False, False, workspace.turning)


@jit
def run_exact_with_both(workspace, job):
    """Run the lanes of a thread with the rule ``exact``, with exponents and extremes."""
    run_lanes(workspace, job, fill_exact_lane, True, False, True, workspace.turning)


@jit
def run_plain(workspace, job):
    """Run the lanes of a thread with the rule ``plain``."""
    run_lanes(workspace, job, fill_stepped_lane, False, True, False, None)


@jit
def run_plain_with_extremes(workspace, job):
    """Run the lanes of a thread with the rule ``plain``, and find their extremes."""
    run_lanes(workspace, job, fill_stepped_lane, False, True, False, workspace.turning)


@jit
def run_shortened(workspace, job):
    """Run the lanes of a thread with ``reduced-step`` or ``cubic``."""
    run_lanes(workspace, job, fill_stepped_lane, False, False, False, None)


@jit
def run_shortened_with_extremes(workspace, job):
    """Run the lanes of a thread with ``reduced-step`` or ``cubic``, and find their extremes."""
    run_lanes(workspace, job, fill_stepped_lane, False, False, False, workspace.turning)
