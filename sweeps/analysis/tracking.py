"""Track attractors from one parameter point to the next: each has one number along the axes.

Two attractors at neighbouring values of an axis get the same number if each is the nearest to the
other and their distance is at most ``MAX_DISTANCE``. If a step moves the section by more, they get
the same number if both are on the same exact branch (`vibroimpact.branch`): either the branch of
one leads to the other, or the branches of m and of 2 m periods lead to the same flip. An attractor
keeps its number through a flip: an orbit of m periods may continue as a nearby orbit of 2 m or
m / 2 periods, as the branches of a diagram do. It loses its number in a jump, for example at the
end of a window.

These links form chains along the longest axis, also over gaps of at most ``MAX_GAP`` of the axis,
because at a few values no start may reach the attractor, or settle on it. Along the other axes
chains are joined, those with the longest border first, but never two chains that coexist at some
point. Around a cusp, where one attractor leads to another, the number therefore changes along some
line.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from sweeps.analysis.motions import leads_to, orbit_of, same_orbit
from sweeps.analysis.section_distance import Cycles, distances, sizes
from vibroimpact.orbits.periodic import OrbitError, PeriodicOrbit

#: Attractors farther apart than this, relative to their greatest coordinate, are different.
MAX_DISTANCE = 0.2
#: Most pairs whose exact branches are tried; each pair takes some milliseconds.
MOST_BRANCHES = 1000
#: Longest gap that is bridged, as a share of an axis.
MAX_GAP = 1 / 32

#: Tells whether an attractor continues as another one at the next value of the longest axis.
Continues = Callable[[int, int], bool]


@dataclass(frozen=True)
class PeriodicAttractors:
    """Periodic attractors, in the order of their parameter points."""

    at: np.ndarray  # index of the point that represents the attractor; int, shape (n,)
    point: np.ndarray  # index of its parameter point, increasing; int, shape (n,)
    m: np.ndarray  # forcing periods per repetition; int, shape (n,)
    place: np.ndarray  # index of its cycle in ``cycles[m]``; int, shape (n,)
    cycles: Mapping[int, Cycles]  # the cycles, by m

    def distances(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Return the distances of pairs; inf unless their periods are equal or one is double."""
        swap = self.m[a] > self.m[b]
        a, b = np.where(swap, b, a), np.where(swap, a, b)
        apart = np.full(len(a), np.inf)
        for m in np.unique(self.m[a]):
            for turns in (1, 2):
                pairs = np.flatnonzero((self.m[a] == m) & (self.m[b] == turns * m))
                if len(pairs):
                    shorter = self.cycles[m][self.place[a[pairs]]]
                    longer = self.cycles[turns * m][self.place[b[pairs]]]
                    apart[pairs] = distances(shorter, longer)
        return apart

    def links(self, a: np.ndarray, b: np.ndarray, step: int) -> tuple[np.ndarray, np.ndarray]:
        """Pair attractors of `a` with attractors of `b` that continue them `step` points further.

        `a` and `b` must be in increasing order. No attractor is in two pairs.
        """
        nearest, back = self._nearest(a, b, step), self._nearest(b, a, -step)
        found = np.flatnonzero(nearest < len(b))
        mutual = found[back[nearest[found]] == found]
        return a[mutual], b[nearest[mutual]]

    def _nearest(self, a: np.ndarray, b: np.ndarray, step: int) -> np.ndarray:
        """Return the index in `b` of the nearest that continues each of `a`; len(b) if none."""
        from scipy.spatial import KDTree

        sites, unit, sizes_of, R = self._sites
        best, nearest = np.full(len(a), MAX_DISTANCE), np.full(len(a), len(b))
        tree, most = KDTree(sites[b]), sizes_of[b].max(initial=0.0)
        for turns in (0.5, 1.0, 2.0):
            targets = sites[a] * [1.0, 1.0, 1.0, turns] + [0.0, 0.0, step, 0.0]
            left, count = np.flatnonzero(np.isin(turns * self.m[a], self.m[b])), 4
            while len(left):
                away, there = tree.query(targets[left], count, p=np.inf, distance_upper_bound=0.4)
                row, column = np.nonzero(there < len(b))
                i, j = left[row], there[row, column]
                pairs = (a[i], b[j]) if step > 0 else (b[j], a[i])
                apart = self.distances(*pairs)
                order = np.lexsort((-j, -apart))
                i, j, apart = i[order], j[order], apart[order]  # the nearest of each last
                nearer = (apart < best[i]) | ((apart == best[i]) & (j < nearest[i]))
                best[i[nearer]], nearest[i[nearer]] = apart[nearer], j[nearer]
                # Places are at most as far apart as the cycles, unless R differs.
                more = there[:, -1] < len(b)
                away, left, last = unit * away[more, -1], left[more], b[there[more, -1]]
                largest = np.maximum(np.maximum(sizes_of[a[left]], most), np.finfo(float).tiny)
                beyond = (1.0 - 1e-9) * away / largest - np.abs(R[a[left]] - R[last])
                left, count = left[beyond <= best[left]], 2 * count
        return nearest

    @cached_property
    def _sites(self) -> tuple[np.ndarray, float, np.ndarray, np.ndarray]:
        """Places in a unit, parameter points and m, (n, 4); that unit; greatest coordinates; R."""
        places, sizes_of = np.empty((len(self.at), 2)), np.empty(len(self.at))
        R = np.empty(len(self.at))
        for m, cycles in self.cycles.items():
            of_m = np.flatnonzero(self.m == m)
            own = cycles[self.place[of_m]]
            places[of_m], sizes_of[of_m], R[of_m] = own.places(), sizes(own.states), own.R
        unit = 5.0 * (float(np.abs(places).max(initial=0.0)) or 1.0)
        return np.column_stack([places / unit, self.point, self.m]), unit, sizes_of, R

    def links_on_branches(
        self, a: np.ndarray, b: np.ndarray, step: int, on_one_branch: Continues
    ) -> tuple[np.ndarray, np.ndarray]:
        """Pair attractors on the same exact branch, at any distance; otherwise as `links` does."""
        pairs: dict[int, int] = {}
        taken: set[int] = set()
        tried = 0
        begins, ends = (
            np.searchsorted(self.point[b], self.point[a] + step, side) for side in ("left", "right")
        )
        for i, begin, end in zip(a.tolist(), begins.tolist(), ends.tolist(), strict=True):
            for j in b[begin:end].tolist():
                shorter, longer = sorted((self.m[i], self.m[j]))
                if j in taken or longer not in (shorter, 2 * shorter):
                    continue
                tried += 1
                if tried > MOST_BRANCHES:
                    break
                if on_one_branch(i, j):
                    pairs[i] = j
                    taken.add(j)
                    break
        return np.array([*pairs], np.int64), np.array([*pairs.values()], np.int64)


def track(
    shape: tuple[int, ...],
    attractors: PeriodicAttractors,
    on_one_branch: Continues | None = None,
) -> np.ndarray:
    """Return a number for each attractor, shape (n,), the same for those that continue each other.

    `shape` is the shape of the grid of parameter points.
    """
    alone = np.arange(len(attractors.point))
    if not shape or not len(alone):
        return alone
    longest = int(np.argmax(shape))
    before = alone.copy()
    gap = max(1, int(MAX_GAP * shape[longest]))
    for a, b in _along(shape, attractors, longest, gap, on_one_branch):
        before[b] = a
    while not np.array_equal(before, before[before]):  # each pass doubles the distance back
        before = before[before]
    borders: Counter[tuple[int, int]] = Counter()
    for axis in range(len(shape)):
        if axis != longest and shape[axis] > 1:
            for a, b in _along(shape, attractors, axis, 1):
                pairs, lengths = np.unique(before[[a, b]], axis=1, return_counts=True)
                borders.update(
                    dict(zip(map(tuple, pairs.T.tolist()), lengths.tolist(), strict=True))
                )
    return _joined(before, attractors.point, borders) if borders else before


def exact_links(axis: str, phase: float, motions: np.ndarray) -> Continues:
    """Return the function that tells whether two attractors are on one exact branch along an axis.

    `motions`, of dtype ``MOTION``, are the attractors, and `phase` is that of the section. The file
    must have been computed with exact impacts.
    """

    @cache
    def stable_orbit(a: int) -> PeriodicOrbit | None:
        with suppress(OrbitError):
            orbit = orbit_of(motions[a], phase)
            return orbit if orbit.stable else None
        return None

    def on_one_branch(a: int, b: int) -> bool:
        first, second = stable_orbit(a), stable_orbit(b)
        if first is None or second is None:
            return False
        there = leads_to(first, axis, getattr(second.oscillator, axis))
        if (first.m, first.q) == (second.m, second.q):
            return there.kind == "edge" and same_orbit(there.orbit, second, phase)
        back = leads_to(second, axis, getattr(first.oscillator, axis))
        return there.kind == back.kind == "flip" and same_orbit(there.orbit, back.orbit, phase)

    return on_one_branch


def _along(
    shape: tuple[int, ...],
    attractors: PeriodicAttractors,
    axis: int,
    longest_step: int,
    on_one_branch: Continues | None = None,
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the links along an axis, over gaps last; each attractor has at most one per side."""
    n = len(attractors.point)
    stride = int(np.prod(shape[axis + 1 :], dtype=np.int64))
    at = attractors.point // stride % shape[axis]
    ends, begins = np.ones(n, bool), np.ones(n, bool)
    for step in range(1, longest_step + 1):
        a = np.flatnonzero(ends & (at < shape[axis] - step))
        b = np.flatnonzero(begins & (at >= step))
        a, b = attractors.links(a, b, step * stride)
        ends[a] = begins[b] = False
        yield a, b
        if step == 1 and on_one_branch is not None:
            open_ends = np.flatnonzero(ends & (at < shape[axis] - 1))
            open_begins = np.flatnonzero(begins & (at >= 1))
            a, b = attractors.links_on_branches(open_ends, open_begins, stride, on_one_branch)
            ends[a] = begins[b] = False
            yield a, b


def _joined(
    chain: np.ndarray, point: np.ndarray, borders: Mapping[tuple[int, int], int]
) -> np.ndarray:
    """Join chains along their borders, longest first, unless they share a parameter point."""
    from scipy.cluster.hierarchy import DisjointSet

    joined = DisjointSet(a for pair in borders for a in pair)
    points: dict[int, set[int]] = {}
    for a, at in zip(chain.tolist(), point.tolist(), strict=True):
        points.setdefault(a, set()).add(at)
    for pair, _ in sorted(borders.items(), key=lambda item: (-item[1], item[0])):
        a, b = (joined[number] for number in pair)
        if a != b and points[a].isdisjoint(points[b]):
            joined.merge(a, b)
            kept = joined[a]
            points[kept] |= points.pop(b if kept == a else a)
    names = np.arange(len(chain))
    for a in joined:
        names[a] = joined[a]
    return names[chain]
