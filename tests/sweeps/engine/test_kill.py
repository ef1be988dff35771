"""Runs in separate processes that are killed, interrupted or started twice.

The campaign sends 1,200 signals: ``pytest -m campaign tests/sweeps/engine/test_kill.py``.
"""

import os
import random
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sweeps import interrupts, open_sweep, run_sweep
from sweeps.cli.__main__ import NOTED
from sweeps.config.loading import load_config
from sweeps.store.writer import SweepWriter
from tests.helpers.commands import call
from tests.helpers.interruptions import (
    ANSWERED,
    KINDS,
    MOMENTS,
    PATIENCE,
    SWEEP,
    Forks,
    environment,
    hear,
    share_written,
    signalled,
    wait_until,
)
from vibroimpact.jit.cache import cache_folder
from vibroimpact.jit.way import WAY
from vibroimpact.status import Status

pytestmark = pytest.mark.slow

CONFIG = SWEEP


@pytest.fixture(scope="module")
def forks(tmp_path_factory):
    with Forks(tmp_path_factory.mktemp("forks")) as forks:
        yield forks


def run(*arguments, program=(sys.executable, "-m", "sweeps.cli")):
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    command = [*program, "run", "sweep.yaml", *arguments]
    return subprocess.Popen(command, env=environment(), preexec_fn=hear, **streams)


def ended(process):
    """Wait for the end of a process, and return its exit code and its message."""
    _, stderr = process.communicate(timeout=PATIENCE)
    return process.returncode, stderr


def test_a_signal_ends_a_run_in_a_long_block_and_it_goes_on_with_the_command_it_names(forks):
    """Motions with damping come back to the same bits at once; those without take minutes."""
    changes = ("record.transient=5e8", "oscillator.h=[0.5, 0]", "oscillator.clearance=2")
    settings = [part for change in changes for part in ("--set", change)]
    arguments = ["run", "sweep.yaml", "-o", "long one.h5", *settings, "--threads", "1"]
    pid = forks.start(*arguments, folder=Path.cwd())
    done = wait_until(lambda: share_written(Path("long one.h5")), "the first block")
    assert call("info", "long one.h5").exit_code == 0  # while it is being written
    os.kill(pid, signal.SIGHUP)
    code, stderr = forks.ended()
    assert code == 1 and "; to go on: " in stderr and "Traceback" not in stderr, stderr
    message, resume = stderr.splitlines()[-1].split("; to go on: vibroimpact ")
    kept = int(message.split("interrupted; ")[1].split()[0].replace(",", ""))
    assert message.endswith(f"{kept:,} of 2,600 points kept in long one.h5.parts")
    assert 1300 >= kept >= 2600 * done > 0.0  # those with damping
    assert shlex.split(resume) == [*arguments, "--resume"]
    assert forks.run(*shlex.split(resume), "--dry-run", folder=Path.cwd()) == (0, "")
    assert sorted(path.name for path in Path().iterdir()) == ["long one.h5.parts", "sweep.yaml"]
    info = call("info", "long one.h5")
    assert f"2,600 points, of which {2600 - kept:,} PENDING (not computed yet)" in info.stdout


def test_a_process_notes_from_its_start_the_signals_that_end_work():
    assert NOTED == interrupts.SIGNAL_NAMES and len(interrupts.SIGNALS) >= 3


def test_signals_at_any_moment_end_a_run_with_one_line_until_it_is_complete(forks):
    signals = zip(ANSWERED, MOMENTS, strict=False)
    signalled(forks, KINDS[1], signals, random.Random(1))


def test_killed_at_any_moment_and_resumed_it_ends_with_the_same_bits(forks):
    kills = [(signal.SIGKILL, moment) for moment in ("creation", "block", "block")]
    signalled(forks, KINDS[2], kills, random.Random(1))


#: The process of a command, which receives a signal when it imports its n-th module.
_IMPORTING = """
import os, sys

number, last = int(sys.argv.pop(1)), int(sys.argv.pop(1))
imports = []

def note(event, arguments):
    if event == "import" and (imports or arguments[0] == "sweeps"):
        imports.append(arguments[0])
        if len(imports) == 1 + last:
            os.kill(os.getpid(), number)

sys.addaudithook(note)
from sweeps.cli.__main__ import main
main()
"""


@pytest.mark.parametrize(("imports", "number"), [*zip((1, 5, 30), ANSWERED, strict=False)])
def test_a_signal_while_a_command_imports_ends_it_with_one_line(imports, number):
    program = [sys.executable, "-c", _IMPORTING, str(number.value), str(imports)]
    process = run("--quiet", program=program)
    assert ended(process) == (1, "vibroimpact: error: interrupted\n")


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(300))
def test_1200_signals(forks, seed):
    draw = random.Random(seed)
    for numbers in (ANSWERED, [signal.SIGKILL]):
        signals = [(draw.choice(numbers), draw.choice(MOMENTS)) for _ in range(2)]
        signalled(forks, draw.choice(KINDS), signals, draw)


def test_an_interrupt_ends_a_compilation(monkeypatch, tmp_path, forks):
    """It ends before numba's next pass over a function: the kernel is never complete."""
    cache = tmp_path / "compiled"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache))
    process = run("-o", "out.h5", "--quiet")
    wait_until(Path("out.h5.lock").exists, "a run that begins")
    time.sleep(0.5)  # compilation takes ten
    process.send_signal(signal.SIGTERM)
    assert ended(process) == (1, "vibroimpact: error: interrupted; nothing is kept\n")
    kernel = "run_exact-*"
    assert list(cache_folder(WAY.name).glob(kernel))  # stored by other runs
    assert not list(cache.rglob(kernel))
    assert {path.name for path in Path().iterdir()} <= {"compiled", "sweep.yaml"}


def test_an_ignored_interrupt_stays_ignored():
    """As in a background run of a shell, where Ctrl-C is meant for the foreground."""
    process = subprocess.Popen(
        [sys.executable, "-m", "sweeps.cli", "run", "sweep.yaml", "--quiet"],
        env=environment(),
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    )
    while process.poll() is None:
        process.send_signal(signal.SIGINT)
        time.sleep(0.05)
    assert process.returncode == 0


@pytest.mark.parametrize(("unbuffered", "word"), [("", "--help"), ("1", "schema")])
def test_a_full_standard_output_is_told_from_a_file_whatever_its_buffer_is(unbuffered, word):
    """Also if the text is longer than the buffer."""
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "sweeps.cli", word]
        streams = {"stdout": full, "stderr": subprocess.PIPE, "text": True}
        env = {**environment(), "PYTHONUNBUFFERED": unbuffered}
        done = subprocess.run(command, env=env, **streams)
    said = "the standard output cannot be written: No space left on device\n"
    assert (done.returncode, done.stderr) == (1, f"vibroimpact: error: {said}")


def test_a_run_that_is_complete_is_not_interrupted_any_more(monkeypatch):
    """A signal after the last block does not affect a command, but reaches a Python caller."""
    complete = SweepWriter.finish

    def finish(self, *arguments, **options):
        complete(self, *arguments, **options)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(SweepWriter, "finish", finish)
    with pytest.raises(KeyboardInterrupt):
        run_sweep(load_config("sweep.yaml"), "out.h5")
    with open_sweep("out.h5") as dataset:
        assert (dataset["status"] != Status.PENDING).all()
