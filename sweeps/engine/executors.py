"""Computes a block or all points of a sweep; hands blocks out to a thread or Dask.

The main thread only waits for results and writes them, so it reacts to Ctrl-C and SIGTERM at once.
`vibroimpact.points` alone determines the numbers in a file, which records the version of that code.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Any, TypeVar

import numpy as np

from sweeps.grid import Block, Sweep, box_shape
from sweeps.interrupts import check, this_thread
from vibroimpact.jit import ALL_THREADS, called_before_passes
from vibroimpact.kernel.threads import FEWEST_LANES
from vibroimpact.points.computation import compute_chains, compute_points
from vibroimpact.points.stages import Results, RunSpec

Value = TypeVar("Value")
#: Interval of the checks for signals [s]: a signal caught by another thread does not wake the main.
_WAIT = 0.1


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
    block = block[len(block) - len(grid.axes) :]
    points = grid.points(block)
    if spec.followed is None:
        results = compute(spec, points, threads)
        advance(points.size)
        return results

    def unless_cancelled(points: int) -> None:
        check()
        advance(points)

    box, along = points.reshape(box_shape(block)), list(grid.axes).index(spec.followed)
    results = compute_chains(spec, box, along, threads, unless_cancelled, this_thread.flag)
    check()  # the classes of the last points may be missing
    return results


def compute(spec: RunSpec, points: np.ndarray, threads: int | None) -> dict[str, np.ndarray]:
    """Compute parameter points, each from its own start; see `vibroimpact.points`."""
    results = compute_points(spec, points, threads, interrupt=this_thread.flag)
    check()
    return results


def compute_all(sweep: Sweep) -> Results:
    """Compute all points of a sweep together, with the same results as a run."""
    return compute(sweep.spec, sweep.grid.points(), None)


@contextmanager
def other_thread() -> Iterator[ThreadPoolExecutor]:
    """Yield an executor of one thread, whose work ends with `Cancelled` at the end of the block."""
    cancelled = np.zeros(1, np.int64)
    executor = ThreadPoolExecutor(1, initializer=setattr, initargs=(this_thread, "flag", cancelled))
    with executor, called_before_passes(check):  # a pass takes 3 s at most
        try:
            yield executor
        finally:
            cancelled[0] = 1
            executor.shutdown(cancel_futures=True)


def in_thread(function: Callable[..., Value], *arguments: Any) -> Value:
    """Call a function in another thread, and check for signals while waiting for its result."""
    with other_thread() as executor:
        future = executor.submit(function, *arguments)
        while not wait([future], _WAIT).done:
            check()
        return future.result()


def submit_blocks(
    submit: Callable[[Block], Future[Results]], blocks: Iterable[Block], most: Callable[[], int]
) -> Iterator[tuple[Block, Future[Results]]]:
    """Submit blocks, with at most `most` of them pending at a time, and yield each when done."""
    remaining, out = iter(blocks), dict[Future[Results], Block]()
    while True:
        for block in islice(remaining, max(0, most() - len(out))):
            out[submit(block)] = block
        if not out:
            return
        wait(out, _WAIT, FIRST_COMPLETED)
        check()
        if done := next((future for future in out if future.done()), None):
            yield out.pop(done), done


@dataclass
class LocalComputer:
    """Computes blocks one after the other on this machine; ``threads=None`` uses all cores."""

    threads: int | None = None  #: Of a trial, too.
    cores = 1  #: How many trials would run at once.

    def place_text(self) -> str:
        """Return nothing: the work is done here."""
        return ""

    def block_limits(self, seconds: float, size: int) -> Mapping[str, int]:
        """Return limits that give every thread points."""
        return {"least": min(size, FEWEST_LANES * (self.threads or ALL_THREADS))}

    def compute_blocks(
        self, sweep: Sweep, blocks: Iterable[Block], advance: Callable[[int], object]
    ) -> Generator[tuple[Block, Results], None, None]:
        """Yield the blocks in order, one computed while another is written; close the generator."""
        with other_thread() as executor:

            def submit(block: Block) -> Future[Results]:
                return executor.submit(compute_block, sweep, block, self.threads, advance)

            for block, future in submit_blocks(submit, blocks, lambda: 2):
                yield block, future.result()
