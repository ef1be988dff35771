"""The command line: exit codes, what goes to which stream, and what is created."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import time
import types
import unittest.mock
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

import sweeps
from commands import accepted, call, refused
from sweeps import interrupts
from sweeps.config.loading import load_config
from sweeps.engine import run as runner
from sweeps.engine.run import block_size
from sweeps.text import printable
from vibroimpact.status import Status
from vibroimpact.step.flight import LONGEST_STEP

CONFIG = """\
name: small
oscillator:
  h: 0.1
  R: 0.8
  omega: {start: 1.5, stop: 3.0, num: 5}
  f: 1.0
  clearance: [0.0, 0.1]
method: {steps_per_period: 20}
record: {transient: 3, periods: 4, impacts: 2}
"""
ROOT = Path(sweeps.__file__).parents[1]


def process(*arguments, **variables):
    """Run the command line in its own process, as a user does, with variables around it."""
    command = [sys.executable, "-m", "sweeps.cli", *arguments]
    environment = {"PYTHONPATH": str(ROOT), "PATH": "", **variables}
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=120)


# run


def test_run_info_and_plot():
    printed = accepted("run", "sweep.yaml", "--threads", 1)
    assert "small.h5: 10 points" in printed
    assert re.search(r" in \S+ s$", printed, re.MULTILINE)
    assert printed.splitlines()[-1] == "next: vibroimpact plot small.h5"
    with xr.open_dataset("small.h5", engine="h5netcdf") as dataset:
        assert dict(dataset["poincare_x"].sizes) == {"omega": 5, "clearance": 2, "section": 4}

    shown = accepted("info", "small.h5")
    assert re.search(r"name +small\n", shown)
    assert re.search(r"points +10 points, all certified: ", shown)
    assert "omega = 1.5 .. 3 [rad/time], 5 values" in shown
    assert "poincare_x (omega: 5, clearance: 2, section: 4)" in shown
    for part in ("vibroimpact_version", "numba_version", "duration", "integrator: exact"):
        assert part in shown

    assert accepted("plot", "small.h5") == "small.png\n"
    assert Path("small.png").read_bytes().startswith(b"\x89PNG")
    options = ("--kind", "bifurcation", "--axis", "omega", "--at", "clearance=0.1")
    assert accepted("plot", "small.h5", "-o", "b.pdf", *options, "--coordinate", "impact_v")
    assert Path("b.pdf").read_bytes().startswith(b"%PDF")


def test_the_configuration_of_a_file_runs_again():
    accepted("run", "sweep.yaml", "--quiet")
    again = accepted("info", "small.h5", "--config")
    assert again == sweeps.open_sweep("small.h5").attrs["configuration"]
    Path("again.yaml").write_text(again)
    accepted("run", "again.yaml", "-o", "again.h5", "--quiet")
    accepted("run", "small.h5", "-o", "other.h5", "--set", "oscillator.omega.start=2.0", "--quiet")
    first, second, other = map(sweeps.open_sweep, ("small.h5", "again.h5", "other.h5"))
    assert first.drop_attrs().identical(second.drop_attrs())
    np.testing.assert_array_equal(other["omega"], np.linspace(2.0, 3.0, 5))
    assert "small.h5 exists" in refused("run", "small.h5")
    assert "output            small.h5" in accepted("run", "small.h5", "--resume", "--dry-run")
    assert "--set oscillator.omga.start" in refused(
        "run", "small.h5", "--set", "oscillator.omga.start=2"
    )
    assert "exclude each other" in refused("info", "small.h5", "--config", "--bifurcations")


def test_units_are_names_only():
    """They change every label and attribute, and no number."""
    units = ("--set", "units={length: mm, time: s}", "-o", "named.h5")
    assert "omega = 1.5 .. 3 [rad/s], 5 values" in done("run", "small.yaml", *units, "--dry-run")
    done("run", "small.yaml", *units, "--quiet")
    done("run", "small.yaml", "--quiet")
    plain, labelled = map(sweeps.open_sweep, ("small.h5", "named.h5"))
    for name in plain.variables:
        np.testing.assert_array_equal(plain[name].values, labelled[name].values)
        expected = plain[name].attrs["units"].replace("length", "mm").replace("time", "s")
        assert labelled[name].attrs["units"] == expected
    assert labelled["f"].attrs["units"] == "mm/s^2"
    shown = done("info", "named.h5")
    assert "omega = 1.5 .. 3 [rad/s], 5 values" in shown
    assert "velocity at the section [mm/s]" in shown
    assert "units: {length: mm, time: s}" in done("info", "named.h5", "--config")
    assert "units" not in done("info", "small.h5", "--config")
    for kind in ("bifurcation", "trajectory"):
        at = ("--at", "omega=3", "--at", "clearance=0", "--periods", 1)
        done("plot", "named.h5", "-o", f"{kind}.svg", *(at if kind == "trajectory" else ()))
        text = Path(f"{kind}.svg").read_text()
        assert "mm" in text
        assert "length]" not in text
    for value in ("{length: 1mm}", "{length: ''}", "{length: $x$}", "{mass: kg}"):
        assert "units" in refused("run", "small.yaml", "--set", f"units={value}")


def test_init_writes_a_scene_to_begin_from():
    assert done("init") == "quickstart.yaml\nnext: vibroimpact run quickstart.yaml\n"
    assert Path("quickstart.yaml").read_text() == (ROOT / "configs/quickstart.yaml").read_text()
    done("run", "quickstart.yaml", "--dry-run")
    done("init", "hysteresis")
    assert Path("hysteresis.yaml").read_text().startswith("# Hysteresis at a stop")
    Path("cascade.yaml").write_text("mine")
    assert "cascade.yaml exists" in refused("init", "cascade")
    message = refused("init", "hysteresys")
    assert "did you mean hysteresis?" in message
    for path in (ROOT / "configs").glob("*.yaml"):
        assert path.stem in message
    for name in ("../configs/basins", "pictures", ""):
        assert "there is no scene" in refused("init", name)


def test_zoom_computes_and_draws_a_piece():
    accepted("run", "sweep.yaml", "--quiet")
    printed = accepted("zoom", "small.h5", "omega=2.25:2.5", "poincare_v=-1:1")
    assert printed.splitlines()[-1] == "small-omega-2.25-2.5.png"
    assert Path("small-omega-2.25-2.5.png").read_bytes().startswith(b"\x89PNG")
    accepted("zoom", "small.h5", "clearance=0.1:0.2", "omega=2:3", "-o", "two.h5")
    whole, piece, two = map(sweeps.open_sweep, ("small.h5", "small-omega-2.25-2.5.h5", "two.h5"))
    np.testing.assert_array_equal(piece["omega"], np.linspace(2.25, 2.5, 5))
    np.testing.assert_array_equal(two["clearance"], [0.1, 0.2])
    np.testing.assert_array_equal(two["omega"], np.linspace(2.0, 3.0, 5))
    point = {"omega": 2.25}  # which the grid of the whole has, too
    assert piece.sel(point).drop_attrs().identical(whole.sel(point).drop_attrs())


@pytest.mark.parametrize(
    ("pieces", "reason"),
    [
        (["omega=2:1"], "expected: NAME=LOW:HIGH"),
        (["omega=2"], "expected: NAME=LOW:HIGH"),
        (["omega=2:nan"], "expected: NAME=LOW:HIGH"),
        (["omgea=2:3"], "did you mean omega?"),
        (["h=0:1"], "expected: omega or clearance"),
        (["omega=-1:1"], "expected: forcing frequency"),
        (["poincare_x=0:1"], "at least one swept axis"),
        (["omega=2:3", "omega=2:4"], "each name once"),
        (["omega=2:3", "poincare_x=0:1", "poincare_v=0:1"], "at most one of"),
        (["omega=2:3", "-o", "no/folder.h5"], "does not exist"),
        (["omega=2:3", "-o", "small.h5"], "small.h5 exists"),
    ],
)
def test_a_zoom_that_cannot_be(pieces, reason):
    accepted("run", "sweep.yaml", "--quiet")
    assert reason in refused("zoom", "small.h5", *pieces)


def test_a_map_and_the_exact_orbits():
    accepted("run", "sweep.yaml", "--quiet", "--set", "record.diagnostics=[period]")
    assert accepted("plot", "small.h5", "--kind", "map") == "small.png\n"
    axes = ("--axis", "clearance", "--axis", "omega", "--quantity", "slowest_impact")
    assert accepted("plot", "small.h5", "-o", "map.svg", *axes) == "map.svg\n"
    assert b"forcing frequency" in Path("map.svg").read_bytes()
    assert accepted("plot", "small.h5", "--kind", "impacts", "--at", "omega=1.5") == "small.png\n"
    cut = ("--set", "oscillator.clearance=0", "--set", "record.transient=200")
    accepted("run", "sweep.yaml", "--quiet", "--overwrite", *cut)
    followed, *_, picture = accepted("plot", "small.h5", "--exact").splitlines()
    assert re.match(r"1/1: \d points follow the stable branch; largest deviation \d", followed)
    assert picture == "small.png"


def test_several_configurations_are_run_and_drawn_one_after_the_other(folder):
    (folder / "sub").mkdir()
    Path("other.yaml").write_text(CONFIG.replace("name: small", "name: other\noutput: sub/o.h5"))
    printed = accepted("run", "sweep.yaml", "other.yaml", "--set", "oscillator.h=0.3")
    outcomes = [line.split(" in ")[0] for line in printed.splitlines()]
    certified = "10 points, all certified: every impact found, none missed"
    assert outcomes[:2] == [f"small.h5: {certified}", f"sub/o.h5: {certified}"]
    assert outcomes[2:] == ["next: vibroimpact plot small.h5 sub/o.h5"]
    with (
        xr.open_dataset("small.h5", engine="h5netcdf") as first,
        xr.open_dataset("sub/o.h5", engine="h5netcdf") as second,
    ):
        xr.testing.assert_equal(first, second)
        assert (first.attrs["name"], second.attrs["name"]) == ("small", "other")
    assert accepted("plot", "small.h5", "sub/o.h5") == "small.png\nsub/o.png\n"
    assert Path("sub/o.png").stat().st_size > 10_000
    plans = accepted("run", "sweep.yaml", "other.yaml", "--overwrite", "--dry-run").split("\n\n")
    assert [plan.split()[1] for plan in plans] == ["small", "other"]


def test_several_are_refused_before_any_is_run_or_drawn():
    Path("other.yaml").write_text(CONFIG.replace("name: small", "name: other"))
    Path("wrong.yaml").write_text(CONFIG.replace("h: 0.1", "h: -1"))
    Path("same.yaml").write_text(CONFIG)
    assert "wrong.yaml, line 3" in refused("run", "sweep.yaml", "wrong.yaml")
    message = refused("run", "sweep.yaml", "other.yaml", "-o", "a.h5")
    assert "-o a.h5 is not allowed here: it is for a single file, and 2 are given" in message
    message = refused("run", "sweep.yaml", "same.yaml")
    assert "sweep.yaml and same.yaml would both write small.h5" in message
    accepted("run", "other.yaml", "--quiet")
    assert "other.h5 exists" in refused("run", "sweep.yaml", "other.yaml")
    assert "missing.h5 does not exist" in refused("plot", "other.h5", "missing.h5")
    assert "-o a.png is not allowed here" in refused("plot", "other.h5", "other.h5", "-o", "a.png")
    assert "other.h5 and other.h5 would both write" in refused("plot", "other.h5", "other.h5")
    assert "other.h5: h is not a swept axis" in refused("plot", "other.h5", "--axis", "h")


def test_the_configuration_in_info_can_be_run_again():
    accepted("run", "sweep.yaml", "--quiet", "--set", "oscillator.h=0.3")
    configuration = accepted("info", "small.h5").split("\n\n", 1)[1]
    Path("again.yaml").write_text(configuration)
    accepted("run", "again.yaml", "--quiet", "-o", "again.h5")
    with (
        xr.open_dataset("small.h5", engine="h5netcdf") as first,
        xr.open_dataset("again.h5", engine="h5netcdf") as second,
    ):
        assert float(second.poincare_x[0, 0, 0]) == float(first.poincare_x[0, 0, 0])
        xr.testing.assert_equal(first, second)


def test_quiet_prints_nothing():
    assert accepted("run", "sweep.yaml", "--quiet") == ""
    assert Path("small.h5").exists()


def test_overwrite_replaces_the_output():
    accepted("run", "sweep.yaml", "--quiet")
    accepted("run", "sweep.yaml", "--quiet", "--overwrite", "--set", "oscillator.omega.num=3")
    with xr.open_dataset("small.h5", engine="h5netcdf") as dataset:
        assert dataset.sizes["omega"] == 3


def test_output_option_wins_over_the_configuration():
    accepted("run", "sweep.yaml", "--quiet", "--set", "output=a.h5", "-o", "b.h5")
    assert Path("b.h5").exists() and not Path("a.h5").exists()


def test_dry_run_says_what_would_be_done_and_does_nothing(monkeypatch):
    monkeypatch.setitem(sys.modules, "sweeps.engine.run", None)
    printed = accepted("run", "sweep.yaml", "--dry-run", "--set", "record.trajectory={every: 2}")
    rows = [tuple(re.split(r"  +", line)) for line in printed.splitlines()]
    # Per point: 4 sections, 2 impacts, 4 * 20 / 2 + 1 samples, nine numbers and the status.
    size = 10 * (8 * (2 * 4 + 2 * 2 + 3 * 41 + 9) + 1)
    time, memory = dict(rows)["expected time"], dict(rows)["memory"]
    assert rows == [
        ("name", "small"),
        ("axis", "omega = 1.5 .. 3 [rad/time], 5 values"),
        ("axis", "clearance = 0 .. 0.1 [length], 2 values"),
        ("points", "10"),
        ("forcing periods", "70"),
        ("steps per period", "20"),
        ("steps", "1,400"),
        ("expected time", time),
        ("size of the file", f"{size / 1000:.3g} kB"),
        ("memory", memory),
        ("output", "small.h5"),
    ]
    assert re.fullmatch(r"about \d\S* s", time)
    assert re.fullmatch(r"about \d+ kB for the blocks in work", memory)
    assert [path.name for path in Path().iterdir()] == ["sweep.yaml"]


def test_every_start_says_what_it_takes():
    planned = accepted("run", "sweep.yaml", "--dry-run").splitlines()
    started = call("run", "sweep.yaml").stderr
    for line in planned:
        assert line in started or line.startswith("expected time")
    assert re.search(r"^expected time +about \d\S* s$", started, re.MULTILINE)


def test_dry_run_shows_the_steps_chosen_for_the_worst_point():
    printed = accepted("run", "sweep.yaml", "--dry-run", "--set", "method={}")
    steps = math.ceil(2 * math.pi * (1.2 / 1.5 + 1) / LONGEST_STEP)
    assert re.search(rf"steps per period +{steps}\n", printed)
    printed = accepted("run", "sweep.yaml", "--dry-run", "--set", "method={impact: plain}")
    assert re.search(r"steps per period +100\n", printed)


def test_no_unit_is_shown_where_there_is_none():
    printed = accepted("run", "sweep.yaml", "--dry-run", "--set", "oscillator.R=[0.5, 0.8]")
    assert "R = 0.5 .. 0.8, 2 values" in printed


def test_what_became_of_the_points_is_told(monkeypatch, folder):
    assert "10 points, all certified: every impact found, none missed in " in accepted(
        "run", "sweep.yaml"
    )
    compute = runner.compute_block

    def settled(*arguments):
        results = compute(*arguments)
        results["status"][:2] = [Status.SETTLED, Status.COMPUTED]
        return results

    monkeypatch.setattr(runner, "compute_block", settled)
    accepted("run", "sweep.yaml", "--quiet", "--overwrite")
    assert re.search(
        rf"points +10 points, of which 1 SETTLED \({Status.SETTLED.meaning}\)\n",
        accepted("info", "small.h5"),
    )
    monkeypatch.setattr(runner, "compute_block", compute)
    printed = accepted("run", "sweep.yaml", "--overwrite", "--set", "method={impact: plain}")
    assert "small.h5: 10 points in " in printed


def test_a_run_without_impacts_says_so():
    """Far from the stop; at the stop under a preload, the mass rests there without an impact."""
    said = "no impact in any record: no motion meets the stop"
    free = accepted("run", "sweep.yaml", "--set", "oscillator.clearance=50")
    assert said in free and said in accepted("info", "small.h5")
    pressed = ("--set", "oscillator.clearance=-50", "--set", "start.x0=-50", "--overwrite")
    assert said not in accepted("run", "sweep.yaml", *pressed)
    with h5py.File("small.h5") as file:
        assert (file["rest_fraction"][()] > 0.999).all()
    assert said not in accepted("run", "sweep.yaml", "--overwrite")


def test_an_unstable_step_is_refused_or_allowed_and_said():
    """Euler at p T = 0.84, where 0.2 is the limit; the other point is stable."""
    Path("unstable.yaml").write_text(
        "oscillator: {h: 0.1, R: 0.8, omega: [3, 0.3], f: 1.0}\n"
        "method: {integrator: euler, impact: plain, steps_per_period: 25}\n"
        "record: {transient: 3000, periods: 4}\n"
    )
    message = refused("run", "unstable.yaml")
    assert "line 2: method.steps_per_period: 25 are not enough for euler" in message
    assert "an integer from 105 to" in message and "allow_unstable" in message
    text = accepted("run", "unstable.yaml", "--set", "method.allow_unstable=true")
    assert "2 points, of which 1 NON_FINITE (the state overflowed: the step is unstable" in text
    accepted("run", "unstable.yaml", "--overwrite", "--set", "method.steps_per_period=105")


def test_diagnostics_are_computed_where_they_are_asked_for():
    with unittest.mock.patch("vibroimpact.points.computation.period_class") as period:
        accepted("run", "sweep.yaml", "--quiet")
    assert not period.called
    both = ("--set", "record.diagnostics=[period, lyapunov]", "--set", "record.transient=200")
    accepted("run", "sweep.yaml", "--quiet", "--overwrite", *both)
    with xr.open_dataset("small.h5", engine="h5netcdf") as dataset:
        assert dict(dataset["lyapunov"].sizes) == {"omega": 5, "clearance": 2, "exponent": 2}
        assert np.isfinite(dataset["lyapunov"].values).all()
        assert (dataset["period"].values[:, 0] == 1).any()
        assert (dataset["near_grazes"].values >= 0).all()
        slowest, speeds = dataset["slowest_impact"].values, dataset["impact_v"].values
        assert (slowest <= np.nanmin(speeds, axis=-1)).all()


def test_any_block_size_gives_the_same_data(monkeypatch):
    small = ("--set", "method={}", "--set", "record.diagnostics=[period, lyapunov]")
    accepted("run", "sweep.yaml", "--quiet", *small)
    monkeypatch.setattr("sweeps.engine.run.block_size", lambda _: 3)
    accepted("run", "sweep.yaml", "--quiet", *small, "-o", "blocks.h5")
    with (
        xr.open_dataset("small.h5", engine="h5netcdf") as first,
        xr.open_dataset("blocks.h5", engine="h5netcdf") as second,
    ):
        xr.testing.assert_equal(first, second)


@pytest.mark.parametrize(
    ("record", "points", "expected"),
    [
        ("{transient: 0, periods: 1, impacts: 0}", 100_000, 2016),
        ("{transient: 999, periods: 1, impacts: 0}", 1_000_000, 20000),  # 2e8 / (1000 * 10)
        ("{transient: 1e6, periods: 1}", 100_000, 64),
        ("{transient: 0, periods: 1e6}", 100_000, 64),  # 16 MB each, but full lanes
        ("{transient: 0, periods: 1e6, trajectory: {every: 10}}", 100_000, 1),
    ],
)
def test_a_block_is_done_in_about_a_second(monkeypatch, record, points, expected):
    monkeypatch.setattr("sweeps.engine.plan._available_memory", lambda: 20 * 10**9)
    method = "method={impact: plain, steps_per_period: 10}"
    num = f"oscillator.omega={{start: 1, stop: 2, num: {points}}}"
    config = load_config("sweep.yaml", [method, num, "oscillator.clearance=0", f"record={record}"])
    assert block_size(config) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (KeyboardInterrupt(), "interrupted; nothing is kept"),
        (OSError(28, "No space left on device"), "No space left on device; nothing is kept"),
        (MemoryError(), "MemoryError; nothing is kept"),
    ],
)
def test_a_run_that_ends_early_exits_with_1(monkeypatch, error, text):
    def run_sweep(*_, **__):
        raise error

    monkeypatch.setitem(
        sys.modules, "sweeps.engine.run", types.SimpleNamespace(run_sweep=run_sweep)
    )
    result = call("run", "sweep.yaml")
    assert result.exit_code == 1
    assert result.stderr.startswith("vibroimpact: error: ") and text in result.stderr
    assert result.stderr.count("\n") == 1


def test_an_interrupted_run_says_what_is_kept(monkeypatch):
    accepted("run", "sweep.yaml", "--quiet")

    def run_sweep(*_, **__):
        with h5py.File("small.h5", "r+") as file:
            file["status"][3:] = -1
        raise KeyboardInterrupt

    monkeypatch.setitem(
        sys.modules, "sweeps.engine.run", types.SimpleNamespace(run_sweep=run_sweep)
    )
    result = call("run", "sweep.yaml", "--overwrite")
    assert result.exit_code == 1
    assert "interrupted; 6 of 10 points kept in small.h5" in result.stderr


@pytest.mark.parametrize("command", ["info", "plot", "run", "schema", "zoom"])
def test_an_interrupted_command_exits_with_1(monkeypatch, command):
    accepted("run", "sweep.yaml", "--quiet")

    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("sweeps.store.open_sweep", interrupt)
    monkeypatch.setattr("sweeps.engine.configurations.read_config", interrupt)
    monkeypatch.setattr("sweeps.config.sweep.json_schema", interrupt)
    file = {
        "info": ["small.h5"],
        "plot": ["small.h5"],
        "run": ["sweep.yaml"],
        "schema": [],
        "zoom": ["small.h5", "omega=2:3"],
    }
    result = call(command, *file[command])
    assert result.exit_code == 1
    assert result.stderr == "vibroimpact: error: interrupted\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_run(folder, number):
    endless = ["--set", "record.transient=2e5", "--set", "oscillator.omega.num=2000"]
    command = [sys.executable, "-m", "sweeps.cli", "run", "sweep.yaml", *endless]
    environment = {"PYTHONPATH": str(ROOT), "PATH": ""}
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment) as run:
        deadline = time.monotonic() + 120
        while not Path("small.h5").exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        run.send_signal(number)
        _, stderr = run.communicate(timeout=120)
    assert run.returncode == 1
    assert stderr.splitlines()[-1].startswith("vibroimpact: error: interrupted; ")
    assert "Traceback" not in stderr


@pytest.fixture
def listening(monkeypatch):
    """What the process of a command has from its start."""
    monkeypatch.setattr(interrupts, "_came", False)
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    interrupts.listen()
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_that_the_compiler_swallows_is_not_lost(monkeypatch, capfd, listening, number):
    class Callback:  # exceptions in it are swallowed, as in LLVM's
        def __del__(self):
            os.kill(os.getpid(), number)
            time.sleep(0.1)

    written = []

    def write(self, block, results):
        written.append(block)
        Callback()

    monkeypatch.setattr(runner.SweepWriter, "write", write)
    monkeypatch.setattr(runner, "block_size", lambda _: 2)
    result = call("run", "sweep.yaml", "--quiet")
    assert result.exit_code == 1
    assert result.stderr.startswith("vibroimpact: error: interrupted; 0 of 10 points kept")
    assert len(written) == 1
    assert capfd.readouterr().err == ""


# Requests that are refused


@pytest.mark.parametrize(
    ("line", "given", "number", "parts"),
    [
        ("  h: 0.1", "  h: -1", 3, ["oscillator.h = -1", ">= 0"]),
        ("  h: 0.1", "  h: .nan", 3, ["oscillator.h = .nan", "a finite number >= 0"]),
        ("  R: 0.8", "  R: 1.2", 4, ["oscillator.R = 1.2", "a number from 0 to 1"]),
        ("  omega: {start: 1.5, stop: 3.0, num: 5}", "  omega: 0", 5,
         ["oscillator.omega = 0", "> 0"]),
        ("num: 5", "num: 0", 5, ["oscillator.omega.num = 0", "an integer from 1"]),
        ("  omega:", "  omga:", 5,
         ["unknown key oscillator.omga", "did you mean omega?", "h, R, omega, f, p, clearance"]),
        ("method:", "start: {x0: 0.5}\nmethod:", 8,
         ["start.x0", "x0 = 0.5", "clearance = 0", "every x0 must be <= every clearance"]),
        ("{steps_per_period: 20}", "{integrator: newmrak}", 8,
         ["method.integrator = newmrak", "did you mean newmark?", "newmark, rk4"]),
        ("  R: 0.8", "  R: [0.8", 5, ["column 8", "not valid YAML"]),
    ],
)  # fmt: skip
def test_a_wrong_configuration(line, given, number, parts):
    assert CONFIG.count(line) == 1
    Path("wrong.yaml").write_text(CONFIG.replace(line, given))
    for arguments in (["run", "wrong.yaml"], ["run", "wrong.yaml", "--dry-run"]):
        message = refused(*arguments)
        assert f"wrong.yaml, line {number}" in message
        for part in parts:
            assert part in message


def test_a_missing_configuration():
    message = refused("run", "missing.yaml")
    assert "missing.yaml: cannot be read (No such file" in message
    assert "expected: a YAML file" in message


def test_a_wrong_override():
    message = refused("run", "sweep.yaml", "--set", "oscillator.R=1.2")
    assert "--set oscillator.R=1.2: oscillator.R = 1.2" in message
    assert "a number from 0 to 1" in message


@pytest.mark.parametrize("dry", [[], ["--dry-run"]])
def test_an_output_folder_that_does_not_exist(dry):
    message = refused("run", "sweep.yaml", "-o", "nowhere/out.h5", *dry)
    assert "folder nowhere" in message and "does not exist" in message


def test_an_output_that_exists():
    Path("small.h5").write_text("precious")
    message = refused("run", "sweep.yaml")
    assert "small.h5 exists" in message and "--overwrite" in message
    assert Path("small.h5").read_text() == "precious"


@pytest.mark.parametrize("threads", [0, -1, 100_000])
def test_threads_that_numba_does_not_have(threads):
    message = refused("run", "sweep.yaml", "--threads", threads)
    assert f"--threads {threads} " in message and "an integer from 1 to " in message


@pytest.mark.parametrize("command", ["plot", "info"])
def test_a_file_that_is_not_a_sweep(command):
    message = refused(command, "sweep.yaml")
    assert "sweep.yaml is not an HDF5 file" in message
    with h5py.File("other.h5", "w") as file:
        file["x"] = [1.0]
    assert "other.h5 is an HDF5 file, but not one" in refused(command, "other.h5")
    assert "missing.h5 does not exist" in refused(command, "missing.h5")


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--kind", "bifurcatoin"], ["bifurcatoin", "bifurcation"]),
        (["--kind", ""], ["no picture ''"]),
        (["--at", "omega=2", "--at", "omega=3"], ["--at omega=3 ", "omega was given before"]),
        (["-o", "link.png"], ["link.png", "replace the data"]),
        (["-o", "folder/../small.h5"], ["small.h5", "replace the data"]),
        (["--axis", "h"], ["h is not a swept axis", "omega"]),
        (["--coordinate", "poincare_y"], ["poincare_y", "poincare_x"]),
        (["--at", "omega"], ["--at omega ", "NAME=VALUE"]),
        (["--at", "omega=x"], ["--at omega=x ", "NAME=VALUE"]),
        (["--at", "h=1"], ["h "]),
        (["-o", "small.h5"], ["small.h5", "replace the data"]),
        (["-o", "small.docx"], ["small.docx", ".png"]),
        (["-o", "nowhere/small.png"], ["folder nowhere", "does not exist"]),
    ],
)
def test_a_picture_that_cannot_be_drawn(arguments, parts):
    accepted("run", "sweep.yaml", "--quiet")
    Path("link.png").symlink_to("small.h5")
    Path("folder").mkdir()
    message = refused("plot", "small.h5", *arguments)
    for part in parts:
        assert part in message


def test_a_cut_off_the_grid_is_told():
    accepted("run", "sweep.yaml", "--quiet")
    result = call("plot", "small.h5", "--at", "clearance=0.06")
    assert (result.exit_code, result.stdout) == (0, "small.png\n")
    assert result.stderr == "clearance = 0.06 is not on the grid; drawn at clearance = 0.1\n"
    rounded = call("plot", "small.h5", "--at", "clearance=0.1000000000001")
    assert (rounded.exit_code, rounded.stderr) == (0, "")


@pytest.mark.parametrize("dry", [[], ["--dry-run"]])
def test_more_than_the_disk_holds(monkeypatch, dry):
    usage = types.SimpleNamespace(free=1000)
    monkeypatch.setattr("shutil.disk_usage", lambda _: usage)
    message = refused("run", "sweep.yaml", *dry)
    assert re.search(r"the sweep takes about \d\.\d+ kB, .* has only 1 kB left", message)


def test_a_grid_beyond_all_bounds():
    axis = "{start: 0, stop: 1, num: 1e7}"
    three = [f"oscillator.{name}={axis}" for name in ("h", "R", "f")]
    message = refused("run", "sweep.yaml", *(part for text in three for part in ("--set", text)))
    assert "a grid of 10,000,000,000,000,000,000,000 points" in message
    assert "at most 1,000,000,000" in message


@pytest.mark.parametrize("name", ["z.txt", "z.png", "z.yaml"])
def test_an_output_with_the_ending_of_another_kind(name):
    assert "did you mean z.h5?" in refused("run", "sweep.yaml", "-o", name)


@pytest.mark.parametrize(
    "arguments", [["run"], ["run", "sweep.yaml", "--foo"], ["fly"], ["run", "a", "--threads", "x"]]
)
def test_bad_arguments(arguments):
    result = call(*arguments)
    assert result.exit_code == 2
    assert "Error: " in result.stderr and "Traceback" not in result.stderr


# The rest


def test_schema_is_json():
    schema = json.loads(accepted("schema"))
    assert "oscillator" in schema["properties"]


def test_version():
    assert accepted("--version").startswith("vibroimpact")


@pytest.mark.parametrize(
    # Newer typers import pydantic to describe the arguments of a command.
    ("arguments", "typers"),
    [
        (["--help"], set()),
        (["run", "--help"], {"pydantic"}),
        (["bench", "stability", "--help"], {"pydantic"}),
    ],
)
def test_help_imports_nothing_heavy(arguments, typers):
    heavy = {"numba", "numpy", "matplotlib", "pydantic", "xarray", "h5py", "yaml"} - typers
    code = (
        "import sys\n"
        "from sweeps.cli.__main__ import main\n"
        "try:\n"
        "    main()\n"
        "except SystemExit as end:\n"
        "    assert end.code == 0, end.code\n"
        f"heavy = {heavy} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    command = [sys.executable, "-c", code, *arguments]
    environment = {"PYTHONPATH": str(ROOT)}
    result = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=60)
    assert result.returncode == 0, result.stderr
    assert "Usage: vibroimpact" in result.stdout


def test_a_process_exits_like_the_command(folder):
    result = process("run", "sweep.yaml", "--set", "oscillator.R=2")
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr.startswith("vibroimpact: error: --set oscillator.R=2: ")
    assert result.stderr.count("\n") == 1
    assert process("run", "sweep.yaml", "--dry-run").returncode == 0
    assert [path.name for path in folder.iterdir()] == ["sweep.yaml"]


# What other programs and people put in the way


def test_what_a_file_says_reaches_the_terminal_escaped(monkeypatch):
    odd = '"a\\e]0;owned\\x07\\x9b31m\\u202E.h5"'
    message = refused("run", "sweep.yaml", "--set", f"output={odd}", "--set", "name=nowhere/x")
    assert message.isascii() and printable(message) == message
    printed = accepted("run", "sweep.yaml", "--set", f"output={odd}", "--dry-run")
    assert r"a\x1b]0;owned\x07\x9b31m\u202e.h5" in printed and printable(printed) == printed
    result = call("run", "sweep.yaml", "--set", f"output={odd}", "--set", "name=a[red]\u202eb")
    assert result.exit_code == 0
    assert printable(result.stdout) == result.stdout and r"\u202e.h5" in result.stdout
    for text in (result.stderr, accepted("info", next(Path().glob("*.h5")))):
        assert r"a[red]\u202eb" in text and "\u202e" not in text
    bad = refused("run", "sweep.yaml", "--set", 'oscillator.h="\\e[31m"')
    assert r"oscillator.h = \x1b[31m is not a number" in bad and "\x1b" not in bad
    assert r"\x1b[31m.h5 does not exist" in refused("info", "\x1b[31m.h5")


@pytest.mark.parametrize("name", ["", ".", "..", "/"])
def test_a_folder_is_no_file_of_a_sweep(name):
    for command in ("plot", "info", "attractors"):
        assert "vibroimpact: error: " in refused(command, name)


def test_a_picture_with_a_long_name():
    accepted("run", "sweep.yaml", "--quiet")
    assert accepted("plot", "small.h5", "-o", "a" * 251 + ".png")
    Path("loop.png").symlink_to("loop.png")
    for name in ("a" * 252 + ".png", "/proc/x.png"):
        result = call("plot", "small.h5", "-o", name)
        assert result.exit_code == 1
        assert re.fullmatch(r"vibroimpact: error: \S+ cannot be written: .*\n", result.stderr)
    assert call("plot", "small.h5", "-o", "loop.png").exit_code in (0, 1)
    assert not list(Path().glob(".*"))


def test_a_followed_sweep_that_records_no_impacts():
    followed = ("--set", "follow={axis: omega}", "--set", "record.impacts=0")
    accepted("run", "sweep.yaml", "--quiet", *followed)
    with xr.open_dataset("small.h5", engine="h5netcdf") as dataset:
        assert "impact_v" not in dataset and np.isfinite(dataset["poincare_x"]).all()


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("NUMBA_NUM_THREADS=abc", "could not be parsed"),
        ("NUMBA_NUM_THREADS=0", "Number of threads specified must be > 0"),
        ("NUMBA_DISABLE_JIT=1", "needs numba's compiler"),
        ("NUMBA_OPT=9", "value '9' could not be parsed"),
    ],
)
def test_odd_settings_of_numba_are_refused(setting, told):
    name, value = setting.split("=")
    result = process("run", "sweep.yaml", **{name: value})
    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr.startswith("vibroimpact: error: numba cannot work with its settings: ")
    assert told in result.stderr and setting in result.stderr and result.stderr.count("\n") == 1


def test_an_odd_date_is_refused(monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "abc")
    assert "SOURCE_DATE_EPOCH=abc is not allowed" in refused("run", "sweep.yaml")


def test_odd_settings_of_matplotlib_are_refused():
    accepted("run", "sweep.yaml", "--quiet")
    result = process("plot", "small.h5", MPLBACKEND="nonsense")
    assert result.returncode == 2 and not Path("small.png").exists()
    assert "matplotlib cannot work with its settings: " in result.stderr
    assert "unset or correct MPLBACKEND" in result.stderr and result.stderr.count("\n") == 1


def test_an_encoding_that_lacks_a_character():
    result = process("run", "sweep.yaml", "--set", "name=日", PYTHONIOENCODING="latin-1")
    assert result.returncode == 0, result.stderr
    assert r"next: vibroimpact plot '\u65e5.h5'" in result.stdout


def test_a_warning_is_one_line(folder):
    code = (
        "import warnings\n"
        "from sweeps.cli.terminal import prepare_streams\n"
        "prepare_streams()\n"
        "warnings.warn('the cache\\x1b[31m is full')\n"
    )
    command = [sys.executable, "-c", code]
    environment = {"PYTHONPATH": str(ROOT)}
    result = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=120)
    assert result.stderr == "vibroimpact: warning: the cache\\x1b[31m is full\n"
