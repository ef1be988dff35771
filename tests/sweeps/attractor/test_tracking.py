"""The identity of attractors along an axis of a sweep."""

import itertools
from functools import partial

import numpy as np
import pytest

from sweeps import attractors, run_sweep
from sweeps.attractor.tracking import MAX_DISTANCE, mutually_nearest, track
from sweeps.opened.motions import Cycles, distances
from tests.helpers.motions import cycle, given_sections, partition
from tests.sweeps.attractor.test_attractor_identity import cycles_of
from vibroimpact.points.regimes import Regime


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


def test_an_identity_is_kept_through_a_flip_and_lost_in_a_jump():
    split = 0.05 * np.sqrt(np.maximum(np.arange(30) - 9.5, 0.0))
    states = np.zeros((30, 2, 2))
    states[:, 0, 0], states[:, 1, 0] = -1.0 - split, -1.0 + split
    states[20:] += [0.9, 0.0]
    cycles = Cycles(states, np.repeat([1, 2], [10, 20]), np.ones(30))
    links = partial(mutually_nearest, cycles), lambda a, b: np.zeros(len(a), bool)
    found = track((30,), np.arange(30), *links)
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


def test_an_identity_survives_an_impact_that_passes_the_section():
    """Before the impact v = 0.5, after it -0.8 * 0.5, at the stop."""
    points = np.empty((21, 1, 16, 2))
    for i in range(21):
        t = 0.02 * (i - 10)
        points[i, 0] = (0.5 * t, 0.5) if t < 0 else (-0.4 * t, -0.4)
    assert len(set(along(points, 1)[:, 0])) == 1


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
    for order in (np.arange(139)[::-1], np.roll(np.arange(139), 60)):  # as pieces are concatenated
        mixed = attractors(dataset.isel(omega=order))
        assert mixed.sortby("omega").equals(found)


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
    found, turned = found["attractor"], turned["attractor"]
    assert partition(turned.transpose(*found.dims)) == partition(found)


@pytest.mark.slow
def test_a_branch_keeps_its_number_over_large_steps(tmp_path):
    """A step of 10 rad/s moves the section by up to twice its size, along each branch.

    The ends of the branches are those of the scene joint-clearance.
    """
    config = {
        "oscillator": {
            "h": 4.0, "R": 0.7, "omega": np.linspace(63.0, 283.0, 23), "f": 16.0,
            "p": 126.49110640673517, "clearance": 5e-4,
        },
        "start": {"x0": [-1e-3, -5e-4, 0.0], "v0": [-0.1, 0.0, 0.1]},
        "record": {"transient": 500, "periods": 130, "diagnostics": ["period"]},
    }  # fmt: skip
    found = attractors(run_sweep(config, tmp_path / "joint.h5"))
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
    found = attractors(run_sweep(config, tmp_path / "flip.h5"))
    classes = list(zip(found["m"].values[:, 0], found["q"].values[:, 0], strict=True))
    assert classes == [(1, 1), (1, 1), (2, 2), (2, 2)]
    assert len(np.unique(found["number"].values[:, 0])) == 1
