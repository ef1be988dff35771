"""Diagnostics of a motion: impulse and energy at impacts."""

import math

import numpy as np
import pytest

from tests.helpers import naive
from tests.helpers.kernel_cases import integrated
from vibroimpact import Oscillator, integrate, one_impact_orbit, simulate

METHODS = [("exact", "exact"), ("rk4", "cubic"), ("newmark", "reduced-step"), ("newmark", "plain")]


@pytest.mark.parametrize(("integrator", "impact"), METHODS)
@pytest.mark.parametrize("R", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("periods", [1, 7])
def test_they_are_summed_over_the_impacts_of_the_record(integrator, impact, R, periods):
    osc = Oscillator(h=0.5, R=R, omega=1.3, f=1.0)
    method = {"integrator": integrator, "impact": impact, "steps_per_period": 100}
    results = integrate(osc.at(-0.5, 0.0), transient=3, periods=periods, impacts=400, **method)
    run = simulate(osc, 3 + periods, x0=-0.5, **method)
    v = run.impact_v[run.impact_t > 3 * 2.0 * math.pi / 1.3]
    assert results["impacts_per_period"][0] * periods == len(v) > 0
    expected = [v.max(), (1.0 + R) * v.sum() / periods, (1.0 - R**2) / 2 * (v @ v) / periods]
    found = [results[name][0] for name in ("fastest_impact", "impulse", "energy_lost")]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-14)


@pytest.mark.parametrize(("integrator", "impact"), METHODS)
def test_without_an_impact_nothing_is_lost(integrator, impact):
    osc = Oscillator(h=0.1, R=0.5, omega=2.0, f=1.0, clearance=10.0)
    results = integrated(osc.at(), integrator, impact, 100, 1000, periods=5)
    assert np.isnan(results["fastest_impact"][0])
    assert (results["impulse"][0], results["energy_lost"][0]) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("h", "R", "omega", "n", "clearance"),
    [
        (0.05, 0.7, 2.3, 1, 0.0),
        (0.05, 0.6, 2.2, 1, 0.0),
        (0.1, 0.5, 2.0, 1, 0.0),
        (0.02, 0.8, 4.1, 2, 0.0),
        (0.5, 1.0, 2.0, 1, 0.0),
        (0.0, 0.5, 2.0, 1, 0.3),  # with clearance 0 the impact lies on the section
        (0.1, 0.8, 2.6, 2, 0.6),
    ],
)
def test_the_energy_balance_of_a_periodic_orbit(h, R, omega, n, clearance):
    """Work of the force = 2 h integral x'^2 + loss at the impact, by Gauss and Legendre's rule."""
    osc = Oscillator(h=h, R=R, omega=omega, f=1.0, clearance=clearance)
    orbit = one_impact_orbit(osc, n)
    assert orbit.stable
    t0, T = orbit.phase / omega, 2.0 * math.pi * n / omega
    nodes, weights = np.polynomial.legendre.leggauss(80)
    t, weights = t0 + 0.5 * T * (nodes + 1.0), 0.5 * T * weights
    _, v = naive.ClosedForm(osc, t0, clearance, -R * orbit.v)(t)
    work = weights @ (-np.sin(omega * t) * v) / n
    damped = 2.0 * h * (weights @ v**2) / n
    x0, v0 = orbit.sections()[0]
    results = integrate(osc.at(min(x0, clearance), v0), transient=0, periods=20 * n)
    assert results["impacts_per_period"][0] == 1.0 / n
    lost = results["energy_lost"][0]
    assert work == pytest.approx(damped + lost, rel=1e-11)
    assert results["impulse"][0] == pytest.approx((1.0 + R) * orbit.v / n, rel=1e-11)
    assert results["fastest_impact"][0] == pytest.approx(orbit.v, rel=1e-11)


# A forcing period from the stop at rest, with all 42, 100 and 173 impacts down to a speed of 1e-22:
# impulse and energy in mpmath, 50 digits.
CHATTERS = [
    ({"h": 0.05, "R": 0.3, "omega": 0.3}, 0.67546050370678545597, 0.060650959394022870362),
    ({"h": 0.05, "R": 0.6, "omega": 0.4}, 3.8317981879796203634, 0.36915578068323891687),
    (
        {"h": 0.0017813268069742114, "R": 0.7663732648179757, "omega": 0.17220592946231833,
         "p": 1.895638316906608}, 0.054300483595095646605, 0.000022293460102068459461,
    ),
]  # fmt: skip


@pytest.mark.parametrize(("given", "impulse", "energy"), CHATTERS)
def test_the_impacts_of_a_chatter_that_are_summed_are_among_them(given, impulse, energy):
    found = integrate(Oscillator(f=1.0, **given).at(), transient=0, periods=1)
    assert found["impulse"][0] == pytest.approx(impulse, rel=1e-12, abs=0.0)
    assert found["energy_lost"][0] == pytest.approx(energy, rel=1e-12, abs=0.0)


@pytest.mark.parametrize(("given", "impulse", "energy"), CHATTERS[:2])
def test_time_stepping_sums_them_too(given, impulse, energy):
    """Without the sum the impulse is off by 1e-3, however short the steps."""
    for steps, near in ((400, 1e-5), (1600, 1e-6)):
        found = integrated(Oscillator(f=1.0, **given).at(), "rk4", "cubic", steps, periods=1)
        assert found["impulse"][0] == pytest.approx(impulse, rel=near)
        assert found["energy_lost"][0] == pytest.approx(energy, rel=near)
