"""Crises of chaotic attractors, against long runs on both sides."""

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

#: Two ends of chaos over R at h = 0.02, omega = 2.8, each as a bracket: at the first value none of
#: 50 motions leaves it in 1e6 periods, at the second nearly all do. And the orbit touched.
ENDS = {"5/5": (0.6241489, 0.6242), "12/12": (0.57391491, 0.57392)}
#: Ranges and numbers of values in which they are seen, the first with the fold of 5/5 before it.
SEEN = [
    ("5/5", 0.622, 0.6249, 30), ("5/5", 0.6232, 0.6246, 23), ("12/12", 0.5738, 0.57405, 14),
]  # fmt: skip


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
    file, periodic = path(0.6232, 0.6246, 23), path(0.4, 0.5, 6)
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
