"""The kernel: every method, chatter, Lyapunov exponents, threads. Results are checked first."""

import dataclasses
import math
import time

import numba
import numpy as np
import pytest

from sweeps.bench.speed import RANGES, effort_of, points_over
from tests.benchmarks.limits import cpu_seconds
from tests.helpers.kernel_cases import EVERY_METHOD, integrated
from tests.vibroimpact.test_destination import spec_of
from vibroimpact import Oscillator, integrate, simulate
from vibroimpact.jit import on_threads
from vibroimpact.kernel import threads as run
from vibroimpact.points.computation import compute_points
from vibroimpact.status import Evidence, Status

pytestmark = pytest.mark.benchmark(timer=cpu_seconds)


def along_omega(start, stop, count, **values):
    """Return points, and their oscillators, with omega in a range."""
    oscillators = [Oscillator(omega=w, f=1.0, **values) for w in np.linspace(start, stop, count)]
    return np.concatenate([one.at() for one in oscillators]), oscillators


#: Chaos with about one impact in every period: no motion comes back, so every period is computed.
POINTS, OSCILLATORS = along_omega(2.8, 2.95, 1024, h=0.02, R=0.9)
PERIODS = 100


@pytest.mark.parametrize(("integrator", "rule"), EVERY_METHOD)
def test_methods(race, rule, integrator):
    """Every method agrees with ``simulate``, bit for bit in chaos."""
    steps, record = 32 if rule == "exact" else 100, {"periods": 1, "impacts": 1}

    def ours():
        return integrated(POINTS, integrator, rule, steps, PERIODS - 1, **record, threads=1)

    found = race.run(f"{rule}, {integrator}", ours, amount=POINTS.size * PERIODS)
    for i in (0, 500, POINTS.size - 1):
        orbit = simulate(OSCILLATORS[i], PERIODS, integrator, rule, steps)
        assert (found["poincare_x"][i, 0], found["poincare_v"][i, 0]) == (orbit.x[-1], orbit.v[-1])
        assert (found["impacts_per_period"][i] > 0.0) == (orbit.impact_t[-1] > orbit.t[-1 - steps])


@pytest.mark.parametrize("name", RANGES)
def test_scenes(race, benchmark, name):
    """Exact impacts against the rule ``plain`` on the same points: chaos, rattling, rests, ...

    What they compute in a second is kept with the record of the benchmark.
    """
    points, record = points_over(RANGES[name], 1024), {"transient": 200, "periods": 100}

    def run(integrator="exact", rule="exact"):
        return integrate(points, integrator=integrator, impact=rule, **record, threads=1)

    done, steps = effort_of(points, {}, **record)
    plainly, _ = effort_of(points, {"impact": "plain"}, **record)
    found = race.run(
        f"exact / plain, {name}", run, lambda: run("newmark", "plain"),
        amount=done.periods, of_reference=plainly.periods,
    )  # fmt: skip
    best = benchmark.stats.stats.min
    benchmark.extra_info["periods_per_second"] = done.periods / best
    benchmark.extra_info["impacts_per_second"] = done.impacts / best
    benchmark.extra_info["steps_alone"] = done.alone / (done.periods * steps)
    assert np.isin(found["status"], [Status.CERTIFIED, Status.COMPUTED]).all()
    assert done.alone / (done.periods * steps) < 0.03


def test_everything_recorded(race):
    """Every impact of the record is counted, and the last of them kept."""

    def ours():
        return integrated(POINTS, "rk4", "plain", None, periods=PERIODS, threads=1)

    found = race.run("plain, rk4, all recorded", ours, amount=POINTS.size * PERIODS)
    orbit = simulate(OSCILLATORS[500], PERIODS, "rk4", "plain", 100)
    assert found["impacts_per_period"][500] == len(orbit.impact_v) / PERIODS
    np.testing.assert_array_equal(found["impact_v"][500], orbit.impact_v[-64:])


def test_chatter(race):
    """A complete chatter erases the past: the fraction of time at rest is the orbit's own."""
    points, oscillators = along_omega(0.1, 0.6, 2001, h=0.0, R=0.5)

    def ours():
        return integrate(points, transient=1, periods=20, threads=1)

    found = race.run("chatter", ours, amount=points.size * 21)
    assert (found["status"] == Status.CERTIFIED).all()
    for i in (800, 1200, 1600):  # at omega = 0.2 it lands without speed, at an ill-defined time
        began, ended = simulate(oscillators[i], 3).rests[1]
        share = (ended - began) * points["omega"][i] / (2.0 * math.pi)
        assert found["rest_fraction"][i] == pytest.approx(share, rel=1e-9)
    assert share == pytest.approx(0.171, abs=5e-4)  # omega = 0.5


def test_lyapunov(race):
    """Their sum is -2h + 2 ln R times the impacts per unit time."""
    points = POINTS[::4]  # short rounds are disturbed less often

    def run(lyapunov=True):
        return integrate(points, transient=0, periods=PERIODS, lyapunov=lyapunov, threads=1)

    name, how = "Lyapunov exponents on / off", {"of_reference": 1.0, "rounds": 40}
    found = race.run(name, run, lambda: run(False), **how)
    rate = found["impacts_per_period"] * points["omega"] / (2.0 * math.pi)
    expected = -2.0 * points["h"] + 2.0 * rate * np.log(points["R"])
    moving = np.isfinite(found["lyapunov"][:, 1])  # without a rest
    assert moving.mean() > 0.9
    np.testing.assert_allclose(found["lyapunov"].sum(axis=1)[moving], expected[moving], rtol=1e-9)


def race_of_classes(race, name, points, transient, periods):
    """Return the results with classes, after a race against the sweep without them."""
    spec = spec_of(points, "exact", transient, periods)
    without = dataclasses.replace(spec, period=False)

    def sweep(spec):
        return compute_points(spec, points, 1)

    return race.run(name, lambda: sweep(spec), lambda: sweep(without), of_reference=1.0)


def test_classes_of_a_map(race):
    """A map with chaos, long transients, rests and free motions; the shares of its classes."""
    R, omega = np.meshgrid(np.linspace(0.4, 0.95, 60), np.linspace(1.0, 2.6, 60), indexing="ij")
    points = Oscillator(h=0.03, R=0.8, omega=1.0, f=1.0, clearance=0.3).at().repeat(R.size)
    points["R"], points["omega"] = R.ravel(), omega.ravel()
    found = race_of_classes(race, "classes of a map on / off", points, 200, 32)
    evidence = found["class_evidence"]
    free = found["impacts_per_period"] == 0.0
    assert (evidence[free] == Evidence.FREE).mean() > 0.9
    assert 0.05 < (evidence <= Evidence.UNREACHED).mean() < 0.2


def test_classes_with_rests(race):
    """A diagram with chaos, and with rests whose repetitions do not divide the record."""
    points = Oscillator(h=0.1, R=0.8, omega=1.0, f=1.0).at().repeat(2048)
    points["omega"] = np.linspace(0.8, 4.0, 2048)
    found = race_of_classes(race, "classes of a diagram on / off", points, 300, 100)
    rests = (found["period"] > 0) & (found["rest_fraction"] > 0.0)
    assert (100 % found["period"][rests] != 0).sum() > 10


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="one core")
def test_threads(race, benchmark, monkeypatch):
    """Each takes what it can, beside other processes not half, and no bit changes."""
    shares = []

    def clocked(threads, interrupt, work, *arguments):
        spent = []

        def timed(*arguments):
            begin = time.thread_time()
            work(*arguments)
            spent.append(time.thread_time() - begin)

        on_threads(threads, interrupt, timed, *arguments)
        assert len(spent) == threads
        shares.append(max(spent) / sum(spent))

    alone = integrate(POINTS, transient=40 * PERIODS, periods=1, threads=1)
    monkeypatch.setattr(run, "on_threads", clocked)
    found = benchmark.pedantic(
        lambda: integrate(POINTS, transient=40 * PERIODS, periods=1, threads=2),
        rounds=10,
        warmup_rounds=1,
    )
    for name, values in found.items():
        np.testing.assert_array_equal(values, alone[name])
    race.hold("the busier thread's share of both threads' time", float(np.median(shares)))
