"""Points along one axis with the class of their motion, computed for as long as that takes.

The class of a motion that neither rests nor is chaotic is that of the stable periodic orbit it goes
to (`sweeps.analysis.nearby_orbit`), whatever its record shows. A motion for which there is no such
orbit is followed four times as long, up to ``MOST_EXTENSIONS`` times over; then its class is not
known.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from sweeps.analysis.class_changes import Label, labels
from sweeps.analysis.motion import Motion
from sweeps.analysis.nearby_orbit import nearby_orbit
from sweeps.analysis.selection import dataset_of
from sweeps.config.sweep import SweepConfig
from sweeps.engine.compute import compute
from vibroimpact.oscillator import Oscillator, mesh

#: How often a motion that does not show its class is followed four times as long.
MOST_EXTENSIONS = 3

Results = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class ClassifiedPoint:
    """A value of the swept axis with the class of its motion, or None if the class is not known.

    The results are the variables of the file at this point.
    """

    value: float
    label: Label | None
    results: Results

    @property
    def state(self) -> tuple[float, float]:
        """x and v at the last section."""
        return float(self.results["poincare_x"][-1]), float(self.results["poincare_v"][-1])


class Classifier:
    """Computes points of a sweep along its only axis, and finds the classes of their motions."""

    def __init__(self, config: SweepConfig, threads: int | None = None) -> None:
        self._config, self._threads = config, threads
        (self._axis,) = config.grid.axes

    def compute(
        self, values: np.ndarray, starts: np.ndarray | None = None
    ) -> list[ClassifiedPoint]:
        """Compute points, for as long as it takes to know their classes.

        Parameters
        ----------
        values : ndarray, shape (n,)
            Of the axis.
        starts : ndarray, shape (n, 2), optional
            x and v at the section to start from, by default the sweep's own start at t = 0.

        Returns
        -------
        list of ClassifiedPoint
            In the order of `values`.
        """
        points = [ClassifiedPoint(float(value), None, {}) for value in values]
        remaining, record = np.arange(len(values)), self._config.record
        for extension in range(MOST_EXTENSIONS + 1):
            if not remaining.size:
                break
            from_states = None if starts is None else starts[remaining]
            transient = 4**extension * (record.transient + record.periods) - record.periods
            results = self._run(values[remaining], from_states, transient)
            classified = self.classify(values[remaining], results)
            for i, point in zip(remaining.tolist(), classified, strict=True):
                points[i] = point
            remaining = np.array([i for i in remaining.tolist() if points[i].label is None], int)
        return points

    def classify(self, values: np.ndarray, results: Results) -> list[ClassifiedPoint]:
        """Find the class behind each record; if that is a periodic orbit, record the orbit itself.

        Parameters
        ----------
        values : ndarray, shape (n,)
            Of the axis.
        results : mapping of str to ndarray
            The variables of the file at these points, arrays of shape (n, ...).

        Returns
        -------
        list of ClassifiedPoint
            In the order of `values`.
        """
        rows = [{name: array[i] for name, array in results.items()} for i in range(len(values))]
        shown = labels(dataset_of(self._config, {self._axis: values}, results))
        return [
            self._classify(ClassifiedPoint(float(value), label, row))
            for value, label, row in zip(values, shown, rows, strict=True)
        ]

    def _classify(self, point: ClassifiedPoint) -> ClassifiedPoint:
        """Return a point with the class behind its record, and with the record of its orbit."""
        shown = point.label
        if shown is not None and shown.motion is not Motion.PERIODIC:
            return point
        record = np.stack([point.results["poincare_x"], point.results["poincare_v"]], axis=1)
        if not np.isfinite(record).all():
            return point
        m = None if shown is None else shown.m
        oscillator = self._oscillator(point.value)
        orbit = nearby_orbit(oscillator, record, self._config.record.phase, m)
        if orbit is None:
            return ClassifiedPoint(point.value, None, point.results)
        label = Label(Motion.PERIODIC, orbit.m, orbit.q)
        results = self._run(
            np.array([point.value]), orbit.sections(self._config.record.phase)[:1], 0
        )
        # A record may be too short to show m; it shows q only if it is of whole repetitions.
        results["period"][:], results["period_impacts"][:] = label.m, label.q
        row = {name: array[0] for name, array in results.items()}
        return ClassifiedPoint(point.value, label, row)

    def _run(
        self, values: np.ndarray, starts: np.ndarray | None, transient: int
    ) -> dict[str, np.ndarray]:
        """Compute points from states at the section, or by default from the start of the sweep."""
        record = self._config.record.model_copy(update={"transient": transient})
        config = self._config.model_copy(update={"record": record})
        points = mesh({self._axis: values}, self._config.grid.fixed)
        if starts is not None:
            points["x0"], points["v0"] = starts.T
            points["x0"] = np.minimum(points["x0"], points["clearance"])  # as in a followed sweep
        return compute(config, points, self._threads, at_section=starts is not None)

    def _oscillator(self, value: float) -> Oscillator:
        parameters = {**self._config.grid.fixed, self._axis: value}
        return Oscillator(**{field.name: parameters[field.name] for field in fields(Oscillator)})
