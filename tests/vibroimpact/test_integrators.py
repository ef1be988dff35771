"""The order of each integrator, alone and through impacts, and the exact flow.

The phase of an impact within its step jumps with N, and so does the error: every error through
impacts is the RMS over a spread of N.
"""

import math
import re

import mpmath
import numpy as np
import pytest

from tests.helpers import naive
from tests.helpers.kernel_cases import integrated
from vibroimpact import Oscillator
from vibroimpact.step.elementary import asin, hypot, log, sin_cos
from vibroimpact.step.integrators import INTEGRATORS, affine_map
from vibroimpact.step.scheme import IMPACT_RULES

ALL = pytest.mark.parametrize("name", INTEGRATORS)


def point(h=0.1, omega=1.3, p=1.0, f=1.0):
    return Oscillator(h=h, R=0.5, omega=omega, f=f, p=p).at()[0]


def exact_map(pt, T):
    """Return the matrix (x, v, sin, cos) -> (x_T, v_T) of the flow from the package."""
    return np.array(affine_map(INTEGRATORS["exact"].code, T, pt)).reshape(2, 4)


def true_map(pt, T):
    """Return the same matrix from the slow implementation."""
    osc = naive.oscillator(pt["h"], 0.5, pt["omega"], pt["f"], pt["p"])
    return np.array([naive.flow(osc, *unit, T) for unit in np.eye(4)]).T


@ALL
def test_the_docstring_of_an_integrator_names_its_source(name):
    assert re.search(r"[A-Z][a-z]+ \((1[7-9]|20)\d\d\),\s", INTEGRATORS[name].step.__doc__)


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


UNDAMPED = [(0.0, omega) for omega in (1.0, 1.0 + 1e-9, 1.0 - 1e-4, 2.3)]
NEARLY_CRITICAL = [(1.0, 1.0), (1.0 - 1e-10, 0.7), (1.0 + 1e-10, 0.7)]
DAMPED = [(0.05, 0.3), (0.5, 1.0), *NEARLY_CRITICAL, (2.0, 0.5), (2.0, 20.0)]


@pytest.mark.parametrize("T", [1e-9, 0.0628, 1.0, 30.0])
@pytest.mark.parametrize(("h", "omega"), UNDAMPED + DAMPED)
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


def test_an_absurd_step_is_nan_and_ends():
    """Where (2h + p + omega) T overflows no doubling ends; the answer is not a number."""
    assert all(math.isnan(q) for q in exact_map(point(omega=1e200), 1e200).ravel())


def assert_right(function, true, *arguments):
    """Compare with mpmath, to 2^-52 of the size of each result."""
    with mpmath.workdps(40):
        for given in zip(*map(np.ndarray.tolist, arguments), strict=True):
            found, known = function(*given), true(*map(mpmath.mpf, given))
            for ours, value in zip(np.atleast_1d(found), np.atleast_1d(known), strict=True):
                assert abs(ours - value) <= abs(value) * 2.0**-52, given


def test_sine_and_cosine_are_right_to_rounding():
    """Every quadrant, next to and at its ends, and thousands of radians."""
    rng = np.random.default_rng(1)
    ends = np.arange(-40, 41) * (np.pi / 4)
    angles = np.concatenate(
        [rng.uniform(-50.0, 50.0, 2000), ends, ends + rng.normal(0.0, 1e-9, ends.size),
         rng.uniform(0.0, 5e3, 500)]
    )  # fmt: skip
    assert_right(sin_cos, lambda angle: (mpmath.sin(angle), mpmath.cos(angle)), angles)


def test_arc_sine_logarithm_and_length_are_right_to_rounding():
    """Also where they are small, and at the ends of their ranges."""
    rng = np.random.default_rng(2)
    small, signs = 10.0 ** rng.uniform(-16.0, -1.0, 300), rng.choice([-1.0, 1.0], 300)
    sines = [rng.uniform(-1.0, 1.0, 2000), signs * small, signs * (1.0 - small), [1.0, 0.5, -1.0]]
    assert_right(asin, mpmath.asin, np.concatenate(sines))
    sizes = 10.0 ** rng.uniform(-320.0, 308.0, 300)
    values = np.concatenate([rng.uniform(0, 4, 2000), sizes, 1 + signs * small])
    assert_right(log, mpmath.log, values)
    x, y = rng.normal(size=(2, 2000)) * 10.0 ** rng.uniform(-3.0, 3.0, 2000)
    assert_right(hypot, mpmath.hypot, x, y)
    assert hypot(3.0 * 2.0**900, -4.0 * 2.0**900) == 5.0 * 2.0**900
    assert hypot(-5e-324, 0.0) == 5e-324
    assert (log(0.0), log(np.inf), asin(0.0), hypot(0.0, 0.0)) == (-np.inf, np.inf, 0.0, 0.0)
    assert np.isnan([log(-1.0), log(np.nan), asin(1.1), asin(np.nan), hypot(np.nan, 1.0)]).all()


def test_what_is_no_angle_is_no_number():
    """A run that overflowed must not become finite again."""
    for angle in (np.nan, np.inf, -np.inf):
        assert np.isnan(sin_cos(angle)).all()


PERIODS = 20
# The steps at which a method is in its asymptotic range.
LADDER = {1: (400, 800, 1600, 3200), 2: (100, 200, 400, 800), 4: (100, 200, 400, 800)}
# With fewer steps a first-order integrator finds another number of impacts in the third case.
LADDER_OF_THE_FIRST_ORDER = (1600, 3200, 6400, 12800)
# Allowed fitted orders, and the remaining error at the finest step.
FITTED = {1: (0.8, 1.3), 2: (1.7, 2.4), 4: (3.6, 4.6)}
LEFT = {1: 2e-3, 2: 3e-5, 4: 3e-9}


def orders(integrator, rule):
    """Return the orders of the two parts of a method, without parts exact to rounding."""
    parts = INTEGRATORS[integrator].order, IMPACT_RULES[rule].order
    return [order for order in parts if order is not None]


def spread(n, count):
    """Return step counts from n to 1.6 n."""
    return np.round(n * np.linspace(1.0, 1.6, count)).astype(int)


def error_of_the_state(orbit, integrator, rule, steps):
    """RMS over the given step counts, after ``PERIODS`` periods."""
    errors = []
    for m in steps:
        start, transient = orbit.oscillator.at(), PERIODS - 1
        out = integrated(start, integrator, rule, int(m), transient, periods=1, impacts=0)
        state = out["poincare_x"][0, 0], out["poincare_v"][0, 0]
        errors.append(state - orbit.sections[PERIODS - 1])
    return np.sqrt(np.mean(np.square(errors)))


@pytest.mark.slow
@pytest.mark.parametrize("case", ["paper_A", "paper_B", "paper_C"])
def test_the_order_through_impacts_is_the_lower_of_the_two(truth, case, rule, integrator):
    """State after 20 periods of the paper's cases, against 30 certified digits.

    The order is that of the integrator or that of the rule, whichever is lower, and where both
    have it, both leave their error.
    """
    parts = orders(integrator, rule)
    if not parts:
        assert error_of_the_state(truth[case], integrator, rule, spread(100, 4)) < 1e-14
        return
    order = min(parts)
    first = INTEGRATORS[integrator].order == 1
    ladder = LADDER_OF_THE_FIRST_ORDER if first else LADDER[order]
    errors = [error_of_the_state(truth[case], integrator, rule, spread(n, 4)) for n in ladder]
    low, high = FITTED[order]
    assert low < -np.polyfit(np.log(ladder), np.log(errors), 1)[0] < high
    assert errors[-1] < parts.count(order) * LEFT[order]
