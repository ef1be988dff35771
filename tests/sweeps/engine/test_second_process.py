"""What a run says while it compiles, and the process that compiles beside it."""

import io
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import psutil
import pytest
from rich.console import Console

from sweeps.engine import second_process
from vibroimpact.jit import COMPILING
from vibroimpact.jit.cache import tell
from vibroimpact.kernel.integrate import Length, run_points
from vibroimpact.kernel.threads import compile_search, find_all_exact
from vibroimpact.oscillator import Oscillator
from vibroimpact.step.scheme import Scheme

WAITING = "waiting for another process, which compiles the same"


@pytest.fixture
def started(monkeypatch):
    """Count the processes that would be started."""
    started = []
    monkeypatch.setattr(second_process, "compile_beside", lambda: started.append(1))
    monkeypatch.setattr(second_process, "ALL_THREADS", 2)
    return started


def prepared(told, *, terminal=False, cores=None, classes=True):
    """Return what is written while a compilation tells these texts."""
    stream = io.StringIO()
    with second_process.preparing(Console(file=stream, force_terminal=terminal), cores, classes):
        for text in told:
            tell(text)
    return stream.getvalue()


def test_in_a_log_a_compilation_is_one_line(started):
    assert prepared([COMPILING, "", COMPILING, ""]) == COMPILING + "\n"
    assert prepared([WAITING] * 3 + [""]) == WAITING + "\n"
    assert prepared([]) == ""
    assert "compiling" in prepared([COMPILING], terminal=True)


def test_a_process_is_started_once_by_the_one_that_compiles_where_there_is_a_core(started):
    for few in ({"cores": 1}, {"classes": False}):
        prepared([COMPILING, "", COMPILING], **few)
    prepared([WAITING, ""])  # another process compiles, and started one
    assert not started
    prepared([COMPILING, "", COMPILING, ""])
    assert len(started) == 1


@pytest.mark.parametrize("lack", ["memory", "python", "process"])
def test_without_memory_python_or_a_process_nothing_else_is_started(monkeypatch, lack):
    calls = []

    def start(*arguments, **options):
        calls.append(arguments)
        raise OSError("no more processes")

    monkeypatch.setattr(subprocess, "Popen", start)
    monkeypatch.setattr(second_process, "available_memory", lambda: 2**29 - (lack == "memory"))
    if lack == "python":
        monkeypatch.setattr(sys, "executable", "/opt/program")
    second_process.compile_beside()
    for thread in threading.enumerate():
        if thread.daemon and thread.name.endswith("(run)"):
            thread.join()
    assert len(calls) == (lack == "process")


def test_the_other_process_compiles_what_a_run_needs():
    """The same form: else it would be compiled twice."""
    points, interrupt = Oscillator(h=0.1, R=0.8, omega=2.6, f=1.0).at(), np.zeros(1, np.int64)
    scheme = Scheme.of("exact", "exact", 25, 0.0)
    run_points(points, scheme, Length(0, 2, 4), False, 1, interrupt, classes=True)
    compile_search()
    assert len(find_all_exact.overloads) == 1


PLAIN_RUN = """
from vibroimpact import Oscillator, integrate
from vibroimpact.kernel import loop, threads
integrate(Oscillator(h=0.1, R=0.8, omega=2.6, f=1.0).at(), transient=1, periods=1)
assert loop.run_exact.signatures
assert not loop.run_exact_with_exponents.signatures and not threads.find_all_exact.signatures
"""


@pytest.mark.slow
def test_a_run_without_classes_and_exponents_compiles_nothing_of_them():
    subprocess.run([sys.executable, "-c", PLAIN_RUN], check=True)


PARENT = """
import subprocess, sys, time
from sweeps.engine import second_process
popen = subprocess.Popen
def start(*arguments, **options):
    process = popen(*arguments, **options)
    print(process.pid, flush=True)
    return process
subprocess.Popen = start
second_process.available_memory = lambda: 2**40
second_process.compile_beside()
time.sleep(600)
"""


@pytest.mark.slow
def test_the_other_process_ends_when_the_first_one_is_killed(tmp_path):
    """While it compiles, and it leaves neither code nor a lock."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", PARENT]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as parent:
        beside = psutil.Process(int(parent.stdout.readline()))
        deadline = time.monotonic() + 120
        while not list(tmp_path.rglob("find_all_exact-*.lock")) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert beside.is_running()
        parent.send_signal(signal.SIGKILL)
    beside.wait(60)
    assert not list(tmp_path.rglob("find_all_exact-*"))
