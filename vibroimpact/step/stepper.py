"""One step of one orbit on the common grid: what every lane and every single orbit goes through.

The state of an orbit between steps is (x, v, resting), with the rule ``exact`` (y, w, resting) in
the units of ``propagator.py``. Where a period ends it is rounded to (x, v), so that a run that
starts from a recorded section continues the one before to the last bit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibroimpact.jit import jit
from vibroimpact.status import Status
from vibroimpact.step.exact import exact_step, log_impact
from vibroimpact.step.impact import ONLY, single_impact
from vibroimpact.step.integrators import affine_map, apply_map
from vibroimpact.step.propagator import (
    Coefficients,
    Forcing,
    Propagator,
    coefficients_of,
    forced,
    from_dimensionless,
    propagate,
    propagator_of,
    to_dimensionless,
)
from vibroimpact.step.scheme import COS, EXACT, PLAIN, SIN, THETA
from vibroimpact.step.series import TERMS
from vibroimpact.step.time_stepping import plain, reduced_step

_COMPUTED = int(Status.COMPUTED)


class Prepared(NamedTuple):
    """What a point needs for steps of one length: the affine map, and what exact impacts need."""

    to_x: tuple[float, float, float, float]
    to_v: tuple[float, float, float, float]
    eq: Coefficients
    propagators: tuple[Propagator, Forcing]


@jit
def prepare(integrator, grid, pt):
    """Return what is needed of a point for the steps of a grid."""
    m = affine_map(integrator, grid.step / pt.omega, pt)
    eq = coefficients_of(pt)
    return Prepared(m[:4], m[4:], eq, propagator_of(eq, grid.step, np.empty(TERMS)))


@jit(inline=True)
def to_state(rule, x, v, resting, pt):
    """Return the state of an orbit at (x, v)."""
    if rule == EXACT:
        x, v = to_dimensionless(x, v, pt.clearance, pt.omega)
    return x, v, resting


@jit(inline=True)
def from_state(rule, state, pt):
    """Return (x, v) of the state of an orbit."""
    x, v, _ = state
    if rule == EXACT:
        x, v = from_dimensionless(x, v, pt.clearance, pt.omega)
    return x, v


@jit(inline=True)
def take_step(method, rows, state, phase, step, pt, scratch):
    """Take a state over a step by the rows of its affine map, and correct it if it met the stop.

    `method` is the codes of a rule other than ``exact`` and of the integrator, `phase` that at the
    start with its sine and cosine, `step` is omega T; returns what ``reduced_step`` does.
    """
    (x, v, resting), (_, s, c), (to_x, to_v) = state, phase, rows
    x_T, v_T = apply_map(to_x, x, v, s, c), apply_map(to_v, x, v, s, c)
    if resting or not x_T < pt.clearance:
        if method[0] != PLAIN:
            return reduced_step(method, state, (x_T, v_T), phase, step / pt.omega, pt, scratch)
        x, v, n = plain(x_T, v_T, step / pt.omega, pt, scratch)
        return x, v, False, n, 0.0, _COMPUTED
    return x_T, v_T, False, 0, 0.0, _COMPUTED


@jit
def take_exact_step(eq, propagators, state, phase, end_wave, step, pt, scratch):
    """Take a step with the rule ``exact``, as ``kernel/exact.py`` does with many side by side.

    `phase` is that at the start with its sine and cosine, `end_wave` sine and cosine of that at the
    end; returns what ``exact_step`` does.
    """
    (y, w, _), (_, s, c) = state, phase
    propagator, forcing = propagators
    y_T, w_T, bound, guard = propagate(propagator, y, w, forced(forcing, s, c), step)
    if guard < 0.0:
        return y_T, w_T, False, 0, 0.0, 0, 0
    waves = s, c, end_wave[0], end_wave[1]
    impact = single_impact(eq, (y, w), (y_T, w_T, bound), waves, step, 1)
    if impact[4] == ONLY:
        n = log_impact(scratch.events, impact, pt)
        return impact[0], impact[1], False, n, 0.0, 0, 0
    return exact_step(eq, pt, state, (y_T, w_T, bound), impact, phase, step, scratch)


@jit
def take_grid_step(method, prepared, state, grid, n, pt, scratch):
    """Take step `n` of a grid; return the state, the number of events, and the status."""
    table = grid.table
    phase = table[THETA, n], table[SIN, n], table[COS, n]
    if method[0] == EXACT:
        end_wave = table[SIN, n + 1], table[COS, n + 1]
        y, w, resting, n_events, _, status, _ = take_exact_step(
            prepared.eq, prepared.propagators, state, phase, end_wave, grid.step, pt, scratch
        )
        return (y, w, resting), n_events, status
    rows = prepared.to_x, prepared.to_v
    x, v, resting, n_events, _, status = take_step(
        method, rows, state, phase, grid.step, pt, scratch
    )
    return (x, v, resting), n_events, status
