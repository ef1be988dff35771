"""Transients that are found: `record: {transient: auto}`."""

from dataclasses import replace

import numpy as np
import pytest

from sweeps.engine.executors import compute
from sweeps.opened.opened_sweep import OpenedSweep
from tests.helpers.configurations import load, refusal
from tests.helpers.sweep_files import swept
from vibroimpact import Oscillator, integrate
from vibroimpact.destination.repetition import TOLERANCE
from vibroimpact.points.computation import compute_points
from vibroimpact.status import Status

CONFIG = """
oscillator: {h: [0.01, 0.05], R: 0.8, omega: {start: 2.4, stop: 3.5, num: 40}, f: 1.0}
record: {transient: auto, longest: 3000, periods: 20, impacts: 4, phase: 1.0}
"""


@pytest.mark.slow
def test_every_motion_with_a_class_is_on_its_orbit(dataset):
    periodic = dataset["period"].values > 0
    assert 0.3 < periodic.mean() < 1.0
    short = periodic & (dataset["transient"].values < 3000)
    assert (dataset["orbit_distance"].values[short] < 1e-12).all()
    assert len(np.unique(dataset["transient"])) > 5
    # A rest may show in a stage that it repeats, and not in a shorter record.
    assert (dataset["transient"].values[dataset["period"].values == 0] == 3000).mean() > 0.9
    assert dataset["transient"].max() == 3000


def test_a_run_with_the_transient_that_was_found_has_the_same_bits(dataset):
    steps = OpenedSweep(dataset).config.method.steps_per_period
    flat = dataset.stack(point=("h", "omega")).isel(point=slice(0, None, 9))
    for i in range(flat.sizes["point"]):
        point = flat.isel(point=i)
        transient = int(point["transient"])
        osc = Oscillator(h=float(point["h"]), R=0.8, omega=float(point["omega"]), f=1.0)
        options = {"steps_per_period": steps, "transient": transient, "periods": 20}
        run = integrate(osc.at(), **options, phase=1.0, impacts=4)
        for name in ("poincare_x", "poincare_v", "impact_phase", "impact_v"):
            np.testing.assert_array_equal(run[name][0], point[name].values)


def test_a_transient_of_another_rule_ends_where_the_record_repeats():
    method = "method={integrator: newmark, impact: reduced-step}"
    dataset = swept(CONFIG, method, "oscillator.omega.num=8")
    periodic = dataset["period"].values > 0
    assert periodic.any()
    assert (dataset["orbit_distance"].values[periodic] <= TOLERANCE).all()
    assert (dataset["transient"].values[periodic] < 3000).any()


def test_a_motion_that_fails_is_not_continued():
    """Euler overflows at omega = 0.3, in a few periods; there is no result to wait for."""
    dataset = swept("""
oscillator: {h: 0.1, R: 0.8, omega: [3, 0.3], f: 1.0}
method: {integrator: euler, impact: plain, steps_per_period: 25, allow_unstable: true}
record: {transient: auto, longest: 3000, periods: 4}
""")
    assert dataset["status"].values.tolist() == [Status.COMPUTED, Status.NON_FINITE]
    assert dataset["transient"].values[1] < 200


def test_a_motion_that_fails_in_a_stage_has_no_result():
    """Without damping Euler overflows after 1,500 periods; a record from the start would not."""
    text = """
oscillator: {h: 0, R: 1, omega: 1.3, f: 1.0}
start: {x0: -1}
method: {integrator: euler, impact: plain, steps_per_period: 20, allow_unstable: true}
record: {transient: auto, longest: 3000, periods: 20, impacts: 4}
"""
    spec, points = load(text).sweep.spec, Oscillator(h=0, R=1, omega=1.3, f=1).at(-1.0)
    found = compute_points(spec, points, None)
    assert found["status"] == Status.NON_FINITE and found["period"] == 0
    for name in ("poincare_x", "impact_v", "impulse", "rest_fraction"):
        assert np.isnan(found[name]).all(), name
    assert found["impacts_per_period"].dtype == float and found["chatters"] == 0


def test_the_status_is_the_worst_of_all_stages():
    """With R near 1 and a preload a mass comes to rest in bounces too short to follow."""
    points = Oscillator(h=0.05, R=1.0, omega=1.0, f=1.0).at().repeat(60)
    rng = np.random.default_rng(1)
    points["R"], points["omega"] = rng.uniform(0.9991, 1.0, 60), rng.uniform(0.5, 3.0, 60)
    points["clearance"] = rng.uniform(-3.0, -0.3, 60)
    points["x0"] = points["clearance"] - 0.5
    spec = load(CONFIG, "record.phase=0", "record.longest=1000").sweep.spec
    spec = replace(spec, steps_per_period=60)
    found = compute_points(spec, points, None)
    assert len(np.unique(found["status"])) > 1
    for transient in np.unique(found["transient"]).tolist():
        rows = found["transient"] == transient
        how = {"impacts": 4, "steps_per_period": spec.steps_per_period}
        run = integrate(points[rows], transient=transient, periods=20, **how)
        for name in ("status", "poincare_x", "impact_v"):
            np.testing.assert_array_equal(found[name][rows], run[name], err_msg=name)


def test_blocks_and_threads_change_nothing(dataset):
    config = load(CONFIG)
    points = config.sweep.grid.points(tuple(slice(0, n) for n in config.sweep.grid.shape))
    for threads, order in ((1, slice(None)), (2, slice(None, None, -1))):
        results = compute(config.sweep.spec, points[order].copy(), threads)
        for name in ("transient", "poincare_x", "impact_v", "period", "orbit_distance"):
            expected = dataset[name].values.reshape(len(points), *dataset[name].shape[2:])
            np.testing.assert_array_equal(results[name][order], expected)


@pytest.mark.parametrize(
    ("record", "said"),
    [
        ("{transient: 10, longest: 5}", "record.longest: is only for transient: auto"),
        ("{transient: auto, diagnostics: []}", "auto needs the classes of motions"),
        ("{transient: auto, trajectory: {every: 1}}", "auto cannot be used with trajectory"),
        ("{transient: aut}", "is not an integer"),
        ("{transient: auto}\nfollow: {axis: omega, direction: up}", "auto cannot be used with fol"),
    ],
)
def test_what_does_not_go_together_is_refused(record, said):
    text = "oscillator: {h: 0.1, R: 0.8, omega: [1.0, 2.0], f: 1.0}\n"
    assert said in refusal(f"{text}record: {record}\n")
