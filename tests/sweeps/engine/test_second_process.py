"""What a run says while it compiles, and the process that compiles beside it."""

import io
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import redirect_stderr

import numpy as np
import psutil
import pytest

from sweeps.engine import sweep_run
from sweeps.text import progress_shown
from tests.helpers.interruptions import wait_until
from vibroimpact.jit import COMPILING
from vibroimpact.jit.watching import tell
from vibroimpact.kernel.integrate import Length, run_points
from vibroimpact.kernel.threads import compile_search, find_all_exact
from vibroimpact.oscillator import Oscillator
from vibroimpact.step.scheme import Scheme

WAITING = "waiting for another process, which compiles the same"


@pytest.fixture
def started(monkeypatch):
    """Count the processes that would be started."""
    started = []
    monkeypatch.setattr(sweep_run, "compile_beside", lambda: started.append(1))
    monkeypatch.setattr(sweep_run, "ALL_THREADS", 2)
    return started


def prepared(told, *, cores=None, classes=True, function="run_exact"):
    """Return what is written while a compilation tells these texts."""
    with sweep_run.compiling_beside(cores, classes), redirect_stderr(io.StringIO()) as stream:
        with progress_shown("preparing"):
            for text in told:
                tell(text, function)
    return stream.getvalue()


def test_in_a_log_a_compilation_is_one_line(started, monkeypatch):
    assert prepared([COMPILING, "", COMPILING, ""]) == COMPILING + "\n"
    assert prepared([WAITING] * 3 + [""]) == WAITING + "\n"
    assert prepared([]) == ""
    monkeypatch.setenv("FORCE_COLOR", "1")  # as on a terminal
    assert "compiling" in prepared([COMPILING])


def test_a_process_is_started_once_by_the_one_that_compiles_where_there_is_a_core(started):
    for few in ({"cores": 1}, {"classes": False}, {"function": "fill_waves"}):
        prepared([COMPILING, "", COMPILING], **few)
    prepared([WAITING, ""])  # another process compiles, and started one
    assert not started
    prepared([COMPILING, "", COMPILING, ""])
    assert len(started) == 1


@pytest.mark.parametrize("lack", ["memory", "system", "process"])
def test_without_memory_another_system_or_a_process_nothing_else_is_started(monkeypatch, lack):
    calls = []

    def fork():
        calls.append(1)
        raise OSError("no more processes")

    monkeypatch.setattr(os, "fork", fork, raising=False)
    monkeypatch.setattr(sys, "platform", "darwin" if lack == "system" else "linux")
    monkeypatch.setattr(sweep_run, "compile_search", lambda begin: None)
    monkeypatch.setattr(sweep_run, "available_memory", lambda: 2**29 - (lack == "memory"))
    sweep_run.compile_beside()
    assert len(calls) == (lack == "process")


def ended(others):
    """Whether the processes that this one started after `others` end; end them."""
    _, alive = psutil.wait_procs(set(psutil.Process().children()) - others, 300.0)
    for copy in alive:
        copy.kill()
    return not alive


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux copies a process that works")
def test_the_copy_never_goes_on_with_the_work_of_the_first_process(monkeypatch, tmp_path):
    """Not even if a signal raises an exception at once."""
    fork, parent, others = os.fork, os.getpid(), set(psutil.Process().children())

    def interrupted():
        if copy := fork():
            return copy
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fork", interrupted)
    monkeypatch.setattr(sweep_run, "compile_search", lambda begin: None)
    monkeypatch.setattr(sweep_run, "available_memory", lambda: 2**40)
    try:
        sweep_run.compile_beside()
    finally:
        (tmp_path / str(os.getpid())).touch()
        if os.getpid() != parent:
            os._exit(1)
    assert ended(others)
    assert [path.name for path in tmp_path.iterdir()] == [str(parent)]


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux copies a process that works")
def test_a_copy_that_waits_for_a_lock_of_a_lost_thread_ends(monkeypatch):
    """Also where the program has a handler for the alarm, or blocks it."""

    def hang(begin=False):
        while not begin:
            time.sleep(1.0)

    monkeypatch.setattr(sweep_run, "compile_search", hang)
    monkeypatch.setattr(sweep_run, "available_memory", lambda: 2**40)
    monkeypatch.setattr(sweep_run, "LONGEST_WAIT", 0.1, raising=False)
    others = set(psutil.Process().children())
    handler = signal.signal(signal.SIGALRM, lambda *_: None)
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGALRM})
    try:
        beside = threading.Thread(target=sweep_run.compile_beside)  # as a run does
        beside.start()
        beside.join()
        assert ended(others)
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGALRM})
        signal.signal(signal.SIGALRM, handler)


def test_the_other_process_compiles_what_a_run_needs():
    """The same form: else it would be compiled twice."""
    points, interrupt = Oscillator(h=0.1, R=0.8, omega=2.6, f=1.0).at(), np.zeros(1, np.int64)
    scheme = Scheme.of("exact", "exact", 25, 0.0)
    run_points(points, scheme, Length(0, 2, 4), False, 1, interrupt, classes=True)
    compile_search()
    assert len(find_all_exact.overloads) == 1


SHARED = """
import gc
from contextlib import suppress
from numba.core.event import RecordingListener, install_listener
from numba.core.registry import cpu_target
from vibroimpact import Oscillator, integrate
from vibroimpact.jit import translate
from vibroimpact.kernel import threads
def without_machine_code(function, *arguments):
    translate(function, *arguments)
    raise InterruptedError
def lowered():
    return [event.data["qualname"] for _, event in passes.buffer
            if event.is_start and event.data["name"] == "native_lowering"]
gc.disable()  # a quarter of the time
threads.compiled, passes = without_machine_code, RecordingListener()
cpu_target.target_context.refresh()
with install_listener("numba:run_pass", passes):
    threads.compile_search(begin=True)
    with suppress(InterruptedError):
        integrate(Oscillator(h=0.1, R=0.8, omega=2.6, f=1.0).at(), transient=1, periods=1)
    unasked = set(lowered())
    with suppress(InterruptedError):
        threads.compile_search()
lowered = lowered()
assert "run_exact" in unasked and not unasked & {"normalise_lanes", "find_all_exact"}
for shared in ("take_exact_grid_step", "rests_alike_exactly", "run_exact", "find_all_exact"):
    assert lowered.count(shared) == 1, lowered
"""


@pytest.mark.slow
def test_a_run_compiles_no_classes_and_exponents_unasked_and_nothing_twice():
    subprocess.run([sys.executable, "-c", SHARED], check=True)


PARENT = """
import os
from sweeps.engine import sweep_run
from vibroimpact import Oscillator, integrate
fork, parent, search = os.fork, os.getpid(), sweep_run.compile_search
def start():
    copy = fork()
    if os.getpid() == parent:
        print(copy, flush=True)
    return copy
os.fork = start
sweep_run.compile_search = lambda begin=False: begin or search()  # not what both need
sweep_run.available_memory = lambda: 2**40
sweep_run.ALL_THREADS = 2
sweep_run.LONGEST_WAIT = 3600.0
with sweep_run.compiling_beside(None, True):
    integrate(Oscillator(h=0.1, R=0.8, omega=2.6, f=1.0).at(), transient=1, periods=1)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux copies a process that works")
@pytest.mark.slow
def test_the_other_process_ends_when_the_first_one_is_killed(tmp_path):
    """While it compiles, and it leaves neither code nor a lock."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", PARENT]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as parent:
        beside = psutil.Process(int(parent.stdout.readline()))
        lock = "find_all_exact-*.lock"
        wait_until(lambda: [*tmp_path.rglob(lock)] or not beside.is_running(), "a compilation")
        assert beside.is_running()
        parent.send_signal(signal.SIGKILL)
    beside.wait(600)
    assert not list(tmp_path.rglob("find_all_exact-*"))
