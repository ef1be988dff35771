"""The distinct attractors of a sweep: which exist at a point, and which starts reach each.

A parameter point is a point of the grid without its starts, or a set of parameters in a table. The
regime of the motion from each start (`sweeps.analysis.regimes`) decides its attractor:

- The attractor of a periodic motion is its orbit. Two are the same if they have the same class m/q
  and states at the section that agree within a tolerance, in the same order.
- All motions with rest are on one attractor: when the force releases the mass from the stop, at a
  phase that depends only on the parameters, no trace of the past remains. If a rest leads to chaos,
  the chaos is the same attractor.
- All chaotic motions are on one attractor, and so are all unbounded motions. A finite record cannot
  show whether two chaotic motions are on different attractors, so the number of attractors is a
  lower bound.
- Motions whose record does not show where they go, and chaotic motions, which may be transient,
  are continued (`sweeps.analysis.settle`). Motions that still go to no known attractor are unknown,
  and are not counted as attractors.
- Failed points and points that are not computed yet have no attractor.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from sweeps.analysis.dataset import config_of, described, diagnostics_with
from sweeps.analysis.doors import takes_sweep
from sweeps.analysis.grouping import SETS, GridIndex
from sweeps.analysis.motions import cycles_of, different, motions_of
from sweeps.analysis.regimes import approaching
from sweeps.analysis.section_distance import TOLERANCE, same_motions
from sweeps.analysis.settle import EXTENSIONS, settle
from sweeps.analysis.tracking import PeriodicAttractors, exact_links, track
from sweeps.config.rig import model_name
from sweeps.config.sweep import SweepConfig
from sweeps.errors import Refused
from vibroimpact.points.regimes import Regime

#: Regimes that count as attractors; motions of other regimes may still change.
COUNTED = (Regime.PERIODIC, Regime.REST, Regime.CHAOTIC)
#: States that agree to this much less than the tolerance are continued and compared once.
_FINER = 256


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
        How often motions that go to no known attractor are followed, each time four times as long;
        with 0 only the records are used.

    Returns
    -------
    Dataset
        In the shape of ``status``:

        - ``attractor``: the number of the attractor, -1 for none. Along the axes, the same number
          means the same attractor (`sweeps.analysis.tracking`), but not among the sets of a table.
          The most frequent periodic attractor has the number 0; attractors that are not periodic
          have the last numbers.
        - ``followed``: whether the motion was followed beyond its record, which does not show its
          attractor.

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
    for name in ("period", "poincare_x", "poincare_v"):
        if name not in dataset:
            raise Refused(
                f"the file has no {name}, by which attractors are told apart: run the sweep again "
                f"with {diagnostics_with(dataset, 'period')}"
            )
    index, motions, config = GridIndex.of(dataset), motions_of(dataset).ravel(), config_of(dataset)
    followed = approaching(dataset).ravel() | (motions["m"] > dataset.sizes["section"])
    if ((motions["m"] == 0) & (motions["regime"] > Regime.FAILED)).any():
        _put_last_states(motions, dataset)
        followed |= settle(motions, dataset, index, extensions)
    heads, of_point, periodic = attractors_of(motions, index.parameter, config, tolerance)
    number, fraction = np.empty(len(heads), np.int64), _shares(of_point, heads, index)
    own = np.searchsorted(heads, periodic.at)
    number[own] = _numbers(config, index, periodic, motions[periodic.at], fraction[own])
    regime, parameter = motions["regime"][heads], index.parameter[heads]
    others = np.flatnonzero(regime != Regime.PERIODIC)
    first = int(number[own].max(initial=-1)) + 1
    number[others] = first + np.unique(regime[others], return_inverse=True)[1]
    shown = _recorded_members(of_point, heads, followed)
    motion = motions[shown]
    columns: dict[str, tuple[np.ndarray, str, str]] = {
        "number": (number, "number of the attractor", "1"),
        "fraction": (fraction, "share of the starts", "1"),
        "motion": (regime, "kind of motion", "1"),
        "m": (motion["m"], "forcing periods per repetition, 0: not periodic", "1"),
        "q": (motion["q"], "impacts per repetition, 0: not periodic", "1"),
        "from_record": (~followed[shown], "whether its record shows it", "1"),
        "section_x": (motion["point"]["x0"], "displacement at the section", "length"),
        "section_v": (motion["point"]["v0"], "velocity at the section", "length/time"),
        "representative": (index.start[shown], "number of its representative start", "1"),
    }
    order = np.lexsort((number, -fraction, parameter))
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order)) - np.searchsorted(parameter[order], parameter[order])
    data: dict[str, Any] = {}
    for name, (values, meaning, unit) in columns.items():
        missing = {"f": np.nan, "b": False}.get(values.dtype.kind, -1)
        grid = np.full((index.count, int(rank.max(initial=0)) + 1), missing, values.dtype)
        grid[parameter, rank] = values
        shaped = grid.reshape(*index.shape, -1)
        data[name] = (*index.parameters, "coexisting"), shaped, described(config, meaning, unit)
    data["motion"][2]["flag_values"] = np.array(list(Regime))
    data["motion"][2]["flag_meanings"] = " ".join(regime.word for regime in Regime)
    counted = np.bincount(parameter[np.isin(regime, COUNTED)], minlength=index.count)
    for name, array, meaning in (
        ("attractor", np.append(number, -1)[of_point], "number of the attractor, -1: none"),
        ("followed", followed, "whether the motion was followed beyond its record"),
    ):
        status = dataset["status"]
        data[name] = (status.dims, array.reshape(status.shape), {"long_name": meaning})
    about = {"long_name": "distinct attractors found"}
    data["attractors"] = (index.parameters, counted.reshape(index.shape), about)
    return xr.Dataset(data, {name: dataset[name] for name in dataset["status"].coords})


def attractors_of(
    motions: np.ndarray, parameter: np.ndarray, config: SweepConfig, tolerance: float = TOLERANCE
) -> tuple[np.ndarray, np.ndarray, PeriodicAttractors]:
    """Return a motion on each attractor, and the attractor of each motion, -1 for none.

    `parameter` are the parameter points of the `motions`. The periodic attractors are returned,
    too. All other motions of one regime at a parameter point are on one attractor.
    """
    representative, periodic = _orbits(motions, parameter, config, tolerance)
    regime = motions["regime"]
    others = np.flatnonzero((representative < 0) & (regime > Regime.FAILED))
    first, number = different([parameter[others], regime[others]])
    representative[others] = others[first[number]]
    heads = np.unique(representative[representative >= 0])
    of_motion = np.where(representative < 0, -1, np.searchsorted(heads, representative))
    return heads, of_motion, periodic


def _put_last_states(motions: np.ndarray, dataset: xr.Dataset) -> None:
    """Write the last section states of all motions that are not periodic as their starts."""
    rows = motions["m"] == 0
    for name in "xv":
        last = dataset[f"poincare_{name}"].isel(section=-1).values.ravel()
        motions["point"][f"{name}0"][rows] = last[rows]


def _orbits(
    motions: np.ndarray, parameter: np.ndarray, config: SweepConfig, tolerance: float
) -> tuple[np.ndarray, PeriodicAttractors]:
    """Return the point that represents the orbit of each motion, -1 for none, and these orbits.

    Motions are on the same orbit only if their parameter points, m and q agree.
    """
    representative, cycles = np.full(len(motions), -1), {}
    heads, places = list[int](), list[int]()
    for m in (np.flatnonzero(np.bincount(motions["m"])[1:]) + 1).tolist():
        rows = np.flatnonzero(motions["m"] == m)
        own = motions[rows]
        group = different([parameter[rows], own["q"]])[1]
        one, of_row = different([group, *_rounded(own["point"], max(tolerance / _FINER, 1e-15))])
        of_one = cycles_of(config, own[one])
        same = same_motions(of_one, group[one], tolerance)
        kept = np.unique(same)
        representative[rows] = rows[one[same[of_row]]]
        heads += rows[one[kept]].tolist()
        places += range(len(kept))
        cycles[m] = of_one[kept]
    at = np.array(heads, np.int64)
    order = np.lexsort((at, parameter[at]))
    at, place = at[order], np.array(places, np.int64)[order]
    return representative, PeriodicAttractors(at, parameter[at], motions["m"][at], place, cycles)


def _rounded(points: np.ndarray, share: float) -> tuple[np.ndarray, ...]:
    """Return whole numbers that are equal where states agree to about a share of their size."""
    states = np.stack([points["x0"] - points["clearance"], points["v0"] / points["omega"]])
    _, exponent = np.frexp(np.abs(states).max(axis=0))
    return exponent, *np.rint(np.ldexp(states, -exponent) / share).astype(np.int64)


def _shares(of_point: np.ndarray, heads: np.ndarray, index: GridIndex) -> np.ndarray:
    """Return the share of each attractor in the starts with a result at its parameter point."""
    members, parameter = np.bincount(of_point[of_point >= 0]), index.parameter[heads]
    shares: np.ndarray = members / np.bincount(parameter, members, index.count)[parameter]
    return shares


def _recorded_members(of_point: np.ndarray, heads: np.ndarray, followed: np.ndarray) -> np.ndarray:
    """Return a point on each attractor, if possible one whose record shows the attractor."""
    shown = np.flatnonzero((of_point >= 0) & ~followed)
    attractor, first = np.unique(of_point[shown], return_index=True)
    members = heads.copy()
    members[attractor] = shown[first]
    return members


def _numbers(
    config: SweepConfig,
    index: GridIndex,
    periodic: PeriodicAttractors,
    motions: np.ndarray,
    fraction: np.ndarray,
) -> np.ndarray:
    """Number the periodic attractors, in decreasing order of their share of all starts."""
    links = None
    shape = () if SETS in index.parameters else index.shape  # sets have no neighbours
    if shape and config.method.impact == "exact":
        axis = index.parameters[int(np.argmax(shape))]
        links = exact_links(model_name(axis), config.record.phase, motions)
    _, chain = np.unique(track(shape, periodic, links), return_inverse=True)
    shares = np.bincount(chain, fraction)
    return np.argsort(np.argsort(-shares, kind="stable"))[chain]
