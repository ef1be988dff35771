"""Configurations and files of sweeps for tests: followed, over starts."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import yaml

from sweeps import load_config, open_sweep, run_sweep
from sweeps.errors import ConfigError
from sweeps.store import VARIABLES, only_writer, sweep_writer
from vibroimpact.status import Evidence, Status


def load(configuration, *overrides, path="sweep.yaml"):
    """Write a configuration, given as text or mapping, to a file, and load that file."""
    if not isinstance(configuration, str):
        configuration = yaml.safe_dump(configuration, sort_keys=False)
    Path(path).write_text(configuration, encoding="utf-8")
    return load_config(path, overrides)


def run_in(folder, configuration, *overrides, name="out.h5", **options):
    """Run a configuration in a folder, and return the path of the file."""
    config = load(configuration, *overrides, path=folder / "c.yaml")
    return run_sweep(config, folder / name, **options)


def data(path):
    """Return the data of a file without attributes, which include the time of writing."""
    with open_sweep(path) as dataset:
        dataset.load()
    return dataset.drop_attrs(deep=False)


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


def fill(path, schema, results, blocks=None, compressed=False, **options):
    """Write `results(block)` for the first pending blocks; finish the file if none is left.

    Returns the number of damaged blocks.
    """
    with (
        only_writer(Path(path), **options),
        sweep_writer(path, schema, resume=options.get("resume", False)) as store,
    ):
        if store is None:
            return 0
        for block in store.pending()[:blocks]:
            store.write(block, results(block))
        if not store.pending():
            store.finish(compressed=compressed)
        return store.damaged


# A valid configuration, and the messages for invalid ones

EXAMPLE = """\
name: frequency-bifurcation
oscillator: {h: 0.1, R: 0.8, omega: {start: 0.8, stop: 4.0, num: 4096}, f: 1.0}
start: {x0: 0.0, v0: 0.0}
method: {integrator: exact, impact: exact, steps_per_period: null}
output: results/frequency.h5
record: {transient: 1000, periods: 100, phase: 0.0, impacts: 64, trajectory: false,
         diagnostics: [period]}
"""


OSCILLATOR = {"h": "0.1", "R": "0.8", "omega": "2.0", "f": "1.0"}


def refusal(text, overrides=()):
    """Return the message for a configuration that must be refused."""
    with pytest.raises(ConfigError) as caught:
        load(text, *overrides)
    message = str(caught.value)
    for jargon in ("Input should", "type=", "input_value", "errors.pydantic.dev", "<mapping>"):
        assert jargon not in message
    return message


def oscillator(**values):
    """Return a one-line configuration with these values; the others are valid."""
    items = ", ".join(f"{name}: {value}" for name, value in (OSCILLATOR | values).items())
    return f"oscillator: {{{items}}}\n"


# A sweep that is followed up and down, and its data

FOLLOWED = {
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


def configured(*changes, sweep=FOLLOWED):
    return load(sweep, *changes)


def full_block(config):
    """Return the block of all points of a sweep, in both directions if it has them."""
    block = tuple(slice(0, n) for n in config.sweep.grid.shape)
    return (slice(0, 2), *block) if len(config.sweep.spec.directions) == 2 else block


def ran(config, path="out.h5"):
    return data(run_sweep(config, path, overwrite=True))


# Sweeps over starts: a configuration, and artificial points

OVER_STARTS = """\
oscillator: {h: 0.0, R: 0.8, omega: 1.3, f: 1.0}
start: {x0: {start: -2.4, stop: 0.0, num: 9}, v0: {start: -2.0, stop: 2.0, num: 9}}
record: {transient: 400, periods: 32, impacts: 12, diagnostics: [period, lyapunov]}
"""


def hand_made(sections, periods, axes=("x0",), **changed):
    """Return artificial points with these section states, shape (points..., record, 2)."""
    sections = np.asarray(sections, float)
    shape = sections.shape[: len(axes)]
    periods = np.broadcast_to(periods, shape)
    config = load_config(
        {
            "oscillator": {"h": 0.1, "R": 0.8, "omega": 1.0, "f": 1.0},
            "method": {"integrator": "rk4", "impact": "cubic"},
        }
    )
    values = {"status": np.full(shape, Status.CERTIFIED), "rest_fraction": np.zeros(shape)}
    values["chatters"] = np.zeros(shape, int)
    values |= {"period": periods, "period_impacts": periods, "orbit_distance": np.zeros(shape)}
    values["class_evidence"] = np.where(periods > 0, Evidence.REPEATS, Evidence.NONE)
    values |= {"orbit_x": sections[..., -1, 0], "orbit_v": sections[..., -1, 1], **changed}
    data = {name: (axes, np.asarray(value)) for name, value in values.items()}
    for i, name in enumerate(("poincare_x", "poincare_v")):
        data[name] = ((*axes, "section"), sections[..., i])
    coords = {name: np.arange(n) / 10.0 for name, n in zip(axes, shape, strict=True)}
    return xr.Dataset(data, {**config.sweep.grid.fixed, **coords}, {"configuration": config})


def partition(labels):
    """Return the set of points of each label; negative labels are ignored."""
    labels = np.asarray(labels).ravel()
    return {frozenset(np.flatnonzero(labels == one)) for one in np.unique(labels[labels >= 0])}


# The section states of a periodic motion


def cycle(*states, turns=8):
    return np.tile(states, (turns, 1))
