"""Shooting, against closed forms, the paper's steady motions, and what holds for every orbit."""

import math
from dataclasses import replace

import numpy as np
import pytest

from vibroimpact.orbits.one_impact import one_impact_orbit
from vibroimpact.orbits.one_impact_branches import sections
from vibroimpact.orbits.shooting import doubled, periodic_orbit
from vibroimpact.oscillator import Oscillator
from vibroimpact.trajectory import simulate

LIGHT = Oscillator(h=0.05, R=0.8, omega=2.6, f=1.0)
FLIP = 2.65888454668484


def attractor(osc, periods=300, **start):
    """Return the last section of a long run."""
    run = simulate(osc, periods, **start)
    return float(run.section_x[-1]), float(run.section_v[-1])


def beside(osc, n=1, phase=0.0):
    """Return the closed-form one-impact orbit, and a state a little off its section."""
    orbit = one_impact_orbit(osc, n)
    states = sections(osc, orbit, phase)
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
    assert (found.m, found.impacts, found.rests, found.stable) == (n, 1, 0, True)
    assert np.abs(found.sections - states).max() < 1e-13
    assert np.trace(found.monodromy) == pytest.approx(closed.trace, abs=1e-11)
    assert np.linalg.det(found.monodromy) == pytest.approx(closed.determinant, abs=1e-11)
    assert np.abs(found.multipliers) == pytest.approx(np.abs(closed.multipliers), abs=1e-11)


@pytest.mark.parametrize(
    ("h", "R", "impacts", "multipliers", "rounding"),
    [
        (0.5, 1.0, 2, [0.0189 + 0.0388j, 0.0189 - 0.0388j], 7e-5),
        (0.0, 0.5, 2, [0.0876 + 0.234j, 0.0876 - 0.234j], 5e-4),
        (0.5, 0.5, 4, [-0.00035, -0.0206], 5e-5),
    ],
)
def test_the_steady_motions_of_the_paper(h, R, impacts, multipliers, rounding):
    osc = Oscillator(h=h, R=R, omega=1.0, f=1.0)
    found = periodic_orbit(osc, *attractor(osc, 5))
    assert (found.m, found.impacts) == (1, impacts)
    given = sorted(found.multipliers, key=lambda value: (-value.imag, -value.real))
    assert np.abs(np.array(given) - multipliers).max() < rounding


@pytest.mark.parametrize(
    ("h", "R", "omega", "m", "q"),
    [
        (0.1, 0.8, 4.7, 4, 2),
        (0.1, 0.8, 4.715, 8, 4),
        (0.02, 0.3, 2.8, 2, 2),
        (0.1, 0.5, 1.05, 1, 2),
    ],
)
def test_what_the_multipliers_make_together_is_the_dissipation(h, R, omega, m, q):
    """det = R^(2q) exp(-2 h m 2 pi / omega), the Lyapunov sum rule over one repetition."""
    osc = Oscillator(h=h, R=R, omega=omega, f=1.0)
    found = periodic_orbit(osc, *attractor(osc, 2000), 2 * m)
    assert (found.m, found.impacts) == (m, q)
    expected = R ** (2 * q) * math.exp(-4.0 * math.pi * h * m / omega)
    assert np.linalg.det(found.monodromy) == pytest.approx(expected, rel=1e-9, abs=1e-15)


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
    orbit = doubled(after, flipped)
    assert (orbit.m, orbit.impacts, orbit.stable) == (2, 2, True)
    # Its amplitude grows with the square root of the distance: a supercritical flip.
    share = np.abs(orbit.sections[1] - orbit.sections[0]).max() / math.sqrt(distance)
    assert share == pytest.approx(1.4433, rel=2e-3 + 20 * distance)


@pytest.mark.parametrize("distance", [1e-10, 1e-11, 1e-12])
@pytest.mark.parametrize("off", [1e-2, 1e-4, 1e-5])
def test_before_a_flip_there_is_no_orbit_of_twice_the_period(distance, off):
    """Though twice around any motion near by comes back to itself, to rounding."""
    osc = replace(LIGHT, omega=FLIP - distance)
    _, states, _ = beside(osc)
    found = periodic_orbit(osc, states[0, 0] - off, states[0, 1] + off, 2)
    assert (found.m, found.stable) == (1, True)


def test_the_multiplier_at_a_flip_is_minus_one():
    _, _, (x, v) = beside(replace(LIGHT, omega=FLIP))
    found = periodic_orbit(replace(LIGHT, omega=FLIP), x, v)
    assert found.multipliers[0] == pytest.approx(-1.0, abs=1e-11)


def test_an_orbit_that_has_not_flipped_has_no_double():
    osc = replace(LIGHT, omega=2.5)
    _, _, (x, v) = beside(osc)
    assert doubled(osc, periodic_orbit(osc, x, v)) is None


def test_coexisting_orbits_are_found_from_their_own_sides():
    """The impact speeds of both are known: 1.4225, and .7030, 1.1145 and 2.2536."""
    osc = Oscillator(h=0.0, R=0.8, omega=1.3, f=1.0)
    _, _, (x, v) = beside(osc)
    one = periodic_orbit(osc, x, v, 2)
    two = periodic_orbit(osc, *attractor(osc, 500), 2)
    assert (one.m, one.impacts, two.m, two.impacts) == (1, 1, 2, 3)
    assert one.stable and two.stable
    run = simulate(osc, 2, x0=two.sections[0, 0], v0=two.sections[0, 1])
    assert sorted(run.impact_v) == pytest.approx([0.7030, 1.1145, 2.2536], abs=5e-5)


@pytest.mark.parametrize("phase", [0.0, 1.0, 6.0])
def test_a_rest_forgets_every_deviation(phase):
    """It lasts from about 5.2 to 2 pi: only at the phase 1 the section is not in it."""
    osc = Oscillator(h=0.0, R=0.5, omega=0.5, f=1.0)
    found = periodic_orbit(osc, -0.5, 0.5, phase=phase)
    assert found.rests == 1 and found.stable
    assert (found.sections == 0.0).all() == (phase != 1.0)
    assert (found.monodromy == 0.0).all() and (found.multipliers == 0.0).all()


def test_the_free_oscillation_has_the_multipliers_of_the_flow():
    osc = Oscillator(h=0.1, R=0.8, omega=0.7, f=0.1, clearance=1.0)
    found = periodic_orbit(osc, 0.0, 0.0)
    assert found.impacts == 0
    decay = math.exp(-0.1 * osc.forcing_period)
    assert np.abs(found.multipliers) == pytest.approx([decay, decay], rel=1e-12)


def test_there_may_be_no_orbit():
    """R = 1, h = 0, omega = 2 p: no bounded motion with one impact per period."""
    assert periodic_orbit(Oscillator(h=0.0, R=1.0, omega=2.0, f=1.0), -0.5, 0.5) is None


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((0.1, 0.0), "beyond the stop"),
        ((math.nan, 0.0), "finite"),
        ((-0.1, 0.0, 0), "m must be an integer >= 1, not 0"),
        ((-0.1, 0.0, True), "m must be an integer >= 1, not True"),
    ],
)
def test_bad_arguments_are_refused(arguments, said):
    with pytest.raises(ValueError, match=said):
        periodic_orbit(LIGHT, *arguments)
