"""Finds each `Change` of class along a line, its `Explanation`; cells of change on a map.

The branch of the periodic orbit on each side of a change is followed to the other side
(`vibroimpact.orbits.branches`). If the branch ends or loses its stability between the sides, this
is the bifurcation. Otherwise the attractor persists, and the motion of the sweep has only moved
into the basin of another one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sweeps.opened.motions import first_special_point, orbit_of_motion
from sweeps.opened.opened_sweep import START_AXES
from vibroimpact.orbits.orbit import PeriodicOrbit
from vibroimpact.points.regimes import Label, Regime

#: Most steps from one side of a change to the other: a share of the axis, but at least a few cells.
WIDEST_GAP, FEW = 0.05, 3.0
#: Least share of the map that a large region covers.
LARGE = 0.01
#: The class of points that have none.
NO_LABEL = Label(Regime.UNKNOWN)
#: Regimes whose beginning or end is a kind of change.
_REGIMES = (Regime.UNBOUNDED, Regime.REST, Regime.CHAOTIC)
#: Kinds in the list for the special points of a branch: a penetration begins with a graze.
_KINDS = {"flip": "flip", "fold": "fold", "graze": "graze", "penetration": "graze", "rest": "rest"}
#: Values on an axis are the same if they agree to the first share of its length, or, by rounding,
#: to the second share of its greatest value.
_SAME_VALUE, _ROUNDING = 1e-9, 1e-13


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
        """The kind that the two classes suggest, without proof."""
        regimes = {self.before.regime, self.after.regime}
        for regime in _REGIMES:
            if regime in regimes and len(regimes) == 2:
                return regime.word
        is_flip = self.before.doubles_to(self.after) or self.after.doubles_to(self.before)
        return "flip" if is_flip else "unknown"


def changes_of_class(values: np.ndarray, classes: Sequence[Label | None]) -> Iterator[Change]:
    """Yield the changes of class along increasing values, ignoring points of unknown class."""
    classified = [(i, label) for i, label in enumerate(classes) if label is not None]
    for (i, before), (j, after) in pairwise(classified):
        if before != after:
            yield Change(float(values[i]), float(values[j]), before, after, j - i - 1)


def least_difference(low: float, high: float) -> float:
    """Return the difference up to which two values on an axis are the same."""
    return max(_SAME_VALUE * (high - low), _ROUNDING * max(abs(low), abs(high)))


class Explanation(NamedTuple):
    """What explains a change: the first special point on a branch, or its kind alone."""

    kind: str
    value: float = np.nan
    orbit: str = ""  # class of the orbit that bifurcates
    at: PeriodicOrbit | None = None  # this orbit, at `value`

    @property
    def is_exact(self) -> bool:
        """Whether this is a bifurcation with a known value."""
        return self.kind in _KINDS.values() and self.at is not None

    def explains(self, change: Change) -> bool:
        """Whether this is the bifurcation of a change; chaos begins beyond a flip, not at it."""
        beyond = ("rest", "unbounded") + ("chaotic",) * (self.kind == "flip")
        return self.is_exact and change.kind not in beyond


def explain(
    motions: np.ndarray, phase: float, axis: str, values: np.ndarray, change: Change, down: bool
) -> list[tuple[Change, Explanation]]:
    """Return a change with its explanation.

    `motions` are those at the `values` of the axis, a parameter of the model, and `phase` is that
    of their section.
    If points of unknown class lie between, and no bifurcation leads from one class to the other,
    the change from the first class to an unknown one and that to the last class are returned.
    """
    if axis in START_AXES:
        return [(change, Explanation("basin"))]
    low, high = motions[np.searchsorted(values, [change.low, change.high])]
    left, right = _onward(low, high, phase, axis), _onward(high, low, phase, axis)
    first, second = (right, left) if down else (left, right)
    is_regime = change.kind in ("rest", "chaotic", "unbounded")
    if first.kind == "edge" or (is_regime and second.kind == "edge"):
        return [(change, Explanation("basin"))]
    exact = [onward for onward in (first, second) if onward.explains(change)]
    if not exact:
        return [(change, Explanation(change.kind))]
    near = least_difference(values[0], values[-1])
    pairs = [(change, exact[0])]
    if change.between and not _is_joined(change, first, second, near):
        pairs = [
            (
                _open(values, change, onward.value, after=after),
                onward if onward.is_exact else Explanation("unknown"),
            )
            for onward, after in ((left, True), (right, False))
        ]
    return [(_change_at(each, reason.value, left, right, near), reason) for each, reason in pairs]


def _change_at(
    change: Change, value: float, left: Explanation, right: Explanation, near: float
) -> Change:
    """Return a change at a value, without the classes of motions that end before they reach it."""
    before = NO_LABEL if left.value < value - near else change.before
    after = NO_LABEL if right.value > value + near else change.after
    return replace(change, before=before, after=after)


def _is_joined(change: Change, first: Explanation, second: Explanation, near: float) -> bool:
    """Whether the same bifurcation ends the first motion and leads to the second one."""
    if first.is_exact and second.is_exact:
        return abs(first.value - second.value) <= near
    return second.kind == "edge" or change.kind in ("flip", "chaotic")


def _open(values: np.ndarray, change: Change, value: float, *, after: bool) -> Change:
    """Return the change between a class and the points of unknown class `after` or before it.

    It ends at the first of these points that lies beyond the exact value, if this is known. If all
    lie before the value, it is the whole change.
    """
    inside = values[(values > change.low) & (values < change.high)]
    beyond = inside
    if np.isfinite(value):
        beyond = inside[inside > value] if after else inside[inside < value]
    if not beyond.size:
        return change
    if after:
        end = float(beyond[0])
        return replace(change, high=end, after=NO_LABEL, between=int((inside < end).sum()))
    end = float(beyond[-1])
    return replace(change, low=end, before=NO_LABEL, between=int((inside > end).sum()))


def _onward(motion: np.void, other: np.void, phase: float, axis: str) -> Explanation:
    """Return the first special point on the branch of the orbit of a motion towards another one."""
    if motion["regime"] == Regime.PERIODIC:
        with suppress(ValueError):  # no orbit is found, or it cannot be followed
            orbit = orbit_of_motion(motion, phase)
            if orbit.stable:
                point = first_special_point(orbit, axis, other["point"][axis].item())
                of = point.orbit if point.kind in ("flip", "graze") else orbit
                kind = _KINDS.get(point.kind, point.kind)
                return Explanation(kind, point.value, f"{of.m}/{of.q}", point.orbit)
    return Explanation("unknown")


def cells_of_change(classes: np.ndarray, regimes: np.ndarray) -> np.ndarray:
    """Return the two cells of every change along a row or a column, shape (changes, 2, 2).

    `classes` are m and q of each cell, 0 if it is not periodic. The cells between the two have no
    class, or are chaotic: a known rest or a motion without bound ends the search.
    """
    classified = np.argwhere(np.isin(regimes, [Regime.PERIODIC, Regime.REST, Regime.UNBOUNDED]))
    changes = [np.empty((0, 2, 2), int)]
    for axis in (0, 1):
        widest = max(FEW, WIDEST_GAP * regimes.shape[axis])
        cells = classified[np.lexsort((classified[:, axis], classified[:, 1 - axis]))]
        pairs = np.stack([cells[:-1], cells[1:]], axis=1)
        steps = pairs[:, 1] - pairs[:, 0]
        before, after = classes[*pairs[:, 0].T], classes[*pairs[:, 1].T]
        is_change = (before != after).any(axis=1) & (before[:, 0] > 0) & (after[:, 0] > 0)
        changes.append(pairs[is_change & (steps[:, 1 - axis] == 0) & (steps[:, axis] <= widest)])
    return np.concatenate(changes)


def steps_between(changes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the middles of all steps from cell to cell of changes, and whose steps they are."""
    first, last = changes.transpose(1, 0, 2)
    counts = (last - first).max(axis=1)
    owners = np.repeat(np.arange(len(changes)), counts)
    before = np.arange(len(owners)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (before + 0.5) / counts[owners]
    return owners, first[owners] + share[:, None] * (last - first)[owners]


def middles_of_regions(classes: np.ndarray) -> Iterator[tuple[np.ndarray, int]]:
    """Yield the middle of every large region of a class where it is widest, for each axis.

    If all regions of a class are small but cover much of the map together, the largest counts.
    """
    from scipy.ndimage import label

    flat = classes.reshape(-1, 2)
    names, counts = np.unique(flat[flat[:, 0] > 0], axis=0, return_counts=True)
    for name in names[counts >= LARGE * len(flat)]:
        regions, _ = label((classes == name).all(axis=2))
        sizes = np.bincount(regions.ravel())[1:]
        for number in np.flatnonzero(sizes >= min(LARGE * len(flat), sizes.max())) + 1:
            inside = regions == number
            for axis in (0, 1):
                widest = int(np.argmax(inside.sum(axis=axis)))
                within = np.flatnonzero(inside.take(widest, axis=1 - axis))
                middle = int(within[len(within) // 2])
                yield np.array([middle, widest] if axis == 0 else [widest, middle]), axis
