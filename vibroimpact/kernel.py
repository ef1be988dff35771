"""The stepping kernel: lanes, blocks and threads. The only place that knows them.

A lane is one parameter point. Lanes stand side by side in blocks of ``LANES``, and the loop is
"for step: for lane", so that the compiler fills vector registers; ``prange`` runs over blocks.
The steps per period are an integer, so omega t_n mod 2 pi is one table for every lane, also
where omega is swept, and the loop holds no trigonometry. Every lane is advanced by its affine
map; only lanes that ended on or beyond the stop are mended by the impact rule, after the loop.
A lane at rest watches a stop at -inf, so that it is looked at in every step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import get_num_threads, prange, set_num_threads

from vibroimpact.impacts import (
    DISPLACEMENT,
    EVENTS_SHAPE,
    IMPACT,
    IMPACT_RULES,
    KIND,
    PLAIN,
    SPEED,
    TIME,
    mend,
    start,
)
from vibroimpact.integrators import INTEGRATORS, affine_map, apply_map
from vibroimpact.jit import jit
from vibroimpact.phases import COS, SIN, THETA, lead_in, one_period
from vibroimpact.status import Status

#: Points per block.
LANES = 32

# Rows of a block's workspace, one column per lane: the state, the state at the end of the step,
# the affine map, and what the impact rule needs.
X, V, X_T, V_T, XX, XV, XS, XC, VX, VV, VS, VC, LEVEL, CLEARANCE, RESTITUTION = range(15)

_COMPUTED, _NON_FINITE = int(Status.COMPUTED), int(Status.NON_FINITE)


#: What is summed up over the recorded periods of a point, beside its last status.
SUMS = np.dtype(
    [("impacts", np.int64), ("max_penetration", float), ("rested", float), ("status", np.int64)]
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
        met |= x_T >= w[LEVEL, i]
    return met


@jit(inline=True)
def advance_plain(w, grid):
    """Steps with the rule (2)-(5), nothing recorded: selects instead of branches."""
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


@jit(inline=True)
def set_maps(w, points, integrator, grid):
    """Give every lane the affine map of one step of `grid`."""
    for i in range(LANES):
        pt = points[min(i, points.size - 1)]
        rows = affine_map(integrator, grid.step / pt.omega, pt)
        for k in range(8):
            w[XX + k, i] = rows[k]


@jit(inline=True)
def record_step(events, n, x_T, rested, theta, pt, row, tally):
    """Add the events of one mended step to the tally of the lane in that row."""
    sums = tally.sums[row]
    depth = x_T - pt.clearance
    capacity = tally.impacts.shape[1]
    for k in range(n):
        if events[k, KIND] == IMPACT:
            depth = max(depth, events[k, DISPLACEMENT] - pt.clearance)
            if capacity > 0:
                slot = sums.impacts % capacity
                at = theta + pt.omega * events[k, TIME]
                while at >= 2.0 * math.pi:  # twice at the most; fmod is ten times slower
                    at -= 2.0 * math.pi
                tally.impacts[row, slot, 0] = at
                tally.impacts[row, slot, 1] = events[k, SPEED]
            sums.impacts += 1
    sums.rested += rested
    sums.max_penetration = max(sums.max_penetration, depth)


@jit(inline=True)
def advance(w, first, points, rule, integrator, grid, recording, tally, events):
    """Steps over `grid`: predict every lane, mend those that met the stop."""
    for n in range(grid.table.shape[1]):
        if predict(w, grid.table[SIN, n], grid.table[COS, n]):
            theta = grid.table[THETA, n]
            for i in range(points.size):
                if w[X_T, i] >= w[LEVEL, i]:
                    pt = points[i]
                    x, v, resting, n_events, rested, outcome = mend(
                        rule, integrator, w[X, i], w[V, i], w[X_T, i], w[V_T, i],
                        w[LEVEL, i] < pt.clearance, theta, grid.step / pt.omega, pt, events,
                    )  # fmt: skip
                    if recording:
                        end = w[X_T, i] if rule == PLAIN else x
                        record_step(events, n_events, end, rested, theta, pt, first + i, tally)
                    if outcome != _COMPUTED:
                        tally.sums[first + i].status = outcome
                    w[X_T, i], w[V_T, i] = x, v
                    w[LEVEL, i] = -math.inf if resting else pt.clearance
        for i in range(LANES):
            w[X, i] = w[X_T, i]
            w[V, i] = w[V_T, i]


@jit(inline=True)
def record_section(w, first, n, k, tally):
    """Store the state of `n` lanes as section `k`, NaN where it overflowed."""
    for i in range(n):
        x, v, sums = w[X, i], w[V, i], tally.sums[first + i]
        finite = math.isfinite(x) and math.isfinite(v)
        tally.sections[first + i, k, 0] = x if finite else math.nan
        tally.sections[first + i, k, 1] = v if finite else math.nan
        if not finite and sums.status == _COMPUTED:
            sums.status = _NON_FINITE


@jit
def run_block(first, points, rule, integrator, lead, grid, transient, periods, tally):
    """Run one block of at most ``LANES`` points from its start to the end of the record."""
    w = np.empty((RESTITUTION + 1, LANES))
    events = np.empty(EVENTS_SHAPE)
    set_start(w, points, rule)
    for k in range(-1, transient + periods):
        steps = lead if k < 0 else grid
        if k <= 0:
            set_maps(w, points, integrator, steps)
        if rule == PLAIN and k < transient:
            advance_plain(w, steps)
            continue
        advance(w, first, points, rule, integrator, steps, k >= transient, tally, events)
        if k >= transient:
            record_section(w, first, points.size, k - transient, tally)


@jit(parallel=True)
def run_blocks(points, rule, integrator, lead, grid, transient, periods, tally):
    """Run every point, block by block over the threads."""
    for b in prange((points.size + LANES - 1) // LANES):
        lo, hi = b * LANES, min((b + 1) * LANES, points.size)
        run_block(lo, points[lo:hi], rule, integrator, lead, grid, transient, periods, tally)


def _last_in_order(rings: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Unroll rings of the last impacts into time order."""
    width = rings.shape[1]
    if width == 0:
        return rings
    first = np.where(count > width, count % width, 0)
    order = (first[:, None] + np.arange(width)) % width
    return np.take_along_axis(rings, order[:, :, None], axis=1)


def integrate(
    points: np.ndarray,
    *,
    integrator: str = "newmark",
    impact: str = "reduced-step",
    steps_per_period: int = 100,
    transient: int = 200,
    periods: int = 100,
    phase: float = 0.0,
    impacts: int = 64,
    threads: int | None = None,
) -> dict[str, np.ndarray]:
    """Run every parameter point from t = 0 and record its attractor.

    The record spans the `periods` forcing periods that follow `transient` of them, counted from
    the first passage of the phase `phase`. An impact belongs to it if it comes after its start,
    so that one at t = 0 itself does not.

    Parameters
    ----------
    points : ndarray of dtype ``POINT``, shape (n,)
        Valid parameter points; ``Oscillator.at`` makes one.
    integrator, impact : str
        Names in ``INTEGRATORS`` and ``IMPACT_RULES``.
    steps_per_period : int
        Steps of length T = 2 pi / (omega steps_per_period).
    transient, periods : int
        Forcing periods left out, and recorded.
    phase : float
        omega t mod 2 pi of the stroboscopic section, in [0, 2 pi) [rad]. The grid of steps is
        laid so that it falls on a grid point.
    impacts : int
        How many of the last impacts to keep.
    threads : int, optional
        Threads to use; all by default. The results do not depend on it.

    Returns
    -------
    dict of str to ndarray
        ``poincare_x``, ``poincare_v`` : (n, periods), state at the end of each recorded period;
        ``impact_phase``, ``impact_v`` : (n, impacts), omega t mod 2 pi [rad] and speed before
        the last impacts, in time order, NaN where there were fewer; ``impacts_per_period``,
        ``max_penetration``, ``rest_fraction``, ``status`` : (n,). Where ``status`` is not
        ``Status.COMPUTED`` the numbers are NaN. The rule ``plain`` knows no rest.

    Raises
    ------
    KeyError
        For an unknown integrator or impact rule.
    """
    n = points.size
    tally = Tally(
        sections=np.empty((n, periods, 2)),
        impacts=np.full((n, impacts, 2), np.nan),
        sums=np.zeros(n, dtype=SUMS),
    )
    rule, code = IMPACT_RULES[impact].code, INTEGRATORS[integrator].code
    lead, grid = lead_in(phase, steps_per_period), one_period(phase, steps_per_period)
    threads_before = get_num_threads()
    set_num_threads(threads or threads_before)
    try:
        run_blocks(points, rule, code, lead, grid, transient, periods, tally)
    finally:
        set_num_threads(threads_before)
    sums = tally.sums
    last = _last_in_order(tally.impacts, sums["impacts"])
    duration = periods * 2.0 * np.pi / points["omega"]
    computed = sums["status"] == Status.COMPUTED
    return {
        "poincare_x": tally.sections[:, :, 0],
        "poincare_v": tally.sections[:, :, 1],
        "impact_phase": last[:, :, 0],
        "impact_v": last[:, :, 1],
        "impacts_per_period": np.where(computed, sums["impacts"] / periods, np.nan),
        "max_penetration": np.where(computed, sums["max_penetration"], np.nan),
        "rest_fraction": np.where(computed, sums["rested"] / duration, np.nan),
        "status": sums["status"].astype(np.int8),
    }
