"""Crises of chaotic attractors, against long runs on both sides."""

from types import SimpleNamespace

import numpy as np
import pytest

import sweeps
from sweeps.bifurcation.crises import Chaos, crisis
from sweeps.opened.opened_sweep import OpenedSweep
from tests.helpers.commands import accepted
from vibroimpact import integrate

#: Of 1e6 periods, how many motions of 50 have left the chaos at some R: it ends between the two.
ALIVE, DEAD = 0.6241, 0.6243


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Return a sweep over the end of a chaotic attractor, with the fold of 5/5 before it."""
    scene = {
        "oscillator": {
            "h": 0.02, "R": {"start": 0.622, "stop": 0.6249, "num": 30}, "omega": 2.8, "f": 1.0,
        },
        "record": {"transient": 3000, "periods": 128, "diagnostics": ["period", "lyapunov"]},
    }  # fmt: skip
    return sweeps.run_sweep(scene, tmp_path_factory.mktemp("crisis") / "crisis.h5")


def shares_left(path, R):
    """Return the share of motions that are periodic after 20,000 periods from the attractor."""
    with sweeps.open_sweep(path) as dataset:
        before = dataset.sel(R=0.623, method="nearest")
        points = np.repeat(OpenedSweep(dataset).points[:1], 50)
        points["x0"], points["v0"] = (
            before[name].values[-50:] for name in ("poincare_x", "poincare_v")
        )
    points["R"] = R
    x = integrate(points, transient=19_900, periods=100, at_section=True)["poincare_x"]
    return float((np.abs(x[:, -1] - x[:, -11]) < 1e-7).mean())


@pytest.mark.slow
def test_chaos_that_ends_as_it_touches_an_unstable_orbit_is_a_crisis_of_the_border(path):
    """The orbit 5/5 from the fold at 0.6222: nothing else is known of it there."""
    assert shares_left(path, ALIVE) == 0.0 and shares_left(path, DEAD) > 0.9
    found = sweeps.bifurcations(path)
    named = found[found["kind"] == "crisis"]
    assert named[["orbit", "after"]].values.tolist() == [["5/5", "5/5"]]
    assert ALIVE - 1e-9 <= named["low"].item() and named["high"].item() <= DEAD + 1e-9
    listed = accepted("info", path, "--bifurcations")
    assert "  crisis  5/5    chaotic -> 5/5" in listed


@pytest.mark.slow
def test_no_crisis_is_named_where_the_attractor_keeps_its_distance(path):
    """As where a start leads from the chaos to another motion, and the chaos goes on."""
    with sweeps.open_sweep(path) as dataset:
        orbits, sweep = sweeps.branches(dataset), OpenedSweep(dataset)
        for place in (5, 10, 15):
            states = np.repeat(sweep.points[place], 50)
            states["x0"], states["v0"] = (
                dataset[name].values[place, -50:] for name in ("poincare_x", "poincare_v")
            )
            for step in (1e-4, -1e-4, 2e-5):
                assert crisis(Chaos(sweep.spec, states, "R", step, orbits)) == ""


def test_an_orbit_at_its_fold_beyond_the_attractor_is_not_touched(monkeypatch):
    """Its second multiplier is 1 but for rounding, so no power of a distance beyond 1 is finite."""
    states = np.random.default_rng(1).random((50, 500, 2))

    def unstable(chaos, place):
        x = 0.5 if place < 5.0 else 4.0
        yield 0, SimpleNamespace(m=1, q=1, multipliers=np.array([0.5, 1.0 + 1e-9]),
                                 sections=lambda phase: np.array([[x, 1.2]]))  # fmt: skip

    monkeypatch.setattr(Chaos, "holds", lambda chaos, place: True)
    monkeypatch.setattr(Chaos, "states", lambda chaos, place, _: (states, float(place < 0.0)))
    monkeypatch.setattr(Chaos, "unstable", unstable)
    points, spec = np.zeros(1, [("R", float)]), SimpleNamespace(phase=0.0)
    assert crisis(Chaos(spec, points, "R", 1e-4, None)) == ""
