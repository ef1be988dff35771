"""`compute_points`, by the kernel or in chains, and the class of each from its record.

Points are scaled, followed, have transients of their own, or start plainly.

The first point of a chain starts as every point of a sweep does, from x0, v0. Each further
point starts at the section, in the last state that its neighbour recorded there. So its transient
and its record continue the motion of the neighbour at another value of the axis. If the clearance
is followed and the stop has moved past that state, the mass starts on the stop. If the neighbour
failed, there is no state to start from, and the next point starts like the first of a chain.

Chains advance together, value by value: the chains of a batch, and both directions, are lanes of
the same call of the kernel.

**Scaling.** With the stop at the rest position, a start at rest there and a = 0, f is the only
quantity in eq. (1) and the rules (2)-(5) whose unit has a length. So x and v are proportional to f,
and the times of the impacts do not depend on it. The same holds for every step of every method.
Scaling by a power of two is exact to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from vibroimpact.destination.judge import NO_DESTINATION
from vibroimpact.kernel.integrate import Length, find_destinations, integrate, run_points
from vibroimpact.points.regimes import has_result
from vibroimpact.points.stages import RunSpec, put_last, put_rows, run_with_own_transients
from vibroimpact.status import Evidence, Status
from vibroimpact.step.contact import with_near_stop
from vibroimpact.step.recorder import trajectories
from vibroimpact.step.scheme import THETA, Scheme

#: Results proportional to f: their unit is a length, or a length per time.
SCALED = (
    "poincare_x",
    "poincare_v",
    "impact_v",
    "trajectory_x",
    "trajectory_v",
    "slowest_impact",
    "fastest_impact",
    "impulse",
    "max_penetration",
    "x_min",
    "x_max",
    "orbit_x",
    "orbit_v",
)
#: Results proportional to f squared.
SCALED_SQUARED = ("energy_lost",)


def compute_points(
    spec: RunSpec, points: np.ndarray, threads: int | None, interrupt: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """Compute `points` of shape (n,), each from its own start.

    `threads` is None for all. Returns arrays of shape (n, ...), named as by
    `vibroimpact.integrate`; the results of `trajectories` and `classified` are added where `spec`
    asks for them.
    """
    if spec.scaled:
        return _computed_once(replace(spec, scaled=False), points, threads, interrupt)
    points = with_near_stop(points, spec.impact)
    run = partial(_run, threads=threads, interrupt=interrupt)
    if spec.longest is None:
        results = run(spec, points)
    else:
        results = run_with_own_transients(spec, points, run)
    return classified(spec, points, results, threads) if spec.period else results


def compute_chains(
    spec: RunSpec,
    box: np.ndarray,
    along: int,
    threads: int | None,
    advance: Callable[[int], object],
    interrupt: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """Compute the points of a box, each from its neighbour's last state along the followed axis.

    This is complete along dimension `along` of the box. `advance` is given the number of points
    computed since its last call, after every value of the axis. The results are as of
    `compute_points`, one direction after the other, each in C order.
    """
    axis, size, flat = spec.followed, box.size, box.ravel()
    assert axis is not None
    # The indices in `flat` of the points of each chain: shape (chains, values of the axis).
    places = np.moveaxis(np.arange(size).reshape(box.shape), along, -1)
    chains = places.reshape(-1, box.shape[along])
    rising = np.argsort(flat[chains[0]][axis], kind="stable")
    orders = [rising if direction == "up" else rising[::-1] for direction in spec.directions]
    collected, before = dict[str, np.ndarray](), dict[str, np.ndarray]()
    for order in zip(*orders, strict=True):  # one value of the axis for each direction
        rows = np.concatenate([chains[:, value] + i * size for i, value in enumerate(order)])
        lanes = flat[rows % size]
        if before:
            put_last(lanes, before, spec.phase)
            if axis == "clearance":  # the stop may have moved past that state
                lanes["x0"] = np.minimum(lanes["x0"], lanes["clearance"])
        before = _run(spec, with_near_stop(lanes, spec.impact), threads, interrupt)
        put_rows(collected, len(orders) * size, rows, before)
        advance(len(rows))
    points = np.tile(flat, len(orders))
    return classified(spec, points, collected, threads) if spec.period else collected


def _computed_once(
    spec: RunSpec, points: np.ndarray, threads: int | None, interrupt: np.ndarray | None
) -> dict[str, np.ndarray]:
    """Compute points that differ only in f once, at f = 1, and scale the results."""
    at_one = points.copy()
    at_one["f"] = 1.0
    different, index = np.unique(at_one, return_inverse=True)
    computed = compute_points(spec, different, threads, interrupt)
    results = {name: values[index] for name, values in computed.items()}
    for name, values in results.items():
        if name in SCALED:
            values *= points["f"].reshape(-1, *(1,) * (values.ndim - 1))
        elif name in SCALED_SQUARED:
            values *= points["f"] ** 2
    return results


def _run(
    spec: RunSpec, points: np.ndarray, threads: int | None, interrupt: np.ndarray | None
) -> dict[str, np.ndarray]:
    """Compute points without scaling, following or period class."""
    if interrupt is None:
        interrupt = np.zeros(1, np.int64)
    scheme = Scheme.of(spec.integrator, spec.impact, spec.steps_per_period, spec.phase)
    length = Length(spec.transient, spec.periods, spec.impacts)
    results = run_points(
        points, scheme, length, spec.lyapunov, threads, interrupt, spec.period, spec.extremes
    )
    begun = results.pop("begun")
    if spec.every is not None:
        # A start beyond the phase of the section passes it in the next period of the clock.
        first = spec.transient + (points["phase"] > spec.phase)
        if spec.transient > 0:  # the record begins at a section
            points = points.copy()
            points["x0"], points["v0"] = begun.T
            points["phase"] = scheme.grid.table[THETA, 0]
        # A rest has two events besides its impacts, and may begin before the record.
        events = spec.periods * results["impacts_per_period"] + 2.0 * results["chatters"] + 2.0
        results |= trajectories(
            points, scheme, spec.periods, first, spec.every, threads, interrupt,
            np.nan_to_num(events),
        )  # fmt: skip
    return results


#: The results of a run from which the destinations are found.
RECORD = ("poincare_x", "poincare_v", "impacts_per_period", "rest_fraction", "chatters", "status")


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
    destination = results["destination"]
    moves = has_result(results["status"]) & (results["status"] != Status.UNBOUNDED)
    destination[~moves] = NO_DESTINATION
    uncounted = np.flatnonzero(destination["q"] < 0)
    last = np.stack([results[f"poincare_{name}"][uncounted, -1] for name in "xv"], axis=1)
    q, rests = _repeated(spec, points[uncounted], last, destination["m"][uncounted], threads)
    destination["q"][uncounted] = q
    released = (results["rest_fraction"][uncounted] > 0.0) & ~rests
    destination["evidence"][uncounted[released]] = Evidence.RELEASED
    is_known = destination["evidence"] > Evidence.UNREACHED
    others = {name: values for name, values in results.items() if name != "destination"}
    return others | {
        "period": np.where(is_known, destination["m"], 0),
        "period_impacts": np.where(is_known, destination["q"], 0),
        "orbit_x": np.where(is_known, destination["x"], np.nan),
        "orbit_v": np.where(is_known, destination["v"], np.nan),
        "orbit_distance": np.where(is_known, destination["distance"], np.nan),
        "class_evidence": destination["evidence"].astype(np.int8),
    }


def classified_later(
    spec: RunSpec, points: np.ndarray, results: Mapping[str, np.ndarray], threads: int | None = None
) -> dict[str, np.ndarray]:
    """Return what `classified` does, for a run that was not asked for classes."""
    scheme = Scheme.of(spec.integrator, spec.impact, spec.steps_per_period, spec.phase)
    starts = points.copy()
    if spec.followed is not None:  # the run started each point elsewhere
        put_last(starts, results, spec.phase)
    starts = with_near_stop(starts, spec.impact)
    results = {**results, "destination": find_destinations(starts, scheme, results, threads)}
    return classified(spec, points, results, threads)


def _repeated(
    spec: RunSpec, points: np.ndarray, last: np.ndarray, m: np.ndarray, threads: int | None
) -> tuple[np.ndarray, np.ndarray]:
    """Count the impacts of motions over m periods from their `last` section on; say which rest."""
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
