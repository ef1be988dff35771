"""A map over (R, omega) whose results are set by hand, and what a picture of it shows."""

import numpy as np
import xarray as xr
from matplotlib.colors import to_hex

from sweeps import load_config
from sweeps.store.variables import VARIABLES
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Evidence, Status

R = np.array([0.3, 0.5, 0.9])
OMEGA = np.array([1.0, 2.0, 3.0, 4.0])
PERIODS = 50
CONFIG = load_config({
    "name": "by hand",
    "oscillator": {"h": 0.1, "R": 0.8, "omega": 2.0, "f": 1.0, "clearance": 0.25},
    "method": {"integrator": "exact", "impact": "exact", "steps_per_period": 16},
    "record": {"transient": 10, "periods": 50, "phase": 0.0},
})  # fmt: skip
TEXT = CONFIG.to_yaml()
#: Values of a point of period 1 with one impact.
PLAIN = {"status": Status.CERTIFIED, "period": 1, "period_impacts": 1}
PLAIN |= {"orbit_x": 0.0, "orbit_v": 0.0, "orbit_distance": 0.0}
PLAIN |= {"class_evidence": Evidence.REPEATS, "rest_fraction": 0.0, "impacts_per_period": 1.0}
PLAIN |= {"slowest_impact": 0.5, "fastest_impact": 0.5, "impulse": 0.9, "energy_lost": 0.045}
PLAIN |= {"max_penetration": 0.0, "lyapunov": -0.3}


def equal_points(omit=(), axes=None, **changed):
    """Return equal points over (R, omega) with changes {name: {(row, column): value}}."""
    axes = {"R": R, "omega": OMEGA} if axes is None else axes
    shape = tuple(len(values) for values in axes.values())
    data = {}
    for name, value in PLAIN.items():
        if name not in omit:
            values = np.full(shape, value, np.dtype(VARIABLES[name].dtype))
            for at, other in changed.get(name, {}).items():
                values[at] = other
            data[name] = (tuple(axes), values)
    if "lyapunov" in data:
        data["lyapunov"] = (*axes, "exponent"), np.stack(2 * [data["lyapunov"][1]], axis=-1)
    data["poincare_x"] = ((*axes, "section"), np.zeros((*shape, PERIODS)))
    points = xr.Dataset(data, {**CONFIG.sweep.grid.fixed, **axes}, {"configuration": TEXT})
    for name in [*axes, *data]:
        about = PARAMETERS.get(name) or VARIABLES[name]
        attrs = {"long_name": about.meaning, "units": about.unit, "symbol": about.symbol}
        points.variables[name].attrs = attrs
    return points


def colours(figure):
    """Return the colour of every cell, as drawn last; None where none was drawn."""
    meshes = figure.axes[0].collections
    shape = meshes[0].get_array().shape
    found = np.full(shape, None)
    for mesh in meshes:
        array = mesh.get_array()
        rgba = mesh.to_rgba(array)
        for at in np.ndindex(shape):
            if not np.ma.getmaskarray(array)[at]:
                found[at] = to_hex(rgba[at])
    return found


def legend(figure):
    """Return the colours of the patches of a legend by their labels."""
    if not figure.legends:
        return {}
    (one,) = figure.legends
    handles = zip(one.get_texts(), one.get_patches(), strict=False)  # lines come last
    return {text.get_text(): to_hex(patch.get_facecolor()) for text, patch in handles}


def legend_texts(figure):
    """Return the texts of the legends below the panels."""
    return [text.get_text() for one in figure.legends for text in one.get_texts()]


def texts(figure):
    """Return the label of every cell, through its colour."""
    names = {colour: text for text, colour in legend(figure).items()}
    return np.vectorize(lambda colour: names.get(colour))(colours(figure))
