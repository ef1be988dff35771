"""Draws the bifurcation diagram, up and down in two colours, and its panel below."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from sweeps.errors import Refused
from sweeps.opened.coordinates import ORDINATES, coordinate_in
from sweeps.opened.opened_sweep import OpenedSweep, Selection
from sweeps.plotting import canvas, contents, labels, style
from sweeps.plotting.colours import Paint, legend_entries, paint_of
from sweeps.plotting.exact_lines import draw_branches, label_lines, without_gaps, without_idle
from sweeps.plotting.marks import agreeing, draw_jumps, draw_points, mark_status, widen_if_constant
from sweeps.plotting.page import PAGE, Page, styled
from sweeps.plotting.pixels import draw_density, in_view, value_ranges
from sweeps.plotting.table_points import draw_overlay, read_overlay
from sweeps.store.variables import DIRECTION, FLAGS
from vibroimpact.points.regimes import NO_CLASS, OF_REGIMES, has_result

#: More points than this are drawn as a density, because single markers would merge.
DENSITY_FROM = 2_000_000
#: Runs of chaos, and gaps in it, of so small a part of the axis are left out.
_RUNS = 50
#: Height of a panel below the diagram, relative to the height of the diagram.
_LOWER = 0.4
#: Size of the larger Lyapunov exponent, as of other scalars, and of the second one.
_EXPONENTS = 1.0, 0.5
#: Markers of the directions in grey.
_MARKERS = [look.marker for look in style.DIRECTION_LOOKS[True]]


@functools.partial(styled, marks=True)
def bifurcation(
    sweep: OpenedSweep,
    *,
    axes: Sequence[str] = (),
    at: Selection | None = None,
    coordinate: str | None = None,
    exact: xr.Dataset | None = None,
    below: Sequence[contents.NameOrArray] = (),
    color: contents.NameOrArray | None = None,
    overlay: Any = None,
    page: Page = PAGE,
    ax: Axes | None = None,
) -> Figure:
    """Draw a coordinate of the section or of the impacts over one swept axis.

    Points that failed or are not computed yet are not drawn, but marked below the diagram. So are
    motions on their way to m/q; over impacts, so are those of which less than a
    repetition was kept, and the title says how many impacts are left out. If the axis was followed
    both ways, values that both ways have are dark, and an arrow leads from the end of a motion to
    the next one; with `color`, only one direction is drawn, by default the first.

    Parameters
    ----------
    axes : str or sequence of str, optional
        The swept axis, by default the one with most values.
    coordinate : str, optional
        ``poincare_x``, ``poincare_v``, ``poincare_height``, ``impact_v`` or ``impact_phase``, by
        default the first in the file; or an extreme, ``peak_to_peak``, ``x_min`` or ``x_max``.
    exact : Dataset, optional
        Exact branches to draw over the points: the result of `sweeps.branches` for this axis.
    below : str or DataArray, or a sequence of these, optional
        Variables of the file with a number per point, for example ``lyapunov``, or numbers computed
        from the Dataset, with ``long_name`` and ``units``; each gets a panel below the diagram.
    color : str or DataArray, optional
        What colours the points, as for `below`; ``period`` gives the classes the colours of a map.
        By default the colours tell directions apart (``direction``), if the axis was followed in
        both.

    Examples
    --------
    >>> ds = sweeps.open_sweep("flip.h5")  # of the example of `run_sweep`
    >>> sweeps.plotting.bifurcation(ds, below=["impacts_per_period"]).savefig("flip.png")
    """
    if ax is not None and below:
        raise Refused("panels below a diagram need a figure of their own: leave out ax or below")
    sweep, names, tint = _with_numbers(sweep, below, color)
    line, axis, coordinate = contents.select_line(sweep, axes, at, coordinate)
    if tint is not None:
        line = line.each_direction[0]
    if exact is not None:
        contents.refuse_without_branches(coordinate)
        noun = "branches" if "branch" in exact else "curves, which a map shows,"
        exact = contents.fitting_orbits(exact, noun, [axis], _OF_BRANCHES | {coordinate}, line)
    points = read_overlay(overlay, sweep, [[axis], [coordinate, *names]])
    paint = None if tint is None else paint_of(line, tint, dots=True, grey=page.grey)
    rgba = None if paint is None else paint.colours()
    motions = _Motions(line, axis, coordinate, rgba, page.grey)
    heights, shared = [1.0] + [_LOWER] * len(names), range(len(names) + 1)
    panels = canvas.stacked_panels(page, heights, shared) if ax is None else [ax]
    panel, lower = panels[0], panels[1:]
    labels.label_axis(panels[-1].xaxis, line[axis])
    labels.label_axis(panel.yaxis, labels.as_variable(coordinate, sweep))
    for panel_below, name in zip(lower, names, strict=True):
        labels.label_axis(panel_below.yaxis, line[name], heading=True)
    record = labels.record_text(line, coordinate)
    low, high = motions.draw_points(panel)
    branches, idle = dict[str, list[Line2D]](), list[Artist]()
    if exact is not None:
        branches, idle = motions.draw_exact(panel, exact, page.marks)
        low, high = panel.dataLim.intervaly
    if len(motions.values) > 100:
        labels.set_lim(panel.xaxis, motions.values.min(), motions.values.max())
    widen_if_constant(panel.yaxis, low, high)
    page = page.set_limits(panel, fit=True)
    for panel_below, name in zip(lower, names, strict=True):
        motions.draw_scalar(panel_below, name)
        page.fit_ordinate(panel_below)
    if paint is not None:
        paint = motions.mark_cells(panels, paint)
    motions.name_directions(panel)
    of_each = zip(panels, [coordinate, *names], strict=True)
    measured = draw_overlay(points, [(each, axis, name) for each, name in of_each], page)
    jumps = motions.draw_jumps(panel) if page.marks else []
    motions.mark_points(panel, page.marks)
    handles = [handle for each in panels for handle in each.get_legend_handles_labels()[0]]
    handles, title = legend_entries(paint, panels, handles)
    handles += [*jumps, *label_lines(branches), *idle, *measured]
    figure = canvas.finish(panel, page, line, handles, title, record)
    if motions.dense:
        arguments = motions.values, motions.directions, coordinate, motions.colours, motions.rgba
        if not draw_density(panel, *arguments):
            canvas.refuse_limits(page, np.empty(0))
    return figure


#: What a diagram needs of exact branches, besides the coordinate.
_OF_BRANCHES = {"branch", "m", "q", "stable", "impact_phase", "range"}


def _with_numbers(
    sweep: OpenedSweep, below: Sequence[contents.NameOrArray], color: contents.NameOrArray | None
) -> tuple[OpenedSweep, list[str], str | None]:
    """Return the dataset with the quantities, the names below, and the one that colours points."""
    names, tint = list[str](), None
    for quantity in below:
        sweep, name = contents.with_number(sweep, quantity)
        if name in FLAGS or name in sweep.data.coords:
            why = "its numbers stand for words" if name in FLAGS else "it is no result"
            raise Refused(f"{name} cannot be drawn below a diagram: {why}")
        if name in names:
            raise Refused(f"{name} is asked for twice below the diagram")
        names.append(name)
    if color is not None:
        sweep, tint = contents.with_number(sweep, color, for_colour=True)
    return sweep, names, None if tint == DIRECTION else tint


def _within(chaos: np.ndarray, values: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function that says whether there is chaos at a place of the axis."""
    # Lines that alternate with short runs would read as dashes.
    order = np.argsort(values)
    chaos = without_gaps(chaos[order], max(1, len(values) // _RUNS))
    return lambda x: np.interp(x, values[order], chaos.astype(float)) > 0.5


class _Motions:
    """The motions of a diagram: the `directions` in which a `line` was followed, over `values`."""

    def __init__(
        self, line: OpenedSweep, axis: str, coordinate: str, rgba: np.ndarray | None, grey: bool
    ) -> None:
        """Split a line into its directions; colours of the points have the shape (n, 4)."""
        self.line, self.axis, self.coordinate, self.grey = line, axis, coordinate, grey
        self.values, self.directions, self.rgba = line[axis].values, line.each_direction, rgba
        #: Where the motions of all directions are chaotic or unknown.
        self.chaos = np.full(len(self.values), all(name in line for name in OF_REGIMES))
        for direction in self.directions if self.chaos.all() else ():
            self.chaos &= np.isin(direction.regimes, NO_CLASS)
        self.dots = list[Line2D]()
        self.colours = [style.dot_colour(look.colour) for look in style.DIRECTION_LOOKS[grey]]
        computed = int(has_result(line["status"].values).sum())
        self.dense = computed * line.sizes[ORDINATES[coordinate].dimension] > DENSITY_FROM

    def draw_points(self, panel: Axes) -> tuple[float, float]:
        """Draw markers, or make room for a density; return the range of the ordinates."""
        ranges = value_ranges(self.directions, self.coordinate)
        if np.isnan(ranges).all():
            contents.refuse_empty(self.line, self.coordinate)
        if self.dense:
            panel.plot(np.repeat(self.values, 2), ranges.ravel(), visible=False)
        else:
            self._draw_markers(panel, self._records())
        return float(np.nanmin(ranges)), float(np.nanmax(ranges))

    def _records(self) -> list[np.ndarray]:
        """Return the coordinate in each direction, shape (n, record), NaN without a result."""
        return [
            np.where(
                has_result(direction["status"].values)[:, None],
                coordinate_in(direction.data, self.coordinate).values,
                np.nan,
            )
            for direction in self.directions
        ]

    def _draw_markers(self, panel: Axes, records: Sequence[np.ndarray], **props: Any) -> None:
        """Draw values of each direction, shape (n, k); those of both have a colour of their own."""
        colours: Sequence[str | np.ndarray] = self.colours
        if len(self.directions) == 1:
            colours = [style.data_colour() if self.rgba is None else self.rgba]
        layers = [(y, np.isfinite(y), tint) for y, tint in zip(records, colours, strict=False)]
        if len(layers) == 2:
            dark = style.dot_colour(style.BOTH_COLOUR)
            props = {"most": 1.6} | props  # thin, so that both directions are seen
            up, down = records
            both = agreeing(up, down, self.chaos)
            apart = [(y, fine & ~b, tint) for (y, fine, tint), b in zip(layers, both, strict=True)]
            layers = [(y, b, dark) for y, b in zip(records, both, strict=True)] + apart
        shapes = len(layers) * ["o"]
        if len(layers) == 4 and self.grey:
            shapes[2:], props = _MARKERS, props | {"most": 2.6}
        for (y, where, colour), marker in zip(layers, shapes, strict=True):
            x = np.broadcast_to(self.values[:, None], y.shape)[where]
            if not isinstance(colour, str):
                colour = np.broadcast_to(colour[:, None], (*y.shape, 4))[where]
            before = len(panel.lines)
            draw_points(panel, x, y[where], colour, marker=marker, **props)
            self.dots += panel.lines[before:]

    def draw_exact(
        self, panel: Axes, exact: xr.Dataset, marks: bool
    ) -> tuple[dict[str, list[Line2D]], list[Artist]]:
        """Draw exact branches; return their lines by name, and a handle that counts the others."""
        exact, idle = without_idle(exact, self.line)
        is_plain = len(self.directions) == 1 and self.rgba is None and not self.grey
        in_chaos = _within(self.chaos, self.values)
        branches = draw_branches(panel, exact, self.coordinate, is_plain, in_chaos, marks)
        counted = Line2D([], [], linestyle="", label=f"branches not drawn: {idle}")
        return branches, [counted] if idle else []

    def mark_cells(self, panels: Sequence[Axes], paint: Paint) -> Paint:
        """In grey, mark some points, of many the last; return the colours of all within limits."""
        last = slice(-4, None) if self.dense else slice(None)
        line = self.directions[0].isel({ORDINATES[self.coordinate].dimension: last})
        y = coordinate_in(line.data, self.coordinate).values
        x, (panel, *lower) = np.broadcast_to(self.values[:, None], y.shape), panels
        paint.add_markers(panel, x, y)
        if lower or self.dense:  # panels below have other ordinates, and a density has more
            y = np.full(y.shape, panel.get_ylim()[0])
        visible = in_view(panel, x, y)
        return paint.within(np.asarray(visible.any(axis=1)))

    def name_directions(self, panel: Axes) -> None:
        """Name the colours of the directions within limits, with the symbol of the axis."""
        if len(self.directions) == 1:
            return
        visible = {dots.get_color() for dots in self.dots if canvas.is_in_view(dots)}
        texts = *labels.direction_names(self.line), "both"
        colours = *self.colours, style.dot_colour(style.BOTH_COLOUR)
        shapes = (*_MARKERS, "o") if self.grey and not self.dense else 3 * ("o",)
        for text, colour, shape in zip(texts, colours, shapes, strict=True):
            if self.dense or colour in visible:
                marker = "s" if self.dense else shape
                panel.plot([], [], marker, color=colour, markersize=4, label=text)

    def draw_jumps(self, panel: Axes) -> list[Artist]:
        """Draw an arrow where a motion that was followed ends, unless a density is drawn."""
        if len(self.directions) != 2 or self.dense:
            return []
        order = np.argsort(self.values)
        up, down = (record[order] for record in self._records())
        return draw_jumps(panel, self.values[order], up, down, self.colours)

    def mark_points(self, panel: Axes, marks: bool) -> None:
        """Mark points that failed and, if asked for, those that do not show their whole orbit."""
        masks = {style.APPROACHING: self.line.on_its_way} if marks else {}
        if marks and ORDINATES[self.coordinate].dimension == "impact":
            masks = {style.PARTIAL: self.line.shows_part, **masks}
        mark_status(panel, self.values, self.line["status"].values, masks, self.grey)

    def draw_scalar(self, panel: Axes, name: str) -> None:
        """Draw a scalar, or both Lyapunov exponents, over the axis."""
        columns = [
            np.asarray(direction[name].values, float).reshape(len(self.values), -1)
            for direction in self.directions
        ]
        if name == "period":
            columns = [np.where(y > 0.0, y, np.nan) for y in columns]  # 0: no class
        contents.refuse_without_value(columns, name)
        size = float(np.clip(250.0 / len(self.values), 0.8, 2.5))
        for exponent, share in zip(range(columns[0].shape[1]), _EXPONENTS, strict=False):
            self._draw_markers(panel, [y[:, [exponent]] for y in columns], size=share * size)
        if name == "lyapunov":
            panel.axhline(0.0, color=style.ink(), linewidth=0.6, zorder=1)
            is_plain = len(self.directions) == 1 and self.rgba is None
            colour = style.data_colour() if is_plain else style.dot_colour(style.BOTH_COLOUR)
            for number, share in enumerate(_EXPONENTS[: columns[0].shape[1]], 1):
                text = rf"$\lambda_{number}$"
                panel.plot([], [], "o", color=colour, markersize=4 * share, label=text)
