"""Pictures of one point of a sweep: its section and its impacts."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sweeps.analysis.selection import Cut, Setting, recorded
from sweeps.plotting.canvas import PAGE, Page, add_legend, in_style, new_panel
from sweeps.plotting.labels import add_title, label_ordinate
from sweeps.plotting.marks import draw_points, draw_stop, widen_if_constant
from sweeps.plotting.quantity_words import label


@in_style
def section(
    dataset: xr.Dataset, *, at: Cut | None = None, page: Page = PAGE, ax: Axes | None = None
) -> Figure:
    """Draw the Poincaré section at one point: velocity over displacement, and the stop.

    Parameters
    ----------
    dataset, at, page, ax
        As for `sweeps.plotting.bifurcation`.

    Returns
    -------
    Figure

    Raises
    ------
    Refused
        If the file has no section, or nothing was recorded at this point.
    """
    point, (x, v) = recorded(dataset, ("poincare_x", "poincare_v"), at)
    clearance = Setting.of(dataset).value("clearance", point)
    panel = new_panel(ax, page, 4.5, 4.0)
    draw_points(panel, x, v)
    draw_stop(panel.axvline, clearance)
    panel.set_xlabel(label(dataset["poincare_x"]))
    label_ordinate(panel, dataset["poincare_v"])
    widen_if_constant(panel.set_xlim, min(x.min(), clearance), max(x.max(), clearance))
    widen_if_constant(panel.set_ylim, v.min(), v.max())
    page.set_limits(panel)
    add_legend(panel)
    return add_title(panel, page, point)


@in_style
def impacts(
    dataset: xr.Dataset, *, at: Cut | None = None, page: Page = PAGE, ax: Axes | None = None
) -> Figure:
    """Draw the impact section at one point: speed before the impact over the forcing phase.

    Parameters
    ----------
    dataset, at, page, ax
        As for `sweeps.plotting.bifurcation`.

    Returns
    -------
    Figure

    Raises
    ------
    Refused
        If the file has no impacts, or none was recorded at this point.
    """
    point, (phase, v) = recorded(dataset, ("impact_phase", "impact_v"), at)
    panel = new_panel(ax, page, 4.5, 3.7)
    draw_points(panel, phase, v)
    quarters = ["0", r"$\pi/2$", r"$\pi$", r"$3\pi/2$", r"$2\pi$"]
    panel.set_xticks(0.5 * np.pi * np.arange(5), quarters)
    panel.set_xlim(0.0, 2.0 * np.pi)
    panel.set_ylim(bottom=0.0)
    panel.set_xlabel(label(dataset["impact_phase"]))
    label_ordinate(panel, dataset["impact_v"])
    page.set_limits(panel)
    return add_title(panel, page, point)
