"""The identity of attractors, within a point and along the axes."""

import itertools

import numpy as np
import pytest

from sweep_files import cycle, hand_made, partition
from sweeps import attractors, open_sweep, run_sweep
from sweeps.analysis.attractor_table import rows
from sweeps.analysis.regimes import Regime
from sweeps.errors import Refused
from vibroimpact.status import Status


def test_a_motion_reached_at_another_phase_is_the_same():
    three = [
        cycle(*np.roll([(-1, 0.1), (-0.5, 0.2), (-0.2, 0.9)], k, axis=0), turns=6)[:16]
        for k in range(3)
    ]
    found = attractors(hand_made(three, 3))
    assert found["attractor"].values.tolist() == [0, 0, 0]
    assert found["attractors"].item() == 1


def test_the_order_within_a_cycle_tells_two_apart():
    """The same states in another cyclic order are another motion."""
    states = [(-1.0, 0.1), (-0.5, 0.2), (-0.2, 0.9), (-0.7, 0.4)]
    swapped = [states[i] for i in (0, 2, 1, 3)]
    found = attractors(hand_made([cycle(*states), cycle(*swapped), cycle(*states)], 4))
    assert partition(found["attractor"]) == {frozenset({0, 2}), frozenset({1})}


@pytest.mark.parametrize("noise", [0.0, 1e-9])
def test_states_with_nearly_equal_x_are_not_mixed_up(noise):
    """Cycles with any first state, whose order in x depends on rounding errors."""
    random = np.random.default_rng(0)
    states = np.array([(-0.3, 0.5), (-0.3, -0.5), (-0.3, 0.1), (-0.9, 0.0)])
    mirrored = states * [1.0, -1.0]
    points, expected = [], []
    for i in range(40):
        own = np.roll(mirrored if i % 2 else states, random.integers(4), axis=0)
        points.append(np.tile(own, (4, 1)) + noise * random.normal(size=(16, 2)))
        expected.append(i % 2)
    found = attractors(hand_made(points, 4))["attractor"].values
    assert partition(found) == partition(expected)


@pytest.mark.parametrize(("apart", "count"), [(0.9e-3, 1), (1.1e-3, 2)])
def test_the_tolerance_is_relative_to_the_greatest_coordinate(apart, count):
    for size in (1e-6, 1.0, 1e6):
        points = size * np.array([cycle((-1.0, 0.0)), cycle((-1.0, apart))])
        assert attractors(hand_made(points, 1))["attractors"].item() == count
    assert attractors(hand_made(points, 1), tolerance=1e-2)["attractors"].item() == 1


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
    assert attractors(hand_made(points, 1))["attractors"].item() == 1


def test_a_small_flip_is_not_yet_another_attractor():
    points = [cycle((-1.0, 0.0), (-1.0 + 1e-4, 0.0)), cycle((-1.0, 0.0), (-1.0, 0.0))]
    found = attractors(hand_made(points, [2, 1]))
    assert found["attractor"].values.tolist() == [0, 0]
    assert (found["m"].item(), found["q"].item()) == (1, 1)


def test_what_is_on_no_attractor_or_does_not_repeat():
    sections = np.zeros((8, 16, 2))
    sections[:, :, 0] = -1.0
    sections[6] = np.nan
    status = np.full(8, Status.CERTIFIED)
    status[5:] = Status.PENDING, Status.UNRESOLVED, Status.UNBOUNDED
    found = attractors(
        hand_made(
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
        3: (Regime.UNDECIDED, pytest.approx(2 / 6)),
    }


def test_nothing_computed_has_no_attractor():
    points = hand_made(np.full((3, 8, 2), np.nan), 0, status=np.full(3, Status.PENDING))
    found = attractors(points)
    assert found["attractor"].values.tolist() == [-1] * 3
    assert found["attractors"].item() == 0
    assert found["number"].values.tolist() == [-1]


def test_a_file_without_period_is_refused():
    with pytest.raises(Refused, match=r"no period.* record.diagnostics: \[period\]"):
        attractors(hand_made([cycle((-1, 0))], 1).drop_vars("period"))


# Identities along an axis


def along(sections, periods):
    dataset = hand_made(sections, periods, axes=("h", "x0"))
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
    points, periods = np.empty((30, 1, 16, 2)), np.ones((30, 1), int)
    for i in range(30):
        split = 0.05 * np.sqrt(max(i - 9.5, 0.0))
        points[i, 0] = cycle((-1.0 - split, 0.0), (-1.0 + split, 0.0))
        periods[i] = 2 if i > 9 else 1
    points[20:, 0] += 0.9
    found = along(points, periods)[:, 0]
    assert len(set(found[:20])) == 1 and len(set(found[20:])) == 1
    assert found[0] != found[-1]


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
    table = rows(dataset, attractors(dataset))
    single = {row.number for row in table if row.name == "1/1"}
    double = {row.number for row in table if row.name == "2/2"}
    three = {row.number for row in table if row.name == "2/3"}
    assert len(single) == 1 and single == double
    assert len(three) == 1 and three.isdisjoint(single)


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


def test_a_branch_keeps_its_number_through_a_flip_between_two_points(tmp_path):
    """There both states of the orbit of two periods are far from the state of the orbit before."""
    config = {
        "oscillator": {"h": 0.05, "R": 0.8, "omega": [2.55, 2.62, 2.69, 2.715], "f": 1.0},
        "start": {"x0": [-0.3, 0.0]},
        "record": {"transient": 500, "periods": 130, "diagnostics": ["period"]},
    }
    with open_sweep(run_sweep(config, tmp_path / "flip.h5")) as dataset:
        found = attractors(dataset)
    classes = list(zip(found["m"].values[:, 0], found["q"].values[:, 0], strict=True))
    assert classes == [(1, 1), (1, 1), (2, 2), (2, 2)]
    assert len(np.unique(found["number"].values[:, 0])) == 1
