"""The period class: made-up sections, known motions, and the flips of the closed form."""

import math

import numpy as np
import pytest

from oscillators import bifurcation
from vibroimpact import Oscillator, integrate
from vibroimpact.orbits.one_impact import one_impact_orbit
from vibroimpact.points.period_class import LONGEST_PERIOD, TOLERANCE, period_class
from vibroimpact.step.integrators import INTEGRATORS


def cycle(m, periods, seed=0):
    """Sections of a motion of period m."""
    values = np.random.default_rng(seed).normal(size=(2, m))
    return np.array([[np.resize(q, periods)] for q in values])


@pytest.mark.parametrize("m", [1, 2, 3, 8, 63, 64])
def test_made_up_cycles(m):
    """The least period, and the impacts in it."""
    x, v = cycle(m, 2 * m + 3)
    found = period_class(x, v, np.array([3.0 / m]))
    assert (found[0][0], found[1][0]) == (m, 3)


def test_what_is_no_cycle():
    """Noise, NaN, a period longer than half the record or than the bound."""
    noise = np.random.default_rng(0).normal(size=(2, 1, 200))
    assert period_class(*noise, np.array([1.0])) == (0, 0)
    lost = np.full((2, 1, 50), np.nan)
    assert period_class(*lost, np.array([np.nan])) == (0, 0)
    x, v = cycle(10, 19)
    assert period_class(x, v, np.array([1.0]))[0] == 0
    x, v = cycle(LONGEST_PERIOD + 1, 4 * LONGEST_PERIOD)
    assert period_class(x, v, np.array([1.0]))[0] == 0
    assert period_class(np.zeros((1, 0)), np.zeros((1, 0)), np.array([0.0]))[0] == 0


def test_the_tolerance_is_a_share_of_the_greatest():
    """Half of it passes, twice it does not; x and v have each their own; rest is period 1."""
    for scale in (1e-9, 1.0, 1e9):
        for factor, m in ((0.5, 1), (2.0, 2)):
            x = scale * np.array([[1.0, 1.0 + factor * TOLERANCE] * 10])
            assert period_class(x, np.ones((1, 20)), np.array([1.0]))[0] == m
            assert period_class(np.ones((1, 20)), x, np.array([1.0]))[0] == m
    zero = np.zeros((1, 20))
    assert period_class(zero, zero, np.array([0.0])) == (1, 0)


@pytest.mark.parametrize("x0", [0.3, 0.0, -0.4])
@pytest.mark.parametrize(("h", "omega", "p"), [(0.05, 0.7, 1.0), (0.3, 2.0, 0.2), (4.0, 1.1, 2.0)])
def test_without_a_force_the_mass_ends_at_its_rest_position(h, omega, p, x0):
    """What its sections show then is rounding of the clearance, and no motion."""
    points = Oscillator(h=h, R=0.5, omega=omega, f=0.0, p=p, clearance=0.3).at(x0, 0.0)
    out = integrate(points, transient=400, periods=32)
    assert np.abs([out["poincare_x"], out["poincare_v"]]).max() < 1e-14
    sections = out["poincare_x"], out["poincare_v"], out["impacts_per_period"]
    assert period_class(*sections, points=points) == (1, 0)


def test_a_small_motion_under_a_large_clearance_is_no_rounding():
    """A forced motion of 1e-8 of the clearance still has its period, and noise of 1e-9 has none."""
    points = Oscillator(h=0.1, R=0.5, omega=1.0, f=1.0, clearance=2.0).at()
    x, v = cycle(3, 30)
    ones = np.ones(1)
    assert period_class(2e-8 * x, 2e-8 * v, ones, points=points) == (3, 3)
    noise = 2e-9 * np.random.default_rng(0).normal(size=(2, 1, 100))
    assert period_class(*noise, ones, points=points) == (0, 0)


@pytest.mark.parametrize("multiplier", [-0.9999, 0.9999, -1.0001])
def test_a_motion_that_still_settles_repeats_nothing(multiplier):
    """Each section equals the one two periods before it to 2e-7; over the record it does not."""
    n = np.arange(100)
    x = (1.0 + 1e-3 * multiplier**n)[None]
    assert np.abs(x[:, 2:] - x[:, :-2]).max() < TOLERANCE
    assert period_class(x, np.ones((1, 100)), np.array([1.0]))[0] == 0


@pytest.mark.parametrize("turns", [2, 3])
def test_a_spiral_that_shrinks_is_not_a_cycle_of_its_turns(turns):
    """Where it is of the size of the tolerance, it is off by more than it, and then by less."""
    n = np.arange(100)
    x = 1.0 + 0.75 * TOLERANCE * 0.97**n * np.cos(2.0 * np.pi * n / turns)
    assert np.abs(x - np.resize(x[:turns], 100)).max() < TOLERANCE < np.ptp(x)
    assert period_class(x[None], np.ones((1, 100)), np.array([1.0]))[0] == 0


def computed(osc, transient=2000, periods=128, x0=0.0, v0=0.0):
    """Period class, and the last four impact speeds."""
    out = integrate(osc.at(x0, v0), transient=transient, periods=periods, impacts=4)
    m, q = period_class(out["poincare_x"], out["poincare_v"], out["impacts_per_period"])
    return int(m[0]), int(q[0]), np.sort(out["impact_v"][0])


def on_the_orbit(osc, n, aside=0.0):
    """The state at phase 0 of the closed-form orbit with one impact in n periods."""
    orbit = one_impact_orbit(osc, n)
    wait = (2 * math.pi - orbit.phase) / osc.omega
    s, c = math.sin(orbit.phase), math.cos(orbit.phase)
    x, v = INTEGRATORS["exact"].step(0.0, -osc.R * orbit.v, s, c, wait, osc.at()[0])
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
    """Bisection on the period class, started 5e-8 beside the closed-form orbit.

    Near the flip a motion settles, or parts from the orbit, like |multiplier|^k: below it the
    start stays within the tolerance of the class, above it 4e5 periods carry it beyond. Far from
    it fewer do.
    """
    flip = bifurcation(Oscillator(h=h, R=R, omega=low, f=1.0), "flip", "omega", low, high, n)

    def doubled(omega):
        osc = Oscillator(h=h, R=R, omega=omega, f=1.0)
        transient = min(400_000, int(8.0 / (high - low)))
        return computed(osc, transient, 8 * n, *on_the_orbit(osc, n, 5e-8))[0] != n

    assert doubled(high) and not doubled(low)
    while high - low > 5e-7:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if doubled(middle) else (middle, high)
    assert abs(0.5 * (low + high) - flip) < 1e-6
