"""A sweep along f is computed once and scaled if the motion is proportional to f."""

import math

import numpy as np
import pytest

from sweeps import open_sweep, run_sweep
from sweeps.engine.executors import compute
from sweeps.grid import Grid
from sweeps.store.variables import VARIABLES
from tests.helpers.commands import call
from tests.helpers.configurations import load
from tests.helpers.written_files import planned
from vibroimpact.points import computation

SWEEP = """\
oscillator: {h: 0.1, R: 0.7, f: [0.25, 1.0, 3.0, 8.0], omega: [0.4, 1.9, 2.3]}
record: {transient: 40, periods: 6, impacts: 30, trajectory: {every: 5},
         diagnostics: [period, lyapunov, extremes]}
"""


def scaled_sweep(*changes):
    return load(SWEEP, *changes, path="scaled.yaml")


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


@pytest.mark.slow
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
