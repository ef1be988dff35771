"""Sweeps on a local Dask cluster: the same bits, even if workers or schedulers are lost."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from distributed import Client, LocalCluster

from sweeps.engine.cluster import ClusterComputer
from sweeps.engine.estimate import block_size
from sweeps.engine.executors import compute_block
from sweeps.engine.sweep_run import run_sweep
from sweeps.errors import Failed, Refused
from sweeps.store.writer import SweepWriter
from sweeps.store.xarray_engine import open_sweep
from tests.helpers.clusters import CLUSTERED as CONFIG
from tests.helpers.clusters import WORKERS, assert_same_bits, refused_run
from tests.helpers.commands import call
from tests.helpers.configurations import load
from tests.helpers.interruptions import wait_until
from tests.helpers.places import ROOT
from tests.helpers.sweep_files import data
from vibroimpact.jit import NUMERICS
from vibroimpact.points.computation import compute_points
from vibroimpact.status import Status

pytestmark = [pytest.mark.cluster, pytest.mark.slow]


#: The values of a long logarithmic axis take seconds.
LINEAR = ["oscillator.omega.spacing=linear"]


@pytest.fixture
def small_blocks(monkeypatch):
    """Split a sweep into enough blocks to stop it between two of them."""
    monkeypatch.setattr("sweeps.engine.estimate.block_size", lambda *_, **__: 20)


def on_write(monkeypatch, number, action):
    """Call a function before the n-th block is written; return the written blocks."""
    written = []
    write = SweepWriter.write

    def acting(self, block, results):
        if len(written) == number:
            action()
        written.append(tuple((cut.start, cut.stop) for cut in block))
        write(self, block, results)

    monkeypatch.setattr(SweepWriter, "write", acting)
    return written


@pytest.mark.parametrize(
    "overrides",
    [
        ["oscillator.f=[1, 2, 3]", "oscillator.omega.num=300"],  # scaled along f
        ["oscillator={h: 0.05, f: 1.0}", "points={R: [0.8, 0.5, 0.7], omega: [2.4, 3.1, 2.6]}"],
        ["follow={axis: omega, direction: both}", "record.trajectory={every: 10}",
         "oscillator.omega.num=40"],
    ],
)  # fmt: skip
def test_a_cluster_computes_the_same_bits(client, overrides):
    run_sweep(load(CONFIG, *overrides), "there.h5", client=client)
    run_sweep(load(CONFIG, *overrides), "here.h5", threads=1)
    xr.testing.assert_identical(data("there.h5"), data("here.h5"))


@pytest.mark.parametrize("begins_here", [True, False])
def test_a_cluster_ends_what_one_machine_began(client, stop_after, begins_here):
    """Or the other way round; an interrupt takes the tasks off the cluster."""
    first, second = (None, client) if begins_here else (client, None)
    with stop_after(4, size=20), pytest.raises(KeyboardInterrupt):
        run_sweep(load(CONFIG), "out.h5", client=first)
    held = client.processing, client.has_what
    wait_until(lambda: not any(any(tasks().values()) for tasks in held), "workers without tasks")
    with open_sweep("out.h5") as dataset:
        assert 0 < (dataset["status"] != Status.PENDING).sum() < 300
    run_sweep(load(CONFIG), "out.h5", client=second, resume=True)
    assert_same_bits("out.h5")


def test_a_long_axis_travels_without_a_warning(client):
    sweep = load(CONFIG, *LINEAR, "oscillator.omega.num=2000000").sweep
    blocks = [(slice(i, i + 1),) for i in (0, 777_777)]
    for block, results in ClusterComputer(client).compute_blocks(sweep, blocks):
        np.testing.assert_equal(results, compute_block(sweep, block, 1))


def test_a_killed_worker_costs_nothing_but_time(monkeypatch, cluster, client, small_blocks):
    def kill():
        os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)

    written = on_write(monkeypatch, 3, kill)
    run_sweep(load(CONFIG, "record.transient=2000"), "out.h5", client=client)
    assert len(written) == len(set(written)) == 15
    assert_same_bits("out.h5", "record.transient=2000")
    client.wait_for_workers(WORKERS, timeout=300)


def test_workers_may_come_when_the_run_has_begun():
    options = {"processes": False, "n_workers": 0, "threads_per_worker": 1}
    with LocalCluster(**options, dashboard_address=":0") as cluster, Client(cluster) as client:
        assert ClusterComputer(client).place_text() == ", waiting for a worker"
        later = threading.Timer(0.5, cluster.scale, [1])
        later.start()
        run_sweep(load(CONFIG), "out.h5", client=client)
        later.join()
        assert ClusterComputer(client).place_text() == " on 1 worker"
    assert_same_bits("out.h5")


CLUSTER = """
from distributed import LocalCluster
options = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": None}
with LocalCluster(processes=False, protocol="tcp", host="127.0.0.1", **options) as cluster:
    print(cluster.scheduler_address, flush=True)
    input()
"""


def test_a_lost_scheduler_leaves_what_was_done(monkeypatch, small_blocks):
    streams = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    with (
        subprocess.Popen([sys.executable, "-c", CLUSTER], env=env, **streams) as process,
        monkeypatch.context() as patch,
    ):
        address = process.stdout.readline().strip()
        on_write(patch, 3, process.kill)
        result = call("run", "sweep.yaml", "-o", "out.h5", "--dask", address, "--quiet")
    assert result.exit_code == 1
    pattern = (
        rf"vibroimpact: error: the run failed: the scheduler {address} was lost.*; (\d+) of 300 "
        rf"points kept in out\.h5\.parts; to go on: vibroimpact run sweep\.yaml -o out\.h5 --dask "
        rf"{address} --quiet --resume\n"
    )
    found = re.fullmatch(pattern, result.stderr)
    assert found, result.stderr
    assert 60 <= int(found[1]) < 300
    run_sweep(load(CONFIG), "out.h5", resume=True)
    assert_same_bits("out.h5")


def test_an_error_on_a_worker_ends_the_run_with_its_text(client):
    without_an_axis = [()] * 20
    with pytest.raises(Failed, match=r"a worker of tcp://\S+ failed with ValueError: zip\(\)"):
        list(ClusterComputer(client).compute_blocks(load(CONFIG).sweep, without_an_axis))


@pytest.fixture
def stranger(client):
    """Let one worker take on other numerics; yield what does so, and its address."""
    address = next(iter(client.nthreads()))

    def pretend(numerics):
        def change():
            import vibroimpact.jit

            vibroimpact.jit.NUMERICS = numerics

        client.run(change, workers=[address])

    yield lambda: pretend("0123456789abcdef"), address
    pretend(NUMERICS)


def test_a_worker_with_other_numerics_is_refused(client, stranger):
    pretend, address = stranger
    pretend()
    with pytest.raises(Refused) as caught:
        run_sweep(load(CONFIG), "out.h5", client=client)
    assert not isinstance(caught.value, Failed)
    for part in (address, "0123456789abcdef", NUMERICS):
        assert part in str(caught.value)
    said = refused_run("--dask", client.scheduler.address, "--quiet")
    assert said == f"vibroimpact: error: {caught.value}\n"


def test_a_worker_that_joins_with_other_numerics_is_refused(monkeypatch, client, stranger):
    pretend, address = stranger
    # So many blocks that each worker has some left, however slow it is.
    monkeypatch.setattr("sweeps.engine.estimate.block_size", lambda *_, **__: 10)
    with monkeypatch.context() as patch:
        on_write(patch, 2, pretend)
        with pytest.raises(Failed) as caught:
            run_sweep(load(CONFIG), "out.h5", client=client)
    for part in (address, "0123456789abcdef", NUMERICS):
        assert part in str(caught.value)
    run_sweep(load(CONFIG), "out.h5", resume=True)
    assert_same_bits("out.h5")


def test_a_worker_without_this_package_is_refused(client):
    def hide():
        import sys

        sys.modules["sweeps.engine.cluster"] = None

    def show():
        import sys

        del sys.modules["sweeps.engine.cluster"]

    client.run(hide)
    try:
        with pytest.raises(Refused, match=r"tcp://\S+ has another version .*, none \("):
            ClusterComputer(client)
    finally:
        client.run(show)


def test_a_worker_with_many_threads_is_in_the_kernel_once(monkeypatch):
    """The worker runs in this process, so that the test can observe it."""
    inside, most, given = 0, 0, set()

    def watched(task, points, threads, **options):
        nonlocal inside, most
        inside += 1
        most = max(most, inside)
        given.add(threads)
        time.sleep(0.02)
        results = compute_points(task, points, threads, **options)
        inside -= 1
        return results

    sweep = load(CONFIG).sweep
    blocks = list(sweep.grid.blocks(20))
    options = {"processes": False, "n_workers": 1, "threads_per_worker": 4}
    with LocalCluster(**options, dashboard_address=":0") as cluster, Client(cluster) as client:
        computer = ClusterComputer(client)
        assert computer.cores == 4
        with monkeypatch.context() as patch:
            patch.setattr("sweeps.engine.executors.compute_points", watched)
            found = list(computer.compute_blocks(sweep, blocks))
    assert most == 1
    assert given == {min(4, os.cpu_count())}
    assert len(found) == len(blocks)
    for block, results in found:
        np.testing.assert_equal(results, compute_block(sweep, block, 1))


def test_no_more_is_handed_out_than_the_workers_need(client):
    handed = []

    def blocks():
        for number in range(30):
            handed.append(number)
            yield (slice(number, number + 1),)

    sweep, taken = load(CONFIG).sweep, 0
    for block, results in ClusterComputer(client).compute_blocks(sweep, blocks()):
        np.testing.assert_equal(results, compute_block(sweep, block, 1))
        taken += 1
        assert len(handed) <= taken + 3 * WORKERS + 2  # what is out, and two on this side
    assert taken == 30


def test_a_block_is_worth_sending(client):
    sweep, size = load(CONFIG, *LINEAR, "oscillator.omega.num=1e6").sweep, 10**6
    computer = ClusterComputer(client)
    for seconds in (5.0, 50.0, 500.0):
        limits = computer.block_limits(seconds, size)
        assert limits["least"] / size * seconds * WORKERS == pytest.approx(0.5, rel=0.01)
        assert block_size(sweep, **limits) >= limits["least"] - 128  # whole sets of lanes
    assert computer.block_limits(0.01, size)["least"] == size


def test_the_command_says_where_it_computes(client, unpainted):
    address = client.scheduler.address
    plan = call("run", "sweep.yaml", "-o", "out.h5", "--dask", address, "--dry-run")
    assert plan.exit_code == 0
    assert "expected time" in plan.stdout and not Path("out.h5").exists()
    result = call("run", "sweep.yaml", "-o", "out.h5", "--dask", address)
    assert result.exit_code == 0, result.stderr
    assert "on 2 workers" in result.stderr
    assert_same_bits("out.h5")
    assert "on 2 workers" in call("zoom", "out.h5", "omega=2.5:2.6", "--dask", address).stderr


def test_the_address_of_a_worker_is_none_of_a_scheduler(client):
    address = next(iter(client.nthreads()))
    assert "(it is the address of a worker)" in refused_run("--dask", address)


def test_threads_are_those_of_the_workers(client):
    message = refused_run("--threads", 1, "--dask", client.scheduler.address)
    assert "--threads 1 is not allowed with --dask" in message
    with pytest.raises(ValueError, match="threads is not allowed with a client"):
        run_sweep(load(CONFIG), "out.h5", client=client, threads=1)
