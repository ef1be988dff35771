"""The bifurcation diagram: a coordinate over one swept axis, and the exact branches over it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sweeps.overlay import Line
from sweeps.plotting_density import add_bar, draw_density, extent
from sweeps.plotting_labels import entitle, label, set_scale
from sweeps.plotting_marks import DPI, VERMILION, draw_points, guard, mark_status
from sweeps.selection import PlotError, Setting, chosen_axes, listed, select
from vibroimpact.branches import Piece
from vibroimpact.status import Status

#: What a bifurcation diagram can show over the swept axis.
COORDINATES = ("poincare_x", "poincare_v", "impact_v", "impact_phase")

#: More points than this are drawn as a density: single markers would merge into a blob.
DENSITY_FROM = 2_000_000

#: Markers of the bifurcations of a branch.
_MARKS = {"flip": "o", "fold": "s", "graze": "^"}


def line_of(
    dataset: xr.Dataset,
    axes: Sequence[str] = (),
    at: Mapping[str, float] | None = None,
    coordinate: str | None = None,
) -> tuple[xr.Dataset, str, str]:
    """Return the line that a diagram shows, with its axis and its coordinate.

    Raises
    ------
    PlotError
        If the file has no such axis or coordinate.
    """
    (axis,) = chosen_axes(dataset, axes, 1, "bifurcation")
    return select(dataset, at, free=[axis]), axis, held_coordinate(dataset, coordinate)


def held_coordinate(dataset: xr.Dataset, asked: str | None) -> str:
    """Return the coordinate asked for, by default the first that the file has.

    Raises
    ------
    PlotError
        If the file has no such coordinate.
    """
    held = [name for name in COORDINATES if name in dataset]
    if asked is None:
        asked = next(iter(held), COORDINATES[0])
    if asked not in held:
        name = asked or repr(asked)
        raise PlotError(f"the file has no {name} to draw; it has {listed(held) or 'none'}")
    return asked


def bifurcation(
    dataset: xr.Dataset,
    *,
    axes: Sequence[str] = (),
    at: Mapping[str, float] | None = None,
    coordinate: str | None = None,
    exact: bool = False,
) -> Figure:
    """Draw a coordinate of the section or of the impacts over one swept axis.

    Points that failed or were not computed yet are marked below the diagram, not drawn.

    Parameters
    ----------
    axes : sequence of str, optional
        The swept axis, by default the longest.
    coordinate : str, optional
        One of ``COORDINATES``, by default the first that the file has.
    exact : bool
        Whether to draw the closed-form one-impact orbits over the points.

    Raises
    ------
    PlotError
        If the file has no such axis or coordinate, or nothing to draw.
    """
    line, axis, coordinate = line_of(dataset, axes, at, coordinate)
    values, status, record = line[axis].values, line["status"].values, line[coordinate]
    good = np.isin(status, [one for one in Status if not one.failed])
    low, high = extent(record, good)
    if low > high:
        raise PlotError(f"there is nothing to draw: no point has a {coordinate}")
    branches = Line.of(line, axis, coordinate) if exact else None
    figure = Figure(figsize=(5.0, 3.5), layout="constrained")
    panel = figure.add_subplot()
    set_scale(panel.xaxis, values)
    dense = np.count_nonzero(good) * record.shape[1] > DENSITY_FROM
    if dense:
        panel.update_datalim([(values.min(), low), (values.max(), high)])
        panel.autoscale_view()
    else:
        y = record.values[good]
        x = np.broadcast_to(values[good, None], y.shape)[np.isfinite(y)]
        draw_points(panel, x, y[np.isfinite(y)])
    if len(values) > 100:
        panel.set_xlim(values.min(), values.max())
    panel.set_xlabel(label(dataset[axis]))
    panel.set_ylabel(label(dataset[coordinate]))
    guard(panel.set_ylim, low, high)
    if branches is not None:
        _draw_branches(panel, branches)
    mark_status(panel, values, status)
    if panel.get_legend_handles_labels()[0]:
        figure.legend(loc="outside lower center", ncols=2 if exact else 1, frameon=False)
    entitle(figure, Setting.of(dataset), line, 76)
    if dense:
        add_bar(figure, panel)
        draw_density(figure, panel, values, record, good, DPI)
    return figure


def _draw_branches(panel: Axes, line: Line) -> None:
    """Draw the one-impact orbits, solid where stable, and their bifurcations."""
    drawn = [branches for branches in line.branches() if branches.pieces]
    for stable in (True, False):
        parts = [(one.n, piece) for one in drawn for piece in one.pieces if piece.stable == stable]
        for _, piece in parts:
            _draw_piece(panel, line, piece)
        if parts:
            periods = listed(str(n) for n in sorted({n for n, _ in parts}))
            text = f"exact orbit, $n = {periods}$, {'stable' if stable else 'unstable'}"
            panel.plot([], [], label=text, **_look(stable))
    for kind, marker in _MARKS.items():
        marks = [mark for branches in drawn for mark in branches.marks if mark.kind == kind]
        for mark in marks:
            y = line.coordinates(mark.value, mark.orbit)
            (points,) = panel.plot(np.full(len(y), mark.value), y, marker)
            points.set(color=VERMILION, markerfacecolor="white", markersize=4.5, zorder=5)
            points.set_label(kind if mark is marks[0] else "_")


def _draw_piece(panel: Axes, line: Line, piece: Piece) -> None:
    x = np.array(piece.values)
    y = np.array([line.coordinates(*pair) for pair in zip(x, piece.orbits, strict=True)])
    # Where the impact passes the phase at which the coordinate begins anew, so does the line.
    begin = 0.0 if line.coordinate == "impact_phase" else line.phase
    phases = (np.array([orbit.phase for orbit in piece.orbits]) - begin) % (2.0 * np.pi)
    jumps = np.flatnonzero(np.abs(np.diff(phases)) > np.pi) + 1
    x, y = np.insert(x, jumps, np.nan), np.insert(y, jumps, np.nan, axis=0)
    panel.plot(x, y, zorder=4, label="_", **_look(piece.stable))


def _look(stable: bool) -> dict[str, Any]:
    return {"color": VERMILION, "linewidth": 1.0, "linestyle": "-" if stable else (0, (4, 2))}
