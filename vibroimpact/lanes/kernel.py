"""The stepping kernel: blocks of lanes over the threads.

Every lane is advanced by its affine map as if there were no stop, and mended where it may have met
the stop. The rules ``exact`` and ``plain`` have loops of their own, in ``exact.py`` and
``plain.py``. With the other rules a lane that met the stop stays at the start of a stride of steps,
and is taken through the stride alone, step by step, as a single orbit is. With ``reduced-step``
``lanes/reduced_step.py`` mends most of these lanes first. Each thread takes block after block, and
does not hold Python's lock.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import claim, compiled, is_set, jit, on_threads, widest_vectors
from vibroimpact.lanes.columns import VECTOR
from vibroimpact.lanes.exact import run_exact
from vibroimpact.lanes.exact_block import EXACT_LANES, new_memory
from vibroimpact.lanes.plain import advance_plain, clear_sums, sum_up_plain
from vibroimpact.lanes.reduced_step import mend_side_by_side
from vibroimpact.lanes.tally import Tally, close_records, record_section, record_step, rows_of
from vibroimpact.lanes.workspace import (
    LANES,
    LEVEL,
    MET,
    SIZE,
    STRIDE,
    WAKE,
    V,
    X,
    aligned,
    glide_step,
    glide_stride,
    list_met,
    map_of,
    set_maps,
    set_start,
)
from vibroimpact.step.methods import Stepping
from vibroimpact.step.one_step import take_step
from vibroimpact.step.phases import COS, SIN, THETA, sine_at_start
from vibroimpact.step.rules import EXACT, PLAIN, REDUCED_STEP
from vibroimpact.step.stop import Scratch, new_scratch, time_to_release

#: The fewest points that a thread takes side by side with exact impacts, if there are so many:
#: fewer take nearly as long.
FEWEST_LANES = 64


class Run(NamedTuple):
    """A run of the kernel.

    Attributes
    ----------
    points : ndarray of dtype ``POINT``, shape (n,)
    stepping : Stepping
    transient, periods : int
        Periods left out, and recorded.
    lyapunov : bool
    lanes : int
        Points in a block.
    tally : Tally
        Receives the results.
    claimed : ndarray of int, shape (1,)
        Number of blocks taken by the threads.
    interrupt : ndarray of int, shape (1,)
        Once it is set the points are given up: ``PENDING``.
    """

    points: np.ndarray
    stepping: Stepping
    transient: int
    periods: int
    lyapunov: bool
    lanes: int
    tally: Tally
    claimed: np.ndarray
    interrupt: np.ndarray


def lanes_per_block(rule: int, points: int, threads: int) -> int:
    """Return how many points to take side by side, so that threads get equal shares."""
    if rule != EXACT:
        return LANES
    share = max(1, -(-points // threads))
    blocks = -(-share // EXACT_LANES)  # as many for every thread
    return max(FEWEST_LANES, -(-share // (blocks * VECTOR)) * VECTOR)


class Lanes(NamedTuple):
    """A block of points with a rule other than ``exact``.

    ``method`` is the codes of rule and integrator; the tally has a row for each of the points.
    """

    w: np.ndarray
    scratch: Scratch
    points: np.ndarray
    method: tuple[int, int]
    tally: Tally


@jit(inline=True)
def finish(block, i, steps, begin, end, recording):
    """Take lane `i` through the steps from `begin` to before `end`, with every impact in them."""
    w, scratch, points, method, tally = block
    pt, sums, table, step = points[i], tally.sums[i], steps.table, steps.step
    rows, state = map_of(w, i), (w[X + i], w[V + i], w[LEVEL + i] < points[i].clearance)
    for k in range(begin, end):
        theta = table[THETA, k]
        if theta + step < w[WAKE + i] - 1e-9:  # asleep
            if recording:
                sums.rested += step / pt.omega
            continue
        phase = theta, table[SIN, k], table[COS, k]
        x, v, resting, n, rested, status = take_step(method, rows, state, phase, step, pt, scratch)
        state = x, v, resting
        w[WAKE + i] = -math.inf
        if resting:
            w[WAKE + i] = theta + step + pt.omega * time_to_release(theta + step, pt)
        sums.status = max(sums.status, status)
        if recording and (n > 0 or rested > 0.0):
            record_step(scratch.events, n, x, rested, theta, pt, i, tally)
    w[X + i], w[V + i] = state[0], state[1]
    w[LEVEL + i] = -math.inf if state[2] else pt.clearance


@jit(refcounts=False)
def advance(block, steps, recording):
    """Take a block over `steps`, stride by stride, and over the rest of them singly."""
    widest_vectors()
    w, points, (rule, integrator) = block.w, block.points, block.method
    strides = steps.size // STRIDE
    for k in range(strides + steps.size % STRIDE):
        n = k + min(k, strides) * (STRIDE - 1)
        span = STRIDE if k < strides else 1
        bits = glide_step(w, steps.table, n) if span == 1 else glide_stride(w, steps.table, n)
        met = list_met(w, points.size, bits)
        if rule == REDUCED_STEP and span == STRIDE and met > 0:
            met = mend_side_by_side(w, met, points, integrator, steps, n, recording, block.tally)
        for j in range(met):
            finish(block, int(w[MET + j]), steps, n, n + span, recording)


@jit(inline=True)
def run_block(block, plain, run):
    """Run a block of at most ``LANES`` points from its start to the end of the record.

    `plain` says whether the rule is ``plain``. It is a literal, so that only one loop is compiled.
    """
    w, points, tally = block.w, block.points, block.tally
    transient, (method, lead, grid) = run.transient, run.stepping
    set_start(w, points, method[0], sine_at_start(lead, grid))
    if plain:
        clear_sums(w)
    for k in range(-transient - 1, run.periods):
        if is_set(run.interrupt):
            break
        steps = lead if k < -transient else grid
        if k <= -transient:
            set_maps(w, points, method[1], steps)
        if not plain:
            advance(block, steps, k >= 0)
        elif k < 0:
            advance_plain(w, points.size, steps, False, tally)
        else:
            advance_plain(w, points.size, steps, True, tally)
        for i in range(points.size):
            if k >= 0:
                record_section(w[X + i], w[V + i], i, k, tally)
            if k >= -transient:
                w[WAKE + i] -= 2.0 * math.pi  # the grid's phases begin again
    if plain:
        sum_up_plain(w, points.size, tally)


@jit(inline=True)
def take_blocks(run, plain):
    """Run block after block, as long as there are any that no thread has taken yet."""
    w, scratch = aligned(SIZE), new_scratch()
    lanes = run.lanes
    lo = lanes * claim(run.claimed)
    while lo < run.points.size:  # ends: the counter only rises
        points, tally = run.points[lo : lo + lanes], rows_of(run.tally, lo, lo + lanes)
        run_block(Lanes(w, scratch, points, run.stepping.method, tally), plain, run)
        close_records(tally, is_set(run.interrupt))
        lo = lanes * claim(run.claimed)


@jit
def take_plain(run):
    """Run blocks with the rule ``plain``: the work of one thread."""
    widest_vectors()
    take_blocks(run, True)


@jit
def take_mended(run):
    """Run blocks with the rules ``reduced-step`` and ``cubic``: the work of one thread."""
    widest_vectors()
    take_blocks(run, False)


@jit
def take_exact(run):
    """Run blocks with the rule ``exact``: the work of one thread."""
    memory = new_memory()
    lanes = run.lanes
    lo = lanes * claim(run.claimed)
    while lo < run.points.size:  # ends: the counter only rises
        tally = rows_of(run.tally, lo, lo + lanes)
        run_exact(memory, run.points[lo : lo + lanes], run, tally)
        close_records(tally, is_set(run.interrupt))
        lo = lanes * claim(run.claimed)


def run_blocks(threads: int, run: Run) -> None:
    """Run every point on so many threads."""
    loops = {PLAIN: take_plain, EXACT: take_exact}
    work = compiled(loops.get(run.stepping.method[0], take_mended), run)
    on_threads(threads, run.interrupt, work, run)
