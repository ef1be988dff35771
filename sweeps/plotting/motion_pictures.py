"""Draws motions in time and phase plane, their section, their impacts."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from sweeps.errors import Refused
from sweeps.opened import coordinates
from sweeps.opened.opened_sweep import OpenedSweep, Selection
from sweeps.plotting import labels
from sweeps.plotting.canvas import Picture, finish, new_panel, width_of
from sweeps.plotting.colours import Paint, coloured_points, legend_entries
from sweeps.plotting.contents import NameOrArray, refuse_without_value
from sweeps.plotting.looks import Cells
from sweeps.plotting.marks import draw_points, draw_stop, in_both, widen_if_constant
from sweeps.plotting.page import PAGE, Page, styled
from sweeps.plotting.pixels import in_view
from sweeps.plotting.style import BOTH_COLOUR, Look, data_colour, dot_colour, ink
from sweeps.store.variables import DIRECTION, TRAJECTORIES
from sweeps.text import shown_count
from vibroimpact.points.regimes import Label, Regime, has_result


def _draw_records(
    sweep: OpenedSweep,
    names: tuple[str, str],
    at: Selection | None,
    color: NameOrArray | None,
    page: Page,
    ax: Axes | None,
    set_view: Callable[[Axes, OpenedSweep, Sequence[np.ndarray]], None],
) -> Figure:
    """Draw two coordinates recorded at one point or, with a color, at all that `at` leaves."""
    # `set_view` gets the panel, the points drawn and both columns, and sets the ends of the axes.
    sweep.check(*names)
    paint, rgba, handles = None, None, list[Artist]()
    if color is None:
        points = sweep.cut(at)
        columns = coordinates.values_at_point(points, names)
    else:
        points, paint = coloured_points(sweep, at, color, page.grey)
        by_point = np.array([points[name].transpose(*points.grid, ...) for name in names])
        finite = np.isfinite(by_point).all(axis=0)
        refuse_without_value(by_point, names[0])
        rgba = np.broadcast_to(paint.colours()[..., None, :], (*finite.shape, 4)).copy()
        columns = list(by_point[:, finite])
        both = np.zeros(finite.shape, bool)
        if paint.variable.name == DIRECTION and DIRECTION in points.grid:
            both = in_both(by_point, points.grid.index(DIRECTION))
        rgba[both] = to_rgba(dot_colour(BOTH_COLOUR))
        rgba = rgba[finite]
    panel = new_panel(ax, page)
    draw_points(panel, columns[0], columns[1], rgba)
    for axis, name in zip((panel.xaxis, panel.yaxis), names, strict=True):
        labels.label_axis(axis, points[name])
    set_view(panel, points, columns)
    page.set_limits(panel, fit="poincare_v" in names)  # speeds of impacts begin at 0
    if paint is not None:
        visible = in_view(panel, *by_point)
        if (both & visible).any():
            handles = [Cells("both", Look.plain(dot_colour(BOTH_COLOUR)), both).handle()]
        by_point[:, both & page.grey] = np.nan  # without the marker of a direction
        paint.add_markers(panel, *by_point)
        paint = paint.within(np.asarray((visible & ~both).any(axis=-1)))
    handles += panel.get_legend_handles_labels()[0]
    handles, title = legend_entries(paint, [panel], handles)
    return finish(panel, page, points, handles, title, labels.record_text(points, names[1]))


@styled
def section(
    sweep: OpenedSweep,
    *,
    at: Selection | None = None,
    color: NameOrArray | None = None,
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

    def set_view(panel: Axes, points: OpenedSweep, columns: Sequence[np.ndarray]) -> None:
        """Draw the stop."""
        (x, v), clearance = columns, points["clearance"]
        ends = [x.min(), x.max()]
        if not clearance.dims:
            draw_stop(panel.axvline, float(clearance), labels.as_variable("clearance", sweep))
            ends.append(float(clearance))
        widen_if_constant(panel.xaxis, min(ends), max(ends))
        widen_if_constant(panel.yaxis, v.min(), v.max())

    return _draw_records(sweep, ("poincare_x", "poincare_v"), at, color, page, ax, set_view)


@styled
def impacts(
    sweep: OpenedSweep,
    *,
    at: Selection | None = None,
    color: NameOrArray | None = None,
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

    def set_view(panel: Axes, *_: object) -> None:
        """Show a whole period, and speeds from 0."""
        quarters = ["0", r"$\pi/2$", r"$\pi$", r"$3\pi/2$", r"$2\pi$"]
        panel.set_xticks(0.5 * np.pi * np.arange(5), quarters)
        labels.set_lim(panel.xaxis, 0.0, 2.0 * np.pi)
        labels.set_lim(panel.yaxis, 0.0, panel.get_ybound()[1])

    return _draw_records(sweep, ("impact_phase", "impact_v"), at, color, page, ax, set_view)


#: In a figure narrower than this [inch] the phase plane is below the other panels.
NARROW = 4.5
#: Most motions in a picture: of each, at least four periods are drawn.
_MOST_MOTIONS = coordinates.MOST_DRAWN // 4


@functools.partial(styled, panels=(3,))
def trajectory(
    sweep: OpenedSweep,
    *,
    at: Selection | None = None,
    periods: int | None = None,
    color: NameOrArray | None = None,
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
    paint, motion_class = None, None
    if color is None:
        points = sweep.cut(at)
        (motion_class,) = points.labels
        motions = [coordinates.motion_of(points, periods)]
        _draw_curves(panels, motions[0])
        _mark_impacts(panels, motions[0])
    else:
        points, paint = coloured_points(sweep, at, color, page.grey)
        motions = _draw_coloured(panels, points, paint, periods)
    if not points["clearance"].dims:
        clearance = float(points["clearance"])
        draw_stop(over_time.axhline, clearance)
        draw_stop(phase_plane.axvline, clearance, labels.as_variable("clearance", sweep))
    over_time.margins(x=0.01)
    time, x, v = (labels.as_variable(name, sweep) for name in TRAJECTORIES)
    time.attrs["symbol"] = "t-t_0"
    for panel, across, up in ((over_time, None, x), (velocity, time, v), (phase_plane, x, v)):
        labels.label_axis(panel.yaxis, up)
        if across is not None:
            labels.label_axis(panel.xaxis, across)
    deepest = max(motion.depth for motion in motions)
    if deepest > 0.0:
        depth = f"deepest penetration {deepest:.1e}"
        phase_plane.set_title(" ".join([depth, labels.named_unit(x)]).strip())
    page.set_limits(over_time, fit=True).fit_ordinate(velocity)
    handles = phase_plane.get_legend_handles_labels()[0]
    handles, title = legend_entries(paint, panels, handles, curves=True)
    start, since, record = _text_of_motions(motions, time, motion_class)
    if ax is not None or page.title is not None or len(motions) > 1:  # else the title says it
        velocity.set_xlabel(f"{velocity.get_xlabel()}, {start or f'$t_0$ {since}'}", wrap=True)
    return finish(over_time, page, points, handles, title, record)


def _draw_coloured(
    panels: Sequence[Axes], points: OpenedSweep, paint: Paint, periods: int | None
) -> list[coordinates.PointMotion]:
    """Draw a curve for each point with a result, in its colour; return the motions."""
    with_result = np.argwhere(has_result(points["status"].values))
    if len(with_result) > _MOST_MOTIONS:
        raise Refused(
            f"a picture of {len(with_result):,} motions is not readable; choose at most "
            f"{_MOST_MOTIONS} points"
        )
    most = coordinates.MOST_DRAWN // len(with_result)
    dims, colours, motions = points.grid, paint.colours(), []
    at_each = dict(zip(dims, [("motion", place) for place in with_result.T], strict=True))
    classes, dashes = points.with_data(points.data.isel(at_each)).labels, paint.dashes()
    for index, motion_class in zip(with_result, classes, strict=True):
        point = points.isel(dict(zip(dims, index.tolist(), strict=True)))
        motions.append(coordinates.motion_of(point, periods, most))
        look = colours[tuple(index)], dashes[tuple(index)]
        _draw_curves(panels, motions[-1], *look, motion_class.m if motion_class else 0)
    return motions


def _text_of_motions(
    motions: Sequence[coordinates.PointMotion], time: xr.DataArray, motion_class: Label | None
) -> tuple[str, str, str | None]:
    """Write the start of a single motion, after how long motions start, and instead of a record."""
    # The last is None if the motions start after different times.
    turns = 2.0 * np.pi / np.array([motion.oscillator.omega for motion in motions])
    starts = np.array([motion.rows[0, 0] for motion in motions])
    starts += turns * [motion.turns for motion in motions]
    begun = np.array([motion.start_phase for motion in motions])
    since = starts / turns - begun / (2.0 * np.pi)
    (after, *others) = {shown_count(periods, "forcing period", ",.6g") for periods in since}
    if others:
        return "", "of each motion", None
    start = labels.equation("t_0", time, starts[0]) if len(motions) == 1 else ""
    record = ", ".join(filter(None, [start, f"after {after}"]))
    if motion_class is not None:
        kind = "class " if motion_class.regime is Regime.PERIODIC else ""
        record = f"{kind}{motion_class}, {record}"
    most = coordinates.MOST_DRAWN // len(motions)
    periods = sum(motion.periods for motion in motions)
    count = sum(min(motion.periods, most) for motion in motions)
    record += f", {count:,} of {periods:,} periods" if count != periods else ""
    return start, f"after {after}", record


def _new_panels(page: Page) -> list[Axes]:
    """Return new panels for x over t, v over t, and the phase plane beside or below them."""
    narrow = width_of(page) < NARROW
    layout, heights = ("x;v;p", [1.0, 1.0, 1.1]) if narrow else ("xp;vp", [1.0, 1.0])
    figure = Picture(page, 1.75 if narrow else 1.25)
    panels = figure.subplot_mosaic(layout, height_ratios=heights)
    panels["v"].sharex(panels["x"])
    panels["x"].tick_params(labelbottom=False)
    figure.align_ylabels([panels["x"], panels["v"]])
    panels["p"].locator_params(axis="x", nbins=5)
    return [panels["x"], panels["v"], panels["p"]]


def _draw_curves(
    panels: Sequence[Axes],
    motion: coordinates.PointMotion,
    colour: str | np.ndarray | None = None,
    dash: Any = "-",
    m: int = 0,
) -> None:
    """Draw the motion in each panel, by default in the plain colour."""
    colour = data_colour() if colour is None else colour
    t, x, v = motion.flow(per_period=200)
    t = t - motion.rows[0, 0]
    width = 0.9 if motion.rows.shape[1] < 5000 else 0.4
    turn = 2.0 * np.pi / motion.oscillator.omega
    # The dashes of a second repetition in the phase plane would close those of the first.
    once = t <= m * turn if m and dash != "-" else np.ones(len(t), bool)
    for panel, line in zip(panels, ((t, x), (t, v), (x[once], v[once])), strict=True):
        (curve,) = panel.plot(*line, color=colour, ls=dash, linewidth=width, zorder=2.0)
        curve.set_rasterized(len(t) > 50_000)


def _mark_impacts(panels: Sequence[Axes], motion: coordinates.PointMotion) -> None:
    """Mark the impacts of the motion, and its samples beyond the stop."""
    rows = motion.rows
    beyond = rows[:, rows[1] > motion.oscillator.clearance]
    marks = (
        (motion.impacts, data_colour(1), "o", 0.0, "impacts"),
        (beyond, ink(), "x", 0.6, "samples beyond the stop"),
    )
    for (t, x, v), colour, marker, edge, text in marks:
        if not t.size:
            continue
        t = t - rows[0, 0]
        for panel, points in zip(panels, ((t, x), (t, v), (x, v)), strict=True):
            (dots,) = panel.plot(*points, marker, color=colour, ms=2.5, mew=edge, zorder=3.0)
            dots.set_label(text if panel is panels[-1] else "_")
