"""One step of one orbit on the common grid, with the arithmetic of the kernel's lanes.

The state of an orbit between steps is (x, v, resting), or with the rule ``exact`` (y, w, resting)
in the units of ``propagator.py``. At the end of a period it is rounded to (x, v), so that a run
that starts from a recorded section continues the previous run to the last bit.
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
    """The maps of a point for steps of one length: the affine map, and those for exact impacts."""

    to_x: tuple[float, float, float, float]
    to_v: tuple[float, float, float, float]
    eq: Coefficients
    propagators: tuple[Propagator, Forcing]


@jit
def prepare(integrator, grid, pt):
    """Compute what the steps of a grid need of a point."""
    m = affine_map(integrator, grid.step / pt.omega, pt)
    eq = coefficients_of(pt)
    return Prepared(m[:4], m[4:], eq, propagator_of(eq, grid.step, np.empty(TERMS)))


@jit(inline=True)
def to_state(rule, x, v, resting, pt):
    """Return the state of an orbit for (x, v)."""
    if rule == EXACT:
        x, v = to_dimensionless(x, v, pt.clearance, pt.omega)
    return x, v, resting


@jit(inline=True)
def from_state(rule, state, pt):
    """Return (x, v) for the state of an orbit."""
    x, v, _ = state
    if rule == EXACT:
        x, v = from_dimensionless(x, v, pt.clearance, pt.omega)
    return x, v


@jit(inline=True)
def take_step(method, rows, state, phase, step, pt, scratch):
    """Take a state over a step by the rows of its affine map, and correct it if it met the stop.

    `method` holds the codes of the rule, which is not ``exact``, and of the integrator. `phase` is
    the phase at the start, its sine and its cosine; `step` is omega T. Returns the same as
    ``reduced_step``.
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
    """Take a step with the rule ``exact``, as ``kernel/exact.py`` does for many points at once.

    `phase` is the phase at the start, its sine and its cosine; `end_wave` is sine and cosine at the
    end. Returns the same as ``exact_step``.
    """
    (y, w, _), (_, s, c) = state, phase
    propagator, forcing = propagators
    y_T, w_T, bound, guard = propagate(propagator, y, w, forced(forcing, s, c), step)
    if guard < 0.0:
        return y_T, w_T, False, 0, 0.0, 0, 0
    waves = s, c, end_wave[0], end_wave[1]
    impact = single_impact(eq, (y, w), (y_T, w_T, bound), waves, step, 1)
    if impact.proved == ONLY:
        n = log_impact(scratch.events, impact, pt)
        return impact.y, impact.w, False, n, 0.0, 0, 0
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
