"""The special points of a step, located to rounding: flips, folds, cusps, meetings, and ends.

The test functions of flip and fold are det(S + mu T) at mu = -1 and +1 (``corrector.py``). At a
graze the speed of an impact is zero, or a flight between two impacts touches the stop. Both count
as an impact of speed zero, so one condition finds them. An orbit of twice the period becomes one of
half its period where its two halves change places.

Cusps are points on a curve of folds where both parameters turn back together. A curve of grazes
meets curves of flips and folds where the middle coefficient of det(S + mu T) vanishes. The curves
of flips and folds end there, and wherever else their orbit grazes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np

from vibroimpact.orbits.continuation import PathStep
from vibroimpact.orbits.corrector import linearised, null_vector, parameters_at
from vibroimpact.orbits.detection import HEADING, ROUNDING
from vibroimpact.orbits.family import OrbitFamily, Violation
from vibroimpact.orbits.flights import state_after
from vibroimpact.orbits.orbit import PeriodicOrbit

#: A bifurcation that was found belongs to the path if it is closer to it than this, in scaled
#: unknowns.
NEARBY_DISTANCE = 1e-3
#: At the end of a path, an impact slower than this, in the unit of speed, grazes; so does a flight
#: that turns as near to the stop. The value is not smaller because Newton's method fails at 1e-6
#: where all impacts of a long orbit graze at once.
_GRAZES = 1e-5


def special_points(step: PathStep) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the kinds and the unknowns of the special points within a step, in order.

    These are the flips and folds of a branch, the cusps of a curve of folds, and on a curve of
    grazes the ``flip`` and ``fold`` where curves of these kinds meet it.
    """
    if step.family.kind == "":
        located = [(step.place(X), kind, X) for kind, X in _bifurcations(step)]
        for _, kind, X in sorted(located, key=lambda item: item[0]):
            yield kind, X
    elif step.family.kind == "graze":
        # Without damping the coefficient may be zero along the whole curve; its sign is then
        # rounding.
        crosses = _crossing(step, -2) is not None
        meeting = step.root(partial(step.family.test, -2)) if crosses else None
        if meeting is not None:
            yield from (("flip", meeting), ("fold", meeting))
    elif step.family.kind == "fold":
        before, after = (_heading(step, point.X) for point in (step.begin, step.end))
        if before @ after < 0.0 and max(np.abs(before).max(), np.abs(after).max()) > HEADING:
            turn = after - before
            cusp = step.root(lambda X: float(_heading(step, X) @ turn))
            if cusp is not None:
                yield "cusp", cusp


def _bifurcations(step: PathStep) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the flip and the fold within a step of a branch."""
    family = step.family
    for test, kind in ((-2, "flip"), (-1, "fold")):
        share = _crossing(step, test)
        if share is None:
            continue
        guess = step.between(share)
        X = family.bifurcation(guess, kind)
        if X is None or not (-0.01 <= step.place(X) <= 1.01 and family.distance(X, guess) < 0.1):
            X = step.root(partial(family.test, test))
        if X is not None:
            yield kind, X


def _crossing(step: PathStep, test: int) -> float | None:
    """Return about where within a step a test function changes its sign; None if it does not."""
    a, b = (float(point.tests[0, test]) for point in (step.begin, step.end))
    changes = a * b < 0.0 and max(abs(a), abs(b)) > ROUNDING
    return a / (a - b) if changes else None


def _heading(step: PathStep, X: np.ndarray) -> np.ndarray:
    """Return the direction of the parameters at a point of a step."""
    tangent = step.family.tangent(X)
    forward = step.family.inner(tangent, step.begin.tangent) > 0.0
    return tangent[-2:] if forward else -tangent[-2:]


def ending(step: PathStep) -> tuple[str, np.ndarray, PeriodicOrbit]:
    """Return how a path that is not closed ends, its last point, and the orbit there.

    It ends at an ``edge``, in a ``graze``, in ``rest`` if the mass cannot leave the stop, as at
    R = 0, in ``penetration``, or is ``lost``. At the graze of a branch the orbit has the impact of
    speed zero.
    """
    family, X, violation = step.family, step.end.X, step.violation
    if violation is None and family.leaves(step.end):  # as at R = 0, where two impacts may meet
        return "edge", X, family.orbit(X)
    kind = "lost" if violation is None or violation.kind == "speed" else "penetration"
    if violation is not None:
        limit = family.without_force(X)
        if limit is not None:
            return "edge", limit, family.orbit(limit)
        if violation.kind in ("edge", "rest"):
            return violation.kind, X, family.orbit(X)
        found = _graze(family, X, violation) if family.kind == "" else None
        if found is not None:
            return found
    if not step.margin < _GRAZES:
        return kind, X, family.orbit(X)
    X = _without_speed(step) if family.kind == "" and kind == "lost" else X
    return "graze", X, family.orbit(X)


def _without_speed(step: PathStep) -> np.ndarray:
    """Return the end of a branch, on which an impact is slow, along its tangent to speed zero.

    Newton's method fails there where any natural vibration closes the orbit, as at h = 0 and
    omega = n p.
    """
    X, tangent, q = step.end.X, step.end.tangent, step.family.q
    at = 2 * int(np.argmin(X[1 : 2 * q : 2])) + 1
    if not -X[at] / NEARBY_DISTANCE > tangent[at]:  # it becomes no slower
        return X
    X = X - X[at] / tangent[at] * tangent
    X[at] = 0.0
    return X


def _graze(
    family: OrbitFamily, X: np.ndarray, violation: Violation
) -> tuple[str, np.ndarray, PeriodicOrbit] | None:
    """Return the graze near the end of a branch, as `ending` does; None if there is none."""
    grazing, Y, index = family, X, violation.at
    if violation.kind == "penetration":
        grazing, Y = _with_touch(family, X, violation)
        index += 1
    Z = grazing.bifurcation(Y, "graze", index)
    if Z is None or not grazing.distance(Z, Y) < NEARBY_DISTANCE:
        return None
    last = Z if grazing is family else np.delete(Z, [2 * index, 2 * index + 1])
    return "graze", last, grazing.orbit(Z)


def _with_touch(
    family: OrbitFamily, X: np.ndarray, violation: Violation
) -> tuple[OrbitFamily, np.ndarray]:
    """Return the family and the point with one more impact, of speed zero.

    This impact is at the highest point of the flight that crosses the stop.
    """
    at, values = violation.at, parameters_at(family.system, X)
    omega, theta, v = family.oscillator(X).omega, X[2 * at], X[2 * at + 1] * family.speed
    tau = (violation.where - theta) / omega
    for _ in range(20):
        _, u, a = state_after(values, theta, v, tau)
        if not a < 0.0 or abs(u / a) < 1e-12 * tau:
            break
        tau = max(tau - u / a, 0.5 * tau)
    Y = np.insert(X, 2 * at + 2, (theta + omega * tau, 0.0))
    z = Y[: 2 * family.q + 2].reshape(-1, 2)
    touching = PeriodicOrbit(family.oscillator(X), family.m, z[:, 0], z[:, 1] * family.speed)
    return OrbitFamily(touching, family.parameters, speed=family.speed), Y


def halving(step: PathStep) -> tuple[np.ndarray, PeriodicOrbit] | None:
    """Return the point in a step of a branch where the orbit halves its period, and the half orbit.

    None if the step has no such point.
    """
    family, q = step.family, step.family.q
    if family.kind or family.m % 2 or q % 2:
        return None
    unlike = [_unlike(family, X) for X in (step.begin.X, step.end.X)]
    sizes = [float(np.abs(part).max()) for part in unlike]
    change_places = np.sum(unlike[0] * unlike[1]) < 0.0 or sizes[1] ** 2 < ROUNDING
    if not change_places or sizes[0] < ROUNDING:
        return None
    X = step.between(sizes[0] / sum(sizes))
    z = X[: 2 * q].reshape(q, 2)
    mean = z[: q // 2] + 0.5 * _unlike(family, X)
    half = PeriodicOrbit(family.oscillator(X), family.m // 2, mean[:, 0], mean[:, 1] * family.speed)
    halves = OrbitFamily(half, family.parameters)
    Y = halves.bifurcation(halves.start, "flip")
    if Y is None or not halves.allows(halves.point(Y, np.zeros(Y.size))):
        return None
    return doubling(halves, Y, family.speed)[0], halves.orbit(Y)


def _unlike(family: OrbitFamily, X: np.ndarray) -> np.ndarray:
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
