"""Orders, means over scenes, and the efficient frontier, from measured errors and costs."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from sweeps.bench.accuracy_speed import Measurement
from sweeps.bench.scenes import EXACT, REGULAR, Method

#: The scene that stands for the mean of all regular ones.
MEAN = "regular scenes"
#: An error above this says nothing: no digit is right.
NO_DIGIT = 1.0

# An order is fitted to the finest steps, to errors that are small but far from the reference's.
_FITTED, _LARGEST, _ABOVE_FLOOR = 5, 0.1, 10.0

Line = tuple[str, str, Method]


def lines(measurements: Iterable[Measurement]) -> dict[Line, list[Measurement]]:
    """Group by (scene, kind, method), each group from coarse to fine."""
    groups: dict[Line, list[Measurement]] = defaultdict(list)
    for m in measurements:
        groups[m.scene, m.kind, m.method].append(m)
    for group in groups.values():
        group.sort(key=lambda m: (m.steps or 0, -(m.tolerance or 0.0)))
    return dict(groups)


def means(measurements: Iterable[Measurement]) -> list[Measurement]:
    """Return geometric means over the regular scenes, of errors and seconds.

    Where a method failed in one of them, it has no mean.
    """
    names = {scene.name for scene in REGULAR}
    groups: dict[tuple, dict[str, Measurement]] = defaultdict(dict)
    for m in measurements:
        if m.scene in names:
            groups[m.kind, m.method, m.steps, m.tolerance][m.scene] = m
    scenes = max(map(len, groups.values()), default=0)
    return [
        replace(
            next(iter(group.values())),
            scene=MEAN,
            error=_geometric_mean([m.error for m in group.values()]),
            seconds=_geometric_mean([m.seconds for m in group.values()]),
        )
        for group in groups.values()
        if len(group) == scenes
    ]


def main_scene(measurements: Sequence[Measurement]) -> str:
    """Return the scene that is shown first: the mean of the regular ones, else the first."""
    return MEAN if any(m.scene == MEAN for m in measurements) else measurements[0].scene


def _geometric_mean(values: Sequence[float]) -> float:
    with np.errstate(divide="ignore"):
        return float(np.exp(np.mean(np.log(values))))


def measured_order(steps: Sequence[int], errors: Sequence[float], floor: float = 0.0) -> float:
    """Return the order: minus the slope of log error over log steps, by least squares.

    Parameters
    ----------
    steps, errors : sequences of the same length
        From coarse to fine.
    floor : float
        The error of the reference: what is not ten times above it is not fitted.

    Returns
    -------
    float
        NaN with fewer than three errors to fit.
    """
    e = np.array(errors)
    good = np.flatnonzero((e > _ABOVE_FLOOR * floor) & (e < _LARGEST) & (e > 0.0))[-_FITTED:]
    if len(good) < 3:
        return math.nan
    return -float(np.polyfit(np.log(np.array(steps)[good]), np.log(e[good]), 1)[0])


def orders(measurements: Iterable[Measurement]) -> dict[Line, float]:
    """Return the measured order of every line; NaN for the reference, and for peers."""
    groups = lines(measurements)
    measured = {}
    for (scene, kind, method), group in groups.items():
        reference = groups.get((scene, kind, EXACT), ())
        floor = max((m.error for m in reference), default=0.0)
        steps = [m.steps for m in group if m.steps is not None]
        has_order = method != EXACT and len(steps) == len(group)
        errors = [m.error for m in group]
        order = measured_order(steps, errors, floor) if has_order else math.nan
        measured[scene, kind, method] = order
    return measured


def is_drawn(m: Measurement) -> bool:
    """Whether an error has a place on a logarithmic chart, and a digit is right."""
    return 0.0 < m.error < NO_DIGIT


def efficient_frontier(measurements: Iterable[Measurement]) -> list[Measurement]:
    """Return the measurements with no smaller error at the same or lower cost, cheapest first."""
    frontier: list[Measurement] = []
    for m in sorted(measurements, key=lambda m: (m.seconds, m.error)):
        if m.error < min((n.error for n in frontier), default=NO_DIGIT):
            frontier.append(m)
    return frontier


def cheapest(measurements: Iterable[Measurement], error: float) -> Measurement | None:
    """Return the cheapest measurement that reaches an error; None if there is none."""
    good = (m for m in measurements if m.error <= error)
    return min(good, key=lambda m: m.seconds, default=None)


COLUMNS = (
    "scene",
    "error_kind",
    "integrator",
    "impact",
    "steps_per_period",
    "tolerance",
    "error",
    "seconds_per_period",
    "measured_order",
)


def rows(
    measurements: Sequence[Measurement], orders: Mapping[Line, float]
) -> Iterator[tuple[str, ...]]:
    """Yield every measurement as a row of ``COLUMNS``; a value that does not exist is empty."""
    for line, group in lines(measurements).items():
        scene, kind, method = line
        for m in group:
            numbers = (m.steps, m.tolerance, m.error, m.seconds, orders[line])
            yield scene, kind, *method, *map(_number, numbers)


def _number(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else f"{value:.6g}"
