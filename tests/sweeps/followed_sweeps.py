"""A sweep that is followed up and down, and its data."""

from sweep_files import data, load
from sweeps import run_sweep

SWEEP = {
    "oscillator": {
        "h": 0.05,
        "R": [0.8, 0.5, 0.6],
        "omega": [2.7, 0.6, 2.4, 2.65, 1.3],
        "f": 1.0,
        "clearance": [0.0, 0.4],
    },
    "follow": {"axis": "omega", "direction": "both"},
    "record": {
        "transient": 7,
        "periods": 6,
        "impacts": 5,
        "trajectory": {"every": 6},
        "diagnostics": ["period", "lyapunov"],
    },
}


def configured(*changes, sweep=SWEEP):
    return load(sweep, *changes)


def whole(config):
    """The block of the whole file of a sweep."""
    block = tuple(slice(0, n) for n in config.grid.shape)
    return (slice(0, 2), *block) if len(config.directions) == 2 else block


def ran(config, path="out.h5"):
    return data(run_sweep(config, path, overwrite=True))
