"""A small grid, its layout, and files of random results for it."""

import numpy as np

from sweep_files import random_results
from sweeps.config.schema import DIAGNOSTICS
from sweeps.grid import Grid
from sweeps.store.layout import Layout
from sweeps.store.writer import sweep_writer

CONFIGURATION = "oscillator: {h: 0.1}\n"
GRID = Grid(
    {"R": np.array([0.8, 0.5]), "omega": np.geomspace(0.8, 4.0, 5)},
    {"h": 0.1, "f": 1.0, "p": 1.0, "clearance": 0.0, "x0": 0.0, "v0": 0.0},
)
WIDTHS = {"section": 4, "impact": 3, "sample": 6}


def layout(grid=GRID, *, widths=WIDTHS, diagnostics=DIAGNOSTICS, block_size=10):
    return Layout.of(
        grid,
        grid.blocks(block_size),
        attributes={"name": "a test", "configuration": CONFIGURATION, "numerics": "0"},
        widths=widths,
        first_section=11,
        diagnostics=diagnostics,
    )


def lay_out(path, *args, **kwargs):
    """Write a file without data."""
    with sweep_writer(path, layout(*args, **kwargs), overwrite=True):
        pass


def results(points, samples=6, widths=WIDTHS, seed=0):
    return random_results(points, {**widths, "sample": samples}, seed)


def whole(grid, seed=0, samples=6):
    """Results of every point, shaped like the grid."""
    return {
        name: array.reshape(*grid.shape, *array.shape[1:])
        for name, array in results(grid.size, samples, seed=seed).items()
    }


def part(expected, block):
    """The results of a block, out of those of every point."""
    return {
        name: array[block].reshape(-1, *array.shape[len(block) :])
        for name, array in expected.items()
    }


def write_blocks(path, expected, *, size=10, backwards=False, compressed=False):
    with sweep_writer(path, layout(block_size=size)) as store:
        for block in store.pending()[:: -1 if backwards else 1]:
            store.write(block, part(expected, block))
        store.finish(compressed=compressed)
