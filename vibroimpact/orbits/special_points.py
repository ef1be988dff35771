"""Where a branch bifurcates within a step or ends: its flips, folds and grazes, to rounding.

The test functions of flip and fold are det(S + mu T) at mu = -1 and +1 (``corrector.py``). A
graze is where an impact's speed is zero, or where a flight between two impacts touches the stop.
Both count as an impact of speed zero, so one condition finds them. An orbit of twice the period
becomes one of half its period where its two halves change places.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np

from vibroimpact.orbits.continuation import End, Segment
from vibroimpact.orbits.corrector import FLIP, FOLD, GRAZE, null_vector, parameters_at
from vibroimpact.orbits.detection import ROUNDING
from vibroimpact.orbits.family import Objection, Orbits
from vibroimpact.orbits.flights import state_after
from vibroimpact.orbits.orbit import PeriodicOrbit

#: A bifurcation that was found belongs to the walk if it is closer to it than this, in scaled
#: unknowns.
NEARBY_DISTANCE = 1e-3
#: An impact that is slower than this where a walk ends grazes, in the unit of speed; so does a
#: flight that turns so near the stop. Where all impacts of a long orbit graze at once, Newton's
#: method fails at 1e-6.
_GRAZES = 1e-5


def bifurcations(step: Segment) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the flips and folds within a step, in order."""
    orbits, located = step.orbits, []
    for test, kind, condition in ((-2, "flip", FLIP), (-1, "fold", FOLD)):
        share = crossing(step, test)
        if share is None:
            continue
        guess = step.between(share)
        X = orbits.corrected(guess, np.empty((0, guess.size)), condition)
        if X is None or not (-0.01 <= step.place(X) <= 1.01 and _apart(orbits, X, guess) < 0.1):
            X = step.root(partial(orbits.test, test))
        if X is not None:
            located.append((step.place(X), kind, X))
    for _, kind, X in sorted(located, key=lambda item: item[0]):
        yield kind, X


def crossing(step: Segment, test: int) -> float | None:
    """Return about where within a step a test function changes its sign; None if it does not."""
    a, b = (float(point.tests[0, test]) for point in (step.begin, step.end))
    changes = a * b < 0.0 and max(abs(a), abs(b)) > ROUNDING
    return a / (a - b) if changes else None


def _apart(orbits: Orbits, X: np.ndarray, Y: np.ndarray) -> float:
    return math.sqrt(orbits.inner(X - Y, X - Y))


def ending(orbits: Orbits, end: End) -> tuple[str, np.ndarray, PeriodicOrbit]:
    """Return how a branch or a curve ends.

    Parameters
    ----------
    orbits : Orbits
    end : End
        Of a walk that is not closed.

    Returns
    -------
    kind : str
        ``edge``, ``lost``; ``graze``, or ``rest`` if the force presses; ``penetration`` if a flight
        crosses the stop and no graze is found.
    X : ndarray
        The last point.
    orbit : PeriodicOrbit
        At the graze of a branch the impact of speed zero is one of its impacts.
    """
    X, objection = end.X, end.objection
    kind = "lost" if objection is None or objection.kind == "speed" else "penetration"
    if objection is not None:
        limit = orbits.without_force(X)
        if limit is not None:
            return "edge", limit, orbits.orbit(limit)
        if objection.kind in ("edge", "rest"):
            return objection.kind, X, orbits.orbit(X)
        found = _graze(orbits, X, objection) if len(orbits.axes) == 1 else None
        if found is not None:
            return found
    return "graze" if end.margin < _GRAZES else kind, X, orbits.orbit(X)


def _graze(
    orbits: Orbits, X: np.ndarray, objection: Objection
) -> tuple[str, np.ndarray, PeriodicOrbit] | None:
    """Return the graze beside the end of a branch, as `ending` does; None if there is none."""
    grazing, Y, index = orbits, X, objection.at
    if objection.kind == "pass":
        grazing, Y = with_touch(orbits, X, objection)
        index += 1
    Z = grazing.corrected(Y, np.empty((0, Y.size)), GRAZE, index)
    if Z is None or not _apart(grazing, Z, Y) < NEARBY_DISTANCE:
        return None
    osc = grazing.oscillator(Z)
    pulls = -osc.f * math.sin(Z[2 * index]) - osc.p**2 * osc.clearance < 0.0
    last = Z if grazing is orbits else np.delete(Z, [2 * index, 2 * index + 1])
    return "graze" if pulls else "rest", last, grazing.orbit(Z)


def with_touch(orbits: Orbits, X: np.ndarray, objection: Objection) -> tuple[Orbits, np.ndarray]:
    """Return the orbits and the point with one more impact, of speed zero.

    The impact is at the top of the flight that crosses the stop.
    """
    at, values = objection.at, parameters_at(orbits.system, X)
    omega, theta, v = orbits.oscillator(X).omega, X[2 * at], X[2 * at + 1] * orbits.speed
    tau = (objection.where - theta) / omega
    for _ in range(20):
        _, u, a = state_after(values, theta, v, tau)
        if not a < 0.0 or abs(u / a) < 1e-12 * tau:
            break
        tau = max(tau - u / a, 0.5 * tau)
    Y = np.insert(X, 2 * at + 2, (theta + omega * tau, 0.0))
    z = Y[: 2 * orbits.q + 2].reshape(-1, 2)
    touching = PeriodicOrbit(orbits.oscillator(X), orbits.m, z[:, 0], z[:, 1] * orbits.speed)
    return Orbits(touching, orbits.axes, speed=orbits.speed), Y


def halving(step: Segment) -> tuple[np.ndarray, PeriodicOrbit] | None:
    """Return where within a step the orbit becomes one of half the period, and that orbit.

    None if it does not.
    """
    orbits, q = step.orbits, step.orbits.q
    if orbits.m % 2 or q % 2:
        return None
    unlike = [_unlike(orbits, X) for X in (step.begin.X, step.end.X)]
    sizes = [float(np.abs(part).max()) for part in unlike]
    change_places = np.sum(unlike[0] * unlike[1]) < 0.0 or sizes[1] ** 2 < ROUNDING
    if not change_places or sizes[0] < ROUNDING:
        return None
    X = step.between(sizes[0] / sum(sizes))
    z = X[: 2 * q].reshape(q, 2)
    mean = z[: q // 2] + 0.5 * _unlike(orbits, X)
    half = PeriodicOrbit(orbits.oscillator(X), orbits.m // 2, mean[:, 0], mean[:, 1] * orbits.speed)
    halves = Orbits(half, orbits.axes)
    Y = halves.corrected(halves.start, np.empty((0, halves.start.size)), FLIP)
    if Y is None or not halves.allows(halves.point(Y, np.zeros(Y.size))):
        return None
    return doubling(halves, Y, orbits.speed)[0], halves.orbit(Y)


def _unlike(orbits: Orbits, X: np.ndarray) -> np.ndarray:
    """Return by how much the second half of an orbit differs from the first, shape (q / 2, 2)."""
    z = X[: 2 * orbits.q].reshape(2, -1, 2)
    return z[1] - z[0] - np.array([math.pi * orbits.m, 0.0])


def doubling(orbits: Orbits, X: np.ndarray, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a flip as a point of the orbits of twice the period, and the direction they take.

    Parameters
    ----------
    orbits : Orbits
    X : ndarray
        A point of `orbits`, at a flip.
    speed : float
        The unit of speed of the orbits of twice the period.
    """
    q, units = orbits.q, np.array([1.0, orbits.speed / speed])
    z = X[: 2 * q].reshape(q, 2) * units
    vector = null_vector(*orbits.derivatives(X), -1.0).reshape(q, 2) * units
    vector /= math.sqrt(np.sum(vector**2) / q)
    second_round = z + np.array([2.0 * math.pi * orbits.m, 0.0])
    doubled = np.concatenate([z.ravel(), second_round.ravel(), X[2 * q :]])
    along = np.concatenate([vector.ravel(), -vector.ravel(), np.zeros(X.size - 2 * q)])
    return doubled, along
