"""One number for each attractor along the axes: a motion seeded on it leads to the next.

Two attractors at neighbouring values of an axis get the same number if each is the nearest to the
other and their distance is at most ``MAX_DISTANCE``. An attractor keeps its number through a flip:
an orbit of m periods may continue as a nearby orbit of 2 m or m / 2 periods, as the branches of a
diagram do. It loses its number in a jump, for example at the end of a window.

If a step moves the section by more, motions are seeded on each of the two attractors, with the
parameters of the other. They get the same number if each seed leads to the other attractor, and
their classes are the same, or m/q and 2 m/2 q.

These links form chains along the longest axis, also over gaps of at most ``MAX_GAP`` of the axis,
because at a few values no start may reach the attractor, or settle on it. Along the other axes
chains are joined, those with the longest border first, but never two chains that coexist at some
point. Around a cusp, where one attractor leads to another, the number therefore changes along some
line.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from sweeps.opened.motions import ORBIT_TOLERANCE, Cycles, cycles_of, distances, motions_from
from vibroimpact.destination.repetition import LONGEST_PERIOD
from vibroimpact.points.computation import compute_points
from vibroimpact.points.stages import RunSpec

#: Attractors farther apart than this, relative to their greatest coordinate, are different.
MAX_DISTANCE = 0.2
#: Longest gap that is bridged, as a share of an axis.
MAX_GAP = 1 / 32
#: Most attractors of a parameter point that are tracked: all pairs of two points are compared.
MOST_TRACKED = 50
#: Forcing periods for which a seed moves, and the record after them that shows its class.
_SEED_PERIODS, _SEED_RECORD = 500, 2 * LONGEST_PERIOD

#: Tells which pairs of attractors, given by two arrays of indices, are linked.
Links = Callable[[np.ndarray, np.ndarray], np.ndarray]


def track(shape: tuple[int, ...], point: np.ndarray, near: Links, seeded: Links) -> np.ndarray:
    """Return a number from 0 for each attractor, the same for those that continue each other.

    `shape` is the shape of the grid of parameter points, and `point` the index of that of each
    attractor, increasing. `seeded` is asked where `near` finds no link along the longest axis.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count = len(point)
    longest = int(np.argmax(shape))
    gap = max(1, int(MAX_GAP * shape[longest]))
    over = [(1, near), (1, seeded), *((step, near) for step in range(2, gap + 1))]
    a, b = _along(shape, point, longest, over)
    ends = a.astype(np.int32), b.astype(np.int32)  # SciPy 1.11 needs int32
    linked = coo_array((np.ones(len(a)), ends), (count, count))
    chain = connected_components(linked, directed=False)[1]
    others = (axis for axis in range(len(shape)) if axis != longest)
    borders = [chain[_along(shape, point, axis, [(1, near)])] for axis in others]
    return _joined_chains(chain, point, np.concatenate(borders, axis=1)) if borders else chain


def _along(
    shape: tuple[int, ...], point: np.ndarray, axis: int, links: Sequence[tuple[int, Links]]
) -> np.ndarray:
    """Return the pairs linked along an axis, shape (2, n); an attractor has at most one per side.

    The `links` are tried one after the other, each between values that are some steps apart.
    """
    stride = int(np.prod(shape[axis + 1 :], dtype=np.int64))
    at = point // stride % shape[axis]
    free = np.tile(np.bincount(point)[point] <= MOST_TRACKED, (2, 1))  # without a link on a side
    of_steps = [np.empty((2, 0), np.int64)]
    for step, linked in links:
        a, b = np.flatnonzero(free[0] & (at < shape[axis] - step)), np.flatnonzero(free[1])
        first, last = (
            np.searchsorted(point[b], point[a] + step * stride, side) for side in ("left", "right")
        )
        row = np.repeat(np.arange(len(a)), last - first)
        column = np.arange(len(row)) + (last - np.cumsum(last - first))[row]
        pairs = np.stack([a[row], b[column]])
        pairs = pairs[:, linked(*pairs)]
        free[[[0], [1]], pairs] = False
        of_steps.append(pairs)
    return np.concatenate(of_steps, axis=1)


def mutually_nearest(cycles: Cycles, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the mask of the pairs in which each is the nearest to the other, and near enough."""
    apart = distances(cycles, a, b)
    mutual = apart <= MAX_DISTANCE
    for first, second in ((a, b), (b, a)):
        order = np.lexsort((second, apart, first))
        mutual[order[1:]] &= np.diff(first[order]) > 0
    return mutual


def lead_to_each_other(
    spec: RunSpec, motions: np.ndarray, a: np.ndarray, b: np.ndarray
) -> np.ndarray:
    """Return the mask of the pairs of motions in which a seed from each leads to the other."""
    m, q, mask = motions["m"], motions["q"], np.zeros(len(a), bool)
    spec = spec.part(_SEED_PERIODS, _SEED_RECORD, 0, False)
    at = np.flatnonzero(np.isin(m[b] / m[a], (0.5, 1.0, 2.0)) & (q[b] * m[a] == q[a] * m[b]))
    for first, second in ((a, b), (b, a)):
        if not len(at):
            break
        from_, to = motions[first[at]], motions[second[at]]
        seeds = to["point"].copy()
        seeds["x0"] = np.minimum(from_["point"]["x0"], seeds["clearance"])
        seeds["v0"] = from_["point"]["v0"]
        ends = motions_from(spec, seeds, compute_points(spec, seeds, None))
        there = (ends["m"] == to["m"]) & (ends["q"] == to["q"])
        at, ends, to = at[there], ends[there], to[there]
        pairs = np.arange(2 * len(at)).reshape(2, -1)
        cycles = cycles_of(spec, np.concatenate([ends, to]))
        at = at[distances(cycles, *pairs) <= ORBIT_TOLERANCE]
    mask[at] = True
    return mask


def _joined_chains(chain: np.ndarray, point: np.ndarray, borders: np.ndarray) -> np.ndarray:
    """Join chains that have `borders`, shape (2, n), unless they share a parameter point."""
    from scipy.cluster.hierarchy import DisjointSet

    points = [set[int]() for _ in range(chain.max() + 1)]
    for number, at in zip(chain.tolist(), point.tolist(), strict=True):
        points[number].add(at)
    joined = DisjointSet(range(len(points)))
    pairs, lengths = np.unique(borders, axis=1, return_counts=True)
    for pair in pairs[:, np.argsort(-lengths, kind="stable")].T.tolist():
        a, b = (joined[number] for number in pair)
        if a != b and points[a].isdisjoint(points[b]):
            joined.merge(a, b)
            points[joined[a]] = points[a] | points[b]
    names = [joined[number] for number in range(len(points))]
    return np.unique(names, return_inverse=True)[1][chain]
