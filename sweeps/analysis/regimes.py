"""The regime at each point of a sweep: periodic, with rest, chaotic, or not known.

The regime of a point is what its record shows. The first of these that holds decides:

1. not computed, failed, or unbounded: by ``status``;
2. with rest: the mass rested on the stop during the record, after a complete chatter or, with
   R = 0, after an impact. Such a motion may be periodic, but its number of impacts depends on where
   a chatter is cut off;
3. periodic: the record repeats (`vibroimpact.points.period_class.period_class`);
4. by the larger Lyapunov exponent, where it is recorded. Over the time t of a record of k forcing
   periods, tangent vectors grow by exp(lambda_1 t). On a torus they grow linearly at the most, so
   that more than k-fold growth is chaos. From 1/k to k is neutral: a quasi-periodic motion, or a
   periodic one too close to its bifurcation to have settled. Less is a motion that settles and has
   not repeated yet, which is undecided;
5. undecided.

The class of a motion is its regime with m and q. Where the class changes along an axis, there is a
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
from vibroimpact.status import Status


class Regime(IntEnum):
    """What a record shows of a motion."""

    PENDING = 0
    FAILED = 1
    UNBOUNDED = 2
    REST = 3
    PERIODIC = 4
    CHAOTIC = 5
    NEUTRAL = 6
    UNDECIDED = 7


#: Regimes in which the record does not show the attractor.
UNSETTLED = (Regime.UNDECIDED, Regime.NEUTRAL)


def has_result(status: np.ndarray) -> np.ndarray:
    """Return which points were computed and did not fail."""
    return ~np.isin(status, [outcome for outcome in Status if outcome.failed])


def classify(dataset: xr.Dataset) -> np.ndarray:
    """Return the `Regime` at every point of a sweep with ``period``, in the shape of ``status``."""
    axes = dataset["status"].dims
    names = ("status", "rest_fraction", "period", "lyapunov")
    results = {
        name: dataset[name].transpose(*axes, ...).values for name in names if name in dataset
    }
    omega = parameter_at_points(dataset, "omega").reshape(dataset["status"].shape)
    return regimes_of(results, omega, dataset.sizes["section"])


def regimes_of(results: Mapping[str, np.ndarray], omega: np.ndarray, periods: int) -> np.ndarray:
    """Return the `Regime` that results of a record of so many periods show, in any shape (...).

    The results are ``status``, ``rest_fraction``, ``period`` and, where it is recorded,
    ``lyapunov`` of shape (..., 2), as in a file.
    """
    status = results["status"]
    rules = [
        (status == Status.PENDING, Regime.PENDING),
        (~has_result(status), Regime.FAILED),
        (status == Status.UNBOUNDED, Regime.UNBOUNDED),
        (results["rest_fraction"] > 0.0, Regime.REST),
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


#: Regimes that have a class. Of the others it is not known where the motion ends.
_CLASSIFIED = (Regime.UNBOUNDED, Regime.REST, Regime.PERIODIC, Regime.CHAOTIC)
_WORDS = {Regime.UNBOUNDED: "unbounded", Regime.REST: "rest", Regime.CHAOTIC: "chaos"}


class Label(NamedTuple):
    """The class of a motion: its regime, and m forcing periods and q impacts where these are known.

    They are those of a periodic motion, and of one with rest at R = 0, where no chatter is cut off.
    """

    regime: Regime
    m: int = 0
    q: int = 0

    def __str__(self) -> str:
        words = [_WORDS.get(self.regime, ""), f"{self.m}/{self.q}" if self.m else ""]
        return " ".join(filter(None, words))


@dataclass(frozen=True)
class Change:
    """Two values of an axis between which the class changes.

    Attributes
    ----------
    low, high : float
        The nearest values whose classes are known.
    before, after : Label
        The classes there.
    between : int
        Points between them at which nothing can be said of the class.
    """

    low: float
    high: float
    before: Label
    after: Label
    between: int = 0

    @property
    def kind(self) -> str:
        """What the two classes suggest, which is no proof.

        ``flip``: m and q double; ``rest``, ``chaos`` and ``unbounded``: that begins or ends;
        ``unknown``: anything else.
        """
        ends = {self.before.regime, self.after.regime}
        for regime, word in _WORDS.items():
            if regime in ends and len(ends) == 2:
                return word
        (m, q), longer = sorted((self.before[1:], self.after[1:]))
        return "flip" if ends == {Regime.PERIODIC} and longer == (2 * m, 2 * q) else "unknown"


def labels(line: xr.Dataset) -> list[Label | None]:
    """Return the class at every point of a line with ``period``; None where it is not known."""
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
    """Yield the changes of class along increasing values, passing over what is not known."""
    classified = [(i, label) for i, label in enumerate(classes) if label is not None]
    for (i, before), (j, after) in pairwise(classified):
        if before != after:
            yield Change(float(values[i]), float(values[j]), before, after, j - i - 1)


def cascades(line: Sequence[Change]) -> Iterator[list[Change]]:
    """Yield the runs of three flips and more, each of the orbit that arose in the flip before."""
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
