"""Periodic motions as cycles of section states: their distances, and which of them are equal.

A cycle consists of the states of a motion at m passages of the section, in time order. It may begin
at any of the m states, because a motion of m forcing periods can be reached at m phases. The
distance of two cycles compares the states at matching places, for the best rotation of one against
the other. So states that nearly agree in one coordinate cannot be confused.

If the phase of an impact passes the phase of the section along an axis, the state at the section
jumps from before the impact to after it, although the motion changes continuously. Therefore a
state just before an impact counts as near a state just after it: their distance is the distance of
both from the impact (Biemond, van de Wouw, Heemels & Nijmeijer 2013, IEEE Trans. Autom. Control 58,
876-890).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from itertools import product

import numpy as np

#: Cycles closer than this, relative to their greatest coordinate, are the same motion.
ORBIT_TOLERANCE = 1e-3
#: Number of values compared at a time, so that they stay in the cache.
_VALUES_AT_ONCE = 25_000


@dataclass(frozen=True)
class Cycles:
    """Periodic motions, each with its states at the section in a repetition."""

    #: x - clearance and v in the same unit, for example v / omega. Tolerances are thus relative to
    #: the distance from the stop, wherever the stop is. Shape (n, greatest m, 2); NaN beyond m.
    states: np.ndarray
    m: np.ndarray  # forcing periods; int, shape (n,)
    R: np.ndarray  # coefficient of restitution; shape (n,)


def section_distance(
    states: np.ndarray,
    states_0: np.ndarray,
    clearance: np.ndarray | float,
    R: np.ndarray,
    scale: np.ndarray | tuple[float, float] = (1.0, 1.0),
) -> np.ndarray:
    """Return the distance of states at a section, directly or through an impact, if that is less.

    States are x and v, shape (..., 2), and `scale` gives their units. The clearance and R are
    broadcast against x. The distance is the larger of the distances in x and in v, in these units.
    """
    (x, v), (x_0, v_0) = np.moveaxis(states, -1, 0), np.moveaxis(states_0, -1, 0)
    X, V = np.moveaxis(np.asarray(scale), -1, 0)
    direct = np.maximum(np.abs(x - x_0) / X, np.abs(v - v_0) / V)
    to_stop = np.maximum(np.abs(x - clearance), np.abs(x_0 - clearance)) / X
    rebound = np.abs(np.minimum(v, v_0) + R * np.maximum(v, v_0)) / V
    return np.minimum(direct, np.maximum(to_stop, rebound))


def distances(cycles: Cycles, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the distances of pairs of cycles, given their indices `a` and `b`, shape (n,).

    A cycle of 2 m periods is compared with two turns of one of m periods; cycles of other different
    periods are infinitely far apart. The distance is the largest difference of a coordinate, for
    the rotation that makes it least, divided by the greatest absolute coordinate of both cycles.
    """
    m = cycles.m
    a, b = np.where(m[a] > m[b], b, a), np.where(m[a] > m[b], a, b)
    result = np.full(len(a), np.inf)
    for periods, turns in product(np.unique(m[a]).tolist(), (1, 2)):
        rows = np.flatnonzero((m[a] == periods) & (m[b] == turns * periods))
        size = max(1, _VALUES_AT_ONCE // (turns * periods))
        for part in (rows[start : start + size] for start in range(0, rows.size, size)):
            first = np.tile(cycles.states[a[part], :periods], (1, turns, 1))
            second, R = cycles.states[b[part], : turns * periods], cycles.R[b[part], None]
            turned = (np.roll(first, turn, axis=1) for turn in range(periods))
            apart = [section_distance(one, second, 0.0, R) for one in turned]
            both = np.concatenate([first, second], axis=1).reshape(len(part), -1)
            # Column by column: many short rows have their maxima sooner than by `max`.
            *far, greatest = (reduce(np.maximum, one.T) for one in (*apart, np.abs(both)))
            result[part] = reduce(np.minimum, far) / np.where(greatest > 0.0, greatest, 1.0)
    return result


def same_motions(
    cycles: Cycles, group: np.ndarray, tolerance: float = ORBIT_TOLERANCE
) -> np.ndarray:
    """Return for each cycle the index of the first that is the same motion, shape (n,).

    Cycles of one number in `group` are the same motion if they are within `tolerance`, or are
    connected by a chain of such cycles. So the result does not depend on the order of the cycles,
    and no arbitrary boundary separates cycles that converge to the same motion.
    """
    count = len(group)
    if len(np.unique(group)) == count:
        return np.arange(count)
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    # The mean of the states, after an impact, does not depend on the state at which a cycle begins;
    # two of these places are in both coordinates as near as the cycles are.
    x, v = np.moveaxis(cycles.states, -1, 0)
    after = np.fmin(v, -cycles.R[:, None] * v)
    places = (np.nansum(one, axis=1) / cycles.m for one in (x, after))
    size = np.nanmax(np.abs(cycles.states), axis=(1, 2), initial=0.0)
    radius = tolerance * size * (1.0 + 1e-9)  # rounding included
    sites = np.column_stack([*places, 4.0 * radius.max() * group])  # groups are kept apart
    near = KDTree(sites).query_ball_point(sites, radius, p=np.inf)
    a, b = np.repeat(np.arange(count), list(map(len, near))), np.concatenate(near).astype(int)
    a, b = a[a != b], b[a != b]
    equal = distances(cycles, a, b) <= tolerance
    ends = tuple(one[equal].astype(np.int32) for one in (a, b))  # SciPy 1.11 needs int32
    graph = coo_array((equal[equal], ends), (count, count))
    number = connected_components(graph, directed=False)[1]
    return np.unique(number, return_index=True)[1][number]
