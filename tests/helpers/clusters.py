"""A configuration for a local cluster, and the comparison of its files with those of threads."""

from pathlib import Path

import xarray as xr

from sweeps import run_sweep
from tests.helpers.commands import refused
from tests.helpers.configurations import load
from tests.helpers.sweep_files import data

CLUSTERED = """\
oscillator: {h: 0.05, R: 0.8, omega: {start: 2.4, stop: 3.5, num: 300, spacing: log}, f: 1.0}
record: {transient: 20, periods: 10, impacts: 4}
"""
WORKERS = 2


def refused_run(*arguments):
    """Run a sweep that must be refused with one line of text, and return it."""
    message = refused("run", "sweep.yaml", "-o", "out.h5", *arguments)
    assert message.count("\n") == 1
    return message


def assert_same_bits(path):
    """Compare a file bit for bit with a run without the cluster."""
    if not Path("here.h5").exists():
        run_sweep(load(CLUSTERED), "here.h5")
    xr.testing.assert_identical(data(path), data("here.h5"))
