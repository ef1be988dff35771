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

    def last(self, m: int) -> Cycles:
        """Return the last m states of each cycle."""
        return Cycles(self.states[:, -m:], self.R)


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


def shortest_turn(states: np.ndarray, tolerance: float = TOLERANCE) -> np.ndarray:
    """Return the least divisor of m after which a cycle repeats within `tolerance`.

    The states have the shape (n, m, 2), and the result has the shape (n,).
    """
    n, m, _ = states.shape
    shortest = np.full(n, m)
    allowed = tolerance * sizes(states)
    for divisor in range(m // 2, 0, -1):
        if m % divisor == 0:
            moved = sizes(np.roll(states, divisor, axis=1) - states)
            shortest[moved <= allowed] = divisor
    return shortest


def representatives(cycles: Cycles, group: np.ndarray, tolerance: float = TOLERANCE) -> np.ndarray:
    """Return for each cycle the index of a cycle that represents the same motion, shape (n,).

    Only cycles with the same number in `group` are compared. Cycles are sorted by their place, and
    neighbours within `tolerance` form chains. Chains whose first cycles are within `tolerance` of
    each other are merged. So the result does not depend on the order of the cycles, and cycles that
    converge to the same motion are not separated by an arbitrary boundary.
    """
    places = cycles.places()
    order = np.lexsort((*places.T[::-1], group))
    head = np.arange(len(order))
    if len(order) < 2:
        return head
    ordered, groups = cycles[order], group[order]
    equal = distances(ordered[1:], ordered[:-1]) <= tolerance
    begins = np.r_[True, ~(equal & (groups[1:] == groups[:-1]))]
    heads = order[begins]
    head[order] = heads[np.cumsum(begins) - 1]
    # Equal cycles are at most `tolerance` apart in both coordinates. Squares of twice that side
    # have both of them in one square, for one of four positions of the squares.
    _, of_head = np.unique(group[heads], return_inverse=True)
    size = np.zeros(len(heads))
    np.maximum.at(size, of_head, sizes(cycles.states[heads]))
    side = 2.0 * tolerance * size[of_head]
    squares = places[heads] / np.where(side > 0.0, side, 1.0)[:, None]
    merged = np.arange(len(order))
    for shift in ((0.0, 0.0), (0.0, 0.5), (0.5, 0.0), (0.5, 0.5)):
        cells = np.column_stack([group[heads], np.floor(squares + shift)])
        _, cell = np.unique(cells, axis=0, return_inverse=True)
        _merge(cycles, heads, cell, tolerance, merged)
        kept = merged[heads] == heads
        heads, squares = heads[kept], squares[kept]
        merged = merged[merged]
    return merged[head]


def _merge(
    cycles: Cycles, left: np.ndarray, cell: np.ndarray, tolerance: float, merged: np.ndarray
) -> None:
    """Store in `merged` the first cycle within `tolerance` of each cycle `left`, in its cell."""
    while len(left):
        _, first, inverse = np.unique(cell, return_index=True, return_inverse=True)
        leaders = left[first][inverse]
        apart = distances(cycles[left], cycles[leaders]) > tolerance
        merged[left[~apart]] = leaders[~apart]
        left, cell = left[apart], cell[apart]
