"""The command line: output and files of run, plot and info."""

import re
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

import sweeps
from sweeps.engine import executors
from sweeps.grid import Cost
from sweeps.plotting import section
from tests.helpers.commands import SMALL, accepted, call, refused
from tests.helpers.places import ROOT
from vibroimpact.status import Evidence, Status

pytestmark = pytest.mark.slow

CONFIG = SMALL


def test_run_info_and_plot():
    printed = accepted("run", "sweep.yaml", "--threads", 1)
    assert "small.h5: 10 points" in printed
    assert re.search(r" in \S+ s$", printed, re.MULTILINE)
    assert printed.splitlines()[-1] == "next: vibroimpact plot small.h5"
    with xr.open_dataset("small.h5", engine="h5netcdf") as dataset:
        assert dict(dataset["poincare_x"].sizes) == {"omega": 5, "clearance": 2, "section": 4}

    shown = accepted("info", "small.h5")
    assert re.search(r"name +small\n", shown)
    assert re.search(r"points +10 points, every impact found and certified\n", shown)
    assert "omega = 1.5 .. 3 [rad/time], 5 values" in shown
    assert "poincare_x (omega: 5, clearance: 2, section: 4)" in shown
    for part in ("vibroimpact_version", "numba_way", "duration", "integrator: exact"):
        assert part in shown

    assert accepted("plot", "small.h5") == "small.png\n"
    assert Path("small.png").read_bytes().startswith(b"\x89PNG")


def test_the_configuration_of_a_file_runs_again(small_file):
    again = accepted("info", "small.h5", "--config")
    assert again == sweeps.open_sweep("small.h5").attrs["configuration"]
    assert accepted("info", "small.h5").split("\n\n", 1)[1] == again
    Path("again.yaml").write_text(again)
    accepted("run", "again.yaml", "-o", "again.h5", "--quiet")
    accepted("run", "small.h5", "-o", "other.h5", "--set", "oscillator.omega.start=2.0", "--quiet")
    first, second, other = map(sweeps.open_sweep, ("small.h5", "again.h5", "other.h5"))
    assert first.drop_attrs().identical(second.drop_attrs())
    np.testing.assert_array_equal(other["omega"], np.linspace(2.0, 3.0, 5))
    assert "small.h5 exists" in refused("run", "small.h5")
    said = accepted("run", "small.h5", "--resume", "--dry-run")
    assert "expected time     about 0 s" in said and "output            small.h5" in said
    said = call("run", "small.h5", "--resume").stderr
    assert said == "small.h5 is complete: nothing was left to do\n"
    said = refused("run", "small.h5", "--set", "oscillator.omga.start=2")
    assert "override oscillator.omga.start" in said
    assert "exclude each other" in refused("info", "small.h5", "--config", "--bifurcations")


def test_init_writes_a_scene_to_begin_from():
    assert accepted("init") == "quickstart.yaml\nnext: vibroimpact run quickstart.yaml\n"
    assert Path("quickstart.yaml").read_text() == (ROOT / "configs/quickstart.yaml").read_text()
    accepted("run", "quickstart.yaml", "--dry-run")
    accepted("init", "tolerances")
    accepted("run", "tolerances.yaml", "--dry-run")  # with its table
    accepted("init", "hysteresis")
    assert Path("hysteresis.yaml").read_text().startswith("# Hysteresis at a stop")
    Path("cascade.yaml").write_text("mine")
    assert "cascade.yaml exists" in refused("init", "cascade")
    message = refused("init", "hysteresys")
    assert "did you mean hysteresis?" in message
    for path in (ROOT / "configs").glob("*.yaml"):
        assert path.stem in message
    for name in ("../configs/basins", "pictures", ""):
        assert "there is no scene" in refused("init", name)


def test_several_values_of_an_axis_in_one_picture(small_file, unpainted):
    cut = ("--at", "clearance=0.1", "--at", "omega=1.9,2.6")
    for kind in ("section", "impacts", "trajectory"):
        said = call("plot", "small.h5", "--kind", kind, *cut)
        assert said.stdout == f"small-{kind}-clearance-0.1-omega-1.9-2.6.png\n"
        assert said.stderr.endswith(  # before it, that code is compiled, once on this machine
            "omega = 1.9 is not on the grid; drawn at omega = 1.875\n"
            "omega = 2.6 is not on the grid; drawn at omega = 2.625\n"
        )
    both = ("--at", "clearance=0,0.1", "--at", "omega=2.25,3")
    accepted("plot", "small.h5", "--kind", "section", *both, "--color", "impulse")


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["omega=2,3"], "expected: with --kind section or impacts or trajectory"),
        (["omega=2,3m", "--kind", "section"], "NAME=VALUE without a unit, as omega=2.5,2.7"),
        (["omega=2,9", "--kind", "section"], "omega = 9 is outside the sweep: 1.5 to 3"),
        (["omgea=2,3", "--kind", "section"], "did you mean omega?"),
        (["omega=2.2,2.3", "--kind", "section"], "omega = 2.2, 2.3: two of these have the same"),
        (["omega=2,3", "--at", "omega=2", "--kind", "section"], "its values in one list"),
        (["omega=2,3", "--at", "clearance=0,0.1", "--kind", "section"], "with --color, as"),
    ],
)
def test_several_values_that_cannot_be_drawn(small_file, options, reason):
    assert reason in refused("plot", "small.h5", "--at", *options)


def test_a_map_and_the_exact_orbits(unpainted):
    accepted("run", "sweep.yaml", "--quiet", "--set", "record.diagnostics=[period]")
    assert accepted("plot", "small.h5", "--kind", "map") == "small-map.png\n"
    axes = ("--axis", "clearance", "--axis", "omega", "--quantity", "slowest_impact")
    assert accepted("plot", "small.h5", "-o", "map.svg", *axes) == "map.svg\n"
    impacts = ("--kind", "impacts", "--at", "omega=1.5")
    assert accepted("plot", "small.h5", *impacts) == "small-impacts-omega-1.5.png\n"
    cut = ("--set", "oscillator.clearance=0", "--set", "record.transient=200")
    accepted("run", "sweep.yaml", "--quiet", "--overwrite", *cut)
    *followed, picture = accepted("plot", "small.h5", "--exact").splitlines()
    assert "1/1" in followed[0]
    assert picture == "small-exact.png"
    followed = accepted("plot", "small.h5", "--exact", "--classes", "1/1", "--most", 2)
    assert followed.splitlines()[-1] == "small-exact-1_1-2-branches.png"


def test_no_two_pictures_have_the_same_name(small_file, monkeypatch):
    """A name has only characters that every system allows."""
    assert "nowhere" in refused("plot", "small.h5", "--axis", "nowhere/a:b")
    monkeypatch.setattr("sweeps.plotting.plot", lambda sweep, figure, *_, **__: figure)
    for options, name in (
        ([], "small"),
        (["--kind", "map", "--quantity", "energy_lost"], "small-map-energy_lost"),
        (["--quantity", "impulse"], "small-impulse"),
        (["--axis", "clearance", "--at", "omega=1.5"], "small-clearance-omega-1.5"),
        (["--kind", "section", "--at", "omega=1.5"], "small-section-omega-1.5"),
        (["--kind", "section", "--at", "omega=3"], "small-section-omega-3"),
        (["--below", "impulse", "--coordinate", "poincare_v"], "small-poincare_v-below-impulse"),
        (["--color", "impulse"], "small-color-impulse"),
        (["--below", "impulse"], "small-below-impulse"),
    ):
        assert accepted("plot", "small.h5", *options) == f"{name}.png\n"


def test_several_configurations_are_run_and_drawn_one_after_the_other(folder, unpainted):
    (folder / "sub").mkdir()
    Path("other.yaml").write_text(CONFIG.replace("name: small", "name: other\noutput: sub/o.h5"))
    printed = accepted("run", "sweep.yaml", "other.yaml", "--set", "oscillator.h=0.3")
    outcomes = [line.split("; computed in ")[0] for line in printed.splitlines() if ".h5" in line]
    certified = "10 points, every impact found and certified"
    assert outcomes[:2] == [f"small.h5: {certified}", f"sub/o.h5: {certified}"]
    assert outcomes[2:] == ["next: vibroimpact plot small.h5 sub/o.h5"]
    with (
        xr.open_dataset("small.h5", engine="h5netcdf") as first,
        xr.open_dataset("sub/o.h5", engine="h5netcdf") as second,
    ):
        xr.testing.assert_equal(first, second)
        assert (first.attrs["name"], second.attrs["name"]) == ("small", "other")
    assert accepted("plot", "small.h5", "sub/o.h5") == "small.png\nsub/o.png\n"
    assert Path("sub/o.png").read_bytes() == b"painted"
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
    Path("link.h5").symlink_to("small.h5")
    Path("linked.yaml").write_text(f"{SMALL}output: link.h5\n")
    both = refused("run", "sweep.yaml", "linked.yaml", "--overwrite")
    assert "sweep.yaml and linked.yaml would both write link.h5" in both
    assert "other.h5: h is not a swept axis" in refused("plot", "other.h5", "--axis", "h")


def test_dry_run_says_what_would_be_done_and_does_nothing(monkeypatch):
    monkeypatch.setitem(sys.modules, "sweeps.engine.sweep_run", None)
    printed = accepted("run", "sweep.yaml", "--dry-run")
    rows = [tuple(re.split(r"  +", line)) for line in printed.splitlines()]
    # Per point: 4 sections, 2 impacts, nine numbers, the class as two, its orbit as three, its
    # evidence and the status; and what 20 variables take without points.
    size = 10 * (8 * (2 * 4 + 2 * 2 + 9 + 2 + 3) + 2) + 20 * 4500
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
    assert re.fullmatch(r"about \d\S* kB for the blocks in work", memory)
    assert [path.name for path in Path().iterdir()] == ["sweep.yaml"]


def test_a_dry_run_of_the_rest_tells_the_time_of_the_points_that_are_left(monkeypatch):
    monkeypatch.setattr("sweeps.engine.estimate.expected_cost", lambda *_: Cost(50.0, 1, 1, 1))
    monkeypatch.setattr("sweeps.store.parts.finished_points", lambda path: (8, 10))
    for options, time in (((), "50 s"), (("--resume",), "10 s")):
        assert f"about {time}\n" in accepted("run", "sweep.yaml", "--dry-run", *options)


def test_what_became_of_the_points_is_told(monkeypatch):
    certified = "10 points, every impact found and certified; computed in "
    assert certified in accepted("run", "sweep.yaml")
    compute = executors.compute_block

    def settled(*arguments):
        results = compute(*arguments)
        results["status"][:2] = [Status.CUT_SHORT, Status.COMPUTED]
        return results

    monkeypatch.setattr(executors, "compute_block", settled)
    accepted("run", "sweep.yaml", "--quiet", "--overwrite")
    assert re.search(
        r"points +10 points, of which 1 COMPUTED \(x keeps fewer than 8 digits of the motion: the "
        r"stop is far away, the motion is below 1e-300, or omega\^2 overflows\); "
        rf"1 CUT_SHORT \({Status.CUT_SHORT.meaning}\)\n",
        accepted("info", "small.h5"),
    )
    monkeypatch.setattr(executors, "compute_block", compute)
    printed = accepted("run", "sweep.yaml", "--overwrite", "--set", "method={impact: plain}")
    assert "small.h5: 10 points; computed in " in printed


def test_a_stop_too_far_away_is_told():
    """At p = 1e-7 gravity moves it by 1e14, where x is a multiple of 1/64; the ball jumps."""
    settings = [
        "oscillator={h: 0, R: 0.5, omega: 1, f: [1.2, 1.3], p: 1e-7, clearance: -1e14}",
        "start={x0: -100000000000002.5, v0: 3.8}",
        "record={transient: 0, periods: 8}",
    ]
    changes = [word for setting in settings for word in ("--set", setting)]
    said = "2 points, of which 2 COMPUTED (x keeps fewer than 8 digits of the motion: the stop is"
    assert f"small.h5: {said}" in accepted("run", "sweep.yaml", *changes)
    assert said in accepted("info", "small.h5")
    with sweeps.open_sweep("small.h5") as dataset:
        title = section(dataset, at={"f": 1.3}).get_suptitle()
        assert "keeps fewer than 8 digits of the motion" in title.replace("\n", " ")


def test_how_many_motions_go_where_is_told(monkeypatch):
    """Each motion is counted once; without diagnostics nothing is known."""
    compute = executors.compute_block
    unknown = [Evidence.NONE, Evidence.NONE, Evidence.UNSTABLE, Evidence.UNREACHED]
    others = [Evidence.NONE, Evidence.NONE, *list(Evidence)[-4:]]

    def changed(*arguments):
        results = compute(*arguments)
        results["class_evidence"][:] = unknown + others
        results["period"][:] = [0] * 6 + [1] * 4
        results["rest_fraction"][:] = [0.0] * 4 + [0.5] + [0.0] * 5
        results["status"][5] = Status.UNBOUNDED
        results["orbit_distance"][:] = [np.nan] * 6 + [0.0, 1e-3, 1e-6, 2e-6]
        return results

    monkeypatch.setattr(executors, "compute_block", changed)
    lines = [
        "settled on m/q: 2 (20 %); on its way to m/q: 2 (20 %); rest: 1 (10 %); unbounded: 1 (10 "
        "%); unknown: 4 (40 %)",
        "unknown: 2 near no periodic orbit, 1 near unstable orbits only, 1 near a stable orbit "
        "that they were not shown to reach; Lyapunov exponents of 32 or more periods tell which "
        "are chaotic",
    ]
    assert accepted("run", "sweep.yaml").splitlines()[1:3] == lines
    shown = accepted("info", "small.h5")
    below = shown.splitlines()
    place = next(number for number, line in enumerate(below) if line.startswith("classes "))
    assert [line[21:] for line in below[place : place + len(lines)]] == lines
    assert not any(line.startswith("classes ") for line in below[place + 1 :])
    monkeypatch.setattr(executors, "compute_block", compute)
    bare = accepted("run", "sweep.yaml", "--overwrite", "--set", "record.diagnostics=[]")
    assert "class" not in bare + accepted("info", "small.h5").replace("class_", "")
    accepted("export", "small.h5", "-o", "small.csv")
    assert "class" not in Path("small.csv").read_text()
    printed = accepted("run", ROOT / "configs/paper-dissipative-reduced-step.yaml", "-o", "a.h5")
    assert printed.splitlines()[1] == "the motion: unknown, without a repetition in the record"
    assert "unknown, without a repetition in the record" in accepted("info", "a.h5")


def test_a_run_without_impacts_says_so():
    """Far from the stop; at the stop under a preload, the mass rests there without an impact."""
    said = "no impact in any record: no motion meets the stop"
    free = accepted("run", "sweep.yaml", "--set", "oscillator.clearance=50")
    assert f"{said}; computed in " in free and said in accepted("info", "small.h5")
    changes = ("oscillator={h: 0, R: 0.8, omega: 1, f: 1, clearance: 1000}", "record.transient=10")
    late = accepted("run", "sweep.yaml", "--overwrite", *[f"--set={each}" for each in changes])
    assert (
        "; no impact in any record; computed in " in late and said not in late
    )  # it grows, in resonance
    euler = "{integrator: euler, impact: plain, steps_per_period: 20, allow_unstable: true}"
    changes = ("oscillator.h=0", "oscillator.R=1", f"method={euler}", "record.transient=100000")
    sets = [word for change in changes for word in ("--set", change)]
    overflown = accepted("run", "sweep.yaml", *sets, "--overwrite")
    assert "NON_FINITE" in overflown and said not in overflown
    assert "the step is unstable" in overflown and "next" not in overflown
    large = accepted("run", "sweep.yaml", "--set", "oscillator.f=1e300", "--overwrite")
    assert "NON_FINITE (a number overflowed: the motion is too large)" in large
    assert "next" not in large
    pressed = ("--set", "oscillator.clearance=-50", "--set", "start.x0=-50", "--overwrite")
    assert said not in accepted("run", "sweep.yaml", *pressed)
    with h5py.File("small.h5") as file:
        assert (file["rest_fraction"][()] > 0.999).all()
    assert said not in accepted("run", "sweep.yaml", "--overwrite")
