"""Forcing periods per second on scenes of its own, and their share of this machine's peak.

The peak is the measured rate of fused multiply-adds in a loop that does nothing else. A step of the
affine map takes eight of them; the share counts only these. All runs are
interleaved, and the best round of each counts, in wall time.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numba
import numpy as np

from sweeps.text import table, three_digits
from vibroimpact import Oscillator, integrate
from vibroimpact.jit import ALL_THREADS, NUMERICS, WAY, fma, jit, widest_vectors
from vibroimpact.kernel.integrate import Effort, Length, effort
from vibroimpact.step.scheme import scheme_of

#: Multiply-adds in a step of the affine map.
PER_STEP = 8

#: Sums side by side in vector registers; multiply-adds on a sum at a time; repetitions of both.
_SUMS, _CHAIN, _TIMES = 64, 8, 40_000


class OmegaRange(NamedTuple):
    """An oscillator with f = 1 over a range of omega."""

    h: float
    R: float
    low: float
    high: float
    fewer: int = 1  # of so many points one is taken, where a period takes longer


#: Ranges of omega whose motions differ: where impacts are many or rests are long, other parts of
#: the kernel take the time. In chaos every period is computed.
RANGES: Mapping[str, OmegaRange] = {
    "quickstart": OmegaRange(0.05, 0.8, 2.4, 3.5),
    "chaos": OmegaRange(0.02, 0.9, 2.75, 2.95),
    "one impact": OmegaRange(0.1, 0.8, 0.8, 4.0),
    "rattling": OmegaRange(0.02, 0.9, 0.2, 0.4, 8),
    "chatter": OmegaRange(0.05, 0.8, 0.2, 0.4, 8),
    "rests": OmegaRange(0.3, 0.5, 0.3, 4.0, 2),
    "fast forcing": OmegaRange(0.05, 0.8, 6.0, 12.0),
}

#: What is timed, by name: the scene, and the arguments of `integrate`.
WORKS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "plain": ("chaos", {"integrator": "newmark", "impact": "plain"}),
    "reduced-step": ("chaos", {"integrator": "newmark", "impact": "reduced-step"}),
    "cubic": ("chaos", {"integrator": "rk4", "impact": "cubic"}),
    "exact, Lyapunov": ("chaos", {"lyapunov": True}),
    **{f"exact, {name}": (name, {}) for name in RANGES},
}
_ROUNDS = 10


def points_over(scene: OmegaRange, count: int) -> np.ndarray:
    """Return the points of a scene; the cheapest scenes have `count`."""
    points = Oscillator(scene.h, scene.R, 1.0, 1.0).at().repeat(max(1, count // scene.fewer))
    points["omega"] = np.linspace(scene.low, scene.high, points.size)
    return points


def effort_of(
    points: np.ndarray, work: Mapping[str, Any], transient: int, periods: int
) -> tuple[Effort, int]:
    """Return what a run of a work computes, and its steps per forcing period."""
    scheme = scheme_of(points, work.get("integrator", "exact"), work.get("impact", "exact"), None)
    length = Length(transient, periods, 0)
    return effort(points, scheme, length, work.get("lyapunov", False)), scheme.grid.size


def measure_speed(
    count: int, periods: int, report: Callable[[float], object] = lambda share: None
) -> dict[str, Any]:
    """Time every work on one thread and on all threads; return a `speed_record`."""
    threads = sorted({1, ALL_THREADS})
    scenes = {name: points_over(RANGES[scene], count) for name, (scene, _) in WORKS.items()}
    record: dict[str, Any] = {"transient": periods - periods // 3, "periods": periods // 3}
    runs: dict[tuple[str, int], Callable[[], object]] = {
        (name, n): partial(integrate, scenes[name], **WORKS[name][1], **record, threads=n)
        for name in WORKS
        for n in threads
    }
    runs["peak", 1] = partial(_multiply_adds, np.ones(_SUMS), _TIMES)
    times: dict[tuple[str, int], list[float]] = {key: [] for key in runs}
    turns = list(runs) * (_ROUNDS + 1)  # the first round also compiles, if necessary
    for turn, key in enumerate(turns, 1):
        began = time.perf_counter()
        runs[key]()
        times[key].append(time.perf_counter() - began)
        report(turn / len(turns))
    best = {key: min(each) for key, each in times.items()}

    peak = _SUMS * _CHAIN * _TIMES / best["peak", 1]
    speeds = {}
    for name, points in scenes.items():
        work = WORKS[name][1]
        done, steps = effort_of(points, work, **record)
        speeds[name] = {
            "steps": steps,
            "periods": {n: float(points.size * periods / best[name, n]) for n in threads},
            "computed": done.periods / best[name, 1],
            "impacts": done.impacts / best[name, 1],
            "share": done.periods / best[name, 1] * steps * PER_STEP / peak,
            "alone": math.nan if "impact" in work else done.alone / (done.periods * steps),
            "spread": statistics.median(times[name, 1]) / best[name, 1] - 1.0,
        }
    return speed_record(peak, speeds)


def speed_record(peak: float, speeds: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return the measurements of the works with their means, by the names of their keys in JSON.

    ``peak`` is in fused multiply-adds per second on one thread. Each work has ``steps`` per forcing
    period; ``periods`` answered per second, by number of threads; per second of one thread, periods
    ``computed``, where the others were copied, and ``impacts``; ``share``, that of the peak which
    the multiply-adds of the computed steps reach; ``alone``, the share of the computed steps that
    left the vector, NaN unless impacts are exact; and ``spread``, how far the median of the times
    on one thread is above the best. ``mean_share`` is a geometric mean.
    """
    return {
        "mean_share": statistics.geometric_mean([speed["share"] for speed in speeds.values()]),
        "spread": statistics.median([speed["spread"] for speed in speeds.values()]),
        "peak": peak,
        "numerics": NUMERICS,  # tells versions of the code apart in a history of records
        "numba_version": numba.__version__,
        "numba_way": str(WAY),
        "works": speeds,
    }


def speed_text(record: Mapping[str, Any]) -> str:
    """Return a `speed_record` as a table."""
    speeds, peak = record["works"], f"{record['peak'] / 1e9:.3g}e9"
    threads = list(next(iter(speeds.values()))["periods"])
    speed_up = ["speed-up"] if len(threads) > 1 else []
    names = ["one thread" if n == 1 else f"{n} threads" for n in threads]
    rows = [["impact rule", "steps", *names, *speed_up, "computed", "impacts", "alone", "of peak"]]
    for name, speed in speeds.items():
        rates = list(speed["periods"].values())
        ratio = [f"{rates[-1] / rates[0]:.2f}" for _ in speed_up]
        millions = [three_digits(r / 1e6) for r in (*rates, speed["computed"], speed["impacts"])]
        millions[len(rates) : len(rates)] = ratio
        alone = "" if math.isnan(speed["alone"]) else f"{speed['alone']:.2%}"
        rows.append([name, f"{speed['steps']}", *millions, alone, f"{speed['share']:.1%}"])
    return (
        "Million forcing periods per second. Once a motion has come back to the same bits, its\n"
        "periods are copied; on one thread, this many are computed, with so many million impacts\n"
        "per second. Share of the steps that left the vector, because of a rest for example.\n"
        f"Steps per period; share of one thread's peak, {peak} multiply-adds per\n"
        f"second, of which a step takes {PER_STEP}. All methods run in the scene 'chaos'.\n"
        f"numba {numba.__version__} is used {WAY}\n\n"
        f"{table(rows, words=1)}\n\n"
        f"geometric mean of the shares: {record['mean_share']:.3%}\n"
    )


@jit
def _multiply_adds(sums, times):  # type: ignore[no-untyped-def]  # numba types it
    """Do only fused multiply-adds; each sum waits only for its own."""
    widest_vectors()
    for _ in range(times):
        for i in range(_SUMS):
            y = sums[i]
            for _ in range(_CHAIN):
                y = fma(y, 0.999, 0.001)
            sums[i] = y
