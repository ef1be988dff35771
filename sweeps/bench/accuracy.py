"""Accuracy against speed: errors, costs and orders of every method.

All methods run interleaved, each round over all of them, so that a drift of the machine affects all
of them alike; the best time of the rounds counts. A rung n of the ladder stands for numbers of
steps from n to 1.1 n, a different number in every round, so that impacts fall on different places
within a step. Errors are root mean squares over the rounds.

The rows of one scene, kind of error and method are a line of the chart.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from sweeps.bench.method_scenes import (
    CHATTER_SCENE,
    EXACT_METHOD,
    GRAZING,
    METHODS,
    ORBIT_ERRORS,
    PEERS,
    REGULAR,
    SCENES,
    Method,
    Scene,
    installed,
    least_steps,
    of_sweep,
    run_peer,
)
from sweeps.config.sweep import SweepConfig
from sweeps.text import table

#: Least steps of a timed run, all points together; with fewer, mainly the call would be timed.
_LEAST_WORK = 1_500_000

#: The columns of the table of measurements; below, the types of those that may have no value.
MEASURED_COLUMNS = [
    "scene",
    "error_kind",
    "integrator",
    "impact",
    "steps_per_period",
    "tolerance",
    "error",
    "seconds_per_period",
]
_TYPES = {"steps_per_period": "Int64", "tolerance": float, "error": float}
#: The columns that identify a method, and a line of the chart.
METHOD, LINE = MEASURED_COLUMNS[2:4], MEASURED_COLUMNS[:4]
#: What stands for the impact rule of a peer.
EVENTS = "events"
#: Name of the scene that stands for the mean of all regular scenes.
MEAN = "regular scenes"
#: An error above this has no right digit.
NO_DIGIT = 1.0

# An order is fitted to the finest steps whose errors are small but far above the reference's error.
_FITTED, _LARGEST, _ABOVE_FLOOR = 5, 0.1, 10.0

STATE, PENETRATION = ORBIT_ERRORS[0], ORBIT_ERRORS[-1]
#: The steps per period, and for peers the tolerance, at which errors are shown.
COMPARED_STEPS, SOLVER_TOLERANCE = 100, 1e-9
#: The errors for which the cheapest method is named.
TARGETS = (1e-2, 1e-4, 1e-8, 1e-12)


@dataclass(frozen=True)
class Plan:
    """How much is measured."""

    #: Steps per forcing period.
    ladder: tuple[int, ...] = (12, 25, 50, 100, 200, 400, 800, 1600, 3200)
    rounds: int = 4
    tolerances: tuple[float, ...] = (1e-3, 1e-6, 1e-9, 1e-12)  # relative tolerances of the peers
    thinning: int = 16  # only every such point of a scene is given to the peers
    scenes: tuple[Scene, ...] = SCENES
    methods: tuple[Method, ...] = METHODS
    peers: tuple[str, ...] = tuple(PEERS)


FULL = Plan()
QUICK = Plan(ladder=(25, 100, 400, 1600), rounds=2, tolerances=(1e-3, 1e-9), thinning=32)


def plan_for_sweep(config: SweepConfig, plan: Plan) -> Plan:
    """Return a plan for a sweep: without peers, and also with the fewest steps of exact impacts."""
    scene = of_sweep(config)
    ladder = {*plan.ladder, least_steps(EXACT_METHOD, scene.points)}
    return replace(plan, scenes=(scene,), ladder=tuple(sorted(ladder)), peers=())


def measure_methods(
    plan: Plan = FULL,
    threads: int | None = None,
    report: Callable[[float], object] = lambda share: None,
) -> pd.DataFrame:
    """Measure the errors and the cost of every method, a row for each error.

    The columns are ``scene``; ``error_kind``, as in `Scene.errors`; ``integrator`` and ``impact``,
    for a peer its name and ``events``; ``steps_per_period``, missing if the solver chooses them;
    ``tolerance``, only for a peer; ``error``, dimensionless, NaN or inf if the method failed; and
    ``seconds_per_period``, per forcing period. `threads` are those of the kernel; peers use one.
    `report` is given the share that is done.
    """
    runs = list(_runs(plan))
    rows: list[tuple] = []
    failed: set[tuple] = set()
    truths = {scene.name: scene.truth() for scene in plan.scenes}
    for done, (turn, scene, method, rung, tolerance) in enumerate(runs, 1):
        run = scene, method, rung
        if tolerance is not None:
            thinned = replace(scene, points=scene.points[:: plan.thinning])
            results, seconds = run_peer(method.integrator, thinned, tolerance)
            errors = thinned.errors(thinned.truth(), results)
            del errors[PENETRATION]  # the state between the steps of a peer is not compared
        elif rung is not None and run not in failed:  # a failed run might never end
            # The golden ratio spreads the rounds evenly.
            more = round(max(plan.rounds, 0.1 * rung) * (0.618034 * turn % 1.0))
            results, seconds = _timed(scene, method, rung + more, threads)
            errors = scene.errors(truths[scene.name], results)
            failed |= set() if np.isfinite([*errors.values()]).all() else {run}
        else:
            errors = {}
        rows += [
            (scene.name, kind, *method, rung, tolerance, error, seconds)
            for kind, error in errors.items()
        ]
        report(done / len(runs))
    rounds = pd.DataFrame(rows, columns=MEASURED_COLUMNS).astype(_TYPES)
    same = rounds.groupby(MEASURED_COLUMNS[:-2], sort=False, dropna=False)
    return same.agg({"error": _root_mean_square, "seconds_per_period": "min"}).reset_index()


def _runs(plan: Plan) -> Iterator[tuple[int, Scene, Method, int | None, float | None]]:
    """Yield the round, scene, method, and rung or tolerance of every run, all methods in turn.

    Peers run once, and without a complete chatter, whose events would never end.
    """
    for turn in range(plan.rounds):
        for scene in plan.scenes:
            for rung in plan.ladder:
                for method in plan.methods:
                    if rung >= least_steps(method, scene.points):
                        yield turn, scene, method, rung, None
    for scene in plan.scenes:
        if scene is not CHATTER_SCENE and scene.impacts:
            for name in filter(installed, plan.peers):
                for tolerance in plan.tolerances:
                    yield 0, scene, Method(name, EVENTS), None, tolerance


def _timed(
    scene: Scene, method: Method, steps: int, threads: int | None
) -> tuple[dict[str, np.ndarray], float]:
    """Return the results of a method on a scene, and its seconds per forcing period."""
    periods = scene.timed or scene.periods
    copies = math.ceil(_LEAST_WORK / (len(scene.points) * periods * steps))
    began = time.perf_counter()
    results = scene.run(method, steps, threads, copies, periods=periods)
    seconds = (time.perf_counter() - began) / (len(scene.points) * copies * periods)
    if periods != scene.periods:
        results = scene.run(method, steps, threads)
    return results, seconds


def _root_mean_square(values: pd.Series) -> float:
    return float(np.sqrt(np.mean(values.to_numpy() ** 2)))  # NaN if a value is NaN


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
    exact = measured[measured["impact"] == EXACT_METHOD.impact]
    floors = exact.groupby(LINE[:2])["error"].max()
    lines = []
    for line, group in measured.groupby(LINE, sort=False):
        group = group.sort_values(["steps_per_period", "tolerance"], ascending=[True, False])
        order = math.nan
        if line[3] not in (EXACT_METHOD.impact, EVENTS):
            steps, errors = group["steps_per_period"].tolist(), group["error"].tolist()
            order = measured_order(steps, errors, floors.get(line[:2], 0.0))
        lines.append(group.assign(measured_order=order))
    return pd.concat(lines, ignore_index=True)


def efficient_frontier(measured: pd.DataFrame) -> pd.DataFrame:
    """Return the measurements with the least error at the same or lower cost, cheapest first."""
    by_cost = measured.dropna(subset="error").sort_values(["seconds_per_period", "error"])
    least = by_cost["error"].clip(upper=NO_DIGIT).cummin().shift(fill_value=NO_DIGIT)
    return by_cost[by_cost["error"] < least]


def of_methods(measured: pd.DataFrame) -> str:
    """Return a table of the orders, the errors and the cost of every method, from `with_orders`."""
    main, columns = main_scene(measured), {"order": main_scene(measured)}
    if main == MEAN:
        columns = {"regular": MEAN, "chatter": CHATTER_SCENE.name, "graze": GRAZING.name}
    taken = measured["steps_per_period"]
    exact = taken[(measured["impact"] == EXACT_METHOD.impact) & (taken >= COMPARED_STEPS)]
    steps = COMPARED_STEPS if exact.empty else exact.min()
    orders = measured[measured["error_kind"] == STATE].groupby(["scene", *METHOD])
    order = orders["measured_order"].first()
    compared = (taken == steps) | (measured["tolerance"] == SOLVER_TOLERANCE)
    rows = [(*METHOD, *columns, "error", "penetration", "ns/period")]
    for method, group in measured[(measured["scene"] == main) & compared].groupby(
        METHOD, sort=False
    ):
        errors = group.set_index("error_kind")["error"]
        values = (order.get((scene, *method), math.nan) for scene in columns.values())
        shown_orders = ("" if math.isnan(value) else f"{value:.1f}" for value in values)
        deepest = _error(errors[PENETRATION]) if PENETRATION in errors else ""
        rows.append((*method, *shown_orders, _error(errors[STATE]), deepest, _cost(group)))
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
    states = (measured["scene"] == main_scene(measured)) & (measured["error_kind"] == STATE)
    for target in TARGETS:
        reached = measured[states & (measured["error"] <= target)]
        best = reached.nsmallest(1, "seconds_per_period")
        rows += [
            (
                f"{target:g}",
                *row[2:4],
                str(row[4]) if pd.notna(row[4]) else f"tolerance {row[5]:g}",
                _cost(best),
            )
            for row in best.itertuples(index=False)
        ] or [(f"{target:g}", "none", "", "", "")]
    title = "The cheapest way to an error of the section state (as above)"
    return f"{title}\n\n{table(rows, words=4)}\n"


def _cost(measured: pd.DataFrame) -> str:
    return f"{measured['seconds_per_period'].iloc[0] * 1e9:,.0f}"


def _error(value: float) -> str:
    if not math.isfinite(value):
        return "failed"
    if value == 0.0:
        return "0"
    return f"{value:.1e}" if value < NO_DIGIT else "> 1"
