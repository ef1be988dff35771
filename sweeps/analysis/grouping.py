"""Group the periodic motions of a sweep that are the same, reading a part of the file at a time."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
import xarray as xr

from sweeps.analysis.section_distance import Cycles, representatives, shortest_turn
from sweeps.analysis.selection import COORDINATES, recorded_coordinate
from sweeps.errors import Refused
from sweeps.grid import TABLE, Block, Grid
from sweeps.store import DIRECTION
from vibroimpact.oscillator import PARAMETERS, POINT

#: Axes along which the oscillator is the same and only its past differs.
STARTS = ("x0", "v0", DIRECTION)
#: The dimension of the sets of parameters of a table.
SETS = "set"
#: Section states that are read at a time.
_PART = 4_000_000


@dataclass(frozen=True)
class GridIndex:
    """The points of a file in C order: the parameter point and the start of each.

    Attributes
    ----------
    shape : tuple of int
        Of the grid of parameter points, which is that of the file without its ``STARTS``; of a
        table, the number of its different sets of parameters, if there are several.
    parameters : tuple of str
        Its axes, or ``SETS``.
    parameter, start : ndarray of int, shape (n,)
        The number of the parameter point and of the start, each in C order.
    points : ndarray of dtype POINT, shape (n,)
        Their parameters.
    """

    shape: tuple[int, ...]
    parameters: tuple[str, ...]
    parameter: np.ndarray
    start: np.ndarray
    points: np.ndarray

    @classmethod
    def of(cls, dataset: xr.Dataset) -> Self:
        """Number the points of an opened sweep, or of a cut through one."""
        points = points_of(dataset)
        if TABLE in dataset["status"].dims:
            return cls(*_sets(points), points)
        sizes = {str(name): size for name, size in dataset["status"].sizes.items()}
        parameters = {name: size for name, size in sizes.items() if name not in STARTS}

        def numbers(kept: Collection[str]) -> np.ndarray:
            """Count the points along the axes kept; points that differ along others are one."""
            counted = [size if name in kept else 1 for name, size in sizes.items()]
            grid = np.arange(math.prod(counted)).reshape(counted)
            return np.broadcast_to(grid, tuple(sizes.values())).ravel()

        return cls(
            tuple(parameters.values()),
            tuple(parameters),
            numbers(parameters),
            numbers(STARTS),
            points,
        )

    @property
    def count(self) -> int:
        """Number of parameter points."""
        return math.prod(self.shape)

    def cycles(self, at: np.ndarray, states: np.ndarray) -> Cycles:
        """Return the cycles of section states (x, v) of points, shape (k, m, 2)."""
        omega, clearance, R = (self.points[name][at] for name in ("omega", "clearance", "R"))
        from_stop = states[:, :, 0] - clearance[:, None]
        return Cycles(np.stack([from_stop, states[:, :, 1] / omega[:, None]], axis=2), R)


def _sets(points: np.ndarray) -> tuple[tuple[int, ...], tuple[str, ...], np.ndarray, np.ndarray]:
    """Return the shape and axis of the sets of parameters of a table; each row's set and start."""
    rows = np.stack([points[name] for name in PARAMETERS if name not in STARTS], axis=1)
    different, of_row = np.unique(rows, axis=0, return_inverse=True)
    if len(different) == len(rows) > 1:
        raise Refused("attractors need several starts, and no rows of the table differ in x0 or v0")
    order = np.argsort(of_row, kind="stable")
    start = np.empty(len(rows), np.int64)
    start[order] = np.arange(len(rows)) - np.searchsorted(of_row[order], of_row[order])
    several = len(different) > 1
    return (len(different),) * several, (SETS,) * several, of_row, start


def points_of(dataset: xr.Dataset) -> np.ndarray:
    """Return the points of an opened sweep, of dtype POINT, in C order."""
    points = np.empty(dataset["status"].size, POINT)
    for name in PARAMETERS:
        points[name] = parameter_at_points(dataset, name)
    return points


def parameter_at_points(dataset: xr.Dataset, name: str) -> np.ndarray:
    """Return a parameter, swept or not, at every point of an opened sweep, in C order."""
    whole = xr.zeros_like(dataset["status"], float) + dataset[name]
    return whole.transpose(*dataset["status"].dims).values.ravel()


@dataclass(frozen=True)
class Groups:
    """Groups of points whose periodic motions are the same; one point of each represents it.

    Attributes
    ----------
    representative : ndarray of int, shape (n,)
        That of each point of the file; -1 where the motion is not periodic.
    by_period : mapping of int to ndarray of int, shape (k,)
        The representatives, by their number of forcing periods.
    cycles : mapping of int to Cycles
        Those of the representatives.
    last : ndarray, shape (n, 2)
        The last state of every record.
    """

    representative: np.ndarray
    by_period: Mapping[int, np.ndarray]
    cycles: Mapping[int, Cycles]
    last: np.ndarray


def group_periodic(
    dataset: xr.Dataset,
    points: GridIndex,
    period: np.ndarray,
    cycles: Mapping[int, np.ndarray],
    tolerance: float,
) -> Groups:
    """Group the periodic motions that are the same, within parts of the file and then among these.

    `period` has the forcing periods of each point's motion, 0 where it is not periodic, and
    `cycles` the section states, shape (m, 2), of the points whose record does not show their
    motion.
    """
    first, last = np.full(period.size, -1), np.empty((period.size, 2))
    parts: dict[int, list[tuple[np.ndarray, np.ndarray]]] = {}
    replaced = np.fromiter(cycles, np.int64, len(cycles))
    for at, states in _ends(dataset, period):
        for row in np.flatnonzero(np.isin(at, replaced)).tolist():
            cycle = cycles[int(at[row])]
            states[row, -len(cycle) :] = cycle
        last[at] = states[:, -1]
        for m in np.unique(period[at[period[at] > 0]]).tolist():
            rows = np.flatnonzero(period[at] == m)
            turns = shortest_turn(points.cycles(at[rows], states[rows, -m:]).states, tolerance)
            for turn in np.unique(turns).tolist():
                members = rows[turns == turn]
                heads = _represent(at[members], states[members, -turn:], points, first, tolerance)
                parts.setdefault(turn, []).append(
                    (at[members[heads]], states[members[heads], -turn:])
                )
    final, by_period, heads_of = np.arange(period.size), {}, {}
    for m, pieces in parts.items():
        at, states = (np.concatenate(column) for column in zip(*pieces, strict=True))
        heads = _represent(at, states, points, final, tolerance)
        by_period[m], heads_of[m] = at[heads], points.cycles(at[heads], states[heads])
    return Groups(np.where(first < 0, -1, final[first]), by_period, heads_of, last)


def _ends(dataset: xr.Dataset, period: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Read the last sections of the points, as many as one of them needs, a part at a time.

    Yield numbers of points, (k,), and their states, (k, longest period among them, 2).
    """
    for block, at in _blocks(dataset, max(1, _PART // max(1, int(period.max(initial=1))))):
        longest = max(1, int(period[at].max(initial=1)))
        states = np.full((len(at), longest, 2), np.nan)
        for i, name in enumerate(("poincare_x", "poincare_v")):
            ends = dataset[name][(*block, slice(-longest, None))].values.reshape(len(at), -1)
            states[:, longest - ends.shape[1] :, i] = ends
        yield at, states


def _represent(
    at: np.ndarray,
    states: np.ndarray,
    points: GridIndex,
    representative: np.ndarray,
    tolerance: float,
) -> np.ndarray:
    """Enter the representatives of the points `at`, and return their places in `at`."""
    places = representatives(points.cycles(at, states), points.parameter[at], tolerance)
    representative[at] = at[places]
    return np.unique(places)


def records(dataset: xr.Dataset, name: str, at: np.ndarray) -> np.ndarray:
    """Read a coordinate at points in C order, shape (k, record), a part of the file at a time."""
    width = dataset.sizes[COORDINATES[name].record]
    result = np.empty((len(at), width))
    for block, numbers in _blocks(dataset, max(1, _PART // width)):
        wanted = np.flatnonzero(np.isin(at, numbers))
        if len(wanted):
            rows = np.searchsorted(numbers, at[wanted])
            part = dataset.isel(dict(zip(dataset["status"].dims, block, strict=True)))
            result[wanted] = recorded_coordinate(part, name).values.reshape(len(numbers), -1)[rows]
    return result


def grid_of(dataset: xr.Dataset) -> Grid:
    """Return a grid with as many values along each dimension as the file has."""
    sizes = dataset["status"].sizes
    return Grid({str(name): np.empty(length) for name, length in sizes.items()}, {})


def _blocks(dataset: xr.Dataset, size: int) -> Iterator[tuple[Block, np.ndarray]]:
    """Split the file into blocks of at most `size` points, with the numbers of these."""
    grid = grid_of(dataset)
    numbers = np.arange(grid.size).reshape(grid.shape)
    for block in grid.blocks(size):
        yield block, numbers[block].ravel()
