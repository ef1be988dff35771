"""Basins of attraction in the colours of their classes, of one parameter point or several."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from sweeps.attractor.attractor_table import (
    AttractorRow,
    attractor_rows,
    classes_text,
    shown_speeds,
)
from sweeps.attractor.partition import attractors
from sweeps.config.groups import STARTS
from sweeps.config.sweep import SweepConfig
from sweeps.errors import Refused
from sweeps.opened.opened_sweep import START_AXES, OpenedSweep, Selection
from sweeps.plotting import canvas
from sweeps.plotting.labels import CLASSES_TITLE, as_variable, basins_title, equation
from sweeps.plotting.looks import Cells, Looks
from sweeps.plotting.maps import draw_cells, name_and_bound
from sweeps.plotting.page import PAGE, Page, styled
from sweeps.plotting.style import Look, ground, ink
from sweeps.text import fewest_digits, listed, shown_count
from vibroimpact.points.regimes import Regime

#: Most basins beside each other, and the width from which three are [inch].
_MOST_BESIDE, _WIDE = 6, 5.0
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
    result, looks = attractors_in(starts, sweep, page.grey)
    table, numbers = attractor_rows(starts, result), reached(result, *plane)
    drawn = over_starts(starts, *plane)
    cells = basin_cells(table, numbers, looks, sweep.config)
    handles = _draw_basins(panel, page, drawn, table, cells, looks)
    figure = canvas.finish(panel, page, starts, handles, basins_title(sweep.config))
    name_basins(panel, page, drawn, table, numbers)
    return figure


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


def _draw_basins(
    panel: Axes,
    page: Page,
    drawn: OpenedSweep,
    table: Sequence[AttractorRow],
    cells: Sequence[Cells],
    looks: Looks,
) -> list[Artist]:
    """Draw the basins at one parameter point; return the entries of the legend."""
    handles = draw_cells(panel, drawn, cells)
    page.set_limits(panel)
    phase = drawn.config.record.phase
    if "phase" not in drawn.grid and float(drawn["phase"]) == phase:
        handles += mark_attractors(panel, looks.split(table)[0])
    return handles


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
    name, values = next((name, [*map(float, given)]) for name, given in beside.items())
    if name in START_AXES:
        raise Refused(f"{name} is a start: basins are beside each other for values of a parameter")
    if not 1 <= len(values) <= _MOST_BESIDE:
        raise Refused(
            f"{name} = {', '.join(map(fewest_digits, values))}: {shown_count(len(values), 'value')}"
            f" beside each other; expected: at most {_MOST_BESIDE}"
        )
    line = sweep.several({name: values}).cut(at, free=[name, *plane])
    across = min(len(values), 3 if canvas.width_of(page) >= _WIDE else 2)
    row = _LABELS + _SHAPE * canvas.width_of(page) / across
    row /= mpl.rcParams["figure.figsize"][1]
    panels = canvas.panel_grid(page, len(values), across, row, sharex=True)
    found, looks = attractors_in(sweep.cut(at, free=[name, *plane]), sweep, page.grey)
    drawn, further = [], dict[str, Artist]()
    for panel, value in zip(panels, line[name].values.tolist(), strict=True):
        starts, result = line.cut({name: value}, plane), found.sel({name: value})
        table, numbers = attractor_rows(starts, result), reached(result, *plane)
        starts = over_starts(starts, *plane)
        cells = basin_cells(table, numbers, looks, sweep.config)
        own = {cell.label for cell in cells}
        for handle in _draw_basins(panel, page, starts, table, cells, looks):
            if (text := str(handle.get_label())) not in own:
                further[text] = handle
        panel.set_title(equation(line[name].symbol, line[name], value), loc="left")
        drawn.append((panel, starts, table, numbers))
    for number, panel in enumerate(panels):
        if number % across:
            panel.set_ylabel("")
        has_below = number + across < len(panels)
        panel.tick_params(labelbottom=not has_below)
        if has_below:
            panel.set_xlabel("")
    handles = [*_shared_handles([table for *_, table, _ in drawn], looks), *further.values()]
    title = f"{CLASSES_TITLE},\nshare of the starts in each panel"
    figure = canvas.finish(panels[0], page, line, handles, title)
    for panel, starts, table, numbers in drawn:
        name_basins(panel, page, starts, table, numbers)
    return figure


def _shared_handles(tables: Sequence[Sequence[AttractorRow]], looks: Looks) -> list[Artist]:
    """Return an entry of a legend for each look and class in several panels, with the shares."""
    shares: dict[tuple[Look, str], np.ndarray] = {}
    for number, table in enumerate(tables):
        for row in table:
            name = class_names([row]) if looks.has_own(row) else "other periodic attractors"
            of_panels = shares.setdefault((looks.look(row), name), np.zeros(len(tables)))
            of_panels[number] += 100.0 * row.fraction
    return [
        Cells(f"{name}: {', '.join(f'{share:.1f}' for share in each)} %", look, each).handle()
        for (look, name), each in shares.items()
    ]


def over_starts(starts: OpenedSweep, across: str = "x0", up: str = "v0") -> OpenedSweep:
    """Return the starts at one parameter point in the order in which basins are drawn."""
    return starts.sortby([across, up]).transpose(up, across)


def mark_attractors(panel: Axes, table: Sequence[AttractorRow]) -> list[Artist]:
    """Mark the periodic attractors of a table at the section; return a handle for the legend."""
    states = [row.states for row in table if len(row.states)]
    if not states:
        return []
    look: dict[str, Any] = {"color": ink(), "markeredgecolor": ground(), "markersize": 4.0}
    panel.plot(*np.concatenate(states).T, "o", scalex=False, scaley=False, **look)
    return [Line2D([], [], marker="o", linestyle="", label="attractors at the section", **look)]


def attractors_in(cut: OpenedSweep, sweep: OpenedSweep, grey: bool) -> tuple[xr.Dataset, Looks]:
    """Return the attractors in a cut, numbered as in the file, and the looks of the file."""
    fixed = {*sweep.grid} - {*cut.grid}
    starts, others = fixed & set(START_AXES), fixed - set(START_AXES)
    places = sweep.places({name: cut[name].item() for name in starts})
    found = attractors(sweep.isel(places))
    return found.sel({name: cut[name].item() for name in others}), Looks.of(found, grey)


def reached(result: xr.Dataset, across: str = "x0", up: str = "v0") -> np.ndarray:
    """Return the number of the attractor that each start reaches at one point, by (up, across)."""
    return result["attractor"].sortby([across, up]).transpose(up, across).values


def basin_cells(
    table: Sequence[AttractorRow], numbers: np.ndarray, looks: Looks, config: SweepConfig
) -> list[Cells]:
    """Return the cells of each basin, given the number of the attractor of each start.

    All attractors without a look of their own are one entry, which says how many they are.
    """
    own, others = looks.split(table)
    cells = []
    for row, (name, place) in zip(own, names_of([[row] for row in own], config), strict=True):
        speeds = f"{shown_speeds(row)}; " if len(row.speeds) else ""
        text = f"{name}: {speeds}{100.0 * row.fraction:.1f} %{place}"
        cells.append(Cells(text, looks.look(row), numbers == row.number))
    if others:
        share = 100.0 * sum(row.fraction for row in others)
        text = f"{shown_count(len(others), 'other periodic attractor')}: {share:.1f} %"
        where = np.isin(numbers, [row.number for row in others])
        cells.append(Cells(text, looks.look(others[0]), where))
    return cells


def name_basins(
    panel: Axes, page: Page, starts: OpenedSweep, table: Sequence[AttractorRow], numbers: np.ndarray
) -> None:
    """Write the names of classes into the basins; in grey, draw their boundaries."""
    named = [row for row in table if row.regime in (Regime.PERIODIC, Regime.REST)]
    names = {row.number: row.name for row in named}
    name_and_bound(panel, page, starts, numbers, names)


def names_of(
    series: Sequence[Sequence[AttractorRow]], config: SweepConfig, axis: xr.DataArray | None = None
) -> list[tuple[str, str]]:
    """Name the classes of each series of attractors, or its regime.

    Where two series have a class in common, a second line says which is which by a state at the
    section, for several values of an `axis` with that value.
    """
    counts = Counter(
        name for own in series for name in {row.name for row in own if len(row.states)}
    )
    names = list[tuple[str, str]]()
    for own in series:
        place = ""
        if row := next((row for row in own if counts[row.name] > 1), None):
            state = zip(("x0", "v0"), ("x", "v"), row.states[0], strict=True)
            parts = [
                equation(symbol, as_variable(name, config.nomenclature), float(f"{value:.3g}"))
                for name, symbol, value in state
            ]
            if axis is not None:
                parts.append(equation(axis.symbol, axis, row.parameters[str(axis.name)]))
            place = f"\nat {', '.join(parts)}"
        names.append((class_names(own), place))
    return names


def class_names(attractor: Sequence[AttractorRow]) -> str:
    """Name the classes of one attractor over several parameter points, or its regime."""
    free = attractor[0].regime is Regime.PERIODIC and not any(row.q for row in attractor)
    return classes_text(attractor) + (", no impact" if free else "")
