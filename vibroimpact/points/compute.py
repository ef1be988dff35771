"""Points through the kernel: a specification and parameter values in, named results out."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from vibroimpact.kernel.integrate import integrate
from vibroimpact.oscillator import mesh
from vibroimpact.points.following import follow
from vibroimpact.points.period_class import period_class
from vibroimpact.points.run_spec import RunSpec
from vibroimpact.points.scaling import computed_once
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
    ``trajectory_t``, ``trajectory_x``, ``trajectory_v``, ``period`` and ``period_impacts`` are
    added where `spec` asks for them.
    """
    points = mesh(axes, fixed)
    if spec.followed is None:
        results = compute_points(spec, points, threads, interrupt=interrupt)
        advance(points.size)
        return results

    def run(points: np.ndarray, at_section: bool) -> dict[str, np.ndarray]:
        return _run(spec, points, threads, at_section, interrupt)

    box = points.reshape(tuple(map(len, axes.values())))
    along = list(axes).index(spec.followed)
    results = follow(box, along, spec.followed, spec.directions, run, advance)
    return _classified(spec, np.tile(points, len(spec.directions)), results)


def compute_points(
    spec: RunSpec,
    points: np.ndarray,
    threads: int | None,
    *,
    at_section: bool = False,
    interrupt: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """Compute `points` of shape (n,), each from its own start; results as of `compute_box`.

    With `at_section` x0 and v0 are the state at the phase of the section, not at t = 0. The results
    are then not those of a start at rest, and nothing is scaled.
    """

    def run(points: np.ndarray) -> dict[str, np.ndarray]:
        return _classified(spec, points, _run(spec, points, threads, at_section, interrupt))

    return computed_once(points, run) if spec.scaled and not at_section else run(points)


def _classified(
    spec: RunSpec, points: np.ndarray, results: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Add the period class if `spec` asks for it."""
    if spec.period:
        names = ("poincare_x", "poincare_v", "impacts_per_period")
        classes = period_class(points, *(results[name] for name in names))
        results |= dict(zip(("period", "period_impacts"), classes, strict=True))
    return results


def _run(
    spec: RunSpec,
    points: np.ndarray,
    threads: int | None,
    at_section: bool,
    interrupt: np.ndarray | None,
) -> dict[str, np.ndarray]:
    """Compute points without scaling, following or period class."""
    results = integrate(
        points,
        integrator=spec.integrator,
        impact=spec.impact,
        steps_per_period=spec.steps_per_period,
        transient=spec.transient,
        periods=spec.periods,
        phase=spec.phase,
        at_section=at_section,
        impacts=spec.impacts,
        lyapunov=spec.lyapunov,
        threads=threads,
        interrupt=interrupt,
    )
    if spec.every is not None:
        scheme = scheme_of(
            points, spec.integrator, spec.impact, spec.steps_per_period, spec.phase, at_section
        )
        results |= trajectories(points, scheme, spec.periods, spec.transient, spec.every, interrupt)
    return results
