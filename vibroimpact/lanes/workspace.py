"""Lanes: the workspace of a block of points, side by side, so that vector registers are filled.

A lane is one parameter point. The steps per period are an integer, so omega t_n mod 2 pi is one
table for every lane, also where omega is swept, and the loops hold no trigonometry. Every loop
over lanes is a plain loop without branches, taken four steps at a time, so that what a lane needs
stays in registers.
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact.jit import bit, jit, lowest_bit, select
from vibroimpact.step.integrators import affine_map, apply_map
from vibroimpact.step.phases import COS, SIN
from vibroimpact.step.rules import PLAIN
from vibroimpact.step.stop import start

#: Points per block; no more than an integer has bits.
LANES = 32
#: Steps taken at a time.
STRIDE = 4

# Where the rows of a block's workspace begin; row + i belongs to lane i. One flat array, because
# the compiler then knows the distances between the rows.
(
    # The state, the affine map, and the stop. A lane at rest watches a stop at -inf, so that it is
    # looked at in every stride.
    X, V, XX, XV, XS, XC, VX, VV, VS, VC, LEVEL, CLEARANCE, RESTITUTION,
    # The phase before which a lane at rest is not released.
    WAKE,
    # Which lanes may meet their stops in a stride, side by side.
    MET,
    # The rows that the rule has for itself begin here.
    OWN,
) = range(0, 16 * LANES, LANES)  # fmt: skip
SIZE = OWN + 20 * LANES


@jit
def aligned(size):
    """Return an array of `size` zeros.

    The array begins at a line of the cache: a vector of 512 bits across two lines is read twice.
    Lanes without a point are computed, too. Memory that is not set to zero may hold subnormal
    numbers, with which a processor takes ten times as long.
    """
    memory = np.zeros(size + 7)
    skipped = -(memory.ctypes.data // 8) % 8
    return memory[skipped : skipped + size]


@jit(inline=True)
def set_start(w, points, rule, s):
    """Put every lane at its start, at a phase with the sine `s`, and its stop where it is."""
    for i in range(LANES):
        pt = points[min(i, points.size - 1)]  # a short block repeats its last point
        w[X + i], w[V + i], resting = start(pt, s)
        w[LEVEL + i] = -math.inf if resting and rule != PLAIN else pt.clearance
        w[CLEARANCE + i], w[RESTITUTION + i] = pt.clearance, pt.R
        w[WAKE + i] = -math.inf


@jit(inline=True)
def set_maps(w, points, integrator, grid):
    """Give every lane the affine map of one step of `grid`."""
    for i in range(LANES):
        pt = points[min(i, points.size - 1)]
        T = grid.step / pt.omega
        rows = affine_map(integrator, T, pt)
        for k in range(8):
            w[XX + k * LANES + i] = rows[k]


@jit(refcounts=False)
def map_of(w, i):
    """Return the two rows of the affine map of lane `i`."""
    to_x = w[XX + i], w[XV + i], w[XS + i], w[XC + i]
    return to_x, (w[VX + i], w[VV + i], w[VS + i], w[VC + i])


@jit(refcounts=False)
def glide_lane(w, i, x, v, s, c):
    """Take lane `i` from (x, v) over a step; also return whether it is below its ``LEVEL`` then."""
    to_x, to_v = map_of(w, i)
    x_T, v_T = apply_map(to_x, x, v, s, c), apply_map(to_v, x, v, s, c)
    return x_T, v_T, x_T < w[LEVEL + i]  # False for a NaN


@jit(inline=True)
def glide_stride(w, table, n):
    """Take the lanes from step `n` over a stride.

    A lane that may meet its stop in the stride stays where it is. Returns an integer with a bit set
    for each such lane.
    """
    s0, s1, s2, s3 = table[SIN, n], table[SIN, n + 1], table[SIN, n + 2], table[SIN, n + 3]
    c0, c1, c2, c3 = table[COS, n], table[COS, n + 1], table[COS, n + 2], table[COS, n + 3]
    met = 0
    for i in range(LANES):
        x, v, safe = glide_lane(w, i, w[X + i], w[V + i], s0, c0)
        x, v, safe_1 = glide_lane(w, i, x, v, s1, c1)
        x, v, safe_2 = glide_lane(w, i, x, v, s2, c2)
        x, v, safe_3 = glide_lane(w, i, x, v, s3, c3)
        safe &= safe_1 & safe_2 & safe_3
        w[X + i], w[V + i] = select(safe, x, w[X + i]), select(safe, v, w[V + i])
        met |= bit(not safe, i)
    return met


@jit(inline=True)
def glide_step(w, table, n):
    """As ``glide_stride``, over the single step `n`."""
    s, c = table[SIN, n], table[COS, n]
    met = 0
    for i in range(LANES):
        x, v, safe = glide_lane(w, i, w[X + i], w[V + i], s, c)
        w[X + i], w[V + i] = select(safe, x, w[X + i]), select(safe, v, w[V + i])
        met |= bit(not safe, i)
    return met


@jit(inline=True)
def list_met(w, n_points, bits):
    """List the lanes with a point whose bit is set, in row MET; return how many there are."""
    bits &= (1 << n_points) - 1
    n = 0
    while bits != 0:  # ends: one bit less each time
        w[MET + n] = lowest_bit(bits)
        bits &= bits - 1
        n += 1
    return n
