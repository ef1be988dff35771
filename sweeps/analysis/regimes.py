"""The regimes and classes of an opened sweep, and where the class changes along an axis.

If the class changes, there is a bifurcation, or the start leads to another attractor.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import xarray as xr

from sweeps.analysis.grouping import parameter_at_points
from vibroimpact.points.regimes import Label, Regime, labels_of, on_its_way, regimes_of

#: Regimes whose beginning or end is a kind of change.
_KINDS = (Regime.UNBOUNDED, Regime.REST, Regime.CHAOTIC)


def classify(dataset: xr.Dataset) -> np.ndarray:
    """Return the `Regime` at every point of a sweep with ``period``, in the shape of ``status``."""
    axes = dataset["status"].dims
    names = ("status", "rest_fraction", "period", "class_evidence", "lyapunov")
    results = {
        name: dataset[name].transpose(*axes, ...).values for name in names if name in dataset
    }
    omega = parameter_at_points(dataset, "omega").reshape(dataset["status"].shape)
    return regimes_of(results, omega, dataset.sizes["section"])


def approaching(dataset: xr.Dataset) -> np.ndarray:
    """Return the mask of the points whose motion is on its way to its orbit."""
    if "orbit_distance" not in dataset:
        return np.zeros(dataset["status"].shape, bool)
    distance = dataset["orbit_distance"].transpose(*dataset["status"].dims).values
    return on_its_way(classify(dataset), distance)


def labels(line: xr.Dataset) -> list[Label | None]:
    """Return the class at every point of a line with ``period``; None if it is not known."""
    R = parameter_at_points(line, "R")
    return labels_of(classify(line), line["period"].values, line["period_impacts"].values, R)


@dataclass(frozen=True)
class Change:
    """Two values of an axis between which the class changes."""

    #: low, high: the nearest values with known classes.
    low: float
    high: float
    #: before, after: the classes at `low` and `high`.
    before: Label
    after: Label
    between: int = 0  # number of points of unknown class between them

    @property
    def kind(self) -> str:
        """The kind that the two classes suggest, without proof.

        ``flip`` if m and q double; ``rest``, ``chaotic`` or ``unbounded`` if this regime begins or
        ends; otherwise ``unknown``.
        """
        ends = {self.before.regime, self.after.regime}
        for regime in _KINDS:
            if regime in ends and len(ends) == 2:
                return regime.word
        (m, q), longer = sorted((self.before[1:], self.after[1:]))
        return "flip" if ends == {Regime.PERIODIC} and longer == (2 * m, 2 * q) else "unknown"


def changes(values: np.ndarray, classes: Sequence[Label | None]) -> Iterator[Change]:
    """Yield the changes of class along increasing values, ignoring points of unknown class."""
    classified = [(i, label) for i, label in enumerate(classes) if label is not None]
    for (i, before), (j, after) in pairwise(classified):
        if before != after:
            yield Change(float(values[i]), float(values[j]), before, after, j - i - 1)


def cascades(line: Sequence[Change]) -> Iterator[list[Change]]:
    """Yield the runs of at least three flips, each of the orbit that arose in the previous flip."""
    flips = [change for change in line if change.kind == "flip"]
    for upwards in (True, False):
        run: list[Change] = []
        reached = None
        for flip in flips if upwards else reversed(flips):
            ends = (flip.before, flip.after) if upwards else (flip.after, flip.before)
            if ends[0].m > ends[1].m:
                continue
            if ends[0] != reached:
                yield from [run] * (len(run) >= 3)
                run = []
            run, reached = [*run, flip], ends[1]
        yield from [run] * (len(run) >= 3)
