"""The picture of a sweep over a table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from sweeps.errors import Refused
from sweeps.grid import TABLE
from sweeps.opened.opened_sweep import OpenedSweep, Selection
from sweeps.plotting import canvas
from sweeps.plotting.colours import legend_entries, paint_of
from sweeps.plotting.contents import Wanted, number_at, refuse_without_result, with_number
from sweeps.plotting.labels import label_axis
from sweeps.plotting.marks import mark_status
from sweeps.plotting.overlay import draw_overlay, read_overlay
from sweeps.plotting.page import PAGE, Page, styled
from sweeps.text import listed, shown_count

#: Least width of a panel, for its labels [inch].
_LEAST_WIDTH = 2.3
#: Most rows of panels unless the columns are chosen: more would not fit a printed page.
_MOST_ROWS = 6


@styled
def table_panels(
    sweep: OpenedSweep,
    *,
    axes: Sequence[str] = (),
    at: Selection | None = None,
    quantity: Wanted | None = None,
    color: Wanted | None = None,
    overlay: Any = None,
    panels: Sequence[str] = (),
    page: Page = PAGE,
    ax: Axes | None = None,
) -> Figure:
    """Draw a result over the columns of a table, a panel for each.

    Parameters
    ----------
    axes : sequence of str or DataArray, optional
        Abscissas: columns of numbers or results, by default the columns that vary, as many
        as fit a page; the legend says how many are left out. With `ax`, only one.
    panels : sequence of str, optional
        Which of these have a panel, in this order.
    quantity : str or DataArray, optional
        The ordinate: a result or a column of numbers, by default ``impacts_per_period``.
    color : str or DataArray, optional
        What colours the points, by default ``period``, or ``status`` if it was not recorded.

    Examples
    --------
    >>> import sweeps
    >>> rows = {"omega": [2.3, 2.5, 2.4], "R": [0.7, 0.8, 0.75]}
    >>> scene = {"oscillator": {"h": 0.1, "f": 1.0}, "points": rows}
    >>> ds = sweeps.open_sweep(sweeps.run_sweep(scene, "table.h5", overwrite=True))
    >>> sweeps.plotting.table_panels(ds).savefig("table.png")
    """
    if TABLE not in sweep.grid:
        raise Refused("the points of this file are a grid, and not the rows of a table")
    sweep.cut(at, free=[TABLE])  # refuses a value of TABLE
    color = ("period" if "period" in sweep else "status") if color is None else color
    quantity = "impacts_per_period" if quantity is None else quantity
    sweep, (tint, ordinate, *there) = _with_columns(sweep, color, quantity, axes)
    beside = max(1, int(canvas.width_of(page) / _LEAST_WIDTH))
    abscissas = canvas.chosen_panels(panels, there)
    if not (axes or panels):
        abscissas = there[: 1 if ax is not None else _MOST_ROWS * beside]
    if ax is not None and len(abscissas) > 1:
        raise Refused(f"ax is one panel, and {listed(abscissas)} take {len(abscissas)}: choose one")
    paint = paint_of(sweep, tint, dots=True, grey=page.grey)
    points = read_overlay(overlay, sweep, [abscissas, [ordinate]])
    refuse_without_result(sweep["status"].values)
    across = min(math.ceil(math.sqrt(len(abscissas))), beside)
    grid = [ax] if ax is not None else canvas.panel_grid(page, len(abscissas), across, 0.75)
    y = number_at(sweep, ordinate)
    if ax is None:  # the panels share the ordinate, whose label may not fit beside one of them
        heading = label_axis(grid[0].yaxis, y, heading=True)
        if page.ylabel is not None:
            heading.set_text(page.ylabel)
        canvas.refuse_undrawable("ylabel", heading)
    else:
        label_axis(ax.yaxis, y)
    places = list(zip(grid, abscissas, strict=True))
    for panel, name in places:
        x = number_at(sweep, name)
        label_axis(panel.xaxis, x)
        size = float(np.clip(4e2 / math.sqrt(x.size), 0.0, 16.0))  # of a few rows [pt^2]
        size = max(size, float(np.clip(4e3 / math.sqrt(x.size), 0.3, 4.0))) / across
        panel.scatter(x, y, size, paint.colours(), linewidths=0, rasterized=True)
        panel.locator_params(axis="x", nbins=5 - across)
    page = page if ax is not None else replace(page, ylabel=None)
    page = page.on(grid[0])
    page.set_limits(grid[0])
    seen = np.zeros(y.shape, bool)
    for panel, name in places:
        x = number_at(sweep, name)
        mark_status(panel, x.values, sweep["status"].values)
        paint.mark(panel, x.values[:, None], y.values[:, None])
        seen |= canvas.in_view(panel, x.values, y.values) | np.isnan(y.values)
    paint = paint.within(seen)
    measured = draw_overlay(points, [(each, name, ordinate) for each, name in places], page)
    handles, title = legend_entries(paint, grid, grid[-1].get_legend_handles_labels()[0])
    handles += measured
    if ax is None and not (axes or panels) and (further := len(there) - len(abscissas)):
        handles.append(Line2D([], [], linestyle="", label=shown_count(further, "further column")))
    return canvas.finish(grid[0], page, sweep, handles, title)


def _with_columns(
    sweep: OpenedSweep, color: Wanted, quantity: Wanted, axes: Sequence[Wanted]
) -> tuple[OpenedSweep, list[str]]:
    """Return the dataset with what is wanted, and the names; the abscissas are what varies."""
    columns = [name for name, values in sweep.columns.items() if values.dtype.kind in "iuf"]
    varying = [name for name in columns if np.ptp(sweep[name].values) > 0.0] or columns[:1]
    names = []
    for wanted in (color, quantity, *([*axes] or varying)):
        sweep, name = with_number(sweep, wanted)
        names.append(name)
    return sweep, names
