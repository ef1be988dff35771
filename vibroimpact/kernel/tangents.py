"""Takes the tangent vectors of all lanes along; normalises them, sums growth."""

from __future__ import annotations

import math

from vibroimpact.jit import jit, select, widest_vectors
from vibroimpact.kernel.workspace import (
    GUARD,
    ROW,
    TANGENT,
    list_lanes,
    propagator_in,
    put_tangent,
    tangent_in,
    whole_vectors,
)
from vibroimpact.step.elementary import hypot, log
from vibroimpact.step.variational import propagate_tangent

#: Steps between two checks of the tangent vectors.
CHECKED_EVERY = 4


@jit
def propagate_all_tangents(lanes, size, n):
    """Take the tangent vectors of the first lanes over step `n`."""
    widest_vectors()
    old_row, new_row = (n & 1) * ROW, (~n & 1) * ROW
    for i in range(whole_vectors(size)):
        tangent = tangent_in(lanes, TANGENT + old_row + i, 2 * ROW)
        tangent = propagate_tangent(propagator_in(lanes, i), tangent)
        put_tangent(lanes, TANGENT + new_row + i, 2 * ROW, tangent)


@jit
def normalise(tangent, sums):
    """Give a tangent vector the length 1, and add up its growth."""
    y, w = tangent
    length = hypot(y, w)
    if length == 0.0:  # after a rest
        sums.growth = -math.inf
        return tangent
    sums.growth += log(length)
    return y / length, w / length


@jit
def judge_tangents(lanes, size, row):
    """Find tangent vectors that would soon be too short or long: their GUARD is not negative."""
    widest_vectors()
    for i in range(whole_vectors(size)):
        y, w = tangent_in(lanes, row + i, 2 * ROW)
        square = y * y + w * w
        lanes[GUARD + i] = select((square > 1e-100) & (square < 1e100), -1.0, 1.0)


@jit
def normalise_lanes(batch, n):
    """Normalise the tangent vectors that need it, before step `n`."""
    workspace, _, size = batch
    lanes, met = workspace.lanes, workspace.met
    row = TANGENT + (n & 1) * ROW
    judge_tangents(lanes, size, row)
    for j in range(list_lanes(lanes, met, size)):
        a = row + met[j]
        tangent = normalise(tangent_in(lanes, a, 2 * ROW), workspace.sums[met[j]])
        put_tangent(lanes, a, 2 * ROW, tangent)


@jit
def sum_up_tangents(workspace, i):
    """Add up the growth that remains in lane `i`, in dx^2 + (dv / p)^2, and that of an area."""
    (y, w), pt = tangent_in(workspace.lanes, TANGENT + i, 2 * ROW), workspace.points[i]
    sums = workspace.sums[i]
    normalise((y, w * pt.omega / pt.p), sums)
    sums.area = 2.0 * sums.impacts * log(pt.R) if sums.impacts > 0 else 0.0
