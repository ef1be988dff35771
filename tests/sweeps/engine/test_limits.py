"""Memory, disk and time of a sweep are printed or refused before its first step."""

import time
import tracemalloc
from functools import partial
from itertools import count
from pathlib import Path
from threading import Semaphore
from types import SimpleNamespace

import numpy as np
import pytest

from sweeps.engine import estimate as limits
from sweeps.engine.estimate import available_memory, block_size, expected_cost, trial
from sweeps.engine.executors import (
    LocalComputer,
    compute_block,
    other_thread,
    submit_blocks,
)
from sweeps.engine.sweep_run import run_sweep
from sweeps.errors import StoreError
from sweeps.grid import block_points
from tests.helpers.commands import call
from tests.helpers.configurations import load
from tests.helpers.written_files import begun, planned
from vibroimpact.kernel.threads import lanes_per_thread
from vibroimpact.kernel.workspace import LANES

CONFIG = """\
oscillator: {h: 0.1, R: 0.8, omega: {start: 2.0, stop: 3.0, num: 2000}, f: 1.0}
record: {transient: 100, periods: 100}
"""


@pytest.fixture
def usual_trials(monkeypatch):
    monkeypatch.setattr(limits, "_TRIAL", 0.1)


def cost_of(sweep, threads=None):
    return expected_cost(sweep, Path("out.h5"), LocalComputer(threads), resume=False)


def with_memory(monkeypatch, size):
    """Let there be so much memory, besides what the process itself takes."""
    monkeypatch.setattr(limits, "available_memory", lambda: size + limits._OWN_MEMORY)


@pytest.mark.slow
def test_blocks_shrink_to_the_memory_there_is(monkeypatch):
    sweep = load(CONFIG, "record.periods=1e5", "record.impacts=0").sweep
    sizes = []
    for memory in (10**11, 10**9, 10**8, 10**7):
        with_memory(monkeypatch, memory)
        sizes.append(block_size(sweep))
        assert cost_of(sweep).memory <= memory
    assert sizes[0] == 2 * LANES
    assert sizes == sorted(sizes, reverse=True) and sizes[-1] < 4


@pytest.mark.parametrize("memory", [10**11, 2 * 10**7])
def test_a_block_is_whole_sets_of_lanes(monkeypatch, memory):
    """Also where the memory ends it; the rest of a set would be computed without a point."""
    with_memory(monkeypatch, memory)
    size = block_size(load(CONFIG, "oscillator.omega.num=50021").sweep)
    assert size >= LANES and size % LANES == 0
    assert (size + LANES > 50021 // limits._BLOCKS) == (memory > 10**8)


def test_a_block_has_points_for_every_thread(monkeypatch):
    """Also where the blocks are short because their points take long."""
    with_memory(monkeypatch, 10**11)
    sweep = load(CONFIG, "record.transient=1e6").sweep
    for threads in (1, 2, 8, 16):
        size = block_size(sweep, **LocalComputer(threads).block_limits(1.0, sweep.grid.size))
        lanes = lanes_per_thread(size, threads)
        assert size / lanes >= threads


def test_a_point_that_does_not_fit_is_refused(monkeypatch, folder):
    with_memory(monkeypatch, 10**7)
    for options in (["--dry-run"], []):
        # Few points, which fit on every disk.
        few = ["--set", "oscillator.omega.num=3"]
        changed = ["--set", "record.periods=1e6", *few, *options]
        result = call("run", "sweep.yaml", *changed)
        assert result.exit_code == 2
        assert "one point takes about 80 MB of memory, and only 10 MB" in result.stderr
        assert "record fewer periods, impacts or samples" in result.stderr
    assert [path.name for path in folder.iterdir()] == ["sweep.yaml"]


GROUPS = {
    "v2": {
        "self": "0::/a/b\n",
        "memory.max": "max\n",
        "a/memory.max": "1000\n",
        "a/memory.current": "900\n",
        "a/memory.stat": "anon 600\ninactive_file 100\nactive_file 50\n",
        "a/b/memory.max": "max\n",
        "a/b/memory.current": "700\n",
    },
    "v1": {
        "self": "5:cpu,memory:/outside/of/the/container\n1:name=systemd:/\n0::/\n",
        "memory/memory.limit_in_bytes": "1000\n",
        "memory/memory.usage_in_bytes": "900\n",
        "memory/memory.stat": "total_inactive_file 100\ntotal_active_file 50\n",
    },
    "no limit": {
        "self": "4:memory:/\n0::/\n",
        "memory/memory.limit_in_bytes": f"{2**63 - 4096}\n",
        "memory/memory.usage_in_bytes": "900\n",
    },
    "no groups": {},
}


@pytest.mark.parametrize("which", GROUPS)
def test_memory_is_that_of_the_container(which, tmp_path):
    """What a group holds of files does not count: writing a sweep fills it."""
    for name, text in GROUPS[which].items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    found = available_memory(tmp_path / "self", tmp_path)
    assert found == 250 if which in ("v1", "v2") else found > 10**6


FOLLOWED = ["follow={axis: omega, direction: both}", "oscillator.omega.num=50"]


@pytest.mark.slow
@pytest.mark.parametrize(("changes", "threads"), [([], None), ([], 16), (FOLLOWED, None)])
def test_the_memory_and_size_that_are_told_are_those_of_blocks_and_file(changes, threads):
    config = load(CONFIG, *changes)
    told = cost_of(config.sweep, threads)
    with begun("blocks.h5", planned(config, told.block)) as (_, pending):
        points = max(map(block_points, pending)) // (2 if changes else 1)
    assert 0.9 * told.block < points <= told.block
    block = (slice(0, told.block),)
    block = (slice(0, 2), *block) if changes else block
    arrays = sum(array.nbytes for array in compute_block(config.sweep, block, None).values())
    assert told.memory == pytest.approx(limits._BLOCKS_IN_MEMORY * arrays, rel=0.01)
    size = run_sweep(config, "out.h5").stat().st_size
    assert told.file == pytest.approx(size, rel=0.03)


RATTLING = [
    "oscillator={h: 0.02, R: 0.95, omega: {start: 0.05, stop: 0.2, num: 40}, f: 1.0}",
    "record={transient: 0, periods: 20, impacts: 0, trajectory: {every: 20}}",
]


@pytest.mark.parametrize("changes", [RATTLING, [*RATTLING, "start.v0=20"]])
def test_the_memory_that_is_told_counts_the_impacts_of_rattling(changes, monkeypatch):
    """At hundreds of impacts a period, and not only at those of the first periods."""
    sweep = load(CONFIG, *changes).sweep
    told = cost_of(sweep)
    block = (slice(0, told.block),)
    compute_block(sweep, block, None)  # compiles
    tracemalloc.start()
    results = compute_block(sweep, block, None)
    _, used = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert sum(map(len, results["trajectory_t"])) > 100 * 20 * told.block
    assert used < 2 * told.memory
    with_memory(monkeypatch, told.memory // 3)
    assert cost_of(sweep).block < told.block


def test_a_rattling_motion_takes_no_room_for_the_others():
    sweep = load(CONFIG, *RATTLING, "oscillator.omega.stop=20").sweep
    compute_block(sweep, (slice(0, 1),), None)  # compiles
    tracemalloc.start()
    results = compute_block(sweep, (slice(0, 40),), None)
    _, used = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    lengths = [len(samples) for samples in results["trajectory_t"]]
    assert max(lengths) > 10 * np.mean(lengths)
    assert used < 24 * len(lengths) * max(lengths) / 2


def test_memory_that_the_run_itself_needs_is_not_given_to_its_blocks(monkeypatch):
    """Of the process there is more to come: compiled code that is loaded, or that is made."""
    sweep = load(CONFIG).sweep
    for available in (4 * 10**7, 2 * 10**8):
        monkeypatch.setattr(limits, "available_memory", lambda size=available: size)
        if available == 4 * 10**7:
            with pytest.raises(StoreError, match=r"one point takes about .* only 0 B are"):
                cost_of(sweep)
        else:
            assert cost_of(sweep).memory < available - 4 * 10**7
    monkeypatch.setattr(limits, "cache_folder", lambda way: Path("not there"))
    with pytest.raises(StoreError, match="only 0 B are available"):
        block_size(sweep)


@pytest.mark.parametrize("every", [1, 20])
def test_the_size_that_is_told_counts_the_samples_at_impacts(every, monkeypatch):
    few = ["oscillator.omega={start: 0.5, stop: 3, num: 50}", "record.impacts=0"]
    config = load(CONFIG, f"record.trajectory={{every: {every}}}", *few)
    told = cost_of(config.sweep)
    size = run_sweep(config, "out.h5").stat().st_size
    assert told.file == pytest.approx(size, rel=0.2)
    both = 2 * told.file  # the blocks, and the file at the end
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=both - 1))
    with pytest.raises(StoreError, match="record less"):
        cost_of(config.sweep)


def test_the_expected_time_is_the_processor_time_of_all_periods(monkeypatch):
    """Not of the few that a trial takes, nor by a clock that runs while it waits."""
    sweep, spent = load(CONFIG, "record.transient=1e6", "oscillator.omega.num=60").sweep, [0.0]

    def counted(spec, points, *_):
        spent.append(spent[-1] + 1e-3 * (spec.transient + spec.periods) * len(points) / 60)
        return {}

    clocks = dict.fromkeys(("process_time", "thread_time"), lambda: spent[-1])
    monkeypatch.setattr(limits, "time", SimpleNamespace(**clocks))
    monkeypatch.setattr(limits, "compute", counted)
    assert trial(sweep, 1)[0] == pytest.approx(1e-3 * sweep.most_periods)
    assert len(spent) < 20


def test_one_block_is_computed_while_another_is_written_and_none_when_the_rest_is_left():
    begun, later = [], Semaphore(0)

    def compute(block):
        begun.append(block)
        if block > 0:
            later.release()
        if block == 4:
            raise ValueError("the end")
        return {}

    with other_thread() as executor, pytest.raises(ValueError, match="the end"):
        for block, future in submit_blocks(partial(executor.submit, compute), count(), lambda: 2):
            assert future.result() == {}
            assert later.acquire(timeout=300.0), "the next block is not begun"
            time.sleep(0.02)  # in which one block too many would begin
            assert begun == list(range(block + 2))
    assert begun == [0, 1, 2, 3, 4, 5][: len(begun)]


def test_a_run_takes_one_block_beside_the_one_that_is_written():
    """The results of all that it takes are in memory."""
    sweep, taken = load(CONFIG, "record.transient=0", "record.periods=1").sweep, []
    blocks = (taken.append(block) or block for block in sweep.grid.blocks(100))
    for written, _ in enumerate(
        LocalComputer(1).compute_blocks(sweep, blocks, lambda points: None)
    ):
        assert len(taken) <= written + 2
    assert len(taken) > 10


def test_one_chain_of_followed_points_is_expected_to_take_a_call_for_each(usual_trials):
    """Side by side the same points take a hundredth of the time."""
    alone = load(CONFIG, "follow={axis: omega, direction: both}").sweep
    assert trial(alone, 1)[0] > 15.0 * trial(load(CONFIG).sweep, 1)[0]
