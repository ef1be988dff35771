"""Impacts of the rule ``reduced-step`` in columns, a loop for each integrator.

A column is a lane that meets its stop in a stride. Nearly every such lane has one impact there and
a rebound that lasts to the end of the stride. The arithmetic is that of ``reduced_step``, without
branches.
"""

from __future__ import annotations

from collections.abc import Callable

from vibroimpact.jit import inlined, jit, select, specialised, widest_vectors
from vibroimpact.kernel.workspace import COLUMN_ROW, VECTOR, Rows
from vibroimpact.step.integrators import INTEGRATORS, Parameters, integrator_step
from vibroimpact.step.time_stepping import single_linear_impact

_rows = Rows(COLUMN_ROW)
# The parameters of eq. (1), one row each, from which vectors can be loaded.
OF_H, OF_R, OF_OMEGA = _rows.take(), _rows.take(), _rows.take()
OF_F, OF_P, OF_CLEARANCE = _rows.take(), _rows.take(), _rows.take()
STEP = _rows.take()  #: The step in which the lane meets the stop.
# Its start: the phase with its sine and cosine, and the state; and the state at its end.
THETA_0, S_0, C_0 = _rows.take(), _rows.take(), _rows.take()
X_0, V_0 = _rows.take(), _rows.take()
X_T, V_T = _rows.take(), _rows.take()
# The impact: its time since the start of the step, its speed, sine and cosine of its phase.
T_R, V_TR, S_TR, C_TR = _rows.take(), _rows.take(), _rows.take(), _rows.take()
REMAINDER = _rows.take()  #: The time that remains of the step.
SINGLE = _rows.take()  #: Whether the impact is the only one.
#: Numbers in the rows of the columns together.
REDUCED_STEP_COLUMNS = _rows.size


@specialised
def parameters_of_column(c, j):
    """Return the parameters of column `j`."""
    return Parameters(
        c[OF_H + j], c[OF_R + j], c[OF_OMEGA + j], c[OF_F + j], c[OF_P + j], c[OF_CLEARANCE + j]
    )


@jit
def shorten_steps(c, count, phase_step):
    """Take the first columns to their impacts by eqs (6)-(9)."""
    widest_vectors()
    for j in range((count + VECTOR - 1) // VECTOR * VECTOR):
        pt = parameters_of_column(c, j)
        T = phase_step / pt.omega
        T_r, c[V_TR + j], c[S_TR + j], c[C_TR + j], sure = single_linear_impact(
            c[X_0 + j], c[V_0 + j], c[X_T + j], c[V_T + j], c[THETA_0 + j], T, pt
        )
        c[T_R + j], c[REMAINDER + j], c[SINGLE + j] = T_r, T - T_r, select(sure, 1.0, 0.0)


@specialised
def launch(c, j):
    """Return the arguments of an integrator for the remainder of the step of column `j`."""
    pt = parameters_of_column(c, j)
    return pt.clearance, -pt.R * c[V_TR + j], c[S_TR + j], c[C_TR + j], c[REMAINDER + j], pt


@specialised
def land(c, j, end):
    """Put the state at the end of the step into column `j`."""
    c[X_T + j], c[V_T + j] = end
    c[SINGLE + j] = select(end[0] < c[OF_CLEARANCE + j], c[SINGLE + j], 0.0)


@specialised
def _by_any_step(c, count, integrator):
    for j in range(count):
        x, v, sin, cos, T, pt = launch(c, j)
        land(c, j, integrator_step(integrator, x, v, sin, cos, T, pt))


def _loop_with(code: int, chosen: Callable, otherwise: Callable) -> Callable:
    """Return a loop over the columns with the step `chosen` if the integrator has that code."""

    @inlined
    def loop(c, count, integrator):
        if integrator == code:
            for j in range((count + VECTOR - 1) // VECTOR * VECTOR):
                x, v, sin, cos, T, pt = launch(c, j)
                land(c, j, chosen(x, v, sin, cos, T, pt))
        else:
            otherwise(c, count, integrator)

    return loop


# A loop around ``integrator_step`` is not vectorised, nor the exact flow, itself a loop.
_chosen_loop = _by_any_step
for _row in INTEGRATORS.values():
    if _row.order is not None and _row.order > 1:
        _chosen_loop = _loop_with(_row.code, _row.step, _chosen_loop)


@jit
def take_remainders(c, count, integrator):
    """Take the first columns from their rebounds to the ends of the steps."""
    widest_vectors()
    _chosen_loop(c, count, integrator)
