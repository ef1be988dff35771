"""The picture of stability: the spectral radius of every integrator, and its limit."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from sweeps.bench.stability import Chart
from vibroimpact.step.integrators import INTEGRATORS

# Blue where motion decays, the darker the faster; orange where it grows. In grey, too, the lightest
# of all is next to the limit, and the limit is drawn.
_LEVELS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 4.0)
_COLOURS = ListedColormap(
    ["#08519C", "#3C8CC3", "#86BCDC", "#D6E6F4", "#FDD9B0", "#F6A54C", "#D97706", "#8F4600"]
)
_NORM = BoundaryNorm(_LEVELS, _COLOURS.N, extend="max")
# Rounding may lift a marginal radius above 1.
_MARGIN = 1e-9


def picture(chart: Chart) -> Figure:
    """Draw a panel per integrator: its radius, and over it the limit in closed form."""
    rows = math.ceil(len(chart.radius) / 2)
    figure = Figure(figsize=(4.4, 0.8 + 1.4 * rows), layout="constrained")
    panels = figure.subplots(rows, 2, sharex=True, sharey=True, squeeze=False)
    for panel in panels.flat[len(chart.radius) :]:
        panel.set_visible(False)
    for panel, (name, radius) in zip(panels.flat, chart.radius.items(), strict=False):
        panel.pcolormesh(
            chart.step, chart.zeta, radius - _MARGIN, norm=_NORM, cmap=_COLOURS, rasterized=True
        )
        limit = INTEGRATORS[name].limit(chart.zeta)
        panel.plot(limit, chart.zeta, color="black", linewidth=1.4)
        panel.set_title(f"{name}, no limit" if np.isinf(limit).all() else name, pad=3.0)
        panel.set_xlim(0.0, chart.step[-1])
        panel.set_ylim(0.0, chart.zeta[-1])
    for panel in panels[:, 0]:
        panel.set_ylabel("damping $h/p$ [1]")
    for panel in panels[-1]:
        panel.set_xlabel("step $p\\,T$ [rad]")
    bar = figure.colorbar(
        ScalarMappable(_NORM, _COLOURS), ax=panels, location="bottom", aspect=40, pad=0.01
    )
    bar.set_label("spectral radius of a step of free motion; above 1 it grows")
    bar.ax.axvline(1.0, color="black", linewidth=1.4)
    bar.set_ticks(_LEVELS, labels=[f"{level:g}" for level in _LEVELS])
    return figure
