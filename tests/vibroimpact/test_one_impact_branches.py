"""Flips, folds and grazes on random branches of one-impact orbits, in 40 digits and more.

Folds are compared with their closed form, flips and grazes with Newton's method on the section map.
Beside a fold both orbits go as the square root of the distance, so the state there has half the
digits that the distance has. The parameter's value at the fold has them all: it is a smooth
function of the oscillator, so a fold is found to a few roundings times its condition number.
"""

import math
from dataclasses import astuple, replace
from itertools import islice

import mpmath as mp
import numpy as np
import pytest

from oscillators import SectionMap, random_oscillators
from vibroimpact.orbits.branches import branch
from vibroimpact.orbits.one_impact import one_impact_orbit, one_impact_orbits
from vibroimpact.orbits.periodic import solved
from vibroimpact.oscillator import Oscillator

EPS = 2.0**-52


def closed_form(osc, n):
    """The clearance at which both n/1 orbits meet, and their speed there; `osc` has six numbers.

    The free part u of the flight has M u = u + (0, (1 + R) v), so that x_p = sigma + g v and
    x_p' = k omega v at the impact: (sigma + g v)^2 + (k v)^2 = X^2, X the free amplitude, which has
    a double root v > 0 where sigma = -sign(g) X sqrt(g^2 + k^2) / |k|.
    """
    h, R, omega, f, p, _ = osc
    T = 2 * mp.pi * n / omega
    rate = mp.sqrt(mp.mpc(h * h - p * p))
    decay = mp.exp(-h * T)
    response = (decay * mp.sinh(rate * T) / rate).real if rate else decay * T
    trace = (2 * decay * mp.cosh(rate * T)).real
    determinant = 1 - trace + decay**2  # of I - M
    g = (1 + R) * response / determinant
    k = ((1 + R) * (1 - trace / 2 - h * response) / determinant - R) / omega
    X = f / mp.hypot(p * p - omega * omega, 2 * h * omega)
    sigma = -mp.sign(g) * X * mp.hypot(g, k) / abs(k)
    return sigma, -sigma * g / (g * g + k * k)


def condition(osc, n):
    """By how many roundings the fold moves when each of its data moves by one; h by one of p."""
    step, (sigma, _) = mp.mpf(10) ** -18, closed_form(osc, n)
    total = mp.mpf(0)
    for i in range(5):
        moved = list(osc)
        moved[i] += step * (osc[i] if i else osc[4])
        total += abs(closed_form(moved, n)[0] / sigma - 1) / step
    return float(total)


def random_folds(seed):
    """Yield oscillators just beside a fold of admissible n/1 orbits, n, and the faster of these."""
    rng = np.random.default_rng(seed)
    while True:
        p = rng.uniform(0.5, 2.0)
        h = p * float(rng.choice([0.0, 1.0, rng.uniform(0.0, 0.5), rng.uniform(0.5, 2.0)]))
        osc = Oscillator(h, rng.uniform(), p * rng.uniform(0.5, 6.0), 1.0, p)
        n = int(rng.integers(1, 4))
        osc = replace(osc, clearance=0.9999 * float(closed_form(in_digits(osc), n)[0]))
        orbits = one_impact_orbits(osc, n)
        if len(orbits) == 2 and all(orbit.exists for orbit in orbits):
            yield osc, n, orbits[1]


def in_digits(osc):
    """The parameters in multiple precision."""
    return [mp.mpf(value) for value in astuple(osc)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("axis", "count"),
    [("clearance", 50), ("h", 15), ("R", 15), ("omega", 15), ("f", 15), ("p", 15)],
)
def test_random_folds_are_at_their_closed_form(axis, count):
    """As many as the closed form has on the branch; undamped, critical and over-damped too."""
    cases = (case for case in random_folds(seed=5) if getattr(case[0], axis))
    with mp.workdps(40):
        for osc, n, orbit in islice(cases, count):
            value = getattr(osc, axis)
            ends = sorted((0.998 * value, min(1.002 * value, 1.0 if axis == "R" else math.inf)))
            start = solved(osc, n, np.array([orbit.phase]), np.array([orbit.v]))
            assert (start.m, start.q) == (n, 1)
            folds = [point for point in branch(start, axis, *ends).special if point.kind == "fold"]
            assert len(folds) == sum(
                at_end.clearance / closed_form(in_digits(at_end), n)[0] > 1
                for at_end in (replace(osc, **{axis: end}) for end in ends)
            )
            values = [point.value for point in folds]
            speeds = [float(point.orbit.speeds[0]) for point in folds]
            for value, speed in zip(values, speeds, strict=True):
                at_fold = replace(osc, **{axis: value})
                sigma, v = closed_form(in_digits(at_fold), n)
                rounding = EPS * (1.0 + condition(in_digits(at_fold), n))
                assert abs(at_fold.clearance / sigma - 1) < 32.0 * rounding
                assert abs(speed / v - 1) < 100.0 * rounding


@pytest.mark.parametrize(
    "count",
    [pytest.param(12, marks=pytest.mark.slow), pytest.param(500, marks=pytest.mark.campaign)],
)
def test_random_flips_and_grazes_are_those_of_the_section_map(count):
    """To 1e-13, any damping but the critical; and a branch is stable where the closed form is."""
    compared = {"flip": 0, "graze": 0}
    rng = np.random.default_rng(4)
    for osc, n in random_oscillators(60 * count, seed=31, clearance=0.5):
        if sum(compared.values()) >= count:
            break
        closed = one_impact_orbit(osc, n)
        axis = str(rng.choice(["h", "R", "omega", "f", "p", "clearance"]))
        value = getattr(osc, axis)
        if osc.h == osc.p or not closed.exists or not value:
            continue
        start = solved(osc, n, np.array([closed.phase]), np.array([closed.v]))
        ends = sorted((0.85 * value, min(1.15 * value, 1.0 if axis == "R" else math.inf)))
        found = branch(start, axis, *ends)
        for point in found.special:
            if point.kind in compared:
                with mp.workdps(50):
                    expected = SectionMap(point.orbit).bifurcation(point.kind, axis)
                    assert abs(point.value / expected - 1) < 1e-13
                compared[point.kind] += 1
        at_special = np.isin(found.values, [point.value for point in found.special])
        for i in np.flatnonzero(~at_special)[::5].tolist():
            orbits = one_impact_orbits(replace(osc, **{axis: float(found.values[i])}), n)
            nearest = min(orbits, key=lambda orbit: abs(orbit.v - found.speeds[i, 0]))
            assert nearest.v == pytest.approx(found.speeds[i, 0], rel=1e-9)
            assert nearest.stable == found.stable[i]
    assert sum(compared.values()) >= count and min(compared.values()) > count // 4
