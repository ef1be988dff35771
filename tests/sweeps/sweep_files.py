"""Configurations and files of sweeps as tests make and read them."""

from pathlib import Path

import numpy as np
import yaml

from sweeps import load_config, open_sweep, run_sweep
from sweeps.store import VARIABLES, sweep_writer


def load(configuration, *overrides, path="sweep.yaml"):
    """Write a configuration, a text or a mapping, to a file, and load it from there."""
    if not isinstance(configuration, str):
        configuration = yaml.safe_dump(configuration, sort_keys=False)
    Path(path).write_text(configuration, encoding="utf-8")
    return load_config(path, overrides)


def run_in(folder, configuration, *overrides, name="out.h5", **options):
    """Run a configuration in a folder, and return the path of the file."""
    config = load(configuration, *overrides, path=folder / "c.yaml")
    return run_sweep(config, folder / name, **options)


def data(path):
    """Return what a file holds, without its attributes, which tell when it was written."""
    with open_sweep(path) as dataset:
        dataset.load()
    return dataset.drop_attrs(deep=False)


def random_results(points, widths, seed=0, scale=100.0):
    """Return random numbers for every variable, and the status 0.

    `widths` are those of the record dimensions; `scale` is the standard deviation.
    """
    random = np.random.default_rng(seed)
    arrays = {}
    for name, variable in list(VARIABLES.items())[:-1]:  # without the status
        width = {**widths, "exponent": 2, None: None}[variable.record]
        shape = (points,) if width is None else (points, width)
        arrays[name] = random.normal(scale=scale, size=shape).astype(variable.dtype)
    arrays["status"] = np.zeros(points, np.int8)
    return arrays


def fill(path, schema, results, blocks=None, compressed=False, **options):
    """Write so many of the pending blocks, each with `results` of it; finish where that are all.

    Returns how many blocks were damaged.
    """
    with sweep_writer(path, schema, **options) as store:
        for block in store.pending()[:blocks]:
            store.write(block, results(block))
        if not store.pending():
            store.finish(compressed=compressed)
        return store.damaged
