"""Takes one orbit, and its extremes, over a step: map, `meet_stop` or `exact_step`, time stepping.

The state of an orbit between steps is (x, v, resting), or with the rule ``exact`` (y, w, resting)
in the units of ``propagator.py``. At the end of a period it is rounded to (x, v), so that a run
that starts from a recorded section continues the previous run to the last bit.
"""

from __future__ import annotations

import math

from vibroimpact.jit import jit, specialised, widest_vectors
from vibroimpact.status import Status
from vibroimpact.step.chatter import may_rest
from vibroimpact.step.contact import IMPACT, SIDE_BY_SIDE, log_event, start
from vibroimpact.step.elementary import sin_cos
from vibroimpact.step.exact_step import exact_step
from vibroimpact.step.impact import FIRST, NOTHING, ONLY, Flight, FreeEnd, launch_after, meet_stop
from vibroimpact.step.integrators import affine_map, apply_map
from vibroimpact.step.propagator import (
    bound_factors,
    coefficients_of,
    forced,
    from_dimensionless,
    propagate,
    propagator_of,
    remainder_bound,
    to_dimensionless,
)
from vibroimpact.step.scheme import COS, EXACT, PLAIN, SIN, THETA, PhaseGrid
from vibroimpact.step.time_stepping import plain, reduced_step
from vibroimpact.step.turning_points import (
    EVERYTHING,
    widen_by_events,
    widen_by_flight,
    widen_by_impact,
    widen_by_step,
)

_CERTIFIED, _COMPUTED = int(Status.CERTIFIED), int(Status.COMPUTED)


@jit
def prepare(method, grid, pt):
    """Return the rows of the affine map of a point for the steps of a grid."""
    m = affine_map(method[1], grid.phase_step / pt.omega, pt)
    return m[:4], m[4:]


@jit
def prepare_exact(grid, pt, scratch):
    """Return the coefficients of a point, and its propagator for the steps of a grid."""
    eq = coefficients_of(pt)
    return eq, propagator_of(eq, grid.phase_step, scratch.coefficients)


@specialised
def to_state(rule, x, v, resting, pt):
    """Return the state of an orbit for (x, v)."""
    if rule == EXACT:
        x, v = to_dimensionless(x, v, pt.clearance, pt.omega)
    return x, v, resting


@specialised
def from_state(rule, state, pt):
    """Return (x, v) for the state of an orbit."""
    x, v, _ = state
    if rule == EXACT:
        x, v = from_dimensionless(x, v, pt.clearance, pt.omega)
    return x, v


@specialised
def take_step(method, rows, state, phase, phase_step, pt, scratch):
    """Take a state over a step by the rows of its affine map, and correct it if it met the stop.

    `method` holds the codes of the rule, which is not ``exact``, and of the integrator. `phase` is
    the phase at the start, its sine and its cosine; `phase_step` is omega T. Returns the same as
    ``reduced_step``.
    """
    (x, v, resting), (_, s, c), (to_x, to_v) = state, phase, rows
    x_T, v_T = apply_map(to_x, x, v, s, c), apply_map(to_v, x, v, s, c)
    if resting or not x_T < pt.clearance:
        if method[0] != PLAIN:
            return reduced_step(
                method, state, (x_T, v_T), phase, phase_step / pt.omega, pt, scratch
            )
        x, v, n = plain(x_T, v_T, phase_step / pt.omega, pt, scratch)
        return x, v, False, n, 0.0, _COMPUTED
    return x_T, v_T, False, 0, 0.0, _COMPUTED


@specialised
def take_exact_step(prepared, state, grid, n, pt, scratch, extremes, watching):
    """Take a step with the rule ``exact``, as ``exact_lanes.py`` does for many points at once.

    Returns the state, the number of events, the status, and the extremes if `watching`, a literal.
    """
    (y, w, resting), table, (eq, (propagator, forcing)) = state, grid.table, prepared
    theta, wave, phase_step = table[THETA, n], (table[SIN, n], table[COS, n]), grid.phase_step
    y_T, w_T, bound, guard, floor = propagate(propagator, y, w, forced(forcing, *wave), phase_step)
    flight, free = Flight(y, w, *wave, 0.0), FreeEnd(y_T, w_T, bound)
    end_wave, c = (table[SIN, n + 1], table[COS, n + 1]), scratch.coefficients
    if guard < 0.0:
        if watching and (floor < extremes[0] or guard > extremes[1]):
            factors = bound_factors(eq, 0.0, phase_step)
            free = FreeEnd(y_T, w_T, remainder_bound(factors, y + pt.clearance, w))
            end = y_T, w_T, phase_step
            extremes = widen_by_flight(eq, flight, free, end_wave, end, phase_step, c, extremes)
        return (y_T, w_T, False), 0, 0, extremes
    n_events = 0
    for _ in range(SIDE_BY_SIDE):
        impact = meet_stop(eq, flight, free, end_wave, phase_step)
        y_T, w_T, at, w_i, proved, free = impact
        if proved == FIRST or proved == ONLY:
            time, speed = at / pt.omega, w_i * pt.omega
            n_events = log_event(scratch.events, n_events, IMPACT, time, speed, pt.clearance)
        if watching:
            waves = wave, end_wave
            extremes = widen_by_impact(eq, flight, impact, waves, phase_step, c, extremes)
        if proved >= ONLY:
            return (y_T, w_T, False), n_events, 0, extremes
        if proved == NOTHING:
            break
        flight, free = launch_after(eq, wave, at, w_i), FreeEnd(y_T, w_T, bound)
        if may_rest(eq, flight):
            break
    first = n_events
    y, w, now, n_events, _rested, status, _grazes = exact_step(
        eq, pt, flight, resting, bound, theta, phase_step, scratch, first
    )
    if watching:
        rows = first, n_events
        extremes = widen_by_events(
            eq, flight, resting, (y, w), rows, theta, bound, phase_step, pt, scratch, extremes
        )
    return (y, w, now), n_events, status, extremes


@jit
def take_grid_step(method, rows, state, grid, n, pt, scratch):
    """Take step `n` of a grid; return the state, the number of events, and the status."""
    table = grid.table
    phase = table[THETA, n], table[SIN, n], table[COS, n]
    x, v, resting, n_events, _, status = take_step(
        method, rows, state, phase, grid.phase_step, pt, scratch
    )
    return (x, v, resting), n_events, status


@jit
def watch_grid_step(method, rows, state, grid, n, pt, scratch, extremes):
    """Take step `n` of a grid; return the state, the number of events, the status, the extremes."""
    end, n_events, status = take_grid_step(method, rows, state, grid, n, pt, scratch)
    extremes = widen_by_step(state, end, n_events, grid, n, pt, scratch.events, extremes)
    return end, n_events, status, extremes


@jit
def take_exact_grid_step(prepared, state, grid, n, pt, scratch):
    """Take step `n` of a grid with the rule ``exact``; return the same as `take_grid_step`."""
    widest_vectors()  # it keeps LLVM from merging this function into each of its callers
    end, n_events, status, _ = take_exact_step(
        prepared, state, grid, n, pt, scratch, EVERYTHING, False
    )
    return end, n_events, status


@specialised
def take_next_step(prepared, state, grid, n, pt, scratch):
    """Do what `take_exact_grid_step` does, without a call if the step is proved to be free."""
    table, (_, (propagator, forcing)) = grid.table, prepared
    added = forced(forcing, table[SIN, n], table[COS, n])
    y, w, _, guard, _ = propagate(propagator, state[0], state[1], added, grid.phase_step)
    end = (y, w, False), 0, 0
    if not guard < 0.0:
        end = take_exact_grid_step(prepared, state, grid, n, pt, scratch)
    return end


@jit
def watch_exact_grid_step(prepared, state, grid, n, pt, scratch, extremes):
    """Take step `n` of a grid with the rule ``exact``; return the same as `watch_grid_step`."""
    return take_exact_step(prepared, state, grid, n, pt, scratch, extremes, True)


@specialised
def first_section(method, grid, pt, scratch, continued, exactly):
    """Take a point alone to its first section; return its state there, and the worst status.

    `continued` says whether the start is a state that another run has reached.
    """
    rule, table = method[0], scratch.lead
    table[THETA, 1] = pt.phase
    table[SIN, 1], table[COS, 1] = sin_cos(pt.phase)
    x, v, resting = start(pt, table[SIN, 1])
    span = (grid.table[THETA, 0] - pt.phase) % (2.0 * math.pi)
    # None of the steps is longer than one of the grid.
    count = math.ceil(span / (2.0 * math.pi) * grid.size * (1.0 - 1e-12))
    if continued and count == 0:  # a run that came there at speed 0 rests, even if released now
        resting = x == pt.clearance and v == 0.0
    state = to_state(rule, x, v, resting and rule != PLAIN, pt)
    status = _CERTIFIED if exactly else _COMPUTED
    if count > 0:
        lead = PhaseGrid(table, span / count, 1)
        if exactly:
            prepared = prepare_exact(lead, pt, scratch)
        else:
            prepared = prepare(method, lead, pt)
        for n in range(1, count + 1):
            for row in range(3):
                table[row, 0] = table[row, 1]
            table[THETA, 1] = pt.phase + span * n / count
            table[SIN, 1], table[COS, 1] = sin_cos(table[THETA, 1])
            if exactly:
                state, _, outcome = take_exact_grid_step(prepared, state, lead, 0, pt, scratch)
            else:
                state, _, outcome = take_grid_step(method, prepared, state, lead, 0, pt, scratch)
            status = max(status, outcome)
    return state, status
