"""A flight as a polynomial: its first root, and proofs for a step with one impact."""

import math

import mpmath as mp
import numpy as np
import pytest

from vibroimpact import Oscillator
from vibroimpact.step.chatter import is_first
from vibroimpact.step.exact_step import stays_below
from vibroimpact.step.impact import FIRST, FREE, ONLY, Flight, FreeEnd, launch_after, meet_stop
from vibroimpact.step.polynomial import TERMS, expand, first_crossing
from vibroimpact.step.polynomial import value_and_slope as evaluate
from vibroimpact.step.propagator import (
    SLACK,
    coefficients_of,
    extent,
    forced,
    propagate,
    propagator_of,
)
from vibroimpact.step.scheme import default_steps

NONE = -1.0


def padded(c):
    """Return coefficients from the constant term on, padded with zeros."""
    out = np.zeros(TERMS)
    out[: len(c)] = c
    return out


def crossing(c, m=0, end=1.0):
    """Return the first crossing of the polynomial, and its highest turning point."""
    return first_crossing(padded(c), m, end)


def from_roots(roots, lead=1.0):
    """Return the coefficients of lead (u - r_1) (u - r_2) ..., rounded once."""
    with mp.workdps(50):
        c = [mp.mpf(lead)]
        for r in roots:
            c = [(c[k - 1] if k else 0) - (r * c[k] if k < len(c) else 0)
                 for k in range(len(c) + 1)]  # fmt: skip
        return np.array([float(q) for q in c])


def first_root(c, m, end):
    """Return the first rising root of the rounded polynomial in (0, end] and its slope, or None."""
    with mp.workdps(50):
        c = [mp.mpf(float(q)) for q in np.trim_zeros(c[m:], "b")]
        roots = mp.polyroots(c[::-1], maxsteps=400, extraprec=400)
        real = sorted(r.real for r in map(mp.mpc, roots) if abs(r.imag) < mp.mpf(10) ** -30)
        real = [r for r in real if 0 < r <= end]
        if not real:
            return None
        return real[0], sum(k * q * real[0] ** (k - 1) for k, q in enumerate(c) if k)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Descending")
def test_random_roots():
    """50 polynomials of degree up to 8, roots all around: the first in the step, or none."""
    rng = np.random.default_rng(1)
    found = 0
    for _ in range(50):
        count = int(rng.integers(1, 9))
        m = int(rng.integers(0, 3))
        end = rng.choice([1.0, rng.uniform(0.1, 1.0)])
        roots = rng.uniform(-2.0, 3.0, count)
        inner = from_roots(roots)
        inner *= -np.sign(inner[0])  # starts below the stop
        c = padded(np.concatenate([np.zeros(m), inner]))
        true = first_root(c, m, end)
        u, _ = first_crossing(c, m, end)
        if true is None:
            assert u == NONE
            continue
        root, slope = map(float, true)
        assert slope > 0.0
        found += 1
        assert abs(u - root) <= 4e-16 * root + 8e-16 * np.abs(c).sum() / slope
    assert found > 15


def test_a_root_at_the_end():
    """On it: found there; beyond it: none."""
    for end in (1.0, 0.5, 0.3):
        assert crossing(from_roots([end - 1e-9, -1.0]), 0, end)[0] == pytest.approx(end - 1e-9)
        assert crossing(from_roots([end + 1e-9, -1.0]), 0, end)[0] == NONE
    assert crossing([-1.0, 1.0 + 1e-15])[0] == pytest.approx(1.0, abs=2e-15)


def test_roots_a_billionth_apart_are_not_jumped():
    """Roots r and r + 1e-9, where coefficients of one allow it: divided by their size, near 0."""
    for r in (1e-6, 1e-5, 1e-4):
        c = from_roots([r, r + 1e-9, 2.0])
        u, turn = crossing(c)
        assert c[0] < 0.0
        assert u == pytest.approx(r, rel=1e-5 * r / 1e-6)
        assert u < r + 0.6e-9
        u, turn = crossing(from_roots([r, r + 1e-9, 2.0]) - padded([1e-18])[:4])
        assert (u, turn < 0.0) == (NONE, True)


def test_inflections():
    """A triple root is crossed once; a curve with inflections and no root has none."""
    for at in (0.3, 0.5, 0.9):
        u, _ = crossing(from_roots([at, at, at]))
        assert u == pytest.approx(at, abs=2e-5)
        u, _ = crossing(from_roots([at, at, at]) - padded([5e-7])[:4])
        assert u == pytest.approx(at + 5e-7 ** (1 / 3), abs=1e-10)
    wave = np.polynomial.Chebyshev.basis(11).convert(kind=np.polynomial.Polynomial).coef
    assert crossing(wave - padded([1.01])[: wave.size])[0] == NONE


def random_step(rng):
    """Return a point with a step, a state near the stop, and the polynomial of the flight."""
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
    """500 random steps: of the fourth derivative; none that the guard lets pass meets the stop."""
    rng = np.random.default_rng(4)
    passed, met, tightest, u = 0, 0, math.inf, np.linspace(0.0, 1.0, 101)
    for _ in range(500):
        eq, flow, step, (y, w), theta, c = random_step(rng)
        flight = np.polynomial.Polynomial(c)
        fourth = np.abs(flight.deriv(4)(u)).max() / 72
        added = forced(flow[1], math.sin(theta), math.cos(theta))
        _, _, E, high, low = propagate(flow[0], y, w, added, step)
        bound = E - 2.0 * SLACK * (abs(y) + abs(w))  # without the slack
        assert fourth <= bound
        if fourth > 0.0:
            tightest = min(tightest, bound / fourth)
        highest = flight(u).max()
        assert flight(u).min() >= min(low, *flight(u[[0, -1]]))
        proved = high < 0.0 or any(stays_below(c, 1.0, E, pieces, extent(eq)) for pieces in (2, 4))
        assert not proved or highest < 0.0 or highest == y == 0.0
        passed += high < 0.0
        met += highest > 0.0
    assert passed > 100 and met > 100 and tightest < 3.0


def noise_of(c, scale, slope, step):
    """Return what rounding leaves open of a root, of the speed there, and of what comes after.

    `c` is the flight, and `scale` the size of its step.
    """
    u = np.linspace(0.0, 1.0, 101)
    late = 4e-16 * step + 4e-16 * scale / slope
    bent = np.abs(np.polynomial.Polynomial(c).deriv(2)(u)).max() / step**2
    faster = 4e-15 * scale / step + 4 * bent * late
    return 4 * late, faster, 16e-15 * scale + 16 * (bent * step + slope) * late


@pytest.mark.slow
def test_what_is_proved_of_a_flight_holds():
    """800 random steps: of their flights, one after the other, the first root or that none is."""
    rng = np.random.default_rng(5)
    ends, crossings, u = {FREE: 0, ONLY: 0, FIRST: 0}, 0, np.linspace(0.0, 1.0, 101)
    for _ in range(800):
        eq, flow, step, (y, w), theta, c = random_step(rng)
        end = evaluate(c, 0, 1.0)
        added = forced(flow[1], math.sin(theta), math.cos(theta))
        free = FreeEnd(end[0], end[1] / step, propagate(flow[0], y, w, added, step)[2])
        wave, end_wave = ((math.sin(q), math.cos(q)) for q in (theta, theta + step))
        flight, m, scale = Flight(y, w, *wave, 0.0), 0, 0.0
        for _ in range(6):
            end, scale = meet_stop(eq, flight, free, end_wave, step), max(scale, np.abs(c).sum())
            left = (step - flight.begin) / step
            root, _ = first_crossing(c, m, left)
            crossings += root > 0.0
            if end.proved not in ends:
                break
            ends[end.proved] += 1
            if end.proved == FREE:
                assert root == NONE
                y_T, slope_T = evaluate(c, 0, left)
                assert end.y == pytest.approx(y_T, abs=4e-15 * scale)
                assert end.w == pytest.approx(slope_T / step, abs=4e-15 * scale / step)
                break
            slope = root**m * evaluate(c, m, root)[1] / step
            late, faster, noise = noise_of(c, scale, slope, step)
            assert abs(end.at - flight.begin - root * step) <= late
            assert end.w_i == pytest.approx(slope, abs=faster)
            c, m = np.empty(TERMS), 1
            flight = launch_after(eq, wave, end.at, end.w_i)
            assert (flight.y, flight.w) == (0.0, -eq.R * end.w_i)
            expand(eq, 0.0, flight.w, math.sin(theta + end.at), math.cos(theta + end.at), step, c)
            left = (step - end.at) / step
            y_T, slope_T = evaluate(c, 0, left)
            assert end.y == pytest.approx(y_T, abs=noise)
            assert end.w == pytest.approx(slope_T / step, abs=noise / step)
            if end.proved == ONLY:
                assert np.polynomial.Polynomial(c)(u[1:] * left).max() < 0.0
                break
            free = FreeEnd(end.y, end.w, free.bound)
    assert min(ends.values()) > 12 and ends[ONLY] > 160
    assert crossings > 1.2 * ends[ONLY]  # the others are not ordinary steps


def test_no_impact_is_proved_from_what_is_no_number():
    eq = coefficients_of(Oscillator(0.1, 0.8, 2.0, 1.0).at()[0])
    for start in ((-math.inf, 1.0), (math.nan, 1.0), (0.0, 0.0), (-1.0, math.inf), (-1e308, 1e308)):
        for end in ((1.0, 1.0), (math.inf, 1.0), (math.nan, 0.0)):
            for begin in (0.0, 0.1):
                flight, free = Flight(*start, 0.0, 1.0, begin), FreeEnd(*end, 0.1)
                assert meet_stop(eq, flight, free, (0.5, 0.9), 0.5).proved < ONLY


def test_a_rebound_that_ends_falling_is_not_proved_to_be_the_first():
    """It has been above the stop before."""
    assert is_first(-1.0, 0.5, 0.1, 1e-9, 1.0)
    assert not is_first(-1.0, -0.5, 0.1, 1e-9, 1.0)
