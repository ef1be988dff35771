"""Sweeps over starts: a configuration, and points made by hand."""

import numpy as np
import xarray as xr

from sweeps import load_config
from vibroimpact.status import Status

CONFIG = """\
oscillator: {h: 0.0, R: 0.8, omega: 1.3, f: 1.0}
start: {x0: {start: -2.4, stop: 0.0, num: 9}, v0: {start: -2.0, stop: 2.0, num: 9}}
record: {transient: 400, periods: 32, impacts: 12, diagnostics: [period, lyapunov]}
"""


def hand_made(sections, periods, axes=("x0",), **changed):
    """Return points with these last section states, shape (points..., record, 2)."""
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
    values |= {"period": periods, "period_impacts": periods, **changed}
    data = {name: (axes, np.asarray(value)) for name, value in values.items()}
    for i, name in enumerate(("poincare_x", "poincare_v")):
        data[name] = ((*axes, "section"), sections[..., i])
    coords = {name: np.arange(n) / 10.0 for name, n in zip(axes, shape, strict=True)}
    return xr.Dataset(data, {**config.grid.fixed, **coords}, {"configuration": config})


def partition(labels):
    """Return the sets of points with one label each, without those of none."""
    labels = np.asarray(labels).ravel()
    return {frozenset(np.flatnonzero(labels == one)) for one in np.unique(labels[labels >= 0])}


# What is one attractor


def cycle(*states, turns=8):
    return np.tile(states, (turns, 1))
