"""Forcing periods per second on this machine, and their share of its peak.

The peak is the measured rate of fused multiply-adds in a loop that does nothing else. A step of the
affine map takes eight of them; the share counts only these. All runs are
interleaved, and the best round of each counts, in wall time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numba
import numpy as np
from rich.console import Console
from rich.progress import track

from sweeps.text import table
from vibroimpact import Oscillator, integrate
from vibroimpact.jit import ALL_THREADS, WAY, fma, jit, widest_vectors
from vibroimpact.step.scheme import default_steps

#: Multiply-adds in a step of the affine map.
PER_STEP = 8

#: Sums side by side in vector registers; multiply-adds on a sum at a time; repetitions of both.
_SUMS, _CHAIN, _TIMES = 64, 8, 40_000

#: Where most motions come back to the same bits, after which their periods are copied.
_ANSWERED = "exact, chatter", "exact, settling"

#: What is timed, by name: the arguments of `integrate`.
WORKS: Mapping[str, Mapping[str, Any]] = {
    "plain": {"integrator": "newmark", "impact": "plain"},
    "reduced-step": {"integrator": "newmark", "impact": "reduced-step"},
    "cubic": {"integrator": "rk4", "impact": "cubic"},
    "exact": {},
    "exact, Lyapunov": {"lyapunov": True},
    "exact, chatter": {},
    "exact, settling": {},
}
_ROUNDS = 10


class Speed(NamedTuple):
    """The measurement of one work."""

    steps: int  # steps per forcing period
    periods: dict[int, float]  # forcing periods per second, by number of threads
    share: float  # share of the peak of one thread that the multiply-adds of the steps reach


def _points(name: str, count: int) -> np.ndarray:
    """Return the points of a work; in the chaos of most of them every period is computed."""
    osc, low, high = Oscillator(h=0.02, R=0.9, omega=1.0, f=1.0), 2.8, 2.95
    if name == "exact, chatter":  # takes longer, so only a sixteenth of the points
        osc, low, high, count = replace(osc, h=0.05, R=0.5), 0.1, 0.6, count // 16
    elif name == "exact, settling":
        osc, low, high = replace(osc, h=0.1, R=0.8), 0.8, 4.0
    points = osc.at().repeat(count)
    points["omega"] = np.linspace(low, high, count)
    return points


def measure(
    count: int = 4096, periods: int = 300, progress: bool = False
) -> tuple[float, dict[str, Speed]]:
    """Time every work on one thread and on all threads; return the peak, and the speeds by work.

    The last third of the forcing `periods` is recorded. The peak is in fused multiply-adds per
    second on one thread.
    """
    threads = sorted({1, ALL_THREADS})
    scenes = {name: _points(name, count) for name in WORKS}
    record: dict[str, Any] = {"transient": periods - periods // 3, "periods": periods // 3}
    sums = np.ones(_SUMS)
    runs: dict[tuple[str, int], Callable[[], object]] = {
        (name, n): partial(integrate, scenes[name], **WORKS[name], **record, threads=n)
        for name in WORKS
        for n in threads
    }
    runs["peak", 1] = lambda: _multiply_adds(sums, _TIMES)
    best = dict.fromkeys(runs, np.inf)
    # The first round also compiles, if necessary.
    for key in track(
        list(runs) * (_ROUNDS + 1),
        "compiling, then timing",
        console=Console(stderr=True, quiet=not progress),
        transient=True,
    ):
        began = time.perf_counter()
        runs[key]()
        best[key] = min(best[key], time.perf_counter() - began)

    peak = _SUMS * _CHAIN * _TIMES / best["peak", 1]
    speeds = {}
    for name, points in scenes.items():
        steps = default_steps(points, WORKS[name].get("impact", "exact"))
        rates = {n: float(points.size * periods / best[name, n]) for n in threads}
        speeds[name] = Speed(steps, rates, rates[1] * steps * PER_STEP / peak)
    return peak, speeds


def shown(peak: float, speeds: Mapping[str, Speed]) -> str:
    """Return the results of `measure` as a table."""
    threads = list(next(iter(speeds.values())).periods)
    speed_up = ["speed-up"] if len(threads) > 1 else []
    names = ["one thread" if n == 1 else f"{n} threads" for n in threads]
    rows = [["impact rule", "steps", *names, *speed_up, "of peak"]]
    for name, speed in speeds.items():
        rates = [speed.periods[n] for n in threads]
        ratio = [f"{rates[-1] / rates[0]:.2f}" for _ in speed_up]
        cells = [f"{rate / 1e6:.3g}" for rate in rates]
        # Of periods that are not computed there is no share.
        share = "" if name in _ANSWERED else f"{speed.share:.1%}"
        rows.append([name, f"{speed.steps}", *cells, *ratio, share])
    return (
        "Million forcing periods per second. In chaos no motion comes back to the same bits, and\n"
        f"all are computed; where most motions do ({', '.join(map(repr, _ANSWERED))}),\n"
        "most are copied. Steps per period; share of one thread's peak,\n"
        f"{peak / 1e9:.3g}e9 multiply-adds per second, of which a step takes {PER_STEP}.\n"
        f"numba {numba.__version__} is used {WAY}\n\n"
        f"{table(rows, words=1)}\n"
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
