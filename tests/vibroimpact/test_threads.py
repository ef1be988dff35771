"""Many points on threads: beside other threads, in forked processes; runs that are interrupted."""

import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import numba
import numpy as np
import pytest

from tests.helpers.kernel_cases import METHODS, assert_same, one, random_points, steps_for
from vibroimpact import Oscillator, Status, integrate
from vibroimpact.kernel import threads as run
from vibroimpact.kernel.integrate import Length, run_points
from vibroimpact.kernel.lane import loop_of
from vibroimpact.kernel.workspace import LANES
from vibroimpact.step.recorder import trace, trajectories
from vibroimpact.step.scheme import scheme_of

PROGRAM = """
import multiprocessing
import numpy as np
from concurrent.futures import ThreadPoolExecutor
from vibroimpact import Oscillator
from vibroimpact import integrate

points = np.repeat(Oscillator(h=0.1, R=0.8, omega=2.0, f=1.0).at(), 256)
points["omega"] = np.linspace(2.0, 2.5, 256)

def run(impact):
    return integrate(points, impact=impact, transient=10, periods=5, threads=2)["poincare_x"]

rules = ["plain", "reduced-step", "exact"] * 3
here = {rule: run(rule) for rule in rules}
for pool in (multiprocessing.get_context("fork").Pool(2), ThreadPoolExecutor(3)):
    with pool:
        for rule, there in zip(rules, pool.map(run, rules)):
            np.testing.assert_array_equal(there, here[rule])
"""


@pytest.mark.slow
def test_calls_in_forked_processes_and_in_threads():
    environment = os.environ | {"NUMBA_NUM_THREADS": "2"}
    command = [sys.executable, "-c", PROGRAM]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr


#: A block has at least so many points with exact impacts, where there are several.
FEWEST = 64


def points(n):
    oscillators = [Oscillator(h=0.1, R=0.8, omega=w, f=1.0) for w in np.linspace(2.0, 2.5, n)]
    return np.concatenate([osc.at() for osc in oscillators])


@pytest.mark.parametrize(
    ("given", "blocks", "expected"),
    [(1, 8, 1), (3, 8, 3), (3, 2, 2), (None, 64, numba.config.NUMBA_NUM_THREADS)],
)
def test_no_more_threads_than_asked_for_or_than_blocks(monkeypatch, given, blocks, expected):
    """All by default, beside the caller's, which waits; and none is left after the call."""
    started = []
    start = threading.Thread.start
    monkeypatch.setattr(threading.Thread, "start", lambda t: started.append(t) or start(t))
    before = set(threading.enumerate())
    integrate(points(blocks * FEWEST), transient=100, periods=5, threads=given)
    assert 1 <= len(started) <= expected  # fewer where one ended before the next was started
    assert set(threading.enumerate()) <= before


def test_where_no_thread_can_be_started_the_caller_does_the_work(monkeypatch):
    """As under a limit on memory or on processes."""
    expected = integrate(points(256), transient=5, periods=5, threads=1)

    def refuse(thread):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refuse)
    found = integrate(points(256), transient=5, periods=5, threads=4)
    for name, values in found.items():
        np.testing.assert_array_equal(values, expected[name])


def test_no_two_loops_have_one_name():
    """Numba's own cache writes functions of one name to one index, without a lock."""
    exact = {
        loop_of(True, False, e, w).py_func.__name__ for e in (False, True) for w in (False, True)
    }
    steps = {
        loop_of(False, p, False, w).py_func.__name__ for p in (False, True) for w in (False, True)
    }
    assert len(exact | steps) == 8 and min(exact) == "run_exact"


def test_an_error_in_any_thread_is_raised(monkeypatch):
    caller = threading.get_ident()

    def fail(*arguments):
        if threading.get_ident() != caller:
            raise MemoryError
        time.sleep(0.1)

    monkeypatch.setattr(run, "compiled", lambda *arguments: fail)
    with pytest.raises(MemoryError):
        integrate(points(256), transient=5, periods=5, threads=2)


@pytest.mark.slow
@METHODS
def test_an_interrupted_run_keeps_the_points_that_are_complete(rule, integrator):
    """What is complete has the bits of a whole run, and the rest is pending: NaN and no count."""
    points = random_points(3 * LANES)
    method = integrator, rule, steps_for(points, rule)
    length = Length(4_000 if rule == "plain" else 500, 5, 64)
    arguments = points, scheme_of(points, *method), length, False
    names = dict(zip(("integrator", "impact", "steps_per_period"), method, strict=True))
    whole = integrate(points, **names, transient=length.transient, periods=length.periods)
    began = time.perf_counter()
    complete = run_points(*arguments, 1, np.zeros(1, np.int64))
    del complete["begun"]
    assert_same(complete, whole)
    delay, pending = time.perf_counter() - began, np.zeros(1, bool)
    while not pending[-1] and delay > 1e-6:  # the last block is begun last
        delay *= 0.5
        interrupt = np.zeros(1, np.int64)
        timer = threading.Timer(delay, interrupt.fill, (1,))
        timer.start()
        out = run_points(*arguments, 1, interrupt)
        timer.join()
        pending = out["status"] == Status.PENDING
    if not pending[-1]:  # on a busy machine no timer may come before the end
        out = run_points(*arguments, 1, np.ones(1, np.int64))
        pending = out["status"] == Status.PENDING
    assert pending[-1]
    for name in whole:
        np.testing.assert_array_equal(out[name][~pending], whole[name][~pending], err_msg=name)
        if out[name].dtype.kind == "f":
            assert np.isnan(out[name][pending]).all()
        elif name != "status":
            assert (out[name][pending] == 0).all()


def test_a_run_of_days_ends_when_it_is_interrupted():
    """Also one whose point would take days, and one that is interrupted before it begins."""
    interrupt, chaos = np.zeros(1, np.int64), one(h=0.0, R=0.8, omega=2.8)
    timer = threading.Timer(0.2, interrupt.fill, (1,))
    timer.start()
    scheme = scheme_of(chaos, "exact", "exact", None)
    out = run_points(chaos, scheme, Length(10**9, 1, 0), False, None, interrupt)
    assert interrupt[0] and out["status"] == Status.PENDING
    extent = {"periods": 10**6, "every": 10**12}
    log, status = trace(chaos, scheme, **extent, interrupt=interrupt)
    assert status is Status.PENDING and len(log) == 0
    out = trajectories(chaos, scheme, **extent, interrupt=interrupt)
    assert all(len(samples) == 0 for (samples,) in out.values())
    timer = threading.Timer(0.2, interrupt.fill, (1,))
    interrupt[0] = 0
    timer.start()
    assert trace(chaos, scheme, **extent, interrupt=interrupt)[1] < 0


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no /proc")
def test_an_interrupted_run_does_not_fill_the_room_of_its_trajectories():
    """Which may be larger than the memory."""

    def taken():
        status = Path("/proc/self/status").read_text()
        return 1024 * int(re.search(r"VmRSS:\s*(\d+)", status)[1])

    points, interrupt = np.concatenate([one(omega=2.8)] * 16), np.ones(1, np.int64)
    scheme = scheme_of(points, "exact", "exact", None)
    trajectories(points, scheme, periods=1)  # compiles
    before = taken()
    room = trajectories(points, scheme, periods=10**5, every=10**12, interrupt=interrupt)
    assert taken() - before < 10**8 < 16 * 8 * 10**5 * 24
    assert all(len(samples) == 0 for samples in room["trajectory_x"])


INTERRUPTED = """
import os, signal, threading
from vibroimpact import Oscillator, integrate, simulate
osc = Oscillator(h=0.0, R=0.8, omega=2.8, f=1.0)  # chaotic: another motion would come back
for run in (simulate, lambda osc, **many: integrate(osc.at(), **many)):
    run(osc, periods=1)
    try:
        threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
        run(osc, transient=10**9, periods=1)
    except KeyboardInterrupt:
        print("interrupted")
"""


@pytest.mark.slow
def test_ctrl_c_ends_a_run_of_hours():
    command = [sys.executable, "-c", INTERRUPTED]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.stdout.split() == ["interrupted"] * 2, done.stderr
