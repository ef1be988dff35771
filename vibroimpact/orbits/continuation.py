"""Pseudo-arclength continuation of orbits: one walk for branches and for curves of bifurcations.

A step goes along the tangent and is corrected in the plane across it (Keller 1977), so folds are
passed like any other point. The step is shortened where Newton's method fails or the tangent turns
too far, and where the orbit stops being one: the walk ends there, at the last orbit, to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from vibroimpact.orbits.detection import ROUNDING, hides
from vibroimpact.orbits.family import Objection, Orbits, Point

#: Steps of a walk, in units of the scaled unknowns: the first, the longest, and one so short that
#: the walk is given up.
_FIRST, _LONGEST, _SHORTEST = 5e-3, 0.08, 1e-9
#: A step so short hides nothing that is more than rounding.
_RESOLVED = 1e-6
#: Points of a walk at the most; the turn of the tangent in one step (its cosine).
MOST_POINTS, _LEAST_COSINE = 2000, 0.985
#: Trials to find the last orbit of a walk, and a test function that is zero there to rounding.
_MOST_TRIALS, _AT_END = 80, 1e-15
#: The margin of an objection where a walk ends; else the last orbit is sought with a shorter step.
_ENDS = 1e-9
#: Iterations at the end of a walk, where Newton's method may gain only a half in each.
_PATIENT = 60


@dataclass(frozen=True)
class Segment:
    """One step of a walk: from a point along its tangent, over a length, to another."""

    orbits: Orbits
    begin: Point
    end: Point
    length: float

    def at(self, s: float) -> np.ndarray | None:
        """Return the unknowns a length `s` along the tangent."""
        X, tangent = self.begin.X, self.begin.tangent
        return X if s == 0.0 else self.orbits.corrected(X + s * tangent, tangent[None, :])

    def place(self, X: np.ndarray) -> float:
        """Return how far along the tangent a point is, as a share of the step."""
        return self.orbits.inner(self.begin.tangent, X - self.begin.X) / self.length

    def between(self, share: float) -> np.ndarray:
        """Return the unknowns at a share of the chord."""
        return self.begin.X + share * (self.end.X - self.begin.X)

    def hides(self) -> bool:
        """Whether test functions may have more roots in the step than its ends show."""
        first, second = self.begin[:3], self.end[:3]
        return bool(hides(self.orbits.system, *first, *second, self.length))

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

    `objection` is None if the walk is closed or lost. `margin` is what is zero where it begins; if
    Newton's method fails, the slowest speed.
    """

    X: np.ndarray
    objection: Objection | None
    margin: float = math.nan
    closed: bool = False


def walk(orbits: Orbits, start: Point) -> Iterator[Segment | End]:
    """Walk from a point along its tangent, to where there is no orbit any more.

    Yields
    ------
    Segment
        A step, all of whose points are orbits.
    End
        Comes last.
    """
    here, length = start, _FIRST
    for step in range(MOST_POINTS):
        found = _step(orbits, here, length)
        if found is None:
            yield End(here.X, None, orbits.slowest(here.X))
            return
        segment, objection = found
        if objection is not None:
            if segment.length > 0.0:
                yield segment
            yield End(segment.end.X, objection, orbits.margin(segment.end, objection))
            return
        if step > 3 and _returns(segment, start):
            yield replace(segment, end=start)
            yield End(start.X, None, closed=True)
            return
        yield segment
        here = segment.end
        fastest = max(1.0, float(np.abs(here.X[1 : 2 * orbits.q : 2]).max()))
        length = min(1.5 * segment.length, _LONGEST * fastest)
    yield End(here.X, None)


def lost_text(points: int, speeds: np.ndarray) -> str:
    """Say why a walk of so many points is lost at an orbit with these speeds."""
    text = "Newton's method fails or takes too long"
    if points >= MOST_POINTS:
        text = f"not at its end after {MOST_POINTS:,} points"
    slowest, fastest = float(speeds.min()), float(speeds.max())
    return f"{text}; the slowest impact has {slowest / fastest:.0e} of the speed of the fastest"


def _step(orbits: Orbits, begin: Point, length: float) -> tuple[Segment, Objection | None] | None:
    """Return the longest step, of at most `length`, that turns little and hides nothing.

    Where the orbits end within it, it is the step to the last of them, with what objects beyond.
    """
    X, along = begin.X, begin.tangent
    while length > _SHORTEST:
        Y = orbits.corrected(X + length * along, along[None, :])
        if Y is not None and orbits.inner(Y - X, Y - X) < 4.0 * length * length:
            tangent = orbits.tangent(Y)
            cosine = orbits.inner(tangent, along)
            if abs(cosine) > _LEAST_COSINE:
                end = orbits.point(Y, math.copysign(1.0, cosine) * tangent)
                segment, objection = Segment(orbits, begin, end, length), end.objection
                ends = True
                if objection is not None:
                    segment, objection = _ended(segment, objection)
                    ends = orbits.margin(segment.end, objection) < _ENDS
                if length < _RESOLVED or (ends and not segment.hides()):
                    return segment, objection
        length *= 0.5
    return None


def _ended(segment: Segment, objection: Objection) -> tuple[Segment, Objection]:
    """Return a step to the last point that is an orbit, and what objects just after it."""
    orbits = segment.orbits
    X, objection = _last(segment, objection)
    tangent = orbits.tangent(X)
    if orbits.inner(tangent, segment.begin.tangent) < 0.0:
        tangent = -tangent
    length, end = segment.place(X) * segment.length, orbits.point(X, tangent)
    end.tests[0, np.abs(end.tests[0]) < ROUNDING] = math.nan  # zero at the end, not before it
    return Segment(orbits, segment.begin, end, length), objection


def _returns(segment: Segment, start: Point) -> bool:
    """Whether a step passes the point where the walk began, in the same direction."""
    orbits, place = segment.orbits, segment.place(start.X)
    along = segment.begin.tangent
    if not (0.0 <= place <= 1.0 and orbits.inner(along, start.tangent) > 0.5):
        return False
    offset = segment.begin.X + place * segment.length * along - start.X
    return orbits.inner(offset, offset) < segment.length**2


def _last(segment: Segment, objection: Objection) -> tuple[np.ndarray, Objection]:
    """Return the last point of a step that is an orbit, and what objects just after it.

    It is where the margin of the objection is zero: regula falsi by the Illinois rule (Dowell &
    Jarratt 1971), with a halving in every third trial and where the margin is not known.
    """
    orbits, along, last, beyond = segment.orbits, segment.begin.tangent, segment.begin, segment.end
    low, high, far, moved = 0.0, segment.length, segment.length, 0
    above, below = (orbits.margin(point, objection) for point in (last, beyond))
    for trial in range(_MOST_TRIALS):
        if objection.kind == "edge":
            edge = _edge(segment, objection, last.X, beyond.X)
            if edge is not None:
                return edge, objection
        known = high == far and trial % 3 < 2 and above >= 0.0 > below
        share = above / (above - below) if known else 0.5
        middle = low + share * (high - low)
        if middle in (low, high):
            middle = 0.5 * (low + high)
        if middle in (low, high) or 0.0 <= above < _AT_END:
            break
        guess = last.X + (middle - low) / (far - low) * (beyond.X - last.X)
        X = orbits.corrected(guess, along[None, :], most=_PATIENT)
        if X is None:  # as beside a point of codimension two, where the orbits end
            high = middle
            continue
        point = orbits.point(X, along)
        if point.objection is None:
            low, last, above = middle, point, orbits.margin(point, objection)
            below, moved = (0.5 * below if moved < 0 else below), -1
        else:
            high, far, beyond, before, objection = middle, middle, point, objection, point.objection
            below = orbits.margin(point, objection)
            if (objection.kind, objection.at) != (before.kind, before.at):
                above = orbits.margin(last, objection)
            elif moved > 0:
                above *= 0.5
            moved = 1
    return last.X, objection


def _edge(
    segment: Segment, objection: Objection, X: np.ndarray, Y: np.ndarray
) -> np.ndarray | None:
    """Return the orbit at the edge between X and a point Y beyond it, if there is one."""
    orbits, axis = segment.orbits, objection.at
    inside, beyond = orbits.values(X)[axis], orbits.values(Y)[axis]
    share = (objection.where - inside) / (beyond - inside)
    edge = orbits.at(X + share * (Y - X), objection.where, axis)
    if edge is None:
        return None
    if not orbits.allows(orbits.point(edge, segment.begin.tangent)):
        return None
    ends = segment.place(X), segment.place(Y)
    return edge if ends[0] <= segment.place(edge) <= ends[1] else None
