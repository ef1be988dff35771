"""Runs of a followed sweep: blocks, threads, files, memory."""

import itertools
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from sweeps import open_sweep, run_sweep
from sweeps.engine import estimate as limits
from sweeps.engine import executors
from sweeps.engine.estimate import block_size, expected_cost
from sweeps.engine.executors import compute, compute_block
from sweeps.errors import Failed, StoreError
from sweeps.interrupts import this_thread
from sweeps.store.writer import SweepWriter
from tests.helpers.commands import call
from tests.helpers.configurations import configured, full_block
from tests.helpers.sweep_files import data, run_and_read
from vibroimpact import Status

pytestmark = pytest.mark.slow


def test_an_interrupted_run_goes_on_to_the_same_data(stop_after):
    """Whatever the blocks, the threads and the compression are."""
    expected, config = run_and_read(configured()), configured("compression=gzip")
    with stop_after(2, size=5), pytest.raises(KeyboardInterrupt):
        run_sweep(config, "stopped.h5", threads=2)
    with open_sweep("stopped.h5") as dataset:
        missing = (dataset["status"] == Status.PENDING).values
        assert missing.sum() == 4 * 2 * 5  # chains, directions, points
        assert (missing == missing[:1, :, :1]).all()  # no partial chain
    run_sweep(config, "stopped.h5", resume=True, threads=1)
    xr.testing.assert_identical(data("stopped.h5"), expected)
    with xr.open_dataset("stopped.h5", engine="h5netcdf") as dataset:  # as in another program
        assert dataset["direction"].values.tolist() == ["up", "down"]
        xr.testing.assert_equal(dataset.load(), expected)
    with pytest.raises(StoreError, match=r"follow\.direction was both and is up"):
        run_sweep(configured("follow.direction=up"), "stopped.h5", resume=True)
    with pytest.raises(StoreError, match=r"follow\.axis was omega and is not given"):
        run_sweep(configured("follow=null"), "stopped.h5", resume=True)


def test_points_are_counted_in_each_direction():
    configured()
    printed = call("run", "sweep.yaml", "--dry-run").stdout
    assert "follow            omega, up and down\n" in printed
    assert "points            60\n" in printed and "forcing periods   780\n" in printed
    result = call("run", "sweep.yaml", "-o", "out.h5")
    assert result.stdout.startswith("out.h5: 60 points")
    assert "60/60 points" in result.stderr
    shown = call("info", "out.h5").stdout
    assert "direction = up, down\n" in shown
    assert "status (direction: 2, R: 3, omega: 5, clearance: 2)" in shown


def test_the_points_of_a_long_block_are_told_as_they_come():
    config = configured()
    told = []
    results = compute_block(config.sweep, full_block(config), None, told.append)
    assert told == [12] * 5 and len(results["status"]) == 60
    alone, told = configured("follow=null"), []
    results = compute_block(alone.sweep, full_block(alone), None, told.append)
    assert told == [30]
    expected = compute(alone.sweep.spec, alone.sweep.grid.points(full_block(alone)), None)
    np.testing.assert_array_equal(results["poincare_x"], expected["poincare_x"])


def test_a_run_that_was_left_computes_no_further_in_its_block(monkeypatch):
    begun = threading.Semaphore(0)
    numbers = itertools.count(1)

    def computing(sweep, block, threads, advance):
        def told(points):
            begun.release()
            if next(numbers) >= 6:  # until the run is abandoned
                deadline = time.monotonic() + 300
                while not this_thread.flag[0] and time.monotonic() < deadline:
                    time.sleep(0.01)

        return compute_block(sweep, block, threads, told)

    def full(self, block, results):
        for _ in range(6):  # the 5 values of the first block, and one of the second
            assert begun.acquire(timeout=300)
        raise Failed("the disk is full")

    monkeypatch.setattr("sweeps.engine.estimate.block_size", lambda *_, **__: 5)
    monkeypatch.setattr(executors, "compute_block", computing)
    monkeypatch.setattr(SweepWriter, "write", full)
    with pytest.raises(Failed, match="full"):
        run_sweep(configured(), "out.h5")
    assert not begun.acquire(blocking=False)


def test_a_block_holds_whole_chains(monkeypatch):
    long = "oscillator.omega={start: 1, stop: 2, num: 3000}"
    many = configured(long, "oscillator.R={start: 0.5, stop: 0.8, num: 100}")
    for memory in (10**11, 10**9):
        monkeypatch.setattr(limits, "available_memory", lambda memory=memory: memory)
        size = block_size(many.sweep)
        assert size % 3000 == 0
        cost = expected_cost(many.sweep, Path("out.h5"), executors.LocalComputer(), False)
        assert cost.memory <= memory
        for block in many.sweep.grid.blocks(size, unsplit="omega"):
            assert block[1] == slice(0, 3000)
    monkeypatch.setattr(limits, "available_memory", lambda: 10**7)
    told = r"one chain of 3,000 points, followed up and down along omega, takes about .* of memory"
    with pytest.raises(StoreError, match=told):
        run_sweep(many, "out.h5")
    assert not Path("out.h5").exists()
