"""The points of a block through the kernel: a configuration in, the variables of the file out.

This only passes on what `vibroimpact.points` is given and returns: that package alone determines
the numbers of a file, and names itself in it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from sweeps.config.sweep import SweepConfig
from sweeps.grid import Block
from sweeps.interrupts import check, thread_flag
from vibroimpact.jit import NUMERICS, name_of
from vibroimpact.points.compute import compute_box, compute_points

#: The variables of the file by name, of shape (points, ...).
Results = Mapping[str, np.ndarray]


def numerics(config: SweepConfig) -> str:
    """Name the code that determines the data of a sweep.

    That code is all of `vibroimpact`, whose results the engine only passes on; of a refined sweep
    also the refinement and the analysis, which decide which points there are and what is said of
    them.
    """
    if config.refine is None:
        return NUMERICS
    package = Path(__file__).parents[1]
    sources = [package / "engine" / "refine.py", *sorted((package / "analysis").glob("*.py"))]
    code = {path.relative_to(package).as_posix(): path.read_bytes() for path in sources}
    return name_of(code, NUMERICS)


def compute_block(
    config: SweepConfig,
    block: Block,
    threads: int | None,
    advance: Callable[[int], object] = lambda points: None,
) -> dict[str, np.ndarray]:
    """Compute a block of the file of a sweep, shapes (points of the block, ...), in C order.

    If an axis is followed up and down, a slice over the directions comes before those over the
    axes. `advance` is given how many points were computed since it was called before: along an axis
    that is followed after every value, otherwise once. The results do not depend on the threads,
    None for all.
    """
    grid = config.grid
    values = grid.within(block[len(block) - len(grid.axes) :])

    def unless_cancelled(points: int) -> None:
        check()
        advance(points)

    return compute_box(config.spec, values, grid.fixed, threads, unless_cancelled, thread_flag())


def compute(
    config: SweepConfig, points: np.ndarray, threads: int | None, *, at_section: bool = False
) -> dict[str, np.ndarray]:
    """Compute parameter points, each from its own start; see `vibroimpact.points`.

    With `at_section`, x0 and v0 are the state at the section's phase, not at t = 0.
    """
    results = compute_points(
        config.spec, points, threads, at_section=at_section, interrupt=thread_flag()
    )
    check()
    return results
