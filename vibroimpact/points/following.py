"""Chains of points: each starts from the final state of its neighbour along one axis.

The first point of a chain starts as every point of a sweep does, from x0, v0 at t = 0. A further
one starts at the section, in the last state that its neighbour recorded there: so its transient and
its record continue the neighbour's motion under another value of the axis. Where the clearance is
followed, and the stop has moved past that state, the mass starts on the stop. Where the neighbour
failed there is no state to start from, and the next point begins as the first of a chain.

A chain is walked value by value, side by side with the others of its block: they are lanes of the
same call of the kernel, and so are the two directions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from vibroimpact.status import Status

#: Points, and whether their starts are states at the section, to results of shape (n, ...).
Run = Callable[[np.ndarray, bool], dict[str, np.ndarray]]

_ALL = slice(None)
_FAILED = [int(status) for status in Status if status.failed]


def follow(
    points: np.ndarray,
    along: int,
    axis: str,
    directions: Sequence[str],
    run: Run,
    advance: Callable[[int], object],
) -> dict[str, np.ndarray]:
    """Compute the points of a box along one of whose axes each starts from its neighbour.

    Parameters
    ----------
    points : ndarray of dtype ``POINT``, shape (box...)
        With all values of the axis that is followed.
    along : int
        Which of the axes of `points` that is.
    axis : str
        The parameter that is swept along it.
    directions : sequence of str
        ``up`` from the least value on, or ``down`` from the greatest, or both.
    run : callable
        What computes points.
    advance : callable
        Is given the number of points after every call of `run`.

    Returns
    -------
    dict of str to ndarray
        Arrays of shape (points, ...), one direction after the other, each in C order.
    """
    # The chains: shape (chains, values of the axis), in C order of the other axes.
    chains = np.moveaxis(points, along, -1)
    rest, length = chains.shape[:-1], chains.shape[-1]
    chains = chains.reshape(-1, length)
    rising = np.argsort(chains[0][axis], kind="stable")
    orders = [rising if direction == "up" else rising[::-1] for direction in directions]
    stack = _Stack(len(orders), *chains.shape)
    before: dict[str, np.ndarray] = {}
    for order in zip(*orders, strict=True):  # one value of the axis for each direction
        lanes = np.concatenate([chains[:, value] for value in order])
        before = _next(lanes, before, run, moving_stop=axis == "clearance")
        stack.put(order, before)
        advance(len(lanes))
    return {
        name: np.moveaxis(
            values.reshape(len(orders), *rest, length, *values.shape[3:]), 1 + len(rest), 1 + along
        ).reshape(len(orders) * points.size, *values.shape[3:])
        for name, values in stack.arrays.items()
    }


def _next(
    lanes: np.ndarray, before: Mapping[str, np.ndarray], run: Run, *, moving_stop: bool
) -> dict[str, np.ndarray]:
    """Compute one point of every chain, given the results of those before, if there are any.

    `moving_stop` says whether the stop can have moved past their states.
    """
    if not before:
        return run(lanes, False)
    x, v = before["poincare_x"][:, -1], before["poincare_v"][:, -1]
    ended = np.isfinite(x) & np.isfinite(v) & ~np.isin(before["status"], _FAILED)
    lanes["x0"] = np.where(ended, x, lanes["x0"])
    lanes["v0"] = np.where(ended, v, lanes["v0"])
    if moving_stop:
        lanes["x0"] = np.minimum(lanes["x0"], lanes["clearance"])
    if ended.all():
        return run(lanes, True)
    stack = _Stack(1, len(lanes), 1)
    for chosen, at_section in ((ended, True), (~ended, False)):
        if chosen.any():
            stack.put((0,), run(lanes[chosen], at_section), np.flatnonzero(chosen))
    return {name: values[0, :, 0] for name, values in stack.arrays.items()}


class _Stack:
    """Results, as they come, in arrays of shape (directions, chains, values of the axis, ...)."""

    def __init__(self, *shape: int) -> None:
        self._shape = shape
        self.arrays: dict[str, np.ndarray] = {}

    def put(
        self,
        order: tuple[int, ...],
        results: Mapping[str, np.ndarray],
        chains: slice | np.ndarray = _ALL,
    ) -> None:
        """Add the results of one value of the axis for each direction, which are in their order."""
        for name, values in results.items():
            values = values.reshape(len(order), len(values) // len(order), *values.shape[1:])
            stack = self._room(name, values)
            for way, value in enumerate(order):
                if values.ndim > 2:
                    stack[way, chains, value, : values.shape[2]] = values[way]
                else:
                    stack[way, chains, value] = values[way]

    def _room(self, name: str, values: np.ndarray) -> np.ndarray:
        """Return the array of a variable: a trajectory may be longer than all before it."""
        tail = values.shape[2:]
        stack = self.arrays.get(name)
        if stack is None:
            empty = np.nan if values.dtype.kind == "f" else 0
            stack = self.arrays[name] = np.full((*self._shape, *tail), empty, values.dtype)
        elif tail and tail[0] > stack.shape[3]:
            missing = [(0, 0)] * 3 + [(0, tail[0] - stack.shape[3])]
            stack = self.arrays[name] = np.pad(stack, missing, constant_values=np.nan)
        return stack
