"""Further points where the class of the motion changes along an axis, to bracket the change.

The interval between two neighbours of different classes is halved, `levels` times, and the half
goes on whose ends still differ; both do where the class in the middle is a third one. Beside a
bifurcation motions settle ever more slowly, and a record shows a class that is not the attractor's,
or none. So the class of a motion that neither rests nor is chaotic is that of the periodic orbit
which shooting finds from its last section (`vibroimpact.periodic`), where that is stable; a
motion from which none is found is followed four times as long, ``LONGER`` times over, and then
left as it is. What is recorded of such a point is the orbit itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
import xarray as xr

from sweeps.changes import Label, changes, label_of, labels
from sweeps.classes import Motion
from sweeps.compute import compute
from sweeps.config import SweepConfig
from sweeps.variables import VARIABLES
from vibroimpact.diagnostics import LONGEST_PERIOD
from vibroimpact.oscillator import Oscillator
from vibroimpact.periodic import periodic_orbit

#: A motion that does not show its class is followed longer, by a factor of four each time.
LONGER = 3
#: Intervals that are halved at the same time, at most: a chaotic range has a window in every one.
MOST_INTERVALS = 1000
#: An orbit counts as that of a motion if it is as near to its last section, by the section's size.
_NEAR = 0.2
#: Periods that are tried where no repetition was found: those after which it nearly repeats.
_TRIED = 4

Results = dict[str, np.ndarray]


@dataclass(frozen=True)
class Point:
    """A value of the axis with its class, and its results if they are to be put into the file."""

    value: float
    label: Label | None
    results: Results | None = None


class Refinement:
    """The refinement of a sweep whose grid is computed.

    Parameters
    ----------
    config : SweepConfig
        With ``refine``.
    line : Dataset
        The computed sweep.
    threads : int, optional

    Attributes
    ----------
    level : int
        How often the intervals have been halved.
    intervals : list of tuple of Point
        The intervals that are halved next.
    """

    def __init__(self, config: SweepConfig, line: xr.Dataset, threads: int | None = None) -> None:
        assert config.refine is not None
        self._config, self._axis, self._threads = config, config.refine.axis, threads
        self._levels = config.refine.levels
        self._added: dict[float, Point] = {}
        self.level = 0
        self.intervals = self._between(self._certified(line))

    def __iter__(self) -> Iterator[int]:
        """Halve the intervals level by level, yielding the number of each."""
        while self.level < self._levels and self.intervals:
            self._halve()
            self.level += 1
            yield self.level

    def points(self) -> dict[float, Results]:
        """Return the results to put into the file, by increasing values of the axis."""
        added = (self._added[value] for value in sorted(self._added))
        return {point.value: point.results for point in added if point.results is not None}

    def _certified(self, line: xr.Dataset) -> list[Point]:
        """Return the points of the grid, with the true classes where these change."""
        values, classes = line[self._axis].values, labels(line)
        ends = {value for change in changes(values, classes) for value in (change.low, change.high)}
        beside = np.flatnonzero(np.isin(values, list(ends)))
        held = [name for name in VARIABLES if name in line]
        found = self._settled(
            values[beside],
            {name: line[name].isel({self._axis: beside}).values for name in held},
            computed=True,
        )
        by_value = {point.value: point for point in found}
        self._added |= by_value
        return [
            by_value.get(value, Point(value, label))
            for value, label in zip(values.tolist(), classes, strict=True)
        ]

    def _between(self, points: Sequence[Point]) -> list[tuple[Point, Point]]:
        """Return the intervals between neighbours of different classes."""
        known = [point for point in points if point.label is not None]
        values = np.array([point.value for point in known])
        found = changes(values, [point.label for point in known])
        by_value = {point.value: point for point in known}
        return [(by_value[change.low], by_value[change.high]) for change in found]

    def _halve(self) -> None:
        middles = np.array([0.5 * (low.value + high.value) for low, high in self.intervals])
        results = self._run(middles, 1)
        left: list[tuple[Point, Point]] = []
        settled = self._settled(middles, results)
        for (low, high), middle in zip(self.intervals, settled, strict=True):
            self._added[middle.value] = middle
            if middle.label is None or middle.value in (low.value, high.value):
                continue
            halves = ((low, middle), (middle, high))
            left += [(one, other) for one, other in halves if one.label != other.label]
        self.intervals = left[:MOST_INTERVALS]

    def _settled(
        self, values: np.ndarray, results: Results, *, computed: bool = False
    ) -> list[Point]:
        """Return points with their classes; if `computed`, with results only where these change."""
        points: dict[int, Point] = {}
        left = np.arange(len(values))
        for longer in range(LONGER + 1):
            if longer > 0:
                results = self._run(values[left], 4**longer)
            shown = labels(self._line(values[left], results))
            for k, i in enumerate(left.tolist()):
                row = {name: array[k] for name, array in results.items()}
                point = self._classified(float(values[i]), row, shown[k])
                if computed and longer == 0 and point.label == shown[k]:
                    point = Point(point.value, point.label)
                points[i] = point
            left = np.array([i for i in left.tolist() if points[i].label is None], int)
            if not left.size:
                break
        return [points[i] for i in range(len(values))]

    def _classified(self, value: float, row: Results, shown: Label | None) -> Point:
        """Return a point with the class of its motion, and what is to be recorded of it."""
        if shown is not None and shown.motion is not Motion.PERIODIC:
            return Point(value, shown, row)
        if not np.isfinite(row["poincare_x"]).all():
            return Point(value, None, row)
        osc = self._oscillator(value)
        sections = np.stack([row["poincare_x"], row["poincare_v"]], axis=1)
        periods = _nearly_repeats(sections) if shown is None else [shown.m]
        x, v = sections[-1].tolist()
        for m in periods:
            orbit = periodic_orbit(osc, x, v, m, self._config.record.phase)
            if orbit is None or not orbit.stable or orbit.rests:
                continue
            size = np.abs(sections).max(axis=0)
            if (np.abs(orbit.sections[0] - sections[-1]) > _NEAR * size).any():
                continue
            label = label_of(Motion.PERIODIC, orbit.m, orbit.impacts)
            return Point(value, label, self._recorded(value, orbit.sections[0]))
        return Point(value, None, row)

    def _recorded(self, value: float, state: np.ndarray) -> Results:
        """Return the results of a motion that is at a state at the start of its record."""
        points = self._points(np.array([value]))
        points["x0"], points["v0"] = state
        record = self._config.record.model_copy(update={"transient": 0})
        config = self._config.model_copy(update={"record": record})
        results = compute(config, points, self._threads, at_section=True)
        return {name: array[0] for name, array in results.items()}

    def _run(self, values: np.ndarray, longer: int) -> Results:
        """Compute points, after a transient that is `longer` by this factor."""
        transient = self._config.record.transient
        record = self._config.record.model_copy(update={"transient": longer * transient})
        config = self._config.model_copy(update={"record": record})
        return compute(config, self._points(values), self._threads)

    def _points(self, values: np.ndarray) -> np.ndarray:
        return self._config.grid.with_values(self._axis, values)

    def _oscillator(self, value: float) -> Oscillator:
        at = {**self._config.grid.fixed, self._axis: value}
        return Oscillator(**{field.name: at[field.name] for field in fields(Oscillator)})

    def _line(self, values: np.ndarray, results: Mapping[str, np.ndarray]) -> xr.Dataset:
        """Return results as the file of a sweep shows them."""
        variables = {}
        for name, array in results.items():
            record = VARIABLES[name].record
            variables[name] = ((self._axis, record) if record else (self._axis,), array)
        attributes = {"name": self._config.name, "configuration": self._config.to_yaml()}
        return xr.Dataset(variables, {self._axis: values}, attributes)


def _nearly_repeats(sections: np.ndarray) -> list[int]:
    """Return the numbers of periods after which a record nearly repeats, in increasing order."""
    most = min(LONGEST_PERIOD, len(sections) // 2)
    size = np.abs(sections).max(axis=0)
    missed = [
        (np.abs(sections[-m:] - sections[-2 * m : -m]) / size).max() for m in range(1, most + 1)
    ]
    best = np.argsort(missed, kind="stable")[:_TRIED]
    return sorted(int(i) + 1 for i in best if missed[i] < _NEAR)
