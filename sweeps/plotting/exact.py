"""Exact branches over a bifurcation diagram, and exact curves over a map."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.transforms import Bbox

from sweeps.analysis.exact_branches import wide_branches
from sweeps.plotting.style import VERMILION

_STABLE, _UNSTABLE = "exact orbits, stable", "exact orbits, unstable"
#: Names of the lines in the legend, with their dashes.
LINES: dict[str, Any] = {_STABLE: "-", _UNSTABLE: (0, (4, 2))}
_THIN_LINES = "stable over less than 1 % of the axis"
#: Markers of the bifurcations of a branch.
MARKERS = {"flip": "o", "fold": "s", "graze": "^"}
#: Look of the lines over the points of one direction and of two directions. For two, the lines are
#: thin and black, so that the markers in both colours remain visible.
_OVER_ONE: dict[str, Any] = {"color": VERMILION, "linewidth": 1.0}
_OVER_BOTH: dict[str, Any] = {"color": "black", "linewidth": 0.4}
_THIN: dict[str, Any] = {"linewidth": 0.3, "alpha": 0.5}
#: Most names of curves on a map; least length of a named curve and least distance between names, as
#: shares of the panel.
_MOST_NAMES, _LONG, _ROOM = 24, 0.25, 0.1
#: Dashes of the curves of each kind.
_CURVES: dict[str, Any] = {"flip": "-", "fold": (0, (4, 2)), "graze": (0, (1, 1.5))}


class Part(NamedTuple):
    """A stable or unstable piece of a branch, or the bifurcations of one kind.

    `name` is its name in the legend, out of ``LINES`` or ``MARKERS``. `x` are values of the axis,
    shape (n,), and `y` values of the coordinate, shape (n, k), with NaN for no value. A piece is
    `thin` if its branch is stable over less than a hundredth of the axis, because many such
    branches would hide the others; their bifurcations are not drawn. `orbit` is the class of the
    branch.
    """

    name: str
    x: np.ndarray
    y: np.ndarray
    thin: bool = False
    orbit: str = ""


def parts_of(found: xr.Dataset, coordinate: str) -> Iterator[Part]:
    """Yield the parts of `sweeps.branches` that a diagram of a coordinate shows."""
    (axis,), wide = found.coords, wide_branches(found)
    for number in range(len(wide)):
        branch = found.isel(point=found["branch"].values == number)
        x, y, stable = (branch[name].values for name in (axis, coordinate, "stable"))
        orbit = f"{found['m'].values[number]}/{found['q'].values[number]}"
        y = _wrapped(y[:, np.isfinite(y).any(axis=0)], coordinate)
        if not y.shape[1]:  # the free oscillation has no impact
            continue
        # A special point ends the pieces on both sides, and belongs to the stable one.
        states = zip(stable[1:] | stable[:-1], _breaks(branch, coordinate), strict=True)
        for (steady, run), group in groupby(enumerate(states), key=lambda item: item[1]):
            indices = [i for i, _ in group]
            part = slice(indices[0], indices[-1] + 2)
            if run >= 0:
                thin = found["q"].values[number] > 0 and not wide[number]
                yield Part(_STABLE if steady else _UNSTABLE, x[part], y[part], thin, orbit)
    for kind in MARKERS:
        here = (found["kind"].values == kind) & wide[found["special_branch"].values]
        if here.any():
            y = _wrapped(found[f"special_{coordinate}"].values[here], coordinate)
            yield Part(kind, found["special_value"].values[here], y)


def _wrapped(values: np.ndarray, coordinate: str) -> np.ndarray:
    """Return values of a coordinate, with phases reduced to 0 to 2 pi."""
    return values % (2.0 * np.pi) if coordinate == "impact_phase" else values


def _breaks(branch: xr.Dataset, coordinate: str) -> list[int]:
    """Number the continuous runs of a branch, for each step; -1 for a step in which y jumps.

    The coordinate jumps where an impact passes the section, or its phase passes 0.
    """
    phases = branch["impact_phase"].values
    if coordinate not in ("impact_phase", "poincare_v"):
        return [0] * (len(phases) - 1)
    wrap_phase = 0.0 if coordinate == "impact_phase" else branch.attrs["phase"]
    turns = np.floor((phases - wrap_phase) / (2.0 * np.pi))
    jumps = (np.abs(np.diff(turns, axis=0)) > 0.0).any(axis=1)  # False for NaN
    return np.where(jumps, -1, np.cumsum(jumps)).tolist()


def draw_branches(
    panel: Axes, found: xr.Dataset, coordinate: str, two_directions: bool
) -> dict[str, list[Line2D]]:
    """Draw `sweeps.branches`, with solid lines where stable; return the lines by their names."""
    look = _OVER_BOTH if two_directions else _OVER_ONE
    drawn: dict[str, list[Line2D]] = {name: [] for name in (*LINES, _THIN_LINES, *MARKERS)}
    for name, x, y, thin, _ in parts_of(found, coordinate):
        if name in LINES:
            stroke = look | _THIN if thin else look
            lines = panel.plot(x, y, zorder=4, label="_", ls=LINES[name], **stroke)
            drawn[_THIN_LINES if thin else name] += lines
            continue
        seen = np.isfinite(y)
        x = np.broadcast_to(x[:, None], y.shape)
        (marks,) = panel.plot(x[seen], y[seen], MARKERS[name], label="_", zorder=5)
        marks.set(color=look["color"], markerfacecolor="white", markersize=3.5)
        marks.set_markeredgewidth(0.7)
        drawn[name].append(marks)
    return drawn


def name_parts(panel: Axes, parts: Mapping[str, Sequence[Line2D]]) -> None:
    """Label one line of each part of `draw_branches` that is visible within the panel's limits."""
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


def _name_curves(panel: Axes, found: xr.Dataset, values: np.ndarray) -> None:
    """Write m/q beside long curves where there is room, starting with the shortest periods."""
    places = panel.transAxes.inverted().transform(panel.transData.transform(values.T))
    curves = [places[found["curve"].values == number] for number in range(found.sizes["number"])]
    lengths = [float(np.abs(np.diff(curve, axis=0)).sum()) for curve in curves]
    taken = np.empty((0, 2))
    order = np.lexsort((-np.array(lengths), found["q"].values, found["m"].values))
    for number in [i for i in order.tolist() if lengths[i] > _LONG][:_MOST_NAMES]:
        curve = curves[number]
        inside = curve[((curve > 0.05) & (curve < 0.95)).all(axis=1)]
        if not len(inside):
            continue
        away = np.abs(inside[:, None] - taken).max(axis=2).min(axis=1, initial=np.inf)
        place = inside[len(inside) // 2] if not len(taken) else inside[np.argmax(away)]
        if away.max() < _ROOM:
            continue
        m, q = (int(found[name].values[number]) for name in ("m", "q"))
        edge = [withStroke(linewidth=1.5, foreground="white")]
        text = panel.text(
            place[0], place[1], f"{m}/{q}", transform=panel.transAxes, size="x-small", zorder=6
        )
        text.set(path_effects=edge, clip_on=True)
        taken = np.vstack([taken, place])


def draw_curves(panel: Axes, found: xr.Dataset) -> list[Line2D]:
    """Draw `sweeps.curves` over a map of the same axes; return labelled handles for the legend.

    Cusps and points where curves meet are marked.
    """
    limits = panel.get_xlim(), panel.get_ylim()
    values = np.stack([found[axis].values for axis in found.coords])
    look: dict[str, Any] = {"color": "black", "linewidth": 0.5}
    handles = {}
    for number, kind in enumerate(found["kind"].values):
        line = values[:, found["curve"].values == number]
        edge = [withStroke(linewidth=0.9, foreground="white", alpha=0.5)]  # visible on black
        panel.plot(*line, zorder=4, path_effects=edge, ls=_CURVES[kind], **look)
        handles[kind] = Line2D([], [], ls=_CURVES[kind], label=kind, **look)
    _name_curves(panel, found, values)
    marked = np.isin(found["special_kind"].values, ["cusp", "flip"])
    if marked.any():
        (marks,) = panel.plot(*found["special_values"].values[marked].T, "D", color="black")
        marks.set(markersize=2.5, markerfacecolor="white", markeredgewidth=0.6, zorder=5)
        marks.set_label("cusp or meeting")
        handles["marks"] = marks
    panel.set(xlim=limits[0], ylim=limits[1])
    return [handles[kind] for kind in (*_CURVES, "marks") if kind in handles]
