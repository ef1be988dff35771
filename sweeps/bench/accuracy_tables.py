"""The measurements of ``sweeps.bench.accuracy_speed`` as tables for the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from rich import box
from rich.table import Table

from sweeps.bench.accuracy_speed import Measurement
from sweeps.bench.scenes import CHATTER, FLIP, FLIP_SCENE, GRAZING, ORBIT_ERRORS
from sweeps.bench.work_precision import MEAN, NO_DIGIT, Line, cheapest

STATE, PENETRATION = ORBIT_ERRORS[0], ORBIT_ERRORS[-1]
#: The steps per period, and of the peers the tolerance, at which errors are shown.
STEPS, TOLERANCE = 100, 1e-9
#: The errors for which the cheapest method is named.
TARGETS = (1e-2, 1e-4, 1e-8, 1e-12)

# Column, scene and kind of the orders shown.
_ORDERS = (
    ("regular", MEAN, STATE),
    ("chatter", CHATTER.name, STATE),
    ("graze", GRAZING.name, STATE),
    ("flip", FLIP_SCENE.name, FLIP),
)


def tables(
    measurements: Sequence[Measurement], orders: dict[Line, float]
) -> Iterator[tuple[str, Table]]:
    """Yield titles and tables.

    Parameters
    ----------
    measurements : sequence of Measurement
        With the means over the regular scenes.
    orders : dict
        From `work_precision.orders`, of the same.
    """
    yield (
        "Measured orders of the section state and of the flip value; "
        f"errors and cost with {STEPS} steps per period (solvers: tolerance {TOLERANCE:g}), "
        "mean of the regular scenes",
        _methods(measurements, orders),
    )
    yield (
        "The cheapest way to an error of the section state, mean of the regular scenes",
        _targets(measurements),
    )


def _methods(measurements: Sequence[Measurement], orders: dict[Line, float]) -> Table:
    table = Table(
        box=box.SIMPLE_HEAD,
        caption=(
            "No order: fewer than three errors below 0.1 and above rounding, or no such value. "
            "Steps beyond a limit of stability are run like the others; their impacts may bound "
            "what they let grow."
        ),
        caption_justify="left",
    )
    table.add_column("integrator")
    table.add_column("impact")
    for name in (*(name for name, _, _ in _ORDERS), "error", "penetration", "ns/period"):
        table.add_column(name, justify="right")
    shown = {
        (m.method, m.kind): m
        for m in measurements
        if m.scene == MEAN and (m.steps == STEPS or m.tolerance == TOLERANCE)
    }
    for method in dict.fromkeys(method for method, _ in shown):
        state, depth = shown[method, STATE], shown.get((method, PENETRATION))
        table.add_row(
            *method,
            *(_order(orders.get((scene, kind, method), math.nan)) for _, scene, kind in _ORDERS),
            _error(state.error),
            "" if depth is None else _error(depth.error),
            f"{state.seconds * 1e9:,.0f}",
        )
    return table


def _targets(measurements: Sequence[Measurement]) -> Table:
    table = Table(box=box.SIMPLE_HEAD)
    for name in ("error", "integrator", "impact", "steps"):
        table.add_column(name)
    table.add_column("ns/period", justify="right")
    states = [m for m in measurements if (m.scene, m.kind) == (MEAN, STATE)]
    for target in TARGETS:
        best = cheapest(states, target)
        row = ("none", "", "", "") if best is None else _cells(best)
        table.add_row(f"{target:g}", *row)
    return table


def _cells(m: Measurement) -> tuple[str, str, str, str]:
    setting = f"{m.steps}" if m.tolerance is None else f"tolerance {m.tolerance:g}"
    return *m.method, setting, f"{m.seconds * 1e9:,.0f}"


def _order(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.1f}"


def _error(value: float) -> str:
    if not math.isfinite(value):
        return "failed"
    if value == 0.0:
        return "0"
    return f"{value:.1e}" if value < NO_DIGIT else "> 1"
