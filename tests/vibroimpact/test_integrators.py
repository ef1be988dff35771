"""Each step as a map, its order, and the exact flow against series of hundreds of digits."""

import math
import re

import naive
import numpy as np
import pytest

from vibroimpact import Oscillator
from vibroimpact.step.integrators import INTEGRATORS, affine_map, apply_map, step

ALL = pytest.mark.parametrize("name", INTEGRATORS)
STATES = [(1.0, 0.0, 0.0, 1.0), (-0.3, 0.7, 0.6, -0.8), (0.0, 0.0, 0.28, 0.96), (-2.0, -1.5, 1, 0)]


def point(h=0.1, omega=1.3, p=1.0, f=1.0):
    """A parameter point."""
    return Oscillator(h=h, R=0.5, omega=omega, f=f, p=p).at()[0]


def exact_map(pt, T):
    """The matrix (x, v, sin, cos) -> (x_T, v_T) of the flow, by the package."""
    return np.array(affine_map(INTEGRATORS["exact"].code, T, pt)).reshape(2, 4)


def true_map(pt, T):
    """The same by the slow implementation."""
    osc = naive.oscillator(pt["h"], 0.5, pt["omega"], pt["f"], pt["p"])
    return np.array([naive.flow(osc, *unit, T) for unit in np.eye(4)]).T


@ALL
@pytest.mark.parametrize("T", [1e-3, 0.06, 0.9])
def test_a_step_is_its_affine_map(name, T):
    """The map applied to a state is the step from that state."""
    pt = point(h=0.3, f=1.7, p=1.2)
    code = INTEGRATORS[name].code
    rows = affine_map(code, T, pt)
    for state in STATES:
        mapped = apply_map(rows[:4], *state), apply_map(rows[4:], *state)
        np.testing.assert_allclose(mapped, INTEGRATORS[name].step(*state, T, pt), atol=1e-14)


@ALL
def test_the_dispatcher_takes_the_integrator_of_that_code(name):
    """A row of the table and a branch of the dispatcher are the same function."""
    pt = point(h=0.3, f=1.7, p=1.2)
    row = INTEGRATORS[name]
    for state in STATES:
        assert step(row.code, *state, 0.4, pt) == row.step(*state, 0.4, pt)


@ALL
def test_the_docstring_of_an_integrator_names_its_source(name):
    """Authors and the year in parentheses."""
    assert re.search(r"[A-Z][a-z]+ \((1[7-9]|20)\d\d\),\s", INTEGRATORS[name].step.__doc__)


@ALL
def test_a_step_is_that_of_the_slow_implementation(name):
    """Same method, other code: one step from a state, at several phases."""
    pt = point(h=0.3, omega=1.7, p=1.2, f=0.8)
    osc = naive.oscillator(0.3, 0.5, 1.7, 0.8, 1.2)
    for t in (0.0, 0.4, 2.9):
        s, c = math.sin(1.7 * t), math.cos(1.7 * t)
        ours = INTEGRATORS[name].step(-0.4, 0.9, s, c, 0.3, pt)
        np.testing.assert_allclose(ours, naive.STEPS[name](osc, t, -0.4, 0.9, 0.3), atol=3e-16)


@ALL
def test_the_order_on_smooth_motion_is_that_of_the_table(name):
    """Halving the step divides the error at a fixed time by 2^order; exact is exact."""
    pt, osc = point(h=0.2, p=1.1), naive.oscillator(0.2, 0.5, 1.3, p=1.1)
    end = 6.0
    true = np.array(naive.exact_step(osc, 0.0, -0.4, 0.7, end))
    errors = []
    for n in (32, 64, 128, 256):
        x, v = -0.4, 0.7
        for k in range(n):
            t = end * k / n
            s, c = math.sin(1.3 * t), math.cos(1.3 * t)
            x, v = INTEGRATORS[name].step(x, v, s, c, end / n, pt)
        errors.append(np.hypot(*(np.array([x, v]) - true)))
    order = INTEGRATORS[name].order
    if order is None:
        assert max(errors) < 3e-14
    else:
        assert errors[-1] > 1e-12
        np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), order, atol=0.2)


@pytest.mark.parametrize("T", [1e-9, 1e-3, 0.0628, 1.0, 7.0, 30.0])
@pytest.mark.parametrize(
    ("h", "omega"),
    [
        (0.0, 1.0),
        (0.0, 1.0 + 1e-9),
        (0.0, 1.0 - 1e-4),
        (0.0, 2.3),
        (0.05, 0.3),
        (0.5, 1.0),
        (1.0, 1.0),
        (1.0 - 1e-10, 0.7),
        (1.0 + 1e-10, 0.7),
        (2.0, 0.5),
        (2.0, 20.0),
        (10.0, 1.0),
    ],
)
def test_the_exact_step_is_the_flow(h, omega, T):
    """Under, at and over critical damping, at and near resonance, short and long steps."""
    pt = point(h=h, omega=omega)
    ours, true = exact_map(pt, T), true_map(pt, T)
    # The forced response holds omega T radians, known to a rounding of that angle.
    rounding = 1e-15 * (4.0 + (2.0 * h + 1.0 + omega) * T)
    np.testing.assert_allclose(ours, true, rtol=0, atol=rounding * np.abs(true).max())


def test_the_exact_step_is_the_flow_under_heavy_damping():
    """h = 50: one eigenvalue a hundred times the other's inverse, and steps over a hundred long."""
    pt = point(h=50.0)
    for T in (0.01, 1.0, 3.0):
        ours, true = exact_map(pt, T), true_map(pt, T)
        np.testing.assert_allclose(ours, true, rtol=1e-13, atol=1e-15 * np.abs(true).max())


@pytest.mark.parametrize("h", [0.0, 0.3, 50.0])
def test_a_tiny_step_keeps_its_leading_digits(h):
    """Over 1e-9 the entries are the first terms of their series, each to its own rounding."""
    T = 1e-9
    (xx, xv, xs, xc), (vx, vv, vs, vc) = exact_map(point(h=h, omega=1.7), T)
    np.testing.assert_allclose([xv, vx, xs, vs], [T, -T, -(T**2) / 2, -T], rtol=1e-7)
    np.testing.assert_allclose([xc, vc], [-1.7 * T**3 / 6, -1.7 * T**2 / 2], rtol=1e-7)
    np.testing.assert_allclose([xx, vv], [1.0, math.exp(-2 * h * T)], rtol=1e-15)


@pytest.mark.parametrize("T", [0.05, 1.0, 12.0])
def test_the_exact_step_is_the_textbook_solution(T):
    """Free motion under, at and over critical damping, and the secular one at resonance."""
    Om = math.sqrt(1.44 - 0.09)
    m = exact_map(point(h=0.3, p=1.2), T)
    decay = math.exp(-0.3 * T)
    assert m[0, 1] == pytest.approx(decay * math.sin(Om * T) / Om, abs=1e-15 * (3 + T))
    m = exact_map(point(h=1.0), T)
    assert m[0, 0] == pytest.approx((1 + T) * math.exp(-T), rel=1e-14 * (1 + T))
    m = exact_map(point(h=1.25), T)
    slow, fast = math.exp(-0.5 * T), math.exp(-2.0 * T)
    assert m[0, 1] == pytest.approx((slow - fast) / 1.5, rel=1e-14 * (1 + T))
    m = exact_map(point(h=0.0, omega=1.0), T)
    secular = (T * math.cos(T) - math.sin(T)) / 2
    assert m[0, 3] == pytest.approx(secular, abs=2e-15 * (3 + T))
    assert m[1, 3] == pytest.approx(-T * math.sin(T) / 2, abs=2e-15 * (3 + T))


@pytest.mark.parametrize(("h", "omega"), [(0.0, 1.0), (0.1, 2.3), (1.0, 0.7), (3.0, 1.0)])
@pytest.mark.parametrize(("a", "b"), [(0.1, 0.2), (0.013, 1.9), (3.0, 4.5)])
def test_two_exact_steps_are_one(h, omega, a, b):
    """The flow over a, then over b, is the flow over a + b."""
    pt = point(h=h, omega=omega)
    exact = INTEGRATORS["exact"].step
    for x, v, theta in ((-0.4, 0.9, 0.3), (-1.0, 0.0, 4.0)):
        middle = exact(x, v, math.sin(theta), math.cos(theta), a, pt)
        phase = theta + omega * a
        twice = exact(*middle, math.sin(phase), math.cos(phase), b, pt)
        once = exact(x, v, math.sin(theta), math.cos(theta), a + b, pt)
        np.testing.assert_allclose(twice, once, atol=3e-15 * (2 + a + b))


def amplification(z):
    """|P(z)|^2 of the classical Runge-Kutta method."""
    return abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24) ** 2


# det M under the critical damping, in closed form.
DETERMINANT = {
    "euler": lambda h, p, T: 1 - 2 * h * T + (p * T) ** 2,
    "semi-implicit-euler": lambda h, p, T: 1 - 2 * h * T,
    "verlet": lambda h, p, T: (1 - h * T) / (1 + h * T),
    "newmark": lambda h, p, T: (1 - h * T + (p * T / 2) ** 2) / (1 + h * T + (p * T / 2) ** 2),
    "rk4": lambda h, p, T: amplification(T * complex(-h, math.sqrt(p**2 - h**2))),
    "exact": lambda h, p, T: math.exp(-2 * h * T),
}


@ALL
@pytest.mark.parametrize("h", [0.0, 0.3])
def test_the_determinant_of_a_step(name, h):
    """What a step makes of an area of the phase plane; e^(-2 h T) to the order of the method."""
    p = 1.2
    for T in (0.05, 0.5):
        m = np.array(affine_map(INTEGRATORS[name].code, T, point(h=h, p=p))).reshape(2, 4)
        assert np.linalg.det(m[:, :2]) == pytest.approx(DETERMINANT[name](h, p, T), abs=2e-15)


def energy(x, v, p, T):
    """Twice that of free undamped motion."""
    return v**2 + p**2 * x**2


# Free undamped motion in steps T: a quadratic form, and by what a step multiplies it (z = p T).
INVARIANT = {
    "euler": (energy, lambda z: 1 + z**2),
    "semi-implicit-euler": (
        lambda x, v, p, T: energy(x, v, p, T) - p**2 * T * x * v,
        lambda z: 1.0,
    ),
    "verlet": (lambda x, v, p, T: v**2 / (1 - (p * T) ** 2 / 4) + p**2 * x**2, lambda z: 1.0),
    "newmark": (energy, lambda z: 1.0),
    "rk4": (energy, lambda z: 1 - z**6 / 72 + z**8 / 576),
    "exact": (energy, lambda z: 1.0),
}


@ALL
@pytest.mark.parametrize("T", [0.06, 0.5])
def test_the_energy_of_free_motion(name, T):
    """Euler gains (p T)^2 of it in every step, Runge-Kutta loses (p T)^6 / 72; the rest keep it.

    Semi-implicit Euler and Verlet keep a neighbour of it, which differs by their order in T.
    """
    p = 1.2
    pt = point(h=0.0, p=p, f=0.0)
    form, factor = INVARIANT[name]
    x, v = -0.4, 0.7
    start = form(x, v, p, T)
    for k in range(1, 401):
        x, v = INTEGRATORS[name].step(x, v, 0.0, 1.0, T, pt)
        assert form(x, v, p, T) == pytest.approx(start * factor(p * T) ** k, rel=1e-13 * (5 + k))


def test_an_absurd_step_is_nan_and_ends():
    """Where (2h + p + omega) T overflows no doubling ends; the answer is not a number."""
    assert all(math.isnan(q) for q in exact_map(point(omega=1e200), 1e200).ravel())
