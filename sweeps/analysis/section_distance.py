"""Periodic motions as cycles of section states: how far two are apart, and which are the same.

A cycle is the states of a motion at m passages of the section, shape (m, 2), in time order but from
any of the m on: a motion of m forcing periods can be reached at m phases. Distances are between
states at matched places of two cycles, for the best of the rotations against each other, so that
states that are nearly equal in one coordinate cannot be taken for each other.

When the phase of an impact passes that of the section, the state at the section jumps from before
the impact to after it, though the motion does not. So a state just before an impact is near one
just after it: they are as far apart as both are from the impact (Biemond, van de Wouw, Heemels &
Nijmeijer 2013, IEEE Trans. Autom. Control 58, 876-890).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

#: Cycles closer than this, relative to their greatest coordinate, are one motion.
TOLERANCE = 1e-3
#: Numbers that are compared at a time: as many as stay in the cache.
_PART = 50_000


@dataclass(frozen=True)
class Cycles:
    """Motions of m forcing periods each.

    Attributes
    ----------
    states : ndarray, shape (n, m, 2)
        x - clearance and v, in one unit, say v / omega: tolerances are relative to the distance
        from the stop, wherever the stop is.
    R : ndarray, shape (n,)
        Of the impact.
    """

    states: np.ndarray
    R: np.ndarray

    def __getitem__(self, index: Any) -> Cycles:
        """Return some of the motions."""
        return Cycles(self.states[index], self.R[index])

    def __len__(self) -> int:
        return len(self.states)

    @property
    def m(self) -> int:
        """Forcing periods of a turn."""
        return self.states.shape[1]

    def last(self, m: int) -> Cycles:
        """Return the last m states of each."""
        return Cycles(self.states[:, -m:], self.R)


def section_distance(
    states: np.ndarray,
    states_0: np.ndarray,
    clearance: np.ndarray | float,
    R: np.ndarray,
    scale: np.ndarray | tuple[float, float] = (1.0, 1.0),
) -> np.ndarray:
    """Return how far states at a section are apart, directly or through an impact.

    States are x and v, shape (..., 2), `scale` their units; the clearance and R are broadcast
    against x. The distance is the larger of those in x and in v, in these units.
    """
    (x, v), (x_0, v_0) = np.moveaxis(states, -1, 0), np.moveaxis(states_0, -1, 0)
    X, V = np.moveaxis(np.asarray(scale), -1, 0)
    direct = np.maximum(np.abs(x - x_0) / X, np.abs(v - v_0) / V)
    to_stop = np.maximum(np.abs(x - clearance), np.abs(x_0 - clearance)) / X
    rebound = np.abs(np.minimum(v, v_0) + R * np.maximum(v, v_0)) / V
    return np.minimum(direct, np.maximum(to_stop, rebound))


def distances(a: Cycles, b: Cycles) -> np.ndarray:
    """Return how far cycles are apart, irrespective of where each begins, shape (n,).

    A cycle of `b` may be k times as long; it is compared with k turns of `a`. The distance is the
    largest difference of a coordinate, in the rotation in which it is least, over the greatest
    absolute coordinate of both cycles; 0 if all coordinates are 0.
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
    """Return the maximum of each row, column by column, which is fast for many short rows."""
    return reduce(np.maximum, table.T)


def shortest_turn(states: np.ndarray, tolerance: float = TOLERANCE) -> np.ndarray:
    """Return the least divisor of m after which a cycle comes back to within `tolerance`.

    The states have the shape (n, m, 2), the result (n,).
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
    """Find the cycles that are the same motion, within groups of numbers, shape (n,).

    Returned is the index of a cycle that stands for the motion, its own for one in each. Cycles in
    the order of their mean first coordinate are chained where neighbours are within `tolerance`;
    chains whose first cycles are within it are then taken together. So the result does not depend
    on the order in which the cycles come, and cycles on their way to one motion are not divided by
    where they happen to lie.
    """
    order = np.lexsort((cycles.states[:, :, 0].mean(axis=1), group))
    head = np.arange(len(order))
    if len(order) < 2:
        return head
    ordered, groups = cycles[order], group[order]
    equal = distances(ordered[1:], ordered[:-1]) <= tolerance
    begins = np.r_[True, ~(equal & (groups[1:] == groups[:-1]))]
    heads = order[begins]
    head[order] = heads[np.cumsum(begins) - 1]
    merged = np.arange(len(order))
    while len(heads):
        _, first, inverse = np.unique(group[heads], return_index=True, return_inverse=True)
        leaders = heads[first][inverse]
        close = distances(cycles[heads], cycles[leaders]) <= tolerance
        merged[heads[close]] = leaders[close]
        heads = heads[~close]
    return merged[head]
