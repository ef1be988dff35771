"""What the list names beside a bifurcation, and a crisis as the end of chaos, against long runs."""

import itertools
from functools import cache

import numpy as np
import pandas as pd
import pytest

import sweeps
from sweeps.bifurcation.crises import Chaos, crisis
from sweeps.errors import Refused
from sweeps.opened.opened_sweep import OpenedSweep
from tests.helpers.commands import accepted
from vibroimpact import Oscillator, branch, integrate, periodic_orbit
from vibroimpact.oscillator import POINT

pytestmark = pytest.mark.slow

#: Ranges of the parameters in which most motions have impacts.
RANGES = {
    "h": (0.01, 0.3), "R": (0.4, 0.95), "omega": (2.2, 3.3), "f": (0.7, 1.3), "p": (0.7, 1.3),
    "clearance": (0.02, 0.3),
}  # fmt: skip
#: The case that was wrong: 8/7 ends in a fold before the graze at which 4/3 begins.
CASE = {
    "R": 0.7885194416827579, "omega": 2.716989975262034, "f": 1.0, "clearance": 0.14602287303658285,
    "h": np.linspace(0.0, 0.3, 140).tolist(),
}  # fmt: skip
#: Distance from a bifurcation at which a motion must exist, as a share of the steps of the axis, if
#: no value of the sweep and no other bifurcation is as near: then half the way to that.
BESIDE = 1e-2


def run(tmp_path, axis, oscillator):
    """Run a sweep from rest; return it, and the bifurcations along its axis."""
    record = {"transient": 200, "periods": 64, "diagnostics": ["period"]}
    scene = {"oscillator": oscillator, "start": {"x0": 0.0}, "record": record}
    path = sweeps.run_sweep(scene, tmp_path / "out.h5", overwrite=True)
    with sweeps.open_sweep(path) as dataset:
        return dataset.load(), sweeps.bifurcations(dataset, axis, most=1)


def settled(oscillator, state, transient):
    """Continue a motion; return its last state, its periods and its impacts in a repetition."""
    points = oscillator.at()
    points["x0"], points["v0"] = min(state[0], oscillator.clearance), state[1]
    record = integrate(points, transient=transient, periods=64, at_section=True)
    sections = np.stack([record["poincare_x"][0], record["poincare_v"][0]], axis=1)
    for m in range(1, 33):
        if np.abs(sections[m:] - sections[:-m]).max() < 1e-6 * np.abs(sections).max():
            points["x0"], points["v0"] = sections[-1]
            whole = integrate(points, transient=0, periods=m, at_section=True)
            return sections[-1], (m, round(m * whole["impacts_per_period"].item()))
    return sections[-1], None


def persists(oscillator, axis, values, state, expected):
    """Whether a motion keeps its class from value to value."""
    for value in values:
        there = Oscillator(**{**oscillator, axis: value})
        for transient in (2_000, 200_000):  # beside a bifurcation it settles slowly
            state, reached = settled(there, state, transient)
            if reached == expected:
                break
        else:
            return False
    return True


def free(h, omega, f, p=1.0, **others):
    """Return the state of the free motion at the phase 0."""
    amplitude = -f / (p * p - omega * omega + 2j * h * omega)
    return amplitude.imag, omega * amplitude.real


def missing(sweep, found, oscillator, axis):
    """Return how many classes the list names beside its values, and those not found there.

    They are looked for from motions of the sweep, from the bifurcation and from the free motion.
    """
    values, gap = sweep[axis].values, np.diff(sweep[axis].values).max()
    states = np.stack([sweep["poincare_x"].values, sweep["poincare_v"].values], axis=-1)[:, -1]
    shares = np.concatenate([np.linspace(1.0, 0.1, 40), np.geomspace(0.1, 1e-3, 15), [0.0]])
    named, absent = 0, []
    marks = np.append(values, found["value"].dropna())
    for row in found.dropna(subset="value").to_dict("records"):
        for side, way in (("before", -1), ("after", 1)):
            m, _, q = row[side].partition("/")
            if not q or int(m) > 32:
                continue
            named, expected = named + 1, (int(m), int(q))
            apart = way * (marks - row["value"])
            target = row["value"] + way * min(BESIDE * gap, *(apart[apart > 0.0] / 2.0))
            nearest = np.argsort(np.where(way * (values - target) > 0.0, abs(values - target), 9e9))
            starts = [(values[i], states[i]) for i in nearest[:4]]
            starts.append((target, (row["x"], row["v"])))
            starts.append((target, free(**oscillator | {axis: target})))
            if not any(
                persists(oscillator, axis, target + (value - target) * shares, state, expected)
                for value, state in starts
            ):
                absent.append((row["kind"], row["orbit"], row["value"], side, row[side]))
    return named, absent


def test_a_motion_that_has_ended_is_not_named(tmp_path):
    """Neither one that begins later, at the flip before."""
    _, found = run(tmp_path, "h", CASE)
    rows = found[found["value"].between(0.1037, 0.1101)]
    expected = "flip 12/12 24/24 ?", "fold 8/7 8/7 ?", "graze 4/4 ? 4/3"
    cells = rows[["kind", "orbit", "before", "after"]].values
    assert [" ".join(row) for row in cells] == [*expected]


@pytest.mark.parametrize(
    "seed", [10, *(pytest.param(n, marks=pytest.mark.campaign) for n in range(60, 160))]
)
def test_what_is_named_beside_a_bifurcation_exists_there(tmp_path, seed):
    random = np.random.default_rng(seed)
    axis = [*RANGES][seed % len(RANGES)]
    oscillator = {name: random.uniform(*ends) for name, ends in RANGES.items()}
    values = np.linspace(*RANGES[axis], int(random.integers(20, 140))).tolist()
    sweep, found = run(tmp_path, axis, oscillator | {axis: values})
    named, absent = missing(sweep, found, oscillator, axis)
    assert not absent and (named or seed != 10)


#: Two ends of chaos over R at h = 0.02, omega = 2.8, each as a bracket: at the first value none of
#: 50 motions leaves it in 1e6 periods, at the second nearly all do. And the orbit touched.
ENDS = {"5/5": (0.6241489, 0.6242), "12/12": (0.57391491, 0.57392)}
#: Ranges and numbers of values in which they are seen, the first with the fold of 5/5 before it.
SEEN = [("5/5", 0.622, 0.6249, 30), ("12/12", 0.5738, 0.57405, 14)]


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Return a function that runs a sweep over a range of R."""

    @cache
    def run(start, stop, num):
        scene = {
            "oscillator": {
                "h": 0.02, "R": {"start": start, "stop": stop, "num": num}, "omega": 2.8, "f": 1.0,
            },
            "record": {"transient": 3000, "periods": 128, "diagnostics": ["period", "lyapunov"]},
        }  # fmt: skip
        folder = tmp_path_factory.mktemp("crisis")
        return sweeps.run_sweep(scene, folder / "crisis.h5")

    return run


def states_at(sweep, place, number=50):
    """Return the last states of a point at the section as points."""
    points = np.repeat(sweep.points[place], number)
    for name in ("x0", "v0"):
        points[name] = sweep.data[f"poincare_{name[0]}"].values[place, -number:]
    return points


@pytest.mark.parametrize(("orbit", "start", "stop", "num"), SEEN)
def test_chaos_that_touches_an_unstable_orbit_ends_in_a_crisis(path, orbit, start, stop, num):
    file, (alive, dead) = path(start, stop, num), ENDS[orbit]
    found = sweeps.bifurcations(file)
    named = found[found["kind"] == "crisis"]
    assert named[["orbit", "before", "after"]].values.tolist() == [[orbit, "chaotic", orbit]]
    with sweeps.open_sweep(file) as dataset:
        sweep = OpenedSweep(dataset)
        points = states_at(sweep, int(np.searchsorted(dataset["R"].values, alive)) - 1)
    shares = []
    for points["R"] in (alive, dead):
        x = integrate(points, transient=19_800, periods=200, at_section=True)["poincare_x"]
        turn = int(orbit.split("/")[0])
        shares.append(float((np.abs(x[:, -1] - x[:, -1 - 2 * turn]) < 1e-7).mean()))
    assert shares[0] == 0.0 and shares[1] > 0.9


def test_no_crisis_is_named_where_the_chaos_goes_on_or_is_a_transient(path):
    """As where a start leads from the chaos to another motion, or the crisis lies far before."""
    with sweeps.open_sweep(path(0.622, 0.6249, 30)) as dataset:
        sweep = OpenedSweep(dataset)
        for place in (5, 10, 15, 24):
            states = states_at(sweep, place)
            for step in (1e-4, -1e-4, 2e-5):
                first, end = states["R"][0] - step, states["R"][0] + step
                assert crisis(Chaos(sweep.spec, states, "R", first, end)) == ""


def test_only_the_end_of_chaos_needs_sections(path):
    file, periodic = path(0.622, 0.6249, 30), path(0.4, 0.5, 6)
    with sweeps.open_sweep(file) as dataset:
        with pytest.raises(Refused, match="the file has no poincare_x"):
            sweeps.bifurcations(dataset.drop_vars("poincare_x"), most=1)
    with sweeps.open_sweep(periodic) as dataset:
        found = sweeps.bifurcations(dataset.drop_vars("poincare_x"))
    assert len(found)
    pd.testing.assert_frame_equal(found, sweeps.bifurcations(periodic))


def test_where_the_orbit_reached_is_born_in_the_chaos_a_fold_is_the_reason(path):
    """The orbit 10/10: its multiplier is 1 at the value listed, where it begins to attract."""
    file = path(0.5977, 0.5981, 21)
    found = sweeps.bifurcations(file)
    assert "  fold  10/10  chaotic -> 10/10" in accepted("info", file, "--bifurcations")
    chaos = found[(found["before"] == "chaotic") | (found["after"] == "chaotic")]
    (fold,) = chaos[chaos["kind"] == "fold"].to_dict("records")
    assert (fold["before"], fold["after"], fold["orbit"]) == ("chaotic", "10/10", "10/10")
    assert "crisis" not in found["kind"].values and fold["source"] == "exact"
    beyond = Oscillator(h=0.02, R=fold["value"] + 1e-7, omega=2.8, f=1.0)
    orbit = periodic_orbit(beyond, fold["x"], fold["v"], 10)
    assert (orbit.m, orbit.q) == (10, 10) and abs(orbit.multipliers[0] - 1.0) < 0.1
    special = branch(orbit, "R", 0.5977, 0.5981).special
    assert [point.kind for point in special if abs(point.value - fold["value"]) < 1e-12] == ["fold"]


@pytest.mark.parametrize("values", [{"start": 0, "stop": 0.002, "num": 3}, [0.0, 0.001, 0.0015]])
def test_no_motion_is_run_beyond_the_ends_of_the_axis(tmp_path, monkeypatch, values):
    """The chaos at h = 0, the first value and the least that is allowed, ends at once."""
    scene = {
        "oscillator": {"h": values, "R": 0.8, "omega": 3.0220440881763526, "f": 1.0},
        "record": {"transient": 600, "diagnostics": ["period", "lyapunov"]},
        "start": {"x0": -0.6},
    }
    file, shares = sweeps.run_sweep(scene, tmp_path / "ends.h5"), []
    (row,) = sweeps.bifurcations(file, report=shares.append).to_dict("records")
    assert (row["kind"], row["before"], row["low"], row["high"]) == ("basin", "chaotic", 0.0, 1e-3)
    assert shares == sorted(shares) and shares[0] == 0.0


def test_no_rounding_takes_a_motion_beyond_the_ends():
    points = np.zeros(1, POINT)
    for step, steps in itertools.product((0.1, 0.001, 0.3), (1, 2, 4, 8, 16)):
        first, last, end = 0.0, steps * step, (steps + 1) * step
        points["h"] = last
        ran = [Chaos(None, points, "h", first, end).at(place)["h"][0] for place in (steps, -1.0)]
        assert first <= ran[0] and ran[1] <= end
