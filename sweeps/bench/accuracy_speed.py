"""Accuracy against speed: the errors of every method on every scene, and its cost per period.

All methods run interleaved, each round over all of them, so that a drift of the machine affects all
of them alike; the best time of the rounds counts. A rung n of the ladder stands for numbers of
steps from n to 1.1 n, a different number in every round, so that impacts fall on different places
within a step. Errors are root mean squares over the rounds.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeRemainingColumn,
)

from sweeps.bench.event_solvers import PEERS
from sweeps.bench.method_scenes import (
    CHATTER_SCENE,
    EXACT_METHOD,
    METHODS,
    SCENES,
    Method,
    Scene,
    least_steps,
    of_sweep,
)
from sweeps.config.sweep import SweepConfig

#: Least steps of a timed run, all points together; with fewer, mainly the call would be timed.
_LEAST_WORK = 1_500_000
#: The errors that are measured for a peer; the state between its steps is not compared.
_PEER_KINDS = ("section state", "impact time", "impact speed")

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
#: One method on one scene at one rung of the ladder.
_Run = tuple[Scene, int, Method]
_TYPES = {"steps_per_period": "Int64", "tolerance": float, "error": float}


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
QUICK = Plan(
    ladder=(25, 100, 400, 1600),
    rounds=2,
    tolerances=(1e-3, 1e-9),
    thinning=32,
)


def plan_for_sweep(config: SweepConfig, plan: Plan) -> Plan:
    """Return a plan for a sweep: without peers, and also with the fewest steps of exact impacts."""
    scene = of_sweep(config)
    ladder = {*plan.ladder, least_steps(EXACT_METHOD, scene.points)}
    return replace(plan, scenes=(scene,), ladder=tuple(sorted(ladder)), peers=())


def measure_methods(
    plan: Plan = FULL, threads: int | None = None, progress: bool = False
) -> pd.DataFrame:
    """Measure the errors and the cost of every method, a row for each error.

    The columns are ``scene``; ``error_kind``, as in `Scene.errors`; ``integrator`` and ``impact``,
    for a peer its name and ``events``; ``steps_per_period``, missing if the solver chooses them;
    ``tolerance``, only for a peer; ``error``, dimensionless, NaN or inf if the method failed; and
    ``seconds_per_period``, per forcing period. `threads` are those of the kernel; peers use one.
    """
    runs, peer_runs = list(_runs(plan)), list(_peer_runs(plan))
    rows: list[tuple] = []
    failed: set[_Run] = set()
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("runs"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        disable=not progress,
    ) as bar:
        task = bar.add_task(
            "compiling (kept for the next run)", total=plan.rounds * len(runs) + len(peer_runs)
        )
        truths = {scene.name: scene.truth() for scene in plan.scenes}
        for turn in range(plan.rounds):
            for run in runs:
                scene, rung, method = run
                if run not in failed:  # a failed run might never end
                    steps = _steps(rung, turn, plan.rounds)
                    results, seconds = _timed(scene, method, steps, threads)
                    errors = scene.errors(truths[scene.name], results)
                    for kind, error in errors.items():
                        rows.append((scene.name, kind, *method, rung, None, error, seconds))
                    failed |= set() if np.isfinite([*errors.values()]).all() else {run}
                bar.update(task, advance=1, description=scene.name)
        for scene, name, tolerance in peer_runs:
            errors, seconds = _peer_errors(scene, name, tolerance, plan.thinning)
            rows += [
                (scene.name, kind, name, "events", None, tolerance, errors[kind], seconds)
                for kind in _PEER_KINDS
            ]
            bar.update(task, advance=1, description=name)
    rounds = pd.DataFrame(rows, columns=MEASURED_COLUMNS).astype(_TYPES)
    same = rounds.groupby(MEASURED_COLUMNS[:-2], sort=False, dropna=False)
    return same.agg({"error": _root_mean_square, "seconds_per_period": "min"}).reset_index()


def _runs(plan: Plan) -> Iterator[_Run]:
    """Yield the runs of a round: for each scene and rung, all methods in turn."""
    for scene in plan.scenes:
        for rung in plan.ladder:
            for method in plan.methods:
                if rung >= least_steps(method, scene.points):
                    yield scene, rung, method


def _steps(rung: int, turn: int, rounds: int) -> int:
    """Return the number of steps in one round; the golden ratio spreads the rounds evenly."""
    return rung + round(max(rounds, 0.1 * rung) * (0.618034 * turn % 1.0))


def _peer_runs(plan: Plan) -> Iterator[tuple[Scene, str, float]]:
    """Yield the runs of peers; without a complete chatter, whose events would never end."""
    for scene in plan.scenes:
        if scene is not CHATTER_SCENE and scene.impacts:
            for name in plan.peers:
                if PEERS[name].installed:
                    yield from ((scene, name, tolerance) for tolerance in plan.tolerances)


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


def _peer_errors(
    scene: Scene, name: str, tolerance: float, thinning: int
) -> tuple[dict[str, float], float]:
    """Return the errors of a peer by kind, and its seconds per forcing period."""
    thinned = replace(scene, points=scene.points[::thinning])
    results, seconds = PEERS[name].run(thinned, tolerance)
    return thinned.errors(thinned.truth(), results), seconds
