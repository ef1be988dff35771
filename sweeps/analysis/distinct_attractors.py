"""The distinct attractors of a sweep: which exist at a point, and which starts reach each.

A parameter point is a point of the grid without its starts. Each start there is on one of its
attractors, according to its kind of motion (`sweeps.analysis.motion`):

- periodic motions are the same attractor if they have the same number m of forcing periods and
  the same section states within a tolerance, wherever in the cycle each record ends. Impacts need
  not be compared, since a state at the section determines all that follows. A record that repeats
  after m periods, but already within the tolerance after a divisor of m, as beside a flip, is one
  of so many periods;
- motions with rest are one attractor: when the force releases the mass from the stop, at a phase
  that depends on the parameters only, nothing is left of the past;
- chaotic motions are one attractor, and unbounded ones. Whether two chaotic motions are on one
  attractor cannot be seen in a finite record, so the number of attractors is a lower bound;
- motions that have not settled in their record are followed on (`sweeps.analysis.unsettled`); what
  has not settled then is listed as such, and is no attractor;
- failed points and those not computed yet are on none.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from sweeps.analysis.exact_links import ExactLinks
from sweeps.analysis.grouping import Groups, PointNumbers, group_periodic
from sweeps.analysis.motion import Motion
from sweeps.analysis.selection import Setting
from sweeps.analysis.tracking import PeriodicAttractors, track
from sweeps.analysis.unsettled import EXTENSIONS, Outcomes, outcomes
from sweeps.messages import Refused
from vibroimpact.orbits.cycles import TOLERANCE

#: Motions that count as an attractor; of the others it is not known whether they stay.
COUNTED_MOTIONS = (Motion.PERIODIC, Motion.REST, Motion.CHAOTIC)


def attractors(
    dataset: xr.Dataset, tolerance: float = TOLERANCE, extensions: int = EXTENSIONS
) -> xr.Dataset:
    """Find the distinct attractors at every parameter point.

    Parameters
    ----------
    dataset : Dataset
        An opened sweep, or a cut through one, with ``period`` and the section; ``lyapunov`` is
        used where there.
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
        number is the same attractor along the axes (`sweeps.analysis.tracking`); the most
        frequent periodic one has 0, and those that are not periodic have the last.
        ``followed``, in the same shape: whether the motion had not settled in its record.
        ``attractors`` (parameters...): how many of ``COUNTED_MOTIONS`` were found, a lower bound.
        And for each of a point's, in the dimension ``coexisting`` from the most frequent on, -1 or
        NaN where there are no more: ``number``; ``fraction`` of the starts with a result;
        ``motion``, a `sweeps.analysis.motion.Motion`; ``m`` forcing periods and ``q`` impacts per
        repetition of a periodic one, otherwise 0;
        ``section_x``, ``section_v``: a state on it; ``representative``: the number of the start it
        is from, in C order over the axes of starts in the order of the file; ``settled``: whether
        the record of that start shows it.

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
    points = PointNumbers.of(dataset)
    ends = outcomes(dataset, points, extensions)
    groups = group_periodic(dataset, points, ends.period, ends.cycles, tolerance)
    return _as_dataset(dataset, points, _numbered(dataset, points, ends, groups), ends)


class _Attractors(NamedTuple):
    """The attractors of all parameter points, in the order of these, the most frequent first.

    Attributes
    ----------
    of_point : ndarray of int, shape (points of the file,)
        The index of the attractor that each point is on; -1 for none.
    representative : ndarray of int, shape (n,)
        A point of the file on each attractor.
    motion, m, number, members : ndarray of int, shape (n,)
        `members` is the number of points on the attractor.
    section : ndarray, shape (n, 2)
        The last state of the representative.
    """

    of_point: np.ndarray
    representative: np.ndarray
    motion: np.ndarray
    m: np.ndarray
    number: np.ndarray
    members: np.ndarray
    section: np.ndarray


def _numbered(
    dataset: xr.Dataset, points: PointNumbers, ends: Outcomes, groups: Groups
) -> _Attractors:
    """Number the attractors, those that are not periodic among them."""
    motion = ends.motion
    representative = groups.representative.copy()
    not_periodic = np.flatnonzero((representative < 0) & (motion > Motion.FAILED))
    if len(not_periodic):
        kinds = points.parameter[not_periodic] * len(Motion) + motion[not_periodic]
        _, first, inverse = np.unique(kinds, return_index=True, return_inverse=True)
        representative[not_periodic] = not_periodic[first][inverse]
    at, of_point = np.unique(representative, return_inverse=True)
    of_point = of_point - int(len(at) > 0 and at[0] < 0)
    at = at[at >= 0]
    members = np.bincount(of_point[of_point >= 0], minlength=len(at))
    total = np.bincount(points.parameter[at], members, points.count)
    share = members / total[points.parameter[at]]
    m, number = _tracked(dataset, points, motion, at, share, groups)
    order = np.lexsort((number, -members, points.parameter[at]))
    at = at[order]
    if len(at):
        place = np.empty_like(order)
        place[order] = np.arange(len(order))
        of_point = np.where(of_point < 0, -1, place[of_point])
    at = _settled_members(of_point, at, ends)
    return _Attractors(
        of_point, at, motion[at], m[order], number[order], members[order], groups.last[at]
    )


def _settled_members(of_point: np.ndarray, at: np.ndarray, ends: Outcomes) -> np.ndarray:
    """Return a point on each attractor, one whose record shows it where there is one."""
    shown = np.flatnonzero((of_point >= 0) & ~ends.followed)
    attractor, first = np.unique(of_point[shown], return_index=True)
    at = at.copy()
    replaced = ends.followed[at[attractor]]
    at[attractor[replaced]] = shown[first[replaced]]
    return at


def _tracked(
    dataset: xr.Dataset,
    points: PointNumbers,
    motion: np.ndarray,
    at: np.ndarray,
    share: np.ndarray,
    groups: Groups,
) -> tuple[np.ndarray, np.ndarray]:
    """Return m and the number of each attractor: the periodic by their share, the rest last."""
    lengths, places = np.zeros(motion.size, np.int64), np.zeros(motion.size, np.int64)
    for length, heads in groups.by_period.items():
        lengths[heads], places[heads] = length, np.arange(len(heads))
    number = np.empty(len(at), np.int64)
    periodic = np.flatnonzero(motion[at] == Motion.PERIODIC)
    periodic = periodic[np.argsort(points.parameter[at[periodic]], kind="stable")]
    heads = at[periodic]
    links = None
    if points.shape and Setting.of(dataset).method.get("impact") == "exact":
        axis = points.parameters[int(np.argmax(points.shape))]
        links = ExactLinks(dataset, axis, heads, groups.last[heads], lengths[heads])
    chains = track(
        points.shape,
        PeriodicAttractors(points.parameter[heads], lengths[heads], places[heads], groups.cycles),
        links,
    )
    _, chain = np.unique(chains, return_inverse=True)
    shares = np.bincount(chain, share[periodic])
    ranks = np.empty(len(shares), np.int64)
    ranks[np.argsort(-shares, kind="stable")] = np.arange(len(shares))
    number[periodic] = ranks[chain]
    not_periodic = np.flatnonzero(motion[at] != Motion.PERIODIC)
    _, kinds = np.unique(motion[at[not_periodic]], return_inverse=True)
    number[not_periodic] = len(shares) + kinds
    return lengths[at], number


def _as_dataset(
    dataset: xr.Dataset, points: PointNumbers, table: _Attractors, ends: Outcomes
) -> xr.Dataset:
    """Put the attractors into the shape of the grid."""
    parameter = points.parameter[table.representative]
    rank = np.arange(len(parameter)) - np.searchsorted(parameter, parameter)
    width = int(rank.max(initial=0)) + 1
    results = np.bincount(parameter, table.members, points.count)
    x, v = table.section.T
    columns: dict[str, tuple[np.ndarray, str]] = {
        "number": (table.number, "number of the attractor"),
        "fraction": (table.members / results[parameter], "fraction of the starts"),
        "motion": (table.motion, "kind of motion"),
        "m": (table.m, "forcing periods per repetition, 0: not periodic"),
        "q": (_impacts(ends, table), "impacts per repetition, 0: not periodic"),
        "settled": (~ends.followed[table.representative], "whether its record shows it"),
        "section_x": (x, "displacement at the section"),
        "section_v": (v, "velocity at the section"),
        "representative": (
            points.start[table.representative], "number of the start that stands for it"
        ),
    }  # fmt: skip
    data: dict[str, Any] = {}
    for name, (values, meaning) in columns.items():
        missing = {"f": np.nan, "b": False}.get(values.dtype.kind, -1)
        grid = np.full((points.count, width), missing, values.dtype)
        grid[parameter, rank] = values
        shaped = grid.reshape(*points.shape, width)
        about: dict[str, Any] = {"long_name": meaning}
        if name == "motion":
            about["flag_values"] = np.array(list(Motion))
            about["flag_meanings"] = " ".join(motion.name.lower() for motion in Motion)
        data[name] = ((*points.parameters, "coexisting"), shaped, about)
    of_point = table.of_point
    number = np.where(of_point < 0, -1, table.number[of_point]) if len(parameter) else of_point
    counted = np.bincount(parameter[np.isin(table.motion, COUNTED_MOTIONS)], minlength=points.count)
    about = {"long_name": "number of the attractor, -1: none"}
    data["attractor"] = (dataset["status"].dims, number.reshape(dataset["status"].shape), about)
    about = {"long_name": "whether the motion was followed on, since it had not settled"}
    followed = ends.followed.reshape(dataset["status"].shape)
    data["followed"] = (dataset["status"].dims, followed, about)
    about = {"long_name": "distinct attractors found"}
    data["attractors"] = (points.parameters, counted.reshape(points.shape), about)
    return xr.Dataset(data, {name: dataset[name] for name in dataset["status"].coords})


def _impacts(ends: Outcomes, table: _Attractors) -> np.ndarray:
    """Return the impacts per repetition that most points on an attractor have."""
    on = np.flatnonzero(table.of_point >= 0)
    attractor = table.of_point[on]
    repetitions = np.maximum(ends.period[on], 1)
    counted = np.rint(ends.impacts[on] * table.m[attractor] / repetitions).astype(np.int64)
    pairs, times = np.unique(np.stack([attractor, counted]), axis=1, return_counts=True)
    most = np.zeros(len(table.representative), np.int64)
    order = np.argsort(times, kind="stable")
    most[pairs[0, order]] = pairs[1, order]  # the last, most frequent one stays
    return most
