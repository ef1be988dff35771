"""`KernelJob`: points over the threads and their lanes; the `Search` for destinations.

All lanes take a step as if there were no stop, and lanes that may have met it are corrected. A lane
whose record is complete takes the next point. Each thread does so until there are no more points,
without holding Python's global lock:

- ``run_on_threads``: starts the threads, and gives each its memory. From here on nothing is
  allocated, so references to arrays need not be counted.
- ``loop_of`` of ``lane.py``: the work of one thread, its lanes from point to point, compiled for
  one rule, without or with exponents or extremes.
- ``take_exact_steps`` or ``take_strides``: one forcing period.

Where the motions go is found from their records afterwards, by ``find_on_threads``: only a run that
asks for classes compiles it.
"""

from __future__ import annotations

from functools import cache, partial
from typing import NamedTuple

import numpy as np

from vibroimpact.destination.judge import (
    NO_DESTINATION,
    Memory,
    Motion,
    find_exact,
    find_repetition,
    is_resolved,
)
from vibroimpact.destination.repetition import MOST_REPETITIONS, rests_alike_exactly
from vibroimpact.destination.section_map import MOST_SECTIONS
from vibroimpact.jit import claim, compiled, is_set, jit, on_threads, specialised, translate
from vibroimpact.kernel.exact_impacts import EXACT_COLUMNS
from vibroimpact.kernel.lane import loop_of
from vibroimpact.kernel.record import SUMS, Record
from vibroimpact.kernel.reduced_step_impacts import REDUCED_STEP_COLUMNS
from vibroimpact.kernel.workspace import COLUMNS, KEPT, LANES, LANES_SIZE, ROW, VECTOR, Workspace
from vibroimpact.oscillator import POINT
from vibroimpact.step.contact import new_scratch
from vibroimpact.step.scheme import EXACT, PLAIN, PhaseGrid, Scheme

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


class Search(NamedTuple):
    """The motions whose destinations the threads find."""

    points: np.ndarray  #: Of dtype ``POINT``, shape (n,).
    sections: np.ndarray  #: Of their records, which are complete.
    sums: np.ndarray
    scheme: Scheme
    destinations: np.ndarray  #: Receives where each motion goes; of dtype ``DESTINATION``.
    claimed: np.ndarray  #: As in a ``KernelJob``.
    interrupt: np.ndarray


def lanes_per_thread(points: int, threads: int) -> int:
    """Return how many points a thread takes side by side, so that every thread has some."""
    share = max(1, -(-points // threads))
    return min(LANES, max(FEWEST_LANES, -(-share // VECTOR) * VECTOR))


def aligned(size: int) -> np.ndarray:
    """Return an array of `size` zeros that begins at a cache line."""
    # A vector of 512 bits across two lines is read twice. Lanes without a point are computed, too,
    # and with subnormal numbers, as memory may hold, ten times as slowly.
    memory = np.zeros(size + 7)
    skipped = -(memory.ctypes.data // 8) % 8
    return memory[skipped : skipped + size]


def new_workspace(columns: int) -> Workspace:
    """Return the workspace of a thread; `columns` is the number of values in its columns."""
    return Workspace(
        lanes=aligned(LANES_SIZE),
        met=np.zeros(LANES, np.int64),
        columns=aligned(columns),
        turning=np.zeros(COLUMNS + 1, np.int64),
        turns=aligned(columns),
        added=aligned(2 * KEPT * ROW).reshape((KEPT, 2, ROW)),
        scratch=new_scratch.py_func(),  # compiled code calls it, too
        rows=np.zeros(LANES, np.int64),
        points=np.empty(LANES, POINT),
        sums=np.empty(LANES, SUMS),
        sums_at_mark=np.empty(LANES, SUMS),
    )


#: Returns a workspace of which only the type is read.
_typical_workspace = cache(partial(new_workspace, 0))

#: The numbers in the columns of a rule.
_COLUMNS = {PLAIN: 0, EXACT: EXACT_COLUMNS}


def run_on_threads(threads: int, job: KernelJob) -> None:
    """Run every point, on `threads` threads or as many as have lanes."""
    rule = job.scheme.method[0]
    columns = _COLUMNS.get(rule, REDUCED_STEP_COLUMNS)
    constants = {"exactly": rule == EXACT, "plain": rule == PLAIN, "exponents": job.lyapunov}
    loop = loop_of(**constants, watching=job.record.extremes.size > 0)
    work = compiled(loop, _typical_workspace(), job)
    # To start a thread takes longer than a few lanes.
    threads = min(threads, max(1, -(-job.points.size // job.lanes)))
    on_threads(threads, job.interrupt, lambda: work(new_workspace(columns), job))


@specialised
def find_all(search, memory, find):
    """Find where motion after motion goes, until the threads have taken all of them."""
    row = claim(search.claimed)
    while row < search.points.size and not is_set(search.interrupt):
        if is_resolved(search.sums[row]):
            motion = Motion(
                search.points[row], search.sections[row], search.sums[row], search.scheme, memory
            )
            find(motion, search.destinations[row])
        row = claim(search.claimed)


@jit
def find_all_exact(search, memory):
    """Find destinations for the rule ``exact``."""
    find_all(search, memory, find_exact)


@jit
def find_all_repetitions(search, memory):
    """Find destinations for a rule of time stepping."""
    find_all(search, memory, find_repetition)


def find_on_threads(
    points: np.ndarray,
    scheme: Scheme,
    sections: np.ndarray,
    sums: np.ndarray,
    threads: int,
    interrupt: np.ndarray,
) -> np.ndarray:
    """Find where every motion of a record goes; returns dtype ``DESTINATION``, (n,)."""
    destinations, claimed = np.full(points.size, NO_DESTINATION), np.zeros(1, np.int64)
    search = Search(points, sections, sums, scheme, destinations, claimed, interrupt)
    find = find_all_exact if scheme.method[0] == EXACT else find_all_repetitions
    work = compiled(find, search, _new_memory())
    threads = min(threads, max(1, -(-points.size // FEWEST_LANES)))
    on_threads(threads, interrupt, lambda: work(search, _new_memory()))
    return destinations


def _new_memory() -> Memory:
    """Return the memory of a thread that finds destinations."""
    passed, tried = np.zeros((MOST_SECTIONS, 2)), np.zeros(MOST_REPETITIONS, np.int64)
    beside = np.empty(1, POINT)
    return Memory(new_scratch.py_func(), passed, tried, beside)  # compiled code calls it, too


def compile_search(*, begin: bool = False) -> None:
    """Compile the search for destinations with the rule ``exact``, for a run that begins.

    If only to `begin`, translate what its loop contains, too: a step of a point alone.
    """
    points, sums, memory = np.zeros(1, POINT), np.empty(1, SUMS), _new_memory()
    scheme = Scheme((EXACT, EXACT), PhaseGrid(np.empty((3, 2)), 0.0, 1))
    sections, flag = np.empty((1, 1, 2)), np.zeros(1, np.int64)
    if begin:
        translate(rests_alike_exactly, Motion(points[0], sections[0], sums[0], scheme, memory), 1)
        return
    destinations = np.full(1, NO_DESTINATION)
    search = Search(points, sections, sums, scheme, destinations, flag, flag)
    compiled(find_all_exact, search, memory)
