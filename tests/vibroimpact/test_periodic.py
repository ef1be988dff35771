"""Periodic orbits by their impacts: closed forms, the paper's motions, what every orbit obeys."""

import math
from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest

from tests.helpers import naive
from tests.helpers.oscillators import SectionMap, characteristic, settled_orbit
from vibroimpact.orbits.branches import branch
from vibroimpact.orbits.calls import correct
from vibroimpact.orbits.curves import bifurcation_curve
from vibroimpact.orbits.family import OrbitFamily
from vibroimpact.orbits.one_impact import one_impact_orbit
from vibroimpact.orbits.orbit import PeriodicOrbit
from vibroimpact.orbits.periodic import OrbitError, periodic_orbit, solved, why_inadmissible
from vibroimpact.oscillator import Oscillator
from vibroimpact.step.polynomial import LONGEST_STEP
from vibroimpact.step.recorder import trace
from vibroimpact.step.scheme import scheme_of

LIGHT = Oscillator(h=0.05, R=0.8, omega=2.6, f=1.0)
FLIP = 2.65888454668484


def beside(osc, n=1, phase=0.0):
    """Return the closed-form one-impact orbit, and a state a little off its section."""
    orbit = one_impact_orbit(osc, n)
    states = naive.after_impact(osc, n, orbit.v, orbit.phase, phase)
    return orbit, states, states[0] + np.array([-0.01, 0.01])


@pytest.mark.parametrize("phase", [0.0, 1.0, 4.0])
@pytest.mark.parametrize(
    ("h", "omega", "R", "n"),
    [(0.05, 2.3, 0.7, 1), (0.05, 2.2, 0.6, 1), (0.1, 2.0, 0.5, 1), (0.02, 4.1, 0.8, 2)],
)
def test_the_one_impact_orbits_are_those_in_closed_form(h, omega, R, n, phase):
    osc = Oscillator(h=h, R=R, omega=omega, f=1.0)
    closed, states, (x, v) = beside(osc, n, phase)
    found = periodic_orbit(osc, x, v, n, phase)
    assert (found.m, found.q, found.stable) == (n, 1, True)
    shifts = [np.roll(found.sections(phase), k, axis=0) for k in range(n)]
    assert min(np.abs(shift - states).max() for shift in shifts) < 1e-13
    assert found.multipliers == pytest.approx(closed.multipliers, abs=1e-13)


@pytest.mark.parametrize("distance", [1e-3, 1e-5, 1e-7, 1e-9])
def test_either_side_of_a_flip_is_told_however_near(distance):
    """A run would need a million periods for each unit of 1e-6, and more."""
    before, after = (replace(LIGHT, omega=FLIP + s * distance) for s in (-1.0, 1.0))
    _, _, (x, v) = beside(before)
    for m in (1, 2, 4):
        assert periodic_orbit(before, x, v, m).m == 1
    assert periodic_orbit(before, x, v).stable
    flipped = periodic_orbit(after, x, v)
    assert not flipped.stable and flipped.multipliers[0].real < -1.0


@pytest.mark.parametrize("distance", [1e-10, 1e-11, 1e-12])
@pytest.mark.parametrize("off", [1e-2, 1e-4, 1e-5])
def test_before_a_flip_there_is_no_orbit_of_twice_the_period(distance, off):
    """Though twice around any motion near by comes back to itself, to rounding."""
    osc = replace(LIGHT, omega=FLIP - distance)
    _, states, _ = beside(osc)
    found = periodic_orbit(osc, states[0, 0] - off, states[0, 1] + off, 2)
    assert (found.m, found.stable) == (1, True)


@pytest.mark.parametrize("turns", [2, 20, 2000])
def test_the_multipliers_of_many_turns_are_powers(turns):
    osc = replace(LIGHT, omega=3.2)
    closed = one_impact_orbit(osc)
    larger = closed.multipliers[0].real
    assert larger < -1.5
    phases = closed.phase + 2.0 * math.pi * np.arange(turns)
    found = PeriodicOrbit(osc, turns, phases, np.full(turns, closed.v)).multipliers
    expected = larger**turns if turns < 2000 else math.inf
    assert found[0] == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("phase", [0.0, 1.0, 6.0])
def test_a_motion_that_rests_is_refused_with_the_reason(phase):
    osc = Oscillator(h=0.0, R=0.5, omega=0.5, f=1.0)
    with pytest.raises(OrbitError, match="rests on the stop"):
        periodic_orbit(osc, -0.5, 0.5, phase=phase)


def test_there_may_be_no_orbit():
    """R = 1, h = 0, omega = 2 p: no bounded motion with one impact per period."""
    with pytest.raises(OrbitError):
        periodic_orbit(Oscillator(h=0.0, R=1.0, omega=2.0, f=1.0), -0.5, 0.5)


@pytest.mark.parametrize("seed", range(2))
def test_what_newtons_method_ends_at_is_an_orbit_or_refused(seed):
    """Guesses at random: simulation over one period says which roots pass the stop."""
    rng = np.random.default_rng(seed)
    refused = accepted = 0
    while refused < 30:
        h, R, omega, stop = rng.uniform([0.0, 0.4, 0.4, -1.0], [0.2, 1.0, 4.0, 1.0]).tolist()
        osc = Oscillator(h=h, R=R, omega=omega, f=1.0, clearance=stop)
        q = int(rng.integers(1, 4))
        phases = np.sort(rng.uniform(0.0, 2.0 * np.pi, q))
        root, reason = root_near(osc, phases, rng.uniform(0.0, 2.0, q))
        if root is None or min(root.speeds) < 1e-4 or reason.startswith("its impacts miss"):
            continue
        closed = returns(osc, root)
        if closed is None:
            continue
        assert closed == (reason == "") == is_solved(root), (osc, root, reason)
        refused += not closed
        accepted += closed
    assert accepted > 5


@pytest.mark.parametrize("R", [0.0, 0.5, 1.0])
def test_impacts_that_meet_at_a_rest_are_those_of_an_orbit(R):
    """It is x = (3 cos t - cos(t)^3) / 2, which the stop at 1 touches without acceleration."""
    osc = Oscillator(h=0.0, R=R, omega=3.0, f=1.0, clearance=1.0)
    for q in (1, 2, 3):
        orbit = PeriodicOrbit(osc, 3, np.full(q, 1.5 * math.pi), np.zeros(q))
        assert why_inadmissible(orbit) == "" and orbit.exists
        assert orbit.x_min == pytest.approx(-1.0, abs=1e-14)
    parted = PeriodicOrbit(osc, 3, np.full(2, 1.5 * math.pi), np.array([0.0, 0.1]))
    assert why_inadmissible(parted).startswith("its impacts miss the stop by")


def root_near(osc, phases, speeds):
    """Return the root of the impact equations near a guess, and why it is no orbit."""
    family = OrbitFamily(PeriodicOrbit(osc, 1, phases, speeds), ())
    X = family.start
    if not correct(family.system, X, np.empty((0, 0)), 60) or (X[1::2] < 0.0).any():
        return None, ""
    root = family.orbit(X)
    return root, why_inadmissible(root)


def is_solved(root):
    """Whether a root of the impact equations is taken for an orbit."""
    try:
        solved(root.oscillator, root.m, root.phases, root.speeds)
    except OrbitError:
        return False
    return True


def returns(osc, root):
    """Whether a motion that starts just after an impact of a root has the same impacts."""
    phase = float(root.phases[0])
    point = osc.at(osc.clearance, -osc.R * root.speeds[0], phase)
    scheme = scheme_of(point, "exact", "exact", None, phase)
    log, _ = trace(point, scheme, periods=1)
    hits = log[log[:, 0] == 0]
    phases, speeds = hits[:, 1] * osc.omega, hits[:, 3]
    first = np.r_[root.phases[1:], root.phases[0] + 2.0 * np.pi]
    inside = phases < first[-1] - 1e-6
    if (log[:, 0] == 1).any() or inside.sum() != root.q - 1:
        return False
    off = np.abs(phases[inside] - first[:-1]).max(initial=0.0)
    off = max(off, np.abs(speeds[inside] - root.speeds[1:]).max(initial=0.0))
    return None if 1e-8 < off < 1e-4 else bool(off <= 1e-8)


def test_a_repetition_of_too_many_steps_or_impacts_is_refused():
    """Before it is followed: three periods of a natural frequency 5512 times that of the force."""
    stiff = Oscillator(h=0.1, R=1.0, omega=2.5, f=1.0, p=13781.0)
    steps = 3 * 2.0 * math.pi * ((0.2 + 13781.0) / 2.5 + 1.0) / LONGEST_STEP
    orbit = PeriodicOrbit(stiff, 3, np.ones(1), np.ones(1))
    said = f"would be {steps:,.0f} time steps, more than the 32,768"
    for find in (
        lambda: periodic_orbit(stiff, 0.0, 0.0, 3),
        lambda: branch(orbit, "f", 0.5, 2.0),
        lambda: bifurcation_curve(orbit, "flip", ("f", 0.5, 2), ("h", 0, 1)),
    ):
        with pytest.raises(OrbitError, match=said):
            find()
    with pytest.raises(OrbitError, match="5,000 impacts are more than the 4,096"):
        branch(PeriodicOrbit(LIGHT, 1, np.linspace(0, 6, 5000), np.ones(5000)), "f", 0.5, 2.0)


def test_a_motion_of_endless_impacts_is_not_followed():
    """Hardly any loss at the stop, and so slow a force that none of its bounces is the last."""
    osc = Oscillator(h=0.0, R=1.0, omega=0.001, f=1.0)
    with pytest.raises(OrbitError, match="more impacts than are followed"):
        periodic_orbit(osc, -1e-9, 0.0)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((0.1, 0.0), "beyond the stop"),
        ((math.nan, 0.0), "finite"),
        ((-0.1, 0.0, 0), "m = 0 is not allowed; expected: an integer from 1 to 32,768"),
        ((-0.1, 0.0, True), "m = True is not allowed; expected: an integer from 1 to 32,768"),
        ((-0.1, 0.0, 10**12), "m = .* is not allowed; expected: an integer from 1 to 32,768"),
        ((-0.1, 0.0, 1, "0"), "phase = '0' is not allowed; expected: a number >= 0 and < 2 pi"),
    ],
)
def test_bad_arguments_are_refused(arguments, said):
    with pytest.raises(ValueError, match=said):
        periodic_orbit(LIGHT, *arguments)


# --- multipliers, against finite differences of the section map in 50 digits ---

# m, q, h, R, omega, clearance of attractors from a zero start
ATTRACTORS = [
    (1, 2, 0.48, 0.06, 0.96, 0.6),
    (1, 3, 1.15, 0.14, 1.95, 0.0),
    (1, 5, 0.0, 0.58, 0.56, 0.0),
    (2, 1, 0.0, 0.04, 3.44, 0.1),
    (2, 8, 0.07, 0.96, 0.52, 0.0),
    (3, 6, 0.0, 0.95, 0.83, 0.2),
    (5, 2, 0.33, 0.98, 4.71, 0.0),
    (6, 9, 0.0, 0.95, 1.15, 0.0),
]


def orbits_of(m, q, h, R, omega, clearance):
    """The attractor, and an unstable orbit on its branch if there is one."""
    osc = Oscillator(h=h, R=R, omega=omega, f=1.0, clearance=clearance)
    orbit = settled_orbit(osc, m, periods=300)
    assert (orbit.m, orbit.q, orbit.stable) == (m, q, True)
    line = branch(orbit, "omega", 0.9 * omega, 1.1 * omega)
    others = [line.orbit(i) for i in np.flatnonzero(~line.stable).tolist()]
    unstable = [other for other in others if 1.05 < abs(other.multipliers[0]) < 100.0]
    return [orbit, *unstable[len(unstable) // 2 :][:1]]


def stays_below(osc, impacts, period):
    """Whether 500 samples of every flight do."""
    times = [float(t) for t, _ in impacts]
    for (_, v), t, end in zip(impacts, times, [*times[1:], times[0] + period], strict=True):
        flight = naive.ClosedForm(osc, t, osc.clearance, -osc.R * float(v))
        x, _ = flight(np.linspace(t, end, 501))
        if not (x[1:-1] < osc.clearance).all():
            return False
    return True


def eigenvalues(D):
    """Of a 2x2 matrix, the larger first."""
    half = (D[0, 0] + D[1, 1]) / 2
    root = mp.sqrt(mp.mpc(half * half - mp.det(D)))
    return in_order([half + root, half - root])


def in_order(multipliers):
    """The larger first; of a pair the one above the real axis."""
    return sorted(multipliers, key=lambda mu: (-abs(mu), -mu.imag))


@pytest.mark.slow
def test_the_multipliers_of_a_dozen_orbits_are_those_of_the_section_map():
    """Stable and unstable; the slowest impact has a speed of 7e-5 of that of the fastest."""
    seen = []
    for row in ATTRACTORS:
        for orbit in orbits_of(*row):
            osc, multipliers = orbit.oscillator, in_order(orbit.multipliers)
            seen.append(orbit.stable)
            with mp.workdps(50):
                section = SectionMap(orbit)
                impacts = section.polish()
                assert stays_below(osc, impacts, orbit.m * osc.forcing_period)
                D = section.derivative()
                product = mp.mpf(osc.R) ** (2 * orbit.q)
                product *= mp.exp(-4 * mp.pi * mp.mpf(osc.h) * orbit.m / mp.mpf(osc.omega))
                assert abs(mp.det(D) / product - 1) < 1e-11  # of the map itself
                assert abs(mp.fprod(multipliers) / product - 1) < 1e-13
                for mu, expected in zip(multipliers, eigenvalues(D), strict=True):
                    assert abs(mu / expected - 1) < 1e-10
            c0, _, c2 = characteristic(orbit)
            assert c0 / c2 == pytest.approx(float(product), abs=1e-14)
    assert len(seen) >= 12 and seen.count(False) >= 5
