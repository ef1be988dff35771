"""Lists attractors and measures of their integrity: `AttractorRow`s, text, columns of a CSV."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import groupby
from operator import attrgetter
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from sweeps.attractor.attractors import ATTRACTOR_COLUMNS, SETS, GridIndex
from sweeps.attractor.tracking import EXTENSIONS, MOST_CONTINUED, MOST_TRACKED
from sweeps.grid import TABLE
from sweeps.opened.export import headed
from sweeps.opened.motions import run_on
from sweeps.opened.opened_sweep import START_AXES, OpenedSweep, Selection
from sweeps.store.variables import DIRECTION
from sweeps.text import shown_count, shown_range, table
from vibroimpact.points.regimes import Label, Regime, rest_of
from vibroimpact.points.stages import RunSpec

if TYPE_CHECKING:
    import pandas as pd

#: Most impact speeds that are written out; of more, only the slowest and the fastest are.
_MOST_SPEEDS = 4
#: Most classes of one attractor that are listed.
_MOST_CLASSES = 3
#: The distances among the measures, with the flags that the edge of the window decided them.
_EDGES = {"integrity_factor": "factor_at_edge", "local_integrity": "local_at_edge"}


class AttractorRow(NamedTuple):
    """An attractor at a parameter point, numbered and classed as by `sweeps.attractors`."""

    parameters: Mapping[str, float]  # the swept parameters there
    number: int
    regime: Regime
    m: int
    q: int
    fraction: float
    speeds: np.ndarray  # before each impact of a repetition, increasing [length/time]; shape (q,)
    states: np.ndarray  # x and v at the section, shape (m, 2)
    point: int = -1  # index in C order of a point of the file on the attractor, -1 for none
    measures: Mapping[str, Any] = MappingProxyType({})  # of `sweeps.integrity` and `sweeps.knocks`

    @property
    def name(self) -> str:
        """The class m/q, or the regime, with the periods of one with rest."""
        known = self.regime is not Regime.UNKNOWN
        return str(Label(self.regime, self.m, self.q)) if known else self.regime.word

    @property
    def shown_number(self) -> str:
        """The number, or a dash for motions that are not counted as an attractor."""
        return "-" if self.regime is Regime.UNKNOWN else str(self.number)

    @property
    def shown_speeds(self) -> str:
        """The impact speeds with four digits."""
        speeds = self.speeds if len(self.speeds) <= _MOST_SPEEDS else self.speeds[[0, -1]]
        joint = ", " if len(self.speeds) <= _MOST_SPEEDS else " to "
        return joint.join(f"{speed:.4g}" for speed in speeds)


def parameter_axes(sweep: OpenedSweep) -> tuple[str, ...]:
    """Return the names of the swept axes, or of the columns of a table, that are not starts."""
    names = sweep.columns or sweep.grid
    return tuple(
        name for name in names if name in sweep.nomenclature.parameters and name not in START_AXES
    )


def starts_at(sweep: OpenedSweep, at: Selection) -> OpenedSweep:
    """Fix parameters and the phase of the starts nearest to `at`; keep all other starts there."""
    return sweep.isel(sweep.indices(at, free=("x0", "v0", DIRECTION, TABLE)))


def attractor_rows(sweep: OpenedSweep, result: xr.Dataset) -> list[AttractorRow]:
    """List the attractors in the result of an analysis, by parameter point, most frequent first."""
    axes = [str(name) for name in result["attractors"].dims]
    columns = result[[name for name in result if "coexisting" in result[name].dims]]
    frame = columns.to_dataframe(dim_order=[*axes, "coexisting"])[list(columns)]
    exists = frame["number"].values >= 0
    frame = frame[exists]
    index = GridIndex.of(sweep)
    file = np.empty((index.parameter.max() + 1, index.start.max() + 1), np.int64)
    file[index.parameter, index.start] = np.arange(len(index.start))
    indices = file[np.flatnonzero(exists) // result.sizes["coexisting"], frame["representative"]]
    points = sweep.points[indices]
    swept = sweep.values(parameter_axes(sweep))
    points["x0"], points["v0"] = frame["section_x"], frame["section_v"]
    m = np.where(frame["motion"] == Regime.PERIODIC, frame["m"], 0)
    orbits = orbits_of(sweep.spec, points, m, frame["q"].values)
    added = [name for name in map(str, columns) if name not in ATTRACTOR_COLUMNS]
    measures = {name: frame[name].tolist() for name in added}
    return [
        AttractorRow(
            {name: values.flat[indices[i]].item() for name, values in swept.items()},
            row.number,
            Regime(row.motion),
            row.m,
            row.q,
            row.fraction,
            *orbits[i],
            int(indices[i]),
            {name: values[i] for name, values in measures.items()},
        )
        for i, row in enumerate(frame.itertuples())
    ]


def orbits_of(
    spec: RunSpec, points: np.ndarray, m: np.ndarray, q: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return speeds before the impacts, increasing, and section states of periodic motions.

    They start from the states of `points` at the section. Motions of m = 0 have neither.
    """
    orbits = [(np.empty(0), np.empty((0, 2)))] * len(points)
    for periods, impacts in np.unique(np.stack([m, q], axis=1)[m > 0], axis=0).tolist():
        at = np.flatnonzero((m == periods) & (q == impacts))
        sections, hits = run_on(spec, points[at], periods, impacts)
        for index, speeds, states in zip(at.tolist(), hits[:, :, 1], sections, strict=True):
            orbits[index] = np.sort(speeds[np.isfinite(speeds)]), states
    return orbits


def attractor_frame(attractors: Sequence[AttractorRow]) -> pd.DataFrame:
    """Return the attractors as a table, with impact speeds separated by spaces."""
    import pandas as pd

    columns = ["attractor", "motion", "m", "q", "fraction", "impact_v"]
    records = [
        {
            **row.parameters,
            "attractor": row.number,
            "motion": row.regime.word,
            "m": row.m,
            "q": row.q,
            "fraction": row.fraction,
            "impact_v": " ".join(map(repr, row.speeds.tolist())),
            **row.measures,
        }
        for row in attractors
    ]
    return pd.DataFrame(records, columns=None if records else columns)


def attractor_report(
    sweep: OpenedSweep, result: xr.Dataset, attractors: Sequence[AttractorRow]
) -> str:
    """Write the attractors as a table, those of several parameter points once if not measured."""
    if result["attractors"].ndim and "integrity_factor" not in result:
        lines = _over_parameters(sweep, result, attractors)
    else:
        lines = [_row_by_row(sweep, result, attractors)]
    if missing := int((result["attractor"] < 0).sum()):
        points = shown_count(result["attractor"].size, "point")
        lines.append(f"{missing:,} of {points} without a result, left out")
    if followed := float(result["followed"].mean()):
        lines.append(
            f"{100.0 * followed:.1f} % of the starts were followed beyond their record, which "
            "does not show their attractor"
        )
    if left_out := result.attrs["left_out"]:
        lines.append(
            f"chaos and unknown starts were not followed to the end, but all together for at most "
            f"{MOST_CONTINUED:,} forcing periods: {left_out} of {EXTENSIONS} extensions left out"
        )
    unknown = result["fraction"].where(result["motion"] == Regime.UNKNOWN).sum("coexisting")
    if unknown.any():
        share = 100.0 * float(unknown.mean())
        lines.append(f"{share:.1f} % of the starts are unknown, which is no attractor")
    if "integrity_factor" in result:
        root = ", p = sqrt(stiffness / mass)" if sweep.in_rig else ""
        lines.append(
            f"distances: sqrt(dx^2 + (dv / p)^2){root}, at omega t = {sweep.spec.phase:g}, right "
            "to one spacing of the starts; >=: the window's edge decided"
        )
    return "\n".join(lines)


def _row_by_row(sweep: OpenedSweep, result: xr.Dataset, attractors: Sequence[AttractorRow]) -> str:
    """Write each attractor at each parameter point, with its measures."""
    axes = parameter_axes(sweep) if result["attractors"].ndim else ()
    measured = [name for name in (*_EDGES, "knock_harmful") if name in result]
    heads = {"knock_harmful": "least knock"}
    head = [
        *(headed(axis, sweep[axis]) for axis in axes),
        "attractor",
        "class",
        headed("speeds before the impacts", result["section_v"]),
        "share of the starts",
        *(headed(heads.get(name, name.replace("_", " ")), result[name]) for name in measured),
    ]
    body = []
    for row in attractors:
        cells = [f"{row.parameters[axis]:.6g}" for axis in axes]
        cells += [row.shown_number, row.name, row.shown_speeds or "-", f"{row.fraction:.4f}"]
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
    sweep: OpenedSweep, result: xr.Dataset, attractors: Sequence[AttractorRow]
) -> list[str]:
    """Write each attractor once, with the range of its parameters and its share of the starts."""
    counted, axes = result["attractors"], parameter_axes(sweep)
    heads = [headed(axis, sweep[axis]) for axis in axes]
    head = ["attractor", "class", *heads, "parameter points", "share of the starts there"]
    number = attrgetter("number")
    by_number = groupby(sorted(attractors, key=number), number)
    body = []
    for _, appearances in by_number:
        rows = list(appearances)
        ranges = [shown_range([row.parameters[name] for row in rows]) for name in axes]
        share = float(np.mean([row.fraction for row in rows]))
        counts = f"{len(rows):,}", f"{share:.4f}"
        body.append([rows[0].shown_number, classes_text(rows), *ranges, *counts])
    lines = [table([head, *body])]
    starts, where = result["attractor"].size, "in all"
    if SETS not in counted.dims:
        starts, where = starts // counted.size, "at each"
    for count, times in zip(*np.unique(counted.values, return_counts=True), strict=True):
        count_text = shown_count(count, "attractor")
        lines.append(f"{count_text} at {times:,} of {shown_count(counted.size, 'parameter point')}")
    untracked = int(((result["motion"] == Regime.PERIODIC).sum("coexisting") > MOST_TRACKED).sum())
    if untracked and SETS not in counted.dims:
        lines.append(
            f"at {shown_count(untracked, 'parameter point')} more than {MOST_TRACKED} attractors "
            "are periodic: none of these has the number of an attractor at another point"
        )
    return [*lines, f"{shown_count(starts, 'start')} {where}"]


def classes_text(appearances: Sequence[AttractorRow]) -> str:
    """List the classes of one attractor along the axes: 1/1, 2/2 or rest, 1, 3 periods."""
    if appearances[0].regime is Regime.REST:
        return rest_of(sorted(row.m for row in appearances))
    names = {row.name: None for row in sorted(appearances, key=lambda row: (row.m, row.q))}
    return ", ".join(list(names)[:_MOST_CLASSES]) + ", ..." * (len(names) > _MOST_CLASSES)
