"""Files with random results in place of computed ones, written block by block or for pictures."""

from pathlib import Path

import numpy as np

from sweep_files import fill, random_results
from sweeps.config.groups import DIAGNOSTICS
from sweeps.grid import Grid, block_points
from sweeps.store import VARIABLES, Schema
from vibroimpact.points.run_spec import RunSpec

CONFIGURATION = "oscillator: {h: 0.1}\n"
GRID = Grid(
    {"R": np.array([0.5, 0.8]), "omega": np.linspace(1.0, 4.0, 6)},
    {"h": 0.1, "f": 1.0, "p": 1.0, "clearance": 0.0, "x0": 0.0, "v0": 0.0},
)
WIDTHS = {"section": 20, "impact": 3, "sample": 6}


def spec_of(widths=WIDTHS, diagnostics=DIAGNOSTICS):
    """Return a RunSpec whose records have these widths."""
    return RunSpec(
        integrator="exact",
        impact="exact",
        steps_per_period=widths["sample"] - 1,
        transient=10,
        longest=100,
        periods=widths["section"],
        phase=0.0,
        impacts=widths["impact"],
        lyapunov="lyapunov" in diagnostics,
        period="period" in diagnostics,
        every=widths["section"] if widths["sample"] else None,
        scaled=False,
        followed=None,
        directions=(),
    )


def schema(
    grid=GRID,
    *,
    block_size=2,
    widths=WIDTHS,
    diagnostics=DIAGNOSTICS,
    configuration=CONFIGURATION,
    numerics="1",
):
    return Schema.of(
        grid,
        grid.blocks(block_size),
        spec_of(widths, diagnostics),
        {"name": "a test", "configuration": configuration, "numerics": numerics},
    )


def results(block, samples=None, widths=WIDTHS):
    """Return random results of a block; the length of trajectories differs between blocks."""
    seed = [cut.start for cut in block]
    samples = 4 + 3 * sum(seed) if samples is None else samples
    return random_results(block_points(block), {**widths, "sample": samples}, seed)


def fill_blocks(path, blocks=None, compressed=False, **options):
    """Write the first pending blocks, all by default; finish the file if none is left."""
    return fill(path, schema(), results, blocks, compressed, **options)


def contents(folder=Path("out.h5.parts")):
    """Return the bytes of a file, or of each file in a folder by its name."""
    if folder.is_file():
        return folder.read_bytes()
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def whole(grid=GRID, samples=6):
    """Return the results of every point, shaped like the grid."""
    arrays = results(tuple(slice(0, n) for n in grid.shape), samples)
    return {name: array.reshape(*grid.shape, *array.shape[1:]) for name, array in arrays.items()}


def part(arrays, block):
    """Return the results of a block from the results of every point."""
    return {
        name: array[block].reshape(block_points(block), *array.shape[len(block) :])
        for name, array in arrays.items()
    }


def assert_holds(dataset, arrays, where=...):
    """Compare the results of a sweep at some points bit for bit."""
    for name in dataset.data_vars:
        np.testing.assert_array_equal(dataset[name].values[where], arrays[name][where])
    assert set(dataset.data_vars) <= set(VARIABLES)


# Random numbers for pictures

FIXED = {"h": 0.1, "R": 0.8, "omega": 2.0, "f": 1.0, "p": 1.0, "clearance": 0.25, "x0": 0, "v0": 0}
OMEGA = np.array([0.8, 1.0, 1.5, 4.0])
R = np.array([0.5, 0.8])
SAMPLES = 40


def random_numbers(points, widths, seed=0):
    arrays = random_results(points, widths, seed, scale=1.0)
    random = np.random.default_rng(seed + 1)
    arrays["period"] = random.integers(0, 3, points)
    arrays["rest_fraction"] = random.integers(0, 2, points) / 4.0
    arrays["impact_v"][..., -1:] = np.nan
    np.minimum(arrays["poincare_x"], FIXED["clearance"], out=arrays["poincare_x"])
    return arrays
