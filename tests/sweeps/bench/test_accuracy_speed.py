"""Accuracy against speed: the evaluation of measurements, and the command."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from sweeps import load_config
from sweeps.bench import accuracy
from sweeps.bench import accuracy_results as results
from sweeps.bench.accuracy import (
    CHATTER_SCENE,
    EXACT_METHOD,
    GRAZING,
    MEASURED_COLUMNS,
    METHODS,
    ORBIT_ERRORS,
    REGULAR,
    Method,
    Plan,
    measure_methods,
    of_sweep,
)
from sweeps.bench.accuracy_results import MEAN
from sweeps.bench.peers import PEERS, installed, run_peer
from sweeps.grid import Grid
from tests.helpers.commands import call
from vibroimpact import Status

STATE, TIME, SPEED, DEPTH = ORBIT_ERRORS
ONE_IMPACT = next(scene for scene in REGULAR if scene.name == "one impact")

PLAIN, CUBIC = Method("rk4", "plain"), Method("rk4", "cubic")


def made(error, seconds, steps=100, method=PLAIN, scene="s", kind=STATE, tolerance=None):
    """Return an artificial measurement, a row of the table."""
    return (scene, kind, *method, steps, tolerance, error, seconds)


def in_a_table(rows):
    """Return measurements as `measure` does."""
    return pd.DataFrame(rows, columns=MEASURED_COLUMNS).astype(accuracy._TYPES)


def test_the_efficient_frontier():
    good = [made(0.5, 1.0), made(0.1, 2.0), made(1e-9, 7.0)]
    # Same cost but less accurate, more costly but not better, failed, no correct digit.
    bad = [made(0.2, 2.0), made(0.1, 3.0), made(math.nan, 0.1), made(2.0, 0.2), made(0.6, 1.5)]
    found = results.efficient_frontier(in_a_table([*bad, *good[::-1]]))
    pd.testing.assert_frame_equal(found.reset_index(drop=True), in_a_table(good))
    assert results.efficient_frontier(in_a_table([])).empty


@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
def test_the_order_of_a_power_law(order):
    steps = np.array([25, 50, 100, 200, 400, 800])
    wiggle = 1.0 + 0.05 * np.array([1, -1, 1, -1, 1, -1])
    errors = 0.1 * (steps / 10.0) ** -order
    assert results.measured_order(steps, errors) == pytest.approx(order, abs=1e-12)
    assert results.measured_order(steps, errors * wiggle) == pytest.approx(order, abs=0.1)
    # Neither a coarse start nor a plateau at the reference's error counts.
    steps, bent = [5, *steps], [0.9, *np.where(steps > 200, 1e-13, errors)]
    known = results.measured_order(steps, bent, floor=1e-13)
    assert known == pytest.approx(order, abs=1e-12)
    assert results.measured_order(steps, bent) > order + 1.0


def test_no_order_from_less_than_three_errors():
    order = results.measured_order
    assert math.isnan(order([50, 100], [1e-2, 1e-3]))
    assert math.isnan(order([50, 100, 200], [0.5, 1e-2, 1e-3]))
    assert math.isnan(order([50, 100, 200], [math.nan, 1e-2, 1e-3]))
    assert math.isnan(order([50, 100, 200], [0.0, 0.0, 0.0]))
    assert math.isnan(order([50, 100, 200], [1e-2, 1e-3, 1e-4], floor=1e-4))


def test_the_reference_and_the_peers_have_no_order():
    steps, errors = (50, 100, 200, 400), (1e-2, 1e-3, 1e-4, 1e-5)
    peer = Method("SciPy RK45", "events")
    rungs = [*zip(steps, errors, strict=True)]
    all_ = [made(e, 1.0, n, m) for m in (EXACT_METHOD, PLAIN) for n, e in rungs]
    all_ += [made(e, 1.0, None, peer, tolerance=e) for e in errors]

    def order(table, method):
        found = results.with_orders(table)
        (one,) = set(found[found["impact"] == method.impact]["measured_order"].astype(str))
        return float(one)

    table = in_a_table(all_)
    known = table[table["impact"] != "exact"]
    assert order(known, PLAIN) == pytest.approx(np.log2(10.0))
    assert math.isnan(order(known, peer))
    # A reference as bad as the method says nothing about the method.
    assert math.isnan(order(table, PLAIN)) and math.isnan(order(table, EXACT_METHOD))


def test_means_are_geometric_and_of_all_regular_scenes():
    names = [scene.name for scene in REGULAR]
    all_ = [made(10.0**-k, 2.0**k, scene=name) for k, name in enumerate(names)]
    all_ += [made(1e-3, 1.0, 200, scene=name) for name in names[1:]]  # one is missing
    all_ += [made(1e-3, 1.0, scene=CHATTER_SCENE.name)]
    (mean,) = results.means(in_a_table(all_)).itertuples()
    assert (mean.scene, mean.steps_per_period, mean.integrator) == (MEAN, 100, "rk4")
    assert mean.error == pytest.approx(1e-2) and mean.seconds_per_period == pytest.approx(4.0)
    failed = [made(math.nan, 1.0, scene=names[0]), *all_[1:]]
    assert math.isnan(results.means(in_a_table(failed))["error"].item())


@pytest.mark.parametrize("scene", [*REGULAR, CHATTER_SCENE, GRAZING], ids=lambda scene: scene.name)
def test_the_truth_of_a_scene(scene):
    """All impacts found, as many for every neighbour, none near the section."""
    truth = scene.truth()
    assert (truth["status"] == Status.CERTIFIED).all()
    assert len(set(truth["impacts_per_period"])) == (2 if scene is GRAZING else 1)
    phases = truth["impact_phase"][np.isfinite(truth["impact_phase"])]
    away = (phases - scene.phase + math.pi) % (2 * math.pi) - math.pi
    assert np.abs(away).min() > 0.1
    assert (truth["rest_fraction"] > 0.0).all() == (scene is CHATTER_SCENE)
    assert set(scene.errors(truth, truth).values()) == {0.0}


def test_errors_of_known_size():
    """A run equal to the truth except for known shifts, with impacts in another order."""
    truth = ONE_IMPACT.truth()
    n, per_V = len(ONE_IMPACT.points), np.sqrt(np.mean(truth["impact_v"] ** -2.0))
    late = np.full((n, 3), np.nan)
    late[:, 0], late[:, 1] = truth["impact_phase"][:, 0] + 3.0, truth["impact_phase"][:, 0] - 0.1
    speeds = np.stack([np.full(n, 9.0), truth["impact_v"][:, 0] + 0.2, np.full(n, np.nan)], axis=1)
    found = {
        "poincare_x": truth["poincare_x"],
        "poincare_v": truth["poincare_v"] - 0.3,
        "impact_phase": late % (2 * math.pi),
        "impact_v": speeds,
        "max_penetration": np.full(n, 0.4) / ONE_IMPACT.points["omega"],
    }
    errors = ONE_IMPACT.errors(truth, found)
    assert errors == pytest.approx(
        {STATE: 0.3 * per_V, TIME: 0.1 / (2 * math.pi), SPEED: 0.2 * per_V, DEPTH: 0.4 * per_V}
    )
    nothing = np.full((n, 3), np.nan)
    errors = ONE_IMPACT.errors(truth, found | {"impact_phase": nothing, "impact_v": nothing})
    assert errors[TIME] == 0.5 and errors[SPEED] == pytest.approx(1.0)


def test_states_on_the_two_sides_of_an_impact_are_near():
    """The section at an impact: the velocity jumps there, the error does not."""
    truth, (R,) = ONE_IMPACT.truth(), set(ONE_IMPACT.points["R"])
    v = truth["impact_v"][:, :1]
    before = truth | {"poincare_x": 0.0 * v, "poincare_v": v}
    after = truth | {"poincare_x": 0.0 * v, "poincare_v": -R * v}
    assert ONE_IMPACT.errors(before, after)[STATE] < 1e-15
    assert ONE_IMPACT.errors(before, before | {"poincare_v": 0.9 * v})[STATE] > 0.09


SWEEP = {
    "name": "a sweep",
    "oscillator": {"h": 0.05, "R": 0.7, "omega": {"start": 1.0, "stop": 3.4, "num": 200}, "f": 1.0},
    "record": {"transient": 50, "periods": 10, "phase": 1.0},
}


def test_the_points_of_a_sweep_are_on_their_motions():
    """Where the motion is periodic, a forcing period leads from the start to itself."""
    sweep = SWEEP | {"oscillator": SWEEP["oscillator"] | {"omega": [2.2, 2.3, 2.4]}}
    scene = of_sweep(load_config(sweep | {"record": {"transient": 500, "phase": 1.0}}))
    truth = scene.truth()
    np.testing.assert_allclose(truth["poincare_x"][:, 0], scene.points["x0"], atol=1e-9)
    assert (truth["impacts_per_period"] == 1.0).all()
    errors = [scene.errors(truth, scene.run(CUBIC, steps))[STATE] for steps in (100, 200)]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.3)


def test_a_sweep_without_impacts_has_no_errors_of_them():
    free = SWEEP | {"oscillator": SWEEP["oscillator"] | {"clearance": 10.0}}
    scene = of_sweep(load_config(free))
    assert set(scene.errors(scene.truth(), scene.run(PLAIN, 50))) == {STATE, DEPTH}


def test_the_points_are_spread_over_the_grid():
    fixed = dict.fromkeys(("f", "p", "clearance", "a", "x0", "v0", "phase"), 0.0)
    axes = {"h": np.arange(5.0), "omega": np.arange(1.0, 401.0), "R": np.arange(4.0)}
    points = Grid(axes, fixed).spread(64)
    assert 60 < len(points) <= 64 and len(np.unique(points)) == len(points)
    assert points["omega"].min() < 10.0 and points["omega"].max() > 390.0
    for name, values in axes.items():
        counts, _ = np.histogram(points[name], bins=4)
        assert np.isin(points[name], values).all() and counts.min() >= 8
    everything = Grid(axes, fixed).spread(10**6)
    np.testing.assert_array_equal(everything, Grid(axes, fixed).points((slice(None),) * 3))
    assert len(Grid({}, fixed | {"h": 0.0, "R": 0.0, "omega": 1.0}).spread(64)) == 1


def test_a_failed_method_is_run_once(monkeypatch):
    """Such a measurement might never end."""
    calls = []
    failed = {STATE: math.nan}
    monkeypatch.setattr(accuracy.Scene, "errors", lambda *_: calls.append(1) or failed)
    plan = Plan(ladder=(50,), rounds=3, scenes=(ONE_IMPACT,), methods=(PLAIN,), peers=())
    found = measure_methods(plan)
    assert math.isnan(found["error"].item()) and len(calls) == 1


@pytest.mark.slow
@pytest.mark.parametrize("name", PEERS)
def test_a_peer_meets_the_truth(name):
    if not installed(name):
        pytest.skip(f"{name} is not installed")
    scene = replace(ONE_IMPACT, points=ONE_IMPACT.points[::32], periods=4)
    truth = scene.truth()
    coarse, fine = (run_peer(name, scene.points, 4, 0.0, tolerance) for tolerance in (1e-3, 1e-9))
    errors = [scene.errors(truth, found) for found, _ in (coarse, fine)]
    for kind in (STATE, TIME, SPEED):
        assert errors[1][kind] < 1e-7 < 1e-2
        assert errors[1][kind] < 0.01 * errors[0][kind]
    assert coarse[1] > 0.0


def test_a_peer_that_is_not_installed_is_left_out(monkeypatch):
    monkeypatch.setitem(PEERS, "absent", ("not_there", None))
    plan = Plan(ladder=(50,), rounds=1, scenes=(ONE_IMPACT,), methods=(PLAIN,), peers=("absent",))
    assert set(measure_methods(plan)["impact"]) == {"plain"}


@pytest.mark.slow
def test_the_command(monkeypatch, unpainted):
    """All methods and scenes on a short ladder, each run once: picture, rows and tables."""
    monkeypatch.setattr(accuracy, "_LEAST_WORK", 1)
    monkeypatch.setattr("sweeps.bench.peers._LEAST_SECONDS", 1e-9)
    peer = {"tolerances": (1e-9,), "thinning": 64, "peers": ("SciPy DOP853",)}
    plan = Plan(ladder=(50, 100, 200), rounds=1, **peer)
    monkeypatch.setattr(accuracy, "QUICK", plan)
    options = ("--quick", "-o", "chart.png", "--csv", "all.csv", "--threads", 1)
    result = call("bench", "accuracy-speed", *options)
    assert result.exit_code == 0, result.output
    assert Path("chart.png").read_bytes() == b"painted"
    assert result.stdout.splitlines()[-2:] == ["chart.png", "all.csv"]
    for word in ("semi-implicit-euler", "reduced-step", "SciPy DOP853", "ns/period", "1e-12"):
        assert word in result.stdout
    rows = pd.read_csv("all.csv")
    assert list(rows) == [*MEASURED_COLUMNS, "measured_order"]
    methods = set(rows[["integrator", "impact"]].itertuples(index=False, name=None))
    assert methods == {*METHODS, ("SciPy DOP853", "events")}
    assert set(rows["scene"]) == {*(s.name for s in accuracy.SCENES), MEAN}
    row = rows.set_index(MEASURED_COLUMNS[:5]).sort_index().loc[(MEAN, STATE, *CUBIC, 200)]
    assert row["error"] < 1e-6 and row["seconds_per_period"] > 0.0
    assert row["measured_order"] == pytest.approx(4.0, abs=0.3) and math.isnan(row["tolerance"])


@pytest.mark.slow
def test_the_command_on_few_measurements(monkeypatch):
    """A peer may be missing, and a required error may be reached by no method."""
    rows = [made(1e-2, 1.0), made(1e-3, 2.0, 200), made(1e-4, 4.0, 400), made(math.nan, 0.1, 25)]
    few = in_a_table(rows)
    monkeypatch.setattr(accuracy, "measure_methods", lambda *_, **__: few)
    monkeypatch.setitem(PEERS, "heyoka", ("not_there", None))
    result = call("bench", "accuracy-speed", "-o", "chart.svg")
    assert result.exit_code == 0, result.output
    assert "heyoka is not installed, so it is not on the chart" in result.stderr
    targets = [line.split() for line in result.stdout.splitlines()]
    for cheapest in (["0.01", *PLAIN, "100"], ["0.0001", *PLAIN, "400"]):
        assert cheapest in [words[:4] for words in targets]
    assert ["1e-12", "none"] in targets


@pytest.mark.slow
def test_the_command_on_a_sweep(monkeypatch):
    """Also with a name that a formula would be read in, and steps that `exact` needs."""
    monkeypatch.setattr(accuracy, "_LEAST_WORK", 1)
    sweep = SWEEP | {"name": "a $x^2$ sweep", "output": "a.h5"}
    sweep["oscillator"] = sweep["oscillator"] | {"omega": {"start": 0.05, "stop": 3.4, "num": 9}}
    Path("sweep.yaml").write_text(yaml.safe_dump(sweep))
    monkeypatch.setattr(accuracy, "QUICK", replace(accuracy.QUICK, ladder=(50, 100), rounds=1))
    options = ("sweep.yaml", "--quick", "-o", "chart.png", "--csv", "all.csv")
    result = call("bench", "accuracy-speed", *options)
    assert result.exit_code == 0, result.output
    assert "9 points of the sweep a $x^2$ sweep" in result.stdout and "SciPy" not in result.output
    assert Path("chart.png").read_bytes().startswith(b"\x89PNG")
    rows = pd.read_csv("all.csv")
    assert set(rows["scene"]) == {"sweep a $x^2$ sweep"}
    exact = rows[(rows["impact"] == "exact") & (rows["error_kind"] == STATE)]
    assert exact["steps_per_period"].item() > 100 and exact["error"].item() < 1e-10
    assert f"with {exact['steps_per_period'].item()} steps per period" in result.stdout
