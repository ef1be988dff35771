"""Computing a block: the points of a sweep in, the variables of the file out.

The functions only call `vibroimpact.points`, which alone determines the numbers in a file; the file
records the version of that code.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from sweeps.grid import Block, Sweep
from sweeps.interrupts import check, thread_flag
from vibroimpact.points.computation import compute_box, compute_points
from vibroimpact.points.run_spec import RunSpec

#: The variables of the file by name, of shape (points, ...).
Results = Mapping[str, np.ndarray]


def compute_block(
    sweep: Sweep,
    block: Block,
    threads: int | None,
    advance: Callable[[int], object] = lambda points: None,
) -> dict[str, np.ndarray]:
    """Compute a block of a sweep; results have the shape (points of the block, ...), in C order.

    If an axis is followed up and down, the block starts with a slice over the directions.
    `advance` is called with the number of points computed since its last call: after every value of
    a followed axis, otherwise once. `threads` is None for all; the results do not depend on it.
    """
    grid, spec = sweep.grid, sweep.spec
    values = grid.within(block[len(block) - len(grid.axes) :])

    def unless_cancelled(points: int) -> None:
        check()
        advance(points)

    results = compute_box(spec, values, grid.fixed, threads, unless_cancelled, thread_flag())
    check()  # the classes of the last points may be missing
    return results


def compute(spec: RunSpec, points: np.ndarray, threads: int | None) -> dict[str, np.ndarray]:
    """Compute parameter points, each from its own start; see `vibroimpact.points`."""
    results = compute_points(spec, points, threads, interrupt=thread_flag())
    check()
    return results
