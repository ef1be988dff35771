"""Computing points: a sweep in, the variables of the file out.

The functions only call `vibroimpact.points`, which alone determines the numbers in a file; the file
records the version of that code.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from sweeps.config.sweep import SweepConfig
from sweeps.grid import Block, Sweep
from sweeps.interrupts import check, thread_flag
from vibroimpact.jit import NUMERICS, name_of
from vibroimpact.points.compute import compute_box, compute_points
from vibroimpact.points.run_spec import RunSpec

#: The variables of the file by name, of shape (points, ...).
Results = Mapping[str, np.ndarray]


def numerics(config: SweepConfig) -> str:
    """Return a digest of the code that determines the data of a sweep.

    This code is the package `vibroimpact`. For a refined sweep it includes the refinement and the
    analysis, which decide where points are added and which class is recorded for them.
    """
    if config.refine is None:
        return NUMERICS
    package = Path(__file__).parents[1]
    sources = [package / "engine" / "refine.py", *sorted((package / "analysis").glob("*.py"))]
    code = {path.relative_to(package).as_posix(): path.read_bytes() for path in sources}
    return name_of(code, NUMERICS)


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


def compute(
    spec: RunSpec, points: np.ndarray, threads: int | None, *, at_section: bool = False
) -> dict[str, np.ndarray]:
    """Compute parameter points, each from its own start; see `vibroimpact.points`.

    With `at_section`, x0 and v0 are the state at the phase of the section, not at t = 0.
    """
    results = compute_points(spec, points, threads, at_section=at_section, interrupt=thread_flag())
    check()
    return results
