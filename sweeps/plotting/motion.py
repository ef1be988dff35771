"""Pictures of one point of a sweep: its motion in time and in the phase plane, and its sections."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sweeps.analysis.selection import Selection, config_of, recorded
from sweeps.analysis.trajectories import (
    RECORDED,
    PointMotion,
    continued_motion,
    recorded_motion,
)
from sweeps.plotting import canvas
from sweeps.plotting.canvas import PAGE, Page, styled
from sweeps.plotting.labels import as_variable, label_axis, mathtext
from sweeps.plotting.style import BLUE, ORANGE, VERMILION

#: Number of forcing periods to compute if no trajectory was recorded.
PERIODS = 4
#: In a figure narrower than this [inch] the phase plane is below the other panels.
_NARROW = 4.5


@styled
def section(
    dataset: xr.Dataset, *, at: Selection | None = None, page: Page = PAGE, ax: Axes | None = None
) -> Figure:
    """Draw the Poincaré section at one point: velocity over displacement, and the stop."""
    point, (x, v) = recorded(dataset, ("poincare_x", "poincare_v"), at)
    clearance = float(point["clearance"])
    panel = canvas.new_panel(ax, page)
    canvas.draw_points(panel, x, v)
    canvas.draw_stop(panel.axvline, clearance)
    label_axis(panel.xaxis, point["poincare_x"])
    label_axis(panel.yaxis, point["poincare_v"])
    canvas.widen_if_constant(panel.set_xlim, min(x.min(), clearance), max(x.max(), clearance))
    canvas.widen_if_constant(panel.set_ylim, v.min(), v.max())
    page.set_limits(panel)
    return canvas.finish(panel, page, point)


@styled
def impacts(
    dataset: xr.Dataset, *, at: Selection | None = None, page: Page = PAGE, ax: Axes | None = None
) -> Figure:
    """Draw the impact section at one point: speed before the impact over the forcing phase."""
    point, (phase, v) = recorded(dataset, ("impact_phase", "impact_v"), at)
    panel = canvas.new_panel(ax, page)
    canvas.draw_points(panel, phase, v)
    quarters = ["0", r"$\pi/2$", r"$\pi$", r"$3\pi/2$", r"$2\pi$"]
    panel.set_xticks(0.5 * np.pi * np.arange(5), quarters)
    panel.set_xlim(0.0, 2.0 * np.pi)
    panel.set_ylim(bottom=0.0)
    label_axis(panel.xaxis, point["impact_phase"])
    label_axis(panel.yaxis, point["impact_v"])
    page.set_limits(panel)
    return canvas.finish(panel, page, point)


@styled
def trajectory(
    dataset: xr.Dataset,
    *,
    at: Selection | None = None,
    periods: int | None = None,
    page: Page = PAGE,
    ax: Sequence[Axes] | None = None,
) -> Figure:
    """Draw the motion of one point as in the paper: x over t, v over t and v over x.

    Impacts and samples beyond the stop are marked, and the deepest penetration is stated. For the
    integrator ``exact`` the exact flow between events is drawn instead of the steps. `ax` are the
    three panels. The limits of the page apply to x over t.

    Parameters
    ----------
    periods : int, optional
        Number of forcing periods to compute, with the method of the sweep, from the last state at
        the section. By default the trajectory in the file is drawn; without one, ``PERIODS``
        periods are computed.
    """
    if periods is None and all(name in dataset for name in RECORDED):
        motion = recorded_motion(dataset, at)
    else:
        motion = continued_motion(dataset, at, PERIODS if periods is None else periods)
    over_time, velocity, phase_plane = panels = _new_panels(page) if ax is None else list(ax)
    _draw(panels, motion)
    units = dict(config_of(dataset).units.items())
    time, x, v = (as_variable(name, units) for name in RECORDED)
    time.attrs["symbol"] = "t-t_0"
    for panel, across, up in ((over_time, None, x), (velocity, time, v), (phase_plane, x, v)):
        label_axis(panel.yaxis, up)
        if across is not None:
            label_axis(panel.xaxis, across)
    depth = float((motion.rows[1] - motion.oscillator.clearance).max())
    if depth > 0.0:
        phase_plane.set_title(f"deepest penetration {depth:.1e}")
    page.set_limits(over_time)
    period = 2.0 * np.pi / motion.oscillator.omega
    start = motion.rows[0, 0] + motion.turns * period
    record = f"$t_0={mathtext(start)}$, after {start / period:.6g} forcing periods"
    handles, _ = phase_plane.get_legend_handles_labels()
    return canvas.finish(over_time, page, motion.point, handles, record=record)


def _new_panels(page: Page) -> list[Axes]:
    """Return new panels for x over t, v over t, and the phase plane beside or below them."""
    narrow = (page.width or mpl.rcParams["figure.figsize"][0]) < _NARROW
    layout, heights = ("x;v;p", [1.0, 1.0, 1.6]) if narrow else ("xp;vp", [1.0, 1.0])
    figure = canvas.Picture(page, 1.6 if narrow else 1.25)
    panels = figure.subplot_mosaic(layout, height_ratios=heights)
    panels["v"].sharex(panels["x"])
    panels["x"].tick_params(labelbottom=False)
    figure.align_ylabels([panels["x"], panels["v"]])
    panels["p"].locator_params(axis="x", nbins=5)
    return [panels["x"], panels["v"], panels["p"]]


def _draw(panels: Sequence[Axes], motion: PointMotion) -> None:
    """Draw the motion, its impacts, its samples beyond the stop, and the stop."""
    rows, clearance = motion.rows, motion.oscillator.clearance
    marks = (
        (motion.impacts, ORANGE, "impacts"),
        (rows[:, rows[1] > clearance], VERMILION, "samples beyond the stop"),
    )
    flow, begin = motion.flow(per_period=200), np.array([[rows[0, 0]], [0.0], [0.0]])
    width = 0.9 if rows.shape[1] < 5000 else 0.4
    for panel, axes in zip(panels, ([0, 1], [0, 2], [1, 2]), strict=True):
        line = (flow - begin)[axes]
        (curve,) = panel.plot(*line, color=BLUE, linewidth=width, zorder=2.0)
        curve.set_rasterized(line.shape[1] > 50_000)
        for marked, colour, text in marks:
            if marked.size:
                (points,) = panel.plot(*(marked - begin)[axes], "o", color=colour, zorder=3.0)
                points.set(markersize=2.5, markeredgewidth=0)
                points.set_label(text if panel is panels[-1] else "_")
    canvas.draw_stop(panels[0].axhline, clearance, label=False)
    canvas.draw_stop(panels[2].axvline, clearance)
    panels[0].margins(x=0.01)
