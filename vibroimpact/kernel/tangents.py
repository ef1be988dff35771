"""The tangent vectors of all lanes, for Lyapunov exponents: steps, lengths and growth of area."""

from __future__ import annotations

from vibroimpact.jit import jit, select, widest_vectors
from vibroimpact.kernel.workspace import (
    GUARD,
    ROW,
    TANGENTS,
    list_lanes,
    pair_in,
    propagator_in,
    put_pair,
    whole_vectors,
)
from vibroimpact.step.variational import orthonormalise, propagate_tangents

#: Steps between two checks of the tangent vectors.
CHECKED_EVERY = 4


@jit
def propagate_all_tangents(lanes, size, n):
    """Take the tangent vectors of the first lanes over step `n`."""
    widest_vectors()
    old_row, new_row = (n & 1) * ROW, (~n & 1) * ROW
    for i in range(whole_vectors(size)):
        pair = propagate_tangents(
            propagator_in(lanes, i), pair_in(lanes, TANGENTS + old_row + i, 2 * ROW)
        )
        put_pair(lanes, TANGENTS + new_row + i, 2 * ROW, pair)


@jit
def stretch(pair, sums):
    """Orthonormalise two tangent vectors, and add up their growth."""
    pair, growth_1, growth_2 = orthonormalise(pair)
    sums.growth_1 += growth_1
    sums.growth_2 += growth_2
    return pair


@jit
def judge_tangents(lanes, size, row):
    """Find tangent vectors that would soon be too short, too long or too parallel.

    The GUARD of a lane with such vectors is not negative.
    """
    widest_vectors()
    for i in range(whole_vectors(size)):
        ay, aw, by, bw = pair_in(lanes, row + i, 2 * ROW)
        size_2 = ay * ay + aw * aw + by * by + bw * bw
        fit = (abs(ay * bw - aw * by) >= 1e-4 * size_2) & (size_2 > 1e-100) & (size_2 < 1e100)
        lanes[GUARD + i] = select(fit, -1.0, 1.0)


@jit
def stretch_lanes(batch, n):
    """Orthonormalise the tangent vectors that need it, before step `n`."""
    workspace, _, size = batch
    lanes, met = workspace.lanes, workspace.met
    row = TANGENTS + (n & 1) * ROW
    judge_tangents(lanes, size, row)
    for j in range(list_lanes(lanes, met, size)):
        a = row + met[j]
        put_pair(lanes, a, 2 * ROW, stretch(pair_in(lanes, a, 2 * ROW), workspace.sums[met[j]]))


@jit
def sum_up_tangents(workspace, i):
    """Add up the growth that remains in the tangent vectors of lane `i`, in dx^2 + (dv / p)^2."""
    ay, aw, by, bw = pair_in(workspace.lanes, TANGENTS + i, 2 * ROW)
    unit = workspace.points[i].omega / workspace.points[i].p
    stretch((ay, aw * unit, by, bw * unit), workspace.sums[i])
