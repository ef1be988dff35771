"""Pictures of one point of a sweep: its section, its impacts, its trajectory."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from sweeps.analysis.selection import Cut, Setting, recorded
from sweeps.plotting.labels import add_title, label
from sweeps.plotting.marks import draw_points, draw_stop, widen_if_constant
from sweeps.plotting.palette import BLUE, VERMILION


def section(dataset: xr.Dataset, *, at: Cut | None = None) -> Figure:
    """Draw the Poincaré section at one point: velocity over displacement, and the stop.

    Parameters
    ----------
    dataset : Dataset
        From `sweeps.open_sweep`.
    at : mapping of str to float, optional
        Values of the swept axes: the nearest of the grid is taken, and by default the first.

    Returns
    -------
    Figure

    Raises
    ------
    Refused
        If the file has no section, or nothing was recorded at this point.
    """
    point, (x, v) = recorded(dataset, ("poincare_x", "poincare_v"), at)
    setting = Setting.of(dataset)
    clearance = setting.value("clearance", point)
    figure = Figure(figsize=(4.5, 4.0), layout="constrained")
    panel = figure.add_subplot()
    draw_points(panel, x, v)
    draw_stop(panel.axvline, clearance)
    panel.set_xlabel(label(dataset["poincare_x"]))
    panel.set_ylabel(label(dataset["poincare_v"]))
    widen_if_constant(panel.set_xlim, min(x.min(), clearance), max(x.max(), clearance))
    widen_if_constant(panel.set_ylim, v.min(), v.max())
    add_title(figure, setting, point, 72)
    figure.legend(loc="outside lower center", frameon=False)
    return figure


def impacts(dataset: xr.Dataset, *, at: Cut | None = None) -> Figure:
    """Draw the impact section at one point: speed before the impact over the forcing phase.

    Parameters
    ----------
    dataset, at
        As for `section`.

    Returns
    -------
    Figure

    Raises
    ------
    Refused
        If the file has no impacts, or none was recorded at this point.
    """
    point, (phase, v) = recorded(dataset, ("impact_phase", "impact_v"), at)
    figure = Figure(figsize=(4.5, 3.7), layout="constrained")
    panel = figure.add_subplot()
    draw_points(panel, phase, v)
    quarters = ["0", r"$\pi/2$", r"$\pi$", r"$3\pi/2$", r"$2\pi$"]
    panel.set_xticks(0.5 * np.pi * np.arange(5), quarters)
    panel.set_xlim(0.0, 2.0 * np.pi)
    panel.set_ylim(bottom=0.0)
    panel.set_xlabel(label(dataset["impact_phase"]))
    panel.set_ylabel(label(dataset["impact_v"]))
    add_title(figure, Setting.of(dataset), point, 72)
    return figure


def trajectory(dataset: xr.Dataset, *, at: Cut | None = None) -> Figure:
    """Draw the trajectory of one point as the paper does: x over t, v over t, v over x.

    Samples beyond the stop are marked, and the deepest is stated.

    Parameters
    ----------
    dataset, at
        As for `section`.

    Returns
    -------
    Figure

    Raises
    ------
    Refused
        If the file has no trajectory, or nothing was recorded at this point.
    """
    names = ("trajectory_t", "trajectory_x", "trajectory_v")
    point, (t, x, v) = recorded(dataset, names, at)
    setting = Setting.of(dataset)
    clearance = setting.value("clearance", point)
    beyond = x > clearance
    figure = Figure(figsize=(6.2, 4.2), layout="constrained")
    panels = figure.subplot_mosaic([["x", "phase"], ["v", "phase"]])
    panels["v"].sharex(panels["x"])
    columns = {"x": (t, x), "v": (t, v), "phase": (x, v)}
    line_width = 0.9 if len(t) < 5000 else 0.4
    for name, (abscissa, ordinate) in columns.items():
        panel = panels[name]
        panel.plot(abscissa, ordinate, color=BLUE, linewidth=line_width, rasterized=len(t) > 50_000)
        if beyond.any():
            (marks,) = panel.plot(abscissa[beyond], ordinate[beyond], "o", color=VERMILION)
            marks.set(markersize=2.5, markeredgewidth=0, zorder=3)
            marks.set_label("_" if abscissa is t else "samples beyond the stop")
    panels["x"].tick_params(labelbottom=False)
    panels["x"].set_ylabel(label(dataset["trajectory_x"], "\n"))
    panels["v"].set_ylabel(label(dataset["trajectory_v"], "\n"))
    panels["v"].set_xlabel(label(dataset["trajectory_t"]))
    panels["phase"].set_xlabel(label(dataset["trajectory_x"]))
    panels["phase"].set_ylabel(label(dataset["trajectory_v"]))
    draw_stop(panels["x"].axhline, clearance, label=False)
    draw_stop(panels["phase"].axvline, clearance)
    panels["x"].margins(x=0.01)
    figure.align_ylabels([panels["x"], panels["v"]])
    panels["phase"].locator_params(axis="x", nbins=5)
    panels["phase"].set_title(_depth_text(x - clearance))
    add_title(figure, setting, point, 88)
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    return figure


def _depth_text(depth: np.ndarray) -> str:
    if depth.max() <= 0.0:
        return "no sample beyond the stop"
    mantissa, exponent = f"{depth.max():.1e}".split("e")
    return f"deepest penetration {mantissa}e{int(exponent)}"
