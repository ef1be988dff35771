"""Group equal periodic motions of a sweep, reading the file in parts."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
import xarray as xr

from sweeps.analysis.section_distance import Cycles, representatives, shortest_turn
from sweeps.analysis.selection import COORDINATES, recorded_coordinate
from sweeps.analysis.tracking import PeriodicAttractors
from sweeps.errors import Refused
from sweeps.grid import TABLE, Grid, block_points
from sweeps.store import DIRECTION
from vibroimpact.oscillator import PARAMETERS, POINT

#: Axes along which only the start or the past differs, not the oscillator.
STARTS = ("x0", "v0", DIRECTION)
#: The dimension of the different sets of parameters in a table.
SETS = "set"
#: Number of section states read at a time.
_PART = 500_000


@dataclass(frozen=True)
class GridIndex:
    """The parameter point and the start of each point of a file."""

    #: Shape of the grid of parameter points: the grid of the file without its ``STARTS``. For
    #: a table, the number of its different sets of parameters; () if there is only one.
    shape: tuple[int, ...]
    parameters: tuple[str, ...]  # the axes of this grid, or ``SETS``
    #: parameter, start: indices of the parameter point and of the start of each point, all in
    #: C order; int, shape (n,).
    parameter: np.ndarray
    start: np.ndarray
    #: The parameters at each parameter point, with an arbitrary start; dtype POINT, shape
    #: (count,).
    oscillators: np.ndarray

    @classmethod
    def of(cls, dataset: xr.Dataset) -> Self:
        """Index the points of an opened sweep, or of a cut through one."""
        if TABLE in dataset["status"].dims:
            return cls(*_sets(points_of(dataset)))
        sizes = {str(name): size for name, size in dataset["status"].sizes.items()}
        parameters = {name: size for name, size in sizes.items() if name not in STARTS}

        def numbers(kept: Collection[str]) -> np.ndarray:
            """Number the points along the axes `kept`, ignoring the other axes."""
            counted = [size if name in kept else 1 for name, size in sizes.items()]
            grid = np.arange(math.prod(counted)).reshape(counted)
            return np.broadcast_to(grid, tuple(sizes.values())).ravel()

        return cls(
            tuple(parameters.values()),
            tuple(parameters),
            numbers(parameters),
            numbers(STARTS),
            points_of(dataset.isel({name: 0 for name in STARTS if name in sizes})),
        )

    @property
    def count(self) -> int:
        """Number of parameter points."""
        return math.prod(self.shape)

    def cycles(self, at: np.ndarray, states: np.ndarray) -> Cycles:
        """Return section states (x, v) at the points `at`, shape (k, m, 2), as `Cycles`."""
        parameter, states = self.parameter[at], states.copy()
        states[:, :, 0] -= self.oscillators["clearance"][parameter, None]
        states[:, :, 1] /= self.oscillators["omega"][parameter, None]
        return Cycles(states, self.oscillators["R"][parameter])

    def at_states(self, at: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the parameters of the points `at`, with these states as their starts."""
        points = self.oscillators[self.parameter[at]]
        points["x0"], points["v0"] = x, v
        return points


def _sets(
    points: np.ndarray,
) -> tuple[tuple[int, ...], tuple[str, ...], np.ndarray, np.ndarray, np.ndarray]:
    """Return the fields of `GridIndex` for the rows of a table."""
    rows = np.stack([points[name] for name in PARAMETERS if name not in STARTS], axis=1)
    different, first, of_row = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    if len(different) == len(rows) > 1:
        raise Refused("attractors need several starts, and no rows of the table differ in x0 or v0")
    order = np.argsort(of_row, kind="stable")
    start = np.empty(len(rows), np.int64)
    start[order] = np.arange(len(rows)) - np.searchsorted(of_row[order], of_row[order])
    several = len(different) > 1
    return (len(different),) * several, (SETS,) * several, of_row, start, points[first]


def points_of(dataset: xr.Dataset) -> np.ndarray:
    """Return the points of an opened sweep, of dtype POINT, in C order."""
    points = np.empty(dataset["status"].size, POINT)
    for name in PARAMETERS:
        points[name] = parameter_at_points(dataset, name)
    return points


def parameter_at_points(dataset: xr.Dataset, name: str) -> np.ndarray:
    """Return a parameter, swept or not, at every point of an opened sweep, in C order."""
    status = dataset["status"]
    return dataset[name].broadcast_like(status).transpose(*status.dims).values.ravel()


class Groups:
    """Groups of equal periodic motions, found within parts of a file and then across the parts."""

    def __init__(self, points: GridIndex, tolerance: float) -> None:
        self._points, self._tolerance = points, tolerance
        #: The point that represents the motion of each point; -1 if the motion is not periodic.
        self.representative = np.full(len(points.parameter), -1)
        #: The last state of every record.
        self.last = np.empty((len(points.parameter), 2))
        self._parts: dict[int, list[tuple[np.ndarray, np.ndarray]]] = {}

    def add_records(self, dataset: xr.Dataset, period: np.ndarray) -> None:
        """Add the motions of a file; `period`, shape (n,), is 0 for motions that do not repeat."""
        for cut, states in _ends(dataset, period):
            self.last[cut] = states[:, -1]
            for m in (np.flatnonzero(np.bincount(period[cut])[1:]) + 1).tolist():
                rows = np.flatnonzero(period[cut] == m)
                self._add(cut.start + rows, states[rows, -m:])

    def add_cycles(self, cycles: Mapping[int, np.ndarray]) -> None:
        """Add motions, given by their points and section states of shape (m, 2)."""
        for m in sorted(set(map(len, cycles.values()))):
            at = [i for i, cycle in cycles.items() if len(cycle) == m]
            self._add(np.array(at), np.array([cycles[i] for i in at]))

    def _add(self, at: np.ndarray, states: np.ndarray) -> None:
        """Add the motions at the points `at`, with section states of shape (k, m, 2)."""
        self.last[at] = states[:, -1]
        cycles = self._points.cycles(at, states)
        turns = shortest_turn(cycles.states, self._tolerance)
        for turn in np.flatnonzero(np.bincount(turns)).tolist():
            members = np.flatnonzero(turns == turn)
            heads = self._represent(at[members], cycles[members].last(turn), self.representative)
            heads = members[heads]
            self._parts.setdefault(turn, []).append((at[heads], cycles.states[heads, -turn:]))

    def join(self) -> PeriodicAttractors:
        """Merge equal motions of different parts, and return the representatives."""
        final, parameter = np.arange(len(self.representative)), self._points.parameter
        heads_of, cycles_of = [np.empty((3, 0), np.int64)], {}
        for m, parts in self._parts.items():
            at, states = (np.concatenate(column) for column in zip(*parts, strict=True))
            cycles = Cycles(states, self._points.oscillators["R"][parameter[at]])
            heads = self._represent(at, cycles, final)
            heads_of.append(np.stack([at[heads], np.full(len(heads), m), np.arange(len(heads))]))
            cycles_of[m] = cycles[heads]
        found = self.representative >= 0
        self.representative[found] = final[self.representative[found]]
        at, m, place = np.concatenate(heads_of, axis=1)
        order = np.lexsort((at, parameter[at]))
        at = at[order]
        return PeriodicAttractors(at, parameter[at], m[order], place[order], cycles_of)

    def _represent(self, at: np.ndarray, cycles: Cycles, representative: np.ndarray) -> np.ndarray:
        """Store the representative of each point in `at`; return the places of those in `at`."""
        places = representatives(cycles, self._points.parameter[at], self._tolerance)
        representative[at] = at[places]
        return np.flatnonzero(places == np.arange(len(places)))


def _ends(dataset: xr.Dataset, period: np.ndarray) -> Iterator[tuple[slice, np.ndarray]]:
    """Read the last section states of all points in parts, over the longest period in each part.

    Yields a slice of k points in C order, and their states, shape (k, longest period, 2).
    """
    for part, cut in in_parts(dataset, _PART // max(1, int(period.max(initial=1)))):
        last = np.s_[..., -max(1, int(period[cut].max(initial=1))) :]
        x, v = (part[name][last].values for name in ("poincare_x", "poincare_v"))
        yield cut, np.stack([x, v], axis=-1).reshape(cut.stop - cut.start, -1, 2)


def records(dataset: xr.Dataset, name: str, at: np.ndarray) -> np.ndarray:
    """Return a coordinate at points given in C order, shape (k, record), reading in parts."""
    width = dataset.sizes[COORDINATES[name].dimension]
    result = np.empty((len(at), width))
    for part, cut in in_parts(dataset, _PART // width):
        wanted = np.flatnonzero((at >= cut.start) & (at < cut.stop))
        if len(wanted):
            values = recorded_coordinate(part, name).values.reshape(-1, width)
            result[wanted] = values[at[wanted] - cut.start]
    return result


def in_parts(dataset: xr.Dataset, size: int) -> Iterator[tuple[xr.Dataset, slice]]:
    """Yield parts of at most `size` points (at least 1), each with its slice of all in C order."""
    sizes, stop = dataset["status"].sizes, 0
    grid = Grid({str(name): np.empty(length) for name, length in sizes.items()}, {})
    for block in grid.blocks(max(1, size)):
        start, stop = stop, stop + block_points(block)
        yield dataset.isel(dict(zip(sizes, block, strict=True))), slice(start, stop)
