"""One step of one orbit on the common grid: what every lane and every single orbit goes through."""

from __future__ import annotations

import numpy as np

from vibroimpact.jit import jit
from vibroimpact.step.exact import Lane, guard, reach
from vibroimpact.step.flight import TERMS, fill_rows
from vibroimpact.step.integrators import affine_map, apply_map
from vibroimpact.step.phases import COS, SIN, THETA
from vibroimpact.step.rules import EXACT, mend


@jit(inline=True)
def take_step(rule, integrator, to_x, to_v, x, v, resting, theta, s, c, step, pt, lane, scratch):
    """Advance a state by its affine map, and mend the step where it may have met the stop.

    Parameters
    ----------
    to_x, to_v : tuple of 4 floats
        The rows of the map.

    Returns
    -------
    As from ``impacts.mend``; status 0 and no events for a step that needs no mending.
    """
    x_T = apply_map(to_x, x, v, s, c)
    v_T = apply_map(to_v, x, v, s, c)
    highest = x_T
    if rule == EXACT:
        highest = reach(x, v, x_T, lane.along_x, lane.along_v, lane.along_f)
    if resting or not highest < pt.clearance:
        return mend(rule, integrator, x, v, x_T, v_T, resting, theta, s, c, step, pt, lane, scratch)
    return x_T, v_T, False, 0, 0.0, 0, 0


@jit
def prepare(integrator, steps, pt):
    """Return the affine map of a step, and the Taylor rows and guard of the rule ``exact``."""
    T = steps.step / pt.omega
    rows = np.empty((4, TERMS))
    fill_rows(rows, T, pt)
    along_x, along_v, along_f = guard(T, pt)
    m = affine_map(integrator, T, pt)
    return (m[0], m[1], m[2], m[3]), (m[4], m[5], m[6], m[7]), Lane(rows, along_x, along_v, along_f)


@jit
def advance(rule, integrator, prepared, x, v, resting, steps, n, pt, scratch):
    """Step `n` of a run of steps; returns as ``take_step`` does."""
    to_x, to_v, lane = prepared
    theta, s, c = steps.table[THETA, n], steps.table[SIN, n], steps.table[COS, n]
    return take_step(
        rule, integrator, to_x, to_v, x, v, resting, theta, s, c, steps.step, pt, lane, scratch
    )
