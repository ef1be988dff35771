"""One batch of points, from its start to the end of the record, for each rule."""

from __future__ import annotations

import math

from vibroimpact.jit import inlined, is_set, jit
from vibroimpact.kernel import exact, time_stepping
from vibroimpact.kernel.record import record_section
from vibroimpact.kernel.workspace import (
    AT_REST,
    AWAKE,
    CLEARANCE,
    GREATEST,
    LANES,
    LEVEL,
    OMEGA,
    POSITION,
    RESTITUTION,
    ROW,
    SLEPT,
    TANGENTS,
    VELOCITY,
    WAKE,
    put_pair,
)
from vibroimpact.step.contact import start
from vibroimpact.step.scheme import PLAIN, sine_at_start
from vibroimpact.step.stepper import to_state


@jit
def set_start(lanes, points, rule, s):
    """Put every lane at its start, where the phase has the sine `s`."""
    for i in range(LANES):
        pt = points[min(i, points.size - 1)]  # a short batch repeats its last point
        x, v, resting = start(pt, s)
        # With exact impacts these rows are Y and W.
        lanes[POSITION + i], lanes[VELOCITY + i], _ = to_state(rule, x, v, resting, pt)
        lanes[LEVEL + i] = AT_REST if resting and rule != PLAIN else pt.clearance
        lanes[CLEARANCE + i], lanes[OMEGA + i], lanes[RESTITUTION + i] = (
            pt.clearance,
            pt.omega,
            pt.R,
        )
        lanes[WAKE + i], lanes[SLEPT + i], lanes[GREATEST + i] = AWAKE, 0.0, pt.clearance
        # Zeros in lanes without a point: numbers that become subnormal would slow all lanes down.
        one = 1.0 if i < points.size else 0.0
        put_pair(lanes, TANGENTS + i, 2 * ROW, (one, 0.0, 0.0, one * pt.p / pt.omega))


@jit
def end_period(batch, k, row, phase_step):
    """Store the states as section `k` of the record; `row` is 0 or ROW, where the states lie."""
    workspace, points, record = batch
    lanes = workspace.lanes
    for i in range(LANES):
        lanes[WAKE + i] -= 2.0 * math.pi  # the phases of the grid begin again
    if k >= 0:
        for i in range(points.size):
            record_section(lanes[POSITION + row + i], lanes[VELOCITY + row + i], i, k, record)
            if lanes[SLEPT + i] > 0.0:
                record.sums[i].rested += lanes[SLEPT + i] * phase_step / points[i].omega
                lanes[SLEPT + i] = 0.0


@inlined
def run_batch(batch, job, exactly, plain):
    """Run a batch of at most ``LANES`` points from its start to the end of the record.

    `exactly` and `plain` say whether the rule is ``exact`` or ``plain``. They are literals, so only
    the loop of that rule is compiled.
    """
    workspace, points, _ = batch
    lanes, transient, (method, lead, grid) = workspace.lanes, job.transient, job.scheme
    set_start(lanes, points, method[0], sine_at_start(lead, grid))
    # The lead-in counts as the period before the transient, so its loop is compiled only once.
    for k in range(-transient - 1, job.periods):
        if is_set(job.interrupt):
            break
        steps = lead if k < -transient else grid
        if exactly:
            if steps.size > 0 and k <= -transient:
                exact.set_propagators(workspace, points, steps)
            if k == 0:
                exact.forget_at_rest(lanes, points.size)
            exact.take_exact_steps(batch, steps, k >= 0, k >= 0 and job.lyapunov)
            if k >= -transient:
                exact.round_states(lanes)
        else:
            if k <= -transient:
                time_stepping.set_maps(lanes, points, method[1], steps)
            time_stepping.take_strides(batch, method, plain, steps, k >= 0)
        if k >= -transient:
            end_period(batch, k, ROW if exactly else 0, steps.phase_step)
    if exactly and job.lyapunov:
        exact.sum_up_tangents(batch)
    if plain:
        time_stepping.sum_up_plain(batch)


@jit
def run_exact(batch, job):
    """Run a batch with the rule ``exact``."""
    run_batch(batch, job, True, False)


@jit
def run_plain(batch, job):
    """Run a batch with the rule ``plain``."""
    run_batch(batch, job, False, True)


@jit
def run_shortened(batch, job):
    """Run a batch with the rule ``reduced-step`` or ``cubic``."""
    run_batch(batch, job, False, False)
