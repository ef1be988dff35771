"""The digits of the exact rule: against mpmath, at any clearance, on any processor."""

import math
import os
import subprocess
import sys

import llvmlite.binding as llvm
import mpmath as mp
import numpy as np
import pytest

from tests.helpers import naive
from tests.helpers.kernel_cases import taken_apart
from tests.helpers.oscillators import Flight, in_digits
from vibroimpact import Oscillator, integrate, simulate
from vibroimpact.oscillator import POINT
from vibroimpact.step.chatter import rates_of, short_bounce
from vibroimpact.step.impact import Flight as Launch
from vibroimpact.step.propagator import coefficients_of


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
    """Of 200 points; relative to the size of the motion."""
    rng = np.random.default_rng(5)
    points = np.zeros(200, POINT)
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
    assert len(errors) > 150 and impacts > 0.7 * len(errors)
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
     for omega in np.linspace(0.2, 4.0, 100) for R in (0.3, 0.8) for c in (-0.1, 0.0, 0.2)]
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
