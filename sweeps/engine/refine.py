"""Insert points where the class of the motion changes along an axis, to bracket the change.

The interval between two neighbours of different classes is halved, again and again, and the half
goes on whose ends still differ; both do where the class in the middle is a third one. The
class beside a bifurcation is found in ``classification.py``. An interval in whose middle it is not
known is left as it is. Where there are points of no known class between two values, their middle
may be one of them, which is then followed longer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr

from sweeps.analysis.class_changes import Label, changes, labels
from sweeps.config.sweep import SweepConfig
from sweeps.engine.classification import ClassifiedPoint, Classifier, Results
from sweeps.store import VARIABLES

#: Intervals that are halved at the same time, at most: a chaotic range has windows everywhere.
MOST_INTERVALS = 1000

Interval = tuple[ClassifiedPoint, ClassifiedPoint]


class Refinement:
    """The refinement of a sweep whose grid is computed; iterating over it halves the intervals.

    Parameters
    ----------
    config : SweepConfig
        With ``refine``. Where the axis is followed, a new point starts from the neighbour that
        comes before it.
    line : Dataset
        The computed sweep.
    threads : int, optional

    Attributes
    ----------
    intervals : list of tuple of ClassifiedPoint
        The ends of those that are halved next.
    left_out : int
        Number of further intervals, at higher values of the axis, which are not halved.
    points : dict of float to mapping
        By the value of the axis, the results to put into the file: of new points, and of those
        of the grid whose record does not show the class of the attractor.
    """

    def __init__(self, config: SweepConfig, line: xr.Dataset, threads: int | None = None) -> None:
        assert config.refine is not None
        self._levels, self._axis = config.refine.levels, config.refine.axis
        self._followed = config.follow.direction if config.follow else None
        self._classifier = Classifier(config, threads)
        self._values = line[self._axis].values
        self.points: dict[float, Results] = {}
        self.left_out = 0
        self.intervals = self._fewer(list(_intervals(list(self._grid(line)))))

    def __iter__(self) -> Iterator[int]:
        """Yield the number of each level once its intervals are halved."""
        for level in range(1, self._levels + 1):
            if self.intervals:
                self._halve()
                yield level

    def _grid(self, line: xr.Dataset) -> Iterator[ClassifiedPoint]:
        """Yield the points of the grid beside a change of class, with the attractors' classes."""
        shown = labels(line)
        numbers: dict[Label | None, int] = {None: -1}
        classes = np.array([numbers.setdefault(label, len(numbers)) for label in shown])
        added: dict[int, ClassifiedPoint] = {}
        while (at := np.setdiff1d(_beside_changes(classes), list(added))).size:
            results = {
                name: line[name].isel({self._axis: at}).values for name in VARIABLES if name in line
            }
            points = self._classifier.classify(self._values[at], results)
            for i, point in zip(at.tolist(), points, strict=True):
                if point.label not in (None, shown[i]):
                    self.points[point.value] = point.results
                added[i] = point
                classes[i] = numbers.setdefault(point.label, len(numbers))
        for i in sorted(added):
            yield added[i]

    def _halve(self) -> None:
        """Replace every interval by those of its halves whose ends differ in class."""
        middles = np.array([self._middle(low.value, high.value) for low, high in self.intervals])
        starts = None
        if self._followed:
            first = 0 if self._followed == "up" else 1
            starts = np.array([interval[first].state for interval in self.intervals])
        halves: list[Interval] = []
        points = self._classifier.compute(middles, starts)
        for (low, high), middle in zip(self.intervals, points, strict=True):
            if middle.value in (low.value, high.value):  # they are next to each other
                continue
            if middle.label or middle.value not in self._values:
                self.points[middle.value] = middle.results
            halves += _intervals([low, middle, high]) if middle.label else ()
        self.intervals = self._fewer(halves)

    def _fewer(self, intervals: list[Interval]) -> list[Interval]:
        """Return at most ``MOST_INTERVALS``; add the number of the rest to `left_out`."""
        self.left_out += max(0, len(intervals) - MOST_INTERVALS)
        return intervals[:MOST_INTERVALS]

    def _middle(self, low: float, high: float) -> float:
        """Return the middle of an interval, or the grid value there if they differ by rounding."""
        middle = 0.5 * (low + high)
        value = self._values[np.searchsorted(self._values, middle - 1e-9 * (high - low))]
        return float(value) if low < value <= middle + 1e-9 * (high - low) else middle


def _beside_changes(classes: np.ndarray) -> np.ndarray:
    """Return the indices on either side of a change, among the classes known: those >= 0."""
    labelled = np.flatnonzero(classes >= 0)
    before = np.flatnonzero(np.diff(classes[labelled]))
    return np.union1d(labelled[before], labelled[before + 1])


def _intervals(points: Sequence[ClassifiedPoint]) -> Iterator[Interval]:
    """Yield the neighbours of different classes, among the points whose class is known."""
    values = np.array([point.value for point in points])
    by_value = {point.value: point for point in points}
    for change in changes(values, [point.label for point in points]):
        yield by_value[change.low], by_value[change.high]
