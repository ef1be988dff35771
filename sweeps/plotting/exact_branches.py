"""The exact branches over a bifurcation diagram, and how far the points are off."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import Bbox

from sweeps.analysis.coordinates import orbit_coordinate
from sweeps.analysis.exact_branches import (
    Line,
    deviations,
    grow,
    lines_of,
    summary,
)
from sweeps.analysis.selection import Cut
from sweeps.plotting.lines import select_line
from sweeps.plotting.palette import VERMILION
from sweeps.store import DIRECTION
from vibroimpact.orbits.branches import Branch
from vibroimpact.orbits.periodic import PeriodicOrbit
from vibroimpact.orbits.trees import Tree

#: Markers of the bifurcations of a branch.
_MARKERS = {"flip": "o", "fold": "s", "graze": "^"}
#: What the legend calls the lines, by whether the orbits are stable.
_STABILITY = {True: "exact orbits, stable", False: "exact orbits, unstable"}
#: The lines over the points of one direction and of two: of two directions the markers are to be
#: seen through the lines, whose colour is near that of neither.
_OVER_ONE: dict[str, Any] = {"color": VERMILION, "linewidth": 1.0}
_OVER_BOTH: dict[str, Any] = {"color": "black", "linewidth": 0.4}
#: Of a branch that is hardly ever stable: these are many, and would hide the others.
_UNSTABLE: dict[str, Any] = {"linewidth": 0.3, "alpha": 0.5}


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
        A line of text for each direction and class m/q, then what was found and what given up.

    Raises
    ------
    Refused
        As from `sweeps.plotting.bifurcation`.
    """
    _, axis, coordinate = select_line(dataset, axes, at, coordinate)
    lines = lines_of(dataset, axis, at)
    tree = grow(lines)
    texts = []
    for line in lines:
        start = f"{line.dataset[DIRECTION].item()}: " if DIRECTION in line.dataset.coords else ""
        followed = [deviation.summary(axis) for deviation in deviations(line, tree, coordinate)]
        texts += [start + text for text in followed or ["no point follows a stable exact branch"]]
    return texts + summary(tree)


def draw_branches(
    panel: Axes,
    lines: Sequence[Line],
    coordinate: str,
    check: Callable[[], object] | None = None,
) -> dict[str, list[Line2D]]:
    """Draw the branches of all periodic motions, solid where stable, and their bifurcations.

    Parameters
    ----------
    panel : Axes
    lines : sequence of Line
        The points that the orbits are drawn over, once for each direction.
    coordinate : str
        One of ``sweeps.analysis.coordinates.COORDINATES``.
    check : callable, optional
        As for `sweeps.analysis.exact_branches.grow`.

    Returns
    -------
    dict of str to list of Line2D
        What was drawn of each part, by what the legend calls it.
    """
    look = _OVER_BOTH if len(lines) > 1 else _OVER_ONE
    tree, phase = grow(lines, check), lines[0].phase
    parts: dict[str, list[Line2D]] = {text: [] for text in (*_STABILITY.values(), *_MARKERS)}
    for branch in tree.branches:
        if branch.q or not coordinate.startswith("impact"):
            stroke = look if not branch.q or _is_wide(branch, tree) else look | _UNSTABLE
            for stable, pieces in _draw_branch(panel, branch, coordinate, phase, stroke):
                parts[_STABILITY[stable]] += pieces
    for kind, marker in _MARKERS.items():
        x, y = [], []
        for branch in tree.branches:
            for point in branch.special if _is_wide(branch, tree) else ():
                if point.kind == kind:
                    shown = orbit_coordinate(point.orbit, coordinate, phase)
                    x += [point.value] * len(shown)
                    y += shown.tolist()
        if x:
            (points,) = panel.plot(x, y, marker, label="_")
            points.set(color=look["color"], markerfacecolor="white", markersize=3.5, zorder=5)
            points.set_markeredgewidth(0.7)
            parts[kind].append(points)
    return parts


def branch_parts(
    lines: Sequence[Line], coordinate: str, check: Callable[[], object] | None = None
) -> dict[str, tuple[list[np.ndarray], list[np.ndarray]]]:
    """Return abscissae and ordinates of what `draw_branches` draws, whose arguments these are."""
    parts = draw_branches(Figure().add_subplot(), lines, coordinate, check)
    return {
        name: (
            [np.asarray(line.get_xdata(), float) for line in drawn],
            [np.asarray(line.get_ydata(), float) for line in drawn],
        )
        for name, drawn in parts.items()
    }


def name_parts(panel: Axes, parts: Mapping[str, Sequence[Line2D]]) -> None:
    """Label one line of each part of `draw_branches` that is seen within the panel's limits."""
    (left, right), (bottom, top) = panel.get_xlim(), panel.get_ylim()
    view = Bbox([(left, bottom), (right, top)])
    for text, pieces in parts.items():
        seen = (piece for piece in pieces if _is_seen(piece, view))
        if (piece := next(seen, None)) is not None:
            piece.set_label(text)


def _is_seen(line: Line2D, view: Bbox) -> bool:
    path = line.get_path()
    if line.get_linestyle() == "None":
        return bool(view.count_contains(path.vertices))
    return bool(path.intersects_bbox(view, filled=False))


def _is_wide(branch: Branch, tree: Tree) -> bool:
    """Whether a branch is stable over a hundredth of the axis: marks of others hide the lines."""
    steps = np.abs(np.diff(branch.values))[branch.stable[1:] & branch.stable[:-1]]
    return bool(steps.sum() > 0.01 * (tree.high - tree.low))


def _draw_branch(
    panel: Axes, branch: Branch, coordinate: str, phase: float, look: dict[str, Any]
) -> Iterator[tuple[bool, list[Line2D]]]:
    """Draw one branch in pieces of one stability, and yield these with their lines."""
    x, y, breaks = (
        branch.values,
        _ordinates(branch, coordinate, phase),
        _breaks(branch, coordinate, phase),
    )
    # A special point ends the pieces on both sides, and belongs to the stable one.
    stable = branch.stable[1:] | branch.stable[:-1]
    for state, steps in groupby(range(len(stable)), key=lambda i: (bool(stable[i]), breaks[i])):
        piece = list(steps)
        if state[1] >= 0:
            part = slice(piece[0], piece[-1] + 2)
            style = _line_style(state[0])
            yield state[0], panel.plot(x[part], y[part], zorder=4, label="_", **look, ls=style)


def _ordinates(branch: Branch, coordinate: str, phase: float) -> np.ndarray:
    """Return what the diagram shows along a branch, shape (n, m) or (n, q), in continuous order."""
    if coordinate == "impact_v":
        return branch.speeds
    if coordinate == "impact_phase":
        return branch.phases % (2.0 * np.pi)
    rows = []
    for i in range(len(branch.values)):
        # Not the orbit itself, which may number its impacts from another impact than the branch.
        oscillator = branch.orbit(i).oscillator
        orbit = PeriodicOrbit(oscillator, branch.m, branch.phases[i], branch.speeds[i])
        rows.append(orbit_coordinate(orbit, coordinate, phase))
    return np.array(rows)


def _breaks(branch: Branch, coordinate: str, phase: float) -> np.ndarray:
    """Return a number for each step, -1 where an impact passes the section: a jump."""
    steps = len(branch.values) - 1
    if coordinate in ("impact_v", "poincare_x", "poincare_height") or not branch.q:
        return np.zeros(steps, int)
    wrap_phase = 0.0 if coordinate == "impact_phase" else phase
    turns = np.floor((branch.phases - wrap_phase) / (2.0 * np.pi))
    jumps = (np.diff(turns, axis=0) != 0.0).any(axis=1)
    return np.where(jumps, -1, np.cumsum(jumps))


def _line_style(stable: bool) -> Any:
    return "-" if stable else (0, (4, 2))
