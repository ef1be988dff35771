"""The distinct attractors of a sweep: which exist at a point, and which starts reach each.

A parameter point is a point of the grid without its starts, or a set of parameters in a table. Each
start there is on one of its attractors, according to its regime
(`sweeps.analysis.regimes`):

- periodic motions are the same attractor if they have the same number m of forcing periods and
  the same section states within a tolerance, wherever in the cycle each record ends. Impacts need
  not be compared, since a state at the section determines all that follows. A record that repeats
  after m periods, but already within the tolerance after a divisor of m, as beside a flip, is one
  of so many periods;
- motions with rest are one attractor: when the force releases the mass from the stop, at a phase
  that depends on the parameters only, nothing is left of the past. Where a rest leads to chaos, the
  chaos is the same attractor;
- chaotic motions are one attractor, and unbounded ones. Whether two chaotic motions are on one
  attractor cannot be seen in a finite record, so the number of attractors is a lower bound;
- motions that have not settled in their record, and chaos, which may be a transient, are followed
  on (`sweeps.analysis.settle`); those that still have not settled are listed as unsettled, and
  are not attractors;
- failed points and those not computed yet are on none.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from sweeps.analysis.grouping import SETS, GridIndex, Groups
from sweeps.analysis.regimes import Regime
from sweeps.analysis.section_distance import TOLERANCE
from sweeps.analysis.selection import config_of
from sweeps.analysis.settle import EXTENSIONS, Outcomes
from sweeps.analysis.tracking import PeriodicAttractors, exact_links, track
from sweeps.errors import Refused

#: Regimes that count as an attractor; whether the others stay as they are is not known.
COUNTED = (Regime.PERIODIC, Regime.REST, Regime.CHAOTIC)


def attractors(
    dataset: xr.Dataset, tolerance: float = TOLERANCE, extensions: int = EXTENSIONS
) -> xr.Dataset:
    """Find the distinct attractors at every parameter point.

    Parameters
    ----------
    dataset : Dataset
        An opened sweep, or a cut through one, with ``period`` and the section; ``lyapunov`` is
        used if the sweep has it.
    tolerance : float
        Within which section states, x and v / omega, are the same; relative to the greatest of the
        cycle.
    extensions : int
        How often motions that have not settled are followed four times as long; 0 goes by the
        records alone.

    Returns
    -------
    Dataset
        ``attractor``, in the shape of ``status``: the number of the attractor, -1 for none. A
        number is the same attractor along the axes (`sweeps.analysis.tracking`), not among the
        sets of a table; the most
        frequent periodic one has 0, and those that are not periodic have the last.
        ``followed``, in the same shape: whether the motion had not settled in its record.
        ``attractors`` (parameters...): how many of ``COUNTED`` were found, a lower bound.
        And for each of a point's, in the dimension ``coexisting`` from the most frequent on, -1 or
        NaN where there are no more: ``number``; ``fraction`` of the starts with a result;
        ``motion``, a `sweeps.analysis.regimes.Regime`; ``m`` forcing periods and ``q`` impacts per
        repetition of a periodic one, otherwise 0;
        ``section_x``, ``section_v``: a state on it; ``representative``: the number of the start it
        is from, in C order over the axes of starts in the order of the file; ``settled``: whether
        the record of that start shows the attractor.

    Raises
    ------
    Refused
        If the file has no period or section.
    """
    for name in ("period", "poincare_x", "poincare_v"):
        if name not in dataset:
            raise Refused(
                f"the file has no {name}, by which attractors are told apart: run the sweep again "
                "with record.diagnostics: [period]"
            )
    points = GridIndex.of(dataset)
    groups, ends = Groups(points, tolerance), Outcomes(dataset, points)
    groups.add_records(dataset, ends.m)
    ends.follow_on(groups.last, extensions)
    groups.add_cycles(ends.cycles)
    periodic = groups.join()
    heads, of_point = _members(points, ends.regime, groups.representative)
    regime, parameter = ends.regime[heads], points.parameter[heads]
    members = np.bincount(of_point[of_point >= 0], minlength=len(heads))
    fraction = members / np.bincount(parameter, members, points.count)[parameter]
    m, number = np.zeros(len(heads), np.int64), np.empty(len(heads), np.int64)
    own = np.searchsorted(heads, periodic.at)
    m[own] = periodic.m
    number[own] = _numbers(dataset, points, periodic, fraction[own], groups.last)
    others = np.flatnonzero(regime != Regime.PERIODIC)
    first = int(number[own].max(initial=-1)) + 1
    number[others] = first + np.unique(regime[others], return_inverse=True)[1]
    shown = _settled_members(of_point, heads, ends)
    x, v = groups.last[shown].T
    columns: dict[str, tuple[np.ndarray, str]] = {
        "number": (number, "number of the attractor"),
        "fraction": (fraction, "fraction of the starts"),
        "motion": (regime, "kind of motion"),
        "m": (m, "forcing periods per repetition, 0: not periodic"),
        "q": (_impacts(of_point, m, ends), "impacts per repetition, 0: not periodic"),
        "settled": (~ends.followed[shown], "whether its record shows it"),
        "section_x": (x, "displacement at the section"),
        "section_v": (v, "velocity at the section"),
        "representative": (points.start[shown], "number of the start that stands for it"),
    }
    order = np.lexsort((number, -members, parameter))
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order)) - np.searchsorted(parameter[order], parameter[order])
    data: dict[str, Any] = {}
    for name, (values, meaning) in columns.items():
        missing = {"f": np.nan, "b": False}.get(values.dtype.kind, -1)
        grid = np.full((points.count, int(rank.max(initial=0)) + 1), missing, values.dtype)
        grid[parameter, rank] = values
        shaped = grid.reshape(*points.shape, -1)
        data[name] = ((*points.parameters, "coexisting"), shaped, {"long_name": meaning})
    data["motion"][2]["flag_values"] = np.array(list(Regime))
    data["motion"][2]["flag_meanings"] = " ".join(regime.name.lower() for regime in Regime)
    counted = np.bincount(parameter[np.isin(regime, COUNTED)], minlength=points.count)
    for name, array, meaning in (
        ("attractor", np.append(number, -1)[of_point], "number of the attractor, -1: none"),
        ("followed", ends.followed, "whether the motion was followed on, since it had not settled"),
    ):
        status = dataset["status"]
        data[name] = (status.dims, array.reshape(status.shape), {"long_name": meaning})
    about = {"long_name": "distinct attractors found"}
    data["attractors"] = (points.parameters, counted.reshape(points.shape), about)
    return xr.Dataset(data, {name: dataset[name] for name in dataset["status"].coords})


def _members(
    points: GridIndex, regime: np.ndarray, representative: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return a point on each attractor, and the attractor of each point, -1 for none.

    The `representative` points are those of the periodic motions; the others of a regime are one.
    """
    representative = representative.copy()
    others = np.flatnonzero((representative < 0) & (regime > Regime.FAILED))
    groups = points.parameter[others] * len(Regime) + regime[others]
    _, first, inverse = np.unique(groups, return_index=True, return_inverse=True)
    representative[others] = others[first][inverse]
    heads = np.unique(representative[representative >= 0])
    return heads, np.where(representative < 0, -1, np.searchsorted(heads, representative))


def _settled_members(of_point: np.ndarray, heads: np.ndarray, ends: Outcomes) -> np.ndarray:
    """Return a point on each attractor, if possible one whose record shows the attractor."""
    shown = np.flatnonzero((of_point >= 0) & ~ends.followed)
    attractor, first = np.unique(of_point[shown], return_index=True)
    replaced = ends.followed[heads[attractor]]
    heads = heads.copy()
    heads[attractor[replaced]] = shown[first[replaced]]
    return heads


def _numbers(
    dataset: xr.Dataset,
    points: GridIndex,
    periodic: PeriodicAttractors,
    fraction: np.ndarray,
    last: np.ndarray,
) -> np.ndarray:
    """Return the number of each periodic attractor, by the share of the starts along the axes."""
    links = None
    shape = () if SETS in points.parameters else points.shape  # sets have no neighbours
    config = config_of(dataset)
    if shape and config.method.impact == "exact":
        axis = points.parameters[int(np.argmax(shape))]
        states = points.at_states(periodic.at, *last[periodic.at].T)
        links = exact_links(axis, config.record.phase, states, periodic.m)
    _, chain = np.unique(track(shape, periodic, links), return_inverse=True)
    shares = np.bincount(chain, fraction)
    return np.argsort(np.argsort(-shares, kind="stable"))[chain]


def _impacts(of_point: np.ndarray, m: np.ndarray, ends: Outcomes) -> np.ndarray:
    """Return the impacts per repetition that most points on an attractor have."""
    on = np.flatnonzero(of_point >= 0)
    attractor = of_point[on]
    counted = np.rint(ends.q[on] * m[attractor] / np.maximum(ends.m[on], 1))
    base = int(counted.max(initial=0.0)) + 1
    pairs, times = np.unique(attractor * base + counted.astype(np.int64), return_counts=True)
    most = np.zeros(len(m), np.int64)
    pairs = pairs[np.argsort(times, kind="stable")]
    most[pairs // base] = pairs % base  # the last, most frequent one stays
    return most
