"""The trial of a way: small functions in another process.

``way.py`` runs it in a process of its own. The numbers are powers of two, so that the right results
are known to the last bit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibroimpact.jit.compiling import compiled, inlined, jit, specialised
from vibroimpact.jit.intrinsics import (
    claim,
    fma,
    is_set,
    lowest_bit,
    not_negative,
    select,
    widest_vectors,
)
from vibroimpact.jit.way import WAY

_LANES = 64
_E = 2.0**-30


class TrialJob(NamedTuple):
    """Data of the kinds that the threads of the kernel share."""

    points: np.ndarray
    rows: np.ndarray
    claimed: np.ndarray
    method: tuple[int, float]


@specialised
def _square(x, exactly):  # type: ignore[no-untyped-def]  # numba types it
    return fma(x, x, -1.0 - 2.0 * _E) if exactly else x * x - (1.0 + 2.0 * _E)


@inlined
def _positive(x):  # type: ignore[no-untyped-def]
    return select(x > 0.0, x, 0.0)


@jit
def _fill_lanes(lanes, x):  # type: ignore[no-untyped-def]
    """Fill the lanes with e squared in odd places and -1 in the others."""
    widest_vectors()
    for i in range(_LANES):
        lanes[i] = _positive(_square(x, True) + _square(x, False)) if i & 1 else -1.0


@jit
def _run_steps(job, lanes, k):  # type: ignore[no-untyped-def]
    """Add the lanes that are not negative to a point, one by one."""
    point = job.points[k]
    _fill_lanes(lanes, point.x)
    bits = not_negative(lanes, 0)
    while bits:
        i = lowest_bit(bits)
        bits &= bits - 1
        point.total += lanes[i] * job.method[1]
        job.rows[k, i & 1] = i


@jit
def _take(job):  # type: ignore[no-untyped-def]
    """Take point after point, as a thread of the kernel does."""
    lanes = np.zeros(_LANES)
    k = claim(job.claimed)
    while k < job.points.size and not is_set(job.claimed[1:]):
        _run_steps(job, lanes, k)
        k = claim(job.claimed)
    return lanes.sum(), job.rows[:2].copy()


def run_trial() -> None:
    """Print the way, and whether the code was compiled or loaded, if its results are right."""
    points = np.zeros(3, [("x", float), ("total", float)])
    points["x"] = 1.0 + _E
    job = TrialJob(points, np.zeros((3, 2)), np.zeros(2, np.int64), (1, 0.5))
    total, rows = compiled(_take, job)(job)
    half = _LANES // 2
    found = (total, points["total"].tolist(), rows.tolist(), int(job.claimed[0]))
    right = (half * _E * _E - half, [half * _E * _E / 2] * 3, [[0.0, _LANES - 1.0]] * 2, 4)
    if found != right:  # no assert, which PYTHONOPTIMIZE removes
        raise ArithmeticError(f"{found} instead of {right}")
    loaded = sum(_take.stats.cache_hits.values()) == 1
    print(WAY.name, "loaded" if loaded else "compiled")
