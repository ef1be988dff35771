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

from collections.abc import Callable, Mapping

import numpy as np

from sweeps.config.sweep import SweepConfig
from sweeps.grid import Block
from vibroimpact.status import Status

#: Points, and whether their starts are states at the section, to results of shape (n, ...).
Run = Callable[[np.ndarray, bool], dict[str, np.ndarray]]

_ALL = slice(None)
_FAILED = [int(status) for status in Status if status.failed]


def follow(
    config: SweepConfig, block: Block, run: Run, advance: Callable[[int], object]
) -> dict[str, np.ndarray]:
    """Compute a block of a sweep along whose axis each point starts from its neighbour.

    Parameters
    ----------
    config : SweepConfig
        With ``follow``.
    block : Block
        Of the grid: whole along the axis that is followed.
    run : callable
        What computes points.
    advance : callable
        Told the number of points after every call of `run`.

    Returns
    -------
    dict of str to ndarray
        Arrays of shape (points of the block, ...), one direction after the other, each in C order.
    """
    assert config.follow is not None
    axis = config.follow.axis
    at = list(config.grid.axes).index(axis)
    box = tuple(cut.stop - cut.start for cut in block)
    # The chains: shape (chains, values of the axis), and their points in C order of the rest.
    points = np.moveaxis(config.grid.points(block).reshape(box), at, -1)
    rest = points.shape[:-1]
    points = points.reshape(-1, points.shape[-1])
    rising = np.argsort(config.grid.axes[axis], kind="stable")
    ways = [rising if way == "up" else rising[::-1] for way in config.directions]
    found = _Stack(len(ways), *points.shape)
    before: dict[str, np.ndarray] = {}
    for order in zip(*ways, strict=True):  # one value of the axis for each direction
        lanes = np.concatenate([points[:, value] for value in order])
        before = _next(lanes, before, run, moving_stop=axis == "clearance")
        found.put(order, before)
        advance(len(lanes))
    return {
        name: np.moveaxis(
            values.reshape(len(ways), *rest, box[at], *values.shape[3:]), 1 + len(rest), 1 + at
        ).reshape(len(ways) * points.size, *values.shape[3:])
        for name, values in found.arrays.items()
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
    found = _Stack(1, len(lanes), 1)
    for which, at_section in ((ended, True), (~ended, False)):
        if which.any():
            found.put((0,), run(lanes[which], at_section), np.flatnonzero(which))
    return {name: values[0, :, 0] for name, values in found.arrays.items()}


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
