"""One step of one orbit on the common grid: what every lane and every single orbit goes through.

The state of an orbit between steps is (x, v, resting), with the rule ``exact`` (y, w, resting) in
the units of ``flow.py``. Where a period ends it is rounded to (x, v), so that a run that starts
from a recorded section continues the one before to the last bit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibroimpact.jit import jit
from vibroimpact.status import Status
from vibroimpact.step.exact import exact_step, log_impact
from vibroimpact.step.flight import TERMS
from vibroimpact.step.flow import (
    Equation,
    Flow,
    Forcing,
    enter,
    equation_of,
    flow_of,
    forced,
    glide,
    leave,
)
from vibroimpact.step.integrators import affine_map, apply_map
from vibroimpact.step.phases import COS, SIN, THETA
from vibroimpact.step.reduced_step import plain, reduced_step
from vibroimpact.step.rules import EXACT, PLAIN
from vibroimpact.step.single_impact import ONLY, single_impact

_COMPUTED = int(Status.COMPUTED)


class Prepared(NamedTuple):
    """What a point needs for steps of one length.

    Attributes
    ----------
    to_x, to_v : 4 floats
        The rows of the affine map of the integrator.
    eq : Equation
    flows : (Flow, Forcing)
        What the rule ``exact`` needs.
    """

    to_x: tuple[float, float, float, float]
    to_v: tuple[float, float, float, float]
    eq: Equation
    flows: tuple[Flow, Forcing]


@jit
def prepare(integrator, steps, pt):
    """Return what is needed of a point for steps of that length."""
    m = affine_map(integrator, steps.step / pt.omega, pt)
    eq = equation_of(pt)
    return Prepared(m[:4], m[4:], eq, flow_of(eq, steps.step, np.empty(TERMS)))


@jit(inline=True)
def to_state(rule, x, v, resting, pt):
    """Return the state of an orbit at (x, v)."""
    if rule == EXACT:
        x, v = enter(x, v, pt.clearance, pt.omega)
    return x, v, resting


@jit(inline=True)
def from_state(rule, state, pt):
    """Return (x, v) of the state of an orbit."""
    x, v, _ = state
    if rule == EXACT:
        x, v = leave(x, v, pt.clearance, pt.omega)
    return x, v


@jit(inline=True)
def take_step(method, rows, state, phase, step, pt, scratch):
    """Advance a state by its affine map, and mend the step where it met the stop.

    Parameters
    ----------
    method : (int, int)
        The codes of an impact rule other than ``exact``, and of the integrator.
    rows : two tuples of 4 floats
        The rows of the map.
    state : (float, float, bool)
    phase : (float, float, float)
        Phase at the start of the step, its sine and its cosine.
    step : float
        omega T.

    Returns
    -------
    As from ``reduced_step``.
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
def take_exact_step(eq, flows, state, phase, end_wave, step, pt, scratch):
    """Take a step with the rule ``exact``, as ``kernel/exact.py`` does with many side by side.

    Parameters
    ----------
    flows : (Flow, Forcing)
    phase : (float, float, float)
        Phase at the start of the step, its sine and its cosine.
    end_wave : (float, float)
        Sine and cosine of the phase at its end.

    Returns
    -------
    As from ``exact.exact_step``.
    """
    (y, w, _), (_, s, c) = state, phase
    flow, forcing = flows
    y_T, w_T, E, high = glide(flow, y, w, forced(forcing, s, c), step)
    if high < 0.0:
        return y_T, w_T, False, 0, 0.0, 0, 0
    waves = s, c, end_wave[0], end_wave[1]
    impact = single_impact(eq, (y, w), (y_T, w_T, E), waves, step, 1)
    if impact[4] == ONLY:
        n = log_impact(scratch.events, impact, pt)
        return impact[0], impact[1], False, n, 0.0, 0, 0
    return exact_step(eq, pt, state, (y_T, w_T, E), impact, phase, step, scratch)


@jit
def advance(method, prepared, state, steps, n, pt, scratch):
    """Take step `n` of a run of steps.

    Returns
    -------
    state : (float, float, bool)
    n : int
        Number of events in ``scratch``.
    status : int
    """
    table = steps.table
    phase = table[THETA, n], table[SIN, n], table[COS, n]
    if method[0] == EXACT:
        end_wave = table[SIN, n + 1], table[COS, n + 1]
        y, w, resting, n_events, _, status, _ = take_exact_step(
            prepared.eq, prepared.flows, state, phase, end_wave, steps.step, pt, scratch
        )
        return (y, w, resting), n_events, status
    rows = prepared.to_x, prepared.to_v
    x, v, resting, n_events, _, status = take_step(
        method, rows, state, phase, steps.step, pt, scratch
    )
    return (x, v, resting), n_events, status
