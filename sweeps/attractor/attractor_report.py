"""The attractors of a sweep as text, with their measures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import groupby
from operator import attrgetter
from typing import Any

import numpy as np
import xarray as xr

from sweeps.attractor.attractor_table import AttractorRow, parameter_axes
from sweeps.attractor.tracking import MOST_TRACKED
from sweeps.opened.dataset import config_of, headed, nomenclature_of
from sweeps.opened.grouping import SETS
from sweeps.text import shown_count, shown_range, table
from vibroimpact.points.regimes import Regime

#: Most impact speeds that are written out; of more, only the slowest and the fastest are.
_MOST_SPEEDS = 4
#: The distances among the measures, with the flags that the edge of the window decided them.
_EDGES = {"integrity_factor": "factor_at_edge", "local_integrity": "local_at_edge"}


def shown_speeds(row: AttractorRow) -> str:
    """Write the impact speeds of a row with four digits."""
    speeds = row.speeds if len(row.speeds) <= _MOST_SPEEDS else row.speeds[[0, -1]]
    joint = ", " if len(row.speeds) <= _MOST_SPEEDS else " to "
    return joint.join(f"{speed:.4g}" for speed in speeds)


def attractor_report(
    dataset: xr.Dataset, result: xr.Dataset, attractors: Sequence[AttractorRow]
) -> str:
    """Write the attractors as a table, those of several parameter points once if not measured."""
    if result["attractors"].ndim and "integrity_factor" not in result:
        lines = _over_parameters(dataset, result, attractors)
    else:
        lines = [_row_by_row(dataset, result, attractors)]
    missing = int((result["attractor"] < 0).sum())
    if missing:
        lines.append(
            f"{missing:,} of {result['attractor'].size:,} points without a result, left out"
        )
    followed = float(result["followed"].mean())
    if followed:
        lines.append(
            f"{100.0 * followed:.1f} % of the starts were followed beyond their record, which "
            "does not show their attractor"
        )
    unknown = result["fraction"].where(result["motion"] == Regime.UNKNOWN).sum("coexisting")
    if unknown.any():
        share = 100.0 * float(unknown.mean())
        lines.append(f"{share:.1f} % of the starts are unknown, which is no attractor")
    if "integrity_factor" in result:
        root = "" if "p" in nomenclature_of(dataset).parameters else ", p = sqrt(stiffness / mass)"
        lines.append(
            f"distances: sqrt(dx^2 + (dv / p)^2){root}, at omega t = "
            f"{config_of(dataset).start.phase:g}; >=: the window's edge decided"
        )
    return "\n".join(lines)


def _row_by_row(dataset: xr.Dataset, result: xr.Dataset, attractors: Sequence[AttractorRow]) -> str:
    """Write each attractor at each parameter point, with its measures."""
    axes = parameter_axes(dataset) if result["attractors"].ndim else ()
    measured = [name for name in (*_EDGES, "knock_harmful") if name in result]
    heads = {"knock_harmful": "least knock"}
    head = [
        *(headed(axis, dataset[axis]) for axis in axes),
        "attractor",
        "class",
        headed("speeds before the impacts", result["section_v"]),
        "share of the starts",
        *(headed(heads.get(name, name.replace("_", " ")), result[name]) for name in measured),
    ]
    body = []
    for row in attractors:
        cells = [f"{row.parameters[axis]:.6g}" for axis in axes]
        cells += [row.shown_number, row.name, shown_speeds(row) or "-", f"{row.fraction:.4f}"]
        body.append(cells + [_measure(row.measures, name) for name in measured])
    return table([head, *body])


def _measure(measures: Mapping[str, Any], name: str) -> str:
    """Write a measure of an attractor: a distance, or the least knock."""
    value = measures[name]
    if math.isnan(value):  # of a motion that is not counted, or has no knock
        return "-"
    if name in _EDGES:
        return f"{'>= ' if measures[_EDGES[name]] else ''}{value:.4g}"
    if math.isinf(value):
        return "none up to the height of the window"
    ends = measures["knock_ends"]
    to = f"to {ends}" if ends >= 0 else "to an unknown attractor"
    notes = "" if measures["knock_certified"] else ", not certified"
    notes += ", fractal: the least tried" if measures["knock_fractal"] else ""
    return f"{value:+.9g} at omega t = {measures['knock_phase']:.4f}, {to}{notes}"


def _over_parameters(
    dataset: xr.Dataset, result: xr.Dataset, attractors: Sequence[AttractorRow]
) -> list[str]:
    """Write each attractor once, with the range of its parameters and its share of the starts."""
    counted, axes = result["attractors"], parameter_axes(dataset)
    heads = [headed(axis, dataset[axis]) for axis in axes]
    head = ["attractor", "class", *heads, "parameter points", "share of the starts there"]
    number = attrgetter("number")
    by_number = groupby(sorted(attractors, key=number), number)
    lines = [table([head, *(_summary(list(appearances), axes) for _, appearances in by_number)])]
    starts, where = result["attractor"].size, "in all"
    if SETS not in counted.dims:
        starts, where = starts // counted.size, "at each"
    for count, times in zip(*np.unique(counted.values, return_counts=True), strict=True):
        found = shown_count(count, "attractor")
        lines.append(f"{found} at {times:,} of {counted.size:,} parameter points")
    untracked = int(((result["m"] > 0).sum("coexisting") > MOST_TRACKED).sum())
    if untracked and SETS not in counted.dims:
        lines.append(
            f"at {untracked:,} parameter points more than {MOST_TRACKED} attractors are periodic: "
            "none of these has the number of an attractor at another point"
        )
    return [*lines, f"{shown_count(starts, 'start')} {where}"]


def classes_text(appearances: Sequence[AttractorRow], most: int = 3) -> str:
    """List the classes m/q of one attractor along the axes, for example 1/1, 2/2."""
    names = {row.name: None for row in sorted(appearances, key=lambda row: (row.m, row.q))}
    more = ", ..." if len(names) > most else ""
    return ", ".join(list(names)[:most]) + more


def _summary(appearances: Sequence[AttractorRow], axes: Sequence[str]) -> list[str]:
    """Write one attractor, over all parameter points at which it is found, as a row."""
    ranges = [shown_range([row.parameters[name] for row in appearances]) for name in axes]
    mean = float(np.mean([row.fraction for row in appearances]))
    number = appearances[0].shown_number
    return [number, classes_text(appearances), *ranges, f"{len(appearances):,}", f"{mean:.4f}"]
