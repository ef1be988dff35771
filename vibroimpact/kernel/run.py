"""The run of the kernel: batches of points over the threads, period by period.

All lanes of a batch take a step as if there were no stop, and lanes that may have met it are
corrected. Each thread takes batch after batch, without holding Python's global lock:

- ``run_batches``: starts the threads.
- ``take_exact``, ``take_plain``, ``take_shortened``: the work of one thread, compiled for one rule.
  It allocates the workspace.
- ``run_exact`` and so on: one batch, from its start to the end of the record. From here on nothing
  is allocated, so references to arrays need not be counted.
- ``take_steps`` of ``exact.py`` or ``time_stepping.py``: one forcing period.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import claim, compiled, is_set, jit, on_threads
from vibroimpact.kernel import exact, time_stepping
from vibroimpact.kernel.exact_impacts import EXACT_COLUMNS
from vibroimpact.kernel.record import Record, close_records, record_section, rows_of
from vibroimpact.kernel.reduced_step_impacts import REDUCED_STEP_COLUMNS
from vibroimpact.kernel.workspace import (
    LANES,
    POSITION,
    ROW,
    SLEPT,
    VECTOR,
    VELOCITY,
    WAKE,
    Batch,
    new_workspace,
    set_start,
)
from vibroimpact.step.scheme import EXACT, PLAIN, Scheme, sine_at_start

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


def lanes_per_batch(points: int, threads: int) -> int:
    """Return how many points to take side by side so that threads get equal shares."""
    share = max(1, -(-points // threads))
    batches = -(-share // LANES)  # the same number for every thread
    return max(FEWEST_LANES, -(-share // (batches * VECTOR)) * VECTOR)


@jit(refcounts=False)
def end_period(batch, k, row, step):
    """Store the states as section `k` of the record; `row` is 0 or ROW, where the states lie."""
    workspace, points, record = batch
    lanes = workspace.lanes
    for i in range(LANES):
        lanes[WAKE + i] -= 2.0 * math.pi  # the phases of the grid begin again
    if k >= 0:
        for i in range(points.size):
            record_section(lanes[POSITION + row + i], lanes[VELOCITY + row + i], i, k, record)
            if lanes[SLEPT + i] > 0.0:
                record.sums[i].rested += lanes[SLEPT + i] * step / points[i].omega
                lanes[SLEPT + i] = 0.0


@jit(inline=True)
def run_batch(batch, job, exactly, plain):
    """Run a batch of at most ``LANES`` points from its start to the end of the record.

    `exactly` and `plain` say whether the rule is ``exact`` or ``plain``. They are literals, so only
    the loop of that rule is compiled.
    """
    workspace, points, _ = batch
    lanes, transient, (method, lead, grid) = workspace.lanes, job.transient, job.scheme
    set_start(lanes, points, method[0], sine_at_start(lead, grid))
    # The lead-in counts as the period before the transient, so `take_steps` is compiled only once.
    for k in range(-transient - 1, job.periods):
        if is_set(job.interrupt):
            break
        steps = lead if k < -transient else grid
        if exactly:
            if steps.size > 0 and k <= -transient:
                exact.set_propagators(workspace, points, steps)
            if k == 0:
                exact.forget_at_rest(lanes, points.size)
            exact.take_steps(batch, steps, k >= 0, k >= 0 and job.lyapunov)
            if k >= -transient:
                exact.round_states(lanes)
        else:
            if k <= -transient:
                time_stepping.set_maps(lanes, points, method[1], steps)
            time_stepping.take_steps(batch, method, plain, steps, k >= 0)
        if k >= -transient:
            end_period(batch, k, ROW if exactly else 0, steps.step)
    if exactly and job.lyapunov:
        exact.sum_up_tangents(batch)
    if plain:
        time_stepping.sum_up_plain(batch)


@jit(refcounts=False)
def run_exact(batch, job):
    """Run a batch with the rule ``exact``."""
    run_batch(batch, job, True, False)


@jit(refcounts=False)
def run_plain(batch, job):
    """Run a batch with the rule ``plain``."""
    run_batch(batch, job, False, True)


@jit(refcounts=False)
def run_shortened(batch, job):
    """Run a batch with the rule ``reduced-step`` or ``cubic``."""
    run_batch(batch, job, False, False)


@jit(inline=True)
def take_batches(job, run, columns):
    """Run batch after batch until the threads have taken all of them."""
    workspace, lanes = new_workspace(columns), job.lanes
    lo = lanes * claim(job.claimed)
    while lo < job.points.size:  # terminates: the counter only rises
        record = rows_of(job.record, lo, lo + lanes)
        run(Batch(workspace, job.points[lo : lo + lanes], record), job)
        close_records(record, is_set(job.interrupt))
        lo = lanes * claim(job.claimed)


@jit
def take_exact(job):
    """Do the work of one thread with the rule ``exact``."""
    take_batches(job, run_exact, EXACT_COLUMNS)


@jit
def take_plain(job):
    """Do the work of one thread with the rule ``plain``."""
    take_batches(job, run_plain, 0)


@jit
def take_shortened(job):
    """Do the work of one thread with the rules ``reduced-step`` and ``cubic``."""
    take_batches(job, run_shortened, REDUCED_STEP_COLUMNS)


def run_batches(threads: int, job: KernelJob) -> None:
    """Run every point, on `threads` threads."""
    loops = {PLAIN: take_plain, EXACT: take_exact}
    work = compiled(loops.get(job.scheme.method[0], take_shortened), job)
    on_threads(threads, job.interrupt, work, job)
