"""`Sweep`: a `Grid` of axes, points and blocks, and what is computed of its points; its `Cost`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from vibroimpact.oscillator import POINT, mesh, parameters_of
from vibroimpact.points.stages import RunSpec

Block = tuple[slice, ...]

#: Name of the axis of a sweep over the rows of a table.
TABLE = "point"

#: Range of f in which its square neither overflows nor loses digits.
_LEAST_F, _GREATEST_F = 1e-150, 1e150


def box_shape(block: Block) -> tuple[int, ...]:
    """Return the number of values of a block along each axis."""
    return tuple(cut.stop - cut.start for cut in block)


def block_points(block: Block) -> int:
    """Return the number of points in a block."""
    return math.prod(box_shape(block))


def table_values(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Combine columns of equal length into a structured array: the values of axis ``TABLE``."""
    length = len(next(iter(columns.values())))
    table = np.empty(length, [(name, values.dtype) for name, values in columns.items()])
    for name, values in columns.items():
        table[name] = values
    return table


@dataclass(frozen=True, eq=False)  # arrays do not compare
class Grid:
    """The Cartesian product of the swept axes."""

    #: The swept parameters and their values, slowest first. For a table, only ``TABLE`` with a
    #: structured array, which has a field for each parameter and each further column.
    axes: Mapping[str, np.ndarray]
    fixed: Mapping[str, float]  # the value of every parameter that is not swept

    @property
    def swept(self) -> dict[str, np.ndarray]:
        """The values along its axis of each parameter that is not fixed."""
        groups = (parameters_of(axis, values) for axis, values in self.axes.items())
        return {name: values for group in groups for name, values in group.items()}

    @property
    def scales_with_f(self) -> bool:
        """Whether f is swept and all motions are proportional to it (``points/computation.py``)."""
        at_rest = all(self.fixed.get(name) == 0.0 for name in ("clearance", "a", "x0", "v0"))
        f = self.swept.get("f", np.ones(1))
        return at_rest and bool(len(f) > 1 and _LEAST_F <= f.min() and f.max() <= _GREATEST_F)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values along each axis."""
        return tuple(len(values) for values in self.axes.values())

    @property
    def size(self) -> int:
        """Number of parameter points."""
        return math.prod(self.shape)

    def blocks(self, size: int, unsplit: str | None = None) -> Iterator[Block]:
        """Split the grid into boxes of at most `size` points, in C order.

        The boxes cover each point exactly once. All have the same shape, except those at the end of
        the split axis. The axis `unsplit` is never split, even if it is longer than `size`.
        """
        room = max(1, size // (1 if unsplit is None else len(self.axes[unsplit])))
        cuts_of_axes: list[list[slice]] = []
        # Backwards from the last axis: whole axes while they fit, then one axis in parts, and every
        # axis before it value by value.
        for name, values in reversed(list(self.axes.items())):
            n = len(values)
            parts = 1 if name == unsplit else math.ceil(n / room)
            length = math.ceil(n / parts)
            starts = range(0, n, length)
            cuts_of_axes.append([slice(start, min(start + length, n)) for start in starts])
            if name != unsplit:
                room = room // n if parts == 1 else 1
        yield from itertools.product(*reversed(cuts_of_axes))

    def points(self, block: Block | None = None) -> np.ndarray:
        """Return the parameter points of a block, or all, of dtype POINT, in C order."""
        cuts = [slice(None)] * len(self.axes) if block is None else block
        pairs = zip(self.axes.items(), cuts, strict=True)
        return mesh({name: values[cut] for (name, values), cut in pairs}, self.fixed)

    def numbered(self, numbers: np.ndarray) -> np.ndarray:
        """Return the points, of dtype POINT, with these indices in C order over the grid."""
        points = np.empty(len(numbers), POINT)
        for name, value in self.fixed.items():
            points[name] = value
        for axis, values in reversed(list(self.axes.items())):
            for name, column in parameters_of(axis, values).items():
                points[name] = column[numbers % len(values)]
            numbers = numbers // len(values)
        return points

    def along(self, name: str) -> np.ndarray:
        """Return the values of a parameter, in a shape that is broadcast against the grid."""
        for number, (axis, values) in enumerate(self.axes.items(), 1):
            if name in (columns := parameters_of(axis, values)):
                return columns[name].reshape(-1, *(1,) * (len(self.axes) - number))
        return np.asarray(self.fixed[name])

    def spread(self, count: int) -> np.ndarray:
        """Return about `count` points spread evenly over the grid, the same at every call.

        In C order, one is taken of each of `count` equal parts; the golden ratio says which. A grid
        of at most `count` points is returned completely.
        """
        if self.size <= count:
            return self.points()
        k = np.arange(count)
        numbers = (k + 0.6180339887498949 * k % 1.0) * (self.size / count)
        return self.numbered(np.unique(numbers.astype(np.int64)))


@dataclass(frozen=True, eq=False)
class Sweep:
    """What a configuration computes: the points of a grid, and the same quantities of each."""

    grid: Grid
    spec: RunSpec

    @property
    def size(self) -> int:
        """Number of points to compute, counting each direction of a followed axis."""
        return self.grid.size * max(1, len(self.spec.directions))

    @property
    def most_periods(self) -> int:
        """Most forcing periods of a point: those that are left out, and those that are kept."""
        spec = self.spec
        return (spec.transient if spec.longest is None else spec.longest) + spec.periods

    @property
    def known_periods(self) -> int | None:
        """Forcing periods of every point; None if each has its own, or some points are scaled."""
        return None if self.spec.scaled or self.spec.longest is not None else self.most_periods


@dataclass(frozen=True)
class Cost:
    """The expected cost of a sweep."""

    #: Extrapolated from short trials, which cannot show later changes of the motions; it excludes
    #: compilation and other processes.
    seconds: float
    #: Size of the complete file without compression, with as many samples at impacts as in the
    #: trials [bytes].
    file: int
    memory: int  # for the blocks [bytes]
    block: int  # number of points in a block
