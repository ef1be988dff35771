"""The computation of points by the kernel: scaled, followed, or with transients of their own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from vibroimpact.kernel.integrate import Length, record_begins, recorded_extremes, run_points
from vibroimpact.oscillator import mesh
from vibroimpact.points.destinations import classified
from vibroimpact.points.following import follow_chains
from vibroimpact.points.run_spec import RunSpec
from vibroimpact.points.scaling import computed_once
from vibroimpact.points.transient import run_with_own_transients
from vibroimpact.step.recorder import trajectories
from vibroimpact.step.scheme import scheme_of


def compute_box(
    spec: RunSpec,
    axes: Mapping[str, np.ndarray],
    fixed: Mapping[str, float],
    threads: int | None,
    advance: Callable[[int], object],
    interrupt: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """Compute the points of a box of `axes`, slowest first; a followed axis must be complete.

    `advance` is given the number of points computed since its last call: after every value of a
    followed axis, otherwise once. `threads` is None for all. Returns arrays of shape (points, ...),
    in C order, two directions one after the other. They are named as by `vibroimpact.integrate`;
    the results of `trajectories` and `classified` are added where `spec` asks for them.
    """
    points = mesh(axes, fixed)
    if spec.followed is None:
        results = compute_points(spec, points, threads, interrupt=interrupt)
        advance(points.size)
        return results

    run = partial(_run, spec, threads=threads, interrupt=interrupt)
    box = points.reshape(tuple(map(len, axes.values())))
    along = list(axes).index(spec.followed)
    results = follow_chains(box, along, spec.followed, spec.directions, spec.phase, run, advance)
    points = np.tile(points, len(spec.directions))
    return classified(spec, points, results, threads, interrupt) if spec.period else results


def compute_points(
    spec: RunSpec,
    points: np.ndarray,
    threads: int | None,
    interrupt: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """Compute `points` of shape (n,), each from its own start; results as of `compute_box`."""
    part = partial(_run, threads=threads, interrupt=interrupt)

    def run(points: np.ndarray) -> dict[str, np.ndarray]:
        if spec.longest is None:
            results = part(spec, points)
        else:
            results = run_with_own_transients(spec, points, part)
        return classified(spec, points, results, threads, interrupt) if spec.period else results

    return computed_once(points, run) if spec.scaled else run(points)


def _run(
    spec: RunSpec,
    points: np.ndarray,
    threads: int | None,
    interrupt: np.ndarray | None,
) -> dict[str, np.ndarray]:
    """Compute points without scaling, following or period class."""
    if interrupt is None:
        interrupt = np.zeros(1, np.int64)
    scheme = scheme_of(points, spec.integrator, spec.impact, spec.steps_per_period, spec.phase)
    length = Length(spec.transient, spec.periods, spec.impacts)
    results = run_points(points, scheme, length, spec.lyapunov, threads, interrupt, spec.period)
    if spec.extremes:
        results |= recorded_extremes(points, scheme, length, results, threads, interrupt)
    begun = results.pop("begun")
    if spec.every is not None:
        # A start beyond the phase of the section passes it in the next period of the clock.
        first = spec.transient + (points["phase"] > spec.phase)
        points = record_begins(points, scheme, spec.transient, begun)
        # A rest has two events besides its impacts, and may begin before the record.
        events = spec.periods * results["impacts_per_period"] + 2.0 * results["chatters"] + 2.0
        results |= trajectories(
            points, scheme, spec.periods, first, spec.every, threads, interrupt,
            np.nan_to_num(events),
        )  # fmt: skip
    return results
