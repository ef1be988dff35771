"""A small sweep, with results that depend on the block alone, as tests write it."""

import numpy as np

from sweep_files import fill, random_results
from sweeps.grid import Grid, block_points
from sweeps.store.layout import Layout

GRID = Grid({"R": np.array([0.5, 0.8]), "omega": np.linspace(1.0, 4.0, 6)}, {})


WIDTHS = {"section": 50, "impact": 3, "sample": 6}


def layout(configuration="oscillator: {h: 0.1}\n", numerics="1", grid=GRID, block_size=2):
    return Layout.of(
        grid,
        grid.blocks(block_size),
        attributes={"name": "a test", "configuration": configuration, "numerics": numerics},
        widths=WIDTHS,
        first_section=1,
        diagnostics=("period", "lyapunov"),
    )


def results(block, samples=None):
    """Results that depend on the block alone; its trajectories too have their own length."""
    seed = [cut.start for cut in block]
    samples = 4 + 3 * sum(seed) if samples is None else samples
    return random_results(block_points(block), {**WIDTHS, "sample": samples}, seed)


def fill_blocks(path, blocks=None, compressed=False, **options):
    """Write that many of the pending blocks; finish the file where it is complete."""
    return fill(path, layout(), results, blocks, compressed, **options)
