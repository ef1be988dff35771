"""The special points of a step, located to rounding: flips, folds, cusps and meetings.

The test functions of flip and fold are det J(mu) at mu = -1 and +1 (``linear.py``). Cusps are
points on a curve of folds where both parameters turn back together. A curve of grazes meets curves
of flips and folds where the middle coefficient of det J(mu) vanishes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np

from vibroimpact.orbits import calls
from vibroimpact.orbits.detection import HEADING, ROUNDING
from vibroimpact.orbits.family import ArclengthStep, OrbitFamily
from vibroimpact.orbits.halves import difference_of_halves
from vibroimpact.orbits.unknowns import free

#: Greatest difference of the halves of an orbit at which the test of a fold, divided by the square
#: of it, may be rounding.
_ALIKE = 1e-4
#: A bifurcation at an end of a step may lie beyond it by this share of the step, by rounding.
_AT_END = 1e-6


def special_points(
    step: ArclengthStep, half: np.ndarray | None = None
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the kinds and the unknowns of the special points within a step, in order.

    These are the flips and folds of a branch, the cusps of a curve of folds, and on a curve of
    grazes the ``flip`` and ``fold`` where curves of these kinds meet it. If the orbit halves its
    period at `half`, they are those before it.
    """
    if step.family.kind == "":
        end = math.inf if half is None else step.place(half)
        located = [(step.place(X), kind, X) for kind, X in _bifurcations(step, end)]
        for place, kind, X in sorted(located, key=lambda item: item[0]):
            if place < end:
                yield kind, X
    elif step.family.kind == "graze":
        # Without damping the coefficient may be zero along the whole curve; its sign is then
        # rounding.
        crosses = _crossing(step, -2) is not None
        meeting = step.root(partial(step.family.test, -2)) if crosses else None
        if meeting is not None:
            yield from (("flip", meeting), ("fold", meeting))
    elif step.family.kind == "fold":
        # At a degenerate flip the heading turns back, too, but Newton's method fails there.
        # A curve may touch the edge of a range in a step as short as rounding.
        cusp = _cusp(step)
        if cusp is not None and step.family.inadmissible(cusp)[0] is None:
            yield "cusp", cusp


def _bifurcations(step: ArclengthStep, end: float) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the flip and the fold within a step of a branch that ends at a place of it."""
    family = step.family
    for test, kind in ((-2, "flip"), (-1, "fold")):
        share = _crossing(step, test)
        if share is None:
            continue
        X = family.bifurcation(step.between(share), kind)
        # Newton's method may also find the bifurcation of a step beside this one.
        if X is None or not -_AT_END <= step.place(X) <= min(1.0 + _AT_END, end):
            X = step.root(partial(family.test, test))
        if X is not None and not (kind == "fold" and _is_twice_its_half(family, X)):
            yield kind, X


def _crossing(step: ArclengthStep, test: int) -> float | None:
    """Return about where within a step a test function changes its sign; None if it does not."""
    a, b = (float(point.tests[0, test]) for point in (step.begin, step.end))
    # Zero counts as positive, so a path in both directions from a root has it once.
    changes = a * b <= 0.0 and (a < 0.0) != (b < 0.0) and max(abs(a), abs(b)) > ROUNDING
    return a / (a - b) if changes else None


def _cusp(step: ArclengthStep) -> np.ndarray | None:
    """Return the cusp within a step on a curve of folds, or None."""
    family = step.family
    before, after = (_heading(step, point.X) for point in (step.begin, step.end))
    # The slopes of the condition vanish with this, but their rounding does not.
    apart = min(1.0, calls.halves_apart(family.system, step.end.X))
    fastest = max(float(np.abs(free(heading, family.q)).max()) for heading in (before, after))
    seen = fastest * apart > HEADING
    if not (family.inner(before, after) < 0.0 and seen):
        return None
    change = after - before
    return step.root(lambda X: family.inner(_heading(step, X), change))


def _heading(step: ArclengthStep, X: np.ndarray) -> np.ndarray:
    """Return the tangent of a curve of folds without its part along the null vector of the fold.

    It vanishes only with the velocity of the parameters. Where they turn smoothly, it turns little.
    """
    family = step.family
    null = np.append(calls.null_vector(family.system, X, 1.0), np.zeros(2))
    tangent = family.tangent(X, step.begin.tangent)
    return tangent - family.inner(tangent, null) / family.inner(null, null) * null


def _is_twice_its_half(family: OrbitFamily, X: np.ndarray) -> bool:
    """Whether the halves of an orbit are so nearly equal that its test of a fold is rounding."""
    if family.m % 2 or family.q % 2:
        return False
    return float(np.abs(difference_of_halves(family, X)).max()) < _ALIKE
