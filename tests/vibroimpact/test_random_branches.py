"""Branches in 40 digits: random ones, over the frequency of a base, and over wide ranges."""

import math
from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest

from tests.helpers.kernel_cases import few_or_many
from tests.helpers.naive import ClosedForm
from tests.helpers.oscillators import SectionMap, random_oscillators, settled_orbit
from vibroimpact.orbits.branches import branch
from vibroimpact.orbits.one_impact import one_impact_orbit, one_impact_orbits
from vibroimpact.oscillator import Oscillator


def exact(point, axis):
    """Return where a bifurcation of a branch is, by its section map.

    That is singular at a graze where every natural vibration repeats: undamped at omega = n p.
    """
    osc, m = point.orbit.oscillator, point.orbit.m
    if point.kind == "graze" and osc.h == 0.0 and abs(osc.omega / (m * osc.p) - 1.0) < 1e-6:
        return {"omega": m * osc.p, "p": osc.omega / m}[axis]
    return SectionMap(point.orbit).bifurcation(point.kind, axis)


@pytest.mark.parametrize(
    ("osc", "n"),
    [
        (Oscillator(h=0.0, R=0.816275349690762, omega=4.525028781813961, f=0.5562443859270125,
                    p=1.4076976128968552, clearance=0.3097576476882654), 3),
        (Oscillator(h=0.0, R=0.7028936034449044, omega=3.7405928078447332, f=0.0,
                    p=1.714012647311538, clearance=0.4269918579611559, a=0.09637868825649189), 2),
    ],
)  # fmt: skip
def test_an_undamped_branch_loses_its_speed_where_every_vibration_repeats(osc, n):
    """In the closed form v is proportional to tan(pi n p / omega) there: zero at omega = n p."""
    found = branch(one_impact_orbit(osc, n), "omega", 0.85 * osc.omega, 1.15 * osc.omega)
    graze, *_ = found.special
    assert (graze.kind, graze.orbit.speeds.tolist()) == ("graze", [0.0])
    assert graze.value == pytest.approx(n * osc.p, rel=1e-14)


@few_or_many("count", 8, 500)
@pytest.mark.parametrize("shaken", [False, True])
def test_random_bifurcations_are_those_of_the_section_map(count, shaken):
    """To 1e-13, any damping but the critical; and a branch is stable where the closed form is.

    The force is f, or half or all of it comes from a base, along omega or its amplitude.
    """
    compared = {"flip": 0, "fold": 0, "graze": 0}
    rng = np.random.default_rng(4)
    for osc, n in random_oscillators(60 * count, seed=31, clearance=0.5):
        if sum(compared.values()) >= count:
            break
        axis = str(rng.choice(["h", "R", "omega", "f", "p", "clearance"]))
        if shaken:
            share, axis = rng.choice([0.5, 1.0]), str(rng.choice(["omega", "a"]))
            osc = replace(osc, f=(1.0 - share) * osc.f, a=share * osc.f / osc.omega**2)
        orbits, value = one_impact_orbits(osc, n), getattr(osc, axis)
        if osc.h == osc.p or not orbits or not orbits[-1].exists or not value:
            continue
        ends = sorted((0.85 * value, min(1.15 * value, 1.0 if axis == "R" else math.inf)))
        found = branch(orbits[-1], axis, *ends)
        for point in found.special:
            if point.kind in compared:
                with mp.workdps(50):
                    assert abs(point.value / exact(point, axis) - 1) < 1e-13
                compared[point.kind] += 1
        at_special = np.isin(found.values, [point.value for point in found.special])
        for i in np.flatnonzero(~at_special)[::5].tolist():
            orbits = one_impact_orbits(replace(osc, **{axis: float(found.values[i])}), n)
            nearest = min(orbits, key=lambda orbit: abs(orbit.v - found.speeds[i, 0]))
            assert nearest.v == pytest.approx(found.speeds[i, 0], rel=1e-9)
            assert nearest.stable == found.stable[i]
    assert sum(compared.values()) >= count and min(compared.values()) > count // 6


@pytest.mark.parametrize(
    "osc",
    [
        Oscillator(
            h=0.05, R=0.3753126481060007, omega=2.6903152778618624, f=1.0,
            clearance=0.08911435294394687,
        ),
        Oscillator(h=0.01, R=0.6175240725045801, omega=3.0457449019, a=0.3),
    ],
)  # fmt: skip
def test_the_graze_of_a_branch_has_its_impact_of_speed_zero_though_others_are_as_slow(osc):
    """Newton's method misses some of them; each flight is a closed form, and it touches there."""
    start = settled_orbit(osc, 2)
    found = branch(start, "omega", 0.95 * osc.omega, 1.05 * osc.omega)
    grazes = [point.orbit for point in found.special if point.kind == "graze"]
    assert sorted(orbit.q for orbit in grazes) == [found.q, found.q + 1]
    for orbit in grazes:
        assert np.count_nonzero(orbit.speeds == 0.0) == 1
        there, k = orbit.oscillator, int(np.argmin(orbit.speeds))
        theta, v = orbit.phases[k - 1], orbit.speeds[k - 1]
        flight = ClosedForm(there, theta / there.omega, there.clearance, -there.R * v)
        x, u = flight(orbit.phases[k] / there.omega)
        assert x == pytest.approx(there.clearance, abs=1e-9) and u == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("osc", "m"),
    [
        (Oscillator(h=0.0582, R=0.4135, omega=2.1931, f=1.0, clearance=-0.4096), 1),
        (Oscillator(h=0.00149, R=0.7685, omega=1.8621, f=1.0, clearance=-0.3599), 3),
    ],
)
def test_a_wide_range_hides_no_flip_or_fold(osc, m):
    """In natural units, which are those of the greatest force, the speeds are tiny there."""
    start = settled_orbit(osc, m, x0=osc.clearance)
    narrow, wide = (
        {(p.kind, float(f"{p.value:.9g}")) for p in branch(start, "f", 0.5, high).special}
        for high in (2.0, 2e7)
    )
    assert {"flip", "fold"} < {kind for kind, _ in narrow} and narrow == wide
