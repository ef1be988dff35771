"""Orbits whose two halves become equal: there they are orbits of half the period, at a flip.

A branch of orbits of twice the period ends at a flip of the half, where its halves change places. A
curve of folds of such orbits ends where this flip is degenerate (Kuznetsov, *Elements of Applied
Bifurcation Theory*, sec. 9.3). A curve of their flips or folds may also end where the half flips
and grazes at once.
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact.orbits.calls import null_vector
from vibroimpact.orbits.detection import ROUNDING
from vibroimpact.orbits.ends import is_orbit
from vibroimpact.orbits.family import ArclengthStep, OrbitFamily
from vibroimpact.orbits.orbit import PeriodicOrbit
from vibroimpact.orbits.unknowns import free, impacts, phases, speeds, unknowns

#: Where the difference of the halves falls below this, a curve of folds may be about to end.
_ALMOST_ALIKE = 0.1
#: The end of a curve of folds is extrapolated from the first point of a step and from points where
#: the halves differ by these shares of their difference there, at least so many.
_SHARES, _FEWEST = (0.85, 0.7, 0.55, 0.4, 0.3, 0.2), 3
#: The end that is extrapolated is closer to the flip of the half than this, in scaled unknowns.
_EXTRAPOLATED = 1e-7
#: Where an impact of both halves is slower than this, they may both graze.
_SLOW = 0.02
#: A curve deviates from the straight line to this graze by less than this share of its length.
_MOST_OFF = 0.1
#: The graze is where a Newton step along the grazes of the half is below this; most steps.
_AT_FLIP, _MOST_STEPS = 1e-10, 12
#: It is nearer to where the curve seems to lead than this, in scaled unknowns.
_NEARBY = 0.1


def parents_flip(step: ArclengthStep) -> tuple[str, np.ndarray, PeriodicOrbit] | None:
    """Return where in a step an orbit meets the flip of its parent, of half its period; or None.

    The result is ``flip``, the point of the step, and the parent. Where a curve of folds meets an
    edge just before, it is ``edge``, the point there, and its orbit.
    """
    family = step.family
    if family.kind not in ("", "fold") or family.m % 2 or family.q % 2:
        return None
    differences = [difference_of_halves(family, X) for X in (step.begin.X, step.end.X)]
    sizes = [float(np.abs(part).max()) for part in differences]
    if sizes[0] < ROUNDING:
        return None
    if family.kind == "fold":
        return _degenerate_flip(step) if sizes[1] < min(_ALMOST_ALIKE, sizes[0]) else None
    if np.sum(differences[0] * differences[1]) >= 0.0 and sizes[1] ** 2 >= ROUNDING:
        return None
    halves, X = _half(family, step.between(sizes[0] / sum(sizes)))
    return _doubled(family, halves, halves.bifurcation(X, "flip"))


def _degenerate_flip(step: ArclengthStep) -> tuple[str, np.ndarray, PeriodicOrbit] | None:
    """Return the end of a curve of folds near the end of a step, as `parents_flip` does.

    The equations of folds are singular there, so it is extrapolated from points beside it.
    """
    family, beside = step.family, _Beside(step)
    if not beside.found:
        return None
    halves, X = _half(family, beside.at(0.0), "flip")
    Y = halves.corrected(X, halves.tangent(X)[None, :])
    if Y is None or not halves.distance(Y, X) < _EXTRAPOLATED:
        return None
    return _doubled(family, halves, Y) or _edge_beside(beside, halves, Y)


class _Beside:
    """Points on a curve of folds beside its end, where the halves of its orbit become equal.

    The mean of the halves, the parameters, and the difference of the halves as a share of its size
    are smooth functions of the square of this size.
    """

    def __init__(self, step: ArclengthStep) -> None:
        self.family, first = step.family, difference_of_halves(step.family, step.begin.X)
        size = math.sqrt(np.mean(first**2))
        self.direction = first / size
        along = np.concatenate([-self.direction, self.direction])
        self.plane = 0.5 * unknowns(along, np.zeros(len(step.family.parameters)))
        self._points = [self._even(X) for X in (step.begin.X, step.end.X)]
        for share in _SHARES:
            X = self.family.corrected(self.at((share * size) ** 2), self.plane[None, :])
            if X is None:  # by rounding, where the halves are almost equal
                break
            self._points.append(self._even(X))
        del self._points[1]  # its size may be close to another one
        self.found = len(self._points) > _FEWEST
        self.smallest = self._points[-1][0]

    def _even(self, X: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the square of the size, and the functions of it, at a point."""
        difference = difference_of_halves(self.family, X)
        size = float(np.mean(difference * self.direction))
        return size**2, np.append(mean_of_halves(self.family, X), difference / size)

    def at(self, square: float) -> np.ndarray:
        """Return the unknowns at a square of the size, by a polynomial through all points."""
        q, squares = self.family.q, np.array([known for known, _ in self._points])
        even = interpolated(squares, np.array([values for _, values in self._points]), square)
        mean, change = even[:-q], 0.5 * math.sqrt(square) * even[-q:].reshape(-1, 2)
        first = impacts(mean, q // 2)
        second = first + change + np.array([math.pi * self.family.m, 0.0])
        return unknowns(np.concatenate([first - change, second]), free(mean, q // 2))


def interpolated(places: np.ndarray, values: np.ndarray, place: float) -> np.ndarray:
    """Return the polynomial through values, shape (n, k), at n places; at another place."""
    factors = (places - place) / (places - places[:, None] + np.diag(places - place))
    return np.prod(factors, axis=1) @ values


def _edge_beside(
    beside: _Beside, halves: OrbitFamily, Y: np.ndarray
) -> tuple[str, np.ndarray, PeriodicOrbit] | None:
    """Return where a curve of folds meets an edge just before its end Y, as `parents_flip` does."""
    from scipy.optimize import brentq

    family, (reason, _) = beside.family, halves.inadmissible(Y)
    if reason is None or reason.kind != "edge":
        return None
    edge = reason.where / family.spans[reason.at]

    def at_edge(X: np.ndarray) -> float:
        return float(free(X, family.q)[reason.at]) - edge

    try:
        square = brentq(lambda s: at_edge(beside.at(s)), 0.0, 0.5 * beside.smallest)
    except ValueError:  # it is farther away: it is found without this
        return None
    guess, axis = beside.at(square), np.zeros(beside.plane.size)
    free(guess, family.q)[reason.at], free(axis, family.q)[reason.at] = edge, 1.0
    X = family.corrected(guess, np.array([beside.plane, axis]))
    if X is None or not is_orbit(family, family.point(X, np.zeros(X.size))):
        return None
    return "edge", X, family.orbit(X)


def grazing_flip(step: ArclengthStep) -> tuple[str, np.ndarray, PeriodicOrbit] | None:
    """Return where a curve ends as its half flips and grazes at once; None if not near.

    The equations are singular there: the end is sought on the curve of grazes of the half. The
    result is ``graze``, the point, and its orbit.
    """
    family = step.family
    if family.kind == "" or family.m % 2:
        return None
    near = _near_double_graze(step) if family.kind == "graze" else _near_grazing_flip(step)
    if near is None:
        return None
    halves, Y, touch = near
    graze = _at_its_flip(halves, Y, touch is not None)
    if graze is None or not is_orbit(halves, halves.point(graze, np.zeros(graze.size))):
        return None
    X, end, off = step.begin.X, _taken_twice(halves, graze), list[float]()
    if touch is not None:
        z = np.delete(impacts(end, family.q + 1), touch, axis=0)
        end = unknowns(z, free(end, family.q + 1))
    for share in (0.5, 0.875):  # a curve that leads to the end comes back to the straight line
        place = X + share * (end - X)
        between = family.corrected(place, (end - X)[None, :])
        off.append(math.inf if between is None else family.distance(between, place))
    leads = off[1] < off[0] < _MOST_OFF * family.distance(end, X)
    return ("graze", end, family.orbit(end)) if leads else None


def _near_grazing_flip(step: ArclengthStep) -> tuple[OrbitFamily, np.ndarray, None] | None:
    """Return the grazes of the half, and one near which a curve of flips or folds may end."""
    family, X, along = step.family, step.begin.X, step.begin.tangent
    q = family.q // 2
    if family.q % 2:
        return None
    slowest = int(np.argmin(speeds(X, family.q))) % q
    v, slopes = (speeds(Y, family.q)[[slowest, slowest + q]] for Y in (X, along))
    if not (v.max() < _SLOW and (slopes < 0.0).all()):
        return None
    return *_half(family, X - np.mean(v / slopes) * along, "graze", slowest), None


def _near_double_graze(step: ArclengthStep) -> tuple[OrbitFamily, np.ndarray, int | None] | None:
    """Return the same for a curve of grazes whose halves become equal, and a touch that was added.

    The number of impacts may be odd: then one half grazes, and the other only will at the end.
    """
    family, graze, touch = step.family, step.family.system.graze, None
    whole, points = family, [step.begin.X, step.end.X]
    if family.q == 1:
        return None
    if family.q % 2:
        touch = _place_of_touch(family, points[0])
        points = [_touching(family, X, touch) for X in points]
        z = impacts(points[0], family.q + 1)
        whole = family.related(z, family.m)
        graze += int(touch <= graze)
        if abs(graze - touch) != whole.q // 2:
            return None
    sizes = [float(np.abs(difference_of_halves(whole, X)).max()) for X in points]
    if not sizes[1] < min(_ALMOST_ALIKE, sizes[0]):
        return None
    return *_half(whole, points[0], "graze", graze % (whole.q // 2)), touch


def _place_of_touch(family: OrbitFamily, X: np.ndarray) -> int:
    """Return the index at which half an orbit after its graze, another touch is inserted."""
    theta, half = phases(X, family.q), math.pi * family.m
    other = theta[family.system.graze] + half
    return int(
        np.searchsorted(theta, other - 2.0 * half if other > theta[0] + 2.0 * half else other)
    )


def _touching(family: OrbitFamily, X: np.ndarray, touch: int) -> np.ndarray:
    """Return a point with another touch half an orbit before or after its graze."""
    z, graze = impacts(X, family.q), family.system.graze
    half = math.pi * family.m * (1.0 if touch > graze else -1.0)
    z = np.insert(z, touch, (z[graze, 0] + half, 0.0), axis=0)
    return unknowns(z, free(X, family.q))


def _at_its_flip(family: OrbitFamily, X: np.ndarray, without_touch: bool) -> np.ndarray | None:
    """Return the point of a curve of grazes near X where curves of flips meet it, or None.

    There the orbit flips, or the orbit `without_touch` does.
    """
    tangent, other = family.tangent(X), family
    if without_touch:
        z = impacts(_without_touch(family, X), family.q - 1)
        other = family.related(z, family.m)
    for _ in range(_MOST_STEPS):
        Y = family.corrected(X, tangent[None, :])
        if Y is None:
            return None
        Z, along = (_without_touch(family, V) if without_touch else V for V in (Y, tangent))
        value, slope = other.point(Z, along).tests[:, -2]
        if not abs(value) < _NEARBY * abs(slope):
            return None
        if abs(value) < _AT_FLIP * abs(slope):
            return Y
        X = Y - value / slope * tangent
    return None


def _without_touch(family: OrbitFamily, X: np.ndarray) -> np.ndarray:
    """Return a point of a curve of grazes, or a direction, without the impact that grazes."""
    z = np.delete(impacts(X, family.q), family.system.graze, axis=0)
    return unknowns(z, free(X, family.q))


def _taken_twice(halves: OrbitFamily, X: np.ndarray) -> np.ndarray:
    """Return an orbit as a point of the orbits of twice the period."""
    z = impacts(X, halves.q)
    second = z + np.array([2.0 * math.pi * halves.m, 0.0])
    return unknowns(np.concatenate([z, second]), free(X, halves.q))


def _half(
    family: OrbitFamily, X: np.ndarray, kind: str = "", graze: int = 0
) -> tuple[OrbitFamily, np.ndarray]:
    """Return the family of orbits of half the period, and the mean of the halves of a point."""
    mean = mean_of_halves(family, X)
    return family.related(impacts(mean, family.q // 2), family.m // 2, kind, graze), mean


def _doubled(
    family: OrbitFamily, halves: OrbitFamily, Y: np.ndarray | None
) -> tuple[str, np.ndarray, PeriodicOrbit] | None:
    """Return a flip of the half orbits as `parents_flip` does; None if it is not a flip."""
    if Y is None or not is_orbit(halves, halves.point(Y, np.zeros(Y.size))):
        return None
    return "flip", doubling(halves, Y)[0], halves.orbit(Y)


def difference_of_halves(family: OrbitFamily, X: np.ndarray) -> np.ndarray:
    """Return the difference of the second half of an orbit from the first, shape (q / 2, 2)."""
    z, q = impacts(X, family.q), family.q // 2
    return z[q:] - z[:q] - np.array([math.pi * family.m, 0.0])


def mean_of_halves(family: OrbitFamily, X: np.ndarray) -> np.ndarray:
    """Return the mean of the halves of an orbit as a point of the orbits of half the period."""
    first = impacts(X, family.q)[: family.q // 2]
    return unknowns(first + 0.5 * difference_of_halves(family, X), free(X, family.q))


def doubling(family: OrbitFamily, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a flip X as a point of the orbits of twice the period, and their direction there."""
    q, z = family.q, impacts(X, family.q)
    vector = impacts(null_vector(family.system, X, -1.0), q)
    vector /= math.sqrt(np.sum(vector**2) / q)
    second = z + np.array([2.0 * math.pi * family.m, 0.0])
    doubled = unknowns(np.concatenate([z, second]), free(X, q))
    along = unknowns(np.concatenate([vector, -vector]), np.zeros(len(family.parameters)))
    return doubled, along
