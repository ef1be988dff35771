"""The closed-form one-impact orbits over a bifurcation diagram, and how far the points are off."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from sweeps.analysis.overlay import Line, deviations
from sweeps.analysis.selection import Cut, listed
from sweeps.plotting.lines import select_line, split_directions
from sweeps.plotting.palette import VERMILION
from sweeps.store import DIRECTION
from vibroimpact.orbits.one_impact_branches import Piece

#: Markers of the bifurcations of a branch.
_MARKERS = {"flip": "o", "fold": "s", "graze": "^"}
#: The lines over the points of one direction and of two: of two directions the markers are to be
#: seen through the lines, whose colour is near that of neither.
_OVER_ONE: dict[str, Any] = {"color": VERMILION, "linewidth": 1.0}
_OVER_BOTH: dict[str, Any] = {"color": "black", "linewidth": 0.4}


def compare(
    dataset: xr.Dataset,
    axes: Sequence[str] = (),
    at: Cut | None = None,
    coordinate: str | None = None,
) -> list[str]:
    """Say how far the points of a diagram are from the exact branches that they follow.

    Parameters
    ----------
    dataset, axes, at, coordinate
        As for `sweeps.plotting.bifurcation`.

    Returns
    -------
    list of str
        A line of text for each direction and each number of forcing periods.

    Raises
    ------
    Refused
        As from `sweeps.plotting.bifurcation`.
    """
    line, axis, coordinate = select_line(dataset, axes, at, coordinate)
    texts = []
    for branch in split_directions(line):
        start = f"{branch[DIRECTION].item()}: " if DIRECTION in branch.coords else ""
        lines = [
            deviation.told(axis) for deviation in deviations(Line.of(branch, axis, coordinate))
        ]
        texts += [start + text for text in lines or ["no point follows a stable one-impact orbit"]]
    return texts


def draw_branches(panel: Axes, line: Line, directions: int) -> None:
    """Draw the one-impact orbits, solid where stable, and their bifurcations.

    Parameters
    ----------
    panel : Axes
    line : Line
        The points that the orbits are drawn over.
    directions : int
        In how many directions the points were followed.
    """
    look = _OVER_BOTH if directions > 1 else _OVER_ONE
    branches = [branch for branch in line.branches() if branch.pieces]
    for stable in (True, False):
        pieces = [
            (branch.n, piece)
            for branch in branches
            for piece in branch.pieces
            if piece.stable == stable
        ]
        for _, piece in pieces:
            _draw_piece(panel, line, piece, look)
        if pieces:
            periods = listed(str(n) for n in sorted({n for n, _ in pieces}))
            text = f"exact orbit, $n = {periods}$, {'stable' if stable else 'unstable'}"
            panel.plot([], [], label=text, **look, linestyle=_line_style(stable))
    for kind, marker in _MARKERS.items():
        marks = [mark for branch in branches for mark in branch.marks if mark.kind == kind]
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
    panel.plot(x, y, zorder=4, label="_", **look, linestyle=_line_style(piece.stable))


def _line_style(stable: bool) -> Any:
    return "-" if stable else (0, (4, 2))
