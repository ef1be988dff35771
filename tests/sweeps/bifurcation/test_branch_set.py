"""Sets of branches, and their points for a picture, against closed forms and simulation."""

from dataclasses import replace
from operator import attrgetter

import numpy as np
import pytest

from sweeps.bifurcation.branch_set import BranchSet, with_short_chords
from tests.helpers.oscillators import bifurcation
from vibroimpact.orbits.branches import branch
from vibroimpact.orbits.one_impact import one_impact_orbit
from vibroimpact.orbits.periodic import periodic_orbit
from vibroimpact.oscillator import Oscillator
from vibroimpact.trajectory import simulate


def test_orbits_between_a_fold_and_a_flip_of_one_step_are_stable():
    """The window is 1e-6 wide; points added for a picture have their own stability."""
    osc = Oscillator(h=0.565873495924132, R=0.5, omega=4.5, f=1.0, clearance=-0.5)
    inside = periodic_orbit(osc, -0.502280357078872, -0.03054864829772489, 4)
    assert (inside.m, inside.q) == (4, 11) and inside.stable
    start = branch(inside, "h", 0.005, 0.6).orbit(5)
    found = with_short_chords(
        branch(start, "h", 0.005, 0.6), 0.005, 0.6, attrgetter("speeds"), 1e-4
    )
    largest = np.array([abs(found.orbit(i).multipliers[0]) for i in range(len(found.values))])
    clear = np.abs(largest - 1.0) > 1e-6
    assert found.stable[clear].any()
    np.testing.assert_array_equal(found.stable[clear], largest[clear] < 1.0)


def test_ordinates_that_are_rounding_only_end_the_search_for_a_picture():
    """A branch over a range so narrow that the drawn ordinates are noise."""
    osc = Oscillator(h=0.1, R=0.8, omega=2.5, f=1.0)
    noise = np.random.default_rng(1)
    start = branch(one_impact_orbit(osc), "omega", 2.45, 2.55)
    drawn = (lambda orbits: 0.03 * noise.integers(2, size=(len(orbits.phases), 1))), 0.02
    found = with_short_chords(start, 2.45, 2.55, *drawn)
    assert len(start.values) < len(found.values) < 2000


def test_a_branch_between_whose_points_no_orbit_is_found_stays_as_it_is():
    """Its points are far apart, as on both sides of a gap: halfway Newton's method fails."""
    osc = Oscillator(h=0.1, R=0.8, omega=2.5, f=1.0)
    whole = branch(one_impact_orbit(osc), "omega", 2.45, 2.55)
    ends = {name: getattr(whole, name)[[0, -1]] for name in ("values", "stable", "speeds")}
    apart = replace(whole, phases=np.array([[1.0], [60.0]]), **ends)
    found = with_short_chords(apart, 2.45, 2.55, lambda orbits: orbits.sections(0.0)[:, 0], 1e-4)
    assert found.values.tolist() == apart.values.tolist()


def test_a_tree_joins_all_motions_of_the_hysteresis_scene():
    """Two folds, two grazes of the free oscillation, and what lies between them: from one seed."""
    osc = Oscillator(h=0.05, R=0.8, omega=1.5, f=1.0, clearance=1.5)
    tree = BranchSet("omega", 0.4, 1.9, phase=0.0)
    assert tree.add(periodic_orbit(osc, 0.0, 0.0))
    tree.grow()
    classes = {(one.m, one.q) for one in tree.branches}
    assert {(1, 0), (1, 1), (1, 2), (2, 3)} <= classes
    special = [point for one in tree.branches for point in one.special]
    folds = sorted(point.value for point in special if point.kind == "fold")
    expected = [bifurcation(osc, "fold", "omega", *ends) for ends in ((0.5, 0.56), (1.5, 1.8))]
    assert [folds[0], folds[-1]] == pytest.approx(expected, abs=1e-11)
    for one in tree.branches:
        assert tree.holds(one.orbit(len(one.values) // 2))


def test_a_tree_has_no_branch_twice_and_every_stable_orbit_attracts():
    osc = Oscillator(h=0.05, R=0.8, omega=2.5, f=1.0)
    tree = BranchSet("omega", 2.4, 3.5, phase=0.0, most_periods=8)
    assert tree.add(one_impact_orbit(osc))
    tree.grow()
    assert sum((one.m, one.q) == (1, 1) for one in tree.branches) == 1
    classes = {(one.m, one.q) for one in tree.branches}
    assert {(1, 1), (2, 2), (2, 1), (4, 4), (4, 2), (4, 3)} <= classes
    for one in tree.branches:
        for i in np.flatnonzero(one.stable)[1:-1:7].tolist():
            orbit = one.orbit(i)
            (x, v), *_ = orbit.sections()
            run = simulate(orbit.oscillator, 20 * one.m, x0=min(x + 1e-9, 0.0), v0=v)
            assert run.section_x[-1] == pytest.approx(x, abs=2e-8)
    assert tree.given_up["of more than 8 periods"] > 0
