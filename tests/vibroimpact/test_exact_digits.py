"""The exact rule: its digits on any processor, random points, constructed grazes."""

import cmath
import math
import os
import subprocess
import sys

import llvmlite.binding as llvm
import mpmath as mp
import numpy as np
import pytest

from tests.helpers import naive
from tests.helpers.kernel_cases import PERIOD, few_or_many, taken_apart, wide_points
from tests.helpers.oscillators import Flight, in_digits
from vibroimpact import Oscillator, Status, integrate, simulate
from vibroimpact.oscillator import POINT
from vibroimpact.step.chatter import rates_of, short_bounce
from vibroimpact.step.impact import Flight as Launch
from vibroimpact.step.propagator import coefficients_of
from vibroimpact.step.scheme import default_steps


def after_one_period(osc, x, v, most=12):
    """Return the state one forcing period after (x, v) at t = 0; None if impacts are too fast."""
    parameters, end, t = in_digits(osc), 2 * mp.pi / mp.mpf(osc.omega), mp.mpf(0)
    for _ in range(most):
        flight = Flight(parameters, t, x, v)
        grid = np.linspace(float(t), float(end), 3000)[1:]
        sampled, _ = naive.ClosedForm(osc, float(t), float(x), float(v))(grid)
        beyond = np.flatnonzero(sampled > osc.clearance)
        if not beyond.size:
            return flight(end)
        if beyond[0] == 0:
            return None  # a bounce shorter than the distance of two samples
        bracket = grid[beyond[0] - 1], grid[beyond[0]]
        x = parameters["clearance"]
        t = mp.findroot(lambda q, f=flight, x=x: f(q)[0] - x, bracket, solver="anderson")
        v = -parameters["R"] * flight(t)[1]
    return None


@pytest.mark.parametrize(("length", "clearance"), [(0.016, 0.1), (0.029, -0.27)])
def test_a_short_bounce_to_rounding(length, clearance):
    """Rebounds whose lengths times the rates of the system are below 0.03, from many phases."""
    osc = Oscillator(h=0.01, R=1.0, omega=0.1, f=1.0, p=2.5, clearance=clearance)
    eq, lengths = coefficients_of(osc.at(clearance)[0]), []
    for theta in np.linspace(4.2, 5.2, 15):
        s, c = math.sin(theta), math.cos(theta)
        press = eq.of_sin * s + eq.of_1
        w = -0.5 * length * press / (rates_of(eq) + abs(eq.of_sin * c) / press)
        t, w_i = short_bounce(eq, Launch(0.0, w, s, c, 0.0))
        assert t > 0.0
        with mp.workdps(40):
            omega = mp.mpf(osc.omega)
            t_0 = theta / omega
            flight = Flight(in_digits(osc), t_0, mp.mpf(clearance), omega * w)
            t_1 = mp.findroot(lambda q, f=flight: f(q)[0] - clearance, t_0 + t / omega)
            lengths.append(float(t / (omega * (t_1 - t_0)) - 1))
            assert w_i == pytest.approx(float(flight(t_1)[1] / omega), rel=1e-15, abs=0.0)
    assert max(map(abs, lengths)) < 5e-15


def test_a_bounce_is_short_only_where_its_series_is_exact():
    """Neither at the crest of a force that barely presses, nor where the force pulls."""
    taken = 0
    for press in (1e-4, 1e-3, 1e-2, 1.0, -1e-3, -1.0):
        osc = Oscillator(h=0.0, R=1.0, omega=1.0, f=1.0, p=0.1, clearance=(1.0 - press) / 0.01)
        eq = coefficients_of(osc.at(osc.clearance)[0])
        for length in np.geomspace(1e-4, 10.0, 200):
            t, _ = short_bounce(eq, Launch(0.0, -0.5 * length * abs(press), -1.0, 0.0, 0.0))
            taken += t > 0.0
            if t != -1.0:
                assert press > 0.0
                with mp.workdps(40):
                    w = mp.mpf(-0.5 * length * abs(press))
                    flight = Flight(in_digits(osc), 1.5 * mp.pi, mp.mpf(osc.clearance), w)
                    stop = osc.clearance
                    back = mp.findroot(
                        lambda q, f=flight, stop=stop: f(q)[0] - stop, 1.5 * mp.pi + t
                    )
                    error = float(t / (back - 1.5 * mp.pi) - 1)
                assert abs(error) < 5e-15 + 4e-16 / press  # the rounding of the force
    assert taken > 50


@pytest.mark.slow
def test_the_median_error_after_one_period_is_below_1e_15():
    """Of 120 points; relative to the size of the motion."""
    rng = np.random.default_rng(5)
    points = np.zeros(120, POINT)
    ranges = {"h": (0.0, 0.6), "R": (0.2, 1.0), "omega": (0.7, 4.0), "clearance": (-0.2, 0.8)}
    for name, ends in ranges.items():
        points[name] = rng.uniform(*ends, points.size)
    points["f"] = points["p"] = 1.0
    points["x0"] = points["clearance"] - rng.uniform(0.1, 2.0, points.size)
    points["v0"] = rng.normal(0.0, 1.0, points.size)
    results = integrate(points, transient=0, periods=1, threads=1)
    errors, impacts = [], 0.0
    with mp.workdps(40):
        for i, point in enumerate(points):
            osc, x0, v0 = taken_apart(point)
            state = after_one_period(osc, x0, v0)
            if state is not None:
                size = max(abs(x0), abs(v0), *map(abs, state))
                ours = results["poincare_x"][i, 0], results["poincare_v"][i, 0]
                gaps = (abs(a - b) for a, b in zip(ours, state, strict=True))
                errors.append(float(max(gaps) / size))
                impacts += results["impacts_per_period"][i]
    assert len(errors) > 90 and impacts > 0.7 * len(errors)
    assert np.median(errors) < 1e-15
    assert np.quantile(errors, 0.9) < 3e-15


@pytest.mark.parametrize("R", [0.1, 0.3, 0.6, 0.8, 0.9])
@pytest.mark.parametrize(("clearance", "f"), [(-1.5, 1.0), (0.3, 1.0), (40.0, 100.0)])
def test_the_time_of_rest_does_not_depend_on_the_steps(R, clearance, f):
    """A bounce has the digits of its own height, however far the stop is from 0."""
    osc = Oscillator(h=0.05, R=R, omega=0.15, f=f, clearance=clearance)
    rests = [
        simulate(osc, 2, steps_per_period=n, x0=clearance, v0=-0.1 * f).rests[:, 0]
        for n in (None, 47, 64, 150, 400)
    ]
    assert len(rests[0]) >= 1
    for other in rests[1:]:
        np.testing.assert_allclose(other, rests[0], rtol=0.0, atol=1e-13)


PROGRAM = """\
import hashlib
import sys
import numpy as np
from vibroimpact import Oscillator
from vibroimpact.kernel.integrate import Length, run_points
from vibroimpact.step.scheme import scheme_of
points = np.concatenate(
    [Oscillator(h=0.1, R=R, omega=omega, f=1.0 + omega / 9.0, clearance=c).at(min(c, 0.0))
     for omega in np.linspace(0.2, 4.0, 30) for R in (0.3, 0.8) for c in (-0.1, 0.0, 0.2)]
)
for method in sys.argv[1:]:
    integrator, impact = method.split("/")
    scheme = scheme_of(points, integrator, impact, 600, phase=0.1)
    length = Length(5, 20, 64)
    classes = len(sys.argv) > 2
    out = run_points(points, scheme, length, impact == "exact", 1, np.zeros(1, int), classes)
    for name in sorted(out):
        print(impact, name, hashlib.sha256(out[name].tobytes()).hexdigest())
"""


METHODS = "exact/exact", "rk4/plain", "newmark/reduced-step", "rk4/cubic"


def digests(methods=METHODS, **settings):
    """Return the digests of results of methods, computed by a process with these settings."""
    command, environment = [sys.executable, "-c", PROGRAM, *methods], os.environ | settings
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.count("\n") > 12 * len(methods)
    return done.stdout


@pytest.fixture(scope="module")
def usual_digests():
    return digests()


@pytest.mark.parametrize(
    "methods",
    [
        pytest.param(METHODS[:1], marks=pytest.mark.slow),
        pytest.param(METHODS, marks=pytest.mark.campaign),
    ],
)
@pytest.mark.skipif(
    not llvm.get_host_cpu_features().get("avx512f"), reason="a processor without wide vectors"
)
def test_a_processor_with_narrower_vectors_gives_the_same_bits(usual_digests, methods):
    """Compiled for AVX2, and for this processor with its vectors of 512 bits.

    The classes, which take as long to compile, are in the campaign alone. Compiled code is kept
    under the processor's name and features: neither takes the other's.
    """
    features = [
        ("-" if name.startswith(("avx512", "evex")) or not there else "+") + name
        for name, there in llvm.get_host_cpu_features().items()
    ]
    settings = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": ",".join(features)}
    assert set(digests(methods, **settings).splitlines()) <= set(usual_digests.splitlines())


@pytest.mark.slow
def test_another_mathematical_library_gives_the_same_bits(usual_digests):
    """The functions of glibc for processors without FMA differ from the others in last bits."""
    assert digests(GLIBC_TUNABLES="glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4") == usual_digests


@pytest.mark.slow
def test_random_points_end_decided():
    """2000 points, 50 periods: no NaN, nothing beyond the stop, a matching status."""
    points = wide_points(2000, 17)
    for part in np.array_split(points, 10):
        out = integrate(part, transient=0, periods=50, lyapunov=True)
        for name in ("poincare_x", "poincare_v", "impacts_per_period", "rest_fraction"):
            assert np.isfinite(out[name]).all()
        assert not np.isnan(out["lyapunov"]).any()
        assert (out["max_penetration"] <= 1e-12).all()
        assert (out["poincare_x"] <= part["clearance"][:, None]).all()
        assert ((out["rest_fraction"] >= 0.0) & (out["rest_fraction"] <= 1.0 + 1e-12)).all()
        decided = (Status.CERTIFIED, Status.CUT_SHORT, Status.UNBOUNDED)
        assert np.isin(out["status"], decided).all()
        assert (part["R"][out["status"] == Status.CUT_SHORT] > 0.99).all()
        assert not (out["status"] == Status.UNBOUNDED).any()


@pytest.mark.slow
def test_no_impact_depends_on_how_many_share_a_step():
    """4000 points, 4 periods, with long steps and short ones: the same impacts, speeds, sections.

    In long steps flights follow one another. Where a chatter was summed up or R is nearly 1, the
    number of impacts, or what becomes of a rounding, depends on the steps.
    """
    points, alike = wide_points(4000, 31), 0
    points["h"] *= 0.3
    points["omega"] = np.geomspace(0.3, 6.0, points.size)
    for part in np.array_split(points, 20):
        most = default_steps(part, "exact")
        how = {"transient": 0, "periods": 4}
        few, many = (integrate(part, steps_per_period=n, **how) for n in (most, 4 * most + 1))
        np.testing.assert_array_equal(few["status"], many["status"])
        same = (few["chatters"] == 0) & (part["R"] < 0.99) & (few["slowest_impact"] > 1e-4)
        np.testing.assert_array_equal(few["chatters"][same], many["chatters"][same])
        impacts = few["impacts_per_period"][same]
        np.testing.assert_array_equal(impacts, many["impacts_per_period"][same])
        for name in ("poincare_x", "poincare_v", "slowest_impact", "fastest_impact"):
            np.testing.assert_allclose(few[name][same], many[name][same], atol=1e-7)
        alike += (impacts > 1.0).sum()
    assert alike > 500


@few_or_many("every", 400, 1)
@pytest.mark.parametrize("shaken", [False, True])
def test_random_points_are_those_of_the_slow_solver(every, shaken):
    """2000 points, or 5: sections, impacts and rests to 1e-9, with a force or with a shaken base.

    10 periods or 500 impacts, chatters included; from a graze within 1e-6 on, none is compared.
    """
    points = wide_points(2000, 23)[::every]
    if shaken:
        rng = np.random.default_rng(24)
        points["a"] = rng.uniform(0.2, 2.0, len(points)) / (1.0 + points["omega"] ** 2)
        points["f"] *= rng.choice([0.0, 0.5], len(points))
    grazed, sections, impacts, rested = 0, 0, 0, 0
    for point in points:
        osc, x0, v0 = taken_apart(point)
        slow = naive.ExactOrbit(osc, 10, x0, v0, most=500)
        tr = simulate(osc, 10, x0=x0, v0=v0)
        known = np.array(slow.sections).reshape(-1, 2)
        end = min(slow.graze, slow.reached, slow.end) * (1 + 1e-13)
        grazed += slow.graze < slow.reached
        compared = int((np.arange(1, len(known) + 1) * osc.forcing_period <= end).sum())
        ours = np.column_stack([tr.section_x, tr.section_v])
        np.testing.assert_allclose(ours[:compared], known[:compared], atol=1e-9)
        hits = np.array(slow.impacts).reshape(-1, 2)
        hits = hits[(hits[:, 0] < end - 1e-6) & (hits[:, 1] > 1e-4)]
        if len(hits):
            nearest = np.abs(tr.impact_t[:, None] - hits[:, 0]).argmin(axis=0)
            np.testing.assert_allclose(tr.impact_t[nearest], hits[:, 0], atol=1e-9)
            np.testing.assert_allclose(tr.impact_v[nearest], hits[:, 1], atol=1e-9)
        rests = np.array([r for r in slow.rests if r[1] < end]).reshape(-1, 2)
        np.testing.assert_allclose(tr.rests[: len(rests)], rests, atol=1e-9)
        sections += compared
        impacts += len(hits)
        rested += len(rests)
    assert 10 * grazed < len(points)
    assert sections > 5 * len(points) and impacts > 10 * len(points) and rested > len(points)


def graze(rng):
    """A point, the time of its highest point, the acceleration there, and how far beyond it lies.

    The flight is followed back from there with 40 digits; None where it meets the stop before, or
    where rounding its start moves that point by a hundredth of the distance.
    """
    osc = naive.oscillator(
        h=rng.choice([0.0, rng.uniform(0, 1)]), R=0.9 * rng.random(),
        omega=0.3 * 15.0 ** rng.random(), f=rng.uniform(0.2, 3), p=rng.uniform(0.5, 2),
        clearance=rng.choice([0.0, rng.normal()]),
    )  # fmt: skip
    height = rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-12, -5)
    top = rng.uniform(0.02, 0.98) * PERIOD / osc.omega
    s, c = math.sin(osc.omega * top), math.cos(osc.omega * top)
    a = -osc.f * s - osc.p**2 * osc.clearance
    if a > -0.1:
        return None
    x, v = naive.flow(osc, osc.clearance + height, 0.0, s, c, -top)
    before = np.arange(0.0, top - 0.02, 0.005)
    path, _ = naive.ClosedForm(osc, 0.0, x, v)(before)
    if (
        abs(height) < 1e-14 * (abs(x) + abs(v))
        or before.size == 0
        or path.max() > osc.clearance - 1e-4
    ):
        return None
    values = osc.h, osc.R, osc.omega, osc.f, osc.p, osc.clearance, 0.0, x, v, 0.0
    return values, top, a, height


@few_or_many("count", 300, 20_000)
def test_a_touch_is_seen_and_a_miss_is_none(count):
    """From 1e-12 to 1e-5 beyond the stop, or below it, anywhere in a step of any length.

    A miss by less than 1e-9 of the extent of the motion is a near graze.
    """
    rng = np.random.default_rng(17)
    made = (graze(rng) for _ in range(100 * count))
    found = [one for one, _ in zip(filter(None, made), range(count), strict=False)]
    values, top, a, height = (np.array(column) for column in zip(*found, strict=True))
    points = np.zeros(count, POINT)
    for name, column in zip(POINT.names, values.T, strict=True):
        points[name] = column
    phase, touches = points["omega"] * top, height > 0.0
    assert 0.3 < touches.mean() < 0.7
    h, omega, f, p, stop = (points[name] for name in ("h", "omega", "f", "p", "clearance"))
    extent = (f + p**2 * abs(stop)) / (omega**2 + 2.0 * h * omega + p**2)
    gap = -height / extent
    clear = abs(gap - 1e-9) > 1e-10  # to a tenth, the rounding of the start moves the highest point
    for share in (1, 2, 5, 20):
        steps = share * default_steps(points, "exact")
        out = integrate(points, steps_per_period=steps, transient=0, periods=1, impacts=500)
        assert (out["impacts_per_period"] < 500).all()
        with np.errstate(invalid="ignore"):  # NaN without an impact
            early = out["impact_phase"][:, 0] < phase + 0.01 * points["omega"]
        np.testing.assert_array_equal(early, touches)
        near = (gap > 0.0) & (gap < 1e-9)
        np.testing.assert_array_equal(out["near_grazes"][clear], near[clear])
        time = out["impact_phase"][touches, 0] / points["omega"][touches]
        half = np.sqrt(2.0 * height / np.abs(a), where=touches, out=np.zeros(count))[touches]
        np.testing.assert_allclose(top[touches] - time, half, rtol=0.05)
        speed = out["impact_v"][touches, 0]
        np.testing.assert_allclose(speed, half * np.abs(a[touches]), rtol=0.05)


@pytest.mark.parametrize("share", [0.0, 1e-9, 0.25, 0.5, 0.9, 1.0 - 1e-9])
@pytest.mark.parametrize("h", [0.0, 0.1, 0.7])
def test_every_near_graze_of_the_free_oscillation_is_counted(h, share):
    """One per period if it turns within 1e-9 of its extent below the stop, else none.

    It turns after this share of a step, whatever the number of steps. At 0 the end of the step is
    the turning point, to rounding.
    """
    for omega in (0.6, 0.8, 1.7, 2.0):
        X = -1.0 / complex(1.0 - omega**2, 2.0 * h * omega)
        extent = (1.0 + abs(X)) / (omega**2 + 2.0 * h * omega + 1.0)
        gaps = 1e-9 * extent * np.array([0.1, 0.5, 0.98, 1.02, 5.0])
        oscillators = [Oscillator(h, 0.8, omega, 1.0, clearance=abs(X) + gap) for gap in gaps]
        points = np.concatenate([osc.at(X.imag, omega * X.real) for osc in oscillators])
        for steps in (None, 27, 40, 64, 100, 400):
            begin = 0.5 * math.pi - cmath.phase(X) - (3.0 + share) * PERIOD / (steps or 40)
            how = {"steps_per_period": steps, "phase": begin % PERIOD}
            out = integrate(points, transient=0, periods=10, **how)
            np.testing.assert_array_equal(out["near_grazes"], [10, 10, 10, 0, 0])
            assert (out["impacts_per_period"] == 0.0).all()
