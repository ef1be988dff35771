"""The words of a picture: axis labels and scales, and the title."""

from __future__ import annotations

from textwrap import fill

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from sweeps.analysis.selection import Setting
from sweeps.plotting.canvas import Page, Picture, figure_of, printed_width
from sweeps.plotting.quantity_words import label
from sweeps.store import DIRECTION, is_remarkable
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status

#: Letters of a line of the label beside a colour bar.
_BAR_LABEL = 36
#: What a title leaves free of the width of a figure [inch].
_TITLE_MARGIN = 0.1
#: In a narrower figure an ordinate has its label in two lines [inch].
_NARROW = 4.2


def label_colour_bar(bar: Colorbar, variable: xr.DataArray) -> None:
    """Label a colour bar, in several lines if the words are long."""
    words = variable.attrs["long_name"]
    gap = "\n" if len(words) > _BAR_LABEL - 12 else " "  # about what symbol and unit take
    bar.set_label(label(variable.assign_attrs(long_name=fill(words, _BAR_LABEL)), gap))


def label_ordinate(panel: Axes, variable: xr.DataArray) -> None:
    """Label the ordinate of a panel, in two lines if the picture is narrow."""
    narrow = isinstance(figure := figure_of(panel), Picture) and figure.get_figwidth() < _NARROW
    panel.set_ylabel(label(variable, "\n" if narrow else " "))


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


def add_title(panel: Axes, page: Page, drawn: xr.Dataset, record: str | None = None) -> Figure:
    """Put name, fixed parameters and record of the sweep above a `Picture`; return the figure.

    A panel of another figure has no title, unless the page has one.

    Parameters
    ----------
    panel : Axes
    page : Page
    drawn : Dataset
        What the picture shows of the sweep.
    record : str, optional
        What was recorded, by default phase, transient and periods.
    """
    figure = figure_of(panel)
    if not isinstance(figure, Picture):
        if page.title is not None:
            panel.set_title(page.title)
        return figure
    width = figure.letters("figure.titlesize")
    if page.title is not None:
        text = "\n".join(fill(line, width) for line in page.title.split("\n"))
    else:
        text = _title(Setting.of(drawn), drawn, record, figure)
    if text:
        figure.make_room(text.count("\n") - 2)
        figure.suptitle(text)
    return figure


def _title(setting: Setting, drawn: xr.Dataset, record: str | None, figure: Picture) -> str:
    """Write the title of a cut through a sweep, in lines that fit a figure."""
    width = figure.letters("figure.titlesize")
    parameters = [
        f"${PARAMETERS[name].symbol} = {mathtext(setting.value(name, drawn))}$"
        for name in PARAMETERS
        if name not in drawn.dims
    ]
    if not {"x0", "v0"} & set(drawn.dims):
        parameters[-2:] = [", ".join(parameters[-2:])]  # a start is not torn apart
    if setting.follow:
        parameters.append(_followed(setting, drawn))
    if record is None:
        transient, periods = (setting.record.get(name, 0) for name in ("transient", "periods"))
        record = f"phase {setting.phase:.6g} rad, "
        record += f"transient {transient:,}, record {periods:,} periods"
    name = fill(setting.name, width).replace("$", r"\$")
    lines = [name, _joined(parameters, figure.get_figwidth()), fill(record, width)]
    if not drawn["status"].dims and is_remarkable(status := Status(int(drawn["status"]))):
        lines.append(fill(status.meaning, width))
    return "\n".join(lines)


def _followed(setting: Setting, drawn: xr.Dataset) -> str:
    """Say along which axis the points of a picture were followed, and in which directions."""
    names = drawn[DIRECTION] if DIRECTION in drawn.coords else setting.follow[DIRECTION]
    symbol = PARAMETERS[setting.follow["axis"]].symbol
    return f"followed {' and '.join(np.atleast_1d(names))} along ${symbol}$"


def _joined(formulas: list[str], width: float) -> str:
    """Join formulas into lines that are printed within a width [inch]."""
    lines = [""]
    for formula in formulas:
        longer = f"{lines[-1]}, {formula}" if lines[-1] else formula
        if printed_width(longer, "figure.titlesize") <= width - _TITLE_MARGIN:
            lines[-1] = longer
        else:
            lines.append(formula)
    return "\n".join(lines)


def mathtext(value: float) -> str:
    """Write a number in mathtext, where 1e+300 would be a product."""
    mantissa, e, exponent = f"{value:.6g}".partition("e")
    return rf"{mantissa} \times 10^{{{int(exponent)}}}" if e else mantissa
