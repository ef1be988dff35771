"""Motions in time and phase plane, their section, their impacts."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from sweeps.errors import Refused
from sweeps.opened.coordinates import (
    MOST_DRAWN,
    RECORDED,
    PointMotion,
    continued_motion,
    periods_shown,
    recorded,
    recorded_motion,
)
from sweeps.opened.opened_sweep import OpenedSweep, Selection
from sweeps.plotting import canvas
from sweeps.plotting.colours import Paint, coloured_points
from sweeps.plotting.contents import Wanted
from sweeps.plotting.directions import colours_directions, in_both
from sweeps.plotting.labels import as_variable, equation, label_axis, named_unit, record_text
from sweeps.plotting.looks import Cells
from sweeps.plotting.page import PAGE, Page, styled
from sweeps.plotting.style import BOTH_COLOUR, VERMILION, Look, data_colour, ink, visible
from sweeps.store import DIRECTION
from sweeps.text import shown_count
from vibroimpact.points.regimes import Label, Regime, has_result


class _Records(NamedTuple):
    """Values recorded at one point, or at several points with a colour each, as flat columns."""

    points: OpenedSweep
    columns: Sequence[np.ndarray]
    colours: np.ndarray | None = None
    shown: Paint | None = None
    by_point: Sequence[np.ndarray] = ()  # the columns in the shape of ``status`` and a record
    common: Sequence[Artist] = ()  # for the legend: values that both directions have

    @classmethod
    def of(
        cls,
        sweep: OpenedSweep,
        names: tuple[str, str],
        at: Selection | None,
        color: Wanted | None,
        grey: bool,
    ) -> Self:
        """Read the values of one point or, with a colour, of all points that `at` leaves."""
        if color is None:
            return cls(*recorded(sweep, names, at))
        points, shown = coloured_points(sweep, at, color, grey)
        dims = points.grid
        columns = np.array([points[name].transpose(*dims, ...) for name in names])
        seen = np.isfinite(columns).all(axis=0)
        colours = np.broadcast_to(shown.colours()[..., None, :], (*seen.shape, 4)).copy()
        flat, common = columns[:, seen], list[Artist]()
        if DIRECTION in dims and colours_directions(sweep, color):
            both = in_both(columns, dims.index(DIRECTION))
            look = Look.plain(visible(BOTH_COLOUR))
            colours[both] = to_rgba(look.colour)
            columns[:, both & grey] = np.nan  # without the marker of a direction
            common = [Cells("both", look, both).handle()] * bool(both.any())
        return cls(points, list(flat), colours[seen], shown, list(columns), common)

    def finish(self, panel: Axes, page: Page, coordinate: str) -> Figure:
        """Draw the legend or the colour bar of the colours, if any, and return the figure."""
        handles, title = panel.get_legend_handles_labels()[0], None
        if self.shown is not None:
            self.shown.mark(panel, *self.by_point)
            self.shown.add_bar([panel])
            handles, title = [*self.shown.handles(), *self.common, *handles], self.shown.title
        record = record_text(self.points, coordinate)
        return canvas.finish(panel, page, self.points, handles, title, record)


@styled
def section(
    sweep: OpenedSweep,
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
    >>> ds = sweeps.open_sweep("flip.h5")  # of the example of `run_sweep`
    >>> sweeps.plotting.section(ds, at={"omega": 2.7}).savefig("section.png")
    """
    found = _Records.of(sweep, ("poincare_x", "poincare_v"), at, color, page.grey)
    (x, v), clearance = found.columns, found.points["clearance"]
    panel = canvas.new_panel(ax, page)
    canvas.draw_points(panel, x, v, found.colours)
    label_axis(panel.xaxis, found.points["poincare_x"])
    label_axis(panel.yaxis, found.points["poincare_v"])
    ends = [x.min(), x.max()]
    if not clearance.dims:
        stop = as_variable("clearance", sweep)
        canvas.draw_stop(panel.axvline, float(clearance), stop)
        ends.append(float(clearance))
    canvas.widen_if_constant(panel.set_xlim, min(ends), max(ends))
    canvas.widen_if_constant(panel.set_ylim, v.min(), v.max())
    page = page.on(panel)
    page.fit_ordinate(panel)
    page.set_limits(panel)
    return found.finish(panel, page, "poincare_x")


@styled
def impacts(
    sweep: OpenedSweep,
    *,
    at: Selection | None = None,
    color: Wanted | None = None,
    page: Page = PAGE,
    ax: Axes | None = None,
) -> Figure:
    """Draw the impact section: speed before the impact over the forcing phase.

    It is that of one point or, with `color`, those of all points that `at` does not exclude.
    The title says how many impacts of the record were not kept.

    Parameters
    ----------
    color : str or DataArray, optional
        What colours the impacts of several points, as for `sweeps.plotting.bifurcation`.

    Examples
    --------
    >>> ds = sweeps.open_sweep("flip.h5")  # of the example of `run_sweep`
    >>> sweeps.plotting.impacts(ds, at={"omega": 2.7}).savefig("impacts.png")
    """
    found = _Records.of(sweep, ("impact_phase", "impact_v"), at, color, page.grey)
    panel = canvas.new_panel(ax, page)
    phase, v = found.columns
    canvas.draw_points(panel, phase, v, found.colours)
    quarters = ["0", r"$\pi/2$", r"$\pi$", r"$3\pi/2$", r"$2\pi$"]
    panel.set_xticks(0.5 * np.pi * np.arange(5), quarters)
    panel.set_xlim(0.0, 2.0 * np.pi)
    panel.set_ylim(bottom=0.0)
    label_axis(panel.xaxis, found.points["impact_phase"])
    label_axis(panel.yaxis, found.points["impact_v"])
    page.on(panel).set_limits(panel)
    return found.finish(panel, page, "impact_v")


#: In a figure narrower than this [inch] the phase plane is below the other panels.
NARROW = 4.5
#: Most motions in a picture: of each, at least four periods are drawn.
_MOST_MOTIONS = MOST_DRAWN // 4


@functools.partial(styled, panels=(3,))
def trajectory(
    sweep: OpenedSweep,
    *,
    at: Selection | None = None,
    periods: int | None = None,
    color: Wanted | None = None,
    page: Page = PAGE,
    ax: Sequence[Axes] | None = None,
) -> Figure:
    """Draw the motion of one point as in the paper: x over t, v over t and v over x.

    With `color`, these are the motions of all points that `at` does not exclude, at most 250.
    Impacts and samples beyond the stop are marked in the motion of one point; the deepest
    penetration is stated. Of more than 1,000 periods in all as many are drawn, evenly spread over
    each motion. For the integrator ``exact`` the exact flow between events is drawn instead of the
    steps. `ax` are the three panels. The limits of the page apply to x over t.

    Parameters
    ----------
    periods : int, optional
        Number of forcing periods to compute, with the method of the sweep, from the last state at
        the section. By default the trajectory in the file is drawn; without one, two repetitions
        of a periodic motion, but at least four periods.
    color : str or DataArray, optional
        What colours the motions of several points, as for `sweeps.plotting.bifurcation`.

    Examples
    --------
    >>> ds = sweeps.open_sweep("flip.h5")  # of the example of `run_sweep`
    >>> sweeps.plotting.trajectory(ds, at={"omega": 2.7}).savefig("motion.png")
    """
    over_time, velocity, phase_plane = panels = _new_panels(page) if ax is None else list(ax)
    if color is None:
        drawn, shown = sweep.cut(at), None
        (found,) = _classes(drawn.over(drawn.data.expand_dims("motion")))
        motions = [_motion_at(sweep, at, periods, found)]
        _draw_curves(panels, motions[0])
        _mark_impacts(panels, motions[0], page.grey)
    else:
        drawn, shown, found = *coloured_points(sweep, at, color, page.grey), None
        motions = _draw_coloured(panels, drawn, shown, periods)
    if not drawn["clearance"].dims:
        clearance = float(drawn["clearance"])
        canvas.draw_stop(over_time.axhline, clearance)
        canvas.draw_stop(phase_plane.axvline, clearance, as_variable("clearance", sweep))
    over_time.margins(x=0.01)
    time, x, v = (as_variable(name, sweep) for name in RECORDED)
    time.attrs["symbol"] = "t-t_0"
    for panel, across, up in ((over_time, None, x), (velocity, time, v), (phase_plane, x, v)):
        label_axis(panel.yaxis, up)
        if across is not None:
            label_axis(panel.xaxis, across)
    deepest = max(motion.depth for motion in motions)
    if deepest > 0.0:
        depth = f"deepest penetration {deepest:.1e}"
        phase_plane.set_title(" ".join([depth, named_unit(x)]).strip())
    page = page.on(over_time)
    for panel in (over_time, velocity):
        page.fit_ordinate(panel)
    page.set_limits(over_time)
    handles, title = phase_plane.get_legend_handles_labels()[0], None
    if shown is not None:
        shown.add_bar(panels)
        handles, title = [*shown.handles(curves=True), *handles], shown.title
    start, since, record = _text_of_motions(motions, time, found)
    if ax is not None or page.title is not None or len(motions) > 1:  # else the title says it
        velocity.set_xlabel(f"{velocity.get_xlabel()}, {start or f'$t_0$ {since}'}", wrap=True)
    return canvas.finish(over_time, page, drawn, handles, title, record)


def _motion_at(
    sweep: OpenedSweep,
    at: Selection | None,
    periods: int | None,
    found: Label | None,
    most: int = MOST_DRAWN,
) -> PointMotion:
    """Return the motion at one point, recorded or computed; at most so many of its periods."""
    if periods is None and all(name in sweep for name in RECORDED):
        return recorded_motion(sweep, at, most)
    periods = periods_shown(found.m if found else 0) if periods is None else periods
    return continued_motion(sweep, at, periods, most)


def _draw_coloured(
    panels: Sequence[Axes], points: OpenedSweep, shown: Paint, periods: int | None
) -> list[PointMotion]:
    """Draw a curve for each point with a result, in its colour; return the motions."""
    with_result = np.argwhere(has_result(points["status"].values))
    if len(with_result) > _MOST_MOTIONS:
        raise Refused(
            f"a picture of {len(with_result):,} motions is not readable; choose at most "
            f"{_MOST_MOTIONS} points"
        )
    most = MOST_DRAWN // len(with_result)
    dims, colours, motions = points.grid, shown.colours(), []
    at_each = dict(zip(dims, [("motion", place) for place in with_result.T], strict=True))
    classes, dashes = _classes(points.isel(at_each)), shown.dashes()
    for index, found in zip(with_result, classes, strict=True):
        point = points.isel(dict(zip(dims, index.tolist(), strict=True)))
        motions.append(_motion_at(point, None, periods, found, most))
        look = colours[tuple(index)], dashes[tuple(index)]
        _draw_curves(panels, motions[-1], *look, found.m if found else 0)
    return motions


def _text_of_motions(
    motions: Sequence[PointMotion], time: xr.DataArray, found: Label | None
) -> tuple[str, str, str | None]:
    """Write the start of a single motion, after how long motions start, and instead of a record.

    The last is None if the motions start after different times.
    """
    turns = 2.0 * np.pi / np.array([motion.oscillator.omega for motion in motions])
    starts = np.array([motion.rows[0, 0] for motion in motions])
    starts += turns * [motion.turns for motion in motions]
    begun = np.array([motion.begun for motion in motions])
    since = starts / turns - begun / (2.0 * np.pi)
    (after, *others) = {shown_count(periods, "forcing period", ".6g") for periods in since}
    if others:
        return "", "of each motion", None
    start = equation("t_0", time, starts[0]) if len(motions) == 1 else ""
    record = ", ".join(filter(None, [start, f"after {after}"]))
    if found is not None:
        record = f"{'class ' if found.regime is Regime.PERIODIC else ''}{found}, {record}"
    most = MOST_DRAWN // len(motions)
    periods = sum(motion.periods for motion in motions)
    drawn = sum(min(motion.periods, most) for motion in motions)
    record += f", {drawn:,} of {periods:,} periods" if drawn != periods else ""
    return start, f"after {after}", record


def _classes(line: OpenedSweep) -> list[Label | None]:
    """Return the class of each motion; None where the file does not know it."""
    return line.labels if "period" in line else [None] * line["status"].size


def _new_panels(page: Page) -> list[Axes]:
    """Return new panels for x over t, v over t, and the phase plane beside or below them."""
    narrow = canvas.width_of(page) < NARROW
    layout, heights = ("x;v;p", [1.0, 1.0, 1.6]) if narrow else ("xp;vp", [1.0, 1.0])
    figure = canvas.Picture(page, 1.6 if narrow else 1.25)
    panels = figure.subplot_mosaic(layout, height_ratios=heights)
    panels["v"].sharex(panels["x"])
    panels["x"].tick_params(labelbottom=False)
    figure.align_ylabels([panels["x"], panels["v"]])
    panels["p"].locator_params(axis="x", nbins=5)
    return [panels["x"], panels["v"], panels["p"]]


def _draw_curves(
    panels: Sequence[Axes],
    motion: PointMotion,
    colour: str | np.ndarray | None = None,
    dash: Any = "-",
    m: int = 0,
) -> None:
    """Draw the motion in each panel, by default in the plain colour.

    Dashes in the phase plane have one repetition, of `m` periods: those of the next would close it.
    """
    colour = data_colour() if colour is None else colour
    t, x, v = motion.flow(per_period=200)
    t = t - motion.rows[0, 0]
    width = 0.9 if motion.rows.shape[1] < 5000 else 0.4
    turn = 2.0 * np.pi / motion.oscillator.omega
    once = t <= m * turn if m and dash != "-" else np.ones(len(t), bool)
    for panel, line in zip(panels, ((t, x), (t, v), (x[once], v[once])), strict=True):
        (curve,) = panel.plot(*line, color=colour, ls=dash, linewidth=width, zorder=2.0)
        curve.set_rasterized(len(t) > 50_000)


def _mark_impacts(panels: Sequence[Axes], motion: PointMotion, grey: bool) -> None:
    """Mark the impacts of the motion, and its samples beyond the stop."""
    rows = motion.rows
    marks = (
        (motion.impacts, data_colour(1), "impacts"),
        (rows[:, rows[1] > motion.oscillator.clearance], VERMILION, "samples beyond the stop"),
    )
    for (t, x, v), colour, text in marks:
        if not t.size:
            continue
        t = t - rows[0, 0]
        for panel, marked in zip(panels, ((t, x), (t, v), (x, v)), strict=True):
            (points,) = panel.plot(*marked, "o", color=colour, zorder=3.0)
            points.set(markersize=2.5, markeredgewidth=0)
            if grey and text != "impacts":
                points.set(color=ink(), marker="x", markeredgewidth=0.6)
            points.set_label(text if panel is panels[-1] else "_")
