"""The exact branches of the periodic motions along a line of computed points.

Every periodic motion in the file is a seed: the orbit that it is on is found by Newton's method,
and followed with all that its flips and grazes lead to (`vibroimpact.orbits.trees`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache

import numpy as np
import xarray as xr

from sweeps.analysis.coordinates import orbit_coordinate, recorded_coordinate
from sweeps.analysis.selection import Cut, Setting, directions, listed, select
from sweeps.errors import Refused
from sweeps.store.variables import DIRECTION
from vibroimpact.orbits.period_class import period_class
from vibroimpact.orbits.periodic import OrbitError, periodic_orbit
from vibroimpact.orbits.trees import Tree
from vibroimpact.oscillator import Oscillator
from vibroimpact.status import Status

_NAMES = [field.name for field in fields(Oscillator)]
#: Longer orbits are neither seeds nor followed, nor more branches than this.
MOST_PERIODS, MOST_BRANCHES = 8, 60


@dataclass(frozen=True)
class Line:
    """A line of computed points along one axis.

    Attributes
    ----------
    dataset : Dataset
        A cut through an opened sweep, with `axis` as its only swept axis.
    axis : str
        A parameter of the oscillator.
    oscillator : Oscillator
        At the first point of the line.
    phase : float
        Of the section [rad].
    """

    dataset: xr.Dataset
    axis: str
    oscillator: Oscillator
    phase: float

    @classmethod
    def of(cls, dataset: xr.Dataset, axis: str) -> Line:
        """Read what is fixed along a line from the configuration.

        Raises
        ------
        Refused
            If the orbits do not depend on `axis`, or it has a single value.
        """
        check_axis(dataset, axis, "it")
        setting = Setting.of(dataset)
        return cls(dataset, axis, setting.oscillator(dataset.isel({axis: 0})), setting.phase)


@dataclass(frozen=True)
class Motions:
    """The periodic motions of a line.

    Attributes
    ----------
    values : ndarray, shape (n,)
        Of the axis, increasing.
    states : ndarray, shape (n, 2)
        x and v at the last section.
    m, q : ndarray of int, shape (n,)
        Forcing periods and impacts per repetition; 0 where the motion does not repeat, or rests.
    """

    values: np.ndarray
    states: np.ndarray
    m: np.ndarray
    q: np.ndarray

    @classmethod
    def of(cls, line: Line) -> Motions:
        """Read them from the records of a line."""
        names = ["status", "poincare_x", "poincare_v", "impacts_per_period", "rest_fraction"]
        data = line.dataset[names].sortby(line.axis).load()
        x, v = data["poincare_x"].values, data["poincare_v"].values
        m, q = period_class(x, v, data["impacts_per_period"].values)
        failed = np.isin(data["status"].values, [status for status in Status if status.failed])
        unknown = failed | (data["rest_fraction"].values > 0.0)
        states = np.stack([x[:, -1], v[:, -1]], axis=1)
        return cls(data[line.axis].values, states, np.where(unknown, 0, m), np.where(unknown, 0, q))

    def seeds(self) -> list[int]:
        """Return the middle of every run of points of one class, the longest runs first."""
        classes = self.m * (1 + int(self.q.max(initial=0))) + self.q
        begins = np.flatnonzero(np.diff(classes, prepend=-1))
        lengths = np.diff(begins, append=len(classes))
        order = np.argsort(-lengths, kind="stable")
        middles = (begins + lengths // 2)[order].tolist()
        return [i for i in middles if 0 < self.m[i]]


def grow(lines: Sequence[Line], check: Callable[[], object] | None = None) -> Tree:
    """Follow all orbits that the periodic motions of lines are on.

    Parameters
    ----------
    lines : sequence of Line
        Of one oscillator and axis: the directions in which it was followed.
    check : callable, optional
        Is called before each branch; what it raises ends the work.

    Returns
    -------
    Tree
        What was given up is in its ``given_up``.
    """
    values = np.concatenate([line.dataset[line.axis].values for line in lines])
    seeds = []
    for line in lines:
        motions = Motions.of(line)
        for i in motions.seeds():
            x, v = motions.states[i].tolist()
            seeds.append((float(motions.values[i]), int(motions.m[i]), x, v))
    first = lines[0]
    low, high = float(values.min()), float(values.max())
    return _grown(first.oscillator, first.axis, low, high, first.phase, tuple(seeds), check)


@lru_cache(maxsize=8)
def _grown(
    osc: Oscillator,
    axis: str,
    low: float,
    high: float,
    phase: float,
    seeds: tuple[tuple[float, int, float, float], ...],
    check: Callable[[], object] | None,
) -> Tree:
    """Grow a tree from all seeds, each a value, m, x and v; once for all that is shown of it."""
    tree = Tree(axis, low, high, MOST_BRANCHES, MOST_PERIODS, check)
    for value, m, x, v in seeds:
        if m > MOST_PERIODS:
            tree.given_up[f"motions of more than {MOST_PERIODS} periods"] += 1
            continue
        try:
            orbit = periodic_orbit(replace(osc, **{axis: value}), x, v, m, phase)
        except OrbitError as error:
            tree.given_up[f"motions of which {error}"] += 1
            continue
        tree.grow(orbit)
    return tree


def summary(tree: Tree) -> list[str]:
    """Say in lines what was found, and what was given up."""
    classes = sorted({(branch.m, branch.q) for branch in tree.branches})
    if not classes:
        return ["no exact orbit is found"]
    names = [f"{m}/{q}" for m, q in classes]
    shown = listed(names[:8]) + (", ..." if len(names) > 8 else "")
    noun = "branch" if len(tree.branches) == 1 else "branches"
    lines = [f"{len(tree.branches)} exact {noun} of {shown}"]
    if tree.given_up:
        texts = [f"{count} {reason}" for reason, count in sorted(tree.given_up.items())]
        lines.append(f"not followed: {'; '.join(texts)}")
    return lines


@dataclass(frozen=True)
class Deviation:
    """How far computed points of one class are from the stable branches that they follow.

    Attributes
    ----------
    m, q : int
    values : ndarray, shape (k,)
        Values of the axis at which a computed point has this class and there is a stable orbit.
    sizes : ndarray, shape (k,)
        The largest deviation in its record, in the unit of the coordinate.
    settled : ndarray of bool, shape (k,)
        Whether the orbit's multipliers reduce a deviation to rounding within the transient.
    """

    m: int
    q: int
    values: np.ndarray
    sizes: np.ndarray
    settled: np.ndarray

    def summary(self, axis: str) -> str:
        """Say it in one line."""
        worst = int(np.argmax(self.sizes))
        text = (
            f"{self.m}/{self.q}: {len(self.sizes):,} points follow the stable branch; largest "
            f"deviation {self.sizes[worst]:.1e} at {axis} = {self.values[worst]:g}"
        )
        if self.settled.all():
            return text
        if not self.settled.any():
            return f"{text}; the transient has died out at none of them"
        return (
            f"{text}, and {self.sizes[self.settled].max():.1e} at the "
            f"{np.count_nonzero(self.settled):,} where the transient has died out"
        )


def deviations(line: Line, tree: Tree, coordinate: str) -> Iterator[Deviation]:
    """Compare computed points with the stable branches that they follow.

    Yields
    ------
    Deviation
        For every class of which there are points.
    """
    motions = Motions.of(line)
    records = recorded_coordinate(line.dataset, coordinate).sortby(line.axis).values
    transient = int(line.dataset["section"].values[0]) - 1
    for m, q in sorted({(branch.m, branch.q) for branch in tree.branches if branch.q}):
        alike = [branch for branch in tree.branches if (branch.m, branch.q) == (m, q)]
        compared = []
        for i in np.flatnonzero((motions.m == m) & (motions.q == q)).tolist():
            value = float(motions.values[i])
            orbits = [orbit for branch in alike for orbit in branch.at(value) if orbit.stable]
            sizes = [
                _distance(records[i], orbit_coordinate(orbit, coordinate, line.phase), coordinate)
                for orbit in orbits
            ]
            if sizes:
                nearest = int(np.argmin(sizes))
                decay = np.abs(orbits[nearest].multipliers).max() ** (transient / m)
                compared.append((value, sizes[nearest], decay < np.finfo(float).eps))
        if compared:
            values, distances, settled = (np.array(row) for row in zip(*compared, strict=True))
            yield Deviation(m, q, values, distances, settled)


def _distance(record: np.ndarray, orbit: np.ndarray, coordinate: str) -> float:
    """Return the largest distance of a record from an orbit that starts at any of its points."""
    record = record[np.isfinite(record)]
    starts = [np.resize(np.roll(orbit, -k), record.shape) for k in range(len(orbit))]
    apart = np.abs(record - np.array(starts))
    if coordinate == "impact_phase":
        apart = np.minimum(apart, 2.0 * np.pi - apart)
    return float(apart.max(axis=1, initial=0.0).min())


def check_axis(dataset: xr.Dataset, axis: str, picture: str) -> None:
    """Refuse an axis that the orbits do not depend on, or of a single value."""
    if axis not in _NAMES:
        raise Refused(
            f"the exact orbits do not depend on {axis}; draw {picture} without exact orbits"
        )
    if dataset.sizes[axis] == 1:
        value = dataset[axis].item()
        raise Refused(
            f"{axis} has the single value {value:g}: exact orbits are followed over a range"
        )


def lines_of(dataset: xr.Dataset, axis: str, at: Cut | None = None) -> list[Line]:
    """Return a line of a sweep, once for each direction in which it was followed."""
    line = select(dataset, at, free=[axis, DIRECTION])
    ways = [line.sel({DIRECTION: way}) for way in directions(line)] or [line]
    return [Line.of(way, axis) for way in ways]
