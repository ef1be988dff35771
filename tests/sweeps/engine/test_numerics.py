"""A file names all that determines its numbers, and other code does not resume a run.

The physics is identified by its code. Therefore the engine must pass inputs and results on without
a change. A sweep along f is computed once and scaled if the motion is proportional to f.
"""

import math
import shutil
from dataclasses import asdict, replace
from pathlib import Path

import numba
import numpy as np
import pytest
import yaml

import sweeps
import vibroimpact
from sweeps import open_sweep, run_sweep
from sweeps.engine import executors
from sweeps.engine.executors import compute
from sweeps.errors import StoreError
from sweeps.grid import Grid
from sweeps.store.variables import VARIABLES
from tests.helpers.commands import call
from tests.helpers.configurations import load
from tests.helpers.written_files import planned
from vibroimpact.jit import NUMERICS
from vibroimpact.jit.cache import name_of, numerics_of
from vibroimpact.oscillator import POINT
from vibroimpact.points import computation

pytestmark = pytest.mark.slow

PHYSICS = Path(vibroimpact.__file__).parent
ENGINE = Path(sweeps.__file__).parent
RECORD = "record: {transient: 7, periods: 6, impacts: 5, diagnostics: [period, lyapunov]"
OSCILLATOR = "oscillator: {h: 0.05, R: [0.5, 0.8], omega: [2.7, 1.3, 2.4], f: 1.0}"
SWEEPS = {
    "plain": f"{OSCILLATOR}\n{RECORD}}}\n",
    "scaled": f"{OSCILLATOR.replace('1.0', '[0.3, 1.0, 7.0]')}\n{RECORD}}}\n",
    "followed": f"{OSCILLATOR}\n{RECORD}, trajectory: {{every: 6}}}}\n"
    "follow: {axis: omega, direction: both}\n",
}


@pytest.mark.parametrize(
    ("name", "compression"), [("plain", "none"), ("scaled", "gzip"), ("followed", "none")]
)
def test_the_file_holds_what_the_physics_was_given_and_returned(monkeypatch, name, compression):
    """Bit for bit; the inputs are in the file, which compares them when it is resumed."""
    calls = []

    def recorded(compute):
        def computed(spec, points, *others, **options):
            results = compute(spec, points, *others, **options)
            for array in results.values():
                array.flags.writeable = False
            calls.append((spec, points.ravel(), results))
            return results

        return computed

    physics = executors.compute_points
    monkeypatch.setattr("sweeps.engine.estimate.compute", physics)  # its results are in no file
    monkeypatch.setattr(executors, "compute_points", recorded(physics))
    monkeypatch.setattr(executors, "compute_chains", recorded(executors.compute_chains))
    config = load(SWEEPS[name], f"compression={compression}")
    run_sweep(config, "out.h5")
    assert len(calls) >= 1
    with open_sweep("out.h5") as dataset:
        given = yaml.safe_load(dataset.attrs["computation"])
        fixed = given.pop("fixed")
        for spec, points, results in calls:
            assert given == {**asdict(spec), "directions": list(spec.directions)}
            axes = [axis for axis in dataset["status"].dims if axis in POINT.names]
            assert {*axes, *fixed} == {*POINT.names}
            part = dataset.isel({axis: np.isin(dataset[axis], points[axis]) for axis in axes})
            values = np.meshgrid(*(part[axis].values for axis in axes), indexing="ij")
            for axis, along in zip(axes, values, strict=True):
                np.testing.assert_array_equal(points[axis], along.ravel())
            for parameter, value in fixed.items():
                assert (points[parameter] == value).all()
            assert set(results) == set(part.data_vars)
            for variable, array in results.items():
                stored = part[variable].values
                stored = stored.reshape(-1, *stored.shape[part["status"].ndim :])
                if array.dtype == object:  # trajectories
                    for row, samples in zip(stored, array, strict=True):
                        np.testing.assert_array_equal(row[: len(samples)], samples)
                        assert np.isnan(row[len(samples) :]).all()
                else:
                    np.testing.assert_array_equal(stored, array)
        computed = sum(results["status"].size for *_, results in calls)
        assert computed == dataset["status"].size


def test_every_source_of_the_physics_is_in_its_name(tmp_path):
    package = tmp_path / "vibroimpact"
    shutil.copytree(PHYSICS, package)
    code = {path.relative_to(package).as_posix(): path.read_bytes()
            for path in sorted(package.rglob("*.py"))}  # fmt: skip
    assert numerics_of(package) == name_of(code, numba.__version__) == NUMERICS
    for path, source in [*code.items()][::9]:
        assert name_of({path: source + b"pass\n"}) != name_of({path: source})
    first, second = [{path: code[path]} for path in (*code,)[:2]]
    assert len({name_of(first), name_of(second), name_of(first | second)}) == 3


SOURCE = '"""A room."""\ndef step(x):\n    """A step."""\n    T = 0.1\n    return x * T, "a step"\n'


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("T = 0.1", "T  = 0.10  # a comment", True),
        ("    T = 0.1", "\n\n    # moved\n    T = 0.1", True),
        ('"""A step."""', '"""Another sentence.\n\n    On two lines."""', True),
        ('    """A step."""\n', "", True),
        ('"""A room."""\n', "", True),
        ("0.1", "0.2", False),
        ("x * T", "T * x", False),
        ('"a step"', '"another step"', False),
    ],
)
def test_only_code_is_in_its_name(old, new, same):
    edited = SOURCE.replace(old, new)
    assert edited != SOURCE
    assert (name_of({"a.py": SOURCE.encode()}) == name_of({"a.py": edited.encode()})) is same


def test_a_computation_that_differs_is_named():
    """The configuration is the same, but the engine has passed other values on."""
    config = load(SWEEPS["plain"])
    run_sweep(config, "out.h5")
    spec = replace(config.sweep.spec, transient=8)
    vars(config)["sweep"] = replace(config.sweep, spec=spec)
    with pytest.raises(StoreError, match="cannot be resumed: transient was 7 and is 8;"):
        run_sweep(config, "out.h5", resume=True)


SCALED = """\
oscillator: {h: 0.1, R: 0.7, f: [0.25, 1.0, 3.0, 8.0], omega: [0.4, 1.9, 2.3]}
record: {transient: 40, periods: 6, impacts: 30, trajectory: {every: 5},
         diagnostics: [period, lyapunov, extremes]}
"""


def scaled_sweep(*changes):
    return load(SCALED, *changes, path="scaled.yaml")


@pytest.fixture
def counted(monkeypatch):
    """Count the points passed to the kernel."""
    given = []
    kernel = computation.run_points

    def run_points(points, *arguments):
        given.append(points)
        return kernel(points, *arguments)

    monkeypatch.setattr(computation, "run_points", run_points)
    return given


def lone(f, method):
    """Return the results at one f, computed without scaling."""
    config = scaled_sweep(f"oscillator.f={f}", *method)
    assert not config.sweep.spec.scaled
    return compute(config.sweep.spec, config.sweep.grid.points(), None)


@pytest.mark.parametrize(
    "method",
    [
        (),
        ("method={integrator: rk4, impact: reduced-step}", "record.diagnostics=[period, extremes]"),
        ("start.phase=[0.0, 2.5]",),
    ],
)
def test_the_scaled_results_are_the_computed_ones(counted, method):
    """Bit for bit for powers of two, to rounding otherwise; one run for every f of a point."""
    config = scaled_sweep(*method)
    assert config.sweep.spec.scaled
    run_sweep(config, "scaled.h5")
    assert all((points["f"] == 1.0).all() for points in counted)
    assert max(points.size for points in counted) == config.sweep.grid.size // 4
    with open_sweep("scaled.h5") as dataset:
        assert dataset.attrs["scaled_along"] == "f"
        for f in config.sweep.grid.axes["f"]:
            for name, true in lone(f, method).items():
                found = dataset[name].sel(f=f).values
                found = found.reshape(-1, *found.shape[dataset["status"].ndim - 1 :])
                if name.startswith("trajectory"):
                    lengths = [len(samples) for samples in true]
                    rest = found[np.arange(found.shape[1]) >= np.c_[lengths]]
                    assert np.isnan(rest).all()
                    found = found[np.arange(found.shape[1]) < np.c_[lengths]]
                    true = np.concatenate(true)
                if f == 3.0 and name in VARIABLES:
                    np.testing.assert_allclose(found, true, rtol=1e-9, atol=1e-9)
                else:
                    np.testing.assert_array_equal(found, true)


def test_what_breaks_the_symmetry_is_computed():
    changes = [f"oscillator.f={value}" for value in ("1", "[0, 1]", "[1, 1e200]")]
    changes += ["oscillator.clearance=0.1", "oscillator.clearance=[0, 0.1]"]
    for change in (*changes, "start.x0=-0.1", "start.v0=1", "follow={axis: omega}"):
        assert not scaled_sweep(change).sweep.spec.scaled, change


def test_the_axis_is_not_split():
    """Whatever its place."""
    axes = {"h": np.arange(3.0), "f": np.arange(4.0), "omega": np.arange(5.0)}
    for order in (["h", "f", "omega"], ["f", "h", "omega"], ["omega", "h", "f"], ["f"]):
        grid = Grid({name: axes[name] for name in order}, {})
        for size in (4, 7, 16, 60):
            seen = np.zeros(grid.shape, int)
            for block in grid.blocks(size, unsplit="f"):
                assert block[order.index("f")] == slice(0, 4)
                assert seen[block].size <= size
                seen[block] += 1
            assert (seen == 1).all()


def test_an_axis_longer_than_a_block_is_split():
    config = scaled_sweep()
    for size, shape in ((3, (1, 3)), (4, (4, 1))):
        blocks = planned(config, size).blocks
        assert {config.sweep.grid.points(block).size for block in blocks} == {math.prod(shape)}
        assert {tuple(cut.stop - cut.start for cut in block) for block in blocks} == {shape}


def test_the_run_says_so():
    scaled_sweep()
    result = call("run", "scaled.yaml")
    assert result.exit_code == 0
    assert "one value is computed, the others are scaled" in result.stderr
    assert "scaled_along" in call("info", "scaled.h5").stdout
