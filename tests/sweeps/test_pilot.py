"""The method that is chosen by an asked accuracy: that it is reached, recorded and run again."""

from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml

from commands import call
from sweep_files import load
from sweeps import load_config, open_sweep
from sweeps.bench import costs
from sweeps.config.schema import MethodConfig
from sweeps.engine.method_error import ExactSample
from sweeps.engine.pilot import (
    COSTS,
    MAX_RELATIVE_COST,
    SAFETY_FACTOR,
    SAMPLE_SIZE,
    choose,
)
from sweeps.errors import ConfigError
from sweeps.grid import Grid

# The motion rests in every period; meets the stop never; and has flips, chaos and windows.
SCENES = {
    "rest": "oscillator: {h: 0.1, R: 0.5, omega: {start: 0.5, stop: 0.6, num: 400}, f: 1}\n",
    "free": "oscillator: {h: 0.1, R: 0.5, omega: {start: 2.0, stop: 2.1, num: 400}, f: 1, "
    "clearance: 1}\n",
    "chaos": "oscillator: {h: 0.05, R: 0.8, omega: {start: 2.4, stop: 3.5, num: 400}, f: 1}\n",
}
RECORD = "record: {transient: 20, periods: 5, impacts: 4}\n"


def configured(scene, accuracy, *overrides):
    """Load a scene with an accuracy."""
    scene = SCENES.get(scene, scene) + f"method: {{accuracy: {accuracy}}}\n" + RECORD
    return load(scene, *overrides, path="scene.yaml")


# The choice


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("accuracy", [1e-2, 1e-4, 1e-8])
def test_the_asked_accuracy_is_reached_at_points_that_were_not_in_the_pilot(scene, accuracy):
    """Against the exact engine on steps three times finer, so that it does not judge itself."""
    config = configured(scene, accuracy)
    method = choose(config).method
    finer = MethodConfig(steps_per_period=3 * config.steps)
    points = np.setdiff1d(config.grid.points((slice(0, 400),)), config.grid.spread(SAMPLE_SIZE))
    reference = ExactSample(config.with_method(finer), points)
    errors, _ = reference.errors((method.integrator, method.impact), method.steps_per_period)
    assert reference.judged[:, 0].all() and errors.max() > 0.0
    assert errors.max() <= accuracy


@pytest.mark.slow
def test_the_choice_is_the_cheapest_that_was_found_to_reach_it():
    for accuracy in (1e-2, 1e-4):
        pilot = choose(configured("rest", accuracy))
        record = yaml.safe_load(pilot.record)
        cheaper = [
            candidate
            for candidate in record["candidates"]
            if candidate["error"] <= accuracy / SAFETY_FACTOR
            and candidate["cost"] < MAX_RELATIVE_COST
        ]
        exact = {"integrator": "exact", "impact": "exact"}
        best = min(cheaper, key=lambda candidate: candidate["cost"], default=exact)
        chosen = record["chosen"]
        assert {name: chosen[name] for name in best if name in chosen}.items() <= best.items()
        assert record["chosen"] == pilot.method.model_dump(exclude={"accuracy", "allow_unstable"})


def test_a_motion_without_impacts_needs_no_rule_for_them():
    """The exact flow has no error with any rule: the integrator alone is sure."""
    assert choose(configured("free", 1e-12)).method.integrator == "exact"


@pytest.mark.parametrize(
    ("scene", "accuracy", "overrides", "reason"),
    [
        ("free", 1e-2, ["record.diagnostics=[lyapunov]"], "lyapunov needs the exact engine"),
        ("rest", 1e-10, [], "no other has an error <= 1e-10 / 3"),
        ("rest", 1e-2, ["oscillator.p=0.1", "oscillator.f=1e308"], "resolves none of the 64"),
    ],
)
def test_where_it_is_the_only_one_the_exact_engine_is_taken(scene, accuracy, overrides, reason):
    config = configured(scene, accuracy, *overrides)
    pilot = choose(config)
    assert (pilot.method.integrator, pilot.method.impact) == ("exact", "exact")
    assert pilot.method.steps_per_period == config.steps
    assert reason in pilot.summary and reason in yaml.safe_load(pilot.record)["reason"]


@pytest.mark.slow
def test_the_choice_is_the_same_in_every_run_and_on_any_number_of_threads():
    config = configured("rest", 1e-4)
    first = choose(config)
    assert choose(config, threads=1) == first
    assert choose(configured("rest", 1e-4)) == first


def test_a_scaled_motion_has_the_same_errors():
    """With the stop at the rest position the motion scales with f; by 2^20 to the bit."""
    assert choose(configured("rest", 1e-2, "oscillator.f=1048576")) == choose(
        configured("rest", 1e-2)
    )


def test_no_method_is_chosen_whose_trajectory_is_too_long():
    config = configured("rest", 1e-2, "record.periods=100000", "record.trajectory={every: 1}")
    steps = choose(config).method.steps_per_period
    assert 100_000 * steps < 10_000_000
    assert choose(configured("rest", 1e-2)).method.steps_per_period > 100


# The error


def point_scene(**values):
    """Return a sweep of one point."""
    given = {"h": 0.1, "R": 0.5, "omega": 2.0, "f": 1.0} | values
    return f"oscillator: {{{', '.join(f'{name}: {value}' for name, value in given.items())}}}\n"


def test_chaos_is_judged_until_neighbours_have_parted():
    """h = 0, R = 0.8, omega = 2.8: rounding has grown 1e4 times in 11 periods, 1e10 in 54."""
    long = "record.periods=100"
    chaos = ExactSample(*sample(configured(point_scene(h=0, R=0.8, omega=2.8), 1e-2, long)))
    assert 4 <= chaos.judged.any(axis=2).sum() <= 20
    assert chaos.judged[0, :4].all()  # from the start on, and without a gap
    assert np.diff(chaos.judged.ravel().astype(int)).max() == 0
    calm = ExactSample(*sample(configured(point_scene(h=0.05, R=0.7, omega=2.3), 1e-2, long)))
    assert calm.judged.all()


def sample(config):
    """Return a configuration and the points of its pilot."""
    return config, config.grid.spread(SAMPLE_SIZE)


def test_states_on_the_two_sides_of_an_impact_are_near():
    """The section at the phase of an impact: the velocity jumps there, the error does not.

    h = 0.05, omega = 2.3, R = 0.7 has its impact at omega t = 1.05851979, v = 1.17575975.
    """
    config = configured(
        point_scene(h=0.05, R=0.7, omega=2.3),
        1e-2,
        "record.phase=1.05851979",
        "record.transient=60",
    )
    reference = ExactSample(*sample(config))
    sections = reference._sections.copy()
    scale = np.abs(sections).max(axis=(1, 2))[0]
    x, v = sections[0, -1, 0]
    assert abs(x) < 1e-6 and min(abs(v - 1.1757597511), abs(v + 0.7 * 1.1757597511)) < 1e-3
    other = -0.7 * v if v > 0.0 else v / -0.7
    for near in (1e-4, 1e-3):
        sections[0, -1, 0] = [-near * scale[0], other]
        assert reference._distance(sections)[0, -1, 0] == pytest.approx(near, rel=0.05)
    sections[0, -1, 0] = [-0.3 * scale[0], other]  # far from the stop it is another state
    assert reference._distance(sections)[0, -1, 0] > 0.29


def test_a_method_that_fails_has_an_infinite_error():
    config = configured("rest", 1e-2, "oscillator.p=30")  # far beyond the stability of rk4
    reference = ExactSample(*sample(config))
    errors, _ = reference.errors(("rk4", "cubic"), 12)
    assert (errors > 1e3).all()


# The sample


def test_the_sample_is_spread_over_the_grid():
    fixed = dict.fromkeys(("f", "p", "clearance", "x0", "v0"), 0.0)
    axes = {"h": np.arange(5.0), "omega": np.arange(1.0, 401.0), "R": np.arange(4.0)}
    points = Grid(axes, fixed).spread(64)
    assert 60 < len(points) <= 64 and len(np.unique(points)) == len(points)
    assert {points["omega"].min(), points["omega"].max()} == {1.0, 400.0}
    for name, values in axes.items():
        counts, _ = np.histogram(points[name], bins=4)
        assert np.isin(points[name], values).all() and counts.min() >= 8
    everything = Grid(axes, fixed).spread(10**6)
    np.testing.assert_array_equal(everything, Grid(axes, fixed).points((slice(None),) * 3))
    assert len(Grid({}, fixed | {"h": 0.0, "R": 0.0, "omega": 1.0}).spread(64)) == 1


# The configuration


@pytest.mark.parametrize(
    ("method", "parts"),
    [
        ("{accuracy: 0}", ["line 2: method.accuracy = 0 is not allowed", ">= 1e-13 and < 1"]),
        ("{accuracy: 1}", ["method.accuracy = 1 is not allowed", ">= 1e-13 and < 1"]),
        ("{accuracy: 1e-14}", ["method.accuracy = 1e-14 is not allowed"]),
        ("{accuracy: .nan}", ["method.accuracy = .nan"]),
        ("{accuracy: high}", ["method.accuracy = high is not a number"]),
        ("{acuracy: 1e-6}", ["unknown key method.acuracy (did you mean accuracy?)"]),
        (
            "{accuracy: 1e-6, impact: exact}",
            ["line 2: method.impact: impact is for the engine to choose", "accuracy alone, or"],
        ),
        ("{integrator: rk4, accuracy: 1e-6}", ["method.integrator: integrator is for"]),
        ("{accuracy: 1e-6, steps_per_period: 9}", ["method.steps_per_period: steps_per_period is"]),
    ],
)
def test_what_is_refused(tmp_path, method, parts):
    path = tmp_path / "scene.yaml"
    path.write_text(SCENES["rest"] + f"method: {method}\n")
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert str(caught.value).count("\n") == 0
    for part in parts:
        assert part in str(caught.value)


def test_the_configuration_round_trips_before_and_after_the_choice():
    config = configured("rest", 1e-4)
    assert yaml.safe_load(config.to_yaml())["method"] == {"accuracy": 1e-4}
    Path("again.yaml").write_text(config.to_yaml())
    assert load_config("again.yaml").to_yaml() == config.to_yaml()
    assert configured("rest", "null").method.accuracy is None
    chosen = config.with_method(MethodConfig(integrator="rk4", impact="cubic"))
    assert (config.steps, chosen.steps) == (17, 100)  # 2 pi (1.2 / 0.5 + 1) / 1.31, the default
    method = {"integrator": "rk4", "impact": "cubic", "steps_per_period": 100}
    method["allow_unstable"] = False
    assert yaml.safe_load(chosen.to_yaml())["method"] == method
    assert list(chosen.grid.axes) == ["omega"] and chosen.output == config.output


# The run


@pytest.mark.slow
def test_the_file_keeps_the_pilot_and_a_configuration_that_gives_the_same_data():
    configured("rest", 1e-2)
    ran = call("run", "scene.yaml", "--set", "record.trajectory={every: 64}")
    assert ran.exit_code == 0
    (line,) = [line for line in ran.stderr.splitlines() if line.startswith("method: ")]
    with open_sweep("scene.h5") as dataset:
        record = yaml.safe_load(dataset.attrs["pilot"])
        assert record["accuracy"] == 1e-2 and record["points"] == SAMPLE_SIZE
        assert record["periods"] == 25 and 0.9 < record["judged"] <= 1.0
        assert line.endswith(record["reason"]) and f"{record['chosen']['impact']} impacts" in line
        configuration = yaml.safe_load(dataset.attrs["configuration"])
        assert configuration["method"] == record["chosen"] | {"allow_unstable": False}
    shown = call("info", "scene.h5").stdout
    assert "# pilot:\n#   accuracy: 0.01\n" in shown
    Path("again.yaml").write_text(shown.split("\n\n", 1)[1])
    again = call("run", "again.yaml", "-o", "again.h5")
    assert again.exit_code == 0 and "method: " not in again.stderr
    with h5py.File("scene.h5") as first, h5py.File("again.h5") as second:
        assert "pilot" not in second.attrs and len(first) > 10
        for name, data in first.items():
            if isinstance(data, h5py.Dataset):
                assert data[()].tobytes() == second[name][()].tobytes()


def test_quiet_is_quiet_and_a_dry_run_runs_no_pilot(monkeypatch):
    configured("free", 1e-2)
    quiet = call("run", "scene.yaml", "--quiet")
    assert (quiet.exit_code, quiet.output) == (0, "")
    monkeypatch.setattr("sweeps.engine.method_error.integrate", None)
    plan = call("run", "scene.yaml", "--dry-run", "-o", "b.h5")
    assert plan.exit_code == 0
    assert "the cheapest with an error <= 0.01, found by a pilot run" in plan.stdout
    assert "steps" not in plan.stdout and not Path("b.h5").exists()


# The costs


def test_the_costs_are_fitted_to_what_was_measured():
    """Times made of known costs give the costs back."""
    spent, impacts = {}, {}
    for method, (period, step, recorded_step, impact) in COSTS.items():
        for scene, count in zip(costs.SCENES, (0.0, 1.0, 3.0), strict=True):
            for steps in costs.STEPS:
                impacts[method, scene, steps] = count
                fixed = period + count * impact
                spent[method, scene, steps, False] = steps * step + fixed
                spent[method, scene, steps, True] = steps * recorded_step + fixed
    for method, cost in COSTS.items():
        np.testing.assert_allclose(costs._fitted(method, spent, impacts), cost, rtol=1e-9)


def test_every_method_is_measured():
    measured = costs.measure(count=32, periods=2, rounds=1)
    assert list(measured) == list(COSTS)
    assert np.isfinite(list(measured.values())).all()
