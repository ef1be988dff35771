"""Draws a sweep over a table; reads and draws an `Overlay` of measured points."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from sweeps.config.points_table import check_header, read_columns
from sweeps.errors import Refused
from sweeps.grid import TABLE
from sweeps.opened.coordinates import ORDINATES
from sweeps.opened.opened_sweep import OpenedSweep, Selection
from sweeps.plotting import canvas, contents, labels
from sweeps.plotting.colours import has_scale, legend_entries, paint_of
from sweeps.plotting.contents import NameOrArray
from sweeps.plotting.marks import mark_status, marker_size
from sweeps.plotting.page import PAGE, Page, styled
from sweeps.plotting.pixels import in_view
from sweeps.plotting.style import ground, ink
from sweeps.text import (
    fewest_digits,
    listed,
    near_misses,
    printable,
    shortened,
    shown_count,
    suggestion,
)
from vibroimpact.oscillator import Parameter

#: The column with the names of the points in the legend.
LABEL = "label"
#: A marker for each label.
_MARKERS = "osD^vPX*<>"
#: Least and greatest size of the markers [pt], and the margin of the panel around them.
_SIZES, _MARGIN = (1.5, 4.5), 0.04


class Overlay(NamedTuple):
    """The points of a table, by the names of their columns, and their labels."""

    columns: dict[str, np.ndarray]  # in the units of the head or of the picture
    units: dict[str, float]  # of the columns that name theirs, in those of the dataset
    variables: Mapping[str, xr.DataArray]  # describes what the picture shows
    labels: np.ndarray

    def values(self, name: str, limits: Any, text: str | None = None) -> np.ndarray:
        """Return a column in the unit of the dataset; without its own, it has that of the ticks."""
        # The ticks are of an axis or a bar with these `limits` and this `text`.
        size = float(np.abs(limits).max())
        factor = self.units.get(name, labels.prefix_of(self.variables[name], size, text)[1])
        return factor * self.columns[name]


def read_overlay(
    source: Any, sweep: OpenedSweep, needed: Sequence[Sequence[str]], quantity: str = ""
) -> Overlay | None:
    """Read a table with a column of each `needed` group, and a `quantity` on a scale, if any."""
    # None if there is no table.
    if source is None:
        return None
    names = [name for group in needed for name in group]
    names += [quantity] if quantity and has_scale(quantity) else []
    variables = {name: _in_shown_unit(sweep, name) for name in names}
    heads, is_file = dict[str, tuple[str, str]](), isinstance(source, str | Path)

    def check(columns: list[str]) -> Mapping[str, Parameter]:
        check_header(columns)
        if not columns:
            raise ValueError(f"the table is empty; {_expected(variables)}")
        for head in columns:
            if head != LABEL:
                heads[head] = _name_and_unit(head, variables)
        named = [name for name, _ in heads.values()]
        for name in named:
            if named.count(name) > 1:
                raise ValueError(f"column {name} is given twice; expected: once")
        for group in needed:
            if not {*group} & {*named}:
                raise ValueError(f"there is no column {' or '.join(group)}; {_expected(variables)}")
        return dict.fromkeys(heads, Parameter("", "", "", -labels.LARGEST, labels.LARGEST))

    try:
        table = read_columns(source, Path(), check)
        allowed = {head: labels.units_of(variables[name]) for head, (name, _) in heads.items()}
        units = {name: allowed[head][unit] for head, (name, unit) in heads.items() if unit}
        stem = Path(source).stem if is_file else "overlay"
        cells = table[LABEL] if LABEL in (table.dtype.names or ()) else [stem] * len(table)
        texts = np.array([_label_in(cell, stem) for cell in cells])
        if len({*texts}) > len(_MARKERS):
            most = f"expected: at most {len(_MARKERS)}, each with a marker of its own"
            where = f"{source}: " if is_file else ""
            raise ValueError(f"{where}there are {len({*texts})} labels; {most}")
    except ValueError as error:
        raise Refused(f"overlay{' ' if is_file else ': '}{error}") from None
    columns = {name: table[head] for head, (name, _) in heads.items()}
    return Overlay(columns, units, variables, texts)


def _in_shown_unit(sweep: OpenedSweep, name: str) -> xr.DataArray:
    """Return a variable with the unit in which the picture shows it."""
    if name in ORDINATES:
        return labels.as_variable(name, sweep)
    return contents.with_number(sweep, name)[0][name]


def _expected(variables: Mapping[str, xr.DataArray]) -> str:
    return f"expected: columns out of {', '.join([*variables, LABEL])}, with commas between them"


def _name_and_unit(head: str, variables: Mapping[str, xr.DataArray]) -> tuple[str, str]:
    """Split the head of a column into the name and the unit, which may be empty; check both."""
    match = re.fullmatch(r"([^][]*?)\s*\[\s*([^][]*?)\s*\]", head)
    name, unit = (match[1], match[2]) if match else (head, "")
    if name not in variables:
        text, meant = shortened(printable(name)), suggestion(near_misses(name, [*variables, LABEL]))
        raise ValueError(f"the picture has no {text}{meant}; {_expected(variables)}")
    unit = unit.replace("\N{GREEK SMALL LETTER MU}", "\N{MICRO SIGN}")
    known = labels.units_of(variables[name])
    if match and unit not in known:
        wrong = f"column {name} in {shortened(printable(unit)) or '(nothing)'} is not allowed"
        raise ValueError(f"{wrong}; expected: {' or '.join(known) or 'no unit'}")
    return name, unit


def _label_in(cell: Any, otherwise: str) -> str:
    """Return the text of a label for the legend, which would not show one that begins with _."""
    text = fewest_digits(cell) if isinstance(cell, float) else str(cell).strip()
    text = shortened(printable(text or otherwise), 40).replace("$", r"\$")
    return f" {text}" if text.startswith("_") else text


def draw_overlay(
    overlay: Overlay | None,
    panels: Sequence[tuple[Axes, str, str]],
    page: Page,
    scale: tuple[str, Colormap, Normalize] | None = None,
) -> list[Artist]:
    """Draw the points in each panel, with room unless on a map; return handles for the legend."""
    # Limits that the page does not give make room, but not on a map, which has the `scale` of a
    # quantity. The legend counts the points that are outside of all panels.
    if overlay is None:
        return []
    inside = np.zeros(len(overlay.labels), bool)
    markers = dict(zip(dict.fromkeys(overlay.labels.tolist()), _MARKERS, strict=False))
    for panel, abscissa, ordinate in panels:
        if not {abscissa, ordinate} <= overlay.columns.keys():
            continue
        page_there = _page_of(panel, page, panels[0][0])
        x = overlay.values(abscissa, panel.xaxis.get_view_interval(), page_there.xlabel)
        y = overlay.values(ordinate, panel.yaxis.get_view_interval(), page_there.ylabel)
        if scale is None:
            _make_room(panel, x, y, page_there)
        visible = in_view(panel, x, y)
        inside |= visible
        size = marker_size(x, y, *_SIZES)
        for text, marker in markers.items():
            here = visible & (overlay.labels == text)
            props = {"marker": marker, "zorder": 7.0, "linewidths": 0.6}
            if scale is not None and scale[0] in overlay.columns:
                _, ramp, norm = scale
                values = overlay.values(scale[0], (norm.vmin, norm.vmax))[here]
                props |= {"c": ramp(norm(values)), "edgecolors": ink()}
            else:
                props |= {"color": ink(), "edgecolors": ground()}
            panel.scatter(x[here], y[here], size**2, **props)
    if not inside.any():
        raise Refused(
            "no point of the overlay is within the limits of the picture; expected: values in the "
            "units of its axes, or a unit in the head of the column"
        )
    return [
        _handle(text, inside[overlay.labels == text], marker) for text, marker in markers.items()
    ]


def _handle(text: str, inside: np.ndarray, marker: str) -> Line2D:
    """Return the entry of a label, which counts the points outside."""
    outside = np.count_nonzero(~inside)
    text += f" ({outside:,} of {len(inside):,} outside)" if outside else ""
    props: dict[str, Any] = {"color": ink(), "markeredgecolor": ground(), "markersize": _SIZES[1]}
    return Line2D([], [], linestyle="", marker=marker, label=text, markeredgewidth=0.6, **props)


def _page_of(panel: Axes, page: Page, first: Axes) -> Page:
    """Return the page with the limits and labels of a panel, which are given for the first one."""
    if panel is not first and not panel.get_shared_x_axes().joined(panel, first):
        page = replace(page, xlim=None, xlabel=None)
    if panel is not first and not panel.get_shared_y_axes().joined(panel, first):
        page = replace(page, ylim=None, ylabel=None)
    return page


def _make_room(panel: Axes, x: np.ndarray, y: np.ndarray, page: Page) -> None:
    """Widen the limits that the page does not give, to include points."""
    if page.xlim is not None:
        y = y[(page.xlim[0] <= x) & (x <= page.xlim[1])]
    for values, limits, axis in ((x, page.xlim, panel.xaxis), (y, page.ylim, panel.yaxis)):
        if axis.get_scale() == "log":
            values = values[values > 0.0]
        if limits is not None or not values.size:
            continue
        scaled = axis.get_transform()
        low, high = np.sort(scaled.transform(np.array(axis.get_view_interval())))
        positions = scaled.transform(values)
        margin = _MARGIN * (max(high, positions.max()) - min(low, positions.min()))
        bounds = [
            positions.min() - margin if positions.min() < low else low,
            positions.max() + margin if positions.max() > high else high,
        ]
        labels.set_lim(axis, *scaled.inverted().transform(bounds).tolist())


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
    quantity: NameOrArray | None = None,
    color: NameOrArray | None = None,
    overlay: Any = None,
    panels: Sequence[str] = (),
    page: Page = PAGE,
    ax: Axes | None = None,
) -> Figure:
    """Draw a result over the columns of a table, a panel for each.

    Parameters
    ----------
    axes : str or DataArray, or a sequence of these, optional
        Abscissas: columns of numbers or results, by default the columns that vary, as many
        as fit a page; the legend says how many are left out. With `ax`, only one.
    panels : str or sequence of str, optional
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
        if sweep.config.points is not None:
            raise Refused(f"one row of the table is left; expected: rows, as isel({TABLE}=[0, 1])")
        raise Refused("the points of this file are a grid, and not the rows of a table")
    sweep.cut(at, free=[TABLE])  # refuses a value of TABLE
    color = ("period" if "period" in sweep else "status") if color is None else color
    quantity = "impacts_per_period" if quantity is None else quantity
    sweep, (tint, ordinate, *available) = _with_columns(sweep, color, quantity, axes)
    beside = max(1, int(canvas.width_of(page) / _LEAST_WIDTH))
    abscissas = canvas.chosen_panels(panels, available)
    if not (axes or panels):
        abscissas = available[: 1 if ax is not None else _MOST_ROWS * beside]
    if ax is not None and len(abscissas) > 1:
        raise Refused(f"ax is one panel, and {listed(abscissas)} take {len(abscissas)}: choose one")
    paint = paint_of(sweep, tint, dots=True, grey=page.grey)
    points = read_overlay(overlay, sweep, [abscissas, [ordinate]])
    contents.refuse_without_result(sweep["status"].values)
    across = min(math.ceil(math.sqrt(len(abscissas))), beside)
    grid = [ax] if ax is not None else canvas.panel_grid(page, len(abscissas), across, 0.75)
    y = contents.number_at(sweep, ordinate)
    contents.refuse_without_value(y, ordinate)
    heading = labels.label_axis(grid[0].yaxis, y, heading=ax is None)
    if ax is None:  # the panels share the ordinate, whose label may not fit beside one of them
        if page.ylabel is not None:
            heading.set_text(page.ylabel)
        canvas.fit_text("ylabel", heading)
        page = replace(page, ylabel=None)
    numbers = [contents.number_at(sweep, name) for name in abscissas]
    places = list(zip(grid, abscissas, numbers, strict=True))
    for panel, _, x in places:
        labels.label_axis(panel.xaxis, x)
        size = float(np.clip(4e2 / math.sqrt(x.size), 0.0, 16.0))  # of a few rows [pt^2]
        size = max(size, float(np.clip(4e3 / math.sqrt(x.size), 0.3, 4.0))) / across
        panel.scatter(x, y, size, paint.colours(), linewidths=0, rasterized=True)
        panel.update_datalim(np.stack([x, x], axis=1), updatey=False)  # also of failed points
        if panel.get_xscale() == "linear":
            panel.locator_params(axis="x", nbins=5 - across)
    page = page.set_limits(grid[0])
    for panel, _, x in places:
        mark_status(panel, x.values, sweep["status"].values)
    page.set_limits(grid[0])  # again: the marks widen the ordinate
    visible = np.zeros(y.shape, bool)
    for panel, _, x in places:
        paint.add_markers(panel, x.values[:, None], y.values[:, None])
        visible |= in_view(panel, x.values, y.values)
    paint = paint.within(visible)
    measured = draw_overlay(points, [(each, name, ordinate) for each, name, _ in places], page)
    handles, title = legend_entries(paint, grid, grid[-1].get_legend_handles_labels()[0])
    handles += measured
    if ax is None and not (axes or panels) and (further := len(available) - len(abscissas)):
        handles.append(Line2D([], [], linestyle="", label=shown_count(further, "further column")))
    return canvas.finish(grid[0], page, sweep, handles, title)


def _with_columns(
    sweep: OpenedSweep, color: NameOrArray, quantity: NameOrArray, axes: Sequence[NameOrArray]
) -> tuple[OpenedSweep, list[str]]:
    """Return the dataset with the quantities, and their names; abscissas are columns that vary."""
    columns = [name for name, values in sweep.columns.items() if values.dtype.kind in "iuf"]
    varying = [name for name in columns if np.ptp(sweep[name].values) > 0.0] or columns[:1]
    names = []
    for each in (color, quantity, *([*axes] or varying)):
        sweep, name = contents.with_number(sweep, each)
        names.append(name)
    return sweep, names
