"""The points of a block through the kernel: a configuration in, the variables of the file out."""

from __future__ import annotations

from typing import Any

import numpy as np

from sweeps.config import SweepConfig
from sweeps.grid import Block
from sweeps.scaling import computed_once, scales_with_f
from vibroimpact.attractors import integrate
from vibroimpact.diagnostics import period_class
from vibroimpact.trajectory import trajectories


def compute(config: SweepConfig, points: np.ndarray, threads: int | None) -> dict[str, np.ndarray]:
    """Run parameter points as a configuration says; the names of the results are the store's.

    Parameters
    ----------
    config : SweepConfig
    points : ndarray of dtype ``POINT``, shape (n,)
    threads : int or None
        Threads to use, None for all. The results do not depend on it.

    Returns
    -------
    dict of str to ndarray
        Arrays of shape (n, ...). Where they scale with f, one f is computed.
    """
    if scales_with_f(config):
        return computed_once(points, lambda different: _compute(config, different, threads))
    return _compute(config, points, threads)


def compute_block(config: SweepConfig, block: Block, threads: int | None) -> dict[str, np.ndarray]:
    """Run the points of a block of the grid; as `compute` otherwise."""
    return compute(config, config.grid.points(block), threads)


def _compute(config: SweepConfig, points: np.ndarray, threads: int | None) -> dict[str, np.ndarray]:
    method, record = config.method, config.record
    common: dict[str, Any] = {
        "integrator": method.integrator,
        "impact": method.impact,
        "steps_per_period": config.steps,
        "transient": record.transient,
        "periods": record.periods,
        "phase": record.phase,
    }
    results = integrate(
        points,
        impacts=record.impacts,
        lyapunov="lyapunov" in record.diagnostics,
        threads=threads,
        **common,
    )
    if "period" in record.diagnostics:
        found = period_class(
            results["poincare_x"], results["poincare_v"], results["impacts_per_period"]
        )
        results |= dict(zip(("period", "period_impacts"), found, strict=True))
    if record.trajectory:
        results |= trajectories(points, every=record.trajectory.every, **common)
    return results
