"""Orbits with one impact: closed forms, stability and bifurcations against other formulas."""

import dataclasses
import math
from functools import partial

import mpmath as mp
import naive
import numpy as np
import pytest
from scipy.optimize import brentq

from oscillators import bifurcation, oscillator, random_oscillators
from vibroimpact import Oscillator
from vibroimpact.orbits.one_impact import one_impact_orbit, one_impact_orbits

# h, omega, R, n, v, omega t0
ORBITS = [
    (0.05, 2.3, 0.7, 1, 1.1757597511, 1.05851979),
    (0.05, 2.2, 0.6, 1, 1.5933223776, 0.73373263),
    (0.1, 2.0, 0.5, 1, 1.8032426117, -0.10094085),
    (0.02, 4.1, 0.8, 2, 1.3590632910, 0.83266893),
]

# h, R, n, omega
FLIPS = [
    (0.05, 0.8, 1, 1.22973534658679),
    (0.05, 0.8, 1, 2.65888454668484),
    (0.05, 0.8, 2, 3.33809052026845),
    (0.05, 0.8, 2, 4.64512198413259),
    (0.1, 0.5, 1, 2.69176208595193),
    (0.1, 0.5, 2, 3.27476229637949),
    (0.1, 0.5, 2, 4.66788325419651),
    (0.5, 1.0, 1, 2.63675987555693),
    (0.5, 1.0, 2, 4.42911415342189),
]
GRAZES = [
    (0.05, 0.8, 1.01658832780028),
    (0.1, 0.5, 1.11292970401963),
    (0.5, 1.0, 1.11561617993669),
]

# R, n, lower and upper edge of the stable window in omega at h = 0
WINDOWS = [
    (0.9, 1, 1.264903, 2.652886),
    (0.9, 2, 3.353464, 4.641692),
    (0.9, 3, 5.359596, 6.639072),
    (0.8, 1, 1.260677, 2.653348),
    (0.8, 2, 3.353178, 4.641837),
    (0.8, 3, 5.359488, 6.639142),
    (0.5, 1, 1.195148, 2.658152),
    (0.5, 2, 3.350199, 4.643333),
    (0.5, 3, 5.358368, 6.639864),
]
TWO = Oscillator(h=0.1, R=0.8, omega=1.6, f=1.0, clearance=0.7)


def steady_response(osc, n):
    """Orbits (v, theta), slower first, from the steady response, in 40 digits.

    The free part u = (sigma - G, -R v - H) of the flight ends (1 + R) v faster than it began,
    M u = u + (0, (1 + R) v); so G = sigma + g v, H = k v, and G^2 + (H / omega)^2 = f^2 / D.
    """
    with mp.workdps(40):
        h, R, w, f, p, sigma = map(mp.mpf, dataclasses.astuple(osc))
        flow = mp.expm(mp.matrix([[0, 1], [-p * p, -2 * h]]) * (2 * mp.pi * n / w))
        free = mp.lu_solve(mp.eye(2) - flow, mp.matrix([0, 1 + R]))
        g, k = free[0], free[1] - R
        X = -f / (p * p - w * w + 2j * h * w)
        a, b, c = g * g + (k / w) ** 2, sigma * g, sigma**2 - abs(X) ** 2
        if b * b < a * c:
            return []
        speeds = [(-b + sign * mp.sqrt(b * b - a * c)) / a for sign in (-1, 1)]
        return [
            (float(v), float(mp.arg(mp.mpc(k * v / w, sigma + g * v) / X) % (2 * mp.pi)))
            for v in speeds
            if v > 0
        ]


def through_one_impact(osc, t, x, v, span, guess):
    """Integrate over `span` from t with one impact near the time `guess`, by series."""

    def state(tau):
        return naive.exact_step(osc, t, x, v, tau)

    tau = brentq(lambda tau: state(tau)[0] - osc.clearance, guess - 0.05, guess + 0.05, xtol=1e-15)
    return naive.exact_step(osc, t + tau, osc.clearance, -osc.R * state(tau)[1], span - tau)


@pytest.mark.parametrize(("h", "omega", "R", "n", "v", "phase"), ORBITS)
def test_the_printed_orbits(h, omega, R, n, v, phase):
    """Speed and phase to the last printed digit; they exist and are stable."""
    orbit = one_impact_orbit(oscillator(h, R, omega), n)
    assert orbit.v == pytest.approx(v, rel=0, abs=5.1e-11)
    assert orbit.phase == pytest.approx(phase % (2 * math.pi), rel=0, abs=5.1e-9)
    assert orbit.exists and orbit.stable and orbit.n == n


def test_the_orbit_after_the_upper_edge():
    """h = 0, R = 0.8, omega = 2.64 is stable; two orbits of the text at omega = 1.3."""
    orbit = one_impact_orbit(oscillator(0.0, 0.8, 2.64))
    assert orbit.stable
    assert orbit.v == pytest.approx(0.46237772, abs=5.1e-9)
    for h, R, v in [(0.0, 0.8, 1.4225), (0.02, 0.8, 1.4118), (0.02, 0.95, 1.3135)]:
        orbit = one_impact_orbit(oscillator(h, R, 1.3))
        assert orbit.stable
        assert orbit.v == pytest.approx(v, abs=5.1e-5)


@pytest.mark.slow
def test_orbits_of_another_formulation():
    """400 points, under-, critically and over-damped, any clearance: all orbits, 1e-10."""
    numbers = [0, 0, 0]
    for osc, n in random_oscillators(400, seed=5):
        ours, true = one_impact_orbits(osc, n), steady_response(osc, n)
        assert len(ours) == len(true), osc
        numbers[len(ours)] += 1
        for orbit, (v, phase) in zip(ours, true, strict=True):
            assert orbit.v == pytest.approx(v, rel=1e-10, abs=1e-12)
            turn = abs(orbit.phase - phase)
            assert 0.0 <= orbit.phase < 2 * math.pi
            assert min(turn, 2 * math.pi - turn) < 1e-9
    assert min(numbers) > 15


@pytest.mark.parametrize("R", [0.0, 0.3, 0.8, 1.0])
@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("omega", [0.71, 1.7, 2.6, 4.2, 7.3])
def test_the_undamped_closed_form(R, n, omega):
    """The speed at h = 0, clearance 0."""
    f, p = 1.3, 0.9
    k = math.pi * n * p / omega
    size = math.hypot((1 + R) / math.tan(k) / (2 * p), (1 - R) / (2 * omega))
    orbit = one_impact_orbit(oscillator(0.0, R, omega, f=f, p=p), n)
    assert orbit.v == pytest.approx(f / abs(p * p - omega * omega) / size, rel=1e-11)


@pytest.mark.parametrize("R", [0.0, 0.3, 0.8, 0.99])
def test_twice_the_eigenfrequency(R):
    """Omega = 2p, h = 0, where sin(Om T) = 0: v = 4 f / (3 p (1 - R))."""
    orbit = one_impact_orbit(oscillator(0.0, R, 3.0, f=0.7, p=1.5))
    assert orbit.v == pytest.approx(4 * 0.7 / (3 * 1.5 * (1 - R)), rel=1e-14 / (1 - R))
    assert math.sin(orbit.phase) == pytest.approx(0.0, abs=1e-14 / (1 - R))


def test_resonance_and_the_neighbourhood_of_special_points():
    """At h = 0, omega = p the orbit is the limit of its neighbours, and it closes."""
    for clearance in (0.0, 0.3):
        osc = oscillator(0.0, 0.5, 1.0, clearance)
        orbit = one_impact_orbit(osc)
        near = one_impact_orbit(oscillator(0.0, 0.5, 1.0 + 1e-7, clearance))
        assert orbit.v == pytest.approx(near.v, rel=1e-6)
        assert closing_error(osc, orbit) < 1e-14
    critical = one_impact_orbit(oscillator(1.0, 0.5, 2.3))
    for h in (1.0 - 1e-9, 1.0 + 1e-9):
        assert one_impact_orbit(oscillator(h, 0.5, 2.3)).v == pytest.approx(critical.v, rel=1e-8)


def closing_error(osc, orbit):
    """Distance from the stop and from its speed after a flight, by series in 40 digits."""
    T = orbit.n * osc.forcing_period
    s, c = math.sin(orbit.phase), math.cos(orbit.phase)
    x, v = naive.flow(osc, osc.clearance, -osc.R * orbit.v, s, c, T)
    return max(abs(x - osc.clearance), abs(v - orbit.v)) / max(1.0, orbit.v)


def test_orbits_close():
    """Every orbit of 120 points returns to the stop with its speed and phase."""
    worst = 0.0
    for osc, n in random_oscillators(120, seed=8):
        for orbit in one_impact_orbits(osc, n):
            worst = max(worst, closing_error(osc, orbit) / (osc.p * orbit.n * osc.forcing_period))
    assert 0.0 < worst < 1e-14


@pytest.mark.parametrize(("h", "R", "n", "omega"), FLIPS)
def test_the_printed_flips(h, R, n, omega):
    """Each to 1e-14, and one side of it is stable."""
    osc = oscillator(h, R, 2.0)
    found = bifurcation(osc, "flip", "omega", omega - 0.02, omega + 0.03, n)
    assert found == pytest.approx(omega, rel=1e-14)
    orbit = one_impact_orbit(oscillator(h, R, found), n)
    assert min(orbit.multipliers.real) == pytest.approx(-1.0, abs=1e-11)
    sides = [one_impact_orbit(oscillator(h, R, omega + d), n).stable for d in (-1e-6, 1e-6)]
    assert sides[0] != sides[1]


@pytest.mark.parametrize(("h", "R", "omega"), GRAZES)
def test_the_printed_grazes(h, R, omega):
    """Each to 1e-14; the orbit exists above it and not below."""
    found = bifurcation(oscillator(h, R, 2.0), "graze", "omega", omega - 0.02, omega + 0.03)
    assert found == pytest.approx(omega, rel=1e-14)
    for side in (1e-3, 1e-6, 1e-12):
        assert not one_impact_orbit(oscillator(h, R, omega - side)).exists
        assert one_impact_orbit(oscillator(h, R, omega + side)).exists


@pytest.mark.parametrize(("R", "n", "low", "high"), WINDOWS)
def test_the_stable_windows(R, n, low, high):
    """Both edges to all printed digits; on the flip curve of h = 0; stable only within."""
    for edge in (low, high):
        osc = oscillator(0.0, R, 2.0)
        found = bifurcation(osc, "flip", "omega", edge - 1e-3, edge + 1e-3, n)
        assert found == pytest.approx(edge, rel=0, abs=5.1e-7)
        q = ((1 - R) / (1 + R)) ** 2
        assert math.cos(math.pi * n / found) ** 2 * (found**2 - q) == pytest.approx(1, abs=1e-12)
    inside = np.linspace(low + 1e-6, high - 1e-6, 41)
    assert all(one_impact_orbit(oscillator(0.0, R, omega), n).stable for omega in inside)
    for omega in (low - 2e-6, high + 2e-6):
        assert not one_impact_orbit(oscillator(0.0, R, omega), n).stable


def test_trace_and_determinant_by_their_formulas():
    """At clearance 0: the printed trace, det = R^2 exp(-2hT), and no fold."""
    for osc, n in random_oscillators(300, seed=3, clearance=0.0):
        orbit = one_impact_orbit(osc, n)
        T = n * osc.forcing_period
        assert orbit.determinant == pytest.approx(osc.R**2 * math.exp(-2 * osc.h * T), rel=1e-14)
        assert 1 - orbit.trace + orbit.determinant > 0.0
        assert orbit.multipliers.sum() == pytest.approx(orbit.trace, rel=1e-12, abs=1e-14)
        assert orbit.multipliers.prod() == pytest.approx(orbit.determinant, rel=1e-12)
        if osc.h == osc.p:
            continue
        Om = np.sqrt(complex(osc.p**2 - osc.h**2))
        trace = -2 * osc.R * np.cos(Om * T)
        kick = (1 + osc.R) * osc.f * math.sin(orbit.phase) / orbit.v
        trace = math.exp(-osc.h * T) * (trace - kick * np.sin(Om * T) / Om).real
        assert orbit.trace == pytest.approx(trace, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    ("osc", "n"),
    [
        (oscillator(0.05, 0.7, 2.3), 1),
        (oscillator(0.02, 0.8, 4.1, -0.1), 2),
        (oscillator(0.3, 0.6, 1.8, 0.2, f=1.4, p=1.2), 1),
        (oscillator(1.0, 0.9, 2.5, -0.2), 1),
        (oscillator(1.3, 0.9, 2.5, -0.1), 1),
        (oscillator(0.0, 0.5, 1.0, 0.3), 1),
        (oscillator(0.1, 0.0, 2.0), 1),
        (TWO, 1),
    ],
)
def test_multipliers_by_finite_differences(osc, n):
    """Of the map over one period of the orbit, from a section two fifths of it before the impact.

    Existence does not enter: the map is that of the flight with the one impact.
    """
    T = n * osc.forcing_period
    for orbit in one_impact_orbits(osc, n):
        t = orbit.phase / osc.omega
        start = t + 0.6 * T
        x, v = naive.exact_step(osc, t, osc.clearance, -osc.R * orbit.v, 0.6 * T)
        go = partial(through_one_impact, osc, start, span=T, guess=0.4 * T)
        np.testing.assert_allclose(go(x=x, v=v), (x, v), rtol=1e-11, atol=1e-12)
        e = 2e-6
        columns = [
            np.subtract(go(x=x + dx, v=v + dv), go(x=x - dx, v=v - dv)) / (2 * e)
            for dx, dv in ((e, 0.0), (0.0, e))
        ]
        matrix = np.array(columns).T
        assert orbit.trace == pytest.approx(np.trace(matrix), rel=1e-7, abs=1e-8)
        assert orbit.determinant == pytest.approx(np.linalg.det(matrix), rel=1e-7, abs=1e-8)
        np.testing.assert_allclose(
            np.poly(orbit.multipliers), [1.0, -orbit.trace, orbit.determinant], atol=1e-14
        )
