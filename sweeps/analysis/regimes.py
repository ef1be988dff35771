"""The regime at each point of a sweep: periodic, with rest, chaotic, or not known.

The record of a point determines its regime. The first of these rules that applies decides:

1. not computed, failed or unbounded: according to ``status``;
2. with rest: the mass rested on the stop during the record, after a complete chatter or, with
   R = 0, after an impact, unless it is proved that it has no impact any more. Such a motion may be
   periodic, but its number of impacts depends on where a chatter is cut off;
3. periodic: the periodic orbit is known to which the motion goes (`vibroimpact.destination`);
4. by the larger Lyapunov exponent, if it is recorded. Over the time t of a record of k forcing
   periods, tangent vectors grow by exp(lambda_1 t). On a torus they grow at most linearly, so
   growth by more than k is chaos. Growth between 1/k and k is neutral: a quasi-periodic motion, or
   a periodic one too close to its bifurcation to settle. If the growth is less, the motion settles
   somewhere, and is undecided;
5. undecided.

The class of a motion is its regime with m and q. If the class changes along an axis, there is a
bifurcation.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import xarray as xr

from sweeps.analysis.grouping import parameter_at_points
from vibroimpact.destination.repetition import TOLERANCE
from vibroimpact.status import Evidence, Status


class Regime(IntEnum):
    """The regime of a motion according to its record."""

    PENDING = 0
    FAILED = 1
    UNBOUNDED = 2
    REST = 3
    PERIODIC = 4
    CHAOTIC = 5
    NEUTRAL = 6
    UNDECIDED = 7


#: Regimes of motions that neither rest nor go to a known periodic orbit.
NO_CLASS = (Regime.CHAOTIC, Regime.NEUTRAL, Regime.UNDECIDED)
#: Regimes of motions whose record does not show the attractor.
UNSETTLED = (Regime.UNDECIDED, Regime.NEUTRAL)


def has_result(status: np.ndarray) -> np.ndarray:
    """Return the mask of points that were computed and did not fail."""
    return ~np.isin(status, [outcome for outcome in Status if outcome.failed])


def approaching(dataset: xr.Dataset) -> np.ndarray:
    """Return the mask of the points whose motion has a class and is not on its orbit yet."""
    if "orbit_distance" not in dataset:
        return np.zeros(dataset["status"].shape, bool)
    distance: np.ndarray = dataset["orbit_distance"].values
    return distance > TOLERANCE  # False for NaN


def classify(dataset: xr.Dataset) -> np.ndarray:
    """Return the `Regime` at every point of a sweep with ``period``, in the shape of ``status``."""
    axes = dataset["status"].dims
    names = ("status", "rest_fraction", "period", "class_evidence", "lyapunov")
    results = {
        name: dataset[name].transpose(*axes, ...).values for name in names if name in dataset
    }
    omega = parameter_at_points(dataset, "omega").reshape(dataset["status"].shape)
    return regimes_of(results, omega, dataset.sizes["section"])


def regimes_of(results: Mapping[str, np.ndarray], omega: np.ndarray, periods: int) -> np.ndarray:
    """Return the `Regime` of results of any shape (...), from records of `periods` forcing periods.

    The results are ``status``, ``rest_fraction``, ``period``, ``class_evidence`` and, if recorded,
    ``lyapunov`` of shape (..., 2), as in a file.
    """
    status, is_free = results["status"], results["class_evidence"] == Evidence.FREE
    rules = [
        (status == Status.PENDING, Regime.PENDING),
        (~has_result(status), Regime.FAILED),
        (status == Status.UNBOUNDED, Regime.UNBOUNDED),
        ((results["rest_fraction"] > 0.0) & ~is_free, Regime.REST),
        (results["period"] > 0, Regime.PERIODIC),
    ]
    if "lyapunov" in results:
        limit = np.log(periods)
        growth = results["lyapunov"][..., 0] * (periods * 2.0 * np.pi / omega)
        rules += [(growth > limit, Regime.CHAOTIC), (growth >= -limit, Regime.NEUTRAL)]
    return np.select(
        [condition for condition, _ in rules],
        [int(regime) for _, regime in rules],
        int(Regime.UNDECIDED),
    )


def frequent_periods(period: np.ndarray, impacts: np.ndarray, count: int) -> list[tuple[int, int]]:
    """Return the most frequent (forcing periods, impacts) per repetition, in increasing order."""
    pairs, numbers = np.unique(np.stack([period, impacts], axis=1), axis=0, return_counts=True)
    frequent = pairs[np.argsort(-numbers, kind="stable")[:count]]
    return sorted((int(m), int(q)) for m, q in frequent)


#: Regimes that have a class; for the others the attractor is not known.
_CLASSIFIED = (Regime.UNBOUNDED, Regime.REST, Regime.PERIODIC, Regime.CHAOTIC)
_WORDS = {Regime.UNBOUNDED: "unbounded", Regime.REST: "rest", Regime.CHAOTIC: "chaos"}


class Label(NamedTuple):
    """The class of a motion: its regime, with m forcing periods and q impacts if known, else 0.

    m and q are known for periodic motions, and for motions with rest at R = 0, which have no
    chatter that is cut off.
    """

    regime: Regime
    m: int = 0
    q: int = 0

    def __str__(self) -> str:
        words = [
            {**_WORDS, Regime.UNDECIDED: "?"}.get(self.regime, ""),
            f"{self.m}/{self.q}" if self.m else "",
        ]
        return " ".join(filter(None, words))


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

        ``flip`` if m and q double; ``rest``, ``chaos`` or ``unbounded`` if this regime begins or
        ends; otherwise ``unknown``.
        """
        ends = {self.before.regime, self.after.regime}
        for regime, word in _WORDS.items():
            if regime in ends and len(ends) == 2:
                return word
        (m, q), longer = sorted((self.before[1:], self.after[1:]))
        return "flip" if ends == {Regime.PERIODIC} and longer == (2 * m, 2 * q) else "unknown"


def labels(line: xr.Dataset) -> list[Label | None]:
    """Return the class at every point of a line with ``period``; None if it is not known."""
    regimes = classify(line)
    counted = regimes == Regime.PERIODIC
    if not parameter_at_points(line, "R").any():
        counted |= regimes == Regime.REST
    m, q = (np.where(counted, line[name].values, 0) for name in ("period", "period_impacts"))
    return [
        Label(Regime(regime), *mq) if regime in _CLASSIFIED else None
        for regime, *mq in zip(regimes.tolist(), m.tolist(), q.tolist(), strict=True)
    ]


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
