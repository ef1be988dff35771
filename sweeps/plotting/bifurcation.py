"""The bifurcation diagram: a coordinate over one swept axis, and the exact branches over it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sweeps.analysis.overlay import Line
from sweeps.analysis.selection import Cut, Setting, chosen_axes, directions, listed, select
from sweeps.errors import Refused
from sweeps.plotting.density import BOTH_COLOUR, DIRECTION_COLOURS, add_bar, draw_density, extent
from sweeps.plotting.labels import entitle, label, set_scale
from sweeps.plotting.marks import DPI, VERMILION, draw_points, guard, mark_status
from sweeps.store.variables import DIRECTION
from vibroimpact.orbits.one_impact_branches import Piece
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status

#: What a bifurcation diagram can show over the swept axis.
COORDINATES = ("poincare_x", "poincare_v", "impact_v", "impact_phase")

#: More points than this are drawn as a density: single markers would merge into a blob.
DENSITY_FROM = 2_000_000

#: Markers of the bifurcations of a branch.
_MARKS = {"flip": "o", "fold": "s", "graze": "^"}
#: The lines of the exact branches. Those over two directions leave the markers of both to be seen,
#: and are not of a colour near that of one.
_OVER_ONE: dict[str, Any] = {"color": VERMILION, "linewidth": 1.0}
_OVER_BOTH: dict[str, Any] = {"color": "black", "linewidth": 0.4}


def line_of(
    dataset: xr.Dataset,
    axes: Sequence[str] = (),
    at: Cut | None = None,
    coordinate: str | None = None,
) -> tuple[xr.Dataset, str, str]:
    """Return the line that a diagram shows, with its axis and its coordinate.

    Raises
    ------
    Refused
        If the file has no such axis or coordinate.
    """
    (axis,) = chosen_axes(dataset, axes, 1, "bifurcation")
    return select(dataset, at, free=[axis, DIRECTION]), axis, held_coordinate(dataset, coordinate)


def held_coordinate(dataset: xr.Dataset, asked: str | None) -> str:
    """Return the coordinate asked for, by default the first that the file has.

    Raises
    ------
    Refused
        If the file has no such coordinate.
    """
    held = [name for name in COORDINATES if name in dataset]
    if asked is None:
        asked = next(iter(held), COORDINATES[0])
    if asked not in held:
        name = asked or repr(asked)
        raise Refused(f"the file has no {name} to draw; it has {listed(held) or 'none'}")
    return asked


def branches_of(line: xr.Dataset) -> list[xr.Dataset]:
    """Return a line once for each direction in which it was followed, or the line itself."""
    return [line.sel({DIRECTION: way}) for way in directions(line)] or [line]


class _Drawn(NamedTuple):
    """What is drawn of one direction: its record, and which of its points there are."""

    record: xr.DataArray
    good: np.ndarray

    @classmethod
    def of(cls, branch: xr.Dataset, coordinate: str) -> Self:
        good = np.isin(branch["status"].values, [one for one in Status if not one.failed])
        return cls(branch[coordinate], good)

    @property
    def size(self) -> int:
        return int(np.count_nonzero(self.good)) * self.record.shape[1]


def bifurcation(
    dataset: xr.Dataset,
    *,
    axes: Sequence[str] = (),
    at: Cut | None = None,
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
    Refused
        If the file has no such axis or coordinate, or nothing to draw.
    """
    line, axis, coordinate = line_of(dataset, axes, at, coordinate)
    values = line[axis].values
    branches = branches_of(line)
    drawn = [_Drawn.of(branch, coordinate) for branch in branches]
    low, high = extent(drawn)
    if low > high:
        raise Refused(f"there is nothing to draw: no point has a {coordinate}")
    orbits = Line.of(branches[0], axis, coordinate) if exact else None
    figure = Figure(figsize=(5.0, 3.5), layout="constrained")
    panel = figure.add_subplot()
    set_scale(panel.xaxis, values)
    dense = sum(one.size for one in drawn) > DENSITY_FROM
    if dense:
        panel.update_datalim([(values.min(), low), (values.max(), high)])
        panel.autoscale_view()
    else:
        _draw_points(panel, values, drawn)
    if len(drawn) > 1:
        _name_directions(panel, axis, dense)
    if len(values) > 100:
        panel.set_xlim(values.min(), values.max())
    panel.set_xlabel(label(dataset[axis]))
    panel.set_ylabel(label(dataset[coordinate]))
    guard(panel.set_ylim, low, high)
    if orbits is not None:
        _draw_branches(panel, orbits, _OVER_BOTH if len(drawn) > 1 else _OVER_ONE)
    mark_status(panel, values, line["status"].values)
    _add_legend(figure, panel, exact)
    entitle(figure, Setting.of(dataset), line, 76)
    if dense:
        add_bar(figure, panel, len(drawn))
        draw_density(figure, panel, values, drawn, DPI)
    return figure


def _draw_points(panel: Axes, values: np.ndarray, drawn: Sequence[_Drawn]) -> None:
    """Draw markers; of two directions the second on top and smaller, so that both are seen."""
    scales = (1.0,) if len(drawn) == 1 else (1.4, 0.6)
    for one, colour, scale in zip(drawn, DIRECTION_COLOURS, scales, strict=False):
        y = one.record.values[one.good]
        x = np.broadcast_to(values[one.good, None], y.shape)[np.isfinite(y)]
        draw_points(panel, x, y[np.isfinite(y)], colour, scale)


def _name_directions(panel: Axes, axis: str, dense: bool) -> None:
    """Say in the legend which colour is which direction."""
    symbol = PARAMETERS[axis].symbol
    texts = rf"up, ${symbol} \rightarrow$", rf"down, ${symbol} \leftarrow$"
    for text, colour in zip(texts, DIRECTION_COLOURS, strict=True):
        panel.plot([], [], "s" if dense else "o", color=colour, markersize=4, label=text)
    if dense:
        panel.plot([], [], "s", color=BOTH_COLOUR, markersize=4, label="both")


def _add_legend(figure: Figure, panel: Axes, exact: bool) -> None:
    """Say below the panel what is in it; what became of the points is long."""
    _, texts = panel.get_legend_handles_labels()
    if texts:
        columns = 2 if exact else len(texts) if max(map(len, texts)) < 40 else 1
        figure.legend(loc="outside lower center", ncols=columns, frameon=False)


def _draw_branches(panel: Axes, line: Line, look: dict[str, Any]) -> None:
    """Draw the one-impact orbits, solid where stable, and their bifurcations."""
    drawn = [branches for branches in line.branches() if branches.pieces]
    for stable in (True, False):
        parts = [(one.n, piece) for one in drawn for piece in one.pieces if piece.stable == stable]
        for _, piece in parts:
            _draw_piece(panel, line, piece, look)
        if parts:
            periods = listed(str(n) for n in sorted({n for n, _ in parts}))
            text = f"exact orbit, $n = {periods}$, {'stable' if stable else 'unstable'}"
            panel.plot([], [], label=text, **look, linestyle=_line(stable))
    for kind, marker in _MARKS.items():
        marks = [mark for branches in drawn for mark in branches.marks if mark.kind == kind]
        for mark in marks:
            y = line.coordinates(mark.value, mark.orbit)
            (points,) = panel.plot(np.full(len(y), mark.value), y, marker)
            points.set(color=look["color"], markerfacecolor="white", markersize=4.5, zorder=5)
            points.set_label(kind if mark is marks[0] else "_")


def _draw_piece(panel: Axes, line: Line, piece: Piece, look: dict[str, Any]) -> None:
    x = np.array(piece.values)
    y = np.array([line.coordinates(*pair) for pair in zip(x, piece.orbits, strict=True)])
    # Where the impact passes the phase at which the coordinate begins anew, so does the line.
    begin = 0.0 if line.coordinate == "impact_phase" else line.phase
    phases = (np.array([orbit.phase for orbit in piece.orbits]) - begin) % (2.0 * np.pi)
    jumps = np.flatnonzero(np.abs(np.diff(phases)) > np.pi) + 1
    x, y = np.insert(x, jumps, np.nan), np.insert(y, jumps, np.nan, axis=0)
    panel.plot(x, y, zorder=4, label="_", **look, linestyle=_line(piece.stable))


def _line(stable: bool) -> Any:
    return "-" if stable else (0, (4, 2))
