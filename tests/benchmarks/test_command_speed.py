"""From the command to the closed file: the whole run, the store, and the start of the process."""

import os
import subprocess
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

from sweeps import load_config, open_sweep
from sweeps.cli.main import app
from tests.benchmarks.limits import cpu_seconds
from tests.helpers.places import ROOT
from vibroimpact import integrate

pytestmark = pytest.mark.benchmark(timer=cpu_seconds)

SWEEP = """\
name: timed
oscillator: {{h: 0.1, R: 0.8, omega: {{start: 2.0, stop: 2.6, num: {points}}}, f: 1.0}}
method: {{integrator: exact, impact: {rule}, steps_per_period: {steps}}}
record: {{transient: {transient}, periods: {periods}, impacts: 0, diagnostics: []}}
output: {output}
"""


@pytest.fixture
def sweep(tmp_path):
    """Return a maker of configurations: the sweep as written, with these values."""

    def write(**values):
        values = {"rule": "exact", "steps": 32, "output": tmp_path / "timed.h5"} | values
        path = tmp_path / "timed.yaml"
        path.write_text(SWEEP.format(**values))
        return path

    return write


def run(path):
    """Run the command in this process, on one thread."""
    asked = ["run", str(path), "--threads", "1", "--overwrite", "--quiet"]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 0, done.output


def kernel(path):
    """Compute a configuration without storing results."""
    config = load_config(path)
    points = config.sweep.grid.points(tuple(slice(0, n) for n in config.sweep.grid.shape))
    method = config.method.model_dump(include={"integrator", "impact", "steps_per_period"})
    record = config.record.model_dump(include={"transient", "periods", "impacts"})
    return integrate(points, **method, **record, threads=1)


def read(path):
    """Return the dataset of the file, in memory."""
    with open_sweep(path) as dataset:
        return dataset.load()


def check(path):
    """The file holds what the kernel computes, to the last bit."""
    expected, held = kernel(path), read(path.with_suffix(".h5"))
    for name in ("poincare_x", "poincare_v", "impacts_per_period", "status"):
        np.testing.assert_array_equal(held[name], expected[name])


def test_whole_command(race, sweep):
    path = sweep(points=8192, transient=200, periods=100)
    name, alone = "run, from YAML to the closed file / kernel alone", {"of_reference": 1.0}
    race.run(name, lambda: run(path), lambda: kernel(path), **alone, rounds=4)
    check(path)


#: Points and forcing periods of a sweep so cheap that the store takes most of the time.
CHEAP = {"points": 32768, "periods": 100}
NUMBERS = 2.0 * CHEAP["points"] * CHEAP["periods"]


def test_store_write(race, sweep):
    path = sweep(**CHEAP, transient=0, rule="plain", steps=4)
    race.run("store, written", lambda: run(path), amount=NUMBERS, rounds=10)
    check(path)


def test_store_read(race, sweep):
    path = sweep(**CHEAP, transient=0, rule="plain", steps=4)
    run(path)
    held = race.run("store, read", lambda: read(path.with_suffix(".h5")), amount=NUMBERS, rounds=10)
    np.testing.assert_array_equal(held["poincare_x"], kernel(path)["poincare_x"])


def python(*arguments, cwd=ROOT):
    """Run an interpreter, which keeps its bytecode, to its end; return what it prints."""
    command = [sys.executable, *map(str, arguments)]
    # An image may switch bytecode off; every start would then compile all modules again.
    env = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}
    output = {"check": True, "capture_output": True, "text": True}
    return subprocess.run(command, cwd=cwd, env=env, **output).stdout


def test_help(race):
    """The tests of the command line check that it imports neither numba nor matplotlib."""
    both = (lambda: python("-m", "sweeps.cli", "--help")), (lambda: python("-c", "pass"))
    shown = race.run("--help / the bare interpreter", *both, of_reference=1.0, rounds=10)
    assert "Usage: vibroimpact" in shown


def test_second_run(race, sweep):
    """Nothing is compiled again."""
    path = sweep(points=8, transient=10, periods=10)
    libraries = "import numba, h5py, psutil, pydantic, yaml, typer, rich.progress"
    words = "run", path, "--overwrite"
    second = "a second run / importing what it needs", lambda: python("-m", "sweeps.cli", *words)
    told = race.run(*second, lambda: python("-c", libraries), of_reference=1.0, rounds=3)
    assert "8 points, every impact found and certified" in told
    check(path)
