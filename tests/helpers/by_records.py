"""The attractors of a sweep as they were found before: by comparing all states of the records.

An oracle for `sweeps.attractors`, which compares orbits. It reads only the file.
"""

from dataclasses import dataclass
from functools import reduce

import numpy as np

TOLERANCE, _PART = (0.001, 50000)


@dataclass(frozen=True)
class Cycles:
    """Motions of m forcing periods each."""

    states: np.ndarray
    R: np.ndarray

    def __getitem__(self, index):
        """Return some of the motions."""
        return Cycles(self.states[index], self.R[index])

    def __len__(self):
        return len(self.states)

    @property
    def m(self):
        """Number of forcing periods of each cycle."""
        return self.states.shape[1]

    def places(self):
        """Return a point in the plane of the states for each cycle, shape (n, 2).

        It does not depend on the state at which the cycle begins, and is the same just before and
        just after an impact. Two places are in both coordinates as near as the cycles are.
        """
        x, v = np.moveaxis(self.states, -1, 0)
        after = np.minimum(v, -self.R[:, None] * v)
        return np.stack([x.mean(axis=1), after.mean(axis=1)], axis=1)


def section_distance(states, states_0, clearance, R, scale=(1.0, 1.0)):
    """Return the distance of states at a section, directly or through an impact, if that is less.

    States are x and v, shape (..., 2), and `scale` gives their units. The clearance and R are
    broadcast against x. The distance is the larger of the distances in x and in v, in these units.
    """
    (x, v), (x_0, v_0) = (np.moveaxis(states, -1, 0), np.moveaxis(states_0, -1, 0))
    X, V = np.moveaxis(np.asarray(scale), -1, 0)
    direct = np.maximum(np.abs(x - x_0) / X, np.abs(v - v_0) / V)
    to_stop = np.maximum(np.abs(x - clearance), np.abs(x_0 - clearance)) / X
    rebound = np.abs(np.minimum(v, v_0) + R * np.maximum(v, v_0)) / V
    return np.minimum(direct, np.maximum(to_stop, rebound))


def distances(a, b):
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


def sizes(states):
    """Return the greatest absolute coordinate of each cycle, shape (n,)."""
    return _greatest(np.abs(states).reshape(len(states), -1))


def _greatest(table):
    """Return the maximum of each row; taking it column by column is fast for many short rows."""
    return reduce(np.maximum, table.T)


def representatives(cycles, group, tolerance=TOLERANCE):
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
    ordered, groups = (cycles[order], group[order])
    equal = distances(ordered[1:], ordered[:-1]) <= tolerance
    begins = np.r_[True, ~(equal & (groups[1:] == groups[:-1]))]
    heads = order[begins]
    head[order] = heads[np.cumsum(begins) - 1]
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
        heads, squares = (heads[kept], squares[kept])
        merged = merged[merged]
    return merged[head]


def _merge(cycles, left, cell, tolerance, merged):
    """Store in `merged` the first cycle within `tolerance` of each cycle `left`, in its cell."""
    while len(left):
        _, first, inverse = np.unique(cell, return_index=True, return_inverse=True)
        leaders = left[first][inverse]
        apart = distances(cycles[left], cycles[leaders]) > tolerance
        merged[left[~apart]] = leaders[~apart]
        left, cell = (left[apart], cell[apart])


def by_records(dataset):
    """Return the number of the attractor of every periodic motion, -1 where no record shows it."""
    status = dataset["status"]

    def at_points(variable):
        return variable.broadcast_like(status).transpose(*status.dims).values.ravel()

    parameter, m = np.zeros(status.size, int), dataset["period"].values.ravel()
    for name in set(status.dims) - {"x0", "v0", "direction"}:
        of_axis = dataset[name].copy(data=np.arange(dataset.sizes[name]))
        parameter = parameter * dataset.sizes[name] + at_points(of_axis)
    shown = (dataset["orbit_distance"].values.ravel() <= 1e-6) & (m <= dataset.sizes["section"])
    shown &= dataset["rest_fraction"].values.ravel() == 0.0
    R, omega, clearance = (at_points(dataset[name]) for name in ("R", "omega", "clearance"))
    x, v = (dataset[f"poincare_{name}"].values.reshape(status.size, -1).T for name in "xv")
    record = np.stack([(x - clearance).T, (v / omega).T], axis=2)
    found = np.full(status.size, -1)
    for periods in np.unique(m[shown]):
        rows = np.flatnonzero(shown & (m == periods))
        cycles = Cycles(record[rows, -periods:], R[rows])
        found[rows] = rows[representatives(cycles, parameter[rows], TOLERANCE)]
    return found
