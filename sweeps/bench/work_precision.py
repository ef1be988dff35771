"""Means over scenes, orders and the efficient frontier, of a table of measurements.

The columns of the table are those of `sweeps.bench.accuracy_speed.measure`. The rows of one scene,
kind of error and method are a line of the chart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

from sweeps.bench.scenes import EXACT, REGULAR

#: The scene that stands for the mean of all regular ones.
MEAN = "regular scenes"
#: An error above this says nothing: no digit is right.
NO_DIGIT = 1.0
#: What tells the lines of the chart from one another, and a method from the others.
METHOD = ["integrator", "impact"]
LINE = ["scene", "error_kind", *METHOD]

# An order is fitted to the finest steps, to errors that are small but far from the reference's.
_FITTED, _LARGEST, _ABOVE_FLOOR = 5, 0.1, 10.0


def means(measured: pd.DataFrame) -> pd.DataFrame:
    """Return geometric means over the regular scenes, of errors and seconds.

    Where a method failed in one of them, it has no mean.
    """
    regular = measured[measured["scene"].isin([scene.name for scene in REGULAR])]
    same = [*LINE[1:], "steps_per_period", "tolerance"]
    groups = regular.groupby(same, sort=False, dropna=False)
    mean = groups[["error", "seconds_per_period"]].agg(_geometric_mean)
    sizes = groups.size()
    return mean[sizes == sizes.max()].reset_index().assign(scene=MEAN)[list(measured)]


def main_scene(measured: pd.DataFrame) -> str:
    """Return the scene that is shown first: the mean of the regular ones, else the first."""
    return MEAN if (measured["scene"] == MEAN).any() else str(measured["scene"].iloc[0])


def _geometric_mean(values: pd.Series) -> float:
    with np.errstate(divide="ignore"):
        return float(np.exp(np.mean(np.log(values.to_numpy()))))


def measured_order(steps: Sequence[int], errors: Sequence[float], floor: float = 0.0) -> float:
    """Return the order: minus the slope of log error over log steps, by least squares.

    Parameters
    ----------
    steps, errors : sequences of the same length
        From coarse to fine.
    floor : float
        The error of the reference: what is not ten times above it is not fitted.

    Returns
    -------
    float
        NaN with fewer than three errors to fit.
    """
    e = np.array(errors)
    good = np.flatnonzero((e > _ABOVE_FLOOR * floor) & (e < _LARGEST) & (e > 0.0))[-_FITTED:]
    if len(good) < 3:
        return math.nan
    return -float(np.polyfit(np.log(np.array(steps, float)[good]), np.log(e[good]), 1)[0])


def with_orders(measured: pd.DataFrame) -> pd.DataFrame:
    """Return the same line by line, each from coarse to fine, with the column ``measured_order``.

    It is NaN for the reference, and for peers.
    """
    exact = measured[(measured[METHOD] == list(EXACT)).all(axis=1)]
    floors = exact.groupby(["scene", "error_kind"])["error"].max()
    lines = []
    for line, group in measured.groupby(LINE, sort=False):
        group = group.sort_values(["steps_per_period", "tolerance"], ascending=[True, False])
        order = math.nan
        if line[2:] != EXACT and group["steps_per_period"].notna().all():
            steps, errors = group["steps_per_period"].tolist(), group["error"].tolist()
            order = measured_order(steps, errors, floors.get(line[:2], 0.0))
        lines.append(group.assign(measured_order=order))
    return pd.concat(lines, ignore_index=True)


def efficient_frontier(measured: pd.DataFrame) -> pd.DataFrame:
    """Return the measurements with no smaller error at the same or lower cost, cheapest first."""
    by_cost = measured.dropna(subset="error").sort_values(["seconds_per_period", "error"])
    least = by_cost["error"].clip(upper=NO_DIGIT).cummin().shift(fill_value=NO_DIGIT)
    return by_cost[by_cost["error"] < least]


def cheapest(measured: pd.DataFrame, error: float) -> pd.DataFrame:
    """Return the cheapest measurement that reaches an error; none if there is none."""
    return measured[measured["error"] <= error].nsmallest(1, "seconds_per_period")
