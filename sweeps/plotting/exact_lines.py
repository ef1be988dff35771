"""Draws exact branches over a diagram; curves and their special points over a map."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting import canvas
from sweeps.plotting.pixels import in_panel, runs
from sweeps.plotting.style import CLASSES, STABLE, UNSTABLE, VERMILION, ground, ink
from sweeps.text import shown_count
from vibroimpact.points.regimes import Regime

#: Names of the lines in the legend, with their dashes.
LINES: dict[str, Any] = {STABLE: "-", UNSTABLE: (0, (4, 2))}
_THIN_LINES = "thin: chaotic, unknown, narrow"
#: Markers of the bifurcations of a branch.
MARKERS = {"flip": "o", "fold": "s", "graze": "^"}
#: If there are more branches, only those to which motions go, and what bounds these, are drawn.
_BRANCHES_IN_FULL = 12
#: Look of the lines over points of one colour and of several colours, which thin lines leave
#: visible.
_OVER_ONE_COLOUR: dict[str, Any] = {"color": VERMILION, "linewidth": 1.0}
_OVER_COLOURS: dict[str, Any] = {"linewidth": 0.4}
_THIN_BRANCHES: dict[str, Any] = {"linewidth": 0.3, "alpha": 0.5}


class BranchPiece(NamedTuple):
    """A stable or unstable piece of a branch, or the bifurcations of one kind."""

    name: str  # in the legend, out of ``LINES`` or ``MARKERS``
    x: np.ndarray  # values of the axis, shape (n,)
    y: np.ndarray  # values of the coordinate, shape (n, k), with NaN for no value
    #: Whether its branch is stable over less than a hundredth of the axis, because many such
    #: branches would hide the others; their bifurcations are not drawn.
    thin: bool = False
    orbit: str = ""  # class of the branch


def branch_pieces(branches: xr.Dataset, coordinate: str) -> Iterator[BranchPiece]:
    """Yield the pieces of `sweeps.branches` that a diagram of a coordinate shows."""
    from sweeps.bifurcation.exact_branches import wide_branches

    (axis,), wide = branches.coords, wide_branches(branches)
    values = branches[coordinate].values
    values = values % (2.0 * np.pi) if coordinate == "impact_phase" else values
    for number, is_wide in enumerate(wide.tolist()):
        of_branch = (branches["branch"].values == number) & (branches["kind"].values == "")
        branch = branches.isel(point=of_branch)
        x, stable, y = branch[axis].values, branch["stable"].values, values[of_branch]
        y = y[:, np.isfinite(y).any(axis=0)]
        if not y.shape[1]:  # the free oscillation has no impact, a left-out branch no point
            continue
        m, q = (int(branch[name].values[0]) for name in ("m", "q"))
        # A special point ends the pieces on both sides, and belongs to the stable one.
        states = zip(stable[1:] | stable[:-1], _breaks(branch, coordinate), strict=True)
        for start, stop, (steady, run) in runs(states):
            if run >= 0:
                name, at = STABLE if steady else UNSTABLE, slice(start, stop + 1)
                yield BranchPiece(name, x[at], y[at], q > 0 and not is_wide, f"{m}/{q}")
    for kind in MARKERS:
        here = (branches["kind"].values == kind) & wide[branches["branch"].values]
        if here.any():
            yield BranchPiece(kind, branches[axis].values[here], values[here])


def without_idle(branches: xr.Dataset, line: OpenedSweep) -> tuple[xr.Dataset, int]:
    """Return the branches that a diagram of a line draws, and the number of those left out."""
    # Of more than a few branches that were not chosen, drawn are those to which motions of the line
    # go, and those that meet one of these at a bifurcation, which bound the motions.
    (axis,), count = map(str, branches.coords), 1 + branches["branch"].values.max(initial=-1)
    if count <= _BRANCHES_IN_FULL or branches.attrs.get("chosen") or "period" not in line:
        return branches, 0
    _, m, q = (each.ravel() for each in line.classes)
    axis_values = line[axis].broadcast_like(line["status"]).transpose(*line.grid).values
    numbers, kinds, values = (branches[name].values for name in ("branch", "kind", axis))
    is_goal = np.zeros(count, bool)
    for number in range(count):
        of_branch = numbers == number
        x = values[of_branch & branches["stable"].values]
        first = branches.isel(point=int(np.argmax(of_branch)))
        of_class = axis_values.ravel()[(m == first["m"].item()) & (q == first["q"].item())]
        is_goal[number] = len(x) > 0 and ((x.min() <= of_class) & (of_class <= x.max())).any()
    low, high = branches.attrs["range"]
    meetings = list(zip(kinds, np.rint(1e7 * (values - low) / (high - low)), strict=True))
    special = np.isin(kinds, [*MARKERS])
    of_goals = {meetings[i] for i in np.flatnonzero(special & is_goal[numbers])}
    is_goal[[numbers[i] for i in np.flatnonzero(special) if meetings[i] in of_goals]] = True
    subset = branches.isel(point=is_goal[numbers])
    _, renumbered = np.unique(subset["branch"].values, return_inverse=True)
    return subset.assign(branch=("point", renumbered)), int(count - is_goal.sum())


def _breaks(branch: xr.Dataset, coordinate: str) -> list[int]:
    """Number the continuous runs of a branch, for each step; -1 for a step in which y jumps."""
    # It jumps where an impact passes the section, or its phase passes 0.
    phases = branch["impact_phase"].values
    if coordinate not in ("impact_phase", "poincare_v"):
        return [0] * (len(phases) - 1)
    wrap_phase = 0.0 if coordinate == "impact_phase" else branch.attrs["phase"]
    turns = np.floor((phases - wrap_phase) / (2.0 * np.pi))
    jumps = (np.abs(np.diff(turns, axis=0)) > 0.0).any(axis=1)  # False for NaN
    return np.where(jumps, -1, np.cumsum(jumps)).tolist()


def draw_branches(
    panel: Axes,
    branches: xr.Dataset,
    coordinate: str,
    is_plain: bool,
    in_chaos: Callable[[np.ndarray], np.ndarray],
    marks: bool = True,
) -> dict[str, list[Line2D]]:
    """Draw `sweeps.branches`, thinly where unstable `in_chaos`; return the lines by their names."""
    # The lines are thin and have the colour of texts unless the ground `is_plain`, in one colour.
    props = _OVER_ONE_COLOUR if is_plain else {"color": ink(), **_OVER_COLOURS}
    lines: dict[str, list[Line2D]] = {name: [] for name in (*LINES, _THIN_LINES, *MARKERS)}
    for name, x, y, thin, _ in branch_pieces(branches, coordinate):
        hidden = in_chaos(x)
        if name in LINES:
            faint = (hidden & (name == UNSTABLE) | thin).tolist()
            for start, stop, is_faint in runs(faint):
                run, line_name = slice(start, stop + 1), _THIN_LINES if is_faint else name
                run_props = props | _THIN_BRANCHES if is_faint else props
                lines[line_name] += panel.plot(
                    x[run], y[run], zorder=4, label="_", ls=LINES[name], **run_props
                )
            continue
        if marks:
            x_of_y = np.broadcast_to(x[:, None], y.shape)
            (dots,) = panel.plot(x_of_y[np.isfinite(y)], y[np.isfinite(y)], MARKERS[name], zorder=5)
            dots.set(color=props["color"], markerfacecolor=ground(), markersize=3.0, label="_")
            dots.set_markeredgewidth(0.6)
            lines[name].append(dots)
    return lines


def without_gaps(mask: np.ndarray, width: int) -> np.ndarray:
    """Return a mask without interruptions and runs of at most so many places."""
    from scipy.ndimage import binary_closing, binary_opening

    window = np.ones(width, bool)
    padded = binary_closing(np.pad(mask, width, mode="edge"), window)
    result: np.ndarray = binary_opening(padded, window)[width:-width]
    return result


def label_lines(lines: Mapping[str, Sequence[Line2D]]) -> list[Line2D]:
    """Label one line of each name that is within the limits of its panel; return these."""
    entries = []
    for name, of_name in lines.items():
        if (line := next(filter(canvas.is_in_view, of_name), None)) is not None:
            line.set_label(name)
            entries.append(line)
    return entries


#: If there are more curves, only those that bound a class with a colour of its own are drawn.
_CURVES_IN_FULL = 12
#: Points of a curve in each cell; interruptions of so many cells are ignored.
_PER_CELL, _GAP = 3, 6
#: Dashes of the curves of each kind.
_CURVES: dict[str, Any] = {"flip": "-", "fold": (0, (4, 2)), "graze": (0, (1, 1.5))}
#: Width of a curve that bounds a motion with its light edge [pt].
_EDGE = 1.8
#: Look of curves that do not bound a motion.
_THIN_CURVES: dict[str, Any] = {"color": "#666666", "linewidth": 0.3}
#: Name of the special points of curves.
_SPECIAL = "cusp or meeting"


def _pieces(
    curves: xr.Dataset, cut: OpenedSweep, allowed: Container[tuple[int, int]] | None
) -> Iterator[tuple[int, np.ndarray, bool]]:
    """Yield the number and points (k, 2) of each piece, and if it bounds an `allowed` class."""
    # A piece bounds a motion if a cell with the class of its orbit and one without it are within
    # one cell.
    from scipy.ndimage import maximum_filter

    regimes, *numbers = cut.classes
    classes = np.where(regimes == Regime.PERIODIC, numbers, 0)
    values, axes = _on_axes(curves, cut), [cut[name].values for name in cut.grid[::-1]]
    each = _one_point_each(curves)
    kinds, ms, qs = (each[name].values.tolist() for name in ("kind", "m", "q"))
    for number, (kind, m, q) in enumerate(zip(kinds, ms, qs, strict=True)):
        line = values[(curves["curve"].values == number) & (curves["special"].values == "")]
        cells = [np.interp(z, a, np.arange(len(a))) for z, a in zip(line.T, axes, strict=True)]
        count = np.ceil(_PER_CELL * np.abs(np.diff(cells)).max(axis=0, initial=0.0))
        along = np.concatenate([[0.0], np.cumsum(np.maximum(count, 1.0))])
        fine = np.arange(along[-1] + 1.0)
        column, row = (np.rint(np.interp(fine, along, each)).astype(int) for each in cells)
        before = (1, 0) if q == 1 else (m, q - 1)  # of a graze
        bounds = np.zeros(len(fine), bool)
        for mq in {(m, q), before if kind == "graze" else (m, q)}:
            if allowed is not None and mq not in allowed:
                continue
            mask = (classes == np.reshape(mq, (2, 1, 1))).all(axis=0)
            near, other = (maximum_filter(each, 3, mode="nearest") for each in (mask, ~mask))
            bounds |= (near & other)[row, column]
        bounds = without_gaps(bounds, _PER_CELL * _GAP)
        points = np.stack([np.interp(fine, along, z) for z in line.T], axis=1)
        for start, stop, flag in runs(bounds.tolist()):
            yield number, points[start : stop + 1], flag


def _on_axes(curves: xr.Dataset, cut: OpenedSweep) -> np.ndarray:
    """Return the points of curves on abscissa and ordinate of a map, shape (n, 2)."""
    return np.stack([curves[name].values for name in cut.grid[::-1]], axis=1)


def _one_point_each(curves: xr.Dataset) -> xr.Dataset:
    """Return one point of each curve, which has its kind and its class."""
    return curves.isel(point=np.unique(curves["curve"].values, return_index=True)[1])


def draw_curves(
    panel: Axes, curves: xr.Dataset, cut: OpenedSweep, marks: bool
) -> dict[Artist, float]:
    """Draw `sweeps.curves` over a map of a cut; return handles and shares for its legend."""
    # Pieces that bound a motion are strong. The others are thin: there the start leads to another
    # orbit. Of many curves, only those that bound a class with a colour of its own are drawn.
    limits = panel.get_xlim(), panel.get_ylim()
    kinds = _one_point_each(curves)["kind"].values
    is_many = len(kinds) > _CURVES_IN_FULL
    pieces = list(_pieces(curves, cut, CLASSES if is_many else None))
    bounding = {number for number, _, bounds in pieces if bounds}
    edge = [withStroke(linewidth=_EDGE, foreground=ground(), alpha=0.9)]  # on cells of any colour
    bold: dict[str, Any] = {"color": ink(), "linewidth": 0.8, "path_effects": edge, "zorder": 4}
    lines: dict[str, list[Line2D]] = {kind: [] for kind in _CURVES}
    further = list[tuple[int, Line2D]]()
    for number, points, bounds in pieces:
        props = bold if bounds else _THIN_CURVES
        (line,) = panel.plot(*points.T, ls=_CURVES[kinds[number]], **props)
        if bounds:
            lines[kinds[number]].append(line)
        elif number not in bounding:
            further.append((number, line))
    panel.set(xlim=limits[0], ylim=limits[1])
    strong = [points for _, points, bounds in pieces if bounds]
    lines[_SPECIAL] = _mark_special(panel, curves, cut, strong) if marks else []
    count = len({number for number, line in further if canvas.is_in_view(line)})
    text = f"{shown_count(count, 'further curve')}{' not shown' if is_many else ''}"
    lines[text] = [line for _, line in further]
    if is_many:
        for line in lines[text]:
            line.remove()
        lines[text] = [Line2D([], [], ls="")] if count else []
    return {line: float(line.get_label() != text) for line in label_lines(lines)}


def _mark_special(
    panel: Axes, curves: xr.Dataset, cut: OpenedSweep, strong: Sequence[np.ndarray]
) -> list[Line2D]:
    """Mark cusps and meetings on strong pieces, given their points; return the marks."""
    marked = curves.isel(point=np.isin(curves["special"].values, ["cusp", "degenerate", "flip"]))
    special = _on_axes(marked, cut)
    lines = in_panel(panel, np.concatenate([np.empty((0, 2)), *strong]))
    near = [np.abs(lines - place).max(axis=1) < 0.01 for place in in_panel(panel, special)]
    special = special[[each.any() for each in near]]
    if not len(special):
        return []
    (marks,) = panel.plot(*special.T, "D", color=ink(), markersize=2.5)
    marks.set(markerfacecolor=ground(), markeredgewidth=0.6, zorder=5)
    return [marks]
