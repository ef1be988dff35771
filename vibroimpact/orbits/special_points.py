"""The special points of a step, located to rounding: flips, folds, cusps and meetings.

The test functions of flip and fold are det J(mu) at mu = -1 and +1 (``corrector.py``). An orbit
of twice the period becomes one of half its period where its two halves change places.

Cusps are points on a curve of folds where both parameters turn back together. A curve of grazes
meets curves of flips and folds where the middle coefficient of det J(mu) vanishes. A curve of
folds of an orbit with equal halves ends in a degenerate flip of the half (Kuznetsov, *Elements of
Applied Bifurcation Theory*, sec. 9.3).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np

from vibroimpact.orbits.corrector import linearised, null_vector
from vibroimpact.orbits.detection import HEADING, ROUNDING, halves_apart
from vibroimpact.orbits.ends import is_orbit
from vibroimpact.orbits.family import NEARBY_DISTANCE, ArclengthStep, OrbitFamily
from vibroimpact.orbits.orbit import PeriodicOrbit

#: Greatest difference of the halves of an orbit at which the test of a fold, divided by the square
#: of it, may be rounding.
_ALIKE = 1e-4
#: Where the difference of the halves falls below this, a curve of folds is about to end.
_ALMOST_ALIKE = 0.05
#: Root mean square differences of the halves at the points from which this end is extrapolated.
_BESIDE = (0.02, 0.03, 0.04, 0.05, 0.06)


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
        known = X is not None and -0.01 <= step.place(X) <= min(1.01, end)
        if not known:
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
    apart = min(1.0, halves_apart(step.end.X, family.m, family.q))
    seen = max(np.abs(before).max(), np.abs(after).max()) * apart > HEADING
    if not (before @ after < 0.0 and seen):
        return None
    change = after - before
    return step.root(lambda X: float(_heading(step, X) @ change))


def _heading(step: ArclengthStep, X: np.ndarray) -> np.ndarray:
    """Return the direction of the parameters at a point of a step."""
    return step.family.tangent(X, step.begin.tangent)[-2:]


def parents_flip(step: ArclengthStep) -> tuple[np.ndarray, str, PeriodicOrbit] | None:
    """Return where in a step an orbit meets the flip of its parent, of half its period; or None.

    The result is the point of the step, ``flip``, and the parent. Where a curve of folds meets an
    edge just before, it is the point there, ``edge``, and its orbit.
    """
    family = step.family
    if family.kind not in ("", "fold") or family.m % 2 or family.q % 2:
        return None
    differences = [_difference_of_halves(family, X) for X in (step.begin.X, step.end.X)]
    sizes = [float(np.abs(part).max()) for part in differences]
    if sizes[0] < ROUNDING:
        return None
    change_places = np.sum(differences[0] * differences[1]) < 0.0
    if family.kind == "fold":
        falls_to_zero = sizes[1] < min(_ALMOST_ALIKE, sizes[0])
        return _degenerate_flip(step) if change_places or falls_to_zero else None
    if not change_places and sizes[1] ** 2 >= ROUNDING:
        return None
    half = _half(family, step.between(sizes[0] / sum(sizes)))
    halves = OrbitFamily(half, family.parameters)
    return _doubled(family, halves, halves.bifurcation(halves.start, "flip"))


def _degenerate_flip(step: ArclengthStep) -> tuple[np.ndarray, str, PeriodicOrbit] | None:
    """Return the end of a curve of folds within or just beyond a step, as `parents_flip` does.

    The equations of folds are singular there, so points beside it are extrapolated. They are even
    in the difference of the halves.
    """
    family = step.family
    first, last = (_difference_of_halves(family, X) for X in (step.begin.X, step.end.X))
    first_size, last_size = math.sqrt(np.mean(first**2)), np.mean(first * last)
    last_size /= first_size
    plane = np.concatenate([-first.ravel(), first.ravel(), np.zeros(2)]) / (2.0 * first_size)
    points = []
    for size in _BESIDE:
        guess = step.between((first_size - size) / (first_size - last_size))
        X = family.corrected(guess, plane[None, :])
        if X is None:
            return None
        points.append(X)
    half = _half(family, _extrapolated(points, 0.0))
    halves = OrbitFamily(half, family.parameters, "flip")
    Y = halves.corrected(halves.start, halves.tangent(halves.start)[None, :])
    if Y is None or not halves.distance(Y, halves.start) < NEARBY_DISTANCE:
        return None
    return _doubled(family, halves, Y) or _edge_beside(family, points, plane, halves, Y)


def _extrapolated(points: list[np.ndarray], square: float) -> np.ndarray:
    """Extrapolate from points with the differences ``_BESIDE`` to that with this square."""
    squares = np.square(_BESIDE)
    factors = (squares - square) / (squares - squares[:, None] + np.diag(squares - square))
    return np.prod(factors, axis=1) @ np.array(points)


def _edge_beside(
    family: OrbitFamily,
    points: list[np.ndarray],
    plane: np.ndarray,
    halves: OrbitFamily,
    Y: np.ndarray,
) -> tuple[np.ndarray, str, PeriodicOrbit] | None:
    """Return where a curve of folds meets an edge just before its end Y, as `parents_flip` does."""
    from scipy.optimize import brentq

    reason, _ = halves.inadmissible(Y)
    if reason is None or reason.kind != "edge":
        return None
    axis, edge = np.zeros(plane.size), reason.where / family.spans[reason.at]
    at = 2 * family.q + reason.at
    axis[at] = 1.0
    try:
        square = brentq(lambda s: _extrapolated(points, s)[at] - edge, 0.0, 0.5 * _BESIDE[0] ** 2)
    except ValueError:  # it is farther away: it is found without this
        return None
    guess = doubling(halves, Y, family.speed)[0] + math.sqrt(square) * plane
    guess[at] = edge
    X = family.corrected(guess, np.array([plane, axis]))
    if X is None or not is_orbit(family, family.point(X, np.zeros(X.size))):
        return None
    return X, "edge", family.orbit(X)


def _half(family: OrbitFamily, X: np.ndarray) -> PeriodicOrbit:
    """Return the mean of the halves of an orbit."""
    mean = X[: family.q].reshape(-1, 2) + 0.5 * _difference_of_halves(family, X)
    return PeriodicOrbit(family.oscillator(X), family.m // 2, mean[:, 0], mean[:, 1] * family.speed)


def _doubled(
    family: OrbitFamily, halves: OrbitFamily, Y: np.ndarray | None
) -> tuple[np.ndarray, str, PeriodicOrbit] | None:
    """Return a flip of the half orbits as `parents_flip` does; None if it is not a flip."""
    if Y is None or not is_orbit(halves, halves.point(Y, np.zeros(Y.size))):
        return None
    return doubling(halves, Y, family.speed)[0], "flip", halves.orbit(Y)


def _is_twice_its_half(family: OrbitFamily, X: np.ndarray) -> bool:
    """Whether the halves of an orbit are so nearly equal that its test of a fold is rounding."""
    if family.m % 2 or family.q % 2:
        return False
    return float(np.abs(_difference_of_halves(family, X)).max()) < _ALIKE


def _difference_of_halves(family: OrbitFamily, X: np.ndarray) -> np.ndarray:
    """Return the difference of the second half of an orbit from the first, shape (q / 2, 2)."""
    z = X[: 2 * family.q].reshape(2, -1, 2)
    return z[1] - z[0] - np.array([math.pi * family.m, 0.0])


def doubling(family: OrbitFamily, X: np.ndarray, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a flip X as a point of the orbits of twice the period, and their direction there.

    `speed` is the unit of speed of the orbits of twice the period.
    """
    q, units = family.q, np.array([1.0, family.speed / speed])
    z = X[: 2 * q].reshape(q, 2) * units
    _, A, B = linearised(family.system, X)
    vector = null_vector(A, B, -1.0).reshape(q, 2) * units
    vector /= math.sqrt(np.sum(vector**2) / q)
    second_round = z + np.array([2.0 * math.pi * family.m, 0.0])
    doubled = np.concatenate([z.ravel(), second_round.ravel(), X[2 * q :]])
    along = np.concatenate([vector.ravel(), -vector.ravel(), np.zeros(X.size - 2 * q)])
    return doubled, along
