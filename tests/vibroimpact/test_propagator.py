"""The flow of a step and its bounds, and what one impact in it is proved to be."""

import math

import mpmath as mp
import naive
import numpy as np
import pytest

from vibroimpact import Oscillator
from vibroimpact.step.exact import is_below
from vibroimpact.step.impact import FIRST, ONLY, single_impact
from vibroimpact.step.propagator import (
    SLACK,
    coefficients_of,
    forced,
    impulse,
    propagate,
    propagator_of,
)
from vibroimpact.step.scheme import default_steps
from vibroimpact.step.series import LONGEST_STEP, TERMS, expand, first_crossing
from vibroimpact.step.series import value_and_slope as evaluate

POINTS = pytest.mark.parametrize(
    ("h", "omega", "p", "clearance"),
    [
        (0.0, 1.0, 1.0, 0.0), (1.0, 0.3, 1.0, 0.3), (2.0, 20.0, 1.0, -1.5), (0.1, 0.05, 3.0, 40.0),
        (3.0, 0.5, 1.0, 0.0), (0.0, 0.02, 1.0, 0.0), (1.0, 2.0, 1.0, 0.0),
    ],
)  # fmt: skip


@POINTS
def test_a_step_is_the_flow_to_rounding(h, omega, p, clearance):
    """At the longest step, against 40 digits: the polynomial, and the map of a whole step."""
    pt = Oscillator(h=h, R=0.5, omega=omega, f=1.3, p=p, clearance=clearance).at(-50.0)[0]
    step = LONGEST_STEP / (2 * h + p + omega) * omega
    c = np.empty(TERMS)
    eq = coefficients_of(pt)
    flow, forcing = propagator_of(eq, step, c)
    osc = naive.oscillator(h, 0.5, omega, 1.3, p)
    for y, v, theta in ((-0.4, 0.9, 0.3), (-1.0, 0.0, 4.0), (-2.0, -3.0, 5.5)):
        s, k = math.sin(theta), math.cos(theta)
        expand(eq, y, v / omega, s, k, step, c)
        x = mp.mpf(y) + mp.mpf(clearance)
        scale = max(1.0, abs(clearance) * (p / omega) ** 2 * step**2)
        for u in (0.1, 0.5, 0.9, 1.0):
            value, slope = evaluate(c, 0, u)
            true = naive.flow(osc, x, v, s, k, u * step / omega)
            assert value == pytest.approx(float(true[0] - clearance), abs=1e-15 * scale)
            assert slope / step * omega == pytest.approx(float(true[1]), abs=6e-15 * scale)
        y_T, w_T, _, _ = propagate(flow, y, v / omega, forced(forcing, s, k), step)
        assert y_T == pytest.approx(float(true[0] - clearance), abs=1e-15 * scale)
        assert w_T * omega == pytest.approx(float(true[1]), abs=4e-15 * scale)


@POINTS
def test_the_response_to_an_impulse(h, omega, p, clearance):
    """Of y and w, within the longest step, to rounding."""
    pt = Oscillator(h=h, R=0.5, omega=omega, f=1.3, p=p).at()[0]
    step = LONGEST_STEP / (2 * h + p + omega) * omega
    eq, osc = coefficients_of(pt), naive.oscillator(h, 0.5, omega, 0.0, p)
    for share in (1e-9, 0.1, 0.5, 1.0):
        x, v = naive.flow(osc, 0.0, omega, 0.0, 1.0, share * step / omega)
        of_y, of_w = impulse(eq.of_w, eq.of_y, share * step)
        assert of_y == pytest.approx(float(x), rel=4e-16)
        assert of_w == pytest.approx(float(v / omega), rel=4e-16, abs=4e-16)


def random_step(rng):
    """A point with a step, a state near the stop, and the polynomial of the flight."""
    h, omega = rng.choice([0.0, rng.uniform(0, 2)]), 0.05 * 400.0 ** rng.random()
    osc = Oscillator(
        h=h, R=rng.random(), omega=omega, f=rng.uniform(0, 3), p=rng.uniform(0.3, 3),
        clearance=rng.choice([0.0, rng.normal()]),
    )  # fmt: skip
    pt = osc.at(-9.0)[0]
    step = 2.0 * math.pi / (default_steps(osc.at(-9.0), "exact") * int(rng.choice([1, 1, 2, 7])))
    eq, c = coefficients_of(pt), np.empty(TERMS)
    flow = propagator_of(eq, step, c)
    w = rng.normal() * 10.0 ** rng.uniform(-3, 1)
    y, theta = -abs(w) * step * rng.exponential() * rng.choice([1e-3, 0.3, 1.0]), rng.uniform(0, 7)
    expand(eq, y, w, math.sin(theta), math.cos(theta), step, c)
    return eq, flow, step, (y, w), theta, c


@pytest.mark.slow
def test_the_bounds_are_bounds():
    """2000 random steps: of the fourth derivative; none that the guard lets pass meets the stop."""
    rng = np.random.default_rng(4)
    passed, met, tightest, u = 0, 0, math.inf, np.linspace(0.0, 1.0, 101)
    for _ in range(2000):
        _, flow, step, (y, w), theta, c = random_step(rng)
        flight = np.polynomial.Polynomial(c)
        fourth = np.abs(flight.deriv(4)(u)).max() / 72
        added = forced(flow[1], math.sin(theta), math.cos(theta))
        _, _, E, high = propagate(flow[0], y, w, added, step)
        bound = E - 2.0 * SLACK * (abs(y) + abs(w))  # without the slack
        assert fourth <= bound
        if fourth > 0.0:
            tightest = min(tightest, bound / fourth)
        highest = flight(u).max()
        proved = high < 0.0 or is_below(c, 1.0, E, 2) or is_below(c, 1.0, E, 4)
        assert not proved or highest < 0.0 or highest == y == 0.0
        passed += high < 0.0
        met += highest > 0.0
    assert passed > 400 and met > 400 and tightest < 3.0


@pytest.mark.slow
def test_what_is_proved_of_a_single_impact_holds():
    """2000 random steps: it is the first root of the flight, and the rebound does not return."""
    rng = np.random.default_rng(5)
    only, first, crossings, u = 0, 0, 0, np.linspace(0.0, 1.0, 101)
    for _ in range(2000):
        eq, flow, step, (y, w), theta, c = random_step(rng)
        end = evaluate(c, 0, 1.0)
        added = forced(flow[1], math.sin(theta), math.cos(theta))
        free = end[0], end[1] / step, propagate(flow[0], y, w, added, step)[2]
        waves = tuple(q(theta + d) for d in (0.0, step) for q in (math.sin, math.cos))
        y_1, w_1, t, w_i, proved = single_impact(eq, (y, w), free, waves, step, 1)
        root, _ = first_crossing(c, 0, 1.0)
        crossings += root > 0.0
        if proved < FIRST:
            continue
        first += 1
        scale = np.abs(c).sum()
        slope = evaluate(c, 0, root)[1] / step
        late = 4e-16 * step + 4e-16 * scale / slope
        bent = np.abs(np.polynomial.Polynomial(c).deriv(2)(u)).max() / step**2
        assert abs(t - root * step) <= 4 * late
        assert w_i == pytest.approx(slope, abs=4e-15 * scale / step + 4 * bent * late)
        if proved < ONLY:
            continue
        only += 1
        after = np.empty(TERMS)
        expand(eq, 0.0, -eq.R * w_i, math.sin(theta + t), math.cos(theta + t), step, after)
        left = (step - t) / step
        assert np.polynomial.Polynomial(after)(u[1:] * left).max() < 0.0
        y_T, slope_T = evaluate(after, 0, left)
        noise = 4e-15 * scale + 4 * (bent * step + slope) * late
        assert y_1 == pytest.approx(y_T, abs=4 * noise)
        assert w_1 == pytest.approx(slope_T / step, abs=4 * noise / step)
    assert only > 360 and crossings > 2 * only  # the others are no ordinary steps
    assert first >= only


def test_no_impact_is_proved_from_what_is_no_number():
    """Infinite states, and none."""
    eq = coefficients_of(Oscillator(0.1, 0.8, 2.0, 1.0).at()[0])
    for start in ((-math.inf, 1.0), (math.nan, 1.0), (0.0, 0.0), (-1.0, math.inf), (-1e308, 1e308)):
        for end in ((1.0, 1.0), (math.inf, 1.0), (math.nan, 0.0)):
            assert single_impact(eq, start, (*end, 0.1), (0.0, 1.0, 0.5, 0.9), 0.5, 1)[4] < ONLY
