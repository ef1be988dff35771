"""A block of points in the lanes with the rule ``exact``: its memory, and what is set in it.

A lane is one parameter point; the points of a block lie side by side, so that vectors are filled.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import jit, widest_vectors
from vibroimpact.lanes.columns import new_columns, put_pair
from vibroimpact.lanes.tally import Tally
from vibroimpact.lanes.workspace import aligned
from vibroimpact.step.flow import Flow, Forcing, enter, equation_of, flow_of, forced, leave
from vibroimpact.step.phases import COS, SIN
from vibroimpact.step.stop import Scratch, new_scratch, start

#: Points per block at the most; a power of 2.
EXACT_LANES = 128
#: The distance of rows; not a power of two, which would put them all into one set of the cache.
LANE_ROW = EXACT_LANES + 24
# Up to this many steps a period, what each step adds is kept; more would not fit into the cache.
_KEPT = 64
#: The numbers of a lane from LANE_EQUATION on: one line of the cache, of which five are used.
EQUATION_SIZE = 8

# Where the rows of a block's lanes begin; row + i belongs to lane i. The states, and the tangent
# vectors, have two rows: for the starts of even steps, and of odd ones.
Y, W, TANGENTS = 0, 2 * LANE_ROW, 4 * LANE_ROW
FLOW = TANGENTS + 8 * LANE_ROW
FORCING = FLOW + 7 * LANE_ROW
LANE_E, HIGH, CLEARANCE, OMEGA = range(FORCING + 6 * LANE_ROW, FORCING + 10 * LANE_ROW, LANE_ROW)
RESTING, WAKE, SLEPT = range(OMEGA + LANE_ROW, OMEGA + 4 * LANE_ROW, LANE_ROW)
# The equations are not in rows: the numbers of one lane follow each other.
LANE_EQUATION = SLEPT + LANE_ROW
_SIZE = LANE_EQUATION + EQUATION_SIZE * EXACT_LANES


class Memory(NamedTuple):
    """The memory for a block.

    Attributes
    ----------
    w : ndarray
        The rows of the lanes.
    met : ndarray of int
        The list of lanes that may have met the stop.
    columns : ndarray
    added : ndarray, shape (steps, 2, LANE_ROW)
        What a step adds to y and w of each lane, see ``forced``.
    scratch : Scratch
    """

    w: np.ndarray
    met: np.ndarray
    columns: np.ndarray
    added: np.ndarray
    scratch: Scratch


class Block(NamedTuple):
    """A block of points; the tally has a row for each of them."""

    memory: Memory
    points: np.ndarray
    tally: Tally


@jit
def new_memory():
    """Return the memory for a block; one per thread."""
    met = np.zeros(EXACT_LANES, np.int64)
    added = aligned(2 * _KEPT * LANE_ROW).reshape((_KEPT, 2, LANE_ROW))
    return Memory(aligned(_SIZE), met, new_columns(), added, new_scratch())


@jit(inline=True)
def flow_in(w, i):
    """Return the ``Flow`` of lane `i`."""
    f = FLOW + i
    return Flow(
        w[f], w[f + LANE_ROW], w[f + 2 * LANE_ROW], w[f + 3 * LANE_ROW], w[f + 4 * LANE_ROW],
        w[f + 5 * LANE_ROW], w[f + 6 * LANE_ROW],
    )  # fmt: skip


@jit(refcounts=False)
def set_start(w, points, s):
    """Put every lane at its start, at a phase with the sine `s`."""
    for i in range(EXACT_LANES):
        pt = points[min(i, points.size - 1)]  # a short block repeats its last point
        x, v, resting = start(pt, s)
        w[Y + i], w[W + i] = enter(x, v, pt.clearance, pt.omega)
        w[CLEARANCE + i], w[OMEGA + i] = pt.clearance, pt.omega
        w[RESTING + i], w[WAKE + i], w[SLEPT + i] = 1.0 if resting else 0.0, -math.inf, 0.0
        # Zeros where there is no point: with numbers that became subnormal all would be slow.
        one = 1.0 if i < points.size else 0.0
        put_pair(w, TANGENTS + i, 2 * LANE_ROW, (one, 0.0, 0.0, one / pt.omega))


@jit(refcounts=False)
def force_lanes(w, added, s, c):
    """Set what a step from the phase with sine `s` and cosine `c` adds to each lane."""
    widest_vectors()
    for i in range(EXACT_LANES):
        f = FORCING + i
        forcing = Forcing(
            w[f], w[f + LANE_ROW], w[f + 2 * LANE_ROW], w[f + 3 * LANE_ROW], w[f + 4 * LANE_ROW],
            w[f + 5 * LANE_ROW],
        )  # fmt: skip
        added[0, i], added[1, i] = forced(forcing, s, c)


@jit(refcounts=False)
def set_equations(memory, points, grid):
    """Give every lane its equation, and its flow over a step of `grid`."""
    w = memory.w
    for i in range(EXACT_LANES):
        k = min(i, points.size - 1)
        if i == k:
            eq = equation_of(points[k])
            flow, forcing = flow_of(eq, grid.step, memory.scratch.coefficients)
        for q in range(7):
            w[FLOW + q * LANE_ROW + i] = flow[q]
        for q in range(6):
            w[FORCING + q * LANE_ROW + i] = forcing[q]
        for q in range(5):
            w[LANE_EQUATION + EQUATION_SIZE * i + q] = eq[q]
    if grid.size <= _KEPT:
        for n in range(grid.size):
            force_lanes(w, memory.added[n], grid.table[SIN, n], grid.table[COS, n])


@jit(refcounts=False)
def place_of_added(memory, grid, n):
    """Return the place in ``Memory.added`` of what step `n` of `grid` adds to each lane.

    Where not all steps are kept, it is computed, into the first place.
    """
    if grid.size <= _KEPT:
        return n
    force_lanes(memory.w, memory.added[0], grid.table[SIN, n], grid.table[COS, n])
    return 0


@jit(refcounts=False)
def round_states(w):
    """Round the states to (x, v), and put these into the rows for odd steps."""
    widest_vectors()
    for i in range(EXACT_LANES):
        stop, omega = w[CLEARANCE + i], w[OMEGA + i]
        x, v = leave(w[Y + i], w[W + i], stop, omega)
        w[Y + LANE_ROW + i], w[W + LANE_ROW + i] = x, v
        w[Y + i], w[W + i] = enter(x, v, stop, omega)
        w[WAKE + i] -= 2.0 * math.pi  # the grid's phases begin again
