"""The identity of attractors, within a point and along the axes."""

import itertools
from functools import partial

import numpy as np
import pytest

from sweeps import attractors, open_sweep, run_sweep
from sweeps.attractor.attractor_table import attractor_rows
from sweeps.attractor.knocks import _Motions
from sweeps.attractor.partition import same_motions
from sweeps.attractor.tracking import MAX_DISTANCE, MOST_TRACKED, mutually_nearest, track
from sweeps.errors import Refused
from sweeps.opened.motions import ORBIT_TOLERANCE, Cycles, distances
from tests.helpers.motions import cycle, given_sections, partition
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


def test_the_motions_of_a_ball_on_a_table_are_told_apart(tmp_path):
    """The stop is at -1e8: relative to x all motions would be the same."""
    starts = [-4.0, -6.0, -2.0, -8.0, -3.0, -1.0, -5.0, -7.0]
    ball = {"h": 0.0, "R": 0.8, "omega": 1.0, "f": 1.0, "p": 1e-4, "clearance": -1e8}
    record = {"transient": 1000, "periods": 100, "diagnostics": ["period"]}
    sweep = {"oscillator": ball, "start": {"x0": -1e8, "v0": starts}, "record": record}
    ds = open_sweep(run_sweep(sweep, tmp_path / "ball.h5"))
    classes = list(zip(ds["period"].values, ds["period_impacts"].values, strict=True))
    assert len(set(classes)) == 4
    expected = [sorted(set(classes)).index(each) for each in classes]
    assert partition(attractors(ds)["attractor"]) == partition(expected)


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
        "sweeps.attractor.partition.distances",
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
    """The halves of 8/6 differ by less than the tolerance, and 4/3 is unstable.

    A knock may bring the motion to the stable manifold of 4/3, beside which it then lingers.
    """
    dataset = computed_starts(*JUST_FLIPPED)
    assert (dataset["period"] == 8).all() and (dataset["period_impacts"] == 6).all()
    found = attractors(dataset)
    assert (found["m"].values.tolist(), found["q"].values.tolist()) == ([8], [6])
    motions = _Motions(dataset, found)
    states = np.repeat(motions.orbits[0].sections(0.0)[:1], 6, axis=0)
    states[:, 1] += [0.0, 1e-7, -1e-5, -7.2e-5, -1e-4, 1e-3]
    assert motions._reached(0.0, states)[0].tolist() == [0] * 6


def test_what_is_on_no_attractor_or_does_not_repeat():
    sections = np.zeros((8, 16, 2))
    sections[:, :, 0] = -1.0
    sections[6] = np.nan
    status = np.full(8, Status.CERTIFIED)
    status[5:] = Status.PENDING, Status.UNRESOLVED, Status.UNBOUNDED
    found = attractors(
        given_sections(
            sections,
            [1, 1, 3, 0, 0, 1, 0, 0],
            status=status,
            rest_fraction=[0, 0.2, 0.1, 0, 0, 0, np.nan, 0],
        ),
        extensions=0,
    )
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


# Identities along an axis


def along(sections, periods):
    dataset = given_sections(sections, periods, axes=("h", "x0"))
    return attractors(dataset)["attractor"].values


def test_identities_follow_the_branches_whatever_their_share():
    """Two branches that cross in x and in their number of starts."""
    points = np.empty((20, 3, 16, 2))
    for i in range(20):
        down, up = cycle((-1.0 + 0.05 * i, 0.5), turns=16), cycle((-0.05 * i, -0.5), turns=16)
        points[i] = [down, up, down if i < 10 else up]
    found = along(points, 1)
    assert len(set(found[:, 0])) == 1 and len(set(found[:, 1])) == 1
    assert found[0, 0] != found[0, 1]
    assert found[9, 2] == found[0, 0] and found[10, 2] == found[0, 1]


def nobody(a, b):
    """Link no pair of attractors."""
    return np.zeros(len(a), bool)


def test_an_identity_is_kept_through_a_flip_and_lost_in_a_jump():
    split = 0.05 * np.sqrt(np.maximum(np.arange(30) - 9.5, 0.0))
    states = np.zeros((30, 2, 2))
    states[:, 0, 0], states[:, 1, 0] = -1.0 - split, -1.0 + split
    states[20:] += [0.9, 0.0]
    cycles = Cycles(states, np.repeat([1, 2], [10, 20]), np.ones(30))
    found = track((30,), np.arange(30), partial(mutually_nearest, cycles), nobody)
    assert len(set(found[:20])) == 1 and len(set(found[20:])) == 1
    assert found[0] != found[-1]


def test_an_attractor_that_comes_and_goes_beside_another_leaves_it_its_number():
    """Both are near enough to continue each other; only the nearest does."""
    points = np.empty((12, 2, 16, 2))
    for i in range(12):
        points[i] = cycle((-1.0 - 0.01 * i, 0.0), turns=16)
        if 4 <= i < 8:
            points[i, 1] = cycle((-1.0 - 0.01 * i, 0.08 if i < 6 else -0.08), turns=16)
    for ordered in (points, points[:, ::-1]):
        found = along(ordered, 1)
        staying = found[:, 0] if ordered is points else found[:, 1]
        coming = found[4:8, 1] if ordered is points else found[4:8, 0]
        assert len(set(staying)) == 1 and set(staying).isdisjoint(coming)


def test_the_sheets_of_a_cusp_keep_two_numbers_where_both_exist():
    """s^3 - a s - b = 0: around the cusp at a = b = 0 one attractor leads to the other."""
    a, b = np.linspace(-0.5, 1.0, 13), np.linspace(-0.6, 0.6, 41)
    points = np.empty((13, 41, 2, 16, 2))
    for (i, j), _ in np.ndenumerate(points[..., 0, 0, 0]):
        roots = np.roots([1.0, 0.0, -a[i], -b[j]])
        roots = np.sort(roots.real[np.abs(roots.imag) < 1e-9])
        for k, s in enumerate((roots[0], roots[-1])):
            points[i, j, k] = cycle((-2.0 + 1.2 * s, 0.5 * s), turns=16)
    found = attractors(given_sections(points, 1, axes=("f", "h", "x0")))
    lower, upper = np.moveaxis(found["attractor"].values, -1, 0)
    both = found["attractors"].values == 2
    assert both.sum() > 50 and not (lower == upper)[both].any()
    assert len(set(lower[both])) == len(set(upper[both])) == 1
    assert len(set(lower[0])) == 1 and set(lower[0]) <= {*lower[both], *upper[both]}


@pytest.mark.parametrize("same_R", [True, False])
def test_the_links_are_the_mutually_nearest_pair_by_pair(same_R):
    random = np.random.default_rng(1)
    point, m = np.sort(random.integers(0, 6, 240)), random.choice([1, 2, 3, 4], 240)
    R = np.full(6, 0.5) if same_R else random.uniform(0.0, 1.0, 6)
    states = random.normal(size=(240, 4, 2)) * [0.4, 1.0]
    states[..., 0] = -np.abs(states[..., 0])
    cycles = Cycles(states, m, R[point])
    apart = np.full((240, 240), np.inf)
    pairs = np.nonzero(point[:, None] + 1 == point)
    apart[pairs] = distances(cycles, *pairs)
    expected = [
        (i, j)
        for i, j in zip(*np.nonzero(apart <= MAX_DISTANCE), strict=True)
        if apart[i].argmin() == j and apart[:, j].argmin() == i
    ]
    linked = np.transpose(pairs)[mutually_nearest(cycles, *pairs)]
    assert list(map(tuple, linked.tolist())) == expected
    assert len(expected) > 20


def test_equal_states_before_an_impact_are_linked_where_the_rebound_changes():
    """After the impact others would be nearer, but they are not at the stop."""
    v = np.array([1.0, *(-0.65 - 0.001 * np.arange(10)), 1.0])
    states = np.column_stack([np.full(12, -0.3), v])[:, None]
    cycles = cycles_of(states, [0.9] + 11 * [0.5])
    found = mutually_nearest(cycles, np.zeros(11, int), np.arange(1, 12))
    assert np.flatnonzero(found).tolist() == [10]


@pytest.mark.parametrize("count", [MOST_TRACKED, MOST_TRACKED + 1])
def test_beyond_the_limit_every_attractor_has_a_number_of_its_own(count):
    """As along an axis of an undamped oscillator, where every start is an attractor."""
    states = np.random.default_rng(0).uniform(-1.0, 0.0, (count, 1, 2))
    cycles = cycles_of(np.concatenate([states, states + 1e-4]), 1.0)
    found = track((2,), np.repeat([0, 1], count), partial(mutually_nearest, cycles), nobody)
    assert len(set(found)) == (count if count <= MOST_TRACKED else 2 * count)


def test_an_identity_survives_an_impact_that_passes_the_section():
    """Before the impact v = 0.5, after it -0.8 * 0.5, at the stop."""
    points = np.empty((21, 1, 16, 2))
    for i in range(21):
        t = 0.02 * (i - 10)
        points[i, 0] = (0.5 * t, 0.5) if t < 0 else (-0.4 * t, -0.4)
    assert len(set(along(points, 1)[:, 0])) == 1


@pytest.mark.slow
def test_identities_on_a_sweep_over_omega(computed_starts):
    """The orbit of one impact per period, stable from 1.26 on, through its flip at 2.655.

    At omega = 2 its impact passes the section, and where 2/3 coexists, the other keeps its own.
    """
    dataset = computed_starts(
        "oscillator={h: 0.02, R: 0.8, omega: {start: 1.27, stop: 2.69, num: 143}, f: 1.0}",
        "start={x0: [-1.6, -0.8, 0.0], v0: [-1.0, 0.0, 1.0]}",
    )
    table = attractor_rows(dataset, attractors(dataset))
    single = {row.number for row in table if row.name == "1/1"}
    double = {row.number for row in table if row.name == "2/2"}
    three = {row.number for row in table if row.name == "2/3"}
    assert len(single) == 1 and single == double
    assert len(three) == 1 and three.isdisjoint(single)


def test_an_attractor_that_no_start_reaches_at_a_few_values_keeps_its_number(computed_starts):
    """The orbit of one impact per period is stable from 1.25 to 2.655 (closed form)."""
    dataset = computed_starts(
        "oscillator={h: 0.02, R: 0.8, omega: {start: 1.27, stop: 2.65, num: 139}, f: 1.0}",
        "start={x0: [-1.2, -0.4], v0: 0.5}",
    )
    single = (found := attractors(dataset)).where((found["m"] == 1) & (found["q"] == 1))
    numbers = single["number"].max("coexisting")
    reached = np.flatnonzero(numbers.notnull())
    assert np.diff(reached).max() > 1
    assert len(np.unique(numbers[reached])) == 1


@pytest.mark.slow
def test_no_two_attractors_of_a_point_have_one_number(computed_starts):
    dataset = computed_starts(
        "oscillator={h: 0.02, R: {start: 0.5, stop: 0.95, num: 10}, f: 1.0, "
        "omega: {start: 0.5, stop: 3.5, num: 25}}",
        "start={x0: [-1.6, 0.0], v0: [-1.0, 0.0]}",
        "record.periods=64",
    )
    found = attractors(dataset)
    names = found["number"].values.reshape(-1, found.sizes["coexisting"])
    for one, other in itertools.combinations(names.T, 2):
        assert not ((one == other) & (one >= 0)).any()
    assert found["attractors"].max() >= 2
    periodic = found["motion"] == Regime.PERIODIC
    shared = np.unique(names[periodic.values.reshape(names.shape)], return_counts=True)[1]
    assert shared.max() > 30  # names are shared in both directions
    turned = attractors(dataset.transpose("omega", "R", ...))
    assert partition(turned["attractor"].transpose(*found["attractor"].dims)) == partition(
        found["attractor"]
    )


@pytest.mark.slow
@pytest.mark.parametrize("num", [23, 45])
def test_a_branch_keeps_its_number_over_steps_of_any_size(tmp_path, num):
    """A step of 5 to 10 rad/s moves the section by up to twice its size, along each branch.

    The ends of the branches are those of the scene joint-clearance.
    """
    config = {
        "oscillator": {
            "h": 4.0, "R": 0.7, "omega": np.linspace(63.0, 283.0, num), "f": 16.0,
            "p": 126.49110640673517, "clearance": 5e-4,
        },
        "start": {"x0": [-1e-3, -5e-4, 0.0], "v0": [-0.1, 0.0, 0.1]},
        "record": {"transient": 500, "periods": 130, "diagnostics": ["period"]},
    }  # fmt: skip
    with open_sweep(run_sweep(config, tmp_path / "joint.h5")) as dataset:
        found = attractors(dataset)
    omega = found["omega"].values
    for m, q, low, high in ((1, 3, 63.0, 68.3), (1, 2, 69.2, 100.9), (1, 1, 106.4, 218.9)):
        numbers = found["number"].where((found["m"] == m) & (found["q"] == q)).values
        inside = numbers[(omega >= low) & (omega <= high)]
        assert np.isfinite(inside).any(axis=1).all()
        assert len(np.unique(numbers[np.isfinite(numbers)])) == 1
    kinds = found[["number", "m", "q"]].to_dataframe()[["number", "m", "q"]]
    assert kinds.query("m == 1").drop_duplicates()["number"].is_unique


@pytest.mark.parametrize("method", [{}, {"integrator": "rk4", "impact": "cubic"}])
def test_a_branch_keeps_its_number_through_a_flip_between_two_points(tmp_path, method):
    """There both states of the orbit of two periods are far from the state of the orbit before."""
    config = {
        "method": method,
        "oscillator": {"h": 0.05, "R": 0.8, "omega": [2.55, 2.62, 2.69, 2.715], "f": 1.0},
        "start": {"x0": [-0.3, 0.0]},
        "record": {"transient": 500, "periods": 130, "diagnostics": ["period"]},
    }
    with open_sweep(run_sweep(config, tmp_path / "flip.h5")) as dataset:
        found = attractors(dataset)
    classes = list(zip(found["m"].values[:, 0], found["q"].values[:, 0], strict=True))
    assert classes == [(1, 1), (1, 1), (2, 2), (2, 2)]
    assert len(np.unique(found["number"].values[:, 0])) == 1
