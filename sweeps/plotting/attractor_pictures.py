"""Draws `Basins` over starts, and the diagram of attractors along a parameter."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Self

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from sweeps.attractor.attractor_table import (
    AttractorRow,
    attractor_rows,
    parameter_axes,
)
from sweeps.attractor.attractors import attractors
from sweeps.config.groups import STARTS
from sweeps.errors import Refused
from sweeps.opened.coordinates import ORDINATES, records
from sweeps.opened.opened_sweep import START_AXES, OpenedSweep, Selection
from sweeps.plotting import canvas, labels
from sweeps.plotting.contents import refuse_empty, refuse_without_result, with_coordinate
from sweeps.plotting.looks import (
    Cells,
    Looks,
    basin_cells,
    class_names,
    class_of_numbers,
    failed_cells,
    names_of,
)
from sweeps.plotting.maps import draw_cells, entries_of, name_and_bound, view_of
from sweeps.plotting.marks import edge_of, mark_some, mark_status, marker_size, widen_if_constant
from sweeps.plotting.page import PAGE, Page, styled
from sweeps.plotting.pixels import in_view
from sweeps.plotting.style import PARTIAL, Look, ground, ink
from sweeps.store.variables import DIRECTION
from sweeps.text import fewest_digits, listed, shown_count
from vibroimpact.points.regimes import NO_CLASS, Regime

#: Most basins beside each other, and the least width of each, for its labels [inch].
_MOST_BESIDE, _LEAST_WIDTH = 6, 5.0 / 3.0
#: Height of the labels of each row of these [inch], and of the panel as a share of its width.
_LABELS, _SHAPE = 0.5, 0.75


@styled
def basins(
    sweep: OpenedSweep,
    *,
    at: Selection | None = None,
    beside: Mapping[str, Sequence[float]] | None = None,
    page: Page = PAGE,
    ax: Axes | None = None,
) -> Figure:
    """Draw the basins of attraction over starts: one cell per start, coloured by its attractor.

    The first attractor of a class has the colour of the class, and further ones have colours of
    their own. Two of x0, v0 and phase must be swept, and the period must be recorded. The periodic
    attractors are marked over x0 and v0 if the section is at the phase of the starts.

    Parameters
    ----------
    beside : mapping of str to sequence of float, optional
        Several values of one swept axis, at most six: the basins at each have a panel.

    Examples
    --------
    >>> ds = sweeps.open_sweep("basins.h5")  # of the example of `attractors`
    >>> sweeps.plotting.basins(ds).savefig("basins.png")
    """
    plane = _plane_of(sweep, at)
    if beside is not None:
        return _basins_beside(sweep, at or {}, beside, plane, page, ax)
    starts = sweep.cut(at, free=plane)
    panel = canvas.new_panel(ax, page)
    regions = Basins.of(starts, *attractors_in(starts, sweep, page.grey), *plane)
    regions.draw(panel, page)
    view = view_of(panel, regions.starts)
    handles = [*entries_of(regions.starts, regions.cells(), view), *regions.mark_attractors(panel)]
    figure = canvas.finish(panel, page, starts, handles, labels.basins_title(sweep))
    regions.write_names(panel, page)
    return figure


class Basins(NamedTuple):
    """The basins at one parameter point: the `starts`, by ordinate and abscissa, and attractors."""

    starts: OpenedSweep
    table: list[AttractorRow]
    numbers: np.ndarray  # of the rows of the table, for each start
    looks: Looks

    @classmethod
    def of(
        cls, starts: OpenedSweep, point_result: xr.Dataset, looks: Looks, across: str, up: str
    ) -> Self:
        """Return the basins, given the attractors at the point."""
        numbers = point_result["attractor"].sortby([across, up]).transpose(up, across).values
        ordered = starts.sortby([across, up]).transpose(up, across)
        return cls(ordered, attractor_rows(starts, point_result), numbers, looks)

    def draw(self, panel: Axes, page: Page) -> None:
        """Draw the basins within the limits of a page."""
        draw_cells(panel, self.starts, self.cells())
        page.set_limits(panel)

    def cells(self) -> list[Cells]:
        """Return the cells of each basin, and of the starts that failed."""
        of_basins = basin_cells(self.table, self.numbers, self.looks, self.starts)
        return of_basins + failed_cells(self.starts["status"].values)

    def mark_attractors(self, panel: Axes) -> list[Artist]:
        """Mark attractors at the section with their looks, if the starts have its phase."""
        grid, phase = self.starts.grid, self.starts["phase"]
        if "phase" in grid or float(phase) != self.starts.spec.phase:
            return []
        any_visible, props = False, dict[str, Any](linestyle="", markersize=4.5, mec=ink())
        props["path_effects"] = [withStroke(linewidth=2.4, foreground=ground())]
        for row in (row for row in self.looks.split(self.table)[0] if len(row.states)):
            look, states = self.looks.look(row), row.states.T
            props |= {"marker": look.marker, "color": look.colour}
            panel.plot(*states, scalex=False, scaley=False, **props)
            any_visible |= bool(in_view(panel, *states).any())
        props |= {"marker": "o", "color": ground(), "label": "attractors at the section"}
        return [Line2D([], [], **props)] if any_visible else []

    def write_names(self, panel: Axes, page: Page) -> None:
        """Write the names of classes into the basins; in grey, draw their boundaries."""
        name_and_bound(panel, page, self.starts, self.numbers, class_of_numbers(self.table))


def _plane_of(sweep: OpenedSweep, at: Selection | None) -> tuple[str, str]:
    """Return the abscissa and the ordinate of basins: the two axes of starts that are not fixed."""
    axes = sweep.axes
    plane = [name for name in STARTS if name in axes and name not in (at or {})]
    if len(plane) != 2:
        fixed = [name for name in STARTS if name in axes and name not in plane]
        raise Refused(
            f"basins need two of {', '.join(STARTS)} as axes; the file has {listed(axes) or 'none'}"
            + (f", and {listed(fixed)} is fixed here" if fixed else "")
            + ("; one of them must be fixed" if len(plane) > 2 else "")
        )
    if "phase" in plane:
        plane.reverse()  # as abscissa
    return plane[0], plane[1]


def _basins_beside(
    sweep: OpenedSweep,
    at: Selection,
    beside: Mapping[str, Sequence[float]],
    plane: tuple[str, str],
    page: Page,
    ax: Axes | None,
) -> Figure:
    """Draw the basins at several values of one axis, a panel for each, with one legend."""
    if ax is not None:
        raise Refused("basins beside each other need a figure of their own: leave out ax or beside")
    if len(beside) != 1:
        raise Refused(f"basins are beside each other for values of one axis, not {len(beside)}")
    name, values = next((name, [*map(float, several)]) for name, several in beside.items())
    if name in START_AXES:
        raise Refused(f"{name} is a start: basins are beside each other for values of a parameter")
    if not 1 <= len(values) <= _MOST_BESIDE:
        raise Refused(
            f"{name} = {', '.join(map(fewest_digits, values))}: {shown_count(len(values), 'value')}"
            f" beside each other; expected: at most {_MOST_BESIDE}"
        )
    line = sweep.at_values({name: values}).cut(at, free=[name, *plane])
    across = min(len(values), 3, max(1, int(canvas.width_of(page) / _LEAST_WIDTH)))
    row = _LABELS + _SHAPE * canvas.width_of(page) / across
    row /= mpl.rcParams["figure.figsize"][1]
    panels = canvas.panel_grid(page, len(values), across, row, sharex=True)
    line_result, looks = attractors_in(sweep.cut(at, free=[name, *plane]), sweep, page.grey)
    basins_of_panels, further = list[tuple[Axes, Basins]](), dict[str, Artist]()
    for panel, value in zip(panels, line[name].values.tolist(), strict=True):
        point_result = line_result.sel({name: value})
        regions = Basins.of(line.cut({name: value}, plane), point_result, looks, *plane)
        regions.draw(panel, page)
        starts, view = regions.starts, view_of(panel, regions.starts)
        failed = failed_cells(starts["status"].values)
        others = *entries_of(starts, failed, view), *regions.mark_attractors(panel)
        further |= {str(handle.get_label()): handle for handle in others}
        panel.set_title(labels.equation(line[name].symbol, line[name], value), loc="left")
        basins_of_panels.append((panel, regions))
    for number, panel in enumerate(panels):
        has_below = number + across < len(panels)
        panel.tick_params(labelbottom=not has_below)
        if has_below:
            panel.set_xlabel("")
        if number % across:
            panel.set_ylabel("")
    title = f"{labels.CLASSES_TITLE},\nshare of the starts in each panel"
    handles = [*_shared_handles(basins_of_panels, looks), *further.values()]
    figure = canvas.finish(panels[0], page, line, handles, title)
    for panel, regions in basins_of_panels:
        regions.write_names(panel, page)
    return figure


def _shared_handles(basins_of_panels: Sequence[tuple[Axes, Basins]], looks: Looks) -> list[Artist]:
    """Return an entry of a legend for each look and class in several panels, with the shares."""
    shares: dict[tuple[Look, str], np.ndarray] = {}
    for number, (panel, regions) in enumerate(basins_of_panels):
        of_starts = regions.numbers[view_of(panel, regions.starts)]
        for row in regions.table:
            name = class_names([row]) if looks.has_own(row) else "other periodic attractors"
            of_panels = shares.setdefault((looks.look(row), name), np.zeros(len(basins_of_panels)))
            cells = Cells(name, looks.look(row), of_starts == row.number, of_starts >= 0)
            of_panels[number] += cells.share
    return [
        Cells(f"{name}: {', '.join(f'{share:.1f}' for share in each)} %", look, each).handle()
        for (look, name), each in shares.items()
        if each.any()
    ]


def attractors_in(cut: OpenedSweep, sweep: OpenedSweep, grey: bool) -> tuple[xr.Dataset, Looks]:
    """Return the attractors in a cut, numbered as in the file, and the looks of the file."""
    indices = sweep.indices({name: cut[name].item() for name in {*sweep.grid} - {*cut.grid}})
    starts = {name: indices.pop(name) for name in indices.keys() & {*START_AXES}}
    file_result = attractors(sweep.isel(starts))
    return file_result.isel(indices), Looks.of(file_result, grey)


@functools.partial(styled, marks=True)
def attractor_diagram(
    sweep: OpenedSweep,
    *,
    axes: Sequence[str] = (),
    at: Selection | None = None,
    coordinate: str | None = None,
    page: Page = PAGE,
    ax: Axes | None = None,
) -> Figure:
    """Draw all attractors that the starts reach over one swept parameter.

    They have the colours of their classes, as in `basins`.

    The motion from one start of each attractor is drawn: one repetition of a motion that repeats,
    or the whole record of another one. The period must be recorded.

    Parameters
    ----------
    axes : str or sequence of str, optional
        The swept parameter, by default the one with most values.
    coordinate : str, optional
        As for `sweeps.plotting.bifurcation`.

    Examples
    --------
    >>> ds = sweeps.open_sweep("two_basins.h5")  # of the example of `plotting.integrity`
    >>> sweeps.plotting.attractor_diagram(ds).savefig("attractors.png")
    """
    free = [name for name in sweep.grid if name in START_AXES]
    if free and not parameter_axes(sweep):
        raise Refused(
            f"a diagram of attractors is over a swept parameter, and only {listed(free)} "
            f"{'was' if len(free) == 1 else 'were'} swept"
            + ("; the picture of both is basins" if len(free) == 2 else "")
        )
    parameters = sweep.isel(dict.fromkeys(free, 0))
    (axis,) = parameters.chosen_axes(axes, at, 1, "diagram of attractors")
    sweep, coordinate = with_coordinate(sweep, coordinate)
    line = sweep.cut(at, free=[axis, *free])
    refuse_without_result(line["status"].values)
    line_result, looks = attractors_in(line, sweep, page.grey)
    table = attractor_rows(line, line_result)
    values = line[axis].values
    status = line["status"].transpose(axis, ...).values.reshape(len(values), -1)
    panel = canvas.new_panel(ax, page)
    labels.label_axis(panel.xaxis, line[axis])
    labels.label_axis(panel.yaxis, labels.as_variable(coordinate, sweep))
    series = _draw_rows(panel, line, table, looks, axis, coordinate)
    if len(values) > 100:
        labels.set_lim(panel.xaxis, values.min(), values.max())
    page.set_limits(panel, fit=True)
    for each in series:
        if canvas.is_in_view(each.dots):
            (handle,) = panel.plot([], [], each.look.marker, color=each.look.dots, label=each.name)
            handle.set(markersize=4.0, markeredgewidth=edge_of(each.look.marker))
    masks = {}
    if page.marks and ORDINATES[coordinate].dimension == "impact":
        masks[PARTIAL] = line.transpose(axis).shows_part.ravel()
    mark_status(panel, np.repeat(values, status.shape[1]), status.ravel(), masks, page.grey)
    title = f"{labels.CLASSES_TITLE}\n{_starts_at_each(line)}"
    record = labels.record_text(line, coordinate)
    figure = canvas.finish(panel, page, line, legend_title=title, record=record)
    if page.grey:
        for each in series:
            if looks.has_own(each.rows[0]) and each.rows[0].regime not in NO_CLASS:
                points = np.asarray(each.dots.get_xydata())
                mark_some(panel, points, each.look.marker, each.look.dots)
    return figure


def _starts_at_each(line: OpenedSweep) -> str:
    """Say how many motions there are at each value of the axis, and whether both ways."""
    starts = math.prod(line.sizes[name] for name in STARTS if name in line.grid)
    text = f"{shown_count(starts, 'start')} at each value"
    if DIRECTION not in line.grid:
        return text
    return labels.followed(line) if starts == 1 else f"{text}, {labels.followed(line)}"


class _Series(NamedTuple):
    """The attractors of a diagram with one look, the dots drawn of them, their name."""

    rows: list[AttractorRow]
    look: Look
    dots: Line2D
    name: str


def _draw_rows(
    panel: Axes,
    line: OpenedSweep,
    table: Sequence[AttractorRow],
    looks: Looks,
    axis: str,
    coordinate: str,
) -> list[_Series]:
    """Draw the record of each attractor, with the periodic ones on top."""
    series = looks.by_look(table)
    table = [row for rows in series for row in rows]
    values = records(line, coordinate, np.array([row.point for row in table]))
    if coordinate.startswith("poincare"):
        for record, row in zip(values, table, strict=True):
            record[: -row.m] = np.nan  # where m = 0, the whole record is drawn
    finite = values[np.isfinite(values)]
    if not len(finite):
        refuse_empty(line, coordinate)
    widen_if_constant(panel.yaxis, finite.min(), finite.max())
    names = map("".join, names_of(series, line, line[axis]))
    result, groups = [], np.split(values, np.cumsum([*map(len, series)])[:-1])
    for rows, name, y in zip(series, names, groups, strict=True):
        x = np.broadcast_to([[row.parameters[axis]] for row in rows], y.shape)[np.isfinite(y)]
        y = y[np.isfinite(y)]
        first, look = rows[0], looks.look(rows[0])
        (dots,) = panel.plot(x, y, "o", color=look.dots, rasterized=True)
        scattered = first.regime is not Regime.PERIODIC
        least, most, zorder = (0.8, 1.2, 2.0) if scattered else (1.5, 2.0, 3.0)
        size = marker_size(x, y, least, most)
        dots.set(markersize=size, markeredgewidth=0, zorder=zorder)
        label = name if looks.has_own(first) else "other periodic attractors"
        result.append(_Series(rows, look, dots, label))
    return result
