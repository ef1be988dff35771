"""The identity of attractors, within a point and along the axes."""

import itertools

import numpy as np
import pytest

from sweeps import attractors
from sweeps.attractor.attractors import same_motions
from sweeps.errors import Refused
from sweeps.opened.motions import ORBIT_TOLERANCE, Cycles, distances
from tests.helpers.motions import cycle, given_sections, partition
from tests.helpers.sweep_files import swept
from vibroimpact.points.regimes import Regime
from vibroimpact.status import Status


def cycles_of(states, R):
    """Return cycles of states, shape (n, m, 2)."""
    states = np.array(states)
    count, m, _ = states.shape
    return Cycles(states, np.full(count, m), np.broadcast_to(R, count))


def grouped(cycles):
    """Return the number of the motion of each cycle, shape (n, m, 2), at one parameter point."""
    return same_motions(cycles_of(cycles, 0.8), np.zeros(len(cycles), int))


def test_a_motion_reached_at_another_phase_is_the_same():
    three = [(-1, 0.1), (-0.5, 0.2), (-0.2, 0.9)]
    assert grouped([np.roll(three, k, axis=0) for k in range(3)]).tolist() == [0, 0, 0]


def test_the_order_within_a_cycle_tells_motions_apart():
    """The same states in another cyclic order are another motion; there are six orders of four."""
    first, *others = (-1.0, 0.1), (-0.5, 0.2), (-0.2, 0.9), (-0.7, 0.4)
    orders = [(first, *order) for order in itertools.permutations(others)]
    noise = 1e-9 * np.random.default_rng(0).normal(size=(30, 4, 2))
    found = grouped(noise + 5 * orders)
    assert partition(found) == {frozenset(range(i, 30, 6)) for i in range(6)}


@pytest.mark.parametrize("noise", [0.0, 1e-9])
def test_states_with_nearly_equal_x_are_not_mixed_up(noise):
    """Cycles with any first state, whose order in x depends on rounding errors."""
    random = np.random.default_rng(0)
    states = np.array([(-0.3, 0.5), (-0.3, -0.5), (-0.3, 0.1), (-0.9, 0.0)])
    expected = np.arange(40) % 2
    cycles = [np.roll(states * [1.0, 1 - 2 * k], random.integers(4), axis=0) for k in expected]
    found = grouped(cycles + noise * random.normal(size=(40, 4, 2)))
    assert partition(found) == partition(expected)


@pytest.mark.parametrize(("apart", "count"), [(0.9e-3, 1), (1.1e-3, 2)])
def test_the_tolerance_is_relative_to_the_greatest_coordinate(apart, count):
    for size in (1e-6, 1.0, 1e6):
        points = size * np.array([cycle((-1.0, 0.0)), cycle((-1.0, apart))])
        assert attractors(given_sections(points, 1))["attractors"].item() == count
    assert attractors(given_sections(points, 1), tolerance=1e-2)["attractors"].item() == 1


def test_the_motions_of_a_ball_on_a_table_are_told_apart():
    """The stop is at -1e8: relative to x all motions would be the same."""
    starts = [-4.0, -6.0, -2.0, -8.0, -3.0, -1.0, -5.0, -7.0]
    ball = {"h": 0.0, "R": 0.8, "omega": 1.0, "f": 1.0, "p": 1e-4, "clearance": -1e8}
    record = {"transient": 1000, "periods": 100, "diagnostics": ["period"]}
    ds = swept({"oscillator": ball, "start": {"x0": -1e8, "v0": starts}, "record": record})
    classes = list(zip(ds["period"].values, ds["period_impacts"].values, strict=True))
    assert len(set(classes)) == 4
    expected = [sorted(set(classes)).index(each) for each in classes]
    assert partition(attractors(ds)["attractor"]) == partition(expected)
    of_one_class = given_sections([cycle((-1e8 - 1.0, 0.1)), cycle((-1e8 - 2.0, 0.1))], 1)
    assert attractors(of_one_class.assign_coords(clearance=-1e8))["attractors"].item() == 2


def test_states_on_their_way_to_one_motion_are_chained():
    """Seven in a row, each within the tolerance of its neighbours only."""
    points = np.array([cycle((-1.0 + 0.8e-3 * k, 0.0)) for k in (3, 0, 6, 1, 5, 2, 4)])
    assert attractors(given_sections(points, 1))["attractors"].item() == 1


def pairs_of_cycles(count, m):
    """Return cycles at random places, and a partner of each about a tolerance apart."""
    random = np.random.default_rng(m)
    states = random.uniform([-1.0, -1.0], [0.0, 1.0], (count, m, 2))
    states[:, 0, 0] *= random.random(count) < 0.5  # half of them are at the stop once
    partners = states + random.uniform(0.5e-3, 1.2e-3) * random.uniform(-1.0, 1.0, states.shape)
    at_stop = (states[:, 0, 0] == 0.0) & (states[:, 0, 1] > 0.0)
    partners[at_stop, 0, 0] = -1e-4
    partners[at_stop, 0, 1] *= -0.8  # after the impact
    partners = np.array([np.roll(cycle, random.integers(m), axis=0) for cycle in partners])
    return cycles_of(np.concatenate([states, partners]), 0.8)


@pytest.mark.parametrize("m", [1, 2, 3])
def test_two_cycles_are_one_motion_exactly_if_they_are_within_the_tolerance(m):
    """At random places, which are sometimes in different squares."""
    count = (30, 300, 300)[m - 1]
    both = pairs_of_cycles(count, m)
    equal = distances(both, *np.arange(2 * count).reshape(2, -1)) <= ORBIT_TOLERANCE
    assert 0.05 < equal.mean() < 0.99
    found = same_motions(both, np.zeros(2 * count, int))
    np.testing.assert_array_equal(found[:count] == found[count:], equal)
    assert len(set(found)) == count + np.count_nonzero(~equal)


def test_the_work_is_in_proportion_to_the_number_of_attractors(monkeypatch):
    """As for an undamped oscillator, where every start is an attractor."""
    compared = []
    monkeypatch.setattr(
        "sweeps.attractor.attractors.distances",
        lambda cycles, a, b: [compared.append(len(a)), distances(cycles, a, b)][1],
    )
    states = np.random.default_rng(0).uniform(-1.0, 0.0, (3000, 1, 2))
    found = same_motions(cycles_of(states, 1.0), np.zeros(3000, int))
    assert len(set(found)) > 2900
    assert sum(compared) < 10 * 3000


def test_a_motion_that_represents_others_represents_itself():
    """Of motions that fill a region, each may be near others that are not near each other."""
    states = np.random.default_rng(0).uniform(-1.0, -0.97, (1000, 1, 2))
    found = same_motions(cycles_of(states, 1.0), np.zeros(1000, int))
    np.testing.assert_array_equal(found[found], found)
    assert 1 < len(set(found)) < 1000


def test_motions_of_two_classes_are_never_one():
    """A rig just beyond the flip of 4/3: the halves of 8/6 differ by less than the tolerance."""
    found = attractors(given_sections([cycle((-1.0, 0.0))] * 3, 1, period_impacts=[1, 2, 1]))
    assert found["attractor"].values.tolist() == [0, 1, 0]
    assert found["q"].values.tolist() == [1, 2]


JUST_FLIPPED = (
    "oscillator={h: 0.005, R: 0.8413829603726963, omega: 2.8646549477708776, f: 2.5, "
    "clearance: 0.32589109594743776}",
    "start={x0: [-2.0, -0.5], v0: [-1.0, 0.0, 1.0]}",
    "record={transient: 50000, periods: 64, diagnostics: [period]}",
)


@pytest.mark.slow
def test_just_beyond_its_flip_an_attractor_is_the_orbit_of_twice_the_period(computed_starts):
    """The halves of 8/6 differ by less than the tolerance, and 4/3 is unstable."""
    dataset = computed_starts(*JUST_FLIPPED)
    assert (dataset["period"] == 8).all() and (dataset["period_impacts"] == 6).all()
    found = attractors(dataset)
    assert (found["m"].values.tolist(), found["q"].values.tolist()) == ([8], [6])


def test_what_is_on_no_attractor_or_does_not_repeat():
    sections = np.zeros((8, 16, 2))
    sections[:, :, 0] = -1.0
    sections[6] = np.nan
    status = np.full(8, Status.CERTIFIED)
    status[5:] = Status.PENDING, Status.UNRESOLVED, Status.UNBOUNDED
    others = {"status": status, "rest_fraction": [0, 0.2, 0.1, 0, 0, 0, np.nan, 0]}
    dataset = given_sections(sections, [1, 1, 3, 0, 0, 1, 0, 0], **others)
    found = attractors(dataset, extensions=0)
    assert found["attractor"].values.tolist() == [0, 2, 2, 3, 3, -1, -1, 1]
    assert found["attractors"].item() == 2  # periodic, and with rest
    table = {int(n): (Regime(int(k)), float(f)) for n, k, f in zip(
        found["number"], found["motion"], found["fraction"], strict=True)}  # fmt: skip
    assert table == {
        0: (Regime.PERIODIC, pytest.approx(1 / 6)),
        1: (Regime.UNBOUNDED, pytest.approx(1 / 6)),
        2: (Regime.REST, pytest.approx(2 / 6)),
        3: (Regime.UNKNOWN, pytest.approx(2 / 6)),
    }


def test_nothing_computed_has_no_attractor():
    points = given_sections(np.full((3, 8, 2), np.nan), 0, status=np.full(3, Status.PENDING))
    found = attractors(points)
    assert found["attractor"].values.tolist() == [-1] * 3
    assert found["attractors"].item() == 0
    assert found["number"].values.tolist() == [-1]


def test_a_file_without_period_is_refused():
    with pytest.raises(Refused, match=r"no period.* record.diagnostics: \[period\]"):
        attractors(given_sections([cycle((-1, 0))], 1).drop_vars("period"))
