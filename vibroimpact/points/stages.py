"""`RunSpec`, what is computed of each point, its `stage`s; `transient: auto`.

A run that starts from a section continues the run before it to the last bit.

**Transients that are found.** Points run in stages, each as long as all before it. After a stage
the class of every motion is found from the last sections. A motion with a class still needs as many
periods as its distance from the orbit, which its greatest multiplier reduces, takes to fall to
rounding. A motion without a class goes on, but not beyond the longest transient. It does not go on
if its exponents over a long stage say that it is chaotic. So the results are those of a run from
the start, with the transient that was found. The status is the worst of all stages: a motion that
failed in one has no record.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from vibroimpact.points.regimes import has_result, is_chaotic
from vibroimpact.status import Evidence, Status


@dataclass(frozen=True)
class RunSpec:
    """What is computed for every point of a sweep; two equal specifications give equal results.

    Its values are valid: the configuration was checked, and has enough steps for every point.
    """

    # As the arguments of ``integrate``.
    integrator: str
    impact: str
    steps_per_period: int
    transient: int
    longest: int | None  #: Longest transient if each point has its own, see ``stages.py``.
    periods: int
    phase: float
    impacts: int
    lyapunov: bool
    period: bool  #: Whether to find the period class.
    every: int | None  #: Steps between samples of the trajectory; None for no trajectory.
    #: Whether points that differ only in f are computed once, see ``computation.py``.
    scaled: bool
    #: The axis along which each point starts from its neighbour, see ``computation.py``, and the
    #: directions: ``up``, ``down`` or both.
    followed: str | None
    directions: tuple[str, ...]
    extremes: bool = False  #: Whether to find the least and the greatest displacement.

    def stage(self, transient: int, periods: int, impacts: int, lyapunov: bool) -> RunSpec:
        """Return the specification of a stage of the run, without trajectory and extremes."""
        return replace(
            self, transient=transient, longest=None, periods=periods, impacts=impacts,
            lyapunov=lyapunov, every=None, extremes=False, scaled=False,
        )  # fmt: skip


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
    ended = np.isfinite(x) & np.isfinite(v) & has_result(results["status"])
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
    """Return the worst outcomes of motions after a stage, given those of the stages before it."""
    # Whether a motion is unbounded, or loses digits, only its record says.
    counts = (status > Status.CERTIFIED) & (status != Status.UNBOUNDED)
    return np.maximum(before, np.where(counts, status, Status.COMPUTED)).astype(np.int8)


def without_class(evidence: np.ndarray, status: np.ndarray) -> np.ndarray:
    """Return the mask of the motions that have not failed, and go to no known orbit."""
    return (evidence <= Evidence.UNREACHED) & has_result(status)


#: Sections from which a class is found, and periods of the first stage.
_SECTIONS, _FIRST = 32, 64
#: Periods of a stage whose exponents tell chaos from long transients.
_LONG = 512
#: A distance from an orbit that is rounding, as a share of the size of the record.
_ROUNDING = 1e-15
#: Motions that end their transient together wait for the longest of them; so many per doubling.
_STEPS_PER_DOUBLING = 4

#: Computes points by a specification.
Run = Callable[[RunSpec, np.ndarray], dict[str, np.ndarray]]


def run_with_own_transients(spec: RunSpec, points: np.ndarray, run: Run) -> dict[str, np.ndarray]:
    """Compute points, each with its own transient; ``transient`` has the periods, shape (n,)."""
    assert spec.longest is not None
    needed, longest = np.zeros(points.size, np.int64), spec.longest
    worst = np.full(points.size, Status.COMPUTED, np.int8)

    def stage(points: np.ndarray, periods: int) -> dict[str, np.ndarray]:
        return run(_stage(spec, periods), points)

    def goes_on(going: np.ndarray, done: int, results: Results) -> np.ndarray:
        destination = results["destination"]
        needed[going] = _needed(destination, longest - done)
        worst[going] = worst_of(worst[going], results["status"])
        on = without_class(destination["evidence"], results["status"])
        if "lyapunov" in results:
            periods = results["poincare_x"].shape[1]
            on &= ~is_chaotic(results["lyapunov"], points["omega"][going], periods)
        return on

    state, done = in_stages(points, _doubled(longest), spec.phase, stage, goes_on)
    results = _record_points(spec, points, state, done, needed, run)
    failed = ~has_result(worst)
    for name, values in results.items():
        if name not in ("destination", "transient"):
            values[failed] = np.nan if values.dtype.kind == "f" else 0
    status = np.where(
        results["status"] < 0, results["status"], np.maximum(results["status"], worst)
    )
    return results | {"status": status}


def _doubled(longest: int) -> Iterator[int]:
    """Yield the periods after which classes are found: each twice as many as before."""
    stop = _FIRST
    while stop < longest:
        yield stop
        stop *= 2
    yield longest


def _stage(spec: RunSpec, length: int) -> RunSpec:
    """Return the specification of a stage; exponents cover it if it is long enough."""
    lyapunov = spec.lyapunov and length >= _LONG
    sections = length if lyapunov else min(length, _SECTIONS)
    return spec.stage(length - sections, sections, 0, lyapunov)


def _needed(destination: np.ndarray, most: int) -> np.ndarray:
    """Return the periods that motions still need, in few different numbers, at most `most`."""
    with np.errstate(divide="ignore", invalid="ignore"):
        falls = np.log(_ROUNDING / destination["distance"]) / np.log(destination["multiplier"])
    falls = np.clip(np.nan_to_num(falls), 0.0, most)
    falls[destination["evidence"] <= Evidence.UNREACHED] = 0.0
    periods = np.minimum(falls * destination["m"], most)
    steps = np.ceil(_STEPS_PER_DOUBLING * np.log2(np.maximum(periods, 1.0)))
    rounded = np.ceil(2.0 ** (steps / _STEPS_PER_DOUBLING))
    return np.where(periods < 1.0, 0, np.minimum(rounded, most)).astype(np.int64)


def _record_points(
    spec: RunSpec,
    points: np.ndarray,
    state: np.ndarray,
    periods_done: np.ndarray,
    needed: np.ndarray,
    run: Run,
) -> dict[str, np.ndarray]:
    """Record points after the periods that they still need from their states."""
    arrays: dict[str, np.ndarray] = {}
    for more in np.unique(needed).tolist():
        rows = np.flatnonzero(needed == more)
        record = spec.stage(more, spec.periods, spec.impacts, spec.lyapunov)
        record = replace(record, extremes=spec.extremes)
        put_rows(arrays, points.size, rows, run(record, state[rows]))
    return arrays | {"transient": periods_done + needed}
