"""Orders, means over scenes, the efficient frontier, and the tables of accuracy against speed.

The columns are those of `sweeps.bench.accuracy_speed.measure_methods`. The rows of one scene, kind
of error and method are a line of the chart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

from sweeps.bench.method_scenes import CHATTER_SCENE, EXACT_METHOD, GRAZING, ORBIT_ERRORS, REGULAR
from sweeps.text import table

#: Name of the scene that stands for the mean of all regular scenes.
MEAN = "regular scenes"
#: An error above this has no right digit.
NO_DIGIT = 1.0
#: The columns that identify a method, and a line of the chart.
METHOD = ["integrator", "impact"]
LINE = ["scene", "error_kind", *METHOD]

# An order is fitted to the finest steps whose errors are small but far above the reference's error.
_FITTED, _LARGEST, _ABOVE_FLOOR = 5, 0.1, 10.0

STATE, PENETRATION = ORBIT_ERRORS[0], ORBIT_ERRORS[-1]
#: The steps per period, and for peers the tolerance, at which errors are shown.
COMPARED_STEPS, SOLVER_TOLERANCE = 100, 1e-9
#: The errors for which the cheapest method is named.
TARGETS = (1e-2, 1e-4, 1e-8, 1e-12)


def means(measured: pd.DataFrame) -> pd.DataFrame:
    """Return geometric means of errors and seconds over the regular scenes.

    A method that failed in one of the scenes has no mean.
    """
    regular = measured[measured["scene"].isin([scene.name for scene in REGULAR])]
    same = [*LINE[1:], "steps_per_period", "tolerance"]
    groups = regular.groupby(same, sort=False, dropna=False)
    mean = groups[["error", "seconds_per_period"]].agg(_geometric_mean)
    sizes = groups.size()
    return mean[sizes == sizes.max()].reset_index().assign(scene=MEAN)[list(measured)]


def main_scene(measured: pd.DataFrame) -> str:
    """Return the scene to show first: the mean of the regular scenes, or else the first scene."""
    return MEAN if (measured["scene"] == MEAN).any() else str(measured["scene"].iloc[0])


def _geometric_mean(values: pd.Series) -> float:
    with np.errstate(divide="ignore"):
        return float(np.exp(np.mean(np.log(values.to_numpy()))))


def measured_order(steps: Sequence[int], errors: Sequence[float], floor: float = 0.0) -> float:
    """Return minus the slope of log error over log steps, by least squares, from coarse to fine.

    Only errors ten times above `floor`, the error of the reference, are fitted; NaN if fewer than
    three are left.
    """
    e = np.array(errors)
    good = np.flatnonzero((e > _ABOVE_FLOOR * floor) & (e < _LARGEST) & (e > 0.0))[-_FITTED:]
    if len(good) < 3:
        return math.nan
    return -float(np.polyfit(np.log(np.array(steps, float)[good]), np.log(e[good]), 1)[0])


def with_orders(measured: pd.DataFrame) -> pd.DataFrame:
    """Return the measurements line by line, from coarse to fine, and add ``measured_order``.

    It is NaN for the reference and for peers.
    """
    exact = measured[(measured[METHOD] == list(EXACT_METHOD)).all(axis=1)]
    floors = exact.groupby(["scene", "error_kind"])["error"].max()
    lines = []
    for line, group in measured.groupby(LINE, sort=False):
        group = group.sort_values(["steps_per_period", "tolerance"], ascending=[True, False])
        order = math.nan
        if line[2:] != EXACT_METHOD and group["steps_per_period"].notna().all():
            steps, errors = group["steps_per_period"].tolist(), group["error"].tolist()
            order = measured_order(steps, errors, floors.get(line[:2], 0.0))
        lines.append(group.assign(measured_order=order))
    return pd.concat(lines, ignore_index=True)


def efficient_frontier(measured: pd.DataFrame) -> pd.DataFrame:
    """Return the measurements with the least error at the same or lower cost, cheapest first."""
    by_cost = measured.dropna(subset="error").sort_values(["seconds_per_period", "error"])
    least = by_cost["error"].clip(upper=NO_DIGIT).cummin().shift(fill_value=NO_DIGIT)
    return by_cost[by_cost["error"] < least]


def cheapest(measured: pd.DataFrame, error: float) -> pd.DataFrame:
    """Return the cheapest measurement that reaches an error; empty if there is none."""
    return measured[measured["error"] <= error].nsmallest(1, "seconds_per_period")


def of_methods(measured: pd.DataFrame) -> str:
    """Return a table of the orders, the errors and the cost of every method, from `with_orders`."""
    main = main_scene(measured)
    columns = {"order": main}
    if main == MEAN:
        columns = {"regular": MEAN, "chatter": CHATTER_SCENE.name, "graze": GRAZING.name}
    taken = measured["steps_per_period"]
    exact = (measured[METHOD] == list(EXACT_METHOD)).all(axis=1)
    exact_steps = taken[exact & (taken >= COMPARED_STEPS)]
    steps = COMPARED_STEPS if exact_steps.empty else exact_steps.min()
    orders = measured[measured["error_kind"] == STATE].groupby(["scene", *METHOD])
    orders_of = orders["measured_order"].first()
    shown = measured[
        (measured["scene"] == main)
        & ((taken == steps) | (measured["tolerance"] == SOLVER_TOLERANCE))
    ]
    rows = [(*METHOD, *columns, "error", "penetration", "ns/period")]
    for method, group in shown.groupby(METHOD, sort=False):
        errors = group.set_index("error_kind")["error"]
        rows.append(
            (
                *method,
                *(
                    _shown_order(orders_of.get((name, *method), math.nan))
                    for name in columns.values()
                ),
                _error(errors[STATE]),
                _error(errors[PENETRATION]) if PENETRATION in errors else "",
                _cost(group),
            )
        )
    of = f"(solvers: tolerance {SOLVER_TOLERANCE:g}), geometric mean of the regular scenes"
    return (
        f"Measured orders of the section state; errors and cost with {steps} steps per period\n"
        f"{of if main == MEAN else f'of the {main}'}\n\n"
        f"{table(rows, words=2)}\n\n"
        "No order: fewer than three errors below 0.1 and above rounding.\n"
        "Steps beyond a limit of stability are run, too; impacts may limit the growth.\n"
    )


def of_targets(measured: pd.DataFrame) -> str:
    """Return a table of the cheapest method for each of ``TARGETS``."""
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


def _shown_order(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.1f}"


def _error(value: float) -> str:
    if not math.isfinite(value):
        return "failed"
    if value == 0.0:
        return "0"
    return f"{value:.1e}" if value < NO_DIGIT else "> 1"
