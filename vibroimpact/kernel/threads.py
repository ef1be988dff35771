"""The run of the kernel: points over the threads and their lanes, period by period.

All lanes take a step as if there were no stop, and lanes that may have met it are corrected. A lane
whose record is complete takes the next point. Each thread does so until there are no more points,
without holding Python's global lock:

- ``run_on_threads``: starts the threads, and gives each its memory. From here on nothing is
  allocated, so references to arrays need not be counted.
- ``take_exact``, ``take_plain``, ``take_shortened``: the work of one thread, compiled for one rule.
- ``run_exact`` and so on of ``loop.py``: its lanes, from point to point.
- ``take_exact_steps`` or ``take_strides``: one forcing period.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibroimpact.destination.find import Memory, find_exact, find_repetition
from vibroimpact.destination.repetition import MOST_REPETITIONS
from vibroimpact.destination.section_map import MOST_SECTIONS
from vibroimpact.jit import claim, compiled, jit, on_threads, specialised
from vibroimpact.kernel.exact_impacts import EXACT_COLUMNS
from vibroimpact.kernel.loop import find_destination, run_exact, run_plain, run_shortened
from vibroimpact.kernel.record import SUMS, Record
from vibroimpact.kernel.reduced_step_impacts import REDUCED_STEP_COLUMNS
from vibroimpact.kernel.workspace import KEPT, LANES, LANES_SIZE, ROW, VECTOR, Workspace
from vibroimpact.oscillator import POINT
from vibroimpact.step.contact import new_scratch
from vibroimpact.step.scheme import EXACT, PLAIN, Scheme

#: Fewest lanes of a thread, if there are so many points. With exact impacts, fewer points take
#: nearly as long.
FEWEST_LANES = 64


class KernelJob(NamedTuple):
    """The data that the threads share."""

    points: np.ndarray  #: Of dtype ``POINT``, shape (n,).
    scheme: Scheme
    transient: int  #: Periods left out.
    periods: int  #: Periods recorded.
    lyapunov: bool
    lanes: int  #: Lanes of a thread.
    record: Record  #: Receives the results; a point that is not complete keeps its status.
    claimed: np.ndarray  #: Number of points taken by the threads so far, shape (1,).
    interrupt: np.ndarray  #: Once it is set, the run ends within a forcing period. Shape (1,).
    #: Receives where every motion goes, see ``destination``; empty if that is not asked for.
    found: np.ndarray
    only_find: bool  #: Whether `record` is complete, and only the destinations are missing.


def lanes_per_thread(points: int, threads: int) -> int:
    """Return how many points a thread takes side by side, so that every thread has some."""
    share = max(1, -(-points // threads))
    return min(LANES, max(FEWEST_LANES, -(-share // VECTOR) * VECTOR))


def aligned(size: int) -> np.ndarray:
    """Return an array of `size` zeros that begins at a cache line.

    A vector of 512 bits across two lines would be read twice. The memory is set to zero because
    lanes without a point are computed, too: left-over bits may be subnormal numbers, with which a
    processor takes ten times as long.
    """
    memory = np.zeros(size + 7)
    skipped = -(memory.ctypes.data // 8) % 8
    return memory[skipped : skipped + size]


def new_workspace(columns: int) -> Workspace:
    """Return the workspace of a thread; `columns` is the number of values in its columns."""
    return Workspace(
        lanes=aligned(LANES_SIZE),
        met=np.zeros(LANES, np.int64),
        columns=aligned(columns),
        added=aligned(2 * KEPT * ROW).reshape((KEPT, 2, ROW)),
        scratch=new_scratch.py_func(),  # compiled code calls it, too
        rows=np.zeros(LANES, np.int64),
        points=np.empty(LANES, POINT),
        sums=np.empty(LANES, SUMS),
        sums_at_mark=np.empty(LANES, SUMS),
    )


@specialised
def take_points(job, workspace, memory, run, find):
    """Run point after point, or only find where their motions go."""
    if not job.only_find:
        run(workspace, job, memory)
        return
    row = claim(job.claimed)
    while row < job.points.size:  # terminates: the counter only rises
        find_destination(job, row, find, memory)
        row = claim(job.claimed)


@jit
def take_exact(job, workspace, memory):
    """Do the work of one thread with the rule ``exact``."""
    take_points(job, workspace, memory, run_exact, find_exact)


@jit
def take_plain(job, workspace, memory):
    """Do the work of one thread with the rule ``plain``."""
    take_points(job, workspace, memory, run_plain, find_repetition)


@jit
def take_shortened(job, workspace, memory):
    """Do the work of one thread with the rules ``reduced-step`` and ``cubic``."""
    take_points(job, workspace, memory, run_shortened, find_repetition)


def run_on_threads(threads: int, job: KernelJob) -> None:
    """Run every point, on `threads` threads or as many as have lanes.

    To start a thread takes longer than a few lanes.
    """
    loops = {PLAIN: (take_plain, 0), EXACT: (take_exact, EXACT_COLUMNS)}
    loop, columns = loops.get(job.scheme.method[0], (take_shortened, REDUCED_STEP_COLUMNS))

    def memory_of_thread() -> tuple[Workspace, Memory]:
        workspace = new_workspace(columns)
        sections, tried = np.zeros((MOST_SECTIONS, 2)), np.zeros(MOST_REPETITIONS, np.int64)
        return workspace, Memory(workspace.scratch, sections, tried)

    work = compiled(loop, job, *memory_of_thread())
    threads = min(threads, max(1, -(-job.points.size // job.lanes)))
    on_threads(threads, job.interrupt, lambda: work(job, *memory_of_thread()))
