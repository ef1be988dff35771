"""The criticality of flips: in 60 digits, and by simulation on both sides of the flip."""

import math
from dataclasses import replace
from itertools import islice

import mpmath as mp
import numpy as np
import pytest

from tests.helpers.oscillators import SectionMap
from vibroimpact import Oscillator, branch, integrate, periodic_orbit
from vibroimpact.orbits.periodic import OrbitError


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


def in_digits(name, flip):
    """Return the criticality of a flip in 60 digits."""
    with mp.workdps(60):
        there = SectionMap(flip.orbit)
        there.bifurcation("flip", name)
        return "supercritical" if there.cubic_coefficient() > 0 else "subcritical"


@pytest.mark.parametrize(
    "count",
    [pytest.param(12, marks=pytest.mark.slow), pytest.param(400, marks=pytest.mark.campaign)],
)
def test_the_criticality_is_that_of_the_cubic_coefficient_in_60_digits(count):
    for name, flip in islice(random_flips(seed=1), count):
        assert flip.orbit.criticality == in_digits(name, flip), flip


def run(osc, starts, phase, periods, record):
    """Return the states at the last sections of many motions, shape (n, record, 2)."""
    points = np.repeat(osc.at(min(0.0, osc.clearance)), len(starts))
    points["x0"], points["v0"], points["phase"] = *starts.T, phase
    found = integrate(points, transient=periods - record, periods=record, phase=phase,
                      at_section=True, impacts=0)  # fmt: skip
    return np.stack([found["poincare_x"], found["poincare_v"]], axis=2)


def sizes_at(name, flip, away):
    """Return how large orbits of twice the period are where the multiplier is -1 -+ `away`.

    The first is the size on which motions settle where the orbit is unstable; the second is the
    size from which on they leave it where it is stable. NaN if there is none.
    """
    orbit, m = flip.orbit, flip.orbit.m
    phases = np.append(orbit.phases, orbit.phases[0] + 2.0 * math.pi * m)
    longest = int(np.argmax(np.diff(phases)))
    phase = float(phases[longest : longest + 2].mean() % (2.0 * math.pi))
    sections, sizes, step = orbit.sections(phase), [math.nan, math.nan], 1e-6
    near = sections[np.argmin(sections[:, 0])]

    def beside(change):
        osc = replace(orbit.oscillator, **{name: flip.value + change})
        return periodic_orbit(osc, *near, m, phase)

    slope = (beside(step).multipliers[0].real - beside(-step).multipliers[0].real) / (2.0 * step)
    moves = np.concatenate([np.eye(2), -np.eye(2)]) * 1e-7
    D = run(orbit.oscillator, near + moves, phase, m, 1)[:, 0]
    values, vectors = np.linalg.eig((D[:2] - D[2:]).T / 2e-7)
    along = vectors[:, np.argmin(np.abs(values + 1.0))].real
    along /= np.abs(along).max()
    for side in (0, 1):
        here = beside((2.0 * side - 1.0) * away / slope)
        sections = here.sections(phase)
        parent = sections[np.argmin(np.abs(sections - near).max(axis=1))]
        starts = np.geomspace(1e-4, 0.4, 50) if side else np.array([1e-4])
        starts = parent + starts[:, None] * along
        starts = starts[starts[:, 0] < here.oscillator.clearance]
        ends = run(here.oscillator, starts, phase, 2 * m * int(12.0 / away), 4 * m)
        off = np.abs(ends[:, -1] - parent).max(axis=1)
        if side:  # the first that has not come nearer
            leaves = np.flatnonzero(~(off < 0.5 * np.abs(starts - parent).max(axis=1)))
            sizes[1] = float(np.abs(starts[leaves[0]] - parent).max()) if leaves.size else math.nan
        elif np.abs(ends[:, -1] - ends[:, -1 - 2 * m]).max() < 1e-3 * off[0]:
            sizes[0] = float(off[0])
    return sizes


def by_simulation(name, flip, away=1e-2):
    """Return the criticality by simulation: sizes that are halved with a quarter of `away`."""
    first, second = (np.array(sizes_at(name, flip, there)) for there in (away, away / 4.0))
    halved = np.abs(second / first - 0.5) < 0.12
    if halved[0] and not halved[1]:
        return "supercritical"
    return "subcritical" if halved[1] and not halved[0] else "unknown"


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "criticality"), [(2, "supercritical"), (7, "subcritical")])
def test_criticality_by_simulation_on_both_sides(seed, criticality):
    flips = ((name, p) for name, p in random_flips(seed) if p.orbit.criticality == criticality)
    told = [by_simulation(name, flip) for name, flip in islice(flips, 2)]
    assert set(told) - {"unknown"} == {criticality}


@pytest.mark.campaign
def test_random_criticality_by_simulation_on_both_sides():
    """One of 25 random flips is subcritical: told are 25 of these, and 175 of the others."""
    told, most = {"supercritical": 0, "subcritical": 0}, {"supercritical": 175, "subcritical": 25}
    for name, flip in random_flips(seed=2):
        if told.get(flip.orbit.criticality) == most.get(flip.orbit.criticality):
            continue
        try:
            seen = by_simulation(name, flip)
        except (OrbitError, ValueError):  # the orbit ends beside the flip
            continue
        seen = by_simulation(name, flip, 1e-3) if seen == "unknown" else seen
        if seen != "unknown":
            assert seen == flip.orbit.criticality, flip
            told[seen] += 1
        if sum(told.values()) == 200:
            return
