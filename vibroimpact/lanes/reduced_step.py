"""The rule ``reduced-step`` in the lanes: the impacts of a stride side by side, in vectors.

A column of the workspace is one lane that meets its stop in the stride. Nearly every such lane has
one impact, and a rebound that lasts to the end of the stride: these are mended here. The arithmetic
is that of ``reduced_step``, without a branch; every other lane is left to ``reduced_step``.
"""

from __future__ import annotations

from collections.abc import Callable

from vibroimpact.jit import jit, select, widest_vectors
from vibroimpact.lanes.tally import list_impact
from vibroimpact.lanes.workspace import LANES, MET, OWN, STRIDE, V, X, glide_lane
from vibroimpact.step.integrators import INTEGRATORS, Parameters, step
from vibroimpact.step.phases import COS, SIN, THETA
from vibroimpact.step.reduced_step import single_chord_impact

# Columns of a vector of 512 bits.
_VECTOR = 8
# Rows of the workspace; row + j belongs to column j.
(
    # The parameters of eq. (1).
    OF_H, OF_R, OF_OMEGA, OF_F, OF_P, OF_CLEARANCE,
    # The step in which the lane meets the stop, and its two ends.
    STEP, THETA_0, S_0, C_0, X_0, V_0, X_T, V_T,
    # The impact, the time that remains of the step, and whether the impact is the only one.
    T_R, V_TR, S_TR, C_TR, REMAINDER, SINGLE,
) = range(OWN, OWN + 20 * LANES, LANES)  # fmt: skip


@jit(inline=True)
def parameters_of(w, j):
    """Return the parameters of column `j`: from rows, which vectors can be loaded from."""
    return Parameters(
        w[OF_H + j], w[OF_R + j], w[OF_OMEGA + j], w[OF_F + j], w[OF_P + j], w[OF_CLEARANCE + j]
    )


@jit(refcounts=False)
def gather(w, columns, points, table, n):
    """Fill the columns: each lane goes on from step `n` to the one that may take it to its stop."""
    for j in range(columns):
        i = int(w[MET + j])
        x, v, safe, k = w[X + i], w[V + i], True, n
        for q in range(n, n + STRIDE - 1):
            x_T, v_T, further = glide_lane(w, i, x, v, table[SIN, q], table[COS, q])
            safe &= further
            x, v, k = select(safe, x_T, x), select(safe, v_T, v), k + safe
        s, c, pt = table[SIN, k], table[COS, k], points[i]
        w[X_T + j], w[V_T + j], _ = glide_lane(w, i, x, v, s, c)
        w[STEP + j], w[THETA_0 + j], w[S_0 + j], w[C_0 + j] = k, table[THETA, k], s, c
        w[X_0 + j], w[V_0 + j] = x, v
        w[OF_H + j], w[OF_R + j], w[OF_OMEGA + j] = pt.h, pt.R, pt.omega
        w[OF_F + j], w[OF_P + j], w[OF_CLEARANCE + j] = pt.f, pt.p, pt.clearance


@jit(refcounts=False)
def shorten_steps(w, columns, step):
    """Take the columns to their impacts, eqs (6)-(9)."""
    widest_vectors()
    for j in range(columns):
        pt = parameters_of(w, j)
        T = step / pt.omega
        T_r, w[V_TR + j], w[S_TR + j], w[C_TR + j], sure = single_chord_impact(
            w[X_0 + j], w[V_0 + j], w[X_T + j], w[V_T + j], w[THETA_0 + j], T, pt
        )
        w[T_R + j], w[REMAINDER + j], w[SINGLE + j] = T_r, T - T_r, select(sure, 1.0, 0.0)


@jit(inline=True)
def launch(w, j):
    """Return what an integrator needs to take the remainder of the step of column `j`."""
    pt = parameters_of(w, j)
    return pt.clearance, -pt.R * w[V_TR + j], w[S_TR + j], w[C_TR + j], w[REMAINDER + j], pt


@jit(inline=True)
def land(w, j, end):
    """Put the end of the step into column `j`."""
    w[X_T + j], w[V_T + j] = end
    w[SINGLE + j] = select(end[0] < w[OF_CLEARANCE + j], w[SINGLE + j], 0.0)


@jit(inline=True)
def _one_by_one(w, columns, integrator, points):
    """Take the columns with any integrator."""
    for j in range(columns):
        x, v, s, c, T, _ = launch(w, j)
        land(w, j, step(integrator, x, v, s, c, T, points[int(w[MET + j])]))


def _choice(code: int, chosen: Callable, otherwise: Callable) -> Callable:
    """Return a loop over the columns with the step `chosen`, if the integrator has that code."""

    @jit(inline=True)
    def loop(w, columns, integrator, points):
        if integrator == code:
            for j in range((columns + _VECTOR - 1) // _VECTOR * _VECTOR):
                land(w, j, chosen(*launch(w, j)))
        else:
            otherwise(w, columns, integrator, points)

    return loop


_chosen_loop = _one_by_one
for _row in INTEGRATORS.values():
    if _row.order is not None and _row.order > 1:
        _chosen_loop = _choice(_row.code, _row.step, _chosen_loop)


@jit(refcounts=False)
def take_remainders(w, columns, integrator, points):
    """Take the columns from their rebounds to the ends of the steps.

    An integrator of second order or more has a loop of its own: one around ``step`` is not
    vectorised, nor is the exact flow, which is a loop itself.
    """
    widest_vectors()
    _chosen_loop(w, columns, integrator, points)


@jit(refcounts=False)
def mend_side_by_side(w, met, points, integrator, grid, n, recording, tally):
    """Take the `met` lanes of row MET over the stride from step `n`.

    Returns how many lanes are left in row MET, not moved, because a single impact is not certain.
    """
    gather(w, met, points, grid.table, n)
    shorten_steps(w, (met + _VECTOR - 1) // _VECTOR * _VECTOR, grid.step)
    take_remainders(w, met, integrator, points)
    left = 0
    for j in range(met):
        i = int(w[MET + j])
        x, v, single = w[X_T + j], w[V_T + j], w[SINGLE + j] > 0.0
        for q in range(n + 1, n + STRIDE):
            x_T, v_T, safe = glide_lane(w, i, x, v, grid.table[SIN, q], grid.table[COS, q])
            later = q > w[STEP + j]
            x, v = select(later, x_T, x), select(later, v_T, v)
            single &= safe | (not later)
        if single:
            w[X + i], w[V + i] = x, v
            if recording:
                phase = w[THETA_0 + j] + points[i].omega * w[T_R + j]
                list_impact(tally.impacts[i], tally.sums[i], phase, w[V_TR + j])
        else:
            w[MET + left] = i
            left += 1
    return left
