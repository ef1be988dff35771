"""Insert points where the class of the motion changes along an axis, to bracket the change.

The interval between two neighbours of different classes is halved repeatedly: each half whose ends
still differ in class is halved again. If the class in the middle is a third one, both halves are.

A periodic motion has the class of its destination (`vibroimpact.destination`), whatever its record
shows, and the orbit itself is recorded. A motion without a class is computed again for four times
as long, up to ``MOST_EXTENSIONS`` times. Close to a flip no motion settles in this time, so the
class is then that of a stable orbit near by, although the motion was not shown to reach it. If the
class in the middle of an interval is still unknown, the interval is not halved further. If grid
points of unknown class lie within an interval, its middle may be one of them, which is then
computed longer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from sweeps.analysis.regimes import Label, Regime, changes, labels
from sweeps.analysis.selection import dataset_of
from sweeps.config.sweep import SweepConfig
from sweeps.engine.compute import Results, compute
from sweeps.store import VARIABLES
from vibroimpact.oscillator import mesh
from vibroimpact.points.destinations import destinations
from vibroimpact.status import Evidence

#: Most intervals halved at the same time: a chaotic range has windows everywhere.
MOST_INTERVALS = 1000
#: How often a motion of unknown class is computed again, each time four times as long.
MOST_EXTENSIONS = 3


@dataclass(frozen=True)
class ClassifiedPoint:
    """A value of the swept axis, the class of its motion (None if unknown) and its results."""

    value: float
    label: Label | None
    results: Results

    @property
    def state(self) -> tuple[float, float]:
        """State (x, v) at the last section."""
        return float(self.results["poincare_x"][-1]), float(self.results["poincare_v"][-1])


class Classifier:
    """Computes points along the only axis of a sweep, and finds the classes of their motions."""

    def __init__(self, config: SweepConfig, threads: int | None = None) -> None:
        self._config, self._sweep, self._threads = config, config.sweep, threads
        (self._axis,) = self._sweep.grid.axes

    def compute(
        self, values: np.ndarray, starts: np.ndarray | None = None
    ) -> list[ClassifiedPoint]:
        """Compute points, longer where their classes remain unknown.

        They start from `starts`, the states (x, v) at the section, shape (n, 2); by default from
        the start of the sweep at t = 0.
        """
        points = [ClassifiedPoint(float(value), None, {}) for value in values]
        remaining, spec = np.arange(len(values)), self._sweep.spec
        for extension in range(MOST_EXTENSIONS + 1):
            if not remaining.size:
                break
            from_states = None if starts is None else starts[remaining]
            transient = 4**extension * (spec.transient + spec.periods) - spec.periods
            results = self._run(values[remaining], from_states, transient)
            last = extension == MOST_EXTENSIONS
            classified = self.classify(values[remaining], results, near_enough=last)
            for i, point in zip(remaining.tolist(), classified, strict=True):
                points[i] = point
            remaining = np.array([i for i in remaining.tolist() if points[i].label is None], int)
        return points

    def classify(
        self, values: np.ndarray, results: Results, near_enough: bool = False
    ) -> list[ClassifiedPoint]:
        """Find the class of each motion; if it is periodic, replace its record by the orbit's.

        If an orbit near by is `near_enough`, the motion need not be shown to reach it.
        """
        results = {name: array.copy() for name, array in results.items()}
        if near_enough:
            points = mesh({self._axis: values}, self._sweep.grid.fixed)
            found = destinations(self._sweep.spec, points, results)
            rows = found["evidence"] == Evidence.UNREACHED
            columns = {"period": "m", "period_impacts": "q", "orbit_x": "x", "orbit_v": "v"}
            for name, field in columns.items():
                results[name][rows] = found[field][rows]
        known = labels(dataset_of(self._config, {self._axis: values}, results))
        periodic = [i for i, label in enumerate(known) if label and label.regime is Regime.PERIODIC]
        orbits = np.stack([results["orbit_x"][periodic], results["orbit_v"][periodic]], axis=1)
        for name, array in self._run(values[periodic], orbits, 0).items():
            if name not in ("period", "period_impacts"):  # a short record may not show them
                results[name][periodic] = array
        # The record is that of the orbit, also where the motion was not shown to reach it.
        rows = [i for i in periodic if results["class_evidence"][i] <= Evidence.UNREACHED]
        for name in ("x", "v"):
            results[f"orbit_{name}"][rows] = results[f"poincare_{name}"][rows, -1]
        results["orbit_distance"][rows] = 0.0
        results["class_evidence"][rows] = Evidence.REPEATS
        return [
            ClassifiedPoint(
                float(value), label, {name: array[i] for name, array in results.items()}
            )
            for i, (value, label) in enumerate(zip(values, known, strict=True))
        ]

    def _run(
        self, values: np.ndarray, starts: np.ndarray | None, transient: int
    ) -> dict[str, np.ndarray]:
        """Compute points from states at the section; by default from the start of the sweep."""
        spec = replace(self._sweep.spec, transient=transient)
        points = mesh({self._axis: values}, self._sweep.grid.fixed)
        if starts is not None:
            points["x0"], points["v0"] = starts.T
            points["x0"] = np.minimum(points["x0"], points["clearance"])  # as in a followed sweep
        return compute(spec, points, self._threads, at_section=starts is not None)


Interval = tuple[ClassifiedPoint, ClassifiedPoint]


class Refinement:
    """The refinement of a sweep whose grid is computed; iterating over it halves the intervals.

    If the axis is followed, a new point starts from its neighbour, the previous one in the
    direction of following.
    """

    def __init__(self, config: SweepConfig, line: xr.Dataset, threads: int | None = None) -> None:
        assert config.refine is not None
        self._levels, self._axis = config.refine.levels, config.refine.axis
        self._followed = config.follow.direction if config.follow else None
        self._classifier = Classifier(config, threads)
        self._values = line[self._axis].values
        #: The results to write to the file, by the value of the axis: for new points, and for grid
        #: points whose record does not show the class of the attractor.
        self.points: dict[float, Results] = {}
        #: Number of intervals that are not halved because there were too many; they lie at higher
        #: values of the axis.
        self.left_out = 0
        #: The ends of the intervals that are halved next.
        self.intervals = self._fewer(list(_intervals(list(self._grid(line)))))

    def __iter__(self) -> Iterator[int]:
        """Yield the number of each level once its intervals are halved."""
        for level in range(1, self._levels + 1):
            if self.intervals:
                self._halve()
                yield level

    def _grid(self, line: xr.Dataset) -> Iterator[ClassifiedPoint]:
        """Yield the grid points on both sides of each change of class, with the true classes."""
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
        """Replace every interval by its halves, if their ends differ in class."""
        middles = np.array([self._middle(low.value, high.value) for low, high in self.intervals])
        starts = None
        if self._followed:
            first = 0 if self._followed == "up" else 1
            starts = np.array([interval[first].state for interval in self.intervals])
        halves: list[Interval] = []
        points = self._classifier.compute(middles, starts)
        for (low, high), middle in zip(self.intervals, points, strict=True):
            if middle.value in (low.value, high.value):  # no floating-point number lies between
                continue
            if middle.label or middle.value not in self._values:
                self.points[middle.value] = middle.results
            halves += _intervals([low, middle, high]) if middle.label else ()
        self.intervals = self._fewer(halves)

    def _fewer(self, intervals: list[Interval]) -> list[Interval]:
        """Return the first ``MOST_INTERVALS`` intervals; add the number of others to `left_out`."""
        self.left_out += max(0, len(intervals) - MOST_INTERVALS)
        return intervals[:MOST_INTERVALS]

    def _middle(self, low: float, high: float) -> float:
        """Return the middle of an interval, or the grid value there if they differ by rounding."""
        middle = 0.5 * (low + high)
        value = self._values[np.searchsorted(self._values, middle - 1e-9 * (high - low))]
        return float(value) if low < value <= middle + 1e-9 * (high - low) else middle


def _beside_changes(classes: np.ndarray) -> np.ndarray:
    """Return the indices on both sides of each change of class, ignoring unknown classes (-1)."""
    labelled = np.flatnonzero(classes >= 0)
    before = np.flatnonzero(np.diff(classes[labelled]))
    return np.union1d(labelled[before], labelled[before + 1])


def _intervals(points: Sequence[ClassifiedPoint]) -> Iterator[Interval]:
    """Yield neighbours of different classes, ignoring points of unknown class."""
    values = np.array([point.value for point in points])
    by_value = {point.value: point for point in points}
    for change in changes(values, [point.label for point in points]):
        yield by_value[change.low], by_value[change.high]
