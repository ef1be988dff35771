"""Runs in their own processes, killed, interrupted and started twice."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import xarray as xr
from typer.testing import CliRunner

import sweeps
from sweeps.cli.main import app
from sweeps.store.reader import open_sweep
from vibroimpact.status import Status

ROOT = Path(sweeps.__file__).parents[1]
CONFIG = """\
oscillator: {h: 0.05, R: 0.8, omega: {start: 2.4, stop: 3.5, num: 700}, f: 1.0}
record: {transient: 500, periods: 50, diagnostics: [period]}
"""
LONG = ["--set", "record.transient=5e8", "--set", "oscillator.omega.num=2"]  # days per block

# A fork of a process that has imported everything, but not run the kernel, starts at once.
KILLS = """
import os, random, signal, sys, time
import numpy as np
from sweeps import load_config, open_sweep, run_sweep

config, seed = load_config("sweep.yaml", sys.argv[2:]), int(sys.argv[1])
draw, kills = random.Random(seed), 0

def child():
    pid = os.fork()
    if pid == 0:
        try:
            run_sweep(config, "out.h5", resume=True)
            os._exit(0)
        finally:
            os._exit(1)
    return pid

began = time.monotonic()
while kills < 12:
    pid = child()
    limit = draw.uniform(0.0, 1.5)
    began = time.monotonic()
    while os.waitpid(pid, os.WNOHANG) == (0, 0):
        if time.monotonic() - began > limit:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            kills += 1
            break
        time.sleep(0.001)
    else:
        pass
    if os.path.exists("out.h5"):
        with open_sweep("out.h5") as dataset:
            done = dataset["status"].values >= 0
            assert np.isfinite(dataset["poincare_x"].values[done]).all()
            if done.all():
                os.rename("out.h5", f"complete-{kills}.h5")
assert os.waitpid(child(), 0)[1] == 0
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("sweep.yaml").write_text(CONFIG)
    return tmp_path


def python(*arguments):
    return subprocess.Popen(
        [sys.executable, *arguments],
        env={"PYTHONPATH": str(ROOT), "PATH": ""},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def ended(process, timeout=120):
    """Wait for the end of a process, and return its exit code and what it said."""
    _, stderr = process.communicate(timeout=timeout)
    return process.returncode, stderr


def run(*arguments):
    return python("-m", "sweeps.cli", "run", "sweep.yaml", *arguments)


def data(path):
    with open_sweep(path) as dataset:
        dataset.load()
    return dataset.drop_attrs(deep=False)


# 520 points in two directions, in three blocks.
FOLLOWED = [
    "follow={axis: omega, direction: both}",
    "oscillator={h: 0.05, R: {start: 0.5, stop: 0.8, num: 260}, omega: [2.4, 3.0], f: 1}",
]
TRAJECTORY = "record={transient: 50, periods: 10, trajectory: {every: 5}}"


@pytest.mark.parametrize("changed", [[], ["compression=gzip", TRAJECTORY], FOLLOWED])
def test_killed_at_any_moment_and_resumed_it_ends_with_the_same_bits(changed):
    options = [part for change in changed for part in ("--set", change)]
    assert ended(run("-o", "whole.h5", "--quiet", *options)) == (0, "")
    assert ended(python("-c", KILLS, "1", *changed), 300) == (0, "")
    for path in (Path("out.h5"), *Path().glob("complete-*.h5")):
        xr.testing.assert_identical(data(path), data("whole.h5"))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_ends_a_run_in_the_middle_of_a_long_block(number):
    process = run("-o", "long one.h5", *LONG)
    deadline = time.monotonic() + 120
    while not Path("long one.h5").exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(0.5)
    process.send_signal(number)
    code, stderr = ended(process, 10)
    assert code == 1
    options = "--set record.transient=5e8 --set oscillator.omega.num=2"
    assert stderr.splitlines()[-1] == (
        "vibroimpact: error: interrupted; 0 of 2 points kept in long one.h5; to go on: "
        f"vibroimpact run sweep.yaml -o 'long one.h5' {options} --resume"
    )
    assert "Traceback" not in stderr
    assert sorted(path.name for path in Path().iterdir()) == ["long one.h5", "sweep.yaml"]
    with open_sweep("long one.h5") as dataset:
        assert (dataset["status"] == Status.PENDING).all()
    told = CliRunner().invoke(app, ["info", "long one.h5"])
    assert "2 points, of which 2 PENDING (not computed yet)" in told.stdout


def test_an_interrupted_run_goes_on_with_the_command_it_names():
    process = run("--set", "record.transient=20000", "--threads", "1")
    deadline = time.monotonic() + 120
    done = 0
    while not done and time.monotonic() < deadline:
        time.sleep(0.05)
        if Path("sweep.h5").exists():
            with open_sweep("sweep.h5") as dataset:
                done = int((dataset["status"] != Status.PENDING).sum())
    picture = CliRunner().invoke(app, ["plot", "sweep.h5"])  # while it is being written
    assert picture.exit_code == 0, picture.output
    process.send_signal(signal.SIGINT)
    code, stderr = ended(process)
    assert code == 1
    message, command = stderr.splitlines()[-1].split("; to go on: vibroimpact ")
    assert int(message.split("interrupted; ")[1].split()[0]) >= done > 0
    assert ended(python("-m", "sweeps.cli", *command.split(), "--dry-run")) == (0, "")
    # With less to do than that, since another transient is another sweep.
    code, stderr = ended(run("--resume"))
    assert code == 2 and "record.transient was 20000 and is 500" in stderr


def test_of_two_runs_started_together_one_computes():
    both = [run("--set", "record.transient=20000") for _ in range(2)]
    deadline = time.monotonic() + 120
    while all(one.poll() is None for one in both) and time.monotonic() < deadline:
        time.sleep(0.05)
    refused, running = sorted(both, key=lambda one: one.poll() is None)
    code, stderr = ended(refused)
    assert code == 2 and f"sweep.h5 is being written by process {running.pid};" in stderr
    running.send_signal(signal.SIGTERM)
    assert ended(running)[0] == 1
