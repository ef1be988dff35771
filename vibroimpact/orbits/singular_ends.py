"""Extrapolates paths to singular ends: orbits of half the period, impacts without speed, touches.

A branch of orbits of twice the period ends at a flip of the half, where its halves change places.
A curve of folds of such orbits ends where this flip is degenerate (Kuznetsov, *Elements of Applied
Bifurcation Theory*, sec. 9.3): the orbits of twice the period then neither begin on one side of the
curve of flips nor on the other. The equations of the folds are singular there, and so are those of
a curve on which all impacts lose their speed at once: it ends in an orbit that touches the stop
without speed, as without damping where omega is a fraction of p. Impacts may also meet there in a
rest, without speed and acceleration, or at R = 0. Where hardly any energy is lost, the speeds of a
path may grow without bound, and curves may lead to a corner of their ranges: there the force
vanishes. A curve of grazes ends where the other half grazes, too: without its touch the orbit is
twice its half there, at a flip.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from vibroimpact.orbits import calls
from vibroimpact.orbits.continuation import GRAZES, End, onto_edges
from vibroimpact.orbits.corrector import determinant
from vibroimpact.orbits.family import NEARBY_DISTANCE, ContinuationParameter, OrbitFamily
from vibroimpact.orbits.normal_form import cubic_coefficient
from vibroimpact.orbits.orbit import PeriodicOrbit
from vibroimpact.orbits.unknowns import (
    differences_of_halves,
    free,
    impact_rows,
    phases,
    speeds,
    unknowns,
)

#: A curve of folds ends where the mean square difference of its halves is below this, or below the
#: second if Newton's method fails there.
_MEETS, _MAY_MEET = 4e-4, 0.1
#: Impacts that meet at a rest are left this share of their last distance apart.
_APART_BY = 1e-6
#: A flight shorter than this may end a curve at a rest.
_SHORT = 0.02
#: Its end is where it leads from at most so many of its last points, at which this difference,
#: speed or flight is at least so many times that of the next one. It is known if with one point
#: less it is the same to this share of the ranges, or to the second one at a rest and where speeds
#: grow.
_POINTS, _APART, _PRECISE, _KNOWN = 5, 1.5, 1e-8, 1e-7
#: Of a long path the last points tell where it leads.
_LATE = 100
#: The second place at which a touch is looked at, and the error of the root, in scaled unknowns.
_NEAR = 1e-6, 1e-9
#: A curve may end in a corner of its ranges if it is this near to one of its edges.
_NEAR_EDGE = 1e-3
#: A degenerate flip is nearer than this to where the curve of folds leads.
_NEAR_LIMIT = 0.05
#: Impacts of a path that are so many times faster than the force and the clearance alone make them
#: may grow without bound.
_FASTEST = 1e3


def singular_end(
    family: OrbitFamily, points: Sequence[np.ndarray], lost: bool = False
) -> End | None:
    """Return how a path ends beyond some points, where, and the orbit; None if it goes on.

    `lost` says whether Newton's method fails there.
    """
    end = _unbounded(family, points)
    if end or not family.kind:
        return end
    end = _standstill(family, points) or _degenerate_flip(family, points, lost)
    return end or _meeting_impacts(family, points) or _corner(family, points)


def _degenerate_flip(family: OrbitFamily, points: Sequence[np.ndarray], lost: bool) -> End | None:
    """Return how a curve of folds ends beyond some points, where, and the orbit; None if not near.

    It ends in a ``flip`` of the half. The mean of the halves is a smooth function of the square of
    their difference: its limit is near.
    """
    if family.kind != "fold" or family.m % 2 or family.q % 2:
        return None
    m, q = family.m, family.q
    guess, error = _limit(
        points,
        lambda X: np.sum(differences_of_halves(X, m, q) ** 2) / q,
        _MAY_MEET if lost else _MEETS,
        partial(mean_of_halves, family),
    )
    if error == math.inf:
        return None
    halves, _ = half_of(family, points[-1], "flip")
    coefficient = partial(cubic_coefficient, halves.system)
    offset = _root_along(halves, guess, coefficient, NEARBY_DISTANCE, _PRECISE)
    if not (error < NEARBY_DISTANCE and abs(offset) < _NEAR_LIMIT):
        return None
    Y = _along(halves, guess, offset)
    if halves.inadmissible(Y)[0] is not None:
        return None
    return "flip", doubling(halves, Y)[0], halves.orbit(Y)


def starts_degenerate(orbit: PeriodicOrbit, axes: Sequence[ContinuationParameter]) -> bool:
    """Whether a flip at which a curve starts is degenerate."""
    flips = OrbitFamily(orbit, axes, "flip")
    coefficient = partial(cubic_coefficient, flips.system)
    offset = _root_along(flips, flips.start, coefficient, NEARBY_DISTANCE, _PRECISE)
    return abs(offset) < NEARBY_DISTANCE


def _along(family: OrbitFamily, guess: np.ndarray, offset: float) -> np.ndarray:
    """Return the point of a curve at an offset along its tangent from a guess."""
    along = family.tangent(guess)
    X = family.corrected(guess + offset * along, along[None, :])
    if X is None:
        raise ArithmeticError
    return X


def _root_along(
    family: OrbitFamily,
    guess: np.ndarray,
    function: Callable[[np.ndarray], float],
    second: float,
    error: float,
) -> float:
    """Return where along a curve a function is zero, by the secant method; NaN if not found."""
    from scipy.optimize import newton

    try:
        with np.errstate(invalid="ignore"):
            root = newton(lambda s: function(_along(family, guess, s)), 0.0, x1=second, tol=error)
    except (ArithmeticError, RuntimeError):
        return math.nan
    return float(root)


def _standstill(family: OrbitFamily, points: Sequence[np.ndarray]) -> End | None:
    """Return the ``graze``, or ``edge``, in which all impacts lose their speed, as above."""
    if family.kind not in ("flip", "fold") or family.q == 1:
        return None
    X, error = _limit(points, family.fastest, NEARBY_DISTANCE)
    if not error < _KNOWN:
        return None
    X = onto_edges(family, X, _KNOWN)
    speeds(X, family.q)[:] = 0.0
    if family.inadmissible(X)[0] is not None:
        return None
    return _end_in_ranges(family, X, "graze")


def _meeting_impacts(family: OrbitFamily, points: Sequence[np.ndarray]) -> End | None:
    """Return the ``rest``, or ``edge``, in which a flight shrinks to nothing, as above."""
    short = family.flights(points[-1]) < _SHORT
    X, error = _limit(points, lambda X: family.flights(X).max(initial=0.0, where=short), _SHORT)
    if not (short.any() and error < _KNOWN):
        return None
    X = onto_edges(family, X, _KNOWN)
    theta = np.maximum.accumulate(phases(X, family.q))  # apart, as equations where impacts meet
    phases(X, family.q)[:] = theta + _APART_BY * (phases(points[-1], family.q) - theta)
    v = speeds(X, family.q)
    v[v < GRAZES] = 0.0
    return _end_in_ranges(family, X, "rest")


def _corner(family: OrbitFamily, points: Sequence[np.ndarray]) -> End | None:
    """Return the ``edge`` in which a curve leads to a corner of its ranges, as above."""
    edges = np.reshape([(axis.low, axis.high) for axis in family.parameters], (-1, 2))
    for j, side in np.ndindex(edges.shape):
        distance = partial(_distance_to_edge, family, j, edges[j, side] / family.spans[j])
        X, error = _limit(points, distance, _NEAR_EDGE)
        X = onto_edges(family, X, _KNOWN)
        if error < _KNOWN and (family.free_values(X)[:, None] == edges).any(axis=1).all():
            return "edge", X, family.orbit(X)
    return None


def _distance_to_edge(family: OrbitFamily, j: int, edge: float, X: np.ndarray) -> float:
    return abs(float(free(X, family.q)[j]) - edge)


def flip_that_touches(family: OrbitFamily, X: np.ndarray) -> End | None:
    """Return the ``graze`` near X in which both halves of a grazing orbit graze, as above."""
    m, q, at = family.m, family.q, family.system.graze
    if family.kind != "graze" or m % 2 or q < 3 or not q % 2:
        return None
    z, turn = np.roll(impact_rows(X, q), -at, axis=0), np.array([math.pi * m, 0.0])
    z[q - at :] += 2.0 * turn  # now the touch is the first
    half, second = z[1 : 1 + q // 2], z[1 + q // 2 :] - turn
    halves = family.related(half, m // 2, "flip")
    guess = unknowns(0.5 * (half + second), free(X, q))
    root = _root_along(
        halves, guess, lambda Y: calls.first_penetration(halves.system, Y)[2], *_NEAR
    )
    if not abs(root) < NEARBY_DISTANCE:
        return None
    Y = _along(halves, guess, root)
    half = impact_rows(Y, halves.q)
    z[0, 0] = calls.turning_point(halves.system, Y, q // 2 - 1, z[0, 0] + turn[0])[0] - turn[0]
    z[1:] = np.concatenate([half, half + turn])
    z[q - at :] -= 2.0 * turn
    X = unknowns(np.roll(z, at, axis=0), free(Y, halves.q))
    return "graze", X, family.orbit(X)


def _unbounded(family: OrbitFamily, points: Sequence[np.ndarray]) -> End | None:
    """Return where the speeds of a path become infinite, as above: at an ``edge``, or ``lost``.

    The parameters are smooth functions of the inverse speed.
    """
    pt = calls.parameters(family.system, points[-1])
    usual = pt.f / (pt.omega + pt.p) + pt.p * abs(pt.clearance)

    def inverse(X: np.ndarray) -> float:
        return usual / max(family.fastest(X), 1e-300)

    limit, error = _limit(points, inverse, 1.0 / _FASTEST, lambda X: free(X, family.q))
    if not error < _KNOWN:
        return None
    X = points[-1].copy()
    free(X, family.q)[:] = limit
    X = onto_edges(family, X)
    pt = calls.parameters(family.system, X)
    if determinant.py_func(pt, family.m, family.q) < 1.0 - _KNOWN:  # damping or a loss bounds them
        return None
    return _end_in_ranges(family, X, "lost")


def _end_in_ranges(family: OrbitFamily, X: np.ndarray, kind: str) -> End | None:
    """Return the end at a point: an ``edge`` of the ranges, or of a kind; None outside them."""
    values = list(zip(family.parameters, family.free_values(X).tolist(), strict=True))
    if not all(axis.holds(value) for axis, value in values):
        return None
    at_edge = any(value in (axis.low, axis.high) for axis, value in values)
    return "edge" if at_edge else kind, X, family.orbit(X)


def _limit(
    points: Sequence[np.ndarray],
    distance: Callable[[np.ndarray], float],
    below: float,
    value: Callable[[np.ndarray], np.ndarray] = np.copy,
) -> tuple[np.ndarray, float]:
    """Return the limit of values at points of a path as a distance vanishes, and its error.

    It is that of the polynomial through some of the last values that changes least by one value
    more. The nearest values are less accurate. The error is infinite if the last distance is not
    below a bound.
    """
    points = points[-_LATE:]
    last, rows = value(points[-1]), [len(points) - 1]
    best, least = last, math.inf
    if not 0.0 < distance(points[-1]) < below:
        return best, least
    distances = np.array([distance(X) for X in points])
    for i in range(len(distances) - 2, -1, -1):
        if _APART * distances[rows[-1]] <= distances[i] < _MAY_MEET:
            rows.append(i)
    values = np.array([value(points[i]) for i in rows])
    for first in range(len(rows)):
        before = None
        for end in range(first + 1, min(first + _POINTS, len(rows)) + 1):
            limit = _at_zero(distances[rows[first:end]]) @ values[first:end]
            if before is not None and np.abs(limit - before).max() < least:
                best, least = limit, float(np.abs(limit - before).max())
            before = limit
    return best, least


def _at_zero(d: np.ndarray) -> np.ndarray:
    """Return the weights of values at distances d in the value at 0 of their polynomial."""
    weights: np.ndarray = np.prod(d / (d - d[:, None] + np.diag(d)), axis=1)
    return weights


def half_of(family: OrbitFamily, X: np.ndarray, kind: str = "") -> tuple[OrbitFamily, np.ndarray]:
    """Return the family of orbits of half the period, and the mean of the halves of a point."""
    mean = mean_of_halves(family, X)
    return family.related(impact_rows(mean, family.q // 2), family.m // 2, kind), mean


def mean_of_halves(family: OrbitFamily, X: np.ndarray) -> np.ndarray:
    """Return the mean of the halves of an orbit as a point of the orbits of half the period."""
    first = impact_rows(X, family.q)[: family.q // 2]
    difference = differences_of_halves(X, family.m, family.q)
    return unknowns(first + 0.5 * difference, free(X, family.q))


def doubling(family: OrbitFamily, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a flip X as a point of the orbits of twice the period, and their direction there."""
    q, z = family.q, impact_rows(X, family.q)
    vector = impact_rows(calls.null_vector(family.system, X, -1.0), q)
    vector /= math.sqrt(np.sum(vector**2) / q)
    second = z + np.array([2.0 * math.pi * family.m, 0.0])
    doubled = unknowns(np.concatenate([z, second]), free(X, q))
    along = unknowns(np.concatenate([vector, -vector]), np.zeros(len(family.parameters)))
    return doubled, along
