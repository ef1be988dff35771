"""Requests that are refused: exit code 2, one message, and no file changed."""

import re
import types
from pathlib import Path

import h5py
import pytest

from commands import SMALL, call, refused

CONFIG = SMALL


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


def test_a_text_is_no_file_of_a_sweep():
    Path("text.h5").write_text("hello")
    assert "text.h5 is no file of a sweep" in refused("run", "text.h5", "-o", "new.h5")


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
        (["--below", "lyapunov"], ["has no lyapunov", "record.diagnostics: [lyapunov]"]),
        (["--at", "omega=2", "--at", "omega=3"], ["--at omega=3 ", "omega was given before"]),
        (["--coordinate", "impulse"], ["poincare_x", "; --below impulse draws it in a panel"]),
        (["--at", "omega"], ["--at omega ", "NAME=VALUE"]),
        (["--at", "omega=x"], ["--at omega=x ", "NAME=VALUE"]),
        (["-o", "small.h5"], ["small.h5", "replace the data"]),
        (["-o", "small.docx"], ["small.docx", ".png"]),
    ],
)
def test_a_picture_that_cannot_be_drawn(ran, arguments, parts):
    message = refused("plot", "small.h5", *arguments)
    for part in parts:
        assert part in message


@pytest.mark.slow
def test_a_cut_off_the_grid_is_told(ran):
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
    assert re.search(r"the sweep takes about \d+\.?\d* kB .* has only 1 kB left", message)


def test_a_grid_beyond_all_bounds():
    axis = "{start: 0, stop: 1, num: 1e7}"
    three = [f"oscillator.{name}={axis}" for name in ("h", "R", "f")]
    message = refused("run", "sweep.yaml", *(part for text in three for part in ("--set", text)))
    assert "a grid of 10,000,000,000,000,000,000,000 points" in message
    assert "at most 1,000,000,000" in message


@pytest.mark.parametrize(
    "arguments", [["run"], ["run", "sweep.yaml", "--foo"], ["fly"], ["run", "a", "--threads", "x"]]
)
def test_bad_arguments(arguments):
    result = call(*arguments)
    assert result.exit_code == 2
    assert "Error: " in result.stderr and "Traceback" not in result.stderr
