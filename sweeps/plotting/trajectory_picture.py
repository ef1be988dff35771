"""The motion of one point of a sweep: time history and phase plane, recorded or computed again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sweeps.analysis.selection import Cut, Setting
from sweeps.analysis.trajectories import (
    RECORDED,
    PointMotion,
    continued_motion,
    recorded_motion,
)
from sweeps.plotting.canvas import PAGE, Page, add_legend, in_style, new_picture
from sweeps.plotting.labels import add_title, mathtext
from sweeps.plotting.marks import draw_stop
from sweeps.plotting.palette import BLUE, ORANGE, VERMILION
from sweeps.plotting.quantity_words import as_variable, label

#: Forcing periods that are computed where no trajectory was recorded.
PERIODS = 4


@in_style
def trajectory(
    dataset: xr.Dataset,
    *,
    at: Cut | None = None,
    periods: int | None = None,
    page: Page = PAGE,
    ax: Sequence[Axes] | None = None,
) -> Figure:
    """Draw the motion of one point as the paper does: x over t, v over t, v over x.

    Impacts are marked, and so are samples beyond the stop, of which the deepest is stated. Of the
    integrator ``exact`` the exact flow is drawn between the events, not the steps.

    Parameters
    ----------
    dataset, at
        As for `sweeps.plotting.bifurcation`.
    periods : int, optional
        Forcing periods to compute with the method of the sweep, from the last state of the section
        on. By default the trajectory of the file is drawn or, if it has none, ``PERIODS``.
    page : Page, optional
        Its limits are those of x over t.
    ax : three Axes, optional
        The panels to draw into, by default those of a new figure.

    Returns
    -------
    Figure
        That of `ax`, or the new one.

    Raises
    ------
    Refused
        If nothing was recorded at this point.
    """
    if periods is None and all(name in dataset for name in RECORDED):
        motion = recorded_motion(dataset, at)
    else:
        motion = continued_motion(dataset, at, PERIODS if periods is None else periods)
    over_time, velocity, phase_plane = panels = _new_panels(page) if ax is None else list(ax)
    _draw(panels, motion)
    units = Setting.of(dataset).units
    time, x, v = (as_variable(name, units) for name in RECORDED)
    time.attrs["symbol"] = "t - t_0"
    over_time.set_ylabel(label(x, "\n"))
    velocity.set(xlabel=label(time), ylabel=label(v, "\n"))
    phase_plane.set(xlabel=label(x), ylabel=label(v))
    phase_plane.set_title(_depth_text(motion.rows[1] - motion.oscillator.clearance))
    page.set_limits(over_time)
    handles = [handle for panel in panels for handle in panel.get_legend_handles_labels()[0]]
    add_legend(phase_plane, handles)
    period = 2.0 * np.pi / motion.oscillator.omega
    start = motion.rows[0, 0] + motion.turns * period
    record = f"$t_0 = {mathtext(start)}$, after {start / period:.6g} forcing periods"
    return add_title(over_time, page, motion.point, record)


def _new_panels(page: Page) -> list[Axes]:
    """Return the panels of x and v over time and of the phase plane, which is beside or below."""
    narrow = page.width is not None and page.width < 5.0
    if narrow:
        figure = new_picture(page, page.width or 0.0, 5.2)
        layout, heights = "x;v;p", [1.0, 1.0, 1.6]
    else:
        figure = new_picture(page, 6.2, 4.2)
        layout, heights = "xp;vp", [1.0, 1.0]
    panels = figure.subplot_mosaic(layout, height_ratios=heights)
    panels["v"].sharex(panels["x"])
    panels["x"].tick_params(labelbottom=False)
    figure.align_ylabels([panels["x"], panels["v"]])
    panels["p"].locator_params(axis="x", nbins=5)
    return [panels["x"], panels["v"], panels["p"]]


def _draw(panels: Sequence[Axes], motion: PointMotion) -> None:
    """Draw the motion, its impacts, the samples beyond the stop, and the stop."""
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
    draw_stop(panels[0].axhline, clearance, label=False)
    draw_stop(panels[2].axvline, clearance)
    panels[0].margins(x=0.01)


def _depth_text(depth: np.ndarray) -> str:
    """Write how far the deepest sample is beyond the stop."""
    if depth.max() <= 0.0:
        return "no sample beyond the stop"
    mantissa, exponent = f"{depth.max():.1e}".split("e")
    return f"deepest penetration {mantissa}e{int(exponent)}"
