"""The stepping kernel: lanes, blocks and threads. The only place that knows them.

A lane is one parameter point. Lanes stand side by side in blocks of ``LANES``, and the loop is
"for step: for lane", so that the compiler fills vector registers; ``prange`` runs over blocks.
The steps per period are an integer, so omega t_n mod 2 pi is one table for every lane, also
where omega is swept, and the loop holds no trigonometry. Every lane is advanced by its affine
map; only lanes that ended on or beyond the stop are mended by the impact rule, after the loop
(with the rule ``exact``, those that its guard does not keep off the stop).
A lane at rest watches a stop at -inf, so that it is looked at in every step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from vibroimpact.exact_impacts import Lane, guard, reach
from vibroimpact.flight import TERMS, fill_rows
from vibroimpact.impacts import EXACT, PLAIN, mend
from vibroimpact.integrators import affine_map, apply_map
from vibroimpact.jit import fma, jit
from vibroimpact.lyapunov import carry_tangents, orthonormalise
from vibroimpact.phases import COS, SIN, THETA
from vibroimpact.status import Status
from vibroimpact.stop import (
    DISPLACEMENT,
    IMPACT,
    KIND,
    REST,
    SPEED,
    TIME,
    new_scratch,
    start,
    time_to_release,
)

#: Points per block.
LANES = 32

# Rows of a block's workspace, one column per lane: the state, the state at the end of the step,
# the affine map, and what the impact rule needs.
X, V, X_T, V_T, XX, XV, XS, XC, VX, VV, VS, VC, LEVEL, CLEARANCE, RESTITUTION = range(15)
# The phase before which a lane at rest is not released.
WAKE = 15
# For the rule ``exact``: the guard, and the greatest x that it allows in the step.
ALONG_X, ALONG_V, ALONG_F, REACH = range(16, 20)
# Two tangent vectors, and the same at the end of the step.
TANGENTS, TANGENTS_T = 20, 24
ROWS = 28

_UNRESOLVED, _NON_FINITE = int(Status.UNRESOLVED), int(Status.NON_FINITE)


#: What is summed up over the recorded periods of a point, beside its last status.
SUMS = np.dtype(
    [
        ("impacts", np.int64),
        ("slowest_impact", float),
        ("max_penetration", float),
        ("rested", float),
        ("chatters", np.int64),
        ("near_grazes", np.int64),
        ("growth_1", float),
        ("growth_2", float),
        ("status", np.int64),
    ]
)


class Tally(NamedTuple):
    """What is kept of the recorded periods, one row per point.

    Attributes
    ----------
    sections : ndarray, shape (n, periods, 2)
        x and v at the end of each period.
    impacts : ndarray, shape (n, capacity, 2)
        Phase and speed of the last impacts, as a ring: the last overwrite the first.
    sums : ndarray of dtype ``SUMS``, shape (n,)
    """

    sections: np.ndarray
    impacts: np.ndarray
    sums: np.ndarray


@jit(inline=True)
def predict(w, s, c):
    """Advance every lane by its map into rows X_T, V_T; return whether any met its stop."""
    met = False
    for i in range(LANES):
        x, v = w[X, i], w[V, i]
        x_T = apply_map((w[XX, i], w[XV, i], w[XS, i], w[XC, i]), x, v, s, c)
        w[X_T, i] = x_T
        w[V_T, i] = apply_map((w[VX, i], w[VV, i], w[VS, i], w[VC, i]), x, v, s, c)
        met |= not x_T < w[LEVEL, i]  # a NaN is looked at, too
    return met


@jit(inline=True)
def predict_guarded(w, s, c):
    """As ``predict``, but return whether any may have met its stop between the grid points."""
    met = False
    for i in range(LANES):
        x, v = w[X, i], w[V, i]
        x_T = apply_map((w[XX, i], w[XV, i], w[XS, i], w[XC, i]), x, v, s, c)
        w[X_T, i] = x_T
        w[V_T, i] = apply_map((w[VX, i], w[VV, i], w[VS, i], w[VC, i]), x, v, s, c)
        w[REACH, i] = reach(x, v, x_T, w[ALONG_X, i], w[ALONG_V, i], w[ALONG_F, i])
        met |= not w[REACH, i] < w[LEVEL, i]
    return met


@jit(inline=True)
def advance_plain(w, grid):
    """Steps with the rule (2)-(5), nothing recorded: selects instead of branches.

    As ``plain``, but that a displacement which overflowed is taken for an impact, too: with R = 0
    that forgets it with the rest of the past. To test for it would cost 3 % here.
    """
    for n in range(grid.table.shape[1]):
        s, c = grid.table[SIN, n], grid.table[COS, n]
        for i in range(LANES):
            x, v = w[X, i], w[V, i]
            x_T = apply_map((w[XX, i], w[XV, i], w[XS, i], w[XC, i]), x, v, s, c)
            v_T = apply_map((w[VX, i], w[VV, i], w[VS, i], w[VC, i]), x, v, s, c)
            impact = (x_T >= w[CLEARANCE, i]) & (v_T > 0.0)
            w[X, i] = w[CLEARANCE, i] if impact else x_T
            w[V, i] = -w[RESTITUTION, i] * v_T if impact else v_T


@jit(inline=True)
def set_start(w, points, rule):
    """Put every lane at its start, and its stop where it is."""
    for i in range(LANES):
        pt = points[min(i, points.size - 1)]  # a short block repeats its last point
        w[X, i], w[V, i], resting = start(pt)
        w[LEVEL, i] = -math.inf if resting and rule != PLAIN else pt.clearance
        w[CLEARANCE, i], w[RESTITUTION, i] = pt.clearance, pt.R
        w[WAKE, i] = -math.inf
        for k in range(4):
            w[TANGENTS + k, i] = 1.0 if k == 0 or k == 3 else 0.0


@jit(inline=True)
def set_maps(w, taylor, points, rule, integrator, grid):
    """Give every lane the affine map of one step of `grid`, and its Taylor rows and guard."""
    for i in range(LANES):
        pt = points[min(i, points.size - 1)]
        T = grid.step / pt.omega
        rows = affine_map(integrator, T, pt)
        for k in range(8):
            w[XX + k, i] = rows[k]
        if rule == EXACT:
            fill_rows(taylor[i], T, pt)
            w[ALONG_X, i], w[ALONG_V, i], w[ALONG_F, i] = guard(T, pt)


@jit(inline=True)
def record_step(events, n, x_T, rested, grazes, theta, pt, row, tally):
    """Add the events of one mended step to the tally of the lane in that row."""
    sums = tally.sums[row]
    depth = x_T - pt.clearance
    capacity = tally.impacts.shape[1]
    for k in range(n):
        kind = events[k, KIND]
        if kind == IMPACT:
            depth = max(depth, events[k, DISPLACEMENT] - pt.clearance)
            speed = events[k, SPEED]
            sums.slowest_impact = min(sums.slowest_impact, speed)
            if capacity > 0:
                slot = sums.impacts % capacity
                at = theta + pt.omega * events[k, TIME]
                while at >= 2.0 * math.pi:  # twice at the most
                    at -= 2.0 * math.pi
                tally.impacts[row, slot, 0] = at
                tally.impacts[row, slot, 1] = speed
            sums.impacts += 1
        elif kind == REST:
            sums.chatters += 1
    sums.rested += rested
    sums.near_grazes += grazes
    sums.max_penetration = max(sums.max_penetration, depth)


@jit(leaf=True)
def mend_lane(w, i, taylor, rule, integrator, n, grid, pt, scratch):
    """Mend one lane that met its stop in step `n`; returns what is to be recorded of it."""
    theta, s, c = grid.table[THETA, n], grid.table[SIN, n], grid.table[COS, n]
    lane = Lane(taylor[i], w[ALONG_X, i], w[ALONG_V, i], w[ALONG_F, i])
    x, v, resting, n_events, rested, status, grazes = mend(
        rule, integrator, w[X, i], w[V, i], w[X_T, i], w[V_T, i], w[LEVEL, i] < pt.clearance,
        theta, s, c, grid.step, pt, lane, scratch,
    )  # fmt: skip
    end = w[X_T, i] if rule == PLAIN else x
    w[X_T, i], w[V_T, i] = x, v
    w[LEVEL, i] = -math.inf if resting else pt.clearance
    if resting:
        w[WAKE, i] = theta + grid.step + pt.omega * time_to_release(theta + grid.step, pt)
    return end, n_events, rested, status, grazes


@jit(inline=True)
def advance(w, taylor, first, points, rule, integrator, grid, recording, lyapunov, tally, scratch):
    """Steps over `grid`: predict every lane, mend those that met the stop."""
    watched = REACH if rule == EXACT else X_T
    for n in range(grid.table.shape[1]):
        theta, s, c = grid.table[THETA, n], grid.table[SIN, n], grid.table[COS, n]
        met = predict_guarded(w, s, c) if rule == EXACT else predict(w, s, c)
        if lyapunov and recording:
            predict_tangents(w)
        if met:
            for i in range(points.size):
                if w[watched, i] < w[LEVEL, i]:
                    continue
                pt, sums = points[i], tally.sums[first + i]
                if theta + grid.step < w[WAKE, i] - 1e-9:  # asleep
                    w[X_T, i], w[V_T, i] = pt.clearance, 0.0
                    if recording:
                        sums.rested += grid.step / pt.omega
                    continue
                w[WAKE, i] = -math.inf
                end, n_events, rested, status, grazes = mend_lane(
                    w, i, taylor, rule, integrator, n, grid, pt, scratch
                )
                sums.status = max(sums.status, status)
                if recording:
                    record_step(
                        scratch.events, n_events, end, rested, grazes, theta, pt, first + i, tally
                    )
                    if lyapunov and n_events > 0:
                        carry_tangents(
                            w[TANGENTS : TANGENTS + 4, i], w[TANGENTS_T : TANGENTS_T + 4, i],
                            scratch.events, n_events, theta, grid.step / pt.omega, taylor[i], pt,
                        )  # fmt: skip
        accept(w, lyapunov and recording)
        if lyapunov and recording:
            stretch(w, first, points.size, tally, n + 1 == grid.table.shape[1])


@jit(inline=True)
def accept(w, tangents):
    """Take the end of the step as the state of every lane, and of its tangent vectors."""
    for i in range(LANES):
        w[X, i] = w[X_T, i]
        w[V, i] = w[V_T, i]
    if tangents:
        for i in range(LANES):
            awake = w[LEVEL, i] > -math.inf
            for k in range(4):
                w[TANGENTS + k, i] = w[TANGENTS_T + k, i] if awake else 0.0


@jit(inline=True)
def predict_tangents(w):
    """Advance the tangent vectors of every lane by its map."""
    for i in range(LANES):
        for k in range(0, 4, 2):
            x, v = w[TANGENTS + k, i], w[TANGENTS + k + 1, i]
            w[TANGENTS_T + k, i] = fma(w[XX, i], x, w[XV, i] * v)
            w[TANGENTS_T + k + 1, i] = fma(w[VX, i], x, w[VV, i] * v)


@jit(inline=True)
def stretch(w, first, n, tally, always):
    """Orthonormalise the tangent vectors of `n` lanes and add up their growth.

    Where not `always`, only those that would soon be too short or too parallel for their digits.
    """
    for i in range(n):
        ax, av = w[TANGENTS, i], w[TANGENTS + 1, i]
        bx, bv = w[TANGENTS + 2, i], w[TANGENTS + 3, i]
        size = ax * ax + av * av + bx * bx + bv * bv
        if always or abs(ax * bv - av * bx) < 1e-4 * size or size < 1e-100:
            sums = tally.sums[first + i]
            growth_1, growth_2 = orthonormalise(w[TANGENTS : TANGENTS + 4, i])
            sums.growth_1 += growth_1
            sums.growth_2 += growth_2


@jit(inline=True)
def record_section(w, first, n, k, tally):
    """Store the state of `n` lanes as section `k`, NaN where it overflowed."""
    for i in range(n):
        x, v, sums = w[X, i], w[V, i], tally.sums[first + i]
        finite = math.isfinite(x) and math.isfinite(v)
        tally.sections[first + i, k, 0] = x if finite else math.nan
        tally.sections[first + i, k, 1] = v if finite else math.nan
        if not finite and sums.status < _UNRESOLVED:
            sums.status = _NON_FINITE


@jit
def run_block(first, points, rule, integrator, lead, grid, transient, periods, lyapunov, tally):
    """Run one block of at most ``LANES`` points from its start to the end of the record."""
    w = np.empty((ROWS, LANES))
    taylor = np.empty((LANES, 4, TERMS))
    scratch = new_scratch()
    set_start(w, points, rule)
    for k in range(-1, transient + periods):
        steps = lead if k < 0 else grid
        if k <= 0:
            set_maps(w, taylor, points, rule, integrator, steps)
        if rule == PLAIN and k < transient:
            advance_plain(w, steps)
            continue
        advance(
            w, taylor, first, points, rule, integrator, steps, k >= transient, lyapunov, tally,
            scratch,
        )  # fmt: skip
        if k >= transient:
            record_section(w, first, points.size, k - transient, tally)
        for i in range(LANES):
            w[WAKE, i] -= 2.0 * math.pi if k >= 0 else 0.0  # the grid's phases begin again


@jit(parallel=True)
def run_blocks(points, rule, integrator, lead, grid, transient, periods, lyapunov, tally):
    """Run every point, block by block over the threads."""
    for b in prange((points.size + LANES - 1) // LANES):
        lo, hi = b * LANES, min((b + 1) * LANES, points.size)
        run_block(
            lo, points[lo:hi], rule, integrator, lead, grid, transient, periods, lyapunov, tally
        )
