"""The class of a motion that settles too slowly to show it: that of the periodic orbit it is near.

Beside a bifurcation motions settle ever more slowly, and a record shows a class that is not the
attractor's, or none. So the class of a motion that neither rests nor is chaotic is taken from the
periodic orbit which shooting finds from its last section (`vibroimpact.orbits.shooting`), where
that orbit is stable and the motion stays near it throughout the record, and does not leave it. A
motion from which none is found is followed four times as long, ``LONGER`` times over; then its
class is not known.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
import xarray as xr

from sweeps.analysis.changes import Label, labels
from sweeps.analysis.classes import Motion
from sweeps.config.sweep import SweepConfig
from sweeps.engine.compute import compute
from sweeps.store.variables import VARIABLES
from vibroimpact.orbits.period_class import LONGEST_PERIOD
from vibroimpact.orbits.shooting import doubled, periodic_orbit
from vibroimpact.oscillator import Oscillator

#: How often a motion that does not show its class is followed four times as long.
LONGER = 3
#: An orbit is near if it misses no section by more than this share of the record's size.
_NEAR = 0.2
#: By this share a motion may be farther from its orbit in the second half of its record: rounding.
_ROUNDING = 1e-6
#: How many periods are tried where no repetition was found: those after which it nearly repeats.
_TRIED = 4

Results = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Point:
    """A value of the swept axis with the class of its motion.

    Attributes
    ----------
    value : float
    label : Label or None
        None where the class is not known.
    results : mapping of str to ndarray
        What the file holds of it, or is to hold.
    """

    value: float
    label: Label | None
    results: Results

    @property
    def state(self) -> tuple[float, float]:
        """x and v at the last section."""
        return float(self.results["poincare_x"][-1]), float(self.results["poincare_v"][-1])


class Settling:
    """Points of a sweep along one axis, with their classes.

    Parameters
    ----------
    config : SweepConfig
    axis : str
        Its only axis.
    threads : int, optional
    """

    def __init__(self, config: SweepConfig, axis: str, threads: int | None = None) -> None:
        self._config, self._axis, self._threads = config, axis, threads

    def computed(self, values: np.ndarray, starts: np.ndarray | None = None) -> list[Point]:
        """Compute points, for as long as it takes to know their classes.

        Parameters
        ----------
        values : ndarray, shape (n,)
        starts : ndarray, shape (n, 2), optional
            x and v at the section to start from, by default the sweep's own start at t = 0.
        """
        points: list[Point] = [Point(float(value), None, {}) for value in values]
        left, record = np.arange(len(values)), self._config.record
        for longer in range(LONGER + 1):
            if not left.size:
                break
            some = None if starts is None else starts[left]
            transient = 4**longer * (record.transient + record.periods) - record.periods
            found = self.classified(values[left], self._run(values[left], some, transient))
            for i, point in zip(left.tolist(), found, strict=True):
                points[i] = point
            left = np.array([i for i in left.tolist() if points[i].label is None], int)
        return points

    def classified(self, values: np.ndarray, results: Results) -> list[Point]:
        """Find the class behind each record, and where that is not what it shows, record anew.

        Parameters
        ----------
        values : ndarray, shape (n,)
        results : mapping of str to ndarray
            Arrays of shape (n, ...).
        """
        rows = [{name: array[i] for name, array in results.items()} for i in range(len(values))]
        shown = labels(self._line(values, results))
        return [
            self._classified(Point(float(value), label, row))
            for value, label, row in zip(values, shown, rows, strict=True)
        ]

    def _classified(self, point: Point) -> Point:
        shown = point.label
        if shown is not None and shown.motion is not Motion.PERIODIC:
            return point
        record = np.stack([point.results["poincare_x"], point.results["poincare_v"]], axis=1)
        if not np.isfinite(record).all():
            return point
        oscillator = self._oscillator(point.value)
        for m in _nearly_repeats(record) if shown is None else [shown.m]:
            phase = self._config.record.phase
            orbit = periodic_orbit(oscillator, *point.state, m, phase)
            if orbit is not None and not orbit.stable:  # the motion may not have left it yet
                orbit = doubled(oscillator, orbit, phase)
            if orbit is None or not orbit.stable or orbit.rests > 0:
                continue
            if not _goes_to(record, orbit.sections):
                continue
            label = Label(Motion.PERIODIC, orbit.m, orbit.impacts)
            anew = self._run(np.array([point.value]), orbit.sections[:1], 0)
            # A record may be too short to show m, or q where it is not of whole repetitions.
            anew["period"][:], anew["period_impacts"][:] = label.m, label.q
            return Point(point.value, label, {name: array[0] for name, array in anew.items()})
        return Point(point.value, None, point.results)

    def _run(self, values: np.ndarray, starts: np.ndarray | None, transient: int) -> Results:
        record = self._config.record.model_copy(update={"transient": transient})
        config = self._config.model_copy(update={"record": record})
        points = self._config.grid.with_values(self._axis, values)
        if starts is not None:
            points["x0"], points["v0"] = starts.T
            points["x0"] = np.minimum(points["x0"], points["clearance"])  # as where it is followed
        return compute(config, points, self._threads, at_section=starts is not None)

    def _oscillator(self, value: float) -> Oscillator:
        at = {**self._config.grid.fixed, self._axis: value}
        return Oscillator(**{field.name: at[field.name] for field in fields(Oscillator)})

    def _line(self, values: np.ndarray, results: Results) -> xr.Dataset:
        """Return results as the file of a sweep shows them."""
        variables = {}
        for name, array in results.items():
            record = VARIABLES[name].record
            variables[name] = ((self._axis, record) if record else (self._axis,), array)
        attributes = {"name": self._config.name, "configuration": self._config.to_yaml()}
        return xr.Dataset(variables, {self._axis: values}, attributes)


def _goes_to(record: np.ndarray, orbit: np.ndarray) -> bool:
    """Whether a motion stays near an orbit throughout its record, and does not leave it."""
    size = np.abs(record).max(axis=0)
    size[size == 0.0] = 1.0
    last = np.argmin((np.abs(orbit - record[-1]) / size).max(axis=1))
    beside = orbit[(last + np.arange(1 - len(record), 1)) % len(orbit)]
    missed = (np.abs(record - beside) / size).max(axis=1)
    first, second = np.array_split(missed, 2)
    return bool(missed.max() <= _NEAR and second.max() <= first.max() + _ROUNDING)


def _nearly_repeats(record: np.ndarray) -> list[int]:
    """Return the numbers of periods after which a record nearly repeats, in increasing order."""
    most = min(LONGEST_PERIOD, len(record) // 2)
    size = np.abs(record).max(axis=0)
    missed = [(np.abs(record[-m:] - record[-2 * m : -m]) / size).max() for m in range(1, most + 1)]
    best = np.argsort(missed, kind="stable")[:_TRIED]
    return sorted(int(i) + 1 for i in best if missed[i] < _NEAR)
