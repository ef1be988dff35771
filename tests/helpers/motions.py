"""Points whose motions are given, to be told apart as attractors."""

import numpy as np
import xarray as xr

from sweeps import load_config
from vibroimpact.status import Evidence, Status


def given_sections(sections, periods, axes=("x0",), **changed):
    """Return artificial points with these section states, shape (points..., record, 2)."""
    sections = np.asarray(sections, float)
    shape = sections.shape[: len(axes)]
    periods = np.broadcast_to(periods, shape)
    scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": 1.0, "f": 1.0}}
    config = load_config(scene | {"method": {"integrator": "rk4", "impact": "cubic"}})
    values = {"status": np.full(shape, Status.CERTIFIED), "rest_fraction": np.zeros(shape)}
    values["chatters"] = np.zeros(shape, int)
    values |= {"period": periods, "period_impacts": periods, "orbit_distance": np.zeros(shape)}
    values["class_evidence"] = np.where(periods > 0, Evidence.REPEATS, Evidence.NONE)
    values |= {"orbit_x": sections[..., -1, 0], "orbit_v": sections[..., -1, 1], **changed}
    data = {name: (axes, np.asarray(value)) for name, value in values.items()}
    for i, name in enumerate(("poincare_x", "poincare_v")):
        data[name] = ((*axes, "section"), sections[..., i])
    coords = {name: np.arange(n) / 10.0 for name, n in zip(axes, shape, strict=True)}
    coords = {**config.sweep.grid.fixed, **coords}
    return xr.Dataset(data, coords, {"configuration": config.to_yaml()})


def partition(labels):
    """Return the set of points of each label; negative labels are ignored."""
    labels = np.asarray(labels).ravel()
    return {frozenset(np.flatnonzero(labels == one)) for one in np.unique(labels[labels >= 0])}


def cycle(*states, turns=8):
    return np.tile(states, (turns, 1))
