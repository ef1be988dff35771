"""Motions continued in stages until they need no more.

A run that starts from a section continues the run before it to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from vibroimpact.points.regimes import has_result
from vibroimpact.status import Evidence, Status

#: Results by name, of shape (points, ...).
Results = Mapping[str, np.ndarray]


def in_stages(
    points: np.ndarray,
    stops: Iterable[int],
    phase: float,
    run: Callable[[np.ndarray, int], Results],
    goes_on: Callable[[np.ndarray, int, Results], np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Continue motions to one section after another, as long as they go on.

    `stops` are the periods from the start to these sections, increasing. `phase` is that of a
    section. `run` is given points and the periods of a stage; its results have the last section.
    `goes_on` is given the rows of these points, the periods from the start, and the
    results. Returns the last states as points, and their periods from the start, shape (n,).
    """
    state, done = points.copy(), np.zeros(points.size, np.int64)
    going, before = np.arange(points.size), 0
    for stop in stops:
        if not going.size:
            break
        now = state[going]
        results = run(now, stop - before)
        put_last(now, results, phase)
        state[going] = now
        done[going] = before = stop
        going = going[goes_on(going, stop, results)]
    return state, done


def put_last(points: np.ndarray, results: Results, phase: float) -> None:
    """Write the last sections in results as starts of points; a failed motion keeps its start."""
    x, v = results["poincare_x"][:, -1], results["poincare_v"][:, -1]
    ended = np.isfinite(x) & np.isfinite(v)
    for name, value in (("x0", x), ("v0", v), ("phase", phase)):
        points[name] = np.where(ended, value, points[name])


def put_rows(
    collected: dict[str, np.ndarray], size: int, rows: np.ndarray, results: Results
) -> None:
    """Write the results of the points in `rows` into arrays of shape (size, ...)."""
    for name, values in results.items():
        if name not in collected:
            collected[name] = np.empty((size, *values.shape[1:]), values.dtype)
        collected[name][rows] = values


def worst_of(before: np.ndarray, status: np.ndarray) -> np.ndarray:
    """Return the worst outcomes of motions after a stage, given those of the stages before it.

    Whether a motion grows without bound, or loses digits, only its record says.
    """
    kept = (status > Status.CERTIFIED) & (status != Status.UNBOUNDED)
    return np.maximum(before, np.where(kept, status, Status.COMPUTED)).astype(np.int8)


def without_class(evidence: np.ndarray, status: np.ndarray) -> np.ndarray:
    """Return the mask of the motions that have not failed, and go to no known orbit."""
    return (evidence <= Evidence.UNREACHED) & has_result(status)
