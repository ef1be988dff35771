"""Points of a sweep in groups: all starts at each parameter point, and its place in the grid."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Self

import numpy as np
import xarray as xr

from sweeps.errors import Refused
from sweeps.grid import TABLE
from sweeps.store import DIRECTION
from vibroimpact.oscillator import PARAMETERS, POINT

#: Axes along which only the start or the past differs, not the oscillator.
START_AXES = ("x0", "v0", DIRECTION)
#: The dimension of the different sets of parameters in a table.
SETS = "set"


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
    def of(cls, dataset: xr.Dataset) -> Self:
        """Index the points of an opened sweep, or of a cut through one."""
        if TABLE in dataset["status"].dims:
            return cls(*_sets(points_of(dataset)))
        sizes = {str(name): size for name, size in dataset["status"].sizes.items()}
        parameters = {name: size for name, size in sizes.items() if name not in START_AXES}

        def numbers(kept: Collection[str]) -> np.ndarray:
            """Number the points along the axes `kept`, ignoring the other axes."""
            counted = [size if name in kept else 1 for name, size in sizes.items()]
            grid = np.arange(math.prod(counted)).reshape(counted)
            return np.broadcast_to(grid, tuple(sizes.values())).ravel()

        return cls(
            tuple(parameters.values()),
            tuple(parameters),
            numbers(parameters),
            numbers(START_AXES),
        )

    @property
    def count(self) -> int:
        """Number of parameter points."""
        return math.prod(self.shape)


def _sets(points: np.ndarray) -> tuple[tuple[int, ...], tuple[str, ...], np.ndarray, np.ndarray]:
    """Return the fields of `GridIndex` for the rows of a table."""
    rows = np.stack([points[name] for name in PARAMETERS if name not in START_AXES], axis=1)
    different, of_row = np.unique(rows, axis=0, return_inverse=True)
    if len(different) == len(rows) > 1:
        raise Refused("attractors need several starts, and no rows of the table differ in x0 or v0")
    order = np.argsort(of_row, kind="stable")
    start = np.empty(len(rows), np.int64)
    start[order] = np.arange(len(rows)) - np.searchsorted(of_row[order], of_row[order])
    several = len(different) > 1
    return (len(different),) * several, (SETS,) * several, of_row, start


def points_of(dataset: xr.Dataset, at: np.ndarray | slice = np.s_[:]) -> np.ndarray:
    """Return the points of an opened sweep, of dtype POINT, in C order; or those `at` these."""
    columns = {name: parameter_at_points(dataset, name)[at] for name in PARAMETERS}
    points = np.empty(len(columns["h"]), POINT)
    for name, column in columns.items():
        points[name] = column
    return points


def parameter_at_points(dataset: xr.Dataset, name: str) -> np.ndarray:
    """Return a parameter, swept or not, at every point of an opened sweep, in C order."""
    values: np.ndarray = dataset[name].variable.set_dims(dataset["status"].sizes).values
    return values.ravel()
