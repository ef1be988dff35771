"""Pseudo-arclength continuation of orbits: one walk for branches and for curves of bifurcations.

A step goes along the tangent and is corrected in the plane across it (Keller 1977), so folds are
passed like any other point. The step is shortened where Newton's method fails or the tangent turns
too far, and where the orbit stops being one: the walk ends there, at the last orbit, to rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from vibroimpact.orbits.family import Objection, Orbits

#: Steps of a walk, in units of the scaled unknowns: the first, the longest, and one so short that
#: the walk is given up.
_FIRST, _LONGEST, _SHORTEST = 5e-3, 0.08, 1e-9
#: Points of a walk at the most; the turn of the tangent in one step (its cosine).
MOST_POINTS, _LEAST_COSINE = 600, 0.985
#: Halvings to the last orbit of a walk.
_HALVINGS = 52


@dataclass(frozen=True)
class Segment:
    """One step of a walk: from X along the tangent, over a length, to Y."""

    orbits: Orbits
    X: np.ndarray
    tangent: np.ndarray
    length: float
    Y: np.ndarray

    def at(self, s: float) -> np.ndarray | None:
        """Return the point a length `s` along the tangent."""
        if s == 0.0:
            return self.X
        return self.orbits.corrected(self.X + s * self.tangent, self.tangent[None, :])

    def place(self, X: np.ndarray) -> float:
        """Return how far along the tangent a point is, as a share of the step."""
        return self.orbits.inner(self.tangent, X - self.X) / self.length

    def root(self, function: Callable[[np.ndarray], float]) -> np.ndarray | None:
        """Return the point where a function that changes its sign over the step is zero."""
        from scipy.optimize import brentq

        def along_step(s: float) -> float:
            X = self.at(s)
            if X is None:
                raise ArithmeticError
            return function(X)

        try:
            s = brentq(along_step, 0.0, self.length, xtol=1e-16 * (1.0 + self.length), rtol=1e-14)
        except (ArithmeticError, ValueError):
            return None
        return self.at(float(s))


class Track(NamedTuple):
    """The points of a walk, its special points, and whether it is closed."""

    points: list[Any]
    special: list[Any]
    closed: bool


def both_directions(walked: Callable[[np.ndarray], Track], tangent: np.ndarray) -> Track:
    """Walk along a tangent and, unless that walk is closed, against it.

    Returns the points in order along the tangent.
    """
    forward = walked(tangent)
    if forward.closed:
        return forward
    backward = walked(-tangent)
    points = backward.points[::-1] + forward.points[1:]
    return Track(points, backward.special[::-1] + forward.special, closed=False)


@dataclass(frozen=True)
class End:
    """The last point of a walk, and why it ends there.

    `objection` is None if the walk is closed or lost.
    """

    X: np.ndarray
    objection: Objection | None
    closed: bool = False


def walk(
    orbits: Orbits, X: np.ndarray, tangent: np.ndarray, length: float = _FIRST
) -> Iterator[Segment | End]:
    """Walk from a point along a tangent, to where there is no orbit any more.

    Yields
    ------
    Segment
        A step, all of whose points are orbits.
    End
        Comes last.
    """
    begin, first, objection = X, tangent, None
    for step in range(MOST_POINTS):
        segment = _step(orbits, X, tangent, length)
        if segment is None:
            break
        if step > 3 and _returns(segment, begin, first):
            yield Segment(orbits, X, tangent, segment.length, begin)
            yield End(begin, None, closed=True)
            return
        objection = orbits.objection(segment.Y)
        if objection is not None:
            last, objection = _last(segment, objection)
            if segment.place(last) > 0.0:
                yield Segment(orbits, X, tangent, segment.place(last) * segment.length, last)
            X = last
            break
        yield segment
        X = segment.Y
        turned = orbits.tangent(X)
        tangent = turned if orbits.inner(turned, tangent) > 0.0 else -turned
        fastest = max(1.0, float(np.abs(X[1 : 2 * orbits.q : 2]).max()))
        length = min(1.5 * segment.length, _LONGEST * fastest)
    yield End(X, objection)


def lost_text(points: int, speeds: np.ndarray) -> str:
    """Say why a walk of so many points is lost at an orbit with these speeds."""
    text = "Newton's method fails"
    if points >= MOST_POINTS:
        text = f"not at its end after {MOST_POINTS:,} points"
    slowest, fastest = float(speeds.min()), float(speeds.max())
    return f"{text}; the slowest impact has {slowest / fastest:.0e} of the speed of the fastest"


def _step(orbits: Orbits, X: np.ndarray, tangent: np.ndarray, length: float) -> Segment | None:
    """Return the longest step, of at most `length`, whose tangent does not turn too far."""
    while length > _SHORTEST:
        Y = orbits.corrected(X + length * tangent, tangent[None, :])
        if Y is not None and orbits.inner(Y - X, Y - X) < 4.0 * length * length:
            turned = orbits.tangent(Y)
            if abs(orbits.inner(turned, tangent)) > _LEAST_COSINE:
                return Segment(orbits, X, tangent, length, Y)
        length *= 0.5
    return None


def _returns(segment: Segment, begin: np.ndarray, tangent: np.ndarray) -> bool:
    """Whether a step passes the point where the walk began, in the same direction."""
    place = segment.place(begin)
    if not (0.0 <= place <= 1.0 and segment.orbits.inner(segment.tangent, tangent) > 0.5):
        return False
    offset = segment.X + place * segment.length * segment.tangent - begin
    return segment.orbits.inner(offset, offset) < segment.length**2


def _last(segment: Segment, objection: Objection) -> tuple[np.ndarray, Objection]:
    """Return the last point of a step that is an orbit, and what objects just after it."""
    orbits, last, Y = segment.orbits, segment.X, segment.Y
    low, high, far = 0.0, segment.length, segment.length
    for _ in range(_HALVINGS):
        if objection.kind == "edge":
            edge = _edge(segment, objection, last, Y)
            if edge is not None:
                return edge, objection
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        guess = last + (middle - low) / (far - low) * (Y - last)
        X = orbits.corrected(guess, segment.tangent[None, :])
        beyond = None if X is None else orbits.objection(X)
        if X is None:  # as beside a point of codimension two, where the orbits end
            high = middle
        elif beyond is None:
            low, last = middle, X
        else:
            high, far, objection, Y = middle, middle, beyond, X
    return last, objection


def _edge(
    segment: Segment, objection: Objection, X: np.ndarray, Y: np.ndarray
) -> np.ndarray | None:
    """Return the orbit at the edge between X and a point Y beyond it, if there is one."""
    orbits, axis = segment.orbits, objection.at
    inside, beyond = orbits.values(X)[axis], orbits.values(Y)[axis]
    share = (objection.where - inside) / (beyond - inside)
    edge = orbits.at(X + share * (Y - X), objection.where, axis)
    if edge is None or orbits.objection(edge) is not None:
        return None
    ends = segment.place(X), segment.place(Y)
    return edge if ends[0] <= segment.place(edge) <= ends[1] else None
