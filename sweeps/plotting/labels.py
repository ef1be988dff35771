"""The words of a picture: axis labels and scales, and the title."""

from __future__ import annotations

import re
from textwrap import fill

import numpy as np
import xarray as xr
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from sweeps.analysis.selection import Setting
from sweeps.plotting.marks import mathtext
from sweeps.store.variables import DIRECTION, is_remarkable
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status


def label(variable: xr.DataArray, gap: str = " ") -> str:
    """Write meaning, symbol and unit."""
    about = variable.attrs
    unit = "" if about["units"] == "1" else f" [{about['units'].replace('^2', '$^2$')}]"
    return f"{about['long_name']}{gap}${about['symbol']}${unit}"


def log_spaced(values: np.ndarray) -> bool:
    """Whether neighbours have a constant ratio, over a range wide enough for a log axis."""
    if len(values) < 3 or values.min() <= 0.0 or values.max() < 5.0 * values.min():
        return False
    ratios = values[1:] / values[:-1]
    return np.allclose(ratios, ratios[0], rtol=1e-6)


def set_scale(axis: Axis, values: np.ndarray) -> None:
    """Make an axis logarithmic if the values along it are so spaced."""
    if log_spaced(values):
        panel = axis.axes
        (panel.set_xscale if axis is panel.xaxis else panel.set_yscale)("log")
        tick_in_decades(axis)


def tick_in_decades(axis: Axis) -> None:
    """Label 1, 2 and 5 of every decade, as plain numbers."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def entitle(figure: Figure, setting: Setting, drawn: xr.Dataset, width: int) -> None:
    """Put the sweep's name, the parameters of what is drawn, and the method above it."""
    parameters = [
        f"${PARAMETERS[name].symbol} = {mathtext(setting.value(name, drawn))}$"
        for name in PARAMETERS
        if name not in drawn.dims
    ]
    if setting.follow:
        parameters.append(_followed(setting, drawn))
    method = setting.method
    words = (
        f"integrator {method['integrator']}, impact rule {method['impact']}, "
        f"{method['steps_per_period']} steps per period"
    )
    if not drawn["status"].dims:
        status = Status(int(drawn["status"]))
        words += f"\n{fill(status.meaning, width)}" if is_remarkable(status) else ""
    name = fill(setting.name, width).replace("$", r"\$")
    figure.suptitle(f"{name}\n{_joined(parameters, width)}\n{words}", fontsize=8.5)


def _followed(setting: Setting, drawn: xr.Dataset) -> str:
    """Say along which axis the points of a picture were followed, and which way."""
    ways = np.atleast_1d(
        drawn[DIRECTION] if DIRECTION in drawn.coords else setting.follow[DIRECTION]
    )
    return f"followed {' and '.join(ways)} along ${PARAMETERS[setting.follow['axis']].symbol}$"


def _joined(formulas: list[str], width: int) -> str:
    """Join formulas into lines of about `width` letters as printed."""
    lines: list[list[str]] = [[]]
    used = 0
    for formula in formulas:
        printed = len(re.sub(r"\\\w+|_", "", formula))
        if used + printed > width:
            lines.append([])
            used = 0
        lines[-1].append(formula)
        used += printed
    return "\n".join(", ".join(line) for line in lines)
