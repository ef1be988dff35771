"""Pictures of one point of a sweep: its motion in time and in the phase plane, and its sections."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sweeps.analysis.regimes import Label, labels
from sweeps.analysis.selection import Selection, config_of, recorded, select
from sweeps.analysis.trajectories import (
    MOST_PERIODS,
    RECORDED,
    PointMotion,
    continued_motion,
    periods_shown,
    recorded_motion,
)
from sweeps.errors import Refused
from sweeps.plotting import canvas
from sweeps.plotting.canvas import PAGE, Page, styled
from sweeps.plotting.colours import Paint, paint
from sweeps.plotting.labels import as_variable, equation, label_axis, named_unit
from sweeps.plotting.lines import refuse_without_result
from sweeps.plotting.numbers import Wanted, with_number
from sweeps.plotting.style import BLUE, ORANGE, VERMILION

#: In a figure narrower than this [inch] the phase plane is below the other panels.
_NARROW = 4.5


class _Records(NamedTuple):
    """Values recorded at one point, or at several points with a colour each, as flat columns."""

    points: xr.Dataset
    columns: list[np.ndarray]
    colours: str | np.ndarray = BLUE
    shown: Paint | None = None

    @classmethod
    def of(
        cls,
        dataset: xr.Dataset,
        names: tuple[str, str],
        at: Selection | None,
        color: Wanted | None,
    ) -> Self:
        """Read the values of one point or, with a colour, of all points that `at` leaves."""
        if color is None:
            return cls(*recorded(dataset, names, at))
        dataset, name = with_number(dataset, color)
        left = [str(axis) for axis in dataset["status"].dims if axis not in (at or {})]
        points = select(dataset, at, free=left)
        if points["status"].size == 1:
            raise Refused("a color tells several motions apart, and only one point is left")
        shown = paint(points, name, dataset, dots=True)
        refuse_without_result(points["status"].values)
        columns = np.array([points[name].transpose(*points["status"].dims, ...) for name in names])
        seen = np.isfinite(columns).all(axis=0)
        colours = np.broadcast_to(shown.colours()[..., None, :], (*seen.shape, 4))[seen]
        return cls(points, list(columns[:, seen]), colours, shown)

    def finish(self, panel: Axes, page: Page) -> Figure:
        """Draw the legend or the colour bar of the colours, if any, and return the figure."""
        handles = panel.get_legend_handles_labels()[0]
        if self.shown is None:
            return canvas.finish(panel, page, self.points, handles)
        self.shown.add_bar([panel])
        handles = [*self.shown.handles(), *handles]
        return canvas.finish(panel, page, self.points, handles, self.shown.title)


@styled
def section(
    dataset: xr.Dataset,
    *,
    at: Selection | None = None,
    color: Wanted | None = None,
    page: Page = PAGE,
    ax: Axes | None = None,
) -> Figure:
    """Draw the Poincaré section: velocity over displacement, and the stop.

    It is that of one point or, with `color`, those of all points that `at` does not exclude.

    Parameters
    ----------
    color : str or DataArray, optional
        What colours the sections of several points, as for `sweeps.plotting.bifurcation`.

    Examples
    --------
    >>> import sweeps
    >>> omega = {"start": 2.6, "stop": 2.7, "num": 20}
    >>> scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": omega, "f": 1.0}}
    >>> ds = sweeps.open_sweep(sweeps.run_sweep(scene, "flip.h5", overwrite=True))
    >>> from sweeps import plotting
    >>> plotting.section(ds, at={"omega": 2.7}).savefig("section.png")
    """
    found = _Records.of(dataset, ("poincare_x", "poincare_v"), at, color)
    (x, v), clearance = found.columns, found.points["clearance"]
    panel = canvas.new_panel(ax, page)
    canvas.draw_points(panel, x, v, found.colours)
    label_axis(panel.xaxis, found.points["poincare_x"])
    label_axis(panel.yaxis, found.points["poincare_v"])
    ends = [x.min(), x.max()]
    if not clearance.dims:
        units = dict(config_of(dataset).units.items())
        canvas.draw_stop(panel.axvline, float(clearance), as_variable("clearance", units))
        ends.append(float(clearance))
    canvas.widen_if_constant(panel.set_xlim, min(ends), max(ends))
    canvas.widen_if_constant(panel.set_ylim, v.min(), v.max())
    page.fit_ordinate(panel)
    page.set_limits(panel)
    return found.finish(panel, page)


@styled
def impacts(
    dataset: xr.Dataset,
    *,
    at: Selection | None = None,
    color: Wanted | None = None,
    page: Page = PAGE,
    ax: Axes | None = None,
) -> Figure:
    """Draw the impact section: speed before the impact over the forcing phase.

    It is that of one point or, with `color`, those of all points that `at` does not exclude.

    Parameters
    ----------
    color : str or DataArray, optional
        What colours the impacts of several points, as for `sweeps.plotting.bifurcation`.

    Examples
    --------
    >>> import sweeps
    >>> omega = {"start": 2.6, "stop": 2.7, "num": 20}
    >>> scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": omega, "f": 1.0}}
    >>> ds = sweeps.open_sweep(sweeps.run_sweep(scene, "flip.h5", overwrite=True))
    >>> from sweeps import plotting
    >>> plotting.impacts(ds, at={"omega": 2.7}).savefig("impacts.png")
    """
    found = _Records.of(dataset, ("impact_phase", "impact_v"), at, color)
    panel = canvas.new_panel(ax, page)
    phase, v = found.columns
    canvas.draw_points(panel, phase, v, found.colours)
    quarters = ["0", r"$\pi/2$", r"$\pi$", r"$3\pi/2$", r"$2\pi$"]
    panel.set_xticks(0.5 * np.pi * np.arange(5), quarters)
    panel.set_xlim(0.0, 2.0 * np.pi)
    panel.set_ylim(bottom=0.0)
    label_axis(panel.xaxis, found.points["impact_phase"])
    label_axis(panel.yaxis, found.points["impact_v"])
    page.set_limits(panel)
    return found.finish(panel, page)


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

    Impacts and samples beyond the stop are marked, and the deepest penetration is stated. Of more
    than 1,000 periods as many are drawn, evenly spread over all. For the integrator
    ``exact`` the exact flow between events is drawn instead of the steps. `ax` are the three
    panels. The limits of the page apply to x over t.

    Parameters
    ----------
    periods : int, optional
        Number of forcing periods to compute, with the method of the sweep, from the last state at
        the section. By default the trajectory in the file is drawn; without one, two repetitions
        of a periodic motion, but at least four periods.

    Examples
    --------
    >>> import sweeps
    >>> omega = {"start": 2.6, "stop": 2.7, "num": 20}
    >>> scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": omega, "f": 1.0}}
    >>> ds = sweeps.open_sweep(sweeps.run_sweep(scene, "flip.h5", overwrite=True))
    >>> from sweeps import plotting
    >>> plotting.trajectory(ds, at={"omega": 2.7}).savefig("motion.png")
    """
    found = _class_at(dataset, at)
    if periods is None and all(name in dataset for name in RECORDED):
        motion = recorded_motion(dataset, at)
    else:
        periods = periods_shown(found.m if found else 0) if periods is None else periods
        motion = continued_motion(dataset, at, periods)
    over_time, velocity, phase_plane = panels = _new_panels(page) if ax is None else list(ax)
    _draw(panels, motion)
    units = dict(config_of(dataset).units.items())
    time, x, v = (as_variable(name, units) for name in RECORDED)
    time.attrs["symbol"] = "t-t_0"
    for panel, across, up in ((over_time, None, x), (velocity, time, v), (phase_plane, x, v)):
        label_axis(panel.yaxis, up)
        if across is not None:
            label_axis(panel.xaxis, across)
    if motion.depth > 0.0:
        depth = f"deepest penetration {motion.depth:.1e}"
        phase_plane.set_title(" ".join([depth, named_unit(x)]).strip())
    for panel in (over_time, velocity):
        page.fit_ordinate(panel)
    page.set_limits(over_time)
    period = 2.0 * np.pi / motion.oscillator.omega
    start = motion.rows[0, 0] + motion.turns * period
    record = f"{equation('t_0', time, start)}, after {start / period:.6g} forcing periods"
    if found is not None:
        record = f"{'class ' if found.m else ''}{found}, {record}"
    if motion.periods > MOST_PERIODS:
        record += f", {MOST_PERIODS:,} of {motion.periods:,} periods"
    handles, _ = phase_plane.get_legend_handles_labels()
    return canvas.finish(over_time, page, motion.point, handles, record=record)


def _class_at(dataset: xr.Dataset, at: Selection | None) -> Label | None:
    """Return the class of the motion at one point; None if the file does not know it."""
    if "period" not in dataset:
        return None
    (found,) = labels(select(dataset, at).expand_dims("point"))
    return found


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
    units = dict(config_of(motion.point).units.items())
    canvas.draw_stop(panels[0].axhline, clearance)
    canvas.draw_stop(panels[2].axvline, clearance, as_variable("clearance", units))
    panels[0].margins(x=0.01)
