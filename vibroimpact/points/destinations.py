"""The results of a run, with the classes of its points."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vibroimpact.destination.find import NO_DESTINATION
from vibroimpact.kernel.integrate import find_destinations, integrate
from vibroimpact.points.regimes import has_result
from vibroimpact.points.run_spec import RunSpec
from vibroimpact.points.stages import put_last
from vibroimpact.status import Evidence, Status
from vibroimpact.step.contact import with_stop_in_reach
from vibroimpact.step.scheme import Scheme

#: The results of a run from which the destinations are found.
RECORD = (
    "poincare_x",
    "poincare_v",
    "impacts_per_period",
    "rest_fraction",
    "chatters",
    "status",
)


def classified(
    spec: RunSpec, points: np.ndarray, results: Mapping[str, np.ndarray], threads: int | None
) -> dict[str, np.ndarray]:
    """Add the class of every motion to the results of a run that has found ``destination``.

    The others are at least those named in ``RECORD``, with the method and the phase of `spec`.
    ``period`` and ``period_impacts`` are those of the orbit to which the motion goes, 0 if none is
    known. ``orbit_x`` and ``orbit_v`` are the state of the orbit at the last section, and
    ``orbit_distance`` is the distance of the motion from it, as a share of the size of the record;
    NaN without a class. ``class_evidence`` is an ``Evidence``.
    """
    found = results["destination"]
    moves = has_result(results["status"]) & (results["status"] != Status.UNBOUNDED)
    found[~moves] = NO_DESTINATION
    uncounted = np.flatnonzero(found["q"] < 0)
    last = np.stack([results[f"poincare_{name}"][uncounted, -1] for name in "xv"], axis=1)
    q, rests = _repeated(spec, points[uncounted], last, found["m"][uncounted], threads)
    found["q"][uncounted] = q
    released = (results["rest_fraction"][uncounted] > 0.0) & ~rests
    found["evidence"][uncounted[released]] = Evidence.RELEASED
    known = found["evidence"] > Evidence.UNREACHED
    kept = {name: values for name, values in results.items() if name != "destination"}
    return kept | {
        "period": np.where(known, found["m"], 0),
        "period_impacts": np.where(known, found["q"], 0),
        "orbit_x": np.where(known, found["x"], np.nan),
        "orbit_v": np.where(known, found["v"], np.nan),
        "orbit_distance": np.where(known, found["distance"], np.nan),
        "class_evidence": found["evidence"].astype(np.int8),
    }


def classified_later(
    spec: RunSpec,
    points: np.ndarray,
    results: Mapping[str, np.ndarray],
    threads: int | None = None,
) -> dict[str, np.ndarray]:
    """Return what `classified` does, for a run that was not asked for classes."""
    scheme = Scheme.of(spec.integrator, spec.impact, spec.steps_per_period, spec.phase)
    starts = points.copy()
    if spec.followed is not None:  # the run started each point elsewhere
        put_last(starts, results, spec.phase)
    found = find_destinations(with_stop_in_reach(starts, spec.impact), scheme, results, threads)
    return classified(spec, points, {**results, "destination": found}, threads)


def _repeated(
    spec: RunSpec, points: np.ndarray, last: np.ndarray, m: np.ndarray, threads: int | None
) -> tuple[np.ndarray, np.ndarray]:
    """Count the impacts of motions over m periods from their `last` section on; say which rest.

    The record may begin before the motion repeats.
    """
    counted, rests = np.zeros(points.size), np.zeros(points.size, bool)
    for repetition in np.unique(m).tolist():
        rows = np.flatnonzero(m == repetition)
        starts = points[rows]
        starts["x0"], starts["v0"] = last[rows].T
        once = integrate(
            starts,
            integrator=spec.integrator,
            impact=spec.impact,
            steps_per_period=spec.steps_per_period,
            transient=0,
            periods=repetition,
            phase=spec.phase,
            at_section=True,
            impacts=0,
            threads=threads,
        )
        counted[rows] = once["impacts_per_period"] * repetition
        rests[rows] = once["rest_fraction"] > 0.0
    return np.rint(counted).astype(np.int64), rests
