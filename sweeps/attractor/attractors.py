"""`attractors`: which exist at a point (`GridIndex`), their numbers, which starts reach each.

A parameter point is a point of the grid without its starts, or a set of parameters in a table. The
regime of the motion from each start (`sweeps.opened.motions`) decides its attractor:

- The attractor of a periodic motion is its orbit. Two are the same if they have the same class m/q
  and states at the section that agree within a tolerance, in the same order.
- All motions with rest are on one attractor: when the force releases the mass from the stop, at a
  phase that depends only on the parameters, no trace of the past remains. If a rest leads to chaos,
  the chaos is the same attractor.
- All chaotic motions are on one attractor, and so are all unbounded motions. A finite record cannot
  show whether two chaotic motions are on different attractors, so the number of attractors is a
  lower bound.
- Motions whose record does not show where they go, and chaotic motions, which may be transient,
  are continued (`sweeps.attractor.tracking`). Motions that still go to no known attractor are
  unknown, and are not counted as attractors.
- Failed points and points that are not computed yet have no attractor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Self

import numpy as np
import pandas as pd
import xarray as xr

from sweeps.attractor.tracking import (
    EXTENSIONS,
    joined_by,
    lead_to_each_other,
    mutually_nearest,
    settle,
    track,
)
from sweeps.config.groups import STARTS
from sweeps.errors import Refused
from sweeps.grid import TABLE
from sweeps.opened.doors import takes_sweep
from sweeps.opened.motions import ORBIT_TOLERANCE, Cycles, cycles_of, distances
from sweeps.opened.opened_sweep import START_AXES, OpenedSweep
from sweeps.store.variables import description_in
from sweeps.text import listed
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.points.regimes import Regime, on_its_way
from vibroimpact.points.stages import RunSpec

#: The dimension of the different sets of parameters in a table.
SETS = "set"
#: Regimes that count as attractors; motions of other regimes may still change.
COUNTED = (Regime.PERIODIC, Regime.REST, Regime.CHAOTIC)
#: States that agree to this much less than the tolerance are continued and compared once.
_FINER = 256
#: The variables of an attractor at a parameter point, with their meanings and units.
ATTRACTOR_COLUMNS = {
    "number": ("number of the attractor", "1"),
    "fraction": ("share of the starts", "1"),
    "motion": ("kind of motion", "1"),
    "m": ("forcing periods per repetition, 0: none known", "1"),
    "q": ("impacts per repetition, 0: not periodic, or with rest", "1"),
    "from_record": ("whether its record shows it", "1"),
    "section_x": ("displacement at the section", "length"),
    "section_v": ("velocity at the section", "length/time"),
    "representative": ("number of its representative start", "1"),
}


@dataclass(frozen=True)
class GridIndex:
    """The parameter point and the start of each point of a file."""

    #: Shape of the grid of parameter points: the grid of the file without its ``START_AXES``. For
    #: a table, the number of its different sets of parameters; () if there is only one.
    shape: tuple[int, ...]
    parameters: tuple[str, ...]  # the axes of this grid, or ``SETS``
    #: parameter, start: indices of the parameter point and of the start of each point, all in
    #: C order; int, shape (n,).
    parameter: np.ndarray
    start: np.ndarray

    @classmethod
    def of(cls, sweep: OpenedSweep) -> Self:
        """Index the points of an opened sweep, or of a cut through one."""
        if TABLE in sweep.grid:
            return cls(*_sets(sweep.points))
        sizes = {str(name): size for name, size in sweep["status"].sizes.items()}
        parameters = {name: size for name, size in sizes.items() if name not in START_AXES}
        grids = [  # of the parameter points, and of the starts: 1 along all other axes
            [size if (name in parameters) is of_parameters else 1 for name, size in sizes.items()]
            for of_parameters in (True, False)
        ]
        numbers = (np.arange(math.prod(grid)).reshape(grid) for grid in grids)
        at_points = (np.broadcast_to(grid, tuple(sizes.values())).ravel() for grid in numbers)
        return cls(tuple(parameters.values()), tuple(parameters), *at_points)


def _sets(points: np.ndarray) -> tuple[tuple[int, ...], tuple[str, ...], np.ndarray, np.ndarray]:
    """Return the fields of `GridIndex` for the rows of a table."""
    rows = np.stack([points[name] for name in PARAMETERS if name not in START_AXES], axis=1)
    different, of_row = np.unique(rows, axis=0, return_inverse=True)
    if len(different) == len(rows) > 1:
        raise Refused(
            f"attractors need several starts, and no rows of the table differ in {listed(STARTS)}"
        )
    start = pd.Series(of_row).groupby(of_row).cumcount().to_numpy()
    several = len(different) > 1
    return (len(different),) * several, (SETS,) * several, of_row, start


@takes_sweep({})
def attractors(
    sweep: OpenedSweep, tolerance: float = ORBIT_TOLERANCE, extensions: int = EXTENSIONS
) -> xr.Dataset:
    """Find the distinct attractors at every parameter point.

    Parameters
    ----------
    sweep : Dataset
        An opened sweep, or a cut through one, with ``period`` and the section; ``lyapunov`` is
        used if the sweep has it.
    tolerance : float
        Largest difference of section states, x and v / omega, that are taken as equal, relative to
        the greatest coordinate of the cycle.
    extensions : int
        How often motions that go to no known attractor are followed, each time four times as long;
        with 0 only the records are used.

    Returns
    -------
    Dataset
        In the shape of ``status``:

        - ``attractor``: the number of the attractor, -1 for none. Along the axes, the same number
          means the same attractor (`sweeps.attractor.tracking`), but not among the sets of a table,
          nor where more than 50 attractors coexist, each of which has a number of its own.
          The most frequent periodic attractor has the number 0; attractors that are not periodic
          have the last numbers.
        - ``followed``: whether the motion was followed beyond its record, which does not show its
          attractor.

        At every parameter point:

        - ``attractors``: how many attractors, periodic, with rest or chaotic, were found; a
          lower bound.

        The attribute ``left_out`` counts the extensions left out because all motions together are
        followed for at most 300,000,000 forcing periods.

        For each attractor of a parameter point, along the dimension ``coexisting`` with the most
        frequent first, and -1 or NaN where there are no more:

        - ``number``: the number of the attractor.
        - ``fraction``: its share of the starts with a result.
        - ``motion``: its kind, named by the attribute ``flag_meanings``.
        - ``m``, ``q``: forcing periods and impacts per repetition; 0 if it is not periodic. With
          rest m is 0 if it was not shown to repeat, and q is 0: the impacts are not counted.
        - ``section_x``, ``section_v``: a state on it.
        - ``representative``: the start that leads to this state, as its index in C order over the
          axes of starts in the order of the file.
        - ``from_record``: whether the record of that start shows the attractor.

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
    sweep.check("period", "poincare_x", "poincare_v")
    spec = sweep.spec
    index, motions = GridIndex.of(sweep), sweep.motions.ravel()
    followed = on_its_way(motions["regime"], sweep["orbit_distance"].values.ravel())
    followed |= motions["m"] > sweep.sizes["section"]
    continued, left_out = settle(motions, sweep, index.parameter, extensions)
    followed |= continued
    heads, of_point = attractors_of(motions, index.parameter, spec, tolerance)
    parameter, members = index.parameter[heads], np.bincount(of_point[of_point >= 0])
    fraction = members / np.bincount(parameter, members)[parameter]
    number = _numbers(sweep, index, motions[heads], parameter, fraction)
    recorded = np.flatnonzero((of_point >= 0) & ~followed)[::-1]
    member = heads.copy()
    member[of_point[recorded]] = recorded  # the first whose record shows the attractor
    motion, m = motions[member], np.zeros(len(heads) + 1, np.int64)
    np.maximum.at(m, of_point, motions["m"])  # not every motion with rest shows after how many
    x, v = motion["point"]["x0"], motion["point"]["v0"]
    columns = (
        number, fraction, motion["regime"], m[:-1], motion["q"], ~followed[member], x, v,
        index.start[member],
    )  # fmt: skip
    data = _by_rank(sweep, index, parameter, dict(zip(ATTRACTOR_COLUMNS, columns, strict=True)))
    counted = np.bincount(
        parameter[np.isin(motion["regime"], COUNTED)], minlength=math.prod(index.shape)
    ).reshape(index.shape)
    status = sweep["status"]
    for name, values, meaning in (
        ("attractor", np.append(number, -1)[of_point], "number of the attractor, -1: none"),
        ("followed", followed, "whether the motion was followed beyond its record"),
    ):
        data[name] = (status.dims, values.reshape(status.shape), {"long_name": meaning})
    data["attractors"] = index.parameters, counted, {"long_name": "distinct attractors found"}
    names = {*data, "coexisting", SETS}  # a column of a table may have one of these names
    coords = status.drop_vars(names, errors="ignore").coords
    return xr.Dataset(data, coords, {"left_out": left_out})


def _by_rank(
    sweep: OpenedSweep, index: GridIndex, parameter: np.ndarray, columns: Mapping[str, np.ndarray]
) -> dict[str, Any]:
    """Return variables of attractors by parameter point and rank, the most frequent first."""
    order = np.lexsort((columns["number"], -columns["fraction"], parameter))
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order)) - np.searchsorted(parameter[order], parameter[order])
    data: dict[str, Any] = {}
    for name, values in columns.items():
        missing = {"f": np.nan, "b": False}.get(values.dtype.kind, -1)
        grid = np.full((*index.shape, int(rank.max(initial=0)) + 1), missing, values.dtype)
        grid.reshape(-1, grid.shape[-1])[parameter, rank] = values
        attributes = description_in(sweep.attrs, *ATTRACTOR_COLUMNS[name])
        data[name] = (*index.parameters, "coexisting"), grid, attributes
    data["motion"][2]["flag_values"] = np.array(list(Regime))
    data["motion"][2]["flag_meanings"] = " ".join(regime.word for regime in Regime)
    return data


def attractors_of(
    motions: np.ndarray, parameter: np.ndarray, spec: RunSpec, tolerance: float = ORBIT_TOLERANCE
) -> tuple[np.ndarray, np.ndarray]:
    """Return a motion on each attractor, and the attractor of each motion, -1 for none.

    `parameter` are the parameter points of the `motions`. Periodic motions are on one attractor if
    their parameter points, m and q agree, and their orbits; of all others, those of one regime are.
    """
    rows = np.flatnonzero(motions["regime"] > Regime.FAILED)
    motion, at = motions[rows], parameter[rows]
    periodic, points = motion["regime"] == Regime.PERIODIC, motion["point"]
    # Of the motions for which all of this agrees, with rounded states, one is compared.
    states = np.stack([points["x0"] - points["clearance"], points["v0"] / points["omega"]])
    m, q, x, v = np.where(periodic, [motion["m"], motion["q"], *states], 0.0)
    _, exponent = np.frexp(np.maximum(np.abs(x), np.abs(v)))
    rounded = np.rint(np.ldexp([x, v], -exponent) / max(tolerance / _FINER, 1e-15))
    columns = motion["regime"], at, m, q, exponent, *rounded
    order = np.lexsort(columns)
    begins = np.ones(len(order), bool)
    begins[1:] = np.any([np.diff(column[order]) != 0 for column in columns], axis=0)
    distinct, of_row = order[begins], np.empty_like(order)
    of_row[order] = np.cumsum(begins) - 1
    # The periodic ones of these are on one attractor if their cycles agree within the tolerance.
    cyclic, same = np.flatnonzero(periodic[distinct]), np.arange(len(distinct))
    compared = motion[distinct[cyclic]]
    apart = [at[distinct[cyclic]], compared["m"], compared["q"]]
    group = np.unique(apart, axis=1, return_inverse=True)[1].ravel()
    same[cyclic] = cyclic[same_motions(cycles_of(spec, compared), group, tolerance)]
    heads = np.unique(distinct[same])
    of_point = np.full(len(motions), -1)
    of_point[rows] = np.searchsorted(heads, distinct[same[of_row]])
    return rows[heads], of_point


def same_motions(
    cycles: Cycles, group: np.ndarray, tolerance: float = ORBIT_TOLERANCE
) -> np.ndarray:
    """Return for each cycle the index of the first that is the same motion, shape (n,).

    Cycles of one number in `group` are the same motion if they are within `tolerance`, or are
    connected by a chain of such cycles. So the result does not depend on the order of the cycles,
    and no arbitrary boundary separates cycles that converge to the same motion.
    """
    count = len(group)
    if len(np.unique(group)) == count:
        return np.arange(count)
    from scipy.spatial import KDTree

    # The mean of the states, after an impact, does not depend on the state at which a cycle begins;
    # two of these places are in both coordinates as near as the cycles are.
    x, v = np.moveaxis(cycles.states, -1, 0)
    after = np.fmin(v, -cycles.R[:, None] * v)
    means = (np.nansum(column, axis=1) / cycles.m for column in (x, after))
    size = np.nanmax(np.abs(cycles.states), axis=(1, 2), initial=0.0)
    radius = tolerance * size * (1.0 + 1e-9)  # rounding included
    sites = np.column_stack([*means, 4.0 * radius.max() * group])  # groups are kept apart
    near = KDTree(sites).query_ball_point(sites, radius, p=np.inf)
    a, b = np.repeat(np.arange(count), list(map(len, near))), np.concatenate(near).astype(int)
    a, b = a[a != b], b[a != b]
    equal = distances(cycles, a, b) <= tolerance
    number = joined_by(count, a[equal], b[equal])
    return np.unique(number, return_index=True)[1][number]


def _numbers(
    sweep: OpenedSweep,
    index: GridIndex,
    motions: np.ndarray,
    parameter: np.ndarray,
    fraction: np.ndarray,
) -> np.ndarray:
    """Number attractors: the periodic ones in decreasing order of their share of all starts."""
    number, periodic = np.empty(len(motions), np.int64), motions["regime"] == Regime.PERIODIC
    has_neighbours = len(index.shape) and SETS not in index.parameters
    if has_neighbours:  # the values of an axis may be in any order
        ranks = [sweep[name].values.argsort().argsort() for name in index.parameters]
        indices = np.unravel_index(parameter, index.shape)
        parameter = np.ravel_multi_index([*map(np.take, ranks, indices)], index.shape)
    at = np.flatnonzero(periodic)
    at = at[np.argsort(parameter[at], kind="stable")]
    chain = np.arange(len(at))
    if len(at) and has_neighbours:
        near = partial(mutually_nearest, cycles_of(sweep.spec, motions[at]))
        seeded = partial(lead_to_each_other, sweep.spec, motions[at])
        chain = track(index.shape, parameter[at], near, seeded)
    order = np.argsort(-np.bincount(chain, fraction[at]), kind="stable")
    number[at] = np.argsort(order)[chain]
    kinds = np.unique(motions["regime"][~periodic], return_inverse=True)[1]
    number[~periodic] = number[at].max(initial=-1) + 1 + kinds
    return number
