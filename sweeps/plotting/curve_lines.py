"""Exact curves of flips, folds and grazes over a map: those that bound its motions stand out."""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting.style import ground, ink
from sweeps.text import shown_count
from vibroimpact.points.regimes import Regime

#: If there are more curves, only those that bound a class with a colour of its own are drawn.
_CURVES_IN_FULL = 12
#: Points of a curve in each cell; interruptions of so many cells are ignored.
_PER_CELL, _GAP = 3, 6
#: Dashes of the curves of each kind.
_CURVES: dict[str, Any] = {"flip": "-", "fold": (0, (4, 2)), "graze": (0, (1, 1.5))}
#: Look of curves that do not bound a motion.
_THIN_CURVES: dict[str, Any] = {"color": "#666666", "linewidth": 0.3}


class _Piece(NamedTuple):
    """A piece of a curve: its number, its points, shape (k, 2), and whether it bounds a motion."""

    number: int
    points: np.ndarray
    bounds: bool


def _pieces(
    found: xr.Dataset,
    cut: OpenedSweep,
    axes: Sequence[np.ndarray],
    shown: Container[tuple[int, int]] | None,
) -> Iterator[_Piece]:
    """Yield the curves in pieces that bound a motion of the map, and others.

    A piece bounds a motion if a cell with the class of its orbit, which must be one of those
    `shown`, and another cell without it, are within one cell. `axes` are the values of the abscissa
    and of the ordinate.
    """
    from scipy.ndimage import binary_closing, binary_opening, maximum_filter

    regimes, *mq = cut.classes
    classes = np.where(regimes == Regime.PERIODIC, mq, 0)
    window = np.ones(_PER_CELL * _GAP, bool)
    values = np.stack([found[name].values for name in found.coords], axis=1)
    each = _one_point_each(found)
    kinds, ms, qs = (each[name].values.tolist() for name in ("kind", "m", "q"))
    for number, (kind, m, q) in enumerate(zip(kinds, ms, qs, strict=True)):
        line = values[(found["curve"].values == number) & (found["special"].values == "")]
        cells = [np.interp(z, a, np.arange(len(a))) for z, a in zip(line.T, axes, strict=True)]
        count = np.ceil(_PER_CELL * np.abs(np.diff(cells)).max(axis=0, initial=0.0))
        along = np.concatenate([[0.0], np.cumsum(np.maximum(count, 1.0))])
        fine = np.arange(along[-1] + 1.0)
        column, row = (np.rint(np.interp(fine, along, each)).astype(int) for each in cells)
        before = (1, 0) if q == 1 else (m, q - 1)  # of a graze
        bounds = np.zeros(len(fine), bool)
        for own in {(m, q), before if kind == "graze" else (m, q)}:
            if shown is not None and own not in shown:
                continue
            mask = (classes == np.reshape(own, (2, 1, 1))).all(axis=0)
            near, other = (maximum_filter(each, 3, mode="nearest") for each in (mask, ~mask))
            bounds |= (near & other)[row, column]
        padded = binary_closing(np.pad(bounds, len(window), mode="edge"), window)
        bounds = binary_opening(padded, window)[len(window) : -len(window)]
        points = np.stack([np.interp(fine, along, z) for z in line.T], axis=1)
        for flag, group in groupby(enumerate(bounds.tolist()), key=lambda item: item[1]):
            (first, _), *_, (last, _) = 2 * list(group)
            yield _Piece(number, points[first : last + 2], flag)


def _one_point_each(found: xr.Dataset) -> xr.Dataset:
    """Return one point of each curve, which has its kind and its class."""
    return found.isel(point=np.unique(found["curve"].values, return_index=True)[1])


def draw_curves(
    panel: Axes,
    found: xr.Dataset,
    cut: OpenedSweep,
    axes: Sequence[np.ndarray],
    coloured: Container[tuple[int, int]],
    marks: bool,
) -> list[Line2D]:
    """Draw `sweeps.curves` over a map of a cut; return labelled handles for the legend.

    Pieces that bound a motion are drawn strongly. The others are thin: there the start leads to
    another orbit. If there are many curves, only those that bound one of the `coloured` classes
    somewhere are drawn. The legend says how many others there are. Cusps and points where curves
    meet are marked on the strong pieces if `marks` is true.
    """
    limits = panel.get_xlim(), panel.get_ylim()
    kinds = _one_point_each(found)["kind"].values
    is_many = len(kinds) > _CURVES_IN_FULL
    pieces = list(_pieces(found, cut, axes, coloured if is_many else None))
    strong = [piece for piece in pieces if piece.bounds]
    bounding = {piece.number for piece in strong}
    shown = [piece for piece in pieces if not is_many or piece.number in bounding]
    bold: dict[str, Any] = {"color": ink(), "linewidth": 0.8}
    edge = [withStroke(linewidth=1.8, foreground=ground(), alpha=0.9)]  # on cells of any colour
    for piece in shown:
        look = {"path_effects": edge, "zorder": 4, **bold} if piece.bounds else _THIN_CURVES
        panel.plot(*piece.points.T, ls=_CURVES[kinds[piece.number]], **look)
    drawn = kinds[[piece.number for piece in shown]]
    handles = [
        Line2D([], [], ls=dashes, label=kind, **bold)
        for kind, dashes in _CURVES.items()
        if kind in drawn
    ]
    handles += _mark_special(panel, found, strong) if marks else []
    if left := len(kinds) - len(bounding):
        text = f"{shown_count(left, 'further curve')}{' not shown' if is_many else ''}"
        handles.append(Line2D([], [], ls="" if is_many else "-", label=text, **_THIN_CURVES))
    panel.set(xlim=limits[0], ylim=limits[1])
    return handles


def _in_panel(panel: Axes, points: np.ndarray) -> np.ndarray:
    """Return points of a panel as shares of its width and height."""
    shares: np.ndarray = panel.transAxes.inverted().transform(panel.transData.transform(points))
    return shares


def _mark_special(panel: Axes, found: xr.Dataset, strong: Sequence[_Piece]) -> list[Line2D]:
    """Mark cusps and meetings on strong pieces; return a handle if there are any."""
    marked = found.isel(point=np.isin(found["special"].values, ["cusp", "flip"]))
    special = np.stack([marked[name].values for name in marked.coords], axis=1)
    if not len(special) or not strong:
        return []
    lines = _in_panel(panel, np.concatenate([piece.points for piece in strong]))
    away = [np.abs(lines - place).max(axis=1).min() for place in _in_panel(panel, special)]
    shown = special[np.array(away) < 0.01]
    if not len(shown):
        return []
    (marks,) = panel.plot(*shown.T, "D", color=ink(), label="cusp or meeting")
    marks.set(markersize=2.5, markerfacecolor=ground(), markeredgewidth=0.6, zorder=5)
    return [marks]
