"""Files with random results in place of computed ones, written block by block or for pictures."""

import resource
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from sweeps import load_config, open_sweep
from sweeps.config.groups import DIAGNOSTICS
from sweeps.grid import Grid, Sweep, block_points
from sweeps.store.schema import Schema
from sweeps.store.variables import VARIABLES
from sweeps.store.writer import sweep_writer
from vibroimpact.points.stages import RunSpec

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
        extremes="extremes" in diagnostics,
    )


def schema(grid=GRID, *, block_size=2, widths=WIDTHS, diagnostics=DIAGNOSTICS,
           configuration=CONFIGURATION, numerics="1"):  # fmt: skip
    sweep = Sweep(grid, spec_of(widths, diagnostics))
    plan = Schema.of(sweep, block_size, "a test", configuration, {}, {})
    plan.attributes["numerics"] = numerics
    return plan


def planned(config, size):
    """Return the schema of a run of a configuration, in blocks of about `size` points."""
    text = config.to_yaml(table=False)
    return Schema.of(config.sweep, size, config.name, text, {}, config.column_units)


#: Four blocks of few variables, for tests in which any of the calls for each file fails.
FOUR_BLOCKS = schema(block_size=3, diagnostics=(), widths={"section": 20, "impact": 0, "sample": 0})


def random_results(points, widths, seed=0, scale=100.0):
    """Return random numbers for every variable, and status 0.

    `widths` has the width of each record dimension; `scale` is the standard deviation.
    """
    random = np.random.default_rng(seed)
    arrays = {}
    for name, variable in list(VARIABLES.items())[:-1]:  # without the status
        width = {**widths, "exponent": 2, None: None}[variable.dimension]
        shape = (points,) if width is None else (points, width)
        arrays[name] = random.normal(scale=scale, size=shape).astype(variable.dtype)
    arrays["status"] = np.zeros(points, np.int8)
    return arrays


def block_results(block, samples=None, widths=WIDTHS):
    """Return random results of a block; the length of trajectories differs between blocks."""
    seed = [cut.start for cut in block]
    samples = 4 + 3 * sum(seed) if samples is None else samples
    return random_results(block_points(block), {**widths, "sample": samples}, seed)


@contextmanager
def begun(path, plan, *, resume=False):
    """Begin a sweep anew, or resume it; yield its writer and the blocks to write."""
    with sweep_writer(Path(path), overwrite=not resume, resume=resume) as store:
        yield store, store.begin(plan)


def fill_blocks(
    path, blocks=None, compressed=False, *, plan=None, results=block_results, **options
):
    """Write `results(block)` for the first pending blocks, all by default; then finish the file.

    A file with pending blocks is left incomplete. Returns the number of damaged blocks.
    """
    with sweep_writer(Path(path), **options) as store:
        pending = store.begin(schema() if plan is None else plan)
        if pending is None:
            return 0
        for block in pending[:blocks]:
            store.write(block, results(block))
        if blocks is None or blocks >= len(pending):
            store.finish(compressed=compressed)
        return store.damaged


def fill_disk(size=0):
    """Limit the size of files, until the end of `room_again`."""
    resource.setrlimit(
        resource.RLIMIT_FSIZE, (int(size), resource.getrlimit(resource.RLIMIT_FSIZE)[1])
    )


@contextmanager
def room_again():
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def contents(folder=Path("out.h5.parts")):
    """Return the bytes of a file, or of each file in a folder by its name."""
    if folder.is_file():
        return folder.read_bytes()
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def grid_results(grid=GRID, samples=6):
    """Return the results of every point, shaped like the grid."""
    arrays = block_results(tuple(slice(0, n) for n in grid.shape), samples)
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


def picture_results(points, widths, seed=0):
    arrays = random_results(points, widths, seed, scale=1.0)
    random = np.random.default_rng(seed + 1)
    arrays["period"] = random.integers(0, 3, points)
    arrays["rest_fraction"] = random.integers(0, 2, points) / 4.0
    arrays["impact_v"][..., -1:] = np.nan
    np.minimum(arrays["poincare_x"], FIXED["clearance"], out=arrays["poincare_x"])
    arrays["trajectory_t"].sort()
    return arrays


@contextmanager
def random_sweeps(folder):
    """Yield a function that writes a sweep of random numbers and opens it."""
    opened = []

    def make(axes, *, sections=5, impacts=3, with_trajectory=True, fixed=FIXED, diagnostics=(),
             name="a test", phase=0.5, **changed):  # fmt: skip
        fixed = {key: value for key, value in fixed.items() if key not in axes}
        grid = Grid({key: np.asarray(values, float) for key, values in axes.items()}, fixed)
        values = {**fixed, **axes}
        configuration = {
            "name": name,
            "start": {key: values.pop(key) for key in ("x0", "v0")},
            "oscillator": values,
            "method": {"integrator": "newmark", "impact": "cubic", "steps_per_period": 64},
            "record": {"transient": 1000, "periods": 7, "phase": phase},
        }
        widths = {"section": sections, "impact": impacts, "sample": SAMPLES * with_trajectory}
        path = folder / f"{len(opened)}.h5"
        sweep = Sweep(grid, spec_of(widths, diagnostics))
        text = load_config(configuration).to_yaml()
        schema = Schema.of(sweep, grid.size, name, text, {}, {})
        with begun(path, schema) as (store, _):
            results = {**picture_results(grid.size, widths), **changed}
            store.write(tuple(slice(0, n) for n in grid.shape), results)
            store.finish()
        opened.append(open_sweep(path))
        return opened[-1]

    yield make
    for dataset in opened:
        dataset.close()
