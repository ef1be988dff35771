"""Estimates the cost of a sweep before it is run: time, memory, disk; chooses blocks."""

from __future__ import annotations

import math
import os
import time
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np

from sweeps.engine.cluster import ClusterComputer
from sweeps.engine.executors import LocalComputer, compute, in_thread
from sweeps.errors import StoreError
from sweeps.grid import Cost, Sweep
from sweeps.store.paths import check_room
from sweeps.store.variables import bytes_per_point, record_widths
from sweeps.text import shown_bytes, shown_count
from vibroimpact.jit import ALL_THREADS, WAY
from vibroimpact.jit.cache import cache_folder
from vibroimpact.kernel.threads import lanes_per_thread
from vibroimpact.points.stages import RunSpec

#: Memory for the results of one block [bytes]; more is used only to fill the lanes.
_BLOCK_MEMORY = 64 * 2**20
#: Memory of a run, in units of the results of one block: one block is computed, one waits and one
#: is written, and the computation needs memory, too. Measured at the peak of runs with blocks of
#: 64 MB and 1 GB. A picture of the live page takes up to 4.1 times its results.
_BLOCKS_IN_MEMORY = 5
#: Memory that a run still takes, besides the results of its blocks, when their memory is checked
#: [bytes]: measured were 45 MB with compiled code, and 245 MB to compile it.
_OWN_MEMORY = 64 * 2**20
COMPILING_MEMORY = 256 * 2**20
#: Most time steps of all points of a block, so that a block takes about a second.
_BLOCK_STEPS = 200_000_000
#: Least number of points of a block, if the sweep has as many and the memory allows it.
_LEAST_BLOCK = 128
#: Least number of blocks in which a sweep is computed and reported, if it has enough points.
_BLOCKS = 50
#: Least number of trajectory samples at impacts reserved in every period.
_AT_IMPACTS = 8

#: The last trial is the first one that takes longer than this [s].
_TRIAL = 0.1
#: Least number of points in a trial of a followed sweep.
_LEAST_POINTS = 16

#: What a variable takes in a file without points [bytes]: measured were 3,700 to 5,700.
_OF_VARIABLE = 4_500

#: Forcing periods that a transient takes if it is found, as a guess for the size of blocks.
_TYPICAL = 1000

#: Time to write a byte of results twice, to its block and to the file [s], as measured.
_WRITING = 5e-9

#: For a control group of either version: its limit, what it uses, and what of that is a copy of
#: files, which the system drops when memory is needed.
_V2 = ("memory.max", "memory.current", ("inactive_file", "active_file"))
_V1 = (
    "memory.limit_in_bytes",
    "memory.usage_in_bytes",
    ("total_inactive_file", "total_active_file"),
)


def expected_cost(
    sweep: Sweep, path: Path, computer: LocalComputer | ClusterComputer, resume: bool
) -> Cost:
    """Return the cost of a sweep; refuse the sweep if disk space or memory is too small."""
    spec, size, points = sweep.spec, sweep.size, sweep.grid.size

    def in_file(at_impacts: float) -> int:
        empty = _OF_VARIABLE * len(record_widths(spec))
        return empty + size * bytes_per_point(spec, at_impacts)

    check_room(path, 2 * in_file(_AT_IMPACTS), resume=resume)
    seconds, at_impacts = in_thread(trial, sweep, computer.threads)
    seconds /= computer.cores
    check_room(path, 2 * in_file(max(at_impacts, _AT_IMPACTS)), resume=resume)
    limits = computer.block_limits(seconds, points)
    block = min(block_size(sweep, at_impacts, **limits), points)
    chain, of_chain, _ = _chain(sweep, at_impacts)
    memory = _BLOCKS_IN_MEMORY * block * of_chain // chain
    file = in_file(at_impacts)
    return Cost(seconds + _WRITING * file, file, memory, block)


def block_size(
    sweep: Sweep, at_impacts: float = 0.0, *, least: int = 1, blocks: int = _BLOCKS
) -> int:
    """Return the number of grid points per block: few enough to fit memory and to show progress.

    The memory is that of this machine, even if others compute. A block has at least `least` points
    if they fit into it, and a sweep at least `blocks` blocks if each can have two full sets of
    lanes. Raises StoreError if there is not enough memory for one point, or one chain of points.
    """
    spec, (chain, memory, lanes) = sweep.spec, _chain(sweep, at_impacts)
    smallest, directions = "one point", " and ".join(spec.directions)
    if spec.followed:
        points = shown_count(chain, "point")
        smallest = f"one chain of {points}, followed {directions} along {spec.followed},"
    available = check_memory(memory, smallest)
    # Full sets of lanes may take more memory than a normal block.
    memory_limit = _BLOCK_MEMORY if spec.every else max(_BLOCK_MEMORY, 2 * lanes * memory)
    fits = max(1, min(memory_limit, available // (2 * _BLOCKS_IN_MEMORY)) // memory)
    left_out = spec.transient if spec.longest is None else min(spec.longest, _TYPICAL)
    work = _BLOCK_STEPS // ((left_out + spec.periods) * spec.steps_per_period * chain)
    most = max(sweep.grid.size // chain // max(blocks, _BLOCKS), 2 * lanes, _LEAST_BLOCK)
    target = max(min(most, max(work, 2 * lanes)), math.ceil(least / chain))
    # Whole sets of lanes, if one fits, because they fill the SIMD vectors.
    return chain * (min(fits, target) // lanes * lanes or fits)


def _chain(sweep: Sweep, at_impacts: float = 0.0) -> tuple[int, int, int]:
    """Return points and memory [bytes] of a chain, and how many a thread computes side by side."""
    spec = sweep.spec
    points = len(sweep.grid.axes[spec.followed]) if spec.followed else 1
    of_point = bytes_per_point(spec, max(at_impacts, _AT_IMPACTS)) * max(1, len(spec.directions))
    return points, points * of_point, lanes_per_thread(sweep.grid.size // points, 1)


def check_memory(results: int, what: str) -> int:
    """Return the available memory [bytes]; refuse `what` if its results at once need more."""
    needed = _BLOCKS_IN_MEMORY * results
    base = _OWN_MEMORY if os.path.exists(cache_folder(WAY.name)) else COMPILING_MEMORY
    available = max(0, available_memory() - base)
    if needed > available:
        raise StoreError(
            f"{what} takes about {shown_bytes(needed)} of memory, and only "
            f"{shown_bytes(available)} are available, besides {shown_bytes(base)} for the program "
            "itself; record fewer periods, impacts or samples, or raise the limit of memory"
        )
    return available


def available_memory(
    process: Path = Path("/proc/self/cgroup"), groups: Path = Path("/sys/fs/cgroup")
) -> int:
    """Return the available memory in bytes: the least of the machine and of all control groups.

    They are those of this process, and those above them. In a container its own group is the root,
    although `process` may name the path outside.
    """
    import psutil

    free = [int(psutil.virtual_memory().available)]
    for line in _lines(process):
        _, controllers, group = line.split(":", 2)
        if controllers and "memory" not in controllers.split(","):
            continue
        root, (limit, usage, copies) = (groups / "memory", _V1) if controllers else (groups, _V2)
        inside = PurePosixPath(group.lstrip("/"))
        for folder in (root / path for path in (inside, *inside.parents)):
            limits, usages = _lines(folder / limit), _lines(folder / usage)
            if limits and usages and limits[0].isdigit():  # "max" is no limit
                statistics = dict(line.split(" ", 1) for line in _lines(folder / "memory.stat"))
                cached = sum(int(statistics.get(name, 0)) for name in copies)
                free.append(max(0, int(limits[0]) - max(0, int(usages[0]) - cached)))
    return min(free)


def _lines(path: Path) -> list[str]:
    """Return the lines of a file of the system; none if it cannot be read, or does not exist."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []


def trial(sweep: Sweep, threads: int | None) -> tuple[float, float]:
    """Return the expected seconds of a sweep, and its samples at impacts in a recorded period.

    Both come from trials of few points with growing periods. The time is the processor time on each
    thread, which other processes do not lengthen.
    """
    threads = threads or ALL_THREADS
    calls, size = _trial_points(sweep, threads)
    compute(_shorter_spec(sweep, 1), calls[0][:1], threads)  # compiles, if necessary
    # So many threads are in the kernel, see `run_on_threads`; this thread does the rest.
    parallel = min(threads, -(-calls[0].size // lanes_per_thread(calls[0].size, threads)))
    total_periods = sweep.most_periods
    periods, before, at_impacts = 1, (0, 0.0), 0.0
    while True:
        shorter = _shorter_spec(sweep, periods)
        samples = 0
        whole, alone = time.process_time(), time.thread_time()
        for points in calls:
            results = compute(shorter, points, threads)
            samples = max(samples, *map(len, results.get("trajectory_t", ((),))))
        whole, alone = time.process_time() - whole, time.thread_time() - alone
        elapsed = alone + (whole - alone) / parallel
        # A motion may have most impacts while it settles, or when it has settled.
        more = (samples - record_widths(shorter).get("trajectory_t", 0)) / shorter.periods
        at_impacts = max(at_impacts, more)
        if elapsed > _TRIAL or periods == total_periods:
            if sweep.spec.longest is None:  # otherwise most motions need no longest transient
                # Motions that have come back cost nothing more: the last periods tell the others.
                rate = (elapsed - before[1]) / (periods - before[0])
                elapsed += max(rate, 0.0) * (total_periods - periods)
            seconds = elapsed * size / sum(map(len, calls))
            return seconds, at_impacts
        before, periods = (periods, elapsed), min(2 * periods, total_periods)


def _trial_points(sweep: Sweep, threads: int) -> tuple[list[np.ndarray], int]:
    """Return the points of each call of a trial, and the number of points of the sweep."""
    # Try no more points than a block computes side by side: a full set of lanes takes hardly longer
    # than a few.
    chain, _, lanes = _chain(sweep)
    chains = min(block_size(sweep), sweep.grid.size) // chain
    count = min(2 * lanes * threads, chains * max(1, len(sweep.spec.directions)))
    # With few lanes, try several sets: a few points may not be typical.
    number, size = -(-_LEAST_POINTS // count) if sweep.spec.followed else 1, sweep.size
    points = sweep.grid.spread(number * count)
    calls = np.array_split(points, min(number, points.size))
    if sweep.spec.scaled:
        calls[0]["f"] = 1.0
        calls, size = [np.unique(calls[0])], size // len(sweep.grid.axes.get("f", "1"))
    return calls, size


def _shorter_spec(sweep: Sweep, total: int) -> RunSpec:
    """Return what a sweep computes, over `total` periods with the same share of them recorded.

    A followed sweep finds its classes once, at the end, and so they are left out.
    """
    spec, is_auto = sweep.spec, sweep.spec.longest is not None
    periods = max(1, total * spec.periods // sweep.most_periods)
    return replace(
        spec,
        transient=0 if is_auto else total - periods,
        longest=max(1, total - periods) if is_auto else None,
        periods=periods,
        impacts=min(spec.impacts, 8 * periods),
        period=spec.period and spec.followed is None,
    )
