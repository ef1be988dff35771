"""The diagram of the attractors that coexist along a parameter, in the colours of their classes."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sweeps.attractor.attractor_table import (
    AttractorRow,
    attractor_rows,
    classes_text,
    parameter_axes,
)
from sweeps.config.groups import STARTS
from sweeps.errors import Refused
from sweeps.opened.coordinates import COORDINATES, records, shows_part
from sweeps.opened.opened_sweep import START_AXES, OpenedSweep, Selection
from sweeps.plotting import canvas
from sweeps.plotting.basin_pictures import attractors_in, names_of
from sweeps.plotting.contents import choose_coordinate, refuse_empty, refuse_without_result
from sweeps.plotting.labels import CLASSES_TITLE, as_variable, followed, label_axis, record_text
from sweeps.plotting.looks import Looks
from sweeps.plotting.names import name_lines
from sweeps.plotting.page import PAGE, Page, styled
from sweeps.plotting.style import PARTIAL, Look
from sweeps.store import DIRECTION
from sweeps.text import choice_of, listed, shown_count
from vibroimpact.points.regimes import NO_CLASS, Regime


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
    axes : sequence of str, optional
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
    coordinate = choose_coordinate(sweep, coordinate)
    for name in set(free) & set(at or {}):
        raise Refused(f"{name} cannot be fixed here; {choice_of(parameter_axes(sweep))}")
    line = sweep.cut(at, free=[axis, *free])
    refuse_without_result(line["status"].values)
    found, looks = attractors_in(line, sweep, page.grey)
    table = attractor_rows(line, found)
    values = line[axis].values
    status = line["status"].transpose(axis, ...).values.reshape(len(values), -1)
    panel = canvas.new_panel(ax, page)
    label_axis(panel.xaxis, line[axis])
    label_axis(panel.yaxis, as_variable(coordinate, sweep.config.nomenclature))
    series = _draw_rows(panel, line, table, looks, axis, coordinate)
    if len(values) > 100:
        panel.set_xlim(values.min(), values.max())
    page.fit_ordinate(panel)
    page.set_limits(panel)
    masks = {}
    if page.marks and COORDINATES[coordinate].dimension == "impact":
        masks[PARTIAL] = shows_part(line.transpose(axis)).ravel()
    canvas.mark_status(panel, np.repeat(values, status.shape[1]), status.ravel(), masks, page.grey)
    title = f"{CLASSES_TITLE}\n{_starts_at_each(line)}"
    record = record_text(line, coordinate)
    figure = canvas.finish(panel, page, line, legend_title=title, record=record)
    if page.grey:
        for _, look, points in series:
            canvas.mark_some(panel, points, look.marker, look.ink)
        named = [one for one in series if one.rows[0].regime is Regime.PERIODIC]
        name_lines(panel, [(classes_text(one.rows), one.points) for one in named])
    return figure


def _starts_at_each(line: OpenedSweep) -> str:
    """Say how many motions there are at each value of the axis, and whether both ways."""
    starts = math.prod(line.sizes[name] for name in STARTS if name in line.grid)
    text = f"{shown_count(starts, 'start')} at each value"
    if DIRECTION not in line.grid:
        return text
    return followed(line) if starts == 1 else f"{text}, {followed(line)}"


class _Series(NamedTuple):
    """The attractors of a diagram with one look, and the points drawn of them, shape (n, 2)."""

    rows: list[AttractorRow]
    look: Look
    points: np.ndarray


def _draw_rows(
    panel: Axes,
    line: OpenedSweep,
    table: Sequence[AttractorRow],
    looks: Looks,
    axis: str,
    coordinate: str,
) -> list[_Series]:
    """Draw the record of each attractor, with the periodic ones on top.

    Return the series that have a look of their own and a marker.
    """
    values = records(line, coordinate, np.array([row.point for row in table]))
    if coordinate.startswith("poincare"):
        for record, row in zip(values, table, strict=True):
            record[: -row.m] = np.nan  # where m = 0, the whole record is drawn
    finite = values[np.isfinite(values)]
    if not len(finite):
        refuse_empty(line, coordinate)
    canvas.widen_if_constant(panel.set_ylim, finite.min(), finite.max())
    abscissa = np.array([row.parameters[axis] for row in table])
    series = looks.series(table)
    names = names_of([[table[i] for i in places] for places in series], line.config, line[axis])
    marked = []
    for places, name in zip(series, map("".join, names), strict=True):
        y = values[places]
        x = np.broadcast_to(abscissa[places, None], y.shape)[np.isfinite(y)]
        y = y[np.isfinite(y)]
        first = table[places[0]]
        look, own = looks.look(first), looks.has_own(first)
        (points,) = panel.plot(x, y, "o", color=look.ink, rasterized=True)
        scattered = first.regime is not Regime.PERIODIC
        least, most, zorder = (0.8, 1.2, 2.0) if scattered else (1.5, 2.0, 3.0)
        size = canvas.marker_size(x, y, least, most)
        points.set(markersize=size, markeredgewidth=0, zorder=zorder)
        label = name if own else "other periodic attractors"
        (handle,) = panel.plot([], [], look.marker, color=look.ink, label=label)
        handle.set(markersize=4.0, markeredgewidth=0)
        if own and first.regime not in NO_CLASS:
            marked.append(_Series([table[i] for i in places], look, np.stack([x, y], axis=1)))
    return marked
