"""Stability of free motion, by closed forms and maps, and that every run ends."""

import itertools
import math
import subprocess
import sys

import mpmath as mp
import numpy as np
import pytest

from tests.helpers import naive
from tests.helpers.kernel_cases import integrated
from tests.helpers.places import ROOT
from vibroimpact import Oscillator, Status, integrate, simulate
from vibroimpact.step.integrators import INTEGRATORS, free_map, spectral_radius
from vibroimpact.step.scheme import MOST_STEPS, default_steps, least_stable_steps

ALL = pytest.mark.parametrize("name", INTEGRATORS)


def slow_radius(name, step, zeta):
    """Largest modulus of an eigenvalue of one step of the slow implementation."""
    osc = naive.oscillator(zeta, 0.5, 1.0, f=0.0)
    columns = [naive.STEPS[name](osc, 0.0, *unit, step) for unit in np.eye(2)]
    return np.abs(np.linalg.eigvals(np.array(columns, float).T)).max()


def is_stable(name, step, zeta):
    """Whether no multiplier of a step exceeds 1 in modulus, by Jury (1962), Proc. IRE 50, 1493."""
    M = free_map(name, step, zeta)
    trace, det = np.trace(M, axis1=-2, axis2=-1), np.linalg.det(M)
    rounding = 1e-14 * (1.0 + np.asarray(step) ** 2)
    return (np.abs(det) <= 1.0 + rounding) & (np.abs(trace) <= 1.0 + det + rounding)


@ALL
def test_just_below_the_limit_is_stable_and_just_above_is_not(name):
    """At random damping, by Jury's conditions on the map and by its spectral radius."""
    rng = np.random.default_rng(1)
    random = rng.uniform(0.01, 3.0, 5000), 10.0 ** rng.uniform(-2, 3, 500)
    zeta = np.concatenate([[0.0, 1.0], *random])
    limit = INTEGRATORS[name].limit(zeta)
    below = np.where(np.isfinite(limit), limit, 100.0) * (1.0 - 1e-7)
    assert is_stable(name, below, zeta).all()
    assert (spectral_radius(name, below, zeta) <= 1.0 + 1e-12).all()
    for share in (0.5, 0.1, 1e-3):  # nothing is unstable on the way there
        assert is_stable(name, share * below, zeta).all()
    some = np.isfinite(limit) & (limit > 0.0)
    assert not is_stable(name, limit[some] * (1.0 + 1e-7), zeta[some]).any()
    assert (spectral_radius(name, limit[some] * (1.0 + 1e-7), zeta[some]) > 1.0).all()
    if name == "euler":
        assert not is_stable(name, np.geomspace(1e-6, 10.0), 0.0).any()


@ALL
def test_the_spectral_radius_is_that_of_the_slow_implementation(name):
    rng = np.random.default_rng(2)
    steps, zetas = rng.uniform(0.01, 4.0, 40), rng.uniform(0.0, 2.5, 40)
    expected = [slow_radius(name, *point) for point in zip(steps, zetas, strict=True)]
    np.testing.assert_allclose(spectral_radius(name, steps, zetas), expected, rtol=1e-12)


@ALL
def test_the_least_steps_are_stable_and_one_fewer_is_not(name):
    """T = 2 pi / (omega N) where one step a period will do, or thousands."""
    rng = np.random.default_rng(3)
    h, p = rng.exponential(1.0, 2000), 10.0 ** rng.uniform(-2.0, 2.0, 2000)
    omega = 10.0 ** rng.uniform(-2.0, 2.0, 2000)
    least = least_stable_steps(name, h, p, omega)
    assert (least == np.round(least)).all() and (least >= 1.0).all()
    if name in ("newmark", "exact"):
        assert (least == 1.0).all()
        return
    keep = least < 1e5  # beyond, one step more or less is rounding
    h, p, omega, least = h[keep], p[keep], omega[keep], least[keep]
    assert np.ptp(np.log10(least)) > 3.0
    turn = 2.0 * np.pi * p / omega
    assert is_stable(name, turn / least, h / p).all()
    more = least > 1.0
    assert not is_stable(name, (turn / (least - 1.0).clip(1.0))[more], (h / p)[more]).any()


def test_no_step_is_stable():
    assert least_stable_steps("euler", 0.0, 1.0, 1.0) == math.inf
    assert least_stable_steps("rk4", 1e308, 1e-300, 1.0) == math.inf
    assert least_stable_steps("euler", [0.0, 0.5], 1.0, 1.0).tolist() == [math.inf, 7]


@pytest.mark.parametrize("rule", ["reduced-step", "cubic"])
def test_a_motion_that_overflows_within_a_step_ends(rule):
    """Euler at 1.2 times its limit, R = 1: times within a step overflow before the state does."""
    osc = Oscillator(
        h=0.3911426092478119, R=1.0, omega=0.195569472052125, f=1.0, p=0.5878520522077915,
        clearance=-1.6031095602083347,
    )  # fmt: skip
    tr = simulate(osc, 600, "euler", rule, 8, x0=-7.66681272775272)
    assert tr.status is Status.NON_FINITE
    assert np.nanmax(np.abs(tr.x)) > 1e290
    assert np.isnan(tr.section_x[-1])


@pytest.mark.parametrize("rule", ["plain", "reduced-step", "cubic"])
def test_a_displacement_that_overflows_is_no_impact(rule):
    """At R = 0 an impact would put it back to the stop, at rest, as if nothing had been."""
    osc = Oscillator(h=0.0, R=0.0, omega=2.0 * math.pi / 20000, f=0.0, p=1e-3)
    out = integrated(osc.at(-1.0, 2e305), "euler", rule, 8, periods=2)
    assert out["status"][0] == Status.NON_FINITE
    assert simulate(osc, 2, "euler", rule, 8, -1.0, 2e305).status is Status.NON_FINITE


def test_where_no_steps_are_asked_for_they_are_stable():
    """100 as in the paper, more where the integrator needs them, and 100 where none will do."""
    slow = Oscillator(h=0.1, R=0.5, omega=0.02, f=1.0).at()  # p T = pi at 100
    points = np.concatenate([slow, Oscillator(h=0.1, R=0.5, omega=1.0, f=1.0).at()])
    assert default_steps(points, "plain", "rk4") == least_stable_steps("rk4", 0.1, 1.0, 0.02) > 100
    assert default_steps(points[1:], "plain", "rk4") == 100
    assert default_steps(points, "plain", "newmark") == 100
    assert default_steps(points, "cubic", "exact") == 100
    undamped = Oscillator(h=0.0, R=0.5, omega=1.0, f=1.0)
    assert default_steps(undamped.at(), "plain", "euler") == 100
    assert least_stable_steps("euler", 1e-7, 1.0, 1.0) > MOST_STEPS
    assert default_steps(Oscillator(1e-7, 0.5, 1.0, 1.0).at(), "plain", "euler") == 100
    arguments = {"integrator": "rk4", "impact": "plain", "transient": 0, "periods": 9}
    out = integrate(slow, **arguments)
    steps = default_steps(slow, "plain", "rk4")
    same = integrate(slow, **arguments, steps_per_period=steps)
    np.testing.assert_array_equal(out["poincare_x"], same["poincare_x"])


@pytest.mark.slow
def test_asking_for_a_limit_compiles_nothing():
    """A configuration is checked, or refused, without waiting for the compiler."""
    code = (
        "from vibroimpact.kernel.lane import loop_of\n"
        "from vibroimpact.step import integrators, scheme\n"
        "for name in integrators.INTEGRATORS:\n"
        "    scheme.least_stable_steps(name, [0.0, 2.0], 1.0, 1.0)\n"
        "compiled = [integrators.affine_map, integrators.integrator_step]\n"
        "compiled += [row.step for row in integrators.INTEGRATORS.values()]\n"
        "assert not any(function.signatures for function in compiled)\n"
        "assert not loop_of.cache_info().currsize\n"
        "assert integrators.spectral_radius('euler', 0.1, 0.2) > 0.0\n"
        "assert integrators._fill_maps.signatures\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


SMALLEST_NORMAL = sys.float_info.min


@pytest.mark.parametrize(
    ("seed", "steps", "calls"),
    [pytest.param(1, 2_000, 25, marks=pytest.mark.slow),
     pytest.param(2, 1_000_000, 10_000, marks=pytest.mark.campaign)],
)  # fmt: skip
def test_every_step_and_every_call_ends(seed, steps, calls):
    """In a process of its own, so that a hang is a failure and not a hung suite."""
    code = (
        "from tests.helpers import fuzz_steps, hostile_calls\n"
        f"fuzz_steps.main({seed}, {steps})\nhostile_calls.main({seed}, {calls})\n"
    )
    command, seconds = [sys.executable, "-W", "error", "-c", code], 300 if seed == 1 else 7200
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=seconds)
    assert done.returncode == 0, done.stdout + done.stderr


def bouncing(osc, x0):
    """A free mass with the stop at its equilibrium, h < p, from rest at x0 < 0; by mpmath.

    x = x0 e^(-ht) (cos w t + h/w sin w t) up to the first impact; then each flight is
    -R v e^(-ht)/w sin w t, half a period of the damped motion long. Returns time and speed of the
    first impact, the time from impact to impact, and the ratio of the speeds of two.
    """
    h, p, R = mp.mpf(osc.h), mp.mpf(osc.p), mp.mpf(osc.R)
    w = mp.sqrt(p * p - h * h)
    first = (mp.pi - mp.atan2(w, h)) / w
    speed = -mp.mpf(x0) * p * p / w * mp.exp(-h * first) * mp.sin(w * first)
    return first, speed, mp.pi / w, R * mp.exp(-h * mp.pi / w)


DECAYS = [(0.5, 0.8, 300), (0.5, 0.5, 300), (0.1, 0.5, 400), (0.0, 0.3, 300), (0.9, 1.0, 200)]


@pytest.mark.parametrize(("h", "R", "periods"), DECAYS)
def test_a_free_decay_is_followed_to_the_smallest_normal_number(h, R, periods):
    """Every impact down to there, in closed form; after it zero, at rest, and certified."""
    osc = Oscillator(h=h, R=R, omega=1.0, f=0.0)
    tr = simulate(osc, periods, x0=-1.0)
    assert tr.status is Status.CERTIFIED
    first, speed, half, ratio = bouncing(osc, -1.0)
    with mp.workdps(30):
        count = int(mp.floor(mp.log(SMALLEST_NORMAL / speed) / mp.log(ratio)))
        assert count <= len(tr.impact_v) <= count + 4  # the last ones are within a step of it
        for k in range(count):
            tolerance = 1e-15 * (10 + 4 * k)
            assert abs(tr.impact_v[k] / (speed * ratio**k) - 1) <= tolerance
            assert abs(tr.impact_t[k] - (first + k * half)) <= tolerance
    after = tr.t > tr.impact_t[-1] + 2 * float(half)
    assert np.count_nonzero(after) > 30
    assert not tr.x[after].any() and not tr.v[after].any()


def test_a_free_decay_ends_with_every_method(integrator, rule):
    """At the equilibrium; the exact rule also on a stop with preload, where others hammer on."""
    oscillators = [
        Oscillator(h=h, R=R, omega=0.2, f=0.0, clearance=clearance)
        for h, R, clearance in itertools.product((0.2, 1.0, 2.0), (0.0, 0.5, 0.9), (0.0, 0.5, -0.5))
        if clearance >= 0.0 or rule == "exact"
    ]
    points = np.concatenate([osc.at(osc.clearance - 1.0) for osc in oscillators])
    transient = 1000 if integrator == "euler" else 250  # whose steps hold against the decay
    out = integrate(points, integrator=integrator, impact=rule, transient=transient, periods=3)
    assert set(out["status"]) == {Status.CERTIFIED if rule == "exact" else Status.COMPUTED}
    ends = np.repeat(np.minimum(points["clearance"], 0.0)[:, None], 3, axis=1)
    # The exact rule keeps x - clearance: beside it, x is known to a rounding of the clearance.
    allowed = SMALLEST_NORMAL + 4e-15 * np.abs(points["clearance"][:, None]) * (rule == "exact")
    assert (np.abs(out["poincare_x"] - ends) <= allowed).all()
