"""The distinct attractors of a sweep: which there are at a parameter point, and who reaches them.

A parameter point is one of the grid without its starts: all starts there are on one of its
attractors, by `sweeps.analysis.classes.classify`:

- periodic motions are the same attractor if they have the same number m of forcing periods and
  the same section states within a tolerance, wherever in the cycle each record ends. Impacts need
  not be compared, since a state at the section determines all that follows. A record that repeats
  after m periods, but already within the tolerance after a divisor of m, as beside a flip, is one
  of so many periods;
- motions with rest are one attractor: when the force releases the mass from the stop, at a phase
  that depends on the parameters only, nothing is left of the past;
- what does not repeat is one for each of chaotic, quasi-periodic or unsettled, undecided, and
  unbounded. Whether two chaotic motions are on one attractor cannot be told from a finite record,
  so they are taken for one, and the number of attractors is a lower bound;
- failed points and those not computed yet are on none.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from sweeps.analysis.classes import Motion, classify
from sweeps.analysis.identities import Attractors, identities
from sweeps.analysis.periodic import Leaders, Points, periodic
from sweeps.errors import Refused
from vibroimpact.orbits.cycles import TOLERANCE

#: Motions that count as an attractor; of the others it is not known whether they stay.
ATTRACTORS = (Motion.PERIODIC, Motion.REST, Motion.CHAOTIC)


def attractors(dataset: xr.Dataset, tolerance: float = TOLERANCE) -> xr.Dataset:
    """Find the distinct attractors at every parameter point.

    Parameters
    ----------
    dataset : Dataset
        An opened sweep, or a cut through one, with ``period`` and the section; ``lyapunov`` is
        used where there.
    tolerance : float
        Within which section states, x and v / omega, are the same; relative to the greatest of the
        cycle.

    Returns
    -------
    Dataset
        ``attractor``, in the shape of ``status``: the number of the attractor, -1 for none. A
        number is the same attractor along the axes (`sweeps.analysis.identities`); the most
        frequent periodic one has 0, and those that are not periodic have the last.
        ``attractors`` (parameters...): how many of ``ATTRACTORS`` were found, a lower bound.
        And for each of a point's, in the dimension ``coexisting`` from the most frequent on, -1 or
        NaN where there are no more: ``number``; ``fraction`` of the starts with a result;
        ``motion``, a `sweeps.analysis.classes.Motion`; ``m`` forcing periods and ``q`` impacts per
        repetition of a periodic one, otherwise 0;
        ``section_x``, ``section_v``: a state on it; ``representative``: the number of the start it
        is from, in C order over the axes of starts in the order of the file.

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
    points = Points.of(dataset)
    motion = classify(dataset).ravel()
    period = np.where(motion == Motion.PERIODIC, dataset["period"].values.ravel(), 0)
    leaders = periodic(dataset, points, period, tolerance)
    return _described(dataset, points, _found(points, motion, leaders))


class _Found(NamedTuple):
    """The attractors of all parameter points, in the order of these, the most frequent first.

    Attributes
    ----------
    of : ndarray of int, shape (points of the file,)
        Which of them each point is on; -1 for none.
    at : ndarray of int, shape (n,)
        The point of the file that stands for each.
    motion, m, number, members : ndarray of int, shape (n,)
    section : ndarray, shape (n, 2)
    """

    of: np.ndarray
    at: np.ndarray
    motion: np.ndarray
    m: np.ndarray
    number: np.ndarray
    members: np.ndarray
    section: np.ndarray


def _found(points: Points, motion: np.ndarray, leaders: Leaders) -> _Found:
    """Number the attractors, those that are not periodic among them."""
    leader = leaders.of.copy()
    others = np.flatnonzero((leader < 0) & (motion > Motion.FAILED))
    if len(others):
        kinds = points.parameter[others] * len(Motion) + motion[others]
        _, first, inverse = np.unique(kinds, return_index=True, return_inverse=True)
        leader[others] = others[first][inverse]
    at, of = np.unique(leader, return_inverse=True)
    of = of - int(len(at) > 0 and at[0] < 0)
    at = at[at >= 0]
    m, place = np.zeros(motion.size, np.int64), np.zeros(motion.size, np.int64)
    for length, heads in leaders.at.items():
        m[heads], place[heads] = length, np.arange(len(heads))
    members = np.bincount(of[of >= 0], minlength=len(at))
    share = members / np.bincount(points.parameter[at], members, points.count)[points.parameter[at]]
    number = _numbers(points, motion, at, share, m, place, leaders)
    order = np.lexsort((number, -members, points.parameter[at]))
    back = np.empty_like(order)
    back[order] = np.arange(len(order))
    at = at[order]
    of = np.where(of < 0, -1, back[of]) if len(at) else of
    return _Found(of, at, motion[at], m[at], number[order], members[order], leaders.last[at])


def _numbers(
    points: Points,
    motion: np.ndarray,
    at: np.ndarray,
    share: np.ndarray,
    m: np.ndarray,
    place: np.ndarray,
    leaders: Leaders,
) -> np.ndarray:
    """Number the attractors along the axes: the periodic by their share, the rest last."""
    number = np.empty(len(at), np.int64)
    repeat = np.flatnonzero(motion[at] == Motion.PERIODIC)
    repeat = repeat[np.argsort(points.parameter[at[repeat]], kind="stable")]
    own = at[repeat]
    names = identities(
        points.shape, Attractors(points.parameter[own], m[own], place[own], leaders.cycles)
    )
    _, named = np.unique(names, return_inverse=True)
    shares = np.bincount(named, share[repeat])
    ranks = np.empty(len(shares), np.int64)
    ranks[np.argsort(-shares, kind="stable")] = np.arange(len(shares))
    number[repeat] = ranks[named]
    other = np.flatnonzero(motion[at] != Motion.PERIODIC)
    _, kinds = np.unique(motion[at[other]], return_inverse=True)
    number[other] = len(shares) + kinds
    return number


def _described(dataset: xr.Dataset, points: Points, found: _Found) -> xr.Dataset:
    """Put what was found into the shape of the grid."""
    parameter = points.parameter[found.at]
    rank = np.arange(len(parameter)) - np.searchsorted(parameter, parameter)
    width = int(rank.max(initial=0)) + 1
    results = np.bincount(parameter, found.members, points.count)
    x, v = found.section.T
    columns: dict[str, tuple[np.ndarray, str]] = {
        "number": (found.number, "number of the attractor"),
        "fraction": (found.members / results[parameter], "fraction of the starts"),
        "motion": (found.motion, "kind of motion"),
        "m": (found.m, "forcing periods per repetition, 0: not periodic"),
        "q": (_impacts(dataset, found), "impacts per repetition, 0: not periodic"),
        "section_x": (x, "displacement at the section"),
        "section_v": (v, "velocity at the section"),
        "representative": (points.start[found.at], "number of the start that stands for it"),
    }
    data: dict[str, Any] = {}
    for name, (values, meaning) in columns.items():
        missing = np.nan if values.dtype.kind == "f" else -1
        table = np.full((points.count, width), missing, values.dtype)
        table[parameter, rank] = values
        shaped = table.reshape(*points.shape, width)
        data[name] = ((*points.parameters, "coexisting"), shaped, {"long_name": meaning})
    own = np.where(found.of < 0, -1, found.number[found.of]) if len(found.at) else found.of
    counted = np.bincount(parameter[np.isin(found.motion, ATTRACTORS)], minlength=points.count)
    about = {"long_name": "number of the attractor, -1: none"}
    data["attractor"] = (dataset["status"].dims, own.reshape(dataset["status"].shape), about)
    about = {"long_name": "distinct attractors found"}
    data["attractors"] = (points.parameters, counted.reshape(points.shape), about)
    return xr.Dataset(data, {name: dataset[name] for name in dataset["status"].coords})


def _impacts(dataset: xr.Dataset, found: _Found) -> np.ndarray:
    """Return the impacts per repetition that most of those on an attractor have."""
    period, impacts = (dataset[name].values.ravel() for name in ("period", "period_impacts"))
    on = np.flatnonzero(found.of >= 0)
    of = found.of[on]
    counted = np.rint(impacts[on] * found.m[of] / np.maximum(period[on], 1)).astype(np.int64)
    pairs, times = np.unique(np.stack([of, counted]), axis=1, return_counts=True)
    most = np.zeros(len(found.at), np.int64)
    order = np.argsort(times, kind="stable")
    most[pairs[0, order]] = pairs[1, order]  # the last, most frequent one stays
    return most
