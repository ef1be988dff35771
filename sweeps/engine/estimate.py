"""What a sweep takes, in time, disk and memory; known before a step of it is computed."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import psutil

from sweeps.config.sweep import SweepConfig
from sweeps.engine.compute import compute
from sweeps.engine.executors import Local, in_thread
from sweeps.errors import StoreError
from sweeps.store import bytes_per_point, check_room, widths_of
from sweeps.text import shown_bytes
from vibroimpact.jit import ALL_THREADS
from vibroimpact.kernel.run import lanes_per_batch

if TYPE_CHECKING:
    from sweeps.engine.cluster import Cluster

#: Results of one block in memory, more only for full lanes [bytes].
_BLOCK_MEMORY = 64 * 2**20
#: Blocks in memory at once, with what their computation needs: one is computed, one waits, one is
#: written. From the peak of runs with blocks of 64 MB and 1 GB. A picture on the screen takes up to
#: 4.1 times its results.
_BLOCKS_HELD = 5
#: Time steps of one block at most, all points together, so that it takes about a second.
_BLOCK_STEPS = 200_000_000
#: Points of a block at least, where there are as many and memory for them.
_LEAST_BLOCK = 128
#: A sweep is reported and written in at least this many blocks where it has the points.
_BLOCKS = 50
#: Samples of a trajectory at impacts, for which there is room in every period.
_AT_IMPACTS = 8

#: The calibration ends with the trial that takes longer [s].
_TRIAL = 0.1
#: Points in it at least, where chains are followed.
_LEAST_TRIED = 16


@dataclass(frozen=True)
class Estimate:
    """What a sweep takes.

    The time is expected from short trials, which do not see what comes later, without compilation.
    In bytes: the size of the file when it is complete and not compressed, the room on the disk
    for it and its journal, and the memory for the blocks.
    """

    seconds: float
    file: int
    disk: int
    memory: int


def expected(config: SweepConfig, path: Path, computer: Local | Cluster, resume: bool) -> Estimate:
    """Return what a sweep takes; refuse it where there is too little memory or disk."""
    cost = in_thread(estimate, config, computer.threads, computer.cores)
    check_room(path, cost.disk, resume=resume)
    return cost


def estimate(config: SweepConfig, threads: int | None = None, cores: int = 1) -> Estimate:
    """Estimate what a sweep takes in time, disk and memory.

    The trials take so many threads, all by default, and `cores` of them are computed in parallel.
    Raises StoreError if there is not enough memory for one point, or one chain of points.
    """
    size = config.size
    file = size * bytes_per_point(config.spec)
    disk = 2 * size * bytes_per_point(config.spec, _AT_IMPACTS)
    points = min(block_size(config), config.grid.size)
    memory = _BLOCKS_HELD * points * _memory_per_point(config)
    seconds = expected_seconds(config, threads) / cores
    return Estimate(seconds, file, disk, memory)


def block_size(config: SweepConfig, *, least: int = 1, blocks: int = _BLOCKS) -> int:
    """Return the points of the grid per block: few enough for memory, and for signs of progress.

    Where an axis is followed, a block holds whole chains of points along it, each in a lane. The
    memory is that of this machine, also where others compute. A block has `least` points where they
    fit into memory, and a sweep at least so many blocks where it has two full sets of lanes for
    each. Raises StoreError if there is not enough memory for one point, or one chain of points.
    """
    record, chain, lanes = config.record, _chain(config), _lanes(config)
    chain_memory = chain * _memory_per_point(config)
    available = check_memory(config, chain, _unit(config))
    # Full sets of lanes are worth more memory, where there is plenty.
    wished = _BLOCK_MEMORY if record.trajectory else max(_BLOCK_MEMORY, 2 * lanes * chain_memory)
    fits = max(1, min(wished, available // (2 * _BLOCKS_HELD)) // chain_memory)
    work = _BLOCK_STEPS // ((record.transient + record.periods) * config.steps * chain)
    most = max(config.grid.size // chain // max(blocks, _BLOCKS), 2 * lanes, _LEAST_BLOCK)
    wanted = max(min(most, max(work, 2 * lanes)), math.ceil(least / chain))
    # Whole sets of lanes, where there is room for one: they fill the vectors.
    return chain * (min(fits, wanted) // lanes * lanes or fits)


def check_memory(config: SweepConfig, points: int, what: str) -> int:
    """Refuse points that are computed at once if they do not fit into memory; `what` they are.

    Return the bytes of memory that this process can take.
    """
    needed, available = _BLOCKS_HELD * points * _memory_per_point(config), _available_memory()
    if needed > available:
        raise StoreError(
            f"{what} takes about {shown_bytes(needed)} of memory, and only "
            f"{shown_bytes(available)} are available; record fewer periods, impacts or samples"
        )
    return available


def _chain(config: SweepConfig) -> int:
    """Return the points of the grid that are computed one after the other."""
    return len(config.grid.axes[config.follow.axis]) if config.follow else 1


def _unit(config: SweepConfig) -> str:
    """Name what a block holds at least."""
    if config.follow is None:
        return "one point"
    ways = " and ".join(config.directions)
    return f"one chain of {_chain(config):,} points, followed {ways} along {config.follow.axis},"


def _memory_per_point(config: SweepConfig) -> int:
    """Return the bytes of the results of a point of the grid, and of the record of its samples."""
    samples = widths_of(config.spec, _AT_IMPACTS)["sample"]
    in_one_direction = bytes_per_point(config.spec, _AT_IMPACTS) + 32 * samples
    return in_one_direction * max(1, len(config.directions))


def _available_memory() -> int:
    """Return the bytes of memory that are free."""
    return int(psutil.virtual_memory().available)


def expected_seconds(config: SweepConfig, threads: int | None) -> float:
    """Return how long a sweep will take, from trials of few points and ever more periods."""
    # No more than a block has side by side: few take nearly as long as a full set of lanes.
    chains = min(block_size(config), config.grid.size) // _chain(config)
    beside = chains * max(1, len(config.directions))
    count = min(2 * _lanes(config) * (threads or ALL_THREADS), beside)
    # Of few lanes, several calls: one point need not be like the others.
    number, size = -(-_LEAST_TRIED // count) if config.follow else 1, config.size
    tried = config.grid.spread(number * count)
    calls = np.array_split(tried, min(number, tried.size))
    if config.spec.scaled:
        calls[0]["f"] = 1.0
        calls, size = [np.unique(calls[0])], size // len(config.grid.axes.get("f", "1"))
    compute(_shortened(config, 1), calls[0][:1], threads)  # compiles, if need be
    whole = config.record.transient + config.record.periods
    total = 1
    while True:
        trial = _shortened(config, total)
        began = time.perf_counter()
        for points in calls:
            compute(trial, points, threads)
        elapsed = time.perf_counter() - began
        if elapsed > _TRIAL or total == whole:
            return elapsed * whole / total * size / sum(map(len, calls))
        total = min(2 * total, whole)


def _lanes(config: SweepConfig) -> int:
    """Return how many points a single thread computes side by side."""
    return lanes_per_batch(config.grid.size // _chain(config), 1)


def _shortened(config: SweepConfig, total: int) -> SweepConfig:
    """Return the same sweep over `total` periods, with the same share of them recorded."""
    record = config.record
    periods = max(1, total * record.periods // (record.transient + record.periods))
    shorter = {
        "transient": total - periods,
        "periods": periods,
        "impacts": min(record.impacts, 8 * periods),
    }
    return config.with_record(**shorter)
