"""The run of the kernel: batches of points over the threads, period by period.

All lanes of a batch take a step as if there were no stop, and lanes that may have met it are
corrected. Each thread takes batch after batch, without holding Python's global lock:

- ``run_batches``: starts the threads.
- ``take_exact``, ``take_plain``, ``take_shortened``: the work of one thread, compiled for one rule.
  It allocates the workspace.
- ``run_exact`` and so on of ``batch.py``: one batch, from its start to the end of the record. From
  here on nothing is allocated, so references to arrays need not be counted.
- ``take_exact_steps`` or ``take_strides``: one forcing period.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.destination.find import find_repetitions, find_with_exact_impacts
from vibroimpact.destination.repetition import TRIED
from vibroimpact.destination.section_map import MOST_SECTIONS
from vibroimpact.jit import claim, compiled, inlined, is_set, jit, on_threads
from vibroimpact.kernel.batch import run_exact, run_plain, run_shortened
from vibroimpact.kernel.exact_impacts import EXACT_COLUMNS
from vibroimpact.kernel.record import Record, rows_of
from vibroimpact.kernel.reduced_step_impacts import REDUCED_STEP_COLUMNS
from vibroimpact.kernel.workspace import (
    KEPT,
    LANES,
    LANES_SIZE,
    ROW,
    VECTOR,
    Batch,
    Workspace,
)
from vibroimpact.status import Status
from vibroimpact.step.contact import new_scratch
from vibroimpact.step.scheme import EXACT, PLAIN, Scheme

_PENDING = int(Status.PENDING)

#: Fewest points that a thread takes side by side, if there are so many. With exact impacts, fewer
#: points take nearly as long.
FEWEST_LANES = 64


class KernelJob(NamedTuple):
    """The data that the threads share."""

    points: np.ndarray  #: Of dtype ``POINT``, shape (n,).
    scheme: Scheme
    transient: int  #: Periods left out.
    periods: int  #: Periods recorded.
    lyapunov: bool
    lanes: int  #: Points in a batch.
    record: Record  #: Receives the results.
    claimed: np.ndarray  #: Number of batches taken by the threads so far, shape (1,).
    interrupt: np.ndarray  #: Once it is set, the remaining points become ``PENDING``. Shape (1,).
    #: Receives where every motion goes, see ``destination``; empty if that is not asked for.
    found: np.ndarray
    only_find: bool  #: Whether `record` is complete, and only the destinations are missing.


def lanes_per_batch(points: int, threads: int) -> int:
    """Return how many points to take side by side so that threads get equal shares."""
    share = max(1, -(-points // threads))
    batches = -(-share // LANES)  # the same number for every thread
    return max(FEWEST_LANES, -(-share // (batches * VECTOR)) * VECTOR)


@jit
def aligned(size):
    """Return an array of `size` zeros that begins at a cache line.

    A vector of 512 bits across two lines would be read twice. The memory is set to zero because
    lanes without a point are computed, too: left-over bits may be subnormal numbers, with which a
    processor takes ten times as long.
    """
    memory = np.zeros(size + 7)
    skipped = -(memory.ctypes.data // 8) % 8
    return memory[skipped : skipped + size]


@jit
def new_workspace(columns):
    """Return the workspace of a thread; `columns` is the number of values in its columns."""
    met = np.zeros(LANES, np.int64)
    added = aligned(2 * KEPT * ROW).reshape((KEPT, 2, ROW))
    return Workspace(aligned(LANES_SIZE), met, aligned(columns), added, new_scratch())


@jit
def put_in_order(ring, count):
    """Put a ring buffer that received `count` impacts into time order, with NaN in unused rows."""
    size = ring.shape[0]
    for k in range(count, size):
        ring[k, 0] = ring[k, 1] = math.nan
    if count > size:
        kept = ring.copy()
        for k in range(size):
            slot = (count + k) % size
            ring[k, 0], ring[k, 1] = kept[slot, 0], kept[slot, 1]


@jit
def close_records(record, given_up):
    """Put the impacts of every point in order; points that were interrupted are ``PENDING``."""
    for i in range(record.sums.size):
        put_in_order(record.impacts[i], record.sums[i].impacts)
        if given_up:
            record.sums[i].status = _PENDING


@inlined
def take_batches(job, run, find, columns):
    """Run batch after batch until the threads have taken all of them."""
    workspace, lanes = new_workspace(columns), job.lanes
    # The memory in which destinations are found.
    memory = workspace.scratch, np.zeros((MOST_SECTIONS, 2)), np.zeros(TRIED, np.int64)
    lo = lanes * claim(job.claimed)
    while lo < job.points.size:  # terminates: the counter only rises
        record = rows_of(job.record, lo, lo + lanes)
        points = job.points[lo : lo + lanes]
        if not job.only_find:
            run(Batch(workspace, points, record), job)
            close_records(record, is_set(job.interrupt))
        if job.found.size > 0:
            find(points, record, job.scheme.grid, memory, job.found[lo : lo + lanes])
        lo = lanes * claim(job.claimed)


@jit
def take_exact(job):
    """Do the work of one thread with the rule ``exact``."""
    take_batches(job, run_exact, find_with_exact_impacts, EXACT_COLUMNS)


@jit
def take_plain(job):
    """Do the work of one thread with the rule ``plain``."""
    take_batches(job, run_plain, find_repetitions, 0)


@jit
def take_shortened(job):
    """Do the work of one thread with the rules ``reduced-step`` and ``cubic``."""
    take_batches(job, run_shortened, find_repetitions, REDUCED_STEP_COLUMNS)


def run_batches(threads: int, job: KernelJob) -> None:
    """Run every point, on `threads` threads."""
    loops = {PLAIN: take_plain, EXACT: take_exact}
    work = compiled(loops.get(job.scheme.method[0], take_shortened), job)
    on_threads(threads, job.interrupt, work, job)
