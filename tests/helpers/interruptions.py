"""Runs ended by a signal at random moments, and checks of the files.

The runs are forks of a process that has imported everything and loaded the kernel: they start at
once, and end like any Python process.
"""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from sweeps import StoreError, open_sweep
from sweeps.interrupts import SIGNALS
from sweeps.store.parts import finished_points
from tests.helpers.places import ROOT
from tests.helpers.sweep_files import data
from vibroimpact.status import Status

SWEEP = """\
oscillator: {h: 0.05, R: 0.8, omega: {start: 2.4, stop: 3.5, num: 1300}, f: 1.0}
record: {transient: 100, periods: 20, diagnostics: [period]}
"""
# 2,400 points in two directions, in three blocks.
FOLLOWED = [
    "follow={axis: omega, direction: both}",
    "oscillator={h: 0.05, R: {start: 0.5, stop: 0.8, num: 1200}, omega: [2.4, 3.0], f: 1}",
]
TRAJECTORY = "record={transient: 50, periods: 5, impacts: 8, trajectory: {every: 10}}"
#: Changes of the configuration: blocks of a grid, a compressed file, followed chains.
KINDS = [[], ["compression=gzip", TRAJECTORY], FOLLOWED]
#: Events after which a signal is sent, at most ``LATEST`` later.
MOMENTS = ("start", "creation", "block", "end")
#: Longest delay of a signal [s].
LATEST = 0.05
#: Signals that end a run with exit code 1; a kill does not.
ANSWERED = tuple(SIGNALS)
#: Longest time for a run to reach a moment or to react to a signal on a busy machine [s].
PATIENCE = 300.0

_FORKS = """
import gc, json, os, signal, sys
import sweeps.cli.main, sweeps.reports, sweeps.engine.sweep_run, sweeps.engine.estimate
from sweeps.cli.__main__ import main
from vibroimpact import Oscillator, integrate

integrate(Oscillator(h=0.1, R=0.8, omega=2.0, f=1.0).at())  # loads the kernel
sweeps.engine.estimate._TRIAL = 0.01  # as in the tests themselves
gc.freeze()  # forks do not search the shared objects when they end
for line in sys.stdin:
    request = json.loads(line)
    pid = os.fork()
    if pid == 0:
        for stream, name in enumerate(request["streams"], 1):
            os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
        os.chdir(request["folder"])
        sys.argv = ["vibroimpact", *request["arguments"]]
        main()
    print(pid, flush=True)
    print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)
"""


def environment() -> dict[str, str]:
    """Return the environment that lets a process find the packages and the compiled code."""
    kept = {name: value for name, value in os.environ.items() if name.startswith("NUMBA_")}
    return {"PYTHONPATH": str(ROOT), "PATH": "", "HOME": os.environ.get("HOME", ""), **kept}


def hear() -> None:
    """Let a new process receive Ctrl-C, even if this one runs in the background of a shell."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def wait_until(condition: Callable[[], object], what: str) -> object:
    """Wait until a condition holds, and return what it returned; fail if that never comes."""
    end = time.monotonic() + PATIENCE
    while not (held := condition()):
        assert time.monotonic() < end, f"waited {PATIENCE:g} s for {what}"
        time.sleep(0.02)
    return held


def command(changes: list[str], output: str = "out.h5") -> list[str]:
    """Return the arguments of a run with changes of the configuration."""
    settings = [part for change in changes for part in ("--set", change)]
    return ["run", "sweep.yaml", "-o", output, "--quiet", *settings]


class Forks:
    """Starts commands as forks of one process, one after the other.

    By default they run in `folder`, which is below `root`. Their output is in `root`.
    """

    def __init__(self, root: Path) -> None:
        self.folder = root / "runs"
        self.folder.mkdir()
        (self.folder / "sweep.yaml").write_text(SWEEP)
        self._streams = [str(root / name) for name in ("stdout.txt", "stderr.txt")]
        how = {"env": environment(), "text": True, "preexec_fn": hear}
        how |= {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        self._process = subprocess.Popen([sys.executable, "-c", _FORKS], **how)

    def __enter__(self) -> Forks:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.stdin.close()
        self._process.wait(PATIENCE)
        self._process.stdout.close()

    def start(self, *arguments: str, folder: Path | None = None) -> int:
        """Start a command; return its process id."""
        request = {"folder": str(folder or self.folder), "streams": self._streams}
        request["arguments"] = arguments
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        self._pid = int(self._process.stdout.readline())
        return self._pid

    def ended(self) -> tuple[int, str]:
        """Wait for the end of the command, or kill it; return its exit code and its stderr."""
        kill = threading.Timer(PATIENCE, os.kill, (self._pid, signal.SIGKILL))
        kill.start()
        code = int(self._process.stdout.readline())
        kill.cancel()
        return code, Path(self._streams[1]).read_text()

    def emptied(self) -> Path:
        """Return the folder after removing files of earlier runs."""
        for path in self.folder.iterdir():
            if path.name != "sweep.yaml" and not path.name.startswith("whole"):
                shutil.rmtree(path) if path.is_dir() else path.unlink()
        return self.folder

    def run(self, *arguments: str, folder: Path | None = None) -> tuple[int, str]:
        """Run a command to its end."""
        self.start(*arguments, folder=folder)
        return self.ended()

    def whole(self, changes: list[str]) -> Path:
        """Return the file of a run that no signal ended, which is made once."""
        path = self.folder / f"whole-{KINDS.index(changes)}.h5"
        assert path.exists() or self.run(*command(changes, path.name)) == (0, "")
        return path


def share_written(path: Path) -> float:
    """Return the share of written points of a sweep, 0 if it has not begun."""
    if path.exists():
        return 1.0
    done, points = finished_points(path) or (0, 1)
    return done / points


def _listens(pid: int) -> bool:
    """Whether a process has installed its handlers for both signals."""
    match = re.search(r"SigCgt:\s*([0-9a-f]+)", Path(f"/proc/{pid}/status").read_text())
    caught = int(match[1], 16)
    return all(caught & 1 << number - 1 for number in ANSWERED)


def _reached(moment: str, folder: Path, draw: random.Random) -> object:
    """Return a function of the process that tells whether the event has happened."""
    out = folder / "out.h5"
    if moment == "start":
        return _listens
    if moment == "creation":
        return lambda pid: any("out.h5" in name for name in os.listdir(folder))
    share = 1.0 if moment == "end" else draw.uniform(0.1, 0.9)
    return lambda pid: share_written(out) >= share


def signalled(
    forks: Forks, changes: list[str], signals: Iterable[tuple[int, str]], draw: random.Random
) -> None:
    """Send a run signals at moments, and resume it after each; check its ends and its files."""
    folder = forks.emptied()
    for number, moment in signals:
        pid = forks.start(*command(changes), "--resume")
        try:
            reached, began = _reached(moment, folder, draw), time.monotonic()
            while not (_listens(pid) and reached(pid)) and time.monotonic() - began < PATIENCE:
                time.sleep(0.002)
            time.sleep(draw.uniform(0.0, LATEST))
            os.kill(pid, number)
        except (OSError, IndexError, StoreError):  # the run has ended, or its file was replaced
            pass
        code, text = forks.ended()
        check_end(forks, number, code, text, changes)
    finish(forks, changes)


def check_end(forks: Forks, number: int, code: int, text: str, changes: list[str]) -> None:
    """Check the outcome of an interrupted run, and what can be read of it."""
    about = f"signal {number}, {changes}, exit code {code}:\n{text}"
    out, kept = forks.folder / "out.h5", re.search(r"interrupted; ([\d,]+) of ", text)
    if code == 0:
        assert text == "" and out.exists() and not Path(f"{out}.parts").exists(), about
    elif number in ANSWERED:
        assert code == 1 and text.count("\n") == 1, about
        assert text.startswith("vibroimpact: error: interrupted"), about
    else:
        assert code == -number, about
    if out.exists() or Path(f"{out}.parts/schema.h5").exists():
        with open_sweep(out) as dataset:
            done = dataset["status"].values != Status.PENDING
            assert np.isfinite(dataset["poincare_x"].values[done]).all(), about
        assert not kept or int(kept[1].replace(",", "")) == done.sum(), about
    if number in ANSWERED:
        left = {path.name for path in forks.folder.iterdir()}
        left -= {"out.h5", "out.h5.parts", "sweep.yaml"}
        assert not {name for name in left if not name.startswith("whole")}, (left, about)


def finish(forks: Forks, changes: list[str]) -> None:
    """Resume a run to its end; it has the same bits as one that no signal ended."""
    out = forks.folder / "out.h5"
    assert forks.run(*command(changes), "--resume") == (0, "")
    assert data(out).identical(data(forks.whole(changes)))
    out.unlink()
