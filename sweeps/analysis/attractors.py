"""The distinct attractors of a sweep: which exist at a point, and which starts reach each.

A parameter point is a point of the grid without its starts, or a set of parameters in a table. The
regime of the motion from each start (`sweeps.analysis.regimes`) decides its attractor:

- Two periodic motions are on the same attractor if they have the same number m of forcing periods,
  and section states that agree within a tolerance, wherever in the cycle their records end. Impacts
  need not be compared, because a state at the section determines the further motion. If a record
  that repeats after m periods repeats within the tolerance already after a divisor of m, as near a
  flip, this divisor is taken as the number of periods.
- All motions with rest are on one attractor: when the force releases the mass from the stop, at a
  phase that depends only on the parameters, no trace of the past remains. If a rest leads to chaos,
  the chaos is the same attractor.
- All chaotic motions are on one attractor, and so are all unbounded motions. A finite record cannot
  show whether two chaotic motions are on different attractors, so the number of attractors is a
  lower bound.
- Motions that have not settled in their record, and chaotic motions, which may be transient, are
  followed further (`sweeps.analysis.settle`). Motions that still have not settled are listed as
  unsettled, and are not counted as attractors.
- Failed points and points that are not computed yet have no attractor.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from sweeps.analysis.doors import takes_sweep
from sweeps.analysis.grouping import SETS, GridIndex, Groups
from sweeps.analysis.regimes import Regime
from sweeps.analysis.section_distance import TOLERANCE
from sweeps.analysis.selection import config_of, described, diagnostics_with
from sweeps.analysis.settle import EXTENSIONS, Outcomes
from sweeps.analysis.tracking import PeriodicAttractors, exact_links, track
from sweeps.config.rig import model_name
from sweeps.errors import Refused

#: Regimes that count as attractors; motions of other regimes may still change.
COUNTED = (Regime.PERIODIC, Regime.REST, Regime.CHAOTIC)


@takes_sweep({})
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
        Largest difference of section states, x and v / omega, that are taken as equal, relative to
        the greatest coordinate of the cycle.
    extensions : int
        How often motions that have not settled are followed, each time four times as long; with 0
        only the records are used.

    Returns
    -------
    Dataset
        In the shape of ``status``:

        - ``attractor``: the number of the attractor, -1 for none. Along the axes, the same number
          means the same attractor (`sweeps.analysis.tracking`), but not among the sets of a table.
          The most frequent periodic attractor has the number 0; attractors that are not periodic
          have the last numbers.
        - ``followed``: whether the motion had not settled in its record, and was followed further.

        At every parameter point:

        - ``attractors``: how many attractors, periodic, with rest or chaotic, were found; a
          lower bound.

        For each attractor of a parameter point, along the dimension ``coexisting`` with the most
        frequent first, and -1 or NaN where there are no more:

        - ``number``: the number of the attractor.
        - ``fraction``: its share of the starts with a result.
        - ``motion``: its kind, named by the attribute ``flag_meanings``.
        - ``m``, ``q``: forcing periods and impacts per repetition; 0 if it is not periodic.
        - ``section_x``, ``section_v``: a state on it.
        - ``representative``: the start that leads to this state, as its index in C order over the
          axes of starts in the order of the file.
        - ``settled``: whether the record of that start shows the attractor.

    Raises
    ------
    Refused
        If the file has no period or section.

    Examples
    --------
    >>> import sweeps
    >>> x0 = {"start": -3, "stop": 0, "num": 12}
    >>> v0 = {"start": -2, "stop": 2, "num": 12}
    >>> starts = {"x0": x0, "v0": v0}
    >>> scene = {"oscillator": {"h": 0.0, "R": 0.8, "omega": 1.3, "f": 1.0}, "start": starts}
    >>> ds = sweeps.open_sweep(sweeps.run_sweep(scene, "basins.h5", overwrite=True))
    >>> found = sweeps.attractors(ds)
    >>> found["attractors"].item(), found["fraction"].values.round(3)
    (2, array([0.806, 0.194]))
    """
    for name in ("period", "poincare_x", "poincare_v"):
        if name not in dataset:
            raise Refused(
                f"the file has no {name}, by which attractors are told apart: run the sweep again "
                f"with {diagnostics_with(dataset, 'period')}"
            )
    points = GridIndex.of(dataset)
    groups, ends = Groups(points, tolerance), Outcomes(dataset, points)
    groups.add_records(dataset, ends.repetition)
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
    q = ends.q[shown] * m // np.maximum(ends.m[shown], 1)
    columns: dict[str, tuple[np.ndarray, str, str]] = {
        "number": (number, "number of the attractor", "1"),
        "fraction": (fraction, "share of the starts", "1"),
        "motion": (regime, "kind of motion", "1"),
        "m": (m, "forcing periods per repetition, 0: not periodic", "1"),
        "q": (q, "impacts per repetition, 0: not periodic", "1"),
        "settled": (~ends.followed[shown], "whether its record shows it", "1"),
        "section_x": (x, "displacement at the section", "length"),
        "section_v": (v, "velocity at the section", "length/time"),
        "representative": (points.start[shown], "number of its representative start", "1"),
    }
    config = config_of(dataset)
    order = np.lexsort((number, -members, parameter))
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order)) - np.searchsorted(parameter[order], parameter[order])
    data: dict[str, Any] = {}
    for name, (values, meaning, unit) in columns.items():
        missing = {"f": np.nan, "b": False}.get(values.dtype.kind, -1)
        grid = np.full((points.count, int(rank.max(initial=0)) + 1), missing, values.dtype)
        grid[parameter, rank] = values
        shaped = grid.reshape(*points.shape, -1)
        data[name] = (*points.parameters, "coexisting"), shaped, described(config, meaning, unit)
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

    `representative` are the points that represent the periodic motions. All other motions of one
    regime at a parameter point are on one attractor.
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
    """Number the periodic attractors, in decreasing order of their share of all starts."""
    links = None
    shape = () if SETS in points.parameters else points.shape  # sets have no neighbours
    config = config_of(dataset)
    if shape and config.method.impact == "exact":
        axis = points.parameters[int(np.argmax(shape))]
        states = points.at_states(periodic.at, *last[periodic.at].T)
        links = exact_links(model_name(axis), config.record.phase, states, periodic.m)
    _, chain = np.unique(track(shape, periodic, links), return_inverse=True)
    shares = np.bincount(chain, fraction)
    return np.argsort(np.argsort(-shares, kind="stable"))[chain]
