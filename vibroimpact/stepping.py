"""One step of one orbit on the common grid: what every lane and every single orbit goes through."""

from __future__ import annotations

from vibroimpact.exact_impacts import reach
from vibroimpact.impacts import EXACT, mend
from vibroimpact.integrators import apply_map
from vibroimpact.jit import jit


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
