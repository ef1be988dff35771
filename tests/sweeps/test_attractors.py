"""Distinct attractors: against published speeds, closed forms, symmetries, and pair by pair."""

import csv
import itertools

import numpy as np
import pytest
import xarray as xr
import yaml
from matplotlib.colors import to_hex

from commands import call
from sweep_files import run_in
from sweeps import attractors, load_config, open_sweep, run_sweep
from sweeps.analysis.motion import Motion
from sweeps.analysis.table import cut, rows
from sweeps.errors import Refused
from sweeps.plotting import attractor_diagram, basins, plot
from vibroimpact import Oscillator, one_impact_orbit
from vibroimpact.status import Status

CONFIG = """\
oscillator: {h: 0.0, R: 0.8, omega: 1.3, f: 1.0}
start: {x0: {start: -2.4, stop: 0.0, num: 9}, v0: {start: -2.0, stop: 2.0, num: 9}}
record: {transient: 400, periods: 32, impacts: 12, diagnostics: [period, lyapunov]}
"""


@pytest.fixture(scope="module")
def computed(tmp_path_factory):
    """Return a function that runs `CONFIG` with overrides and opens the file."""
    folder, opened = tmp_path_factory.mktemp("runs"), {}

    def make(*overrides):
        if overrides not in opened:
            name = f"{len(opened)}.h5"
            opened[overrides] = open_sweep(run_in(folder, CONFIG, *overrides, name=name))
        return opened[overrides]

    yield make
    for dataset in opened.values():
        dataset.close()


def hand_made(sections, periods, axes=("x0",), **changed):
    """Return points with these last section states, shape (points..., record, 2)."""
    sections = np.asarray(sections, float)
    shape = sections.shape[: len(axes)]
    periods = np.broadcast_to(periods, shape)
    configuration = {
        "oscillator": {"h": 0.1, "R": 0.8, "omega": 1.0, "f": 1.0}, "record": {}, "method": {}
    }  # fmt: skip
    values = {"status": np.full(shape, Status.CERTIFIED), "rest_fraction": np.zeros(shape)}
    values |= {"period": periods, "period_impacts": periods, **changed}
    data = {name: (axes, np.asarray(value)) for name, value in values.items()}
    for i, name in enumerate(("poincare_x", "poincare_v")):
        data[name] = ((*axes, "section"), sections[..., i])
    coords = {name: np.arange(n) / 10.0 for name, n in zip(axes, shape, strict=True)}
    return xr.Dataset(data, coords, {"name": "a", "configuration": yaml.safe_dump(configuration)})


def partition(labels):
    """Return the sets of points with one label each, without those of none."""
    labels = np.asarray(labels).ravel()
    return {frozenset(np.flatnonzero(labels == one)) for one in np.unique(labels[labels >= 0])}


def pair_by_pair(dataset, tolerance=1e-3):
    """Label periodic points: the first before it with the same m and, rotated, the same states."""
    x, v = (dataset[name].values.reshape(-1, 32) for name in ("poincare_x", "poincare_v"))
    omega = dataset["omega"].item() if "omega" in dataset.coords else 1.3
    period, found = dataset["period"].values.ravel(), []
    for i, m in enumerate(period):
        own = np.column_stack([x[i, -m:], v[i, -m:] / omega])
        label = i
        for j in range(i):
            if period[j] == m and found[j] == j:
                other = np.column_stack([x[j, -m:], v[j, -m:] / omega])
                near = min(np.abs(np.roll(other, k, axis=0) - own).max() for k in range(m))
                if near <= tolerance * max(np.abs(own).max(), np.abs(other).max()):
                    label = j
                    break
        found.append(label)
    return found


# Against numbers from elsewhere


@pytest.mark.parametrize(
    ("h", "R", "single", "three"),
    [
        (0.0, 0.8, 1.4225, (0.7030, 1.1145, 2.2536)),
        (0.02, 0.8, 1.4118, (0.6408, 1.1693, 2.2087)),
        (0.02, 0.95, 1.3135, (0.7642, 0.9341, 2.1229)),
    ],
)
def test_the_known_coexisting_attractors(computed, h, R, single, three):
    dataset = computed(f"oscillator.h={h}", f"oscillator.R={R}", "record.transient=1500")
    found = attractors(dataset)
    assert found["attractors"].item() == 2
    by_class = {row.name: row for row in rows(dataset, found)}
    assert set(by_class) == {"1/1", "2/3"}
    np.testing.assert_allclose(by_class["1/1"].speeds, [single], atol=1e-4)
    np.testing.assert_allclose(by_class["2/3"].speeds, three, atol=1e-4)
    exact = one_impact_orbit(Oscillator(h=h, R=R, omega=1.3, f=1.0)).v
    np.testing.assert_allclose(by_class["1/1"].speeds, [exact], rtol=1e-5)
    assert found["fraction"].sum().item() == pytest.approx(1.0)
    zero = found["attractor"].sel(x0=0.0, v0=0.0).item()
    if h == 0.0:
        assert zero == by_class["2/3"].number


@pytest.mark.parametrize("impacts", [3, 12, 64, 200])
def test_speeds_are_shown_whatever_room_the_record_has(computed, impacts):
    """In 32 periods the orbits have 32 and 48 impacts; of more room the rest is padding."""
    dataset = computed("record.transient=1500", f"record.impacts={impacts}")
    by_class = {row.name: row.speeds for row in rows(dataset, attractors(dataset))}
    np.testing.assert_allclose(by_class["1/1"], [1.4225], atol=1e-4)
    np.testing.assert_allclose(by_class["2/3"], (0.7030, 1.1145, 2.2536), atol=1e-4)


# Starts that have not settled


SLOW = (
    "oscillator={h: 0.02, R: 0.8, omega: 2.6, f: 1.0, clearance: 0.6}",
    "start={x0: {start: -3.0, stop: 0.6, num: 12}, v0: {start: -3.0, stop: 3.0, num: 12}}",
    "record={transient: 200, periods: 32, impacts: 16, diagnostics: [period]}",
)


def test_starts_that_settle_slowly_are_on_the_attractor_they_go_to(computed):
    """Without impacts a deviation falls by exp(-2 pi h / omega) = 0.953 per period."""
    dataset = computed(*SLOW)
    slow = dataset["period"].values == 0
    assert 0.1 < slow.mean() < 0.5 and (dataset["impacts_per_period"].values[slow] == 0.0).all()
    found = attractors(dataset)
    assert {row.name for row in rows(dataset, found)} >= {"1/0", "2/1"}
    assert not np.isin(found["motion"], (Motion.UNDECIDED, Motion.NEUTRAL)).any()
    (free,) = (row for row in rows(dataset, found) if row.name == "1/0")
    assert (found["attractor"].values[slow] == free.number).all()
    np.testing.assert_array_equal(found["followed"], slow)
    long = computed(*SLOW, "record.transient=4000")
    assert not attractors(long, extensions=0)["followed"].any()
    assert partition(found["attractor"]) == partition(attractors(long, extensions=0)["attractor"])


def test_the_table_says_which_share_was_followed_on(computed):
    result = call("attractors", computed(*SLOW).encoding["source"])
    slow = (computed(*SLOW)["period"].values == 0).mean()
    assert f"{100 * slow:.1f} % of the starts had not settled in their record" in result.stdout
    assert "unsettled" not in result.stdout and "undecided" not in result.stdout


def test_an_attractor_that_no_record_shows_has_its_speeds(computed):
    """None of the starts settles within two periods."""
    short = computed("record={transient: 0, periods: 2, impacts: 1, diagnostics: [period]}")
    by_class = {row.name: row.speeds for row in rows(short, attractors(short))}
    np.testing.assert_allclose(by_class["1/1"], [1.4225], atol=1e-4)
    np.testing.assert_allclose(by_class["2/3"], (0.7030, 1.1145, 2.2536), atol=1e-4)


def test_what_never_settles_is_unsettled_and_no_attractor(computed):
    """Without damping and impacts: a sum of two frequencies, for ever."""
    dataset = computed(
        "oscillator={h: 0.0, R: 0.8, omega: 1.4142135623730951, f: 1.0, clearance: 10.0}",
        "start={x0: [-1.0, 0.0], v0: [0.0, 0.5]}",
        "record={transient: 20, periods: 32, diagnostics: [period]}",
    )
    found = attractors(dataset)
    assert found["attractors"].item() == 0
    lines = call("attractors", dataset.encoding["source"]).stdout.splitlines()
    assert lines[1].split()[:2] == ["-", "unsettled"]


@pytest.mark.slow
def test_the_shares_are_those_of_runs_that_are_long_enough(tmp_path):
    """At 20 random places; sections of long runs are compared start by start."""
    random = np.random.default_rng(5)
    several = 0
    for _ in range(20):
        h, R = 10.0 ** random.uniform(-2.3, -0.5), random.uniform(0.3, 0.98)
        omega, clearance = random.uniform(0.5, 4.0), random.choice([0.0, random.uniform(-0.5, 1.0)])
        text = (
            f"oscillator: {{h: {h}, R: {R}, omega: {omega}, f: 1.0, clearance: {clearance}}}\n"
            f"start: {{x0: {{start: -2.5, stop: {clearance}, num: 20}}, "
            "v0: {start: -2.0, stop: 2.0, num: 20}}\n"
            "record: {transient: 50, periods: 32, impacts: 4, diagnostics: [period]}\n"
        )
        (tmp_path / "c.yaml").write_text(text)
        short = run_sweep(load_config(tmp_path / "c.yaml"), tmp_path / "short.h5", overwrite=True)
        long = run_sweep(
            load_config(tmp_path / "c.yaml", ["record.transient=5000", "record.periods=128"]),
            tmp_path / "long.h5",
            overwrite=True,
        )
        with open_sweep(short) as dataset, open_sweep(long) as settled:
            found = attractors(dataset)
            assert not np.isin(found["motion"], (Motion.UNDECIDED, Motion.NEUTRAL)).any()
            got = sorted(found["fraction"].values[found["number"].values >= 0])
            shares = sorted(long_run_shares(settled))
        several += len(shares) > 1
        assert len(got) == len(shares)
        error = 3.0 * np.sqrt(np.array(shares) * (1.0 - np.array(shares)) / 400.0)
        assert (np.abs(np.array(got) - shares) <= error + 1e-12).all()
    assert several >= 3


def long_run_shares(dataset):
    """Return the share of the starts on each attractor: by the points in their sections."""
    x, v = (dataset[name].values.reshape(400, -1) for name in ("poincare_x", "poincare_v"))
    rests = dataset["rest_fraction"].values.ravel() > 0.0
    period, kinds = dataset["period"].values.ravel(), []
    for i in range(400):
        if rests[i] or not period[i]:
            kinds.append("rest" if rests[i] else "chaos")
            continue
        m = period[i]
        lowest = np.argmin(x[i, -m:])
        kinds.append((m, round(x[i, -m:][lowest], 4), round(v[i, -m:][lowest], 3)))
    return [kinds.count(kind) / 400.0 for kind in set(kinds)]


def test_the_same_partition_pair_by_pair(computed):
    dataset = computed()
    assert partition(attractors(dataset)["attractor"]) == partition(pair_by_pair(dataset))


def test_one_of_two_attractors_is_the_free_oscillation(computed):
    """Clearance 0.6: x = Im(-exp(i omega t) / (p^2 - omega^2 + 2 i h omega)), without an impact."""
    dataset = computed(
        "oscillator={h: 0.1, R: 0.8, omega: 2.6, f: 1.0, clearance: 0.6}",
        "record.transient=300",
    )
    found = attractors(dataset)
    by_class = {row.name: i for i, row in enumerate(rows(dataset, found))}
    assert set(by_class) == {"1/0", "2/1"}
    steady = -1.0 / (1.0 - 2.6**2 + 2j * 0.1 * 2.6)
    free = found.isel(coexisting=by_class["1/0"])
    assert free["section_x"].item() == pytest.approx(steady.imag, abs=1e-9)
    assert free["section_v"].item() == pytest.approx((2.6j * steady).imag, abs=1e-9)
    orbit = one_impact_orbit(Oscillator(h=0.1, R=0.8, omega=2.6, f=1.0, clearance=0.6), n=2)
    assert orbit.stable
    (speed,) = rows(dataset, found)[by_class["2/1"]].speeds
    assert speed == pytest.approx(orbit.v, rel=1e-9)


# Invariance


def test_the_order_of_the_starts_changes_names_only(computed):
    dataset, random = computed(), np.random.default_rng(1)
    order = {name: random.permutation(dataset.sizes[name]) for name in ("x0", "v0")}
    turned = dataset.isel(order).transpose("v0", "x0", ...)
    found, other = attractors(dataset), attractors(turned)
    np.testing.assert_array_equal(
        other["attractor"].transpose("x0", "v0"), found["attractor"].isel(order)
    )
    np.testing.assert_allclose(other["fraction"], found["fraction"])
    np.testing.assert_allclose(other["m"], found["m"])


def test_parts_of_the_grid_of_starts_agree_with_the_whole(computed):
    dataset = computed()
    whole = attractors(dataset)["attractor"]
    for part in (slice(0, 4), slice(4, 9)):
        own = attractors(dataset.isel(x0=part))["attractor"]
        assert partition(own) == partition(whole.isel(x0=part))


def test_small_parts_of_the_file_give_the_same(computed, monkeypatch):
    dataset = computed()
    whole = attractors(dataset)
    monkeypatch.setattr("sweeps.analysis.grouping._PART", 20)
    xr.testing.assert_allclose(
        attractors(dataset)[["attractor", "fraction", "m", "q"]],
        whole[["attractor", "fraction", "m", "q"]],
    )


def test_the_attractors_scale_with_the_force(computed):
    """At clearance 0 by f = 1000, with the starts."""
    scaled = computed(
        "oscillator.f=1000",
        "start={x0: {start: -2400, stop: 0, num: 9}, v0: {start: -2000, stop: 2000, num: 9}}",
    )
    assert partition(attractors(scaled)["attractor"]) == partition(
        attractors(computed())["attractor"]
    )


# What is one attractor


def cycle(*states, turns=8):
    return np.tile(states, (turns, 1))


TWO = ((-0.5, 0.2), (-0.4, -0.3))


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
    """Cycles that begin anywhere, and whose order in x is that of rounding errors."""
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


def test_states_on_their_way_to_one_motion_are_chained():
    """Seven in a row, each within the tolerance of the next only."""
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
    table = {int(n): (Motion(int(k)), float(f)) for n, k, f in zip(
        found["number"], found["motion"], found["fraction"], strict=True)}  # fmt: skip
    assert table == {
        0: (Motion.PERIODIC, pytest.approx(1 / 6)),
        1: (Motion.UNBOUNDED, pytest.approx(1 / 6)),
        2: (Motion.REST, pytest.approx(2 / 6)),
        3: (Motion.UNDECIDED, pytest.approx(2 / 6)),
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
    """Two branches that pass each other in x and in how many starts they have."""
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


def test_identities_on_a_sweep_over_omega(computed):
    """The orbit of one impact per period, stable from 1.26 on, through its flip at 2.655.

    At omega = 2 its impact passes the section, and where 2/3 coexists, the other keeps its own.
    """
    dataset = computed(
        "oscillator={h: 0.02, R: 0.8, omega: {start: 1.27, stop: 2.69, num: 143}, f: 1.0}",
        "start={x0: [-1.6, -0.8, 0.0], v0: [-1.0, 0.0, 1.0]}",
    )
    table = rows(dataset, attractors(dataset))
    single = {row.number for row in table if row.name == "1/1"}
    double = {row.number for row in table if row.name == "2/2"}
    three = {row.number for row in table if row.name == "2/3"}
    assert len(single) == 1 and single == double
    assert len(three) == 1 and three.isdisjoint(single)


def test_no_two_attractors_of_a_point_have_one_number(computed):
    dataset = computed(
        "oscillator={h: 0.02, R: {start: 0.5, stop: 0.95, num: 24}, f: 1.0, "
        "omega: {start: 0.5, stop: 3.5, num: 40}}",
        "start={x0: [-1.6, 0.0], v0: [-1.0, 0.0]}",
        "record.periods=64",
    )
    found = attractors(dataset)
    names = found["number"].values.reshape(-1, found.sizes["coexisting"])
    for one, other in itertools.combinations(names.T, 2):
        assert not ((one == other) & (one >= 0)).any()
    assert found["attractors"].max() >= 2
    periodic = found["motion"] == Motion.PERIODIC
    shared = np.unique(names[periodic.values.reshape(names.shape)], return_counts=True)[1]
    assert shared.max() > 100  # names are shared in both directions
    turned = attractors(dataset.transpose("omega", "R", ...))
    assert partition(turned["attractor"].transpose(*found["attractor"].dims)) == partition(
        found["attractor"]
    )


# The command and the pictures


def test_the_table_and_its_file(computed, tmp_path):
    dataset = computed()
    file = dataset.encoding["source"]
    result = call("attractors", file, "--csv", str(tmp_path / "a.csv"))
    assert result.exit_code == 0, result.stderr
    lines = result.stdout.splitlines()
    assert lines[1].split()[:5] == ["0", "2/3", "0.703,", "1.114,", "2.254"]
    assert lines[2].split()[:3] == ["1", "1/1", "1.423"]
    with (tmp_path / "a.csv").open() as text:
        table = list(csv.DictReader(text))
    assert [row["m"] + row["q"] for row in table] == ["23", "11"]
    assert sum(float(row["fraction"]) for row in table) == pytest.approx(1.0)
    assert float(table[1]["impact_v"]) == pytest.approx(1.4225, abs=1e-4)


def test_the_table_over_a_parameter(computed):
    dataset = computed(
        "oscillator={h: 0.02, R: 0.8, omega: {start: 1.27, stop: 2.69, num: 143}, f: 1.0}",
        "start={x0: [-1.6, -0.8, 0.0], v0: [-1.0, 0.0, 1.0]}",
    )
    file = dataset.encoding["source"]
    result = call("attractors", file)
    assert "0          1/1, 2/2" in result.stdout and "9 starts at each" in result.stdout
    result = call("attractors", file, "--at", "omega=1.3001")
    assert "2/3" in result.stdout and "1/1" in result.stdout
    assert "shown at omega = 1.3" in result.stderr
    assert len(rows(cut(dataset, {"omega": 1.3}), attractors(cut(dataset, {"omega": 1.3})))) == 2


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--at", "x0=0"], "x0 cannot be fixed here; choose from: none"),
        (["--csv", "a.txt"], "--csv a.txt is not allowed; expected: a .csv file"),
        (["--at", "omega"], "expected: NAME=VALUE"),
    ],
)
def test_requests_that_do_not_fit_are_refused(computed, arguments, text):
    result = call("attractors", computed().encoding["source"], *arguments)
    assert result.exit_code == 2
    assert text in " ".join(result.stderr.split())


def test_the_colours_of_the_basins_are_the_attractors(computed):
    dataset = computed()
    figure = basins(dataset)
    (mesh,) = figure.axes[0].collections
    drawn = mesh.get_array()
    own = attractors(dataset)["attractor"].transpose("v0", "x0").values
    assert partition(drawn) == partition(own)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    share = 100.0 * attractors(dataset)["fraction"].values
    assert labels == [
        f"2/3: 0.703, 1.114, 2.254; {share[0]:.1f} %",
        f"1/1: 1.423; {share[1]:.1f} %",
    ]


def test_basins_of_a_file_that_is_not_complete(computed, tmp_path):
    dataset = computed().load().copy(deep=True)
    dataset["status"][0, 0], dataset["status"][1, 1] = Status.PENDING, Status.UNRESOLVED
    figure = basins(dataset)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "unresolved" in labels and "not computed yet (1 of 81)" in labels
    plot(dataset, tmp_path / "a.svg")


def test_a_diagram_has_a_colour_for_each_attractor(computed, tmp_path):
    dataset = computed(
        "oscillator={h: 0.02, R: 0.8, omega: {start: 1.27, stop: 2.69, num: 143}, f: 1.0}",
        "start={x0: [-1.6, -0.8, 0.0], v0: [-1.0, 0.0, 1.0]}",
    )
    figure = attractor_diagram(dataset, coordinate="impact_v")
    lines = {
        to_hex(line.get_color()): line for line in figure.axes[0].lines if len(line.get_xdata())
    }
    x, y = lines["#0072b2"].get_data()
    for omega in (1.3, 1.8, 2.5):
        exact = one_impact_orbit(Oscillator(h=0.02, R=0.8, omega=omega, f=1.0)).v
        np.testing.assert_allclose(y[np.abs(x - omega) < 1e-9], exact, rtol=1e-6)
    for kind, name in ((None, "a.png"), ("attractors", "b.pdf")):
        plot(dataset, tmp_path / name, kind)


@pytest.mark.parametrize(
    ("draw", "options", "text"),
    [
        (basins, {"at": {"R": 0.5}}, "R cannot be fixed here"),
        (attractor_diagram, {}, "a diagram of attractors|single point"),
        (attractor_diagram, {"coordinate": "pie"}, "single point|no pie"),
    ],
)
def test_pictures_that_do_not_fit_are_refused(computed, draw, options, text):
    with pytest.raises(Refused, match=text):
        draw(computed(), **options)


def test_basins_need_both_starts():
    with pytest.raises(Refused, match="basins need x0 and v0 as axes; the file has x0"):
        basins(hand_made([cycle((-1, 0))] * 2, 1))


def test_up_and_down_are_starts():
    """Two branches along h, one of them reached both ways at the ends only."""
    points = np.empty((6, 2, 16, 2))
    points[:, 0], points[:, 1] = cycle((-1.0, 0.0), turns=16), cycle((-0.2, 0.0), turns=16)
    points[0, 1], points[5, 0] = points[0, 0], points[5, 1]
    dataset = hand_made(points, 1, axes=("h", "direction")).assign_coords(direction=["up", "down"])
    found = attractors(dataset)
    assert found["attractors"].dims == ("h",)
    assert found["attractors"].values.tolist() == [1, 2, 2, 2, 2, 1]
    assert len(rows(dataset, found)) == 10
