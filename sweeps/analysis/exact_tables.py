"""Exact branches and curves as datasets, as rows of CSV files, and as a list of bifurcations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from sweeps.analysis.csv_tables import write_rows
from sweeps.analysis.exact_branches import grow, lines_of, summary
from sweeps.analysis.exact_curves import CurveSearch, find_curves, map_axes
from sweeps.analysis.selection import Cut, chosen_axes, swept_axes
from sweeps.errors import Refused
from sweeps.text import table
from vibroimpact.orbits.trees import Tree


def branches(dataset: xr.Dataset, axis: str | None = None, at: Cut | None = None) -> xr.Dataset:
    """Follow the orbits of all periodic motions of a sweep along one axis.

    Parameters
    ----------
    dataset : Dataset
        From `sweeps.open_sweep`.
    axis : str, optional
        A swept parameter of the oscillator, by default the longest axis.
    at : mapping of str to float, optional
        Values of the other swept axes; by default the first.

    Returns
    -------
    Dataset
        Along ``point``, branch after branch: the axis, ``branch`` (its number), ``stable``, and
        ``impact_phase`` and ``impact_v`` (``point``, ``impact``), NaN beyond q. Along ``number``:
        ``m`` and ``q``. Along ``special``: ``kind``, ``special_value``, ``special_branch``,
        ``special_m`` and ``special_q`` of the flips, folds, grazes and ends.
        The attribute ``given_up`` says what was not followed.

    Raises
    ------
    Refused
        If there is no such axis, or the orbits do not depend on it.
    """
    (axis,) = chosen_axes(dataset, [axis] if axis else [], 1, "branch")
    return _branches_dataset(grow(lines_of(dataset, axis, at)))


def _branches_dataset(tree: Tree) -> xr.Dataset:
    """Return a tree as `branches` does."""
    width = max((branch.q for branch in tree.branches), default=0)
    phases = _padded([branch.phases for branch in tree.branches], width)
    speeds = _padded([branch.speeds for branch in tree.branches], width)
    stable = [branch.stable for branch in tree.branches]
    numbers, m, q, special = _numbered(tree.branches)
    data = {
        "branch": numbers,
        "stable": ("point", np.concatenate([np.empty(0, bool), *stable])),
        "impact_phase": (("point", "impact"), phases),
        "impact_v": (("point", "impact"), speeds),
        "m": m,
        "q": q,
        "kind": ("special", np.array([point.kind for _, point in special], "U11")),
        "special_value": ("special", np.array([point.value for _, point in special], float)),
        "special_branch": ("special", np.array([number for number, _ in special], int)),
        "special_m": ("special", np.array([point.orbit.m for _, point in special], int)),
        "special_q": ("special", np.array([point.orbit.q for _, point in special], int)),
    }
    values = np.concatenate([np.empty(0), *(branch.values for branch in tree.branches)])
    given_up = "; ".join(summary(tree)[1:])
    return xr.Dataset(data, {tree.parameter: ("point", values)}, {"given_up": given_up})


def _numbered(items: Sequence[Any]) -> tuple[Any, Any, Any, list[Any]]:
    """Return the number of each point's branch or curve, all m and q, and the special points."""
    numbers = np.repeat(np.arange(len(items)), [len(item.values) for item in items])
    m, q = (np.array([getattr(item, name) for item in items], int) for name in ("m", "q"))
    special = [(number, point) for number, item in enumerate(items) for point in item.special]
    return ("point", numbers), ("number", m), ("number", q), special


def _padded(columns: Sequence[np.ndarray], width: int) -> np.ndarray:
    """Stack arrays of different widths, with NaN where there is nothing."""
    out = np.full((sum(map(len, columns)), width), np.nan)
    row = 0
    for column in columns:
        out[row : row + len(column), : column.shape[1]] = column
        row += len(column)
    return out


class Bifurcation(NamedTuple):
    """A bifurcation of an exact orbit; at a graze m/q are those with the impact that grazes."""

    kind: str
    m: int
    q: int
    value: float


def exact_bifurcations(tree: Tree) -> list[Bifurcation]:
    """Return the bifurcations of a tree, each once, in the order of their values."""
    kept: list[Bifurcation] = []
    points = [point for branch in tree.branches for point in branch.special]
    for kind, value, orbit in sorted(points, key=lambda point: point.value):
        new = Bifurcation(kind, orbit.m, orbit.q, value)
        lowest = value - 1e-10 * max(1.0, abs(value))
        listed_before = [old[:3] for old in reversed(kept[-64:]) if old.value >= lowest]
        if kind in ("flip", "fold", "graze") and new[:3] not in listed_before:
            kept.append(new)
    return kept


def describe(dataset: xr.Dataset, axis: str, at: Cut | None = None) -> str:
    """List the bifurcations on all branches of the motions along one line of a sweep.

    Parameters
    ----------
    dataset : Dataset
        From `sweeps.open_sweep`.
    axis : str
    at : mapping of str to float, optional
        Values of the other axes.

    Returns
    -------
    str
        A line each: the value to twelve digits, the kind, and m/q; empty where there are several
        lines, or the axis is a start or has a single value.
    """
    uncut = [name for name in swept_axes(dataset) if name != axis and name not in (at or {})]
    if uncut or axis in ("x0", "v0") or dataset.sizes[axis] == 1:
        return ""
    tree = grow(lines_of(dataset, axis, at))
    rows = [
        [f"{axis} = {point.value:.12g}", point.kind, f"{point.m}/{point.q}"]
        for point in exact_bifurcations(tree)
    ]
    return "\n".join(["", *summary(tree), *([table(rows)] if rows else [])])


def write_branches(path: Path, dataset: xr.Dataset) -> None:
    """Write the points of branches, and then their special points, which have a kind.

    Parameters
    ----------
    path : Path
    dataset : Dataset
        From `branches`. Speeds and phases of the impacts are separated by spaces.
    """
    (parameter,) = dataset.coords
    m, q = dataset["m"].values.tolist(), dataset["q"].values.tolist()
    columns = [dataset[name].values.tolist() for name in ("branch", parameter, "stable")]
    impacts = [dataset[name].values for name in ("impact_v", "impact_phase")]
    special = [dataset[f"special_{name}"].values.tolist() for name in ("branch", "m", "q", "value")]

    def rows() -> Iterator[list[object]]:
        for i, (number, value, stable) in enumerate(zip(*columns, strict=True)):
            numbers = [" ".join(map(repr, of[i, : q[number]].tolist())) for of in impacts]
            yield [number, m[number], q[number], value, int(stable), "", *numbers]
        for *row, kind in zip(*special, dataset["kind"].values.tolist(), strict=True):
            yield [*row, "", kind, "", ""]

    head = ["branch", "m", "q", parameter, "stable", "kind", "impact_v", "impact_phase"]
    write_rows(path, head, rows())


def curves(dataset: xr.Dataset, axes: Sequence[str] = (), at: Cut | None = None) -> xr.Dataset:
    """Follow the bifurcations between the periodic motions of a map; arguments as `find_curves`.

    One axis alone is refused: a curve has two parameters.

    Returns
    -------
    Dataset
        Along ``point``, curve after curve: the two axes and ``curve`` (its number). Along
        ``number``: ``kind``, ``m`` and ``q`` of each curve. Along ``special``: ``special_kind``,
        ``special_curve`` and ``special_values`` (``special``, 2). The attributes ``changes`` and
        ``explained`` count the changes between periodic classes, and those with a curve within one
        cell; ``summary`` says why the others have none.
    """
    chosen = [axes] if isinstance(axes, str) else axes
    map_axes(dataset, chosen)
    if len(chosen) == 1:
        raise Refused(f"curves are over two swept axes, not {chosen[0]} alone")
    return _curves_dataset(find_curves(dataset, chosen, at))


def _curves_dataset(search: CurveSearch) -> xr.Dataset:
    """Return what was found as `curves` does."""
    numbers, m, q, special = _numbered(search.curves)
    values = np.concatenate([np.empty((0, 2)), *(curve.values for curve in search.curves)])
    at = np.array([point.values for _, point in special]).reshape(-1, 2)
    data = {
        "curve": numbers,
        "kind": ("number", np.array([curve.kind for curve in search.curves], "U11")),
        "m": m,
        "q": q,
        "special_kind": ("special", np.array([point.kind for _, point in special], "U11")),
        "special_curve": ("special", np.array([number for number, _ in special], int)),
        "special_values": (("special", "parameter"), at),
    }
    coordinates = {axis: ("point", values[:, i]) for i, axis in enumerate(search.axes)}
    attributes = {
        "changes": search.changes,
        "explained": search.explained,
        "summary": "\n".join(search.summary()),
    }
    return xr.Dataset(data, coordinates, attributes)


def write_curves(path: Path, search: CurveSearch) -> None:
    """Write the points of curves, and then of each its special points, to a CSV file."""

    def rows() -> Iterator[list[object]]:
        for number, curve in enumerate(search.curves):
            head = [number, curve.kind, curve.m, curve.q]
            yield from ([*head, *values, ""] for values in curve.values.tolist())
            yield from ([*head, *p.values.tolist(), p.kind] for p in curve.special)

    write_rows(path, ["curve", "kind", "m", "q", *search.axes, "special"], rows())
