"""The rule ``plain`` in the lanes: selects instead of branches, and impacts listed afterwards."""

from __future__ import annotations

import math

from vibroimpact.jit import jit, widest_vectors
from vibroimpact.lanes.tally import list_impact
from vibroimpact.lanes.workspace import CLEARANCE, LANES, OWN, RESTITUTION, STRIDE, V, X, map_of
from vibroimpact.status import Status
from vibroimpact.step.integrators import apply_map
from vibroimpact.step.phases import COS, SIN, THETA

# Rows of the workspace: the number of impacts, the highest displacement, and the speeds of the
# impacts of a stride.
IMPACTS, HIGHEST, SPEEDS = range(OWN, OWN + 3 * LANES, LANES)
_NON_FINITE = int(Status.NON_FINITE)


@jit(inline=True)
def clear_sums(w):
    """Begin the sums of every lane."""
    for i in range(LANES):
        w[IMPACTS + i], w[HIGHEST + i] = 0.0, w[CLEARANCE + i]


@jit(refcounts=False)
def plain_step(w, i, x, v, s, c, place, recording):
    """Take lane `i` from (x, v) over a step with the rule (2)-(5): selects instead of branches.

    The speed of its impact goes to `place`. Unlike in ``plain``, a displacement that overflowed is
    an impact, too, which forgets it where R = 0: see ``sum_up_plain``. A test here would cost 8 %.
    """
    to_x, to_v = map_of(w, i)
    x_T, v_T = apply_map(to_x, x, v, s, c), apply_map(to_v, x, v, s, c)
    impact = (x_T >= w[CLEARANCE + i]) & (v_T > 0.0)
    if recording:
        w[place] = v_T if impact else math.inf
        w[IMPACTS + i] += 1.0 if impact else 0.0
        w[HIGHEST + i] = x_T if x_T > w[HIGHEST + i] else w[HIGHEST + i]
    return w[CLEARANCE + i] if impact else x_T, -w[RESTITUTION + i] * v_T if impact else v_T


@jit(refcounts=False)
def advance_plain(w, n_points, grid, recording, tally):
    """Steps with the rule (2)-(5), four at a time, so that the maps stay in registers."""
    widest_vectors()
    size, table = grid.size, grid.table
    whole = size // STRIDE * STRIDE
    for n in range(0, whole, STRIDE):
        s0, s1, s2, s3 = table[SIN, n], table[SIN, n + 1], table[SIN, n + 2], table[SIN, n + 3]
        c0, c1, c2, c3 = table[COS, n], table[COS, n + 1], table[COS, n + 2], table[COS, n + 3]
        for i in range(LANES):
            x, v = plain_step(w, i, w[X + i], w[V + i], s0, c0, i + SPEEDS, recording)
            x, v = plain_step(w, i, x, v, s1, c1, i + SPEEDS + LANES, recording)
            x, v = plain_step(w, i, x, v, s2, c2, i + SPEEDS + 2 * LANES, recording)
            w[X + i], w[V + i] = plain_step(w, i, x, v, s3, c3, i + SPEEDS + 3 * LANES, recording)
        if recording:
            list_plain_impacts(w, n_points, n, n + STRIDE, grid, tally)
    for n in range(whole, size):
        s0, c0 = table[SIN, n], table[COS, n]
        for i in range(LANES):
            w[X + i], w[V + i] = plain_step(w, i, w[X + i], w[V + i], s0, c0, i + SPEEDS, recording)
        if recording:
            list_plain_impacts(w, n_points, n, n + 1, grid, tally)


@jit(refcounts=False)
def list_plain_impacts(w, n_points, n, end, grid, tally):
    """Put the impacts of the steps from `n` to before `end` into the tally of their lanes."""
    for i in range(n_points):
        if w[IMPACTS + i] > tally.sums[i].impacts:
            for j in range(end - n):
                speed = w[SPEEDS + j * LANES + i]
                if speed < math.inf:
                    phase = grid.table[THETA, n + j] + grid.step
                    list_impact(tally.impacts[i], tally.sums[i], phase, speed)


@jit(inline=True)
def sum_up_plain(w, n_points, tally):
    """Put what the lanes have summed up into the tally."""
    for i in range(n_points):
        sums = tally.sums[i]
        sums.max_penetration = w[HIGHEST + i] - w[CLEARANCE + i]
        if not sums.max_penetration < math.inf:  # an impact may have put it back to the stop
            sums.status = _NON_FINITE
