"""Forcing periods per second on this machine, and their share of its peak.

The peak is the measured rate of fused multiply-adds in a loop that does nothing else. A step of
the affine map is eight of them; the share counts no other work of a method. All runs are
interleaved, and the best round of each counts, in wall time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track

from sweeps.bench.costs import scene
from vibroimpact import integrate
from vibroimpact.jit import ALL_THREADS, fma, jit, widest_vectors
from vibroimpact.step.methods import default_steps

#: Multiply-adds in a step of the affine map.
PER_STEP = 8

#: In turn: sums side by side in vector registers, multiply-adds on each at a time, and how often.
_SUMS, _CHAIN, _TIMES = 64, 8, 40_000

_SWEEP = {"h": 0.1, "R": 0.8, "omega": (0.8, 4.0)}
_CHATTER = {"h": 0.05, "R": 0.5, "omega": (0.1, 0.6)}


@dataclass(frozen=True)
class Work:
    """What is timed.

    Attributes
    ----------
    integrator, impact : str
    scene : mapping of str to float or (float, float)
        The oscillator, a pair being the ends of a range.
    size : float
        Points, relative to the others.
    options : mapping
        Further arguments of `integrate`.
    """

    integrator: str
    impact: str
    scene: Mapping[str, Any] = field(default_factory=lambda: _SWEEP)
    size: float = 1.0
    options: Mapping[str, Any] = field(default_factory=dict)


WORKS: Mapping[str, Work] = {
    "plain": Work("newmark", "plain"),
    "reduced-step": Work("newmark", "reduced-step"),
    "cubic": Work("rk4", "cubic"),
    "exact": Work("exact", "exact"),
    "exact, Lyapunov": Work("exact", "exact", options={"lyapunov": True}),
    "exact, chatter": Work("exact", "exact", _CHATTER, size=0.0625),
}


@dataclass(frozen=True)
class Speed:
    """What was measured of one work.

    Attributes
    ----------
    steps : int
        Steps per forcing period.
    periods : dict of int to float
        Forcing periods per second, by number of threads.
    share : float
        Of one thread's peak, that the multiply-adds of its steps are.
    """

    steps: int
    periods: dict[int, float]
    share: float


@dataclass(frozen=True)
class Measured:
    """All that was measured.

    Attributes
    ----------
    peak : float
        Fused multiply-adds per second on one thread.
    speeds : dict of str to Speed
        By name of the work.
    """

    peak: float
    speeds: dict[str, Speed]


def measure(quick: bool = False, progress: bool = False) -> Measured:
    """Time every work on one thread and on all.

    Parameters
    ----------
    quick : bool
        Whether to take fewer points and periods.
    progress : bool
        Whether to show on stderr how far it is.
    """
    points, transient, recorded, rounds = (1024, 100, 50, 10) if quick else (4096, 200, 100, 10)
    periods = transient + recorded
    threads = sorted({1, ALL_THREADS})
    scenes = {name: scene(work.scene, int(points * work.size)) for name, work in WORKS.items()}
    steps = {name: default_steps(scenes[name], work.impact) for name, work in WORKS.items()}

    def run(name: str, count: int) -> Callable[[], object]:
        work = WORKS[name]
        return lambda: integrate(
            scenes[name],
            integrator=work.integrator,
            impact=work.impact,
            transient=transient,
            periods=recorded,
            threads=count,
            **work.options,
        )

    sums = np.ones(_SUMS)
    runs: dict[tuple[str, int], Callable[[], object]] = {
        (name, count): run(name, count) for name in WORKS for count in threads
    }
    runs["peak", 1] = lambda: _multiply_adds(sums, _TIMES)
    best = dict.fromkeys(runs, np.inf)
    # The first round also compiles, if need be.
    for key in track(
        list(runs) * (rounds + 1),
        "compiling, then timing",
        console=Console(stderr=True, quiet=not progress),
        transient=True,
    ):
        began = time.perf_counter()
        runs[key]()
        best[key] = min(best[key], time.perf_counter() - began)

    peak = _SUMS * _CHAIN * _TIMES / best["peak", 1]
    speeds = {}
    for name, points_of in scenes.items():
        rates = {count: float(points_of.size * periods / best[name, count]) for count in threads}
        share = rates[1] * steps[name] * PER_STEP / peak
        speeds[name] = Speed(steps[name], rates, float(share))
    return Measured(float(peak), speeds)


@jit(refcounts=False)
def _multiply_adds(sums: np.ndarray, times: int) -> None:
    """Do nothing but fused multiply-adds; each sum waits only for its own."""
    widest_vectors()  # type: ignore[call-arg]  # numba gives the context
    for _ in range(times):
        for i in range(_SUMS):
            y = sums[i]
            for _ in range(_CHAIN):
                y = fma(y, 0.999, 0.001)
            sums[i] = y
