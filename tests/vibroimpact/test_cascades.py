"""Flips, their criticality and their cascades: branches of twice the period, and ratios."""

import math
from dataclasses import replace
from itertools import islice

import mpmath as mp
import numpy as np
import pytest

from tests.helpers.kernel_cases import few_or_many
from tests.helpers.oscillators import SectionMap, random_oscillators, special
from vibroimpact import integrate
from vibroimpact.orbits.branches import branch, doubled_branch
from vibroimpact.orbits.one_impact import one_impact_orbit, one_impact_orbits
from vibroimpact.orbits.orbit import PeriodicOrbit
from vibroimpact.orbits.periodic import OrbitError, periodic_orbit
from vibroimpact.oscillator import Oscillator
from vibroimpact.trajectory import simulate


def doubled_branches(seed):
    """Yield branches of orbits of twice the period, and their ranges, from random oscillators."""
    rng = np.random.default_rng(seed)
    for osc, n in random_oscillators(10**6, seed, clearance=0.5):
        osc = replace(osc, h=rng.choice([0.0, 0.1]) * rng.uniform(), R=rng.uniform(0.3, 1.0))
        axis = str(rng.choice(["R", "omega", "p", "clearance"]))
        value = getattr(osc, axis)
        ends = (-0.6, 0.6) if axis == "clearance" else (max(value - 0.3, 0.05), value + 0.3)
        ends = ends[0], min(ends[1], 1.0) if axis == "R" else ends[1]
        orbits = one_impact_orbits(osc, n)[-1:]
        queue = [branch(orbit, axis, *ends) for orbit in orbits if orbit.exists]
        while queue:
            single = queue.pop()
            for point in single.special:
                if point.kind == "flip" and point.orbit.m == single.m:
                    found = doubled_branch(point.orbit, axis, *ends)
                    yield found, ends
                    if found.m <= 4 * n:
                        queue.append(found)


@few_or_many(("seed", "count"), (14, 12), (15, 4000))
def test_a_branch_has_the_same_special_points_from_wherever_it_is_followed(seed, count):
    rng, followed = np.random.default_rng(8), 0
    for found, ends in islice(doubled_branches(seed), count):
        # At a resonance without damping, a branch may be at a single value.
        narrow = np.ptp(found.values) < 1e-6
        if len(found.values) < 4 or narrow or special(found, "lost") or len(found.special) > 20:
            continue
        expected = [(p.kind, p.orbit.m, p.value) for p in found.special]
        expected = sorted([*expected, ("flip", found.m // 2, found.values[0])])
        for i in rng.integers(1, len(found.values) - 1, 3).tolist():
            again = branch(found.orbit(i), *found.parameters, *ends)
            listed = sorted((p.kind, p.orbit.m, p.value) for p in again.special)
            assert [item[:2] for item in listed] == [item[:2] for item in expected]
            values = [item[2] for item in expected]
            assert [item[2] for item in listed] == pytest.approx(values, abs=1e-8)
        followed += 1
    assert followed > count // 2


def feigenbaum(count):
    found = branch(one_impact_orbit(Oscillator(0.0, 0.8, 2.6, 1.0)), "omega", 2.4, 3.0)
    flip = max((p for p in found.special if p.kind == "flip"), key=lambda point: point.value)
    flips = [flip]
    for _ in range(count):
        found = doubled_branch(flip.orbit, "omega", 2.4, 2.9)
        flip = found.special[0]
        assert flip.kind == "flip" and (found.m, found.q) == (2 * flips[-1].orbit.m,) * 2
        flips.append(flip)
    return flips


def test_the_orbits_just_beyond_a_flip_are_those_of_twice_the_period():
    """The halves differ by the square root of the distance; nearer, they were taken for one."""
    (flip,) = feigenbaum(0)
    assert flip.orbit.criticality == "supercritical"
    found, sizes = doubled_branch(flip.orbit, "omega", 2.4, 2.9), []
    for away in (1e-6, 1e-7, 1e-8, 1e-9):
        shares = []
        for further in away * np.linspace(0.8, 1.2, 9):  # each with an error of its own
            (orbit,) = found.at(flip.value + further)
            assert (orbit.m, orbit.q, orbit.stable) == (2, 2, True)
            shares.append(abs(np.diff(orbit.speeds)[0]) / math.sqrt(further))
        sizes.append(np.median(shares))
        again = branch(orbit, "omega", 2.4, 2.9)
        assert [point.kind for point in again.special] == ["flip", "flip", "edge"]
    assert sizes == pytest.approx([sizes[0]] * 4, rel=1e-3)
    assert found.at(flip.value) == []


@pytest.mark.parametrize("width", [1e-3, 1e-8])
def test_a_weak_spring_hides_no_flip_in_a_narrow_range(width):
    """A ball on a table, nearly: the speed p |clearance| is 2,000 times that of any impact."""
    osc = Oscillator(h=0.0, R=0.15, omega=1.0, f=2.8, p=1e-4, clearance=-1e8)
    first = branch(one_impact_orbit(osc), "f", 2.5, 4.0)
    (start,) = [point.orbit for point in first.special if point.kind == "flip"]
    whole = doubled_branch(start, "f", 2.5, 4.0)
    (flip,) = special(whole, "flip")
    (beside,) = whole.at(flip - 0.3 * width)
    narrow = branch(beside, "f", flip - width, flip + width)
    assert [point.kind for point in narrow.special] == ["edge", "flip", "edge"]
    (value,) = special(narrow, "flip")
    assert value == pytest.approx(flip, abs=1e-12)
    assert narrow.stable.tolist() == (narrow.values < value).tolist()


@pytest.mark.slow
def test_feigenbaums_ratio_after_seven_further_flips():
    """4.6692; the last orbit has 256 impacts, and returns to itself in simulation."""
    flips = feigenbaum(8)
    values = [flip.value for flip in flips]
    assert values[1] == pytest.approx(2.715987251, abs=5e-10)
    assert values[2] == pytest.approx(2.7291177, abs=5e-7)
    distances = np.diff(values)
    assert distances[-2] / distances[-1] == pytest.approx(4.6692, abs=5e-4)
    orbit = flips[-1].orbit
    assert orbit.m == 256
    (x, v), *_ = orbit.sections()
    run = simulate(orbit.oscillator, 256, x0=x, v0=v)
    assert run.section_x[-1] == pytest.approx(x, abs=1e-9)


#: Branches of orbits of twice the period that begin at the flip of their half or beside it, at an
#: edge: an oscillator, phases, speeds, the range, and the special points with their periods. The
#: flip of the first is 1.4e-12 below its range.
BESIDE_FLIPS = [
    ((0.2701713793172191, 0.6245254305220789, 3.7163736178086912, -0.23880672490763227),
     (1.3272832574167093, 6.6556027622407194), (0.37149435449185675, 0.48115579959438914),
     (3.5975316443377405, 4.552088788122919), [("edge", 2), ("flip", 2), ("edge", 2)]),
    ((0.012818069992111204, 0.738095818397541, 4.028629611985198, -0.44314465722733387),
     (1.2732074880830258, 7.531395083563601), (0.5752326523833, 0.5758941873551471),
     (4.028546107656853, 4.31640534252883), [("edge", 2), ("edge", 2)]),
]  # fmt: skip


@pytest.mark.parametrize(("values", "phases", "speeds", "ends", "expected"), BESIDE_FLIPS)
def test_a_branch_of_twice_the_period_is_listed_once_and_has_no_fold_beside_its_flip(
    values, phases, speeds, ends, expected
):
    """Beyond it lie the same orbits with their halves exchanged; at it their fold is rounding."""
    h, R, omega, clearance = values
    osc = Oscillator(h=h, R=R, omega=omega, f=1.0, clearance=clearance)
    start = PeriodicOrbit(osc, 2, np.array(phases), np.array(speeds))
    found = branch(start, "omega", *ends)
    assert [(point.kind, point.orbit.m) for point in found.special] == expected


def random_flips(seed):
    """Yield flips of random periodic motions: the parameter and the special point."""
    rng = np.random.default_rng(seed)
    while True:
        osc = Oscillator(
            h=rng.choice([0.0, 10 ** rng.uniform(-3.0, -0.5)]), R=rng.uniform(0.4, 0.97),
            omega=rng.uniform(0.5, 5.0), f=1.0, clearance=rng.choice([0.0, rng.uniform(-0.5, 1.5)]),
        )  # fmt: skip
        points = osc.at(min(0.0, osc.clearance))
        x, v = (integrate(points, transient=400, periods=9)[name][0] for name in
                ("poincare_x", "poincare_v"))  # fmt: skip
        repeats = [m for m in range(1, 8) if abs(x[-1] - x[-1 - m]) < 1e-8]
        if not repeats or np.isnan(x[-1]):
            continue
        name = str(rng.choice(["omega", "R", "clearance"]))
        value = getattr(osc, name)
        low, high = (0.01, 1.0) if name == "R" else (value - 0.2, value + 0.2)
        try:
            found = branch(periodic_orbit(osc, x[-1], v[-1], repeats[0]), name, low, high)
        except OrbitError:
            continue
        flips = [point for point in found.special if point.kind == "flip"]
        yield from ((name, flip) for flip in flips if flip.orbit.speeds.min() > 1e-3)


@few_or_many("count", 4, 400)
def test_the_criticality_is_that_of_the_cubic_coefficient_in_60_digits(count):
    for name, flip in islice(random_flips(seed=1), count):
        with mp.workdps(60):
            there = SectionMap(flip.orbit)
            there.bifurcation("flip", name)
            expected = "supercritical" if there.cubic_coefficient() > 0 else "subcritical"
        assert flip.orbit.criticality == expected, flip
