"""A sweep in which each point starts from its neighbour: chains, requests, coexistence."""

import itertools
import math
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from sweeps import load_config, open_sweep, run_sweep
from sweeps.engine import estimate as limits
from sweeps.engine import executors, sweep_run
from sweeps.engine.estimate import block_size, expected_cost
from sweeps.engine.executors import compute, compute_block
from sweeps.errors import ConfigError, Failed, StoreError
from sweeps.grid import Cost
from sweeps.interrupts import this_thread
from sweeps.store.writer import SweepWriter
from sweeps.text import shown_duration
from tests.helpers.commands import call
from tests.helpers.configurations import load
from tests.helpers.interruptions import wait_until
from tests.helpers.oscillators import bifurcation
from tests.helpers.places import CONFIGS
from tests.helpers.sweep_files import data, run_and_read
from vibroimpact import Oscillator, Status, integrate
from vibroimpact.points import computation
from vibroimpact.step.recorder import trajectories
from vibroimpact.step.scheme import scheme_of

pytestmark = pytest.mark.slow


CONFIG = """\
oscillator: {h: 0.05, R: [0.8, 0.5, 0.6], omega: [2.7, 0.6, 2.4, 2.65, 1.3], f: 1.0,
             clearance: [0.0, 0.4]}
follow: {axis: omega, direction: both}
record: {transient: 7, periods: 6, impacts: 5, trajectory: {every: 6},
         diagnostics: [period, lyapunov]}
"""


def configured(*changes):
    return load(CONFIG, *changes)


def full_block(config):
    """Return the block of all points of a sweep, in both directions if it has them."""
    block = tuple(slice(0, n) for n in config.sweep.grid.shape)
    return (slice(0, 2), *block) if len(config.sweep.spec.directions) == 2 else block


def by_hand(config, point, axis, values):
    """Yield the results along one chain, each from a separate call."""
    record, method = config.record, config.method
    how = method.model_dump(include={"integrator", "impact", "steps_per_period"})
    how["phase"], state = record.phase, None
    for value in values:
        here = point.copy()
        here[axis] = value
        if state is not None:
            here["x0"], here["v0"] = min(state[0], float(here["clearance"][0])), state[1]
        whole = record.model_dump(include={"transient", "periods", "impacts"})
        found = integrate(here, lyapunov=True, at_section=state is not None, **whole, **how)
        if record.trajectory:
            short = {"transient": record.transient - 1, "periods": 1}
            before = integrate(here, at_section=state is not None, **short, **how)
            here["x0"], here["v0"] = before["poincare_x"][0], before["poincare_v"][0]
            here["phase"] = record.phase
            scheme = scheme_of(here, **how)
            every = record.trajectory.every
            found |= trajectories(here, scheme, record.periods, record.transient, every)
        state = found["poincare_x"][0, -1], found["poincare_v"][0, -1]
        yield value, found


@pytest.mark.parametrize(("axis", "phase"), [("omega", 1.3), ("R", 0), ("clearance", 1.3)])
def test_a_chain_is_what_calls_by_hand_give(axis, phase):
    """Bit for bit, in any order of the file; other axes and directions are independent."""
    config = configured(f"record.phase={phase}", f"follow.axis={axis}")
    dataset = run_and_read(config)
    assert dataset["poincare_x"].dims == ("direction", "R", "omega", "clearance", "section")
    others = [name for name in config.sweep.grid.axes if name != axis]
    for way in ("up", "down"):
        order = sorted(config.sweep.grid.axes[axis], reverse=way == "down")
        for corner in ((0, 0), (1, 1)):
            at = dict(zip(others, corner, strict=True))
            chain = dataset.sel(direction=way).isel(at)
            point = config.sweep.grid.points((slice(0, 1),) * 3)
            for name in others:
                point[name] = config.sweep.grid.axes[name][at[name]]
            for value, found in by_hand(config, point, axis, order):
                for name, expected in found.items():
                    given = chain[name].sel({axis: value}).values
                    if name.startswith("trajectory"):
                        assert np.isnan(given[len(expected[0]) :]).all()
                        given = given[: len(expected[0])]
                    np.testing.assert_array_equal(given, expected[0], err_msg=name)


@pytest.mark.parametrize("way", ["up", "down"])
def test_one_direction_has_no_dimension_and_is_that_of_both(dataset, way):
    both = dataset.sel(direction=way, drop=True).drop_attrs(deep=False)
    one = run_and_read(configured(f"follow.direction={way}"))
    assert "direction" not in one.coords
    xr.testing.assert_identical(one, both.assign_attrs(one.attrs))


def test_a_start_that_is_swept_starts_chains_of_its_own():
    record = "record.trajectory=false"
    both = run_and_read(configured("start.x0=[-1, -0.2]", record))["poincare_x"]
    for x0 in both["x0"].values:
        alone = run_and_read(configured(f"start.x0={x0}", record))["poincare_x"]
        np.testing.assert_array_equal(both.sel(x0=x0).transpose(*alone.dims), alone)


def test_a_stop_that_moves_past_the_mass_takes_it_along():
    """At rest under a steady push (f = 0 and a stop below x = 0) the mass lies on each stop."""
    config = configured(
        "oscillator={h: 0.5, R: 0.3, omega: 1, f: 0, clearance: [-0.1, -0.2, -0.3]}",
        "start.x0=-0.4",
        "follow={axis: clearance, direction: down}",
        "record={transient: 0, periods: 4, trajectory: {every: 1}}",
    )
    dataset = run_and_read(config)
    assert dataset["impacts_per_period"].sel(clearance=-0.1) > 0  # it falls onto the first
    for clearance in (-0.2, -0.3):
        here = dataset.sel(clearance=clearance)
        x, v = (here[name].dropna("sample") for name in ("trajectory_x", "trajectory_v"))
        assert (x == clearance).all() and (v == 0.0).all()
        assert here["rest_fraction"] == 1.0 and here["max_penetration"] == 0.0


@pytest.mark.parametrize("status", [Status.UNRESOLVED, Status.NON_FINITE, Status.COMPUTED])
def test_only_the_chain_that_failed_begins_anew(monkeypatch, status):
    """The kernel receives the state before or, after a failure or NaN, the start."""
    config = configured("start.x0=-1", "follow.direction=up", "oscillator.clearance=0")
    calls = []

    def run(_, points, *__):
        calls.append(points[["R", "omega", "x0", "v0", "phase"]].tolist())
        fails = (points["R"] == 0.5) & (points["omega"] == 1.3)
        x = np.where(fails & (status == Status.COMPUTED), math.nan, -points["omega"])
        outcome = np.where(fails, status, Status.COMPUTED).astype(np.int8)
        v = np.stack([x, points["R"]], axis=1)
        return {"poincare_x": np.stack([x + 9.0, x], axis=1), "poincare_v": v, "status": outcome}

    counted = []
    box = config.sweep.grid.points().reshape(config.sweep.grid.shape)
    followed = {"followed": "omega", "directions": ("up",), "phase": 1.5, "period": False}
    monkeypatch.setattr(computation, "_run", run)
    spec = replace(config.sweep.spec, **followed)
    results = computation.compute_chains(spec, box, 1, None, counted.append)
    assert counted == [3] * 5
    assert calls[0] == [(R, 0.6, -1.0, 0.0, 0.0) for R in (0.5, 0.6, 0.8)]
    assert calls[1] == [(R, 1.3, -0.6, R, 1.5) for R in (0.5, 0.6, 0.8)]
    again = [(R, 2.4, -1.3, R, 1.5) for R in (0.6, 0.8)]
    assert calls[2] == [(0.5, 2.4, -1.0, 0.0, 0.0), *again]
    assert calls[3] == [(R, 2.65, -2.4, R, 1.5) for R in (0.5, 0.6, 0.8)]
    found = results["poincare_v"].reshape(3, 5, 2)[:, :, 1]
    np.testing.assert_array_equal(found, np.broadcast_to([[0.5], [0.6], [0.8]], (3, 5)))


@pytest.mark.parametrize(
    ("follow", "message"),
    [
        ("{axis: omgea}", r"line 2: follow\.axis = omgea is unknown \(did you mean omega\?\)"
         r"; expected: .* a swept parameter out of h, R, omega, f, p, clearance"),
        ("{axis: x0}", r"line 2: follow\.axis = x0 is a start, but only the first point starts "
         r"there; expected: .* h, R, omega, f, p, clearance"),
        ("{axis: h}", r"line 2: follow\.axis: h has only one value, so that there is nothing to "
         r"follow; expected: a swept axis out of R, omega$"),
        ("{direction: up}", r"line 2: follow\.axis is missing; expected: axis along which"),
        ("{axis: omega, direction: upp}", r"line 2: follow\.direction = upp is unknown "
         r"\(did you mean up\?\); expected: .*: up, down, both"),
        ("{axis: omega, directoin: up}", r"line 2: unknown key follow\.directoin \(did you mean "
         r"direction\?\); expected: a mapping with keys among axis, direction"),
        ("omega", r"line 2: follow = omega is not allowed; expected: .* a mapping with keys among "
         r"axis, direction, or null"),
        ("{axis: [omega]}", r"line 2: follow\.axis = \[omega\] is not allowed"),
    ],
)  # fmt: skip
def test_bad_input(follow, message):
    lines = "oscillator: {h: 0.1, R: [0.8, 0.7], omega: {start: 1, stop: 2, num: 5}, f: [1]}\n"
    with pytest.raises(ConfigError, match=message):
        load(f"{lines}follow: {follow}\n")
    with pytest.raises(ConfigError, match="expected: an axis that is swept"):
        load("oscillator: {h: 0.1, R: 0.8, omega: 1, f: 1}\nfollow: {axis: omega}\n")


@pytest.fixture(scope="module")
def hysteresis(tmp_path_factory):
    """Return the sweep of the scene."""
    path = tmp_path_factory.mktemp("scene") / "hysteresis.h5"
    run_sweep(load_config(CONFIGS / "hysteresis.yaml", ["oscillator.omega.num=401"]), path)
    return data(path)


def test_the_scene_shows_hysteresis_between_grazes_and_folds(hysteresis):
    """The free amplitude f / sqrt D is the clearance at a graze; folds are in closed form."""
    osc = Oscillator(h=0.05, R=0.8, omega=1.0, f=1.0, clearance=1.5)
    # (1 - w^2)^2 + 4 h^2 w^2 = (f / clearance)^2, quadratic in w^2.
    middle, product = 1.0 - 2.0 * osc.h**2, 1.0 - (osc.f / osc.clearance) ** 2
    reach = math.sqrt(middle**2 - product)
    graze = math.sqrt(middle - reach), math.sqrt(middle + reach)
    fold = [bifurcation(osc, "fold", "omega", *ends) for ends in ((0.5, 0.55), (1.6, 1.7))]
    omega = hysteresis["omega"].values
    met = hysteresis["impacts_per_period"] > 0
    up, down = met.sel(direction="up").values, met.sel(direction="down").values
    step = omega[1] - omega[0]
    # Just before its graze, the step along the axis disturbs the free motion into impacts.
    for hit, low, high in ((up, graze[0], fold[1]), (down, fold[0], graze[1])):
        inside = omega[hit]
        assert (np.flatnonzero(hit) == np.arange(hit.argmax(), hit.argmax() + hit.sum())).all()
        assert inside.min() == pytest.approx(low, abs=1.5 * step)
        assert inside.max() == pytest.approx(high, abs=1.5 * step)
    assert [round(value, 4) for value in (*fold, *graze)] == [0.5251, 1.6504, 0.5795, 1.2861]
    assert (up != down).sum() == pytest.approx((1.6504 - 1.2861 + 0.5795 - 0.5251) / step, abs=4)


def test_an_interrupted_run_goes_on_to_the_same_data(stop_after, monkeypatch, capsys):
    """Whatever the blocks, the threads and the compression are."""
    expected, config = run_and_read(configured()), configured("compression=gzip")
    with stop_after(2, size=5), pytest.raises(KeyboardInterrupt):
        run_sweep(config, "stopped.h5", threads=2)
    with open_sweep("stopped.h5") as dataset:
        missing = (dataset["status"] == Status.PENDING).values
        assert missing.sum() == 4 * 2 * 5  # chains, directions, points
        assert (missing == missing[:1, :, :1]).all()  # no partial chain
    monkeypatch.setattr(sweep_run, "expected_cost", lambda *_: Cost(840.0, 100, 100, 5))
    run_sweep(config, "stopped.h5", resume=True, threads=1, progress=True)
    assert f"about {shown_duration(840.0 * missing.mean())}\n" in capsys.readouterr().err
    xr.testing.assert_identical(data("stopped.h5"), expected)
    with xr.open_dataset("stopped.h5", engine="h5netcdf") as dataset:  # as in another program
        assert dataset["direction"].values.tolist() == ["up", "down"]
        xr.testing.assert_equal(dataset.load(), expected)
    with pytest.raises(StoreError, match=r"follow\.direction was both and is up"):
        run_sweep(configured("follow.direction=up"), "stopped.h5", resume=True)
    with pytest.raises(StoreError, match=r"follow\.axis was omega and is not given"):
        run_sweep(configured("follow=null"), "stopped.h5", resume=True)


def test_points_are_counted_in_each_direction():
    configured()
    printed = call("run", "sweep.yaml", "--dry-run").stdout
    assert "follow            omega, up and down\n" in printed
    assert "points            60\n" in printed and "forcing periods   780\n" in printed
    result = call("run", "sweep.yaml", "-o", "out.h5")
    assert result.stdout.startswith("out.h5: 60 points")
    assert "60/60 points" in result.stderr
    shown = call("info", "out.h5").stdout
    assert "direction = up, down\n" in shown
    assert "status (direction: 2, R: 3, omega: 5, clearance: 2)" in shown


def test_the_points_of_a_long_block_are_told_as_they_come():
    config = configured()
    told = []
    results = compute_block(config.sweep, full_block(config), None, told.append)
    assert told == [12] * 5 and len(results["status"]) == 60
    alone, told = configured("follow=null"), []
    results = compute_block(alone.sweep, full_block(alone), None, told.append)
    assert told == [30]
    expected = compute(alone.sweep.spec, alone.sweep.grid.points(), None)
    np.testing.assert_array_equal(results["poincare_x"], expected["poincare_x"])


def test_a_run_that_was_left_computes_no_further_in_its_block(monkeypatch):
    begun = threading.Semaphore(0)
    numbers = itertools.count(1)

    def computing(sweep, block, threads, advance):
        def told(points):
            begun.release()
            if next(numbers) >= 6:  # until the run is abandoned
                wait_until(lambda: this_thread.flag[0], "the end of the run")

        return compute_block(sweep, block, threads, told)

    def full(self, block, results):
        for _ in range(6):  # the 5 values of the first block, and one of the second
            assert begun.acquire(timeout=300)
        raise Failed("the disk is full")

    monkeypatch.setattr("sweeps.engine.estimate.block_size", lambda *_, **__: 5)
    monkeypatch.setattr(executors, "compute_block", computing)
    monkeypatch.setattr(SweepWriter, "write", full)
    with pytest.raises(Failed, match="full"):
        run_sweep(configured(), "out.h5")
    assert not begun.acquire(blocking=False)


def test_a_block_holds_whole_chains(monkeypatch):
    long = "oscillator.omega={start: 1, stop: 2, num: 3000}"
    many = configured(long, "oscillator.R={start: 0.5, stop: 0.8, num: 100}")
    for memory in (10**11, 10**9):
        monkeypatch.setattr(limits, "available_memory", lambda memory=memory: memory)
        size = block_size(many.sweep)
        assert size % 3000 == 0
        cost = expected_cost(many.sweep, Path("out.h5"), executors.LocalComputer(), False)
        assert cost.memory <= memory
        for block in many.sweep.grid.blocks(size, unsplit="omega"):
            assert block[1] == slice(0, 3000)
    monkeypatch.setattr(limits, "available_memory", lambda: 10**7)
    told = r"one chain of 3,000 points, followed up and down along omega, takes about .* of memory"
    with pytest.raises(StoreError, match=told):
        run_sweep(many, "out.h5")
    assert not Path("out.h5").exists()
