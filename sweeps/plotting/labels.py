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
from sweeps.store import DIRECTION, is_remarkable
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status


def label(variable: xr.DataArray, gap: str = " ") -> str:
    """Write the meaning, symbol and unit of a variable, the first two with `gap` between them."""
    attributes = variable.attrs
    units = attributes["units"]
    unit = "" if units == "1" else f" [{units.replace('^2', '$^2$')}]"
    return f"{attributes['long_name']}{gap}${attributes['symbol']}${unit}"


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


def add_title(figure: Figure, setting: Setting, drawn: xr.Dataset, width: int) -> None:
    """Put the sweep's name, the fixed parameters and the method above the panels.

    Parameters
    ----------
    figure : Figure
    setting : Setting
    drawn : Dataset
        What the figure shows of the sweep.
    width : int
        Letters of a line.
    """
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
    """Say along which axis the points of a picture were followed, and in which directions."""
    names = drawn[DIRECTION] if DIRECTION in drawn.coords else setting.follow[DIRECTION]
    symbol = PARAMETERS[setting.follow["axis"]].symbol
    return f"followed {' and '.join(np.atleast_1d(names))} along ${symbol}$"


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


def mathtext(value: float) -> str:
    """Write a number in mathtext, where 1e+300 would be a product."""
    mantissa, e, exponent = f"{value:.6g}".partition("e")
    return rf"{mantissa} \times 10^{{{int(exponent)}}}" if e else mantissa
