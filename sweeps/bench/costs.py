"""The cost of a step and of an impact with each method: the table ``sweeps.engine.pilot.COSTS``.

``python -m sweeps.bench.costs`` measures them on the machine at hand and prints them beside those
of the table. All methods run interleaved on one thread, each round over all of them, and the best
round counts. The time of a forcing period is then fitted, relative errors least, as

    period + steps * step + impacts * impact

over scenes without an impact, with one and with about three in a period.
"""

from __future__ import annotations

import time
from collections.abc import Mapping

import numpy as np
from scipy.optimize import nnls

from sweeps.engine.pilot import COSTS, EXACT_METHOD, MethodCost
from vibroimpact import integrate
from vibroimpact.oscillator import PARAMETERS, POINT

POINTS, PERIODS, ROUNDS = 1024, 200, 5
#: Steps per period; the exact engine has about as many as it takes by itself.
STEPS, EXACT_STEPS = (80, 160, 320, 640), (16, 32, 48, 64)
SCENES: Mapping[str, Mapping[str, float | tuple[float, float]]] = {
    "no impact": {"h": 0.1, "R": 0.8, "omega": (2.4, 3.5), "clearance": 10.0},
    "one impact": {"h": 0.2, "R": 0.5, "omega": (1.2, 1.6)},
    "three impacts": {"h": 0.05, "R": 0.9, "omega": (0.5, 0.8)},
}


def scene(values: Mapping[str, float | tuple[float, float]], count: int) -> np.ndarray:
    """Return points with these parameters, a pair being the ends of a range."""
    points = np.zeros(count, POINT)
    for name, parameter in PARAMETERS.items():
        points[name] = 1.0 if name == "f" else parameter.default or 0.0
    for name, value in values.items():
        points[name] = np.linspace(*value, count) if isinstance(value, tuple) else value
    return points


def measure(
    count: int = POINTS, periods: int = PERIODS, rounds: int = ROUNDS
) -> dict[tuple[str, str], MethodCost]:
    """Measure the cost of every method of ``COSTS`` [ns]."""
    scenes = {name: scene(values, count) for name, values in SCENES.items()}
    runs = [
        (method, name, steps, recorded)
        for method in COSTS
        for name in SCENES
        for steps in (EXACT_STEPS if method == EXACT_METHOD else STEPS)
        for recorded in (False, True)
    ]
    best = dict.fromkeys(runs, np.inf)
    impacts = {}
    for _ in range(rounds):
        for run in runs:
            (integrator, impact), name, steps, recorded = run
            began = time.perf_counter()
            results = integrate(
                scenes[name],
                integrator=integrator,
                impact=impact,
                steps_per_period=steps,
                transient=0 if recorded else periods - 1,
                periods=periods if recorded else 1,
                threads=1,
            )
            best[run] = min(best[run], time.perf_counter() - began)
            if recorded:
                impacts[run[:3]] = float(results["impacts_per_period"].mean())
    spent = {run: 1e9 * seconds / (count * periods) for run, seconds in best.items()}
    return {method: _fitted(method, spent, impacts) for method in COSTS}


def _fitted(method: tuple[str, str], spent: Mapping, impacts: Mapping) -> MethodCost:
    rows, times = [], []
    for run, nanoseconds in spent.items():
        if run[0] == method:
            steps, recorded = run[2], run[3]
            rows.append([1.0, steps * (not recorded), steps * recorded, impacts[run[:3]]])
            times.append(nanoseconds)
    weights = 1.0 / np.array(times)
    fit, _ = nnls(np.array(rows) * weights[:, None], np.ones(len(times)))
    return MethodCost(*fit)


if __name__ == "__main__":
    titles = f"{'':24}{'measured':>32}{'in the table':>32}"
    print(titles + "   [ns]: period, step, recorded step, impact")
    for (integrator, impact), cost in measure().items():
        columns = [
            "".join(
                f"{value:8.{digits}f}" for value, digits in zip(cost_of, (0, 2, 2, 0), strict=True)
            )
            for cost_of in (cost, COSTS[integrator, impact])
        ]
        print(f"{integrator + ', ' + impact:24}{columns[0]}{columns[1]}")
