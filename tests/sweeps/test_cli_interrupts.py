"""Commands that are interrupted or fail on the way: exit code 1, and what is kept."""

import os
import signal
import subprocess
import sys
import time
import types
from pathlib import Path

import pytest

import sweeps
from commands import SMALL, call
from sweeps import interrupts
from sweeps.engine import run as runner
from sweeps.store import SweepWriter

CONFIG = SMALL
ROOT = Path(sweeps.__file__).parents[1]


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (KeyboardInterrupt(), "interrupted; nothing is kept"),
        (OSError(28, "No space left on device"), "No space left on device; nothing is kept"),
        (MemoryError(), "MemoryError; nothing is kept"),
    ],
)
def test_a_run_that_ends_early_exits_with_1(monkeypatch, error, text):
    def run_sweep(*_, **__):
        raise error

    monkeypatch.setitem(
        sys.modules, "sweeps.engine.run", types.SimpleNamespace(run_sweep=run_sweep)
    )
    result = call("run", "sweep.yaml")
    assert result.exit_code == 1
    assert result.stderr.startswith("vibroimpact: error: ") and text in result.stderr
    assert result.stderr.count("\n") == 1


def test_an_interrupted_run_says_what_is_kept(monkeypatch):
    write = SweepWriter.write

    def write_one(self, block, results):
        write(self, block, results)
        raise KeyboardInterrupt

    monkeypatch.setattr(SweepWriter, "write", write_one)
    monkeypatch.setattr(runner, "block_size", lambda *_, **__: 2)
    for option, done in (("--overwrite", 2), ("--resume", 4)):
        result = call("run", option, "sweep.yaml", "--quiet", "--set", "name=a b")
        assert result.exit_code == 1
        assert f"interrupted; {done} of 10 points kept in a b.h5.part; " in result.stderr
        command = "vibroimpact run sweep.yaml --quiet --set 'name=a b' --resume"
        assert result.stderr.endswith(f"; to go on: {command}\n")


@pytest.mark.parametrize("command", ["info", "plot", "run", "schema", "zoom"])
def test_an_interrupted_command_exits_with_1(ran, monkeypatch, command):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("sweeps.store.open_sweep", interrupt)
    monkeypatch.setattr("sweeps.engine.configurations.read_config", interrupt)
    monkeypatch.setattr("sweeps.config.json_schema.json_schema", interrupt)
    file = {
        "info": ["small.h5"],
        "plot": ["small.h5"],
        "run": ["sweep.yaml"],
        "schema": [],
        "zoom": ["small.h5", "omega=2:3"],
    }
    result = call(command, *file[command])
    assert result.exit_code == 1
    assert result.stderr == "vibroimpact: error: interrupted\n"


@pytest.mark.slow
def test_a_signal_ends_the_wait_for_a_configuration_in_a_pipe():
    os.mkfifo("pipe.yaml")
    command = [sys.executable, "-m", "sweeps.cli", "run", "pipe.yaml"]
    environment = {"PYTHONPATH": str(ROOT), "PATH": ""}
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment) as run:
        try:
            writer = os.open("pipe.yaml", os.O_WRONLY)  # which waits for the command to read
            run.send_signal(signal.SIGTERM)
            _, stderr = run.communicate(timeout=300)
        finally:
            run.kill()
    os.close(writer)
    assert (run.returncode, stderr) == (1, "vibroimpact: error: interrupted\n")


@pytest.fixture
def listening(monkeypatch):
    """What the process of a command has from its start."""
    monkeypatch.setattr(interrupts, "_came", False)
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    interrupts.listen()
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_that_the_compiler_swallows_is_not_lost(monkeypatch, capfd, listening, number):
    class Callback:  # exceptions in it are swallowed, as in LLVM's
        def __del__(self):
            os.kill(os.getpid(), number)
            time.sleep(0.1)

    written = []

    def write(self, block, results):
        written.append(block)
        Callback()

    monkeypatch.setattr(SweepWriter, "write", write)
    monkeypatch.setattr(runner, "block_size", lambda *_, **__: 2)
    result = call("run", "sweep.yaml", "--quiet")
    assert result.exit_code == 1
    assert result.stderr.startswith("vibroimpact: error: interrupted; 0 of 10 points kept")
    assert len(written) == 1
    assert capfd.readouterr().err == ""
