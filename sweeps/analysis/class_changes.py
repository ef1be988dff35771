"""Where the class of the motion changes along an axis: what a bifurcation looks like in a sweep."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import xarray as xr

from sweeps.analysis.grouping import parameter_at_points
from sweeps.analysis.motion import Motion, classify

#: Kinds of motion that have a class. Of the others it is not known where the motion ends.
_CLASSIFIED = (Motion.UNBOUNDED, Motion.REST, Motion.PERIODIC, Motion.CHAOTIC)
_WORDS = {Motion.UNBOUNDED: "unbounded", Motion.REST: "rest", Motion.CHAOTIC: "chaos"}


class Label(NamedTuple):
    """The class of a motion: its kind, and m forcing periods and q impacts where these are known.

    They are those of a periodic motion, and of one with rest at R = 0, where no chatter is cut off.
    """

    motion: Motion
    m: int = 0
    q: int = 0

    def __str__(self) -> str:
        words = [_WORDS.get(self.motion, ""), f"{self.m}/{self.q}" if self.m else ""]
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
        ends = {self.before.motion, self.after.motion}
        for motion, word in _WORDS.items():
            if motion in ends and len(ends) == 2:
                return word
        (m, q), longer = sorted((self.before[1:], self.after[1:]))
        return "flip" if ends == {Motion.PERIODIC} and longer == (2 * m, 2 * q) else "unknown"


def labels(line: xr.Dataset) -> list[Label | None]:
    """Return the class at every point of a line of computed points; None where it is not known.

    Parameters
    ----------
    line : Dataset
        A cut through an opened sweep with one swept axis left, with ``period``.
    """
    motions = classify(line)
    counted = motions == Motion.PERIODIC
    if not parameter_at_points(line, "R").any():
        counted |= motions == Motion.REST
    m, q = (np.where(counted, line[name].values, 0) for name in ("period", "period_impacts"))
    return [
        Label(Motion(kind), *mq) if kind in _CLASSIFIED else None
        for kind, *mq in zip(motions.tolist(), m.tolist(), q.tolist(), strict=True)
    ]


def changes(values: np.ndarray, classes: Sequence[Label | None]) -> Iterator[Change]:
    """Yield the changes of class along increasing values, passing over what is not known.

    Parameters
    ----------
    values : ndarray, shape (n,)
    classes : sequence of Label or None, length n
        Of the motions there, as from `labels`.
    """
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


def ratio(run: Sequence[Change]) -> float:
    """Return (b - a) / (c - b) of the middles a, b, c of three changes."""
    first, second, third = (0.5 * (change.low + change.high) for change in run)
    return (second - first) / (third - second)
