"""Pictures of coexisting attractors: their basins, and a diagram with a colour for each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sweeps.analysis.distinct_attractors import attractors
from sweeps.analysis.grouping import STARTS, records
from sweeps.analysis.motion import Motion
from sweeps.analysis.selection import Cut, Setting, chosen_axes, listed, select, swept_axes
from sweeps.analysis.table import Row, classes, parameter_axes, rows, shown_speeds
from sweeps.errors import Refused
from sweeps.plotting.bifurcation import held_coordinate
from sweeps.plotting.cells import CLASSES, MOTIONS, Cells, draw_kinds, missing
from sweeps.plotting.labels import entitle, label, set_scale
from sweeps.plotting.marks import guard, mark_status

#: Of the periodic attractors, the most frequent first: Okabe and Ito's, far apart from each other.
_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#F0E442")
_OTHER = "#8C8C8C"


def basins(dataset: xr.Dataset, *, at: Cut | None = None) -> Figure:
    """Draw the basins of attraction: over x0 and v0, one cell per start, in its attractor's colour.

    Raises
    ------
    Refused
        If x0 and v0 were not both swept, or the file has no period.
    """
    axes = swept_axes(dataset)
    if not {"x0", "v0"} <= set(axes):
        raise Refused(f"basins need x0 and v0 as axes; the file has {listed(axes) or 'none'}")
    starts = select(dataset, at, free=("x0", "v0")).sortby(["x0", "v0"]).transpose("v0", "x0", ...)
    found = attractors(starts)
    own, kinds = found["attractor"].values, []
    for row in rows(starts, found):
        kinds.append(Cells(_named(row), _colour(row), own == row.number))
    figure = Figure(figsize=(4.5, 4.6), layout="constrained")
    panel = figure.add_subplot()
    more = ",\nspeed before each impact; share of the starts"
    draw_kinds(figure, starts, [*kinds, *missing(starts["status"].values)], more)
    set_scale(panel.xaxis, starts["x0"].values)
    set_scale(panel.yaxis, starts["v0"].values)
    panel.set_xlabel(label(dataset["x0"]))
    panel.set_ylabel(label(dataset["v0"]))
    entitle(figure, Setting.of(dataset), starts, 66)
    return figure


def attractor_diagram(
    dataset: xr.Dataset,
    *,
    axes: Sequence[str] = (),
    at: Cut | None = None,
    coordinate: str | None = None,
) -> Figure:
    """Draw every attractor that the starts find over one swept parameter, in a colour for each.

    Of the starts that reach an attractor one is drawn: a repetition of a periodic motion, or all
    that is recorded of another.

    Parameters
    ----------
    axes : sequence of str, optional
        The swept parameter, by default the longest.
    coordinate : str, optional
        As in `sweeps.plotting.bifurcation.bifurcation`.

    Raises
    ------
    Refused
        If the file has no such axis or coordinate, or no period.
    """
    free = [name for name in map(str, dataset["status"].dims) if name in STARTS]
    parameters = dataset.isel(dict.fromkeys(free, 0))
    (axis,) = chosen_axes(parameters, axes, 1, "diagram of attractors")
    coordinate = held_coordinate(dataset, coordinate)
    for name in set(free) & set(at or {}):
        raise Refused(
            f"{name} cannot be fixed here; choose from: {listed(parameter_axes(dataset))}"
        )
    line = select(dataset, at, free=[axis, *free])
    found = attractors(line)
    table = rows(line, found)
    if not table:
        raise Refused("there is nothing to draw: no point has a result")
    figure = Figure(layout="constrained")
    panel = figure.add_subplot()
    set_scale(panel.xaxis, line[axis].values)
    _draw_rows(panel, line, table, axis, coordinate)
    values = line[axis].values
    if len(values) > 100:
        panel.set_xlim(values.min(), values.max())
    panel.set_xlabel(label(dataset[axis]))
    panel.set_ylabel(label(dataset[coordinate]))
    status = line["status"].transpose(axis, ...).values.reshape(len(values), -1)
    mark_status(panel, np.repeat(values, status.shape[1]), status.ravel())
    lines = -(-len(panel.get_legend_handles_labels()[0]) // 2)
    figure.set_size_inches(5.0, 3.6 + 0.16 * lines)
    starts = "1 start" if status.shape[1] == 1 else f"{status.shape[1]:,} starts"
    legend = figure.legend(
        loc="outside lower center", ncols=2, frameon=False, handlelength=1.0,
        title=f"{CLASSES}\n{starts} at each value", title_fontsize=8.0,
    )  # fmt: skip
    legend.get_title().set_multialignment("center")
    entitle(figure, Setting.of(dataset), line, 76)
    return figure


def _draw_rows(
    panel: Axes, line: xr.Dataset, table: Sequence[Row], axis: str, coordinate: str
) -> None:
    """Draw what was recorded of each attractor, those that repeat over the others."""
    values = records(line, coordinate, np.array([row.point for row in table]))
    if coordinate.startswith("poincare"):
        for record, row in zip(values, table, strict=True):
            record[: -row.m] = np.nan if row.m else record[: -row.m]
    finite = values[np.isfinite(values)]
    if not len(finite):
        raise Refused(f"there is nothing to draw: no point has a {coordinate}")
    guard(panel.set_ylim, finite.min(), finite.max())
    across = np.array([row.parameters[axis] for row in table])
    series: dict[tuple[bool, int, str], list[int]] = {}
    for i, row in enumerate(table):
        repeats = row.motion is Motion.PERIODIC
        rank = min(row.number, len(_COLOURS)) if repeats else int(row.motion)
        series.setdefault((repeats, rank, _colour(row)), []).append(i)
    for (repeats, _, colour), places in sorted(series.items(), key=_periodic_first):
        name = _label([table[i] for i in places])
        text = "other periodic attractors" if colour == _OTHER else name
        y = values[places]
        x = np.broadcast_to(across[places, None], y.shape)[np.isfinite(y)]
        (points,) = panel.plot(x, y[np.isfinite(y)], "o", color=colour, rasterized=True)
        size = 1.3 if repeats else 0.5
        points.set(markersize=size, markeredgewidth=0, zorder=2.0 + repeats)
        panel.plot([], [], "o", color=colour, markersize=4.0, markeredgewidth=0, label=text)


def _periodic_first(series: tuple[tuple[bool, int, str], object]) -> tuple[bool, int]:
    (repeats, rank, _), _ = series
    return not repeats, rank


def _colour(row: Row) -> str:
    if row.motion is not Motion.PERIODIC:
        return MOTIONS[row.motion][1]
    return _COLOURS[row.number] if row.number < len(_COLOURS) else _OTHER


def _label(its: Sequence[Row]) -> str:
    one = its[0].motion
    if one is not Motion.PERIODIC:
        return MOTIONS[one][0]
    return classes(its) + ("" if any(row.q for row in its) else ", no impact")


def _named(row: Row) -> str:
    """Describe an attractor at one parameter point."""
    share = f"{100.0 * row.fraction:.1f} %"
    speeds = shown_speeds(row)
    return f"{_label([row])}: {speeds}; {share}" if speeds else f"{_label([row])}: {share}"
