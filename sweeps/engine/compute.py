"""The points of a block through the kernel: a configuration in, the variables of the file out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from sweeps.config.sweep import SweepConfig
from sweeps.engine.background import check_given_up, interrupt
from sweeps.engine.follow import follow
from sweeps.engine.scaling import computed_once, scales_with_f
from sweeps.grid import Block, block_points
from vibroimpact.integrate import integrate
from vibroimpact.orbits.period_class import period_class
from vibroimpact.trajectory import trajectories


def compute_block(
    config: SweepConfig,
    block: Block,
    threads: int | None,
    advance: Callable[[int], object] | None = None,
) -> dict[str, np.ndarray]:
    """Compute a block of the file of a sweep; the names of the results are the store's.

    Parameters
    ----------
    config : SweepConfig
    block : Block
        One of the file's: with a slice over the directions before those over the axes, where an
        axis is followed up and down.
    threads : int or None
        Threads to use, None for all. The results do not depend on it.
    advance : callable, optional
        Told how many points were computed since it was called before: along an axis that is
        followed after every value, otherwise once.

    Returns
    -------
    dict of str to ndarray
        Arrays of shape (points of the block, ...), in C order.
    """
    told = advance or (lambda points: None)
    if config.follow is not None:

        def run(points: np.ndarray, at_section: bool) -> dict[str, np.ndarray]:
            return _run(config, points, threads, at_section)

        cut = block[len(block) - len(config.grid.axes) :]
        return _classified(config, follow(config, cut, run, told))
    results = compute(config, config.grid.points(block), threads)
    told(block_points(block))
    return results


def compute(
    config: SweepConfig, points: np.ndarray, threads: int | None, *, at_section: bool = False
) -> dict[str, np.ndarray]:
    """Run parameter points, each from its own start; arguments and results as of `compute_block`.

    Parameters
    ----------
    points : ndarray of dtype ``POINT``, shape (n,)
    at_section : bool
        Whether x0 and v0 are the state at the section's phase, not at t = 0.

    Returns
    -------
    dict of str to ndarray
        Arrays of shape (n, ...). Where they scale with f, as from rest, one f is computed.
    """
    if scales_with_f(config) and not at_section:
        return computed_once(points, lambda different: _compute(config, different, threads))
    return _compute(config, points, threads, at_section)


def _compute(
    config: SweepConfig, points: np.ndarray, threads: int | None, at_section: bool = False
) -> dict[str, np.ndarray]:
    return _classified(config, _run(config, points, threads, at_section))


def _classified(config: SweepConfig, results: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Add the period class, if it is asked for."""
    if "period" in config.record.diagnostics:
        found = period_class(
            results["poincare_x"], results["poincare_v"], results["impacts_per_period"]
        )
        results |= dict(zip(("period", "period_impacts"), found, strict=True))
    return results


def _run(
    config: SweepConfig, points: np.ndarray, threads: int | None, at_section: bool = False
) -> dict[str, np.ndarray]:
    method, record = config.method, config.record
    common: dict[str, Any] = {
        "integrator": method.integrator,
        "impact": method.impact,
        "steps_per_period": config.steps,
        "transient": record.transient,
        "periods": record.periods,
        "phase": record.phase,
        "at_section": at_section,
        "interrupt": interrupt(),
    }
    results = integrate(
        points,
        impacts=record.impacts,
        lyapunov="lyapunov" in record.diagnostics,
        threads=threads,
        **common,
    )
    if record.trajectory:
        results |= trajectories(points, every=record.trajectory.every, **common)
    check_given_up()
    return results
