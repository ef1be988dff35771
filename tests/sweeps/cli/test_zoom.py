"""The command zoom: the piece, its names, overrides, picture and plan, and what cannot be."""

import time
import warnings
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

import sweeps
from sweeps.opened.opened_sweep import OpenedSweep
from tests.helpers.commands import accepted, call, refused
from vibroimpact.status import Status

pytestmark = pytest.mark.slow


@pytest.fixture
def undrawn(monkeypatch):
    """Draw no picture of a piece whose data are tested."""
    monkeypatch.setattr("sweeps.cli.plot.draw_picture", lambda *_, **__: None)


def test_zoom_computes_and_draws_a_piece(small_file, unpainted):
    printed = accepted("zoom", "small.h5", "omega=2.25:2.5", "poincare_v=-1:1")
    assert printed.splitlines()[-1] == "small-omega-2.25-2.5.png"
    assert Path("small-omega-2.25-2.5.png").read_bytes() == b"painted"
    said = call("zoom", "small.h5", "omega=2:9", "--quiet", "--exact")
    assert (said.exit_code, said.output) == (0, "") and Path("small-omega-2-9.png").exists()
    accepted("zoom", "small.h5", "clearance=0.1:0.2", "omega=2:3", "-o", "two.h5")
    whole, piece, two = map(sweeps.open_sweep, ("small.h5", "small-omega-2.25-2.5.h5", "two.h5"))
    np.testing.assert_array_equal(piece["omega"], np.linspace(2.25, 2.5, 5))
    np.testing.assert_array_equal(two["clearance"], [0.1, 0.2])
    np.testing.assert_array_equal(two["omega"], np.linspace(2.0, 3.0, 5))
    point = {"omega": 2.25}  # also on the grid of the full sweep
    assert piece.sel(point).drop_attrs().identical(whole.sel(point).drop_attrs())


@pytest.mark.parametrize(
    ("pieces", "reason"),
    [
        (["omega=2:1"], "expected: NAME=LOW:HIGH"),
        (["=2:3"], "expected: NAME=LOW:HIGH"),
        (["omgea=2:3"], "did you mean omega?"),
        (["(o=2:3"], "(o is not a swept axis"),
        (["h=0:1"], "expected: omega or clearance"),
        (["omega=-1:1"], "expected: forcing frequency"),
        (["omega=2:3", "omega=2:4"], "each name once"),
        (["poincare_x=0:1"], "at least one swept axis"),
        (["omega=2:3", "poincare_x=0:1", "poincare_v=0:1"], "at most one of"),
        (["omega=2:3", "poincare_x=0:1", "--coordinate", "impact_v"], "exclude each other"),
        (["omega=2:3", "--coordinate", "impulse"], "impulse is not a coordinate"),
        (["omega=2:3", "--width", "4"], "--width 4 is not allowed"),
        (["omega=2:3", "--title", r"$\no$"], "title = '$"),
        (["omega=2:3", "--coordinate", "x_max", "--exact"], "exact branches have no x_max"),
        (["omega=2:3", "--coordinate", "x_max"], "extremes is no diagnostic of it"),
        (["omega=2:3", "--dask", "host:1"], "did you mean tcp://host:1?"),
        (["omega=2:3", "-o", "small.h5"], "small.h5 exists"),
        (["omega=2:3", "--set", "record.transiet=9"], "did you mean transient?"),
        (["omega=2:3", "--set", "oscillator.omega=2.0"], "omega is not a swept axis"),
        (["omega=2:3", "--set", "oscillator.omega.stop=4"], "the piece chooses oscillator.omega"),
        (["omega=2:3", "--set", "record.impacts=0", "--coordinate", "impact_v"], "impacts is 0"),
    ],
)
def test_a_zoom_that_cannot_be(small_file, with_layout, pieces, reason):
    assert reason in refused("zoom", "small.h5", *pieces)


def test_zoom_takes_the_looks_of_a_picture_and_says_what_is_beyond_the_sweep(small_file):
    """It can be planned."""
    looks = ("--grey", "--title", "Mine", "--no-marks", "--exact", "--width", "4in")
    looks += ("--coordinate", "poincare_v")
    files = sorted(Path().iterdir())
    planned = call("zoom", "small.h5", "omega=2.25:2.5", *looks, "--dry-run")
    assert sorted(Path().iterdir()) == files and "goes beyond" not in planned.stderr
    assert "axis              omega = 2.25 .. 2.5 [rad/time], 5 values" in planned.stdout
    assert planned.stdout.splitlines()[-1] == "output            small-omega-2.25-2.5.h5"
    told = call("zoom", "small.h5", "omega=2.25:9", "clearance=0:0.1", *looks, "-o", "z.h5")
    assert told.exit_code == 0, told.output
    assert "omega = 2.25 .. 9 goes beyond the sweep, which has 1.5 .. 3" in told.stderr
    assert "clearance" not in told.stderr.split("goes beyond")[0]
    accepted("plot", "z.h5", *looks, "-o", "same.png")
    drawn, same = map(matplotlib.image.imread, ("z.png", "same.png"))
    np.testing.assert_array_equal(drawn, same)
    assert np.ptp(drawn[..., :3], axis=-1).max() < 0.01
    assert drawn.shape[1] == 4 * 150  # the fixture cheap_pictures


def test_a_zoom_takes_overrides_as_a_run_does(small_file, undrawn):
    overrides = ("--set", "record.transient=60", "--set", "oscillator.omega.num=3")
    accepted("zoom", "small.h5", "omega=2:2.5", *overrides)
    ends = [f"oscillator.omega.{end}" for end in ("start=2.0", "stop=2.5")]
    accepted("run", "small.h5", "-o", "run.h5", *overrides, "--set", ends[0], "--set", ends[1])
    named = "small-omega-2-2.5-record.transient-60-oscillator.omega.num-3.h5"
    with sweeps.open_sweep(named) as zoomed, sweeps.open_sweep("run.h5") as run:
        assert zoomed.drop_attrs().identical(run.drop_attrs())
        assert OpenedSweep(zoomed).config.record.transient == 60
    other = ("--set", "record.transient=70", "--set", "oscillator.clearance=[0.1, 0.2]")
    planned = accepted("zoom", named, "omega=2:2.2", *other, "--dry-run")
    name = (
        "small-oscillator.omega.num-3-omega-2-2.2-record.transient-70-"
        "oscillator.clearance-_0.1_0.2.h5"
    )
    assert planned.splitlines()[-1] == f"output            {name}"
    planned = accepted("zoom", "small.h5", "omega=2:2.5", "--set", "output=n.h5", "--dry-run")
    assert planned.splitlines()[-1] == "output            n.h5"
    accepted("run", "small.h5", "-o", "none.h5", "--set", "record.impacts=0")
    impacts = ("--set", "record.impacts=9", "--coordinate", "impact_v")
    accepted("zoom", "none.h5", "omega=2:2.5", *impacts)  # the file itself has no impacts


def test_every_zoom_has_a_name_of_its_own(small_file):
    def named(file, *overrides):
        chosen = [word for text in overrides for word in ("--set", text)]
        plan = accepted("zoom", file, "omega=2:2.5", *chosen, "--dry-run").splitlines()[-1]
        return plan.removeprefix("output").strip()

    phases = {named("small.h5", f"{group}.phase=1") for group in ("start", "record")}
    assert phases == {f"small-omega-2-2.5-{group}.phase-1.h5" for group in ("start", "record")}
    twice = "record.transient=60", "record.transient=70"
    assert named("small.h5", *twice) == "small-omega-2-2.5-record.transient-70.h5"
    Path("small.h5").rename(before := named("small.h5", "start.x0=-2e-3", "start.v0=1"))
    assert before == "small-omega-2-2.5-start.x0--2e-3-start.v0-1.h5"
    again = "small-start.v0-1-omega-2-2.5-start.x0--3.h5"
    assert named(before, "start.x0=-3") == again
    others = "R-0.5-0.6-name-a-b"
    Path(before).rename(before := f"small-omega-2-2.5-method.impact-reduced-step-{others}.h5")
    again = f"small-{others}-omega-2-2.5-method.impact-plain.h5"
    assert named(before, "method.impact=plain") == again
    Path(before).rename("small.h5")
    many = ", ".join(f"0.{i}" for i in range(11, 99))
    long = [named("small.h5", f"oscillator.R=[{many}, {last}]") for last in (0, 1)]
    assert len(set(long)) == 2 and max(map(len, long)) < 60


def test_a_piece_of_a_logarithmic_axis_is_logarithmic(small_file, undrawn):
    omega = "oscillator.omega={start: 1.5, stop: 6, num: 5, spacing: log}"
    accepted("run", "small.h5", "-o", "log.h5", "--quiet", "--set", omega)
    accepted("zoom", "log.h5", "omega=2:4", "-o", "piece.h5")
    with sweeps.open_sweep("piece.h5") as piece:
        np.testing.assert_allclose(piece["omega"], np.geomspace(2.0, 4.0, 5), rtol=1e-15)


def test_a_zoom_beyond_the_ends_of_the_sweep_has_the_steps_that_it_needs(small_file, undrawn):
    accepted("zoom", "small.h5", "omega=0.05:0.1", "-o", "beyond.h5")
    with sweeps.open_sweep("beyond.h5") as beyond, sweeps.open_sweep("small.h5") as small:
        assert (beyond["status"] == Status.CERTIFIED).all()
        methods = (OpenedSweep(dataset).config.method for dataset in (beyond, small))
        needed, had = (method.steps_per_period for method in methods)
    assert needed > had


def test_a_quiet_zoom_warns_and_says_nothing_else(small_file, monkeypatch):
    def plot(sweep, figure, *arguments, **options):
        time.sleep(0.1)  # takes long
        warnings.warn("the font is odd", stacklevel=1)
        return figure

    monkeypatch.setattr("sweeps.plotting.plot", plot)
    monkeypatch.setattr("sweeps.text.PATIENCE", 0.01)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        said = call("zoom", "small.h5", "omega=2:2.5", "--quiet")
    assert (said.exit_code, said.stdout) == (0, "")
    assert said.stderr == "vibroimpact: warning: the font is odd\n"


def test_a_zoom_of_a_zoom_is_named_by_its_own_range_and_shows_its_ends(small_file, unpainted):
    accepted("zoom", "small.h5", "omega=2:2.5", "-o", "small-omega-2-2.5.h5")
    said = call("zoom", "small-omega-2-2.5.h5", "omega=2.1234567:2.1234568")
    assert said.stdout.splitlines()[-1] == "small-omega-2.1234567-2.1234568.png"
    assert "omega = 2.1234567 .. 2.1234568 [rad/time], 5 values" in said.stderr


@pytest.mark.parametrize(
    ("way", "oscillator", "low", "high", "impacts"),
    [
        ("up", "h: 0, R: 0.8, f: 1, omega: {start: 2.64, stop: 2.712, num: 10}", 2.7, 2.71, 2),
        ("down", "mass: 2, damping: 0.2, stiffness: 2, force: 2, R: 0.8, gap: 1.5, "
         "frequency: {start: 0.2, stop: 0.3, num: 20}", 0.22, 0.24, 0),
    ],
)  # fmt: skip
def test_a_piece_of_a_followed_sweep_stays_on_its_motion(
    undrawn, way, oscillator, low, high, impacts
):
    """From rest another motion is reached there."""
    group, axis = ("rig", "frequency") if "mass" in oscillator else ("oscillator", "omega")
    Path("whole.yaml").write_text(
        f"{group}: {{{oscillator}}}\nfollow: {{axis: {axis}, direction: {way}}}\n"
        "record: {transient: 2000, periods: 8, phase: 1.0}\n"
    )
    accepted("run", "whole.yaml", "--quiet")
    accepted("zoom", "whole.h5", f"{axis}={low}:{high}", "-o", "piece.h5")
    rest = ("--set", "start.x0=-1e-9")
    accepted("zoom", "whole.h5", f"{axis}={low}:{high}", "-o", "rest.h5", *rest)
    with sweeps.open_sweep("piece.h5") as piece, sweeps.open_sweep("rest.h5") as from_rest:
        assert (piece["period_impacts"] == impacts).all() and (piece["period"] > 0).all()
        assert not (from_rest["period_impacts"] == impacts).any()


@pytest.mark.parametrize(
    ("axis", "piece", "stop"),
    [("omega: {start: 0.26, stop: 0.3, num: 9}, clearance: 0.1", "omega=0.27:0.28", 0.1),
     ("omega: 2.6, clearance: {start: 0, stop: 1, num: 11}", "clearance=-3:-2.5", -3.0)],
)  # fmt: skip
def test_a_piece_begins_at_the_stop_if_the_state_there_is_beyond_it(undrawn, axis, piece, stop):
    """As `plain` leaves a state beyond it, and another piece of clearances has another stop."""
    name = piece.partition("=")[0]
    Path("whole.yaml").write_text(
        f"oscillator: {{h: 0.05, R: 0.8, f: 1, {axis}}}\n"
        f"follow: {{axis: {name}, direction: {'up' if stop > 0 else 'down'}}}\n"
        "method: {impact: plain, steps_per_period: 12}\n"
        "record: {transient: 50, periods: 8, phase: 0.3}\n"
    )
    accepted("run", "whole.yaml", "--quiet")
    accepted("zoom", "whole.h5", piece, "-o", "piece.h5")
    low, high = map(float, piece.partition("=")[2].split(":"))
    before = {name: low if stop > 0 else high}
    with sweeps.open_sweep("piece.h5") as opened, sweeps.open_sweep("whole.h5") as whole:
        nearest = whole["poincare_v"].sel(before, method="pad" if stop > 0 else "backfill")
        assert opened["x0"] == stop and opened["v0"] == nearest[-1] != 0.0


@pytest.mark.parametrize(
    ("axes", "pieces"),
    [("f: 1, omega: {start: 2.3, stop: 2.5, num: 3}", ["omega=2.2:2.4"]),
     ("f: 1, omega: {start: 2.3, stop: 2.5, num: 3}, R: [0.7, 0.8]", ["omega=2.4:2.5", "R=0.7:1"]),
     ("omega: 2.5, f: [1, 1.7e+308]", ["f=1.7e308:1.75e308"])],
)  # fmt: skip
def test_a_piece_before_which_no_point_has_a_state_begins_from_the_start(undrawn, axes, pieces):
    Path("whole.yaml").write_text(
        f"oscillator: {{h: 0, {'' if 'R' in axes else 'R: 0.8, '}{axes}}}\n"
        f"follow: {{axis: {pieces[0].partition('=')[0]}, direction: up}}\n"
        "start: {x0: -1}\nrecord: {transient: 5, periods: 4}\n"
    )
    call("run", "whole.yaml", "--quiet")
    accepted("zoom", "whole.h5", *pieces, "-o", "piece.h5")
    with sweeps.open_sweep("piece.h5") as opened:
        assert opened["x0"] == -1.0
