"""The exact curves of flips, folds and grazes over a map: where its tongues end.

A change between two periodic classes, from one cell of the map to the next, is a seed: the orbit of
one side is followed towards the other until it flips, folds or grazes, and that is followed in both
parameters (`vibroimpact.orbits.curves`). A change counts as explained where a curve of one of its
classes passes within one cell. Curves are sought until no change is left that could give one.
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np
import xarray as xr

from sweeps.analysis.motion import Motion, classify
from sweeps.analysis.selection import Cut, Setting, chosen_axes, select
from sweeps.errors import Refused
from vibroimpact.orbits.branches import branch
from vibroimpact.orbits.curves import Curve, bifurcation_curve
from vibroimpact.orbits.periodic import OrbitError, PeriodicOrbit, periodic_orbit
from vibroimpact.oscillator import Oscillator

#: Longer orbits are not followed, nor more curves than this, and a pair of classes from which so
#: many changes lead to no curve is left.
MOST_PERIODS, MOST_CURVES, MOST_FAILURES = 8, 400, 4
#: How far beyond a change, in cells, its bifurcation is looked for.
_CELLS = 0.5


@dataclass
class CurveSearch:
    """The curves over a map, and which of its changes they explain.

    Attributes
    ----------
    axes : tuple of str
        Abscissa and ordinate.
    curves : list of Curve
    changes : int
        Between periodic classes.
    explained : int
        Those with a curve of one of their classes within one cell.
    reasons : Counter
        Why the others have none.
    """

    axes: tuple[str, str]
    curves: list[Curve] = field(default_factory=list)
    changes: int = 0
    explained: int = 0
    reasons: Counter[str] = field(default_factory=Counter)

    def told(self) -> list[str]:
        """Say it in lines."""
        if not self.changes:
            return ["there is no change between periodic classes"]
        share = self.explained / self.changes
        kinds = Counter(curve.kind for curve in self.curves)
        counted = ", ".join(f"{kinds[kind]} of {kind}s" for kind in kinds) or "none"
        lines = [
            f"{len(self.curves)} exact curves: {counted}",
            f"{self.explained:,} of {self.changes:,} changes between periodic classes "
            f"({100.0 * share:.1f} %) have a curve within one cell",
        ]
        return lines + [f"  {count:,}: {reason}" for reason, count in self.reasons.most_common()]


def find_curves(
    dataset: xr.Dataset, axes: Sequence[str] = (), at: Cut | None = None
) -> CurveSearch:
    """Follow the bifurcations between the periodic motions of a map.

    Parameters
    ----------
    dataset : Dataset
        From `sweeps.open_sweep`, with ``period``.
    axes : sequence of str, optional
        Abscissa and ordinate, by default as a map has them.
    at : mapping of str to float, optional
        Values of the other swept axes; by default the first.

    Raises
    ------
    Refused
        If there are no such axes, or the orbits do not depend on one.
    """
    across, up = map_axes(dataset, axes)
    names = [item.name for item in fields(Oscillator)]
    for axis in (across, up):
        if axis not in names:
            raise Refused(f"the exact orbits do not depend on {axis}; draw the map without them")
    if "period" not in dataset:
        raise Refused(
            "the file has no period: run the sweep again with record.diagnostics: [period]"
        )
    cut = select(dataset, at, free=[across, up]).sortby([across, up]).transpose(across, up, ...)
    return _Search(cut, (across, up)).run()


def map_axes(dataset: xr.Dataset, axes: Sequence[str] = ()) -> list[str]:
    """Return abscissa and ordinate, by default the two longest axes; of equals, the later first."""
    chosen = chosen_axes(dataset, axes, 2, "map")
    if not axes and dataset.sizes[chosen[0]] == dataset.sizes[chosen[1]]:
        chosen.reverse()
    return chosen


class _Search:
    """One search for curves."""

    def __init__(self, cut: xr.Dataset, axes: tuple[str, str]) -> None:
        self._axes = axes
        self._values = [cut[axis].values for axis in axes]
        setting, first = Setting.of(cut), cut.isel(dict.fromkeys(axes, 0))
        names = [item.name for item in fields(Oscillator)]
        self._first = Oscillator(**{name: setting.value(name, first) for name in names})
        self._phase = setting.phase
        last = [cut[name].isel(section=-1).values for name in ("poincare_x", "poincare_v")]
        self._states = np.stack(last, axis=2)
        periodic = classify(cut) == Motion.PERIODIC
        self._m = np.where(periodic, cut["period"].values, 0)
        self._q = np.where(periodic, cut["period_impacts"].values, 0)
        self._pairs = np.array(list(self._changes())).reshape(-1, 2, 2)
        self._explained = np.zeros(len(self._pairs), bool)
        self._result = CurveSearch(axes, changes=len(self._pairs))

    def _changes(self) -> Iterator[np.ndarray]:
        """Yield the cells on both sides of every change between periodic classes."""
        index = np.moveaxis(np.indices(self._m.shape), 0, 2)
        for axis in (0, 1):
            low = (slice(None, -1), slice(None)) if axis == 0 else (slice(None), slice(None, -1))
            high = (slice(1, None), slice(None)) if axis == 0 else (slice(None), slice(1, None))
            m, q = self._m, self._q
            differ = (m[low] != m[high]) | (q[low] != q[high])
            where = differ & (m[low] > 0) & (m[high] > 0)
            yield from np.stack([index[low][where], index[high][where]], axis=1)

    def run(self) -> CurveSearch:
        """Look for curves until nothing is left to look for."""
        result, failures = self._result, Counter[tuple[int, ...]]()
        tried = np.zeros(len(self._pairs), bool)
        names = [self._classes(pair) for pair in self._pairs]
        reasons: dict[tuple[int, ...], str] = {}
        while len(result.curves) < MOST_CURVES:
            left = Counter(
                names[i]
                for i in np.flatnonzero(~self._explained & ~tried).tolist()
                if failures[names[i]] < MOST_FAILURES
            )
            if not left:
                break
            name = left.most_common(1)[0][0]
            own = [
                i for i in np.flatnonzero(~self._explained & ~tried).tolist() if names[i] == name
            ]
            chosen = own[len(own) // 2]
            tried[chosen] = True
            try:
                curve = self._curve(self._pairs[chosen])
            except OrbitError as error:
                failures[name] += 1
                reasons[name] = str(error)
                continue
            result.curves.append(curve)
            self._explain(curve, names)
            if not self._explained[chosen]:
                failures[name] += 1
                reasons[name] = "the curve found there is of another class"
        result.explained = int(self._explained.sum())
        for i in np.flatnonzero(~self._explained).tolist():
            result.reasons[reasons.get(names[i], "not tried")] += 1
        return result

    def _classes(self, pair: np.ndarray) -> tuple[int, ...]:
        (a, b), (c, d) = pair.tolist()
        ends = sorted(
            [(int(self._m[a, b]), int(self._q[a, b])), (int(self._m[c, d]), int(self._q[c, d]))]
        )
        return (*ends[0], *ends[1])

    def _orbit(self, cell: np.ndarray) -> PeriodicOrbit:
        i, j = cell.tolist()
        if self._m[i, j] > MOST_PERIODS:
            raise OrbitError(f"orbits of more than {MOST_PERIODS} periods are not followed")
        here = {
            axis: float(values[k])
            for axis, values, k in zip(self._axes, self._values, (i, j), strict=True)
        }
        x, v = self._states[i, j].tolist()
        return periodic_orbit(replace(self._first, **here), x, v, int(self._m[i, j]), self._phase)

    def _curve(self, pair: np.ndarray) -> Curve:
        """Follow the bifurcation at a change of class, coming from either side."""
        axis = int(np.flatnonzero(pair[0] != pair[1])[0])
        name, values = self._axes[axis], self._values[axis]
        ends = values[pair[0, axis]], values[pair[1, axis]]
        width = ends[1] - ends[0]
        low, high = max(values[0], ends[0] - 2 * width), min(values[-1], ends[1] + 2 * width)
        nearest = ends[0] - _CELLS * width, ends[1] + _CELLS * width
        reason = ""
        for cell in pair:
            try:
                orbit = self._orbit(cell)
                followed = branch(orbit, name, float(low), float(high))
            except OrbitError as error:
                reason = str(error)
                continue
            near = [
                point
                for point in followed.special
                if point.kind in ("flip", "fold", "graze")
                and nearest[0] <= point.value <= nearest[1]
            ]
            if near:
                middle = 0.5 * (ends[0] + ends[1])
                best = min(near, key=lambda point: abs(point.value - middle))
                ranges = [
                    (axis, float(values[0]), float(values[-1]))
                    for axis, values in zip(self._axes, self._values, strict=True)
                ]
                return bifurcation_curve(best.orbit, best.kind, ranges[0], ranges[1])
            reason = "both orbits go on beyond the change: the start decides"
        raise OrbitError(reason)

    def _explain(self, curve: Curve, names: Sequence[tuple[int, ...]]) -> None:
        """Mark the changes of the classes of a curve that it passes within one cell."""
        from scipy.spatial import cKDTree

        cells = [
            np.interp(column, values, np.arange(len(values)))
            for column, values in zip(curve.values.T, self._values, strict=True)
        ]
        line = np.stack(cells, axis=1)
        steps = np.ceil(4.0 * np.abs(np.diff(line, axis=0)).max(axis=1, initial=0.0)).astype(int)
        parts = [
            line[i]
            + np.linspace(0.0, 1.0, max(1, n), endpoint=False)[:, None] * (line[i + 1] - line[i])
            for i, n in enumerate(steps.tolist())
        ]
        tree = cKDTree(np.concatenate([*parts, line[-1:]]))
        separated = {(curve.m, curve.q)}
        if curve.kind == "flip":
            separated.add((2 * curve.m, 2 * curve.q))
        elif curve.kind == "graze":
            separated.add((curve.m, curve.q - 1))
        own = np.array([bool({name[:2], name[2:]} & separated) for name in names])
        distances, _ = tree.query(self._pairs.mean(axis=1), p=np.inf)
        self._explained |= own & (distances <= 1.0)


def curves(dataset: xr.Dataset, axes: Sequence[str] = (), at: Cut | None = None) -> xr.Dataset:
    """Follow the bifurcations between the periodic motions of a map; arguments as `find_curves`.

    Returns
    -------
    Dataset
        Along ``point``, curve after curve: the two axes and ``curve`` (its number). Along
        ``number``: ``kind``, ``m`` and ``q`` of each curve. Along ``special``: ``special_kind``,
        ``special_curve`` and ``special_values`` (``special``, 2). The attributes ``changes`` and
        ``explained`` count the changes between periodic classes, and those with a curve within one
        cell; ``told`` says why the others have none.
    """
    return as_dataset(find_curves(dataset, axes, at))


def as_dataset(search: CurveSearch) -> xr.Dataset:
    """Return what was found as `curves` does."""
    all_ = search.curves
    special = [(number, point) for number, one in enumerate(all_) for point in one.special]
    values = np.concatenate([one.values for one in all_] or [np.empty((0, 2))])
    data = {
        "curve": ("point", np.repeat(np.arange(len(all_)), [len(one.values) for one in all_])),
        "kind": ("number", np.array([one.kind for one in all_], "U11")),
        "m": ("number", np.array([one.m for one in all_], int)),
        "q": ("number", np.array([one.q for one in all_], int)),
        "special_kind": ("special", np.array([point.kind for _, point in special], "U11")),
        "special_curve": ("special", np.array([number for number, _ in special], int)),
        "special_values": (
            ("special", "parameter"),
            np.array([point.values for _, point in special]).reshape(-1, 2),
        ),
    }
    coordinates = {axis: ("point", values[:, i]) for i, axis in enumerate(search.axes)}
    told = {"changes": search.changes, "explained": search.explained}
    return xr.Dataset(data, coordinates, told | {"told": "\n".join(search.told())})


def write_curves(path: Path, search: CurveSearch) -> None:
    """Write the points of curves, and then of each its special points, to a CSV file."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["curve", "kind", "m", "q", *search.axes, "special"])
        for number, curve in enumerate(search.curves):
            head = [number, curve.kind, curve.m, curve.q]
            writer.writerows([*head, *values, ""] for values in curve.values.tolist())
            writer.writerows([*head, *p.values.tolist(), p.kind] for p in curve.special)
