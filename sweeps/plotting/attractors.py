"""Pictures of coexisting attractors: their basins, and a diagram with a colour for each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from sweeps.analysis.attractor_table import Row, parameter_axes, rows
from sweeps.analysis.attractors import attractors
from sweeps.analysis.coordinates import COORDINATES, shows_part
from sweeps.analysis.cuts import Selection, chosen_axes, select, swept_axes
from sweeps.analysis.dataset import config_of
from sweeps.analysis.grouping import STARTS
from sweeps.analysis.parts import records
from sweeps.errors import Refused
from sweeps.plotting import canvas
from sweeps.plotting.colours import Cells
from sweeps.plotting.labels import (
    CLASSES_TITLE,
    as_variable,
    basins_title,
    label_axis,
    record_text,
)
from sweeps.plotting.lines import choose_coordinate, refuse_empty, refuse_without_result
from sweeps.plotting.maps import draw_cells
from sweeps.plotting.page import PAGE, Page
from sweeps.plotting.style import ATTRACTORS, OTHER_ATTRACTORS, PARTIAL, REGIMES
from sweeps.plotting.styled import styled
from sweeps.reports.attractors import classes, shown_speeds
from sweeps.text import choice_of, listed, shown_count
from vibroimpact.points.regimes import Regime


@styled
def basins(
    dataset: xr.Dataset, *, at: Selection | None = None, page: Page = PAGE, ax: Axes | None = None
) -> Figure:
    """Draw the basins of attraction over x0 and v0: one cell per start, coloured by its attractor.

    x0 and v0 must both be swept, and the period must be recorded. The periodic attractors are
    marked if the section is at the phase of the starts.

    Examples
    --------
    >>> import sweeps
    >>> x0 = {"start": -3, "stop": 0, "num": 12}
    >>> v0 = {"start": -2, "stop": 2, "num": 12}
    >>> starts = {"x0": x0, "v0": v0}
    >>> scene = {"oscillator": {"h": 0.0, "R": 0.8, "omega": 1.3, "f": 1.0}, "start": starts}
    >>> ds = sweeps.open_sweep(sweeps.run_sweep(scene, "basins.h5", overwrite=True))
    >>> from sweeps import plotting
    >>> plotting.basins(ds).savefig("basins.png")
    """
    axes = swept_axes(dataset)
    if not {"x0", "v0"} <= set(axes):
        raise Refused(f"basins need x0 and v0 as axes; the file has {listed(axes) or 'none'}")
    starts = select(dataset, at, free=("x0", "v0"))
    panel = canvas.new_panel(ax, page)
    result = attractors_in(starts, dataset)
    table = rows(starts, result)
    drawn = starts.sortby(["x0", "v0"]).transpose("v0", "x0", ...)
    handles = draw_cells(panel, drawn, basin_cells(table, reached(result)))
    page.set_limits(panel)
    if config_of(dataset).record.phase == config_of(dataset).start.phase:
        handles += mark_attractors(panel, table)
    title = basins_title(config_of(dataset))
    return canvas.finish(panel, page, starts, handles, title)


def mark_attractors(panel: Axes, table: Sequence[Row]) -> list[Artist]:
    """Mark the periodic attractors with a colour at the section; return a handle for the legend."""
    states = [row.states for row in by_colour(table)[0] if row.m]
    if not states:
        return []
    look: dict[str, Any] = {"color": "black", "markeredgecolor": "white", "markersize": 4.0}
    panel.plot(*np.concatenate(states).T, "o", scalex=False, scaley=False, **look)
    return [Line2D([], [], marker="o", linestyle="", label="attractors at the section", **look)]


def attractors_in(cut: xr.Dataset, dataset: xr.Dataset) -> xr.Dataset:
    """Return the attractors in a cut, numbered as in the file, for the same colours everywhere.

    An attractor that has no colour of its own in the file gets a number that is free in the cut.
    """
    fixed = {str(name) for name in dataset["status"].dims} - set(map(str, cut["status"].dims))
    starts, others = fixed & set(STARTS), fixed - set(STARTS)
    found = attractors(dataset.sel({name: cut[name].item() for name in starts}))
    found = found.sel({name: cut[name].item() for name in others})
    used = np.unique(found["attractor"].values[found["attractor"].values >= 0])
    own = used[used < len(ATTRACTORS)]
    free = np.setdiff1d(np.arange(len(used) + len(ATTRACTORS)), own)
    names = np.append(np.concatenate([own, free])[: len(used)], -1)

    def renamed(numbers: np.ndarray) -> np.ndarray:
        """Replace the numbers of the file."""
        return names[np.where(numbers < 0, -1, np.searchsorted(used, numbers))]

    columns = "attractor", "number"
    return found.assign(
        {name: found[name].copy(data=renamed(found[name].values)) for name in columns}
    )


def reached(result: xr.Dataset) -> np.ndarray:
    """Return the number of the attractor that each start reaches at one point, by (v0, x0)."""
    return result["attractor"].sortby(["x0", "v0"]).transpose("v0", "x0", ...).values


def basin_cells(table: Sequence[Row], numbers: np.ndarray) -> list[Cells]:
    """Return the cells of each basin, given the number of the attractor of each start.

    All attractors without a colour of their own are one entry, which says how many they are.
    """
    own, others = by_colour(table)
    cells = [Cells(_describe(row), colour_of(row), numbers == row.number) for row in own]
    if others:
        share = 100.0 * sum(row.fraction for row in others)
        text = f"{shown_count(len(others), 'other periodic attractor')}: {share:.1f} %"
        where = np.isin(numbers, [row.number for row in others])
        cells.append(Cells(text, OTHER_ATTRACTORS, where))
    return cells


def by_colour(table: Sequence[Row]) -> tuple[list[Row], list[Row]]:
    """Return the attractors that have a colour of their own, and the others."""
    parts: tuple[list[Row], list[Row]] = [], []
    for row in table:
        parts[colour_of(row) == OTHER_ATTRACTORS].append(row)
    return parts


@styled
def attractor_diagram(
    dataset: xr.Dataset,
    *,
    axes: Sequence[str] = (),
    at: Selection | None = None,
    coordinate: str | None = None,
    page: Page = PAGE,
    ax: Axes | None = None,
) -> Figure:
    """Draw all attractors that the starts reach over one swept parameter, in a colour for each.

    The motion from one start of each attractor is drawn: one repetition of a periodic motion, or
    the whole record of another motion. The period must be recorded.

    Parameters
    ----------
    axes : sequence of str, optional
        The swept parameter, by default the one with most values.
    coordinate : str, optional
        As for `sweeps.plotting.bifurcation`.

    Examples
    --------
    >>> import sweeps
    >>> x0 = {"start": -3, "stop": 0, "num": 12}
    >>> v0 = {"start": -2, "stop": 2, "num": 12}
    >>> starts = {"x0": x0, "v0": v0}
    >>> oscillator = {"h": 0.0, "R": 0.8, "omega": [1.3, 1.35], "f": 1.0}
    >>> scene = {"oscillator": oscillator, "start": starts}
    >>> ds = sweeps.open_sweep(sweeps.run_sweep(scene, "basins.h5", overwrite=True))
    >>> from sweeps import plotting
    >>> plotting.attractor_diagram(ds).savefig("attractors.png")
    """
    free = [name for name in map(str, dataset["status"].dims) if name in STARTS]
    if free and not parameter_axes(dataset):
        raise Refused(
            f"a diagram of attractors is over a swept parameter, and only {listed(free)} "
            f"{'was' if len(free) == 1 else 'were'} swept"
            + ("; the picture of both is basins" if len(free) == 2 else "")
        )
    parameters = dataset.isel(dict.fromkeys(free, 0))
    (axis,) = chosen_axes(parameters, axes, at, 1, "diagram of attractors")
    coordinate = choose_coordinate(dataset, coordinate)
    for name in set(free) & set(at or {}):
        raise Refused(f"{name} cannot be fixed here; {choice_of(parameter_axes(dataset))}")
    line = select(dataset, at, free=[axis, *free])
    refuse_without_result(line["status"].values)
    table = rows(line, attractors_in(line, dataset))
    values = line[axis].values
    status = line["status"].transpose(axis, ...).values.reshape(len(values), -1)
    panel = canvas.new_panel(ax, page)
    label_axis(panel.xaxis, line[axis])
    label_axis(panel.yaxis, as_variable(coordinate, dict(config_of(dataset).units.items())))
    _draw_rows(panel, line, table, axis, coordinate)
    if len(values) > 100:
        panel.set_xlim(values.min(), values.max())
    page.fit_ordinate(panel)
    page.set_limits(panel)
    masks = {}
    if COORDINATES[coordinate].dimension == "impact":
        masks[PARTIAL] = shows_part(line.transpose(axis, ...)).ravel()
    canvas.mark_status(panel, np.repeat(values, status.shape[1]), status.ravel(), masks)
    title = f"{CLASSES_TITLE}\n{shown_count(status.shape[1], 'start')} at each value"
    record = record_text(line, coordinate)
    return canvas.finish(panel, page, line, legend_title=title, record=record)


def _draw_rows(
    panel: Axes, line: xr.Dataset, table: Sequence[Row], axis: str, coordinate: str
) -> None:
    """Draw the record of each attractor, with the periodic ones on top."""
    values = records(line, coordinate, np.array([row.point for row in table]))
    if coordinate.startswith("poincare"):
        for record, row in zip(values, table, strict=True):
            record[: -row.m] = np.nan if row.m else record[: -row.m]
    finite = values[np.isfinite(values)]
    if not len(finite):
        refuse_empty(line, coordinate)
    canvas.widen_if_constant(panel.set_ylim, finite.min(), finite.max())
    abscissa = np.array([row.parameters[axis] for row in table])
    series: dict[tuple[bool, int, str], list[int]] = {}
    for i, row in enumerate(table):
        periodic = row.regime is Regime.PERIODIC
        rank = min(row.number, len(ATTRACTORS)) if periodic else int(row.regime)
        series.setdefault((not periodic, rank, colour_of(row)), []).append(i)
    for (scattered, _, colour), places in sorted(series.items()):
        y = values[places]
        x = np.broadcast_to(abscissa[places, None], y.shape)[np.isfinite(y)]
        y = y[np.isfinite(y)]
        (points,) = panel.plot(x, y, "o", color=colour, rasterized=True)
        least, most, zorder = (0.8, 1.2, 2.0) if scattered else (1.5, 2.0, 3.0)
        size = canvas.marker_size(x, y, least, most)
        points.set(markersize=size, markeredgewidth=0, zorder=zorder)
        text = class_names([table[i] for i in places])
        text = "other periodic attractors" if colour == OTHER_ATTRACTORS else text
        panel.plot([], [], "o", color=colour, markersize=4.0, markeredgewidth=0, label=text)


def colour_of(row: Row) -> str:
    """Return the colour of an attractor, or of its regime."""
    if row.regime is not Regime.PERIODIC:
        return REGIMES[row.regime]
    return ATTRACTORS[row.number] if row.number < len(ATTRACTORS) else OTHER_ATTRACTORS


def class_names(attractor: Sequence[Row]) -> str:
    """Name the classes of one attractor over several parameter points, or its regime."""
    regime = attractor[0].regime
    if regime is not Regime.PERIODIC:
        return regime.word
    return classes(attractor) + ("" if any(row.q for row in attractor) else ", no impact")


def _describe(row: Row) -> str:
    """Write the class, the impact speeds and the share of an attractor at one parameter point."""
    speeds = f"{shown_speeds(row)}; " if len(row.speeds) else ""
    return f"{class_names([row])}: {speeds}{100.0 * row.fraction:.1f} %"
