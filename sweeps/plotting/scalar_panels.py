"""Panels below a bifurcation diagram: numbers of each point over the same axis."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from sweeps.analysis.selection import listed
from sweeps.errors import Refused
from sweeps.plotting.lines import scalars
from sweeps.plotting.palette import DIRECTION_COLOURS
from sweeps.plotting.quantity_words import label

#: Letters of a line of the label beside a panel.
_LABEL_WIDTH = 16


def check_scalars(dataset: xr.Dataset, names: Sequence[str]) -> None:
    """Refuse names that are no scalars of the file, or given twice."""
    available = scalars(dataset)
    for name in names:
        if name not in available:
            raise Refused(
                f"{name or repr(name)} cannot be drawn below a diagram; choose from: "
                f"{listed(available)}"
            )
        if names.count(name) > 1:
            raise Refused(f"{name} is asked for twice below the diagram")


def draw_scalar(panel: Axes, axis: str, branches: Sequence[xr.Dataset], name: str) -> None:
    """Draw a scalar over the axis, of the line of each direction in its colour; both exponents."""
    for branch, colour in zip(branches, DIRECTION_COLOURS, strict=False):
        x = branch[axis].values
        y = np.asarray(branch[name].values, float).reshape(len(x), -1)
        if name == "period":
            y = np.where(y > 0.0, y, np.nan)  # 0: no repetition was found
        size = float(np.clip(250.0 / len(x), 0.8, 2.5))
        for column, alpha in zip(y.T, (1.0, 0.45), strict=False):
            (points,) = panel.plot(x, column, "o", color=colour, alpha=alpha, rasterized=True)
            points.set(markersize=size, markeredgewidth=0)
    if name == "lyapunov":
        panel.axhline(0.0, color="black", linewidth=0.6, zorder=1)
    variable = branches[0][name]
    words = fill(variable.attrs["long_name"].split(",")[0], _LABEL_WIDTH)
    panel.set_ylabel(label(variable.assign_attrs(long_name=words), "\n"))
