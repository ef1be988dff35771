"""The exact curves of flips, folds and grazes over a map: the borders of its tongues.

From the middle of each large tongue its orbit is followed along both axes until it flips, folds or
grazes, and these bifurcations are followed in both parameters (`vibroimpact.orbits.curves`). Then
every change between two periodic classes, from one cell of the map to the next, is a seed: the
orbit on one side is followed to the other side. A change counts as explained if a curve of one of
its classes passes within one cell. For every other change a reason is given.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from sweeps.analysis.exact_branches import PeriodicPoints, check_axis, numbered_dataset
from sweeps.analysis.selection import Selection, check_diagnostic, chosen_axes, listed, select
from sweeps.errors import Refused
from vibroimpact.orbits.branches import Branch, SpecialPoint, branch
from vibroimpact.orbits.continuation import lost_text
from vibroimpact.orbits.curves import KINDS, bifurcation_curve
from vibroimpact.orbits.periodic import OrbitError, PeriodicOrbit

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

#: Most curves that are followed, and least share of the map that a large tongue covers.
MOST_CURVES, LARGE = 400, 0.01
#: Distances in cells: how far beyond a change its bifurcation is sought, and how near to a curve of
#: its kind a bifurcation counts as on the curve.
_CELLS, _ON = 0.5, 0.2
#: Most pairs of classes that are named with a reason.
_EXAMPLES = 3


def curves(
    dataset: xr.Dataset, axes: Sequence[str] = (), at: Selection | None = None
) -> xr.Dataset:
    """Follow the bifurcations between the periodic motions of a map.

    Parameters
    ----------
    dataset : Dataset
        From `sweeps.open_sweep`, with ``period``.
    axes : sequence of str, optional
        Abscissa and ordinate, by default those of a map.
    at : mapping of str to float, optional
        Values of the other swept axes; by default the first.

    Returns
    -------
    Dataset
        Along ``point``, curve after curve: the two axes and ``curve`` (the number of the curve).
        Along ``number``: ``kind``, ``m`` and ``q`` of each curve. Along ``special``, for the
        special points of the curves: ``special_kind``, ``special_curve`` and ``special_values``
        (``special``, 2). The attribute ``changes`` counts the changes between periodic classes, and
        ``explained`` those with a curve within one cell; ``summary`` says why the others have none.

    Raises
    ------
    Refused
        If the sweep does not have two such axes, or the orbits do not depend on one of them.
    """
    chosen = [axes] if isinstance(axes, str) else axes
    across, up = map_axes(dataset, chosen)
    if len(chosen) == 1:
        raise Refused(f"curves are over two swept axes, not {across} alone")
    for axis in (across, up):
        check_axis(dataset, axis, "the map")
    check_diagnostic(dataset, "period")
    cut = select(dataset, at, free=[across, up]).sortby([across, up]).transpose(across, up, ...)
    return _Search(cut, (across, up)).run()


def summary(
    curves: Sequence[Branch], changes: int, explained: int, reasons: Mapping[str, Counter[str]]
) -> str:
    """Write lines on the curves found, and on the reasons why changes have no curve."""
    kinds = Counter(curve.kind for curve in curves)
    counted = listed([f"{kinds[kind]} of {kind}s" for kind in KINDS if kinds[kind]]) or "none"
    lines = [f"{len(curves)} exact curves: {counted}"]
    if changes:
        lines.append(
            f"{explained:,} of {changes:,} changes between periodic classes "
            f"({100.0 * explained / changes:.1f} %) have a curve within one cell"
        )
    else:
        lines.append("there is no change between periodic classes")
    for reason, pairs in sorted(reasons.items(), key=lambda item: -item[1].total()):
        named = [pair for pair, _ in pairs.most_common(_EXAMPLES)]
        dots = ", ..." if len(pairs) > _EXAMPLES else ""
        lines.append(f"  {pairs.total():,}: {reason} ({', '.join(named)}{dots})")
    for curve in curves:
        for point in curve.special:
            if point.kind == "lost":
                values = zip(curve.parameters, point.value.tolist(), strict=True)
                where = ", ".join(f"{name} = {value:g}" for name, value in values)
                why = lost_text(len(curve.values), point.orbit.speeds)
                name = f"{curve.kind}s of {curve.m}/{curve.q}"
                lines.append(f"a curve of {name} is lost at {where}: {why}")
    return "\n".join(lines)


def map_axes(dataset: xr.Dataset, axes: Sequence[str] = ()) -> list[str]:
    """Return abscissa and ordinate, by default the two longest axes; if equal, the later first."""
    chosen = chosen_axes(dataset, axes, 2, "map")
    if not axes and dataset.sizes[chosen[0]] == dataset.sizes[chosen[1]]:
        chosen.reverse()
    return chosen


class _Search:
    """The search for the curves of one map."""

    def __init__(self, cut: xr.Dataset, axes: tuple[str, str]) -> None:
        self._axes = axes
        self._values = [cut[axis].values for axis in axes]
        self._motions = PeriodicPoints.of(cut)
        self._classes = np.stack([self._motions.m, self._motions.q], axis=2)
        self._cells = np.array(list(self._changes()), int).reshape(-1, 2, 2)
        sides = (self._classes[i, j].tolist() for i, j in self._cells.transpose(1, 2, 0))
        self._names = [tuple(sorted(map(tuple, pair))) for pair in zip(*sides, strict=True)]
        self._explained = np.zeros(len(self._cells), bool)
        self._lines: list[tuple[Branch, cKDTree]] = []

    def _changes(self) -> Iterator[np.ndarray]:
        """Yield the two neighbouring cells of every change between periodic classes."""
        index = np.moveaxis(np.indices(self._classes.shape[:2]), 0, 2)
        for low, high in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
            before, after = self._classes[low], self._classes[high]
            where = (before != after).any(axis=2) & (before[..., 0] > 0) & (after[..., 0] > 0)
            yield from np.stack([index[low][where], index[high][where]], axis=1)

    def run(self) -> xr.Dataset:
        """Search from the large tongues, and then from every change that no curve explains yet."""
        for cell, axis in self._tongues():
            for point in self._borders(cell, axis):
                if not self._is_on_curve(point, axis, cell):
                    with suppress(OrbitError):  # the search from its changes reports the reason
                        self._follow(point)
        reasons: dict[int, str] = {}
        while (chosen := self._next(reasons)) is not None:
            try:
                self._follow(self._bifurcation(self._cells[chosen]))
                reasons[chosen] = "the curve found there is of other classes"
            except OrbitError as error:
                reasons[chosen] = str(error)
        counted: dict[str, Counter[str]] = {}
        for i in np.flatnonzero(~self._explained).tolist():
            pair = " and ".join(f"{m}/{q}" for m, q in self._names[i])
            counted.setdefault(reasons[i], Counter())[pair] += 1
        return self._as_dataset(counted)

    def _as_dataset(self, reasons: Mapping[str, Counter[str]]) -> xr.Dataset:
        """Collect the curves found as the Dataset that `curves` returns."""
        found = [curve for curve, _ in self._lines]
        special = [point for curve in found for point in curve.special]
        at = np.array([point.value for point in special]).reshape(-1, 2)
        data = {
            "kind": ("number", np.array([curve.kind for curve in found], "U11")),
            "special_kind": ("special", np.array([point.kind for point in special], "U11")),
            "special_values": (("special", "parameter"), at),
        }
        changes, explained = len(self._cells), int(self._explained.sum())
        about = {
            "changes": changes,
            "explained": explained,
            "summary": summary(found, changes, explained, reasons),
        }
        return numbered_dataset(found, "curve", self._axes, data, about)

    def _tongues(self) -> Iterator[tuple[np.ndarray, int]]:
        """Yield the middle of every large tongue where it is widest, for each axis."""
        flat = self._classes.reshape(-1, 2)
        names, counts = np.unique(flat[flat[:, 0] > 0], axis=0, return_counts=True)
        for name in names[counts >= LARGE * len(flat)]:
            inside = (self._classes == name).all(axis=2)
            for axis in (0, 1):
                widest = int(np.argmax(inside.sum(axis=axis)))
                within = np.flatnonzero(inside.take(widest, axis=1 - axis))
                middle = int(within[len(within) // 2])
                yield np.array([middle, widest] if axis == 0 else [widest, middle]), axis

    def _borders(self, cell: np.ndarray, axis: int) -> Iterator[SpecialPoint]:
        """Yield the nearest bifurcations on both sides of a cell, on the branch of its orbit."""
        values = self._values[axis]
        try:
            special = self._branch(cell, axis, values[0], values[-1]).special
        except OrbitError:
            return
        away = [(point.value - values[cell[axis]], point) for point in special]
        for side in (-1.0, 1.0):
            beyond = [pair for pair in away if side * pair[0] > 0.0]
            _, point = min(beyond, key=lambda pair: abs(pair[0]), default=(0.0, None))
            if point is not None and point.kind in KINDS:
                yield point

    def _is_on_curve(self, point: SpecialPoint, axis: int, cell: np.ndarray) -> bool:
        """Whether a bifurcation on the line through a cell lies on a curve found before."""
        at = cell.astype(float)
        at[axis] = np.interp(point.value, self._values[axis], np.arange(len(self._values[axis])))
        return any(
            (curve.kind, curve.m, curve.q) == (point.kind, point.orbit.m, point.orbit.q)
            and line.query(at, p=np.inf)[0] < _ON
            for curve, line in self._lines
        )

    def _next(self, reasons: Container[int]) -> int | None:
        """Return the next change to search from, the middle one of the most frequent pair.

        Only changes without a curve and without a reason count; None if there is none.
        """
        groups: dict[tuple[tuple[int, int], ...], list[int]] = {}
        for i in np.flatnonzero(~self._explained).tolist():
            if i not in reasons:
                groups.setdefault(self._names[i], []).append(i)
        if not groups:
            return None
        most = max(groups.values(), key=len)
        return most[len(most) // 2]

    def _orbit(self, cell: np.ndarray) -> PeriodicOrbit:
        """Return the orbit of a cell; raise OrbitError if none of the same class is found."""
        orbit = self._motions.orbit(*cell)
        if [orbit.m, orbit.q] != self._classes[*cell].tolist():
            raise OrbitError("a motion has not settled: its orbit is of another class")
        return orbit

    def _branch(self, cell: np.ndarray, axis: int, low: float, high: float) -> Branch:
        return branch(self._orbit(cell), self._axes[axis], float(low), float(high))

    def _bifurcation(self, cells: np.ndarray) -> SpecialPoint:
        """Return the bifurcation at a change, sought from both sides; OrbitError has the reason."""
        axis = int(np.flatnonzero(cells[0] != cells[1])[0])
        values = self._values[axis]
        ends = values[cells[0, axis]], values[cells[1, axis]]
        beyond = _CELLS * (ends[1] - ends[0])
        low, high = max(values[0], ends[0] - beyond), min(values[-1], ends[1] + beyond)
        points: list[SpecialPoint] = []
        reason = "both motions are stable on both sides, and the start decides"
        for cell in cells:
            try:
                points += self._branch(cell, axis, low, high).special
            except OrbitError as error:
                reason = str(error)
        bifurcations = [point for point in points if point.kind in KINDS]
        if bifurcations:
            middle = 0.5 * (ends[0] + ends[1])
            return min(bifurcations, key=lambda point: abs(point.value - middle))
        ends_so = [point.kind for point in points if point.kind != "edge"]
        raise OrbitError(f"a branch ends there: {ends_so[0]}" if ends_so else reason)

    def _follow(self, point: SpecialPoint) -> None:
        """Follow a bifurcation in both parameters, and mark the changes that its curve explains.

        Raises OrbitError if it cannot be followed.
        """
        if len(self._lines) >= MOST_CURVES:
            raise OrbitError(f"curves beyond the first {MOST_CURVES} are not followed")
        first, second = (
            (axis, float(values[0]), float(values[-1]))
            for axis, values in zip(self._axes, self._values, strict=True)
        )
        curve = bifurcation_curve(point.orbit, point.kind, first, second)
        line = self._line(curve)
        self._lines.append((curve, line))
        separated = {(curve.m, curve.q)}
        if curve.kind == "flip":
            separated.add((2 * curve.m, 2 * curve.q))
        elif curve.kind == "graze":
            separated.add((1, 0) if curve.q == 1 else (curve.m, curve.q - 1))
        separated_rows = np.array([not separated.isdisjoint(pair) for pair in self._names], bool)
        rows = np.flatnonzero(separated_rows & ~self._explained)
        distances, _ = line.query(self._cells[rows].mean(axis=1), p=np.inf)
        self._explained[rows[distances <= 1.0]] = True

    def _line(self, curve: Branch) -> cKDTree:
        """Return points along a curve, at most a quarter of a cell apart, in units of cells."""
        from scipy.spatial import cKDTree

        columns = zip(curve.values.T, self._values, strict=True)
        line = np.stack(
            [np.interp(column, values, np.arange(len(values))) for column, values in columns], 1
        )
        steps = np.ceil(4.0 * np.abs(np.diff(line, axis=0)).max(axis=1, initial=0.0)).astype(int)
        along = np.concatenate([[0], np.cumsum(np.maximum(steps, 1))])
        points = np.arange(along[-1] + 1)
        return cKDTree(np.stack([np.interp(points, along, column) for column in line.T], axis=1))
