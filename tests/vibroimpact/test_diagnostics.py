"""Diagnostics of a motion: impulse and energy at impacts, and the period class."""

import math
from dataclasses import replace

import naive
import numpy as np
import pytest

from oscillators import bifurcation
from vibroimpact import Oscillator, integrate, one_impact_orbit, simulate
from vibroimpact.orbits.periodic import solved
from vibroimpact.points.period_class import LONGEST_PERIOD, TOLERANCE, period_class

METHODS = [("exact", "exact"), ("rk4", "cubic"), ("newmark", "reduced-step"), ("newmark", "plain")]


def totals(results):
    return [float(results[name][0]) for name in ("fastest_impact", "impulse", "energy_lost")]


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
    np.testing.assert_allclose(totals(results), expected, rtol=1e-9, atol=1e-14)


@pytest.mark.parametrize(("integrator", "impact"), METHODS)
def test_without_an_impact_nothing_is_lost(integrator, impact):
    osc = Oscillator(h=0.1, R=0.5, omega=2.0, f=1.0, clearance=10.0)
    results = integrate(
        osc.at(), integrator=integrator, impact=impact, steps_per_period=100, periods=5
    )
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
    x0, v0 = solved(osc, n, np.array([orbit.phase]), np.array([orbit.v])).sections()[0]
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
        found = integrate(
            Oscillator(f=1.0, **given).at(), integrator="rk4", impact="cubic",
            steps_per_period=steps, transient=0, periods=1,
        )  # fmt: skip
        assert found["impulse"][0] == pytest.approx(impulse, rel=near)
        assert found["energy_lost"][0] == pytest.approx(energy, rel=near)


# --- period class ---


#: A point whose stop is at the rest position: only the sections decide.
FREE = Oscillator(h=0.1, R=0.5, omega=1.0, f=1.0).at()


def cycle(m, periods, seed=0):
    """Return sections of a motion of period m."""
    values = np.random.default_rng(seed).normal(size=(2, m))
    return np.array([[np.resize(q, periods)] for q in values])


@pytest.mark.parametrize("m", [1, 2, 3, 8, 63, 64])
def test_made_up_cycles(m):
    """The least period, and the impacts in it."""
    x, v = cycle(m, 2 * m + 3)
    found = period_class(FREE, x, v, np.array([3.0 / m]))
    assert (found[0][0], found[1][0]) == (m, 3)


def test_what_is_no_cycle():
    """Noise, NaN, a period longer than half the record or than the bound."""
    noise = np.random.default_rng(0).normal(size=(2, 1, 200))
    assert period_class(FREE, *noise, np.array([1.0])) == (0, 0)
    lost = np.full((2, 1, 50), np.nan)
    assert period_class(FREE, *lost, np.array([np.nan])) == (0, 0)
    x, v = cycle(10, 19)
    assert period_class(FREE, x, v, np.array([1.0]))[0] == 0
    x, v = cycle(LONGEST_PERIOD + 1, 4 * LONGEST_PERIOD)
    assert period_class(FREE, x, v, np.array([1.0]))[0] == 0
    assert period_class(FREE, np.zeros((1, 0)), np.zeros((1, 0)), np.array([0.0]))[0] == 0


def test_the_tolerance_is_a_share_of_the_greatest():
    """Half of it passes, twice it does not; x and v have each their own; rest is period 1."""
    for scale in (1e-9, 1.0, 1e9):
        for factor, m in ((0.5, 1), (2.0, 2)):
            x = scale * np.array([[1.0, 1.0 + factor * TOLERANCE] * 10])
            assert period_class(FREE, x, np.ones((1, 20)), np.array([1.0]))[0] == m
            assert period_class(FREE, np.ones((1, 20)), x, np.array([1.0]))[0] == m
    zero = np.zeros((1, 20))
    assert period_class(FREE, zero, zero, np.array([0.0])) == (1, 0)


@pytest.mark.parametrize("x0", [0.3, 0.0, -0.4])
@pytest.mark.parametrize(("h", "omega", "p"), [(0.05, 0.7, 1.0), (0.3, 2.0, 0.2), (4.0, 1.1, 2.0)])
def test_without_a_force_the_mass_ends_at_its_rest_position(h, omega, p, x0):
    """Its sections then show only rounding of the clearance."""
    points = Oscillator(h=h, R=0.5, omega=omega, f=0.0, p=p, clearance=0.3).at(x0, 0.0)
    out = integrate(points, transient=400, periods=32)
    assert np.abs([out["poincare_x"], out["poincare_v"]]).max() < 1e-14
    sections = out["poincare_x"], out["poincare_v"], out["impacts_per_period"]
    assert period_class(points, *sections) == (1, 0)


def test_a_small_motion_under_a_large_clearance_is_no_rounding():
    """A forced motion of 1e-8 of the clearance still has its period, and noise of 1e-9 has none."""
    points = Oscillator(h=0.1, R=0.5, omega=1.0, f=1.0, clearance=2.0).at()
    x, v = cycle(3, 30)
    ones = np.ones(1)
    assert period_class(points, 2e-8 * x, 2e-8 * v, ones) == (3, 3)
    noise = 2e-9 * np.random.default_rng(0).normal(size=(2, 1, 100))
    assert period_class(points, *noise, ones) == (0, 0)


@pytest.mark.parametrize("multiplier", [-0.9999, 0.9999, -1.0001])
def test_a_motion_that_still_settles_repeats_nothing(multiplier):
    """Each section equals the one two periods before it to 2e-7; over the record it does not."""
    n = np.arange(100)
    x = (1.0 + 1e-3 * multiplier**n)[None]
    assert np.abs(x[:, 2:] - x[:, :-2]).max() < TOLERANCE
    assert period_class(FREE, x, np.ones((1, 100)), np.array([1.0]))[0] == 0


@pytest.mark.parametrize("turns", [2, 3])
def test_a_spiral_that_shrinks_is_not_a_cycle_of_its_turns(turns):
    """Where it is of the size of the tolerance, it is off by more than it, and then by less."""
    n = np.arange(100)
    x = 1.0 + 0.75 * TOLERANCE * 0.97**n * np.cos(2.0 * np.pi * n / turns)
    assert np.abs(x - np.resize(x[:turns], 100)).max() < TOLERANCE < np.ptp(x)
    assert period_class(FREE, x[None], np.ones((1, 100)), np.array([1.0]))[0] == 0


def computed(osc, transient=2000, periods=128, x0=0.0, v0=0.0):
    """Return the period class and the last four impact speeds."""
    out = integrate(osc.at(x0, v0), transient=transient, periods=periods, impacts=4)
    sections = out["poincare_x"], out["poincare_v"], out["impacts_per_period"]
    m, q = period_class(osc.at(), *sections)
    return int(m[0]), int(q[0]), np.sort(out["impact_v"][0])


def on_the_orbit(osc, n, aside=0.0):
    """Return the state at phase 0 of the closed-form orbit with one impact in n periods."""
    orbit = one_impact_orbit(osc, n)
    x, v = naive.after_impact(osc, n, orbit.v, orbit.phase, 0.0)[0]
    return x, v + aside


@pytest.mark.parametrize(
    ("omega", "m", "q", "v"),
    [
        (2.64, 1, 1, [0.46237772] * 4),
        (2.66, 2, 2, [0.448921, 0.448921, 0.451823, 0.451823]),
        (2.70, 2, 2, None),
        (2.80, 0, 0, None),
    ],
)
def test_after_the_upper_edge(omega, m, q, v):
    """h = 0, R = 0.8: period 1, twice 2, then none; speeds as printed.

    From beside the orbit: from zero the mass comes to rest at 2.66, in a cycle of 6 periods.
    """
    osc = Oscillator(h=0.0, R=0.8, omega=omega, f=1.0)
    x0, v0 = on_the_orbit(osc, 1, 1e-4)
    found = computed(osc, 8000, 128, x0, v0)
    assert found[:2] == (m, q)
    if v:
        np.testing.assert_allclose(found[2], v, atol=1e-8 if m == 1 else 6e-7)


def test_known_cycles():
    """The paper's cases, n = 2, the attractor with three impacts in one period, and a rest."""
    for h, R, q in ((0.5, 1.0, 2), (0.0, 0.5, 2), (0.5, 0.5, 4)):
        assert computed(Oscillator(h=h, R=R, omega=1.0, f=1.0))[:2] == (1, q)
    assert computed(Oscillator(h=0.02, R=0.8, omega=4.1, f=1.0))[:2] == (2, 1)
    assert computed(Oscillator(h=0.0, R=0.3, omega=0.3, f=1.0))[0] == 1
    assert computed(Oscillator(h=0.1, R=0.3, omega=3.1, f=1.0))[0] == 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("h", "R", "n", "low", "high"),
    [(0.05, 0.8, 1, 2.64, 2.68), (0.1, 0.5, 1, 2.68, 2.70), (0.1, 0.5, 2, 4.65, 4.68)],
)
def test_the_flip_is_where_the_period_doubles(h, R, n, low, high):
    """Eight points at a time between the ends, started 5e-8 beside the closed-form orbit.

    Near the flip a motion settles, or parts from the orbit, like |multiplier|^k: below it the
    start stays within the tolerance of the class, above it 4e5 periods carry it beyond. Far from
    it fewer do.
    """
    osc = Oscillator(h=h, R=R, omega=low, f=1.0)
    flip = bifurcation(osc, "flip", "omega", low, high, n)
    while high - low > 5e-7:
        omegas = np.linspace(low, high, 8)
        oscillators = [replace(osc, omega=omega) for omega in omegas.tolist()]
        points = np.concatenate([one.at(*on_the_orbit(one, n, 5e-8)) for one in oscillators])
        transient = min(400_000, int(8.0 / (omegas[1] - low)))
        out = integrate(points, transient=transient, periods=8 * n)
        sections = out["poincare_x"], out["poincare_v"], out["impacts_per_period"]
        m, _ = period_class(points, *sections)
        first = int(np.argmax(m != n))
        assert first > 0 and (m[first:] != n).all()
        low, high = omegas[first - 1], omegas[first]
    assert abs(0.5 * (low + high) - flip) < 1e-6
