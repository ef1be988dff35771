"""A configuration for a local cluster, and the comparison of its files with those of threads."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import xarray as xr

from tests.helpers.commands import refused
from tests.helpers.sweep_files import data, run_in

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


@cache
def alone(*overrides):
    """Return the data of a run without the cluster."""
    with TemporaryDirectory() as folder:
        return data(run_in(Path(folder), CLUSTERED, *overrides))


def assert_same_bits(path, *overrides):
    """Compare a file bit for bit with a run without the cluster."""
    xr.testing.assert_identical(data(path), alone(*overrides))
