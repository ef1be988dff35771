"""The measurements of ``sweeps.bench.accuracy_speed`` as tables for the terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from sweeps.bench.accuracy_speed import Measurement
from sweeps.bench.scenes import CHATTER, EXACT, GRAZING, ORBIT_ERRORS
from sweeps.bench.work_precision import MEAN, NO_DIGIT, Line, cheapest, main_scene
from sweeps.text import table

STATE, PENETRATION = ORBIT_ERRORS[0], ORBIT_ERRORS[-1]
#: The steps per period, and of the peers the tolerance, at which errors are shown.
STEPS, TOLERANCE = 100, 1e-9
#: The errors for which the cheapest method is named.
TARGETS = (1e-2, 1e-4, 1e-8, 1e-12)


def of_methods(measurements: Sequence[Measurement], orders: Mapping[Line, float]) -> str:
    """Return the orders, the errors and the cost of every method.

    Parameters
    ----------
    measurements : sequence of Measurement
        Of one scene, or of all with the geometric means over the regular ones.
    orders : mapping
        From `work_precision.orders`, of the same.
    """
    main = main_scene(measurements)
    columns = {"order": main}
    if main == MEAN:
        columns = {"regular": MEAN, "chatter": CHATTER.name, "graze": GRAZING.name}
    exact_steps = (m.steps or 0 for m in measurements if m.method == EXACT)
    steps = min((n for n in exact_steps if n >= STEPS), default=STEPS)
    shown = {
        (m.method, m.kind): m
        for m in measurements
        if m.scene == main and (m.steps == steps or m.tolerance == TOLERANCE)
    }
    rows = [("integrator", "impact", *columns, "error", "penetration", "ns/period")]
    for method in dict.fromkeys(method for method, _ in shown):
        state, depth = shown[method, STATE], shown.get((method, PENETRATION))
        rows.append(
            (
                *method,
                *(_order(orders.get((name, STATE, method), math.nan)) for name in columns.values()),
                _error(state.error),
                "" if depth is None else _error(depth.error),
                _cost(state),
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


def of_targets(measurements: Sequence[Measurement]) -> str:
    """Return the cheapest method for each of ``TARGETS``."""
    rows = [("error", "integrator", "impact", "steps", "ns/period")]
    main = main_scene(measurements)
    states = [m for m in measurements if (m.scene, m.kind) == (main, STATE)]
    for target in TARGETS:
        best = cheapest(states, target)
        if best is None:
            rows.append((f"{target:g}", "none", "", "", ""))
        else:
            steps = f"{best.steps}" if best.steps else f"tolerance {best.tolerance:g}"
            rows.append((f"{target:g}", *best.method, steps, _cost(best)))
    title = "The cheapest way to an error of the section state (as above)"
    return f"{title}\n\n{table(rows, words=4)}\n"


def _cost(m: Measurement) -> str:
    return f"{m.seconds * 1e9:,.0f}"


def _order(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.1f}"


def _error(value: float) -> str:
    if not math.isfinite(value):
        return "failed"
    if value == 0.0:
        return "0"
    return f"{value:.1e}" if value < NO_DIGIT else "> 1"
