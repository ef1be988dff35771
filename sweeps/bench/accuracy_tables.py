"""The measurements of ``sweeps.bench.accuracy_speed`` as tables for the terminal."""

from __future__ import annotations

import math

import pandas as pd

from sweeps.bench.scenes import CHATTER, EXACT, GRAZING, ORBIT_ERRORS
from sweeps.bench.work_precision import MEAN, METHOD, NO_DIGIT, cheapest, main_scene
from sweeps.text import table

STATE, PENETRATION = ORBIT_ERRORS[0], ORBIT_ERRORS[-1]
#: The steps per period, and of the peers the tolerance, at which errors are shown.
STEPS, TOLERANCE = 100, 1e-9
#: The errors for which the cheapest method is named.
TARGETS = (1e-2, 1e-4, 1e-8, 1e-12)


def of_methods(measured: pd.DataFrame) -> str:
    """Return the orders, the errors and the cost of every method.

    Parameters
    ----------
    measured : DataFrame
        From `work_precision.with_orders`: of one scene, or of all with the geometric means over the
        regular ones.
    """
    main = main_scene(measured)
    columns = {"order": main}
    if main == MEAN:
        columns = {"regular": MEAN, "chatter": CHATTER.name, "graze": GRAZING.name}
    taken = measured["steps_per_period"]
    exact_steps = taken[(measured[METHOD] == list(EXACT)).all(axis=1) & (taken >= STEPS)]
    steps = STEPS if exact_steps.empty else exact_steps.min()
    orders = measured[measured["error_kind"] == STATE].groupby(["scene", *METHOD])
    orders_of = orders["measured_order"].first()
    shown = measured[
        (measured["scene"] == main) & ((taken == steps) | (measured["tolerance"] == TOLERANCE))
    ]
    rows = [(*METHOD, *columns, "error", "penetration", "ns/period")]
    for method, group in shown.groupby(METHOD, sort=False):
        errors = group.set_index("error_kind")["error"]
        rows.append(
            (
                *method,
                *(_order(orders_of.get((name, *method), math.nan)) for name in columns.values()),
                _error(errors[STATE]),
                _error(errors[PENETRATION]) if PENETRATION in errors else "",
                _cost(group),
            )
        )
    of = f"(solvers: tolerance {TOLERANCE:g}), geometric mean of the regular scenes"
    return (
        f"Measured orders of the section state; errors and cost with {steps} steps per period\n"
        f"{of if main == MEAN else f'of the {main}'}\n\n"
        f"{table(rows, words=2)}\n\n"
        "No order: fewer than three errors below 0.1 and above rounding.\n"
        "Steps beyond a limit of stability are run like the others; their impacts may bound\n"
        "what they let grow.\n"
    )


def of_targets(measured: pd.DataFrame) -> str:
    """Return the cheapest method for each of ``TARGETS``."""
    rows = [("error", *METHOD, "steps", "ns/period")]
    main = main_scene(measured)
    states = measured[(measured["scene"] == main) & (measured["error_kind"] == STATE)]
    for target in TARGETS:
        best = cheapest(states, target)
        if best.empty:
            rows.append((f"{target:g}", "none", "", "", ""))
        else:
            (one,) = best.itertuples()
            by_steps = pd.notna(one.steps_per_period)
            steps = str(one.steps_per_period) if by_steps else f"tolerance {one.tolerance:g}"
            rows.append((f"{target:g}", one.integrator, one.impact, steps, _cost(best)))
    title = "The cheapest way to an error of the section state (as above)"
    return f"{title}\n\n{table(rows, words=4)}\n"


def _cost(measured: pd.DataFrame) -> str:
    return f"{measured['seconds_per_period'].iloc[0] * 1e9:,.0f}"


def _order(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.1f}"


def _error(value: float) -> str:
    if not math.isfinite(value):
        return "failed"
    if value == 0.0:
        return "0"
    return f"{value:.1e}" if value < NO_DIGIT else "> 1"
