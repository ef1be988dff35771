"""The trial of a way of using numba, with small functions.

``way.py`` runs it in a process of its own. The numbers are powers of two, so that the right results
are known to the last bit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibroimpact.jit.compiling import compiled, jit
from vibroimpact.jit.intrinsics import claim, is_set
from vibroimpact.jit.trial_steps import TRIAL_LANES, E, run_steps
from vibroimpact.jit.way import WAY


class TrialJob(NamedTuple):
    """Data of the kinds that the threads of the kernel share."""

    points: np.ndarray
    rows: np.ndarray
    claimed: np.ndarray
    method: tuple[int, float]


@jit
def _take(job):  # type: ignore[no-untyped-def]
    """Take point after point, as a thread of the kernel does."""
    lanes = np.zeros(TRIAL_LANES)
    k = claim(job.claimed)
    while k < job.points.size and not is_set(job.claimed[1:]):
        run_steps(job, lanes, k)
        k = claim(job.claimed)
    return lanes.sum(), job.rows[:2].copy()


def run_trial() -> None:
    """Print the way, and whether the code was compiled or loaded, if its results are right."""
    points = np.zeros(3, [("x", float), ("total", float)])
    points["x"] = 1.0 + E
    job = TrialJob(points, np.zeros((3, 2)), np.zeros(2, np.int64), (1, 0.5))
    total, rows = compiled(_take, job)(job)
    half = TRIAL_LANES // 2
    found = (total, points["total"].tolist(), rows.tolist(), int(job.claimed[0]))
    right = (half * E * E - half, [half * E * E / 2] * 3, [[0.0, TRIAL_LANES - 1.0]] * 2, 4)
    if found != right:  # no assert, which PYTHONOPTIMIZE removes
        raise ArithmeticError(f"{found} instead of {right}")
    loaded = sum(_take.stats.cache_hits.values()) == 1
    print(WAY.name, "loaded" if loaded else "compiled")
