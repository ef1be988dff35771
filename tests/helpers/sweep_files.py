"""Runs of a configuration, and the data of their files."""

from pathlib import Path

from sweeps import open_sweep, run_sweep
from tests.helpers.configurations import load


def run_in(folder, configuration, *overrides, name="out.h5", **options):
    """Run a configuration in a folder, and return the path of the file."""
    config = load(configuration, *overrides, path=folder / "c.yaml")
    return run_sweep(config, folder / name, **options)


def swept(configuration, *overrides):
    """Run a configuration in the folder of the test, and return the data of the file."""
    path = run_in(Path(), configuration, *overrides, name="swept.h5", overwrite=True)
    with open_sweep(path) as dataset:
        return dataset.load()


def data(path):
    """Return the data of a file without attributes, which include the time of writing."""
    with open_sweep(path) as dataset:
        dataset.load()
    return dataset.drop_attrs(deep=False)


def run_and_read(config, path="out.h5"):
    return data(run_sweep(config, path, overwrite=True))
