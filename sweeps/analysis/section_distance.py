"""Periodic motions as cycles of section states: their distances, and which of them are equal.

A cycle consists of the states of a motion at m passages of the section, shape (m, 2), in time
order. It may begin at any of the m states, because a motion of m forcing periods can be reached at
m phases. The distance of two cycles compares the states at matching places, for the best rotation
of one against the other. So states that nearly agree in one coordinate cannot be confused.

If the phase of an impact passes the phase of the section along an axis, the state at the section
jumps from before the impact to after it, although the motion changes continuously. Therefore a
state just before an impact counts as near a state just after it: their distance is the distance of
both from the impact (Biemond, van de Wouw, Heemels & Nijmeijer 2013, IEEE Trans. Autom. Control 58,
876-890).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

#: Cycles closer than this, relative to their greatest coordinate, are the same motion.
TOLERANCE = 1e-3
#: Number of values compared at a time, so that they stay in the cache.
_PART = 50_000


@dataclass(frozen=True)
class Cycles:
    """Motions of m forcing periods each."""

    #: x - clearance and v in the same unit, for example v / omega. Tolerances are thus
    #: relative to the distance from the stop, wherever the stop is. Shape (n, m, 2).
    states: np.ndarray
    R: np.ndarray  # coefficient of restitution; shape (n,)

    def __getitem__(self, index: Any) -> Cycles:
        """Return some of the motions."""
        return Cycles(self.states[index], self.R[index])

    def __len__(self) -> int:
        return len(self.states)

    @property
    def m(self) -> int:
        """Number of forcing periods of each cycle."""
        return self.states.shape[1]

    def places(self) -> np.ndarray:
        """Return a point in the plane of the states for each cycle, shape (n, 2).

        It does not depend on the state at which the cycle begins, and is the same just before and
        just after an impact. Two places are in both coordinates as near as the cycles are.
        """
        x, v = np.moveaxis(self.states, -1, 0)
        after = np.minimum(v, -self.R[:, None] * v)
        return np.stack([x.mean(axis=1), after.mean(axis=1)], axis=1)


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


def distances(a: Cycles, b: Cycles) -> np.ndarray:
    """Return the distances of cycles, shape (n,), irrespective of the state at which each begins.

    If the cycles of `b` are k times as long, they are compared with k turns of `a`. The distance is
    the largest difference of a coordinate, for the rotation that makes it least, divided by the
    greatest absolute coordinate of both cycles; 0 if all coordinates are 0.
    """
    turns = b.m // a.m
    result = np.empty(len(a))
    rows = max(1, _PART // (2 * b.m))
    for start in range(0, len(a), rows):
        cut = slice(start, start + rows)
        states = np.tile(a.states[cut], (1, turns, 1))
        matching = b[cut]
        R = matching.R[:, None]
        apart = np.full(len(states), np.inf)
        for rotation in range(a.m):
            rotated = np.roll(states, rotation, axis=1) if rotation else states
            differences = section_distance(rotated, matching.states, 0.0, R)
            apart = np.minimum(apart, _greatest(differences))
        scale = np.maximum(sizes(states), sizes(matching.states))
        result[cut] = apart / np.where(scale > 0.0, scale, 1.0)
    return result


def sizes(states: np.ndarray) -> np.ndarray:
    """Return the greatest absolute coordinate of each cycle, shape (n,)."""
    return _greatest(np.abs(states).reshape(len(states), -1))


def _greatest(table: np.ndarray) -> np.ndarray:
    """Return the maximum of each row; taking it column by column is fast for many short rows."""
    return reduce(np.maximum, table.T)


def same_motions(cycles: Cycles, group: np.ndarray, tolerance: float = TOLERANCE) -> np.ndarray:
    """Return for each cycle the index of the first that is the same motion, shape (n,).

    Cycles of one number in `group` are the same motion if they are within `tolerance`, or are
    connected by a chain of such cycles. So the result does not depend on the order of the cycles,
    and no arbitrary boundary separates cycles that converge to the same motion.
    """
    first = np.arange(len(cycles))
    if len(np.unique(group)) == len(cycles):
        return first
    from scipy.spatial import KDTree

    radius = tolerance * sizes(cycles.states) * (1.0 + 1e-9)  # of places, rounding included
    apart = 4.0 * radius.max()  # keeps the groups apart
    sites = np.nan_to_num(np.column_stack([cycles.places(), apart * group]))
    near = KDTree(sites).query_ball_point(sites, np.nan_to_num(radius), p=np.inf)
    a, b = np.repeat(first, list(map(len, near))), np.concatenate(near).astype(int)
    a, b = a[a != b], b[a != b]
    equal = distances(cycles[a], cycles[b]) <= tolerance
    a, b = a[equal], b[equal]
    while True:  # terminates: the numbers only fall
        before = first.copy()
        np.minimum.at(first, a, before[b])
        np.minimum.at(first, b, before[a])
        first = first[first]
        if np.array_equal(first, before):
            return first
