"""Exact branches as a dataset, as rows of a CSV file, and as a list of their bifurcations."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from sweeps.analysis.exact_branches import grow, lines_of, summary
from sweeps.analysis.selection import Cut, swept_axes
from sweeps.messages import table
from vibroimpact.orbits.trees import Tree


def as_dataset(tree: Tree) -> xr.Dataset:
    """Return a tree as `branches` does."""
    all_ = tree.branches
    sizes = [len(branch.values) for branch in all_]
    width = max((branch.q for branch in all_), default=0)
    special = [(number, point) for number, branch in enumerate(all_) for point in branch.special]
    parameter = tree.parameter
    data = {
        "branch": ("point", np.repeat(np.arange(len(all_)), sizes)),
        "stable": (
            "point",
            np.concatenate([branch.stable for branch in all_] or [np.empty(0, bool)]),
        ),
        "impact_phase": (("point", "impact"), _padded([branch.phases for branch in all_], width)),
        "impact_v": (("point", "impact"), _padded([branch.speeds for branch in all_], width)),
        "m": ("number", np.array([branch.m for branch in all_], int)),
        "q": ("number", np.array([branch.q for branch in all_], int)),
        "kind": ("special", np.array([point.kind for _, point in special], "U11")),
        "special_value": ("special", np.array([point.value for _, point in special], float)),
        "special_branch": ("special", np.array([number for number, _ in special], int)),
        "special_m": ("special", np.array([point.orbit.m for _, point in special], int)),
        "special_q": ("special", np.array([point.orbit.q for _, point in special], int)),
    }
    values = np.concatenate([branch.values for branch in all_] or [np.empty(0)])
    return xr.Dataset(
        data, {parameter: ("point", values)}, {"given_up": "; ".join(summary(tree)[1:])}
    )


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


def write_csv(path: Path, dataset: xr.Dataset) -> None:
    """Write the points of branches, and then their special points, which have a kind.

    Parameters
    ----------
    path : Path
    dataset : Dataset
        From `as_dataset`. Speeds and phases of the impacts are separated by spaces.
    """
    (parameter,) = dataset.coords
    m, q = dataset["m"].values.tolist(), dataset["q"].values.tolist()
    columns = [dataset[name].values.tolist() for name in ("branch", parameter, "stable")]
    impacts = [dataset[name].values for name in ("impact_v", "impact_phase")]
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(
            ["branch", "m", "q", parameter, "stable", "kind", "impact_v", "impact_phase"]
        )
        for i, (number, value, stable) in enumerate(zip(*columns, strict=True)):
            numbers = [" ".join(map(repr, rows[i, : q[number]].tolist())) for rows in impacts]
            writer.writerow([number, m[number], q[number], value, int(stable), "", *numbers])
        names = ("branch", "m", "q", "value")
        special = [dataset[f"special_{name}"].values.tolist() for name in names]
        for *row, kind in zip(*special, dataset["kind"].values.tolist(), strict=True):
            writer.writerow([*row, "", kind, "", ""])
