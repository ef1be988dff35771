"""The attractors of a sweep as rows: for a report, a CSV file, and the legends of pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from sweeps.config.sweep import SweepConfig
from sweeps.errors import Refused
from sweeps.opened.cuts import Selection, cut_at, swept_axes
from sweeps.opened.dataset import config_of, nomenclature_of
from sweeps.opened.grouping import START_AXES, GridIndex, parameter_at_points, points_of
from sweeps.opened.motions import different, run_on
from sweeps.store import columns_of
from sweeps.text import choice_of
from vibroimpact.points.regimes import Regime

if TYPE_CHECKING:
    import pandas as pd

#: The variables of `sweeps.attractors` that are fields of a `AttractorRow`, or only lead to one.
_NO_MEASURES = {"number", "fraction", "motion", "m", "q", "from_record", "representative"}
_NO_MEASURES |= {"section_x", "section_v"}


class AttractorRow(NamedTuple):
    """One attractor at one parameter point.

    Attributes
    ----------
    parameters : mapping of str to float
        The swept parameters at the parameter point.
    number, m, q, regime, fraction
        As in the dataset of `sweeps.attractors`, where the regime is called ``motion``.
    speeds : ndarray, shape (q,)
        The speed before each impact of a repetition, increasing [length/time].
    states : ndarray, shape (m, 2)
        x and v at the section.
    point : int
        Index in C order of a point of the file on the attractor, -1 for none.
    measures : mapping of str to number
        The variables that `sweeps.integrity` and `sweeps.knocks` add, if any.
    """

    parameters: Mapping[str, float]
    number: int
    regime: Regime
    m: int
    q: int
    fraction: float
    speeds: np.ndarray
    states: np.ndarray
    point: int = -1
    measures: Mapping[str, Any] = MappingProxyType({})

    @property
    def name(self) -> str:
        """The class m/q, or the regime."""
        return f"{self.m}/{self.q}" if self.m else self.regime.word

    @property
    def shown_number(self) -> str:
        """The number, or a dash for motions that are not counted as an attractor."""
        return "-" if self.regime is Regime.UNKNOWN else str(self.number)


def parameter_axes(dataset: xr.Dataset) -> tuple[str, ...]:
    """Return the names of the swept axes, or of the columns of a table, that are not starts."""
    known = nomenclature_of(dataset).parameters
    names = [name for name in columns_of(dataset) if name in known] or swept_axes(dataset)
    return tuple(name for name in names if name not in START_AXES)


def cut(dataset: xr.Dataset, at: Selection) -> xr.Dataset:
    """Fix parameters at the grid values nearest to `at` and keep all starts; refuse other names."""
    axes = parameter_axes(dataset)
    for name in at:
        if name not in axes:
            raise Refused(f"{name} cannot be fixed here; {choice_of(axes)}")
    free = [name for name in map(str, dataset["status"].dims) if name not in at]
    return cut_at(dataset, at, free=free)


def attractor_rows(dataset: xr.Dataset, result: xr.Dataset) -> list[AttractorRow]:
    """List the attractors in a result, by parameter point, most frequent first.

    It is the result of `sweeps.attractors`, `sweeps.integrity` or `sweeps.knocks` for the dataset.
    """
    axes = [str(name) for name in result["attractors"].dims]
    columns = result[[name for name in result if "coexisting" in result[name].dims]]
    frame = columns.to_dataframe(dim_order=[*axes, "coexisting"])[list(columns)]
    is_there = frame["number"].values >= 0
    frame = frame[is_there]
    index = GridIndex.of(dataset)
    file = np.empty((index.count, int(index.start.max()) + 1), np.int64)
    file[index.parameter, index.start] = np.arange(len(index.start))
    place = file[np.flatnonzero(is_there) // result.sizes["coexisting"], frame["representative"]]
    points = points_of(dataset, place)
    swept = {name: parameter_at_points(dataset, name)[place] for name in parameter_axes(dataset)}
    points["x0"], points["v0"] = frame["section_x"], frame["section_v"]
    orbits = orbits_of(config_of(dataset), points, frame["m"].values, frame["q"].values)
    measures = {
        name: frame[name].tolist() for name in map(str, columns) if name not in _NO_MEASURES
    }
    return [
        AttractorRow(
            {name: values[i].item() for name, values in swept.items()},
            row.number,
            Regime(row.motion),
            row.m,
            row.q,
            row.fraction,
            *orbits[i],
            int(place[i]),
            {name: values[i] for name, values in measures.items()},
        )
        for i, row in enumerate(frame.itertuples())
    ]


def orbits_of(
    config: SweepConfig, points: np.ndarray, m: np.ndarray, q: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return speeds before the impacts, increasing, and section states of periodic motions.

    They start from the states of `points` at the section. Motions of m = 0 have neither.
    """
    orbits = [(np.empty(0), np.empty((0, 2)))] * len(points)
    rows, of_row = different([m, q])
    for i, (periods, impacts) in enumerate(zip(m[rows].tolist(), q[rows].tolist(), strict=True)):
        if periods:
            at = np.flatnonzero(of_row == i)
            sections, hits = run_on(config, points[at], periods, impacts)
            speeds = np.sort(hits[:, :, 1])
            for place, *orbit in zip(at.tolist(), speeds, sections, strict=True):
                orbits[place] = orbit[0][np.isfinite(orbit[0])], orbit[1]
    return orbits


def attractor_records(attractors: Sequence[AttractorRow]) -> list[dict[str, Any]]:
    """Return what a table has of each attractor, by the names of its columns."""
    return [
        {
            **row.parameters,
            "attractor": row.number,
            "motion": row.regime.word,
            "m": row.m,
            "q": row.q,
            "fraction": row.fraction,
            "impact_v": row.speeds.tolist(),
            **row.measures,
        }
        for row in attractors
    ]


def attractor_frame(attractors: Sequence[AttractorRow]) -> pd.DataFrame:
    """Return the attractors as a table for a CSV file, with impact speeds separated by spaces."""
    import pandas as pd

    columns = ["attractor", "motion", "m", "q", "fraction", "impact_v"]
    records = attractor_records(attractors)
    for record in records:
        record["impact_v"] = " ".join(map(repr, record["impact_v"]))
    return pd.DataFrame(records, columns=None if records else columns)
