"""Points through the kernel: a computation and parameter values in, named results out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from vibroimpact.kernel.integrate import integrate
from vibroimpact.oscillator import mesh
from vibroimpact.points.following import follow
from vibroimpact.points.period_class import period_class
from vibroimpact.points.scaling import computed_once
from vibroimpact.step.grid import scheme_of
from vibroimpact.step.recorder import trajectories


@dataclass(frozen=True)
class Computation:
    """What is computed of every point of a sweep; plain values, equal where all results are.

    Attributes
    ----------
    integrator, impact, steps_per_period, transient, periods, phase, impacts, lyapunov
        As for `vibroimpact.integrate`.
    period : bool
        Whether to find the period class.
    every : int or None
        Record the trajectory at so many steps; None for no trajectory.
    scaled : bool
        Whether points that differ in f alone are computed once, see ``scaling.py``.
    followed : str or None
        The axis along which each point starts from its neighbour, see ``following.py``.
    directions : tuple of str
        In which it is followed: ``up``, ``down`` or both.
    """

    integrator: str
    impact: str
    steps_per_period: int
    transient: int
    periods: int
    phase: float
    impacts: int
    lyapunov: bool
    period: bool
    every: int | None
    scaled: bool
    followed: str | None
    directions: tuple[str, ...]


def compute_box(
    computation: Computation,
    axes: Mapping[str, np.ndarray],
    fixed: Mapping[str, float],
    threads: int | None,
    advance: Callable[[int], object],
    interrupt: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """Compute the points of a box.

    Parameters
    ----------
    computation : Computation
    axes : mapping of str to ndarray
        The values of the box along each axis, slowest first; all of them of a followed axis.
    fixed : mapping of str to float
        The value of every other parameter.
    threads : int or None
        Threads to use, None for all. The results do not depend on it.
    advance : callable
        Is given the number of points computed since its last call: after every value of an axis
        that is followed, otherwise once.
    interrupt : ndarray of int64, shape (1,), optional
        As for `vibroimpact.integrate`.

    Returns
    -------
    dict of str to ndarray
        Arrays of shape (points, ...), in C order; of two directions one after the other. The names
        are those of `vibroimpact.integrate`, with ``trajectory_t``, ``trajectory_x``,
        ``trajectory_v``, ``period`` and ``period_impacts`` where they are asked for.
    """
    points = mesh(axes, fixed)
    if computation.followed is None:
        results = compute_points(computation, points, threads, interrupt=interrupt)
        advance(points.size)
        return results

    def run(points: np.ndarray, at_section: bool) -> dict[str, np.ndarray]:
        return _run(computation, points, threads, at_section, interrupt)

    box = points.reshape(tuple(map(len, axes.values())))
    along = list(axes).index(computation.followed)
    directions = computation.directions
    return _classified(
        computation, follow(box, along, computation.followed, directions, run, advance)
    )


def compute_points(
    computation: Computation,
    points: np.ndarray,
    threads: int | None,
    *,
    at_section: bool = False,
    interrupt: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """Compute points, each from its own start; arguments and results as of `compute_box`.

    Parameters
    ----------
    points : ndarray of dtype ``POINT``, shape (n,)
    at_section : bool
        Whether x0 and v0 are the state at the section's phase, not at t = 0. Then the results
        are not those of a start at rest, and nothing is scaled.
    """

    def run(points: np.ndarray) -> dict[str, np.ndarray]:
        return _classified(computation, _run(computation, points, threads, at_section, interrupt))

    return computed_once(points, run) if computation.scaled and not at_section else run(points)


def _classified(computation: Computation, results: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Add the period class, if it is asked for."""
    if computation.period:
        classes = period_class(
            results["poincare_x"], results["poincare_v"], results["impacts_per_period"]
        )
        results |= dict(zip(("period", "period_impacts"), classes, strict=True))
    return results


def _run(
    computation: Computation,
    points: np.ndarray,
    threads: int | None,
    at_section: bool,
    interrupt: np.ndarray | None,
) -> dict[str, np.ndarray]:
    """Compute points as they are: no scaling, no following and no period class."""
    c = computation
    results = integrate(
        points,
        integrator=c.integrator,
        impact=c.impact,
        steps_per_period=c.steps_per_period,
        transient=c.transient,
        periods=c.periods,
        phase=c.phase,
        at_section=at_section,
        impacts=c.impacts,
        lyapunov=c.lyapunov,
        threads=threads,
        interrupt=interrupt,
    )
    if c.every is not None:
        scheme = scheme_of(points, c.integrator, c.impact, c.steps_per_period, c.phase, at_section)
        results |= trajectories(points, scheme, c.periods, c.transient, c.every, interrupt)
    return results
