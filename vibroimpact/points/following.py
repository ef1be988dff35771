"""Chains of points: each starts from the final state of its neighbour along one axis.

The first point of a chain starts as every point of a sweep does, from x0, v0. Each further
point starts at the section, in the last state that its neighbour recorded there. So its transient
and its record continue the motion of the neighbour at another value of the axis. If the clearance
is followed and the stop has moved past that state, the mass starts on the stop. If the neighbour
failed, there is no state to start from, and the next point starts like the first of a chain.

Chains advance together, value by value: the chains of a batch, and both directions, are lanes of
the same call of the kernel.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from vibroimpact.points.regimes import has_result
from vibroimpact.points.stages import put_rows

#: Computes points; results of shape (n, ...).
RunPoints = Callable[[np.ndarray], dict[str, np.ndarray]]


def follow_chains(
    points: np.ndarray,
    along: int,
    axis: str,
    directions: Sequence[str],
    phase: float,
    run: RunPoints,
    advance: Callable[[int], object],
) -> dict[str, np.ndarray]:
    """Compute the points of a box. Along one axis, each starts from its neighbour's last state.

    `points` has the shape (box...) and all values of the parameter `axis`, which is swept along
    dimension `along`. `directions` holds ``up``, from the least value on, ``down``, from the
    greatest, or both. `phase` is that of the section. `advance` receives the number of points after
    every call of `run`. Returns arrays of shape (points, ...), one direction after the other, each
    in C order.
    """
    size, flat = points.size, points.ravel()
    # The indices in `flat` of the points of each chain: shape (chains, values of the axis).
    places = np.moveaxis(np.arange(size).reshape(points.shape), along, -1)
    chains = places.reshape(-1, points.shape[along])
    rising = np.argsort(flat[chains[0]][axis], kind="stable")
    orders = [rising if direction == "up" else rising[::-1] for direction in directions]
    collected, before = dict[str, np.ndarray](), dict[str, np.ndarray]()
    for order in zip(*orders, strict=True):  # one value of the axis for each direction
        rows = np.concatenate([chains[:, value] + i * size for i, value in enumerate(order)])
        lanes = flat[rows % size]
        if before:
            _continue(lanes, before, phase, moving_stop=axis == "clearance")
        before = run(lanes)
        put_rows(collected, len(orders) * size, rows, before)
        advance(len(rows))
    return collected


def _continue(
    points: np.ndarray, before: Mapping[str, np.ndarray], phase: float, *, moving_stop: bool
) -> None:
    """Start one point of every chain at the section, where the point before it has ended.

    `moving_stop` says whether the stop may have moved past that state.
    """
    x, v = before["poincare_x"][:, -1], before["poincare_v"][:, -1]
    if moving_stop:
        x = np.minimum(x, points["clearance"])
    ended = np.isfinite(x) & np.isfinite(v) & has_result(before["status"])
    for name, value in (("x0", x), ("v0", v), ("phase", phase)):
        points[name] = np.where(ended, value, points[name])
