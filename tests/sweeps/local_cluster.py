"""A configuration for a cluster of this machine, and requests that it must refuse."""

from pathlib import Path

import xarray as xr

from commands import refused
from sweep_files import data, load
from sweeps import run_sweep

CONFIG = """\
oscillator: {h: 0.05, R: 0.8, omega: {start: 2.4, stop: 3.5, num: 300, spacing: log}, f: 1.0}
record: {transient: 20, periods: 10, impacts: 4}
"""
WORKERS = 2


def refused_run(*arguments):
    """Run a sweep that must be refused in one line, and return the message."""
    message = refused("run", "sweep.yaml", "-o", "out.h5", *arguments)
    assert message.count("\n") == 1
    return message


def assert_same_bits(path):
    """Compare a file with that of a run on this machine alone."""
    if not Path("here.h5").exists():
        run_sweep(load(CONFIG), "here.h5")
    xr.testing.assert_identical(data(path), data("here.h5"))
