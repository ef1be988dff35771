"""Orbits with one impact: closed forms, bifurcations, where they exist, and what is refused."""

import dataclasses
import math
from functools import partial

import mpmath as mp
import numpy as np
import pytest

from tests.helpers import naive
from tests.helpers.oscillators import (
    bifurcation,
    fold_of_one_impact,
    in_digits,
    one_impact_motions,
    oscillator,
    peak,
    random_oscillators,
)
from vibroimpact import OrbitError, Oscillator, one_impact_orbit, one_impact_orbits

TWO = Oscillator(h=0.1, R=0.8, omega=1.6, f=1.0, clearance=0.7)


@pytest.mark.slow
def test_random_orbits_are_all_that_another_formulation_has_and_close():
    """400 points, under-, critically and over-damped, any clearance.

    Every orbit returns to the stop with its speed and phase; the slower alone is a saddle, as the
    docstring of the module proves.
    """
    numbers, worst = [0, 0, 0], 0.0
    for k, (osc, n) in enumerate(random_oscillators(400, seed=5)):
        ours = one_impact_orbits(osc, n)
        with mp.workdps(40):
            true = one_impact_motions(in_digits(osc), n)
        assert len(ours) == len(true), osc
        numbers[len(ours)] += 1
        for orbit, (v, _), sign in zip(ours, true, (-1, 1)[2 - len(ours) :], strict=True):
            assert orbit.v == pytest.approx(float(v), rel=1e-10, abs=1e-12)
            assert 0.0 <= orbit.phase < 2 * math.pi and sign * at_fold(orbit) > 0.0
            if k % 3 == 0:
                worst = max(worst, closing_error(osc, orbit) / (osc.p * n * osc.forcing_period))
    assert min(numbers) > 15 and 0.0 < worst < 1e-14


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
    """Return the larger error of position and speed after a flight, by series in 40 digits."""
    T = orbit.m * osc.forcing_period
    s, c = math.sin(orbit.phase), math.cos(orbit.phase)
    x, v = naive.flow(osc, osc.clearance, -osc.R * orbit.v, s, c, T)
    return max(abs(x - osc.clearance), abs(v - orbit.v)) / max(1.0, orbit.v)


def flight_of(osc, orbit, count=20001):
    """Return x - clearance on samples of the flight between two impacts; not for h = p."""
    flight = naive.ClosedForm(osc, orbit.phase / osc.omega, osc.clearance, -osc.R * orbit.v)
    x, _ = flight(flight.t0 + np.linspace(0.0, orbit.m * osc.forcing_period, count))
    return x - osc.clearance


@pytest.mark.slow
def test_existence_by_brute_force():
    """120 points: as on 20,000 samples of the flight, with and without a maximum."""
    seen = set()
    for osc, n in random_oscillators(120, seed=11, clearance=0.4):
        if osc.h == osc.p:
            continue
        for orbit in one_impact_orbits(osc, n):
            x = flight_of(osc, orbit)
            tops = (x[:-2] < x[1:-1]) & (x[1:-1] >= x[2:])
            assert orbit.exists == (x[2:-2].max() < 0.0) and orbit.stable <= orbit.exists
            seen.add((orbit.exists, bool(tops.any())))
    assert seen == {(True, True), (True, False), (False, True)}


@pytest.mark.parametrize("depth", [1e-4, 1e-7, 1e-11, 1e-13])
def test_a_touch_of_any_depth_decides_existence(depth):
    """Moved from the graze so that the maximum passes or misses the stop by a given depth."""
    osc = oscillator(0.05, 0.8, 2.0)
    graze = bifurcation(osc, "graze", "omega", 1.0, 1.05)
    slope = peak(one_impact_orbit(oscillator(0.05, 0.8, graze + 1e-6))) / 1e-6
    for side in (-1, 1):
        orbit = one_impact_orbit(oscillator(0.05, 0.8, graze + side * depth / slope))
        assert peak(orbit) == pytest.approx(side * depth, rel=5e-3, abs=2e-14)
        assert orbit.exists == (side < 0)


def test_a_maximum_in_the_middle_of_a_symmetric_flight():
    """h = 0, R = 1: the flight is its own mirror image, and x' = 0 at T / 2 to rounding."""
    at_top = 0
    for omega in np.linspace(0.31, 6.9, 60):
        for n in (1, 2, 3):
            for clearance in (-0.3, 0.0, 0.3):
                osc = oscillator(0.0, 1.0, omega, clearance)
                for orbit in one_impact_orbits(osc, n):
                    x = flight_of(osc, orbit, 2001)
                    if x[999] < x[1000] > x[1001] and x[1000] == x[1:-1].max():
                        at_top += 1
                        assert orbit.exists == (x[1000] < 0.0)
    assert at_top > 20


def test_a_launch_into_the_stop_is_no_orbit():
    """R = 0, the force pressing at the impact: the mass does not leave."""
    orbits = [one_impact_orbit(oscillator(h, 0.0, 0.8)) for h in np.linspace(0.0, 0.5, 20)]
    pressed = [orbit for orbit in orbits if math.sin(orbit.phase) < 0.0]
    assert pressed
    assert not any(orbit.exists for orbit in pressed)


@pytest.mark.parametrize(
    ("R", "omega", "n"),
    [
        (0.23928355917506167, 0.5999761292783834, 3),
        (0.8, 0.50001, 1),
        (0.5, 0.49999, 1),
        (0.7, 0.66667, 2),
        (0.7, 0.75, 1),
        (0.6, 2.2, 1),
    ],
)
def test_a_fold_near_a_multiple_of_the_natural_period(R, omega, n):
    """At h = 0, against its closed form in 40 digits, where 1 - cos(p T) is nearly 0."""
    osc = Oscillator(0.0, R, omega, 1.0)
    with mp.workdps(40):
        fold = float(fold_of_one_impact(in_digits(osc), n)[0])
    bracket = sorted((0.5 * fold, 1.5 * fold))
    assert bifurcation(osc, "fold", "clearance", *bracket, n) == pytest.approx(fold, rel=1e-13)


def at_fold(orbit):
    return np.prod(1.0 - orbit.multipliers).real


def test_two_orbits_and_the_fold_where_they_meet():
    """The faster is a node, the slower a saddle; they meet at the fold's closed form, and end."""
    slow, fast = one_impact_orbits(TWO)
    assert 0.0 < slow.v < fast.v
    assert one_impact_orbit(TWO).v == fast.v
    assert fast.stable
    assert slow.exists and not slow.stable
    assert at_fold(slow) < 0.0 < at_fold(fast)
    fold = bifurcation(TWO, "fold", "f", 0.2, 1.0)
    with mp.workdps(40):  # the clearance at the fold is proportional to f
        true = float(TWO.clearance / fold_of_one_impact(in_digits(TWO), 1)[0])
    assert fold == pytest.approx(true, rel=1e-14)
    at = partial(dataclasses.replace, TWO)
    assert one_impact_orbits(at(f=fold - 1e-9)) == ()
    slow, fast = one_impact_orbits(at(f=fold + 1e-9))
    assert fast.v - slow.v < 1e-3
    assert at_fold(slow) == pytest.approx(0.0, abs=1e-3)
    for name, bracket in (("clearance", (0.7, 2.0)), ("omega", (1.6, 1.9))):
        value = bifurcation(TWO, "fold", name, *bracket)
        counts = [len(one_impact_orbits(at(**{name: value + d}))) for d in (-1e-9, 1e-9)]
        assert counts == [2, 0]


@pytest.mark.parametrize(
    ("osc", "n"),
    [
        (oscillator(0.0, 1.0, 2.0), 1),  # grows without bound
        (oscillator(0.0, 1.0, 1.4, f=0.7, p=0.7), 3),
        (oscillator(0.0, 0.5, 2.0), 2),  # the flight is a multiple of the eigenperiod
        (oscillator(0.0, 0.5, 0.5, 0.4), 1),
        (oscillator(0.1, 0.5, 1.0, f=0.0), 1),
        (oscillator(0.0, 1.0, 3.0, -0.5, f=0.0), 1),  # free bouncing: a family
        (oscillator(0.1, 0.5, 1.7, 50.0), 1),  # out of reach
        (oscillator(0.1, 0.5, 1.7, -50.0), 1),  # pressed too hard
        (oscillator(0.1, 0.5, 1e200), 1),
    ],
)
def test_where_the_equations_have_no_orbit_none_is_returned(osc, n):
    assert one_impact_orbits(osc, n) == ()
    with pytest.raises(OrbitError, match=f"no solution with one impact in {n} forcing periods?"):
        one_impact_orbit(osc, n)


@pytest.mark.parametrize("n", [0, -1, 1.0, True, "1", None, 10**9, 10**30, np.int64(10**9)])
def test_n_is_an_integer_and_not_too_great(n):
    for call in (one_impact_orbits, one_impact_orbit):
        with pytest.raises(ValueError, match=r"^n = .* expected: an integer from 1 to 32,768"):
            call(TWO, n)


def test_numbers_out_of_scale_are_refused():
    changes = [{"h": 1e155}, {"omega": 1e-9}, {"omega": 1e-310}, {"p": 5e-324}, {"f": 1e200}]
    for change in (*changes, {"p": 1e160, "omega": 1e160}):
        osc = dataclasses.replace(oscillator(0.0, 0.5, 2.3), **change)
        with pytest.raises(ValueError, match=r"would be .* time steps, more|too large or too sm"):
            one_impact_orbit(osc)
