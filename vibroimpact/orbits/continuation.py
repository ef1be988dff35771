"""Pseudo-arclength continuation of orbits, for branches and for curves of bifurcations.

A step goes along the tangent and is corrected in the plane normal to it (Keller 1977), so folds are
passed like any other point. The step is shortened if Newton's method fails, if the tangent turns
too far, or if the step may miss something. The path ends, to rounding, at the last point that is an
orbit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from vibroimpact.orbits.detection import ROUNDING, may_miss
from vibroimpact.orbits.family import Inadmissible, OrbitFamily, Point

#: Lengths of steps in scaled unknowns: the first, the longest, and one below which the path is
#: given up.
_FIRST, _LONGEST, _SHORTEST = 5e-3, 0.08, 1e-9
#: A step shorter than this misses nothing but rounding.
_RESOLVED = 1e-6
#: The chord of a step deviates from the mean of both tangents by less than this share of the step.
#: On a circle it does not deviate at all; of 20,000 steps, 11 deviate by more.
_MOST_OFF = 0.05
#: Most points of a path; least cosine of the angle by which the tangent turns in one step.
MOST_POINTS, _LEAST_COSINE = 2000, 0.985
#: Most trials to find the last orbit of a path; a margin below the second is zero to rounding.
_MOST_TRIALS, _AT_END = 80, 1e-15
#: A path ends where the margin of an inadmissible point is below this. If it is not, the last orbit
#: is sought with a shorter step.
_ENDS = 1e-9
#: Most iterations at the end of a path, where each may only halve the error.
_PATIENT = 60


@dataclass(frozen=True)
class ArclengthStep:
    """An arclength step along a path of orbits."""

    family: OrbitFamily
    begin: Point
    end: Point
    length: float  # along the tangent at `begin`; 0 where a path ends without a further step
    last: bool = False  # whether the path ends with this step
    closed: bool = False  # whether it ends where the path began
    inadmissible: Inadmissible | None = None  # just beyond the end of the last step
    margin: float = math.nan  # of that, at the end; if Newton fails, the slowest speed

    def place(self, X: np.ndarray) -> float:
        """Return the position of a point along the tangent, as a share of the step."""
        return self.family.inner(self.begin.tangent, X - self.begin.X) / self.length

    def between(self, share: float) -> np.ndarray:
        """Return the unknowns at a share of the chord."""
        return self.begin.X + share * (self.end.X - self.begin.X)

    def jumps(self) -> bool:
        """Whether the chord deviates from the mean tangent, as in a jump to another path."""
        first, second = self.begin.tangent, self.end.tangent
        mean = (first + second) / (1.0 + self.family.inner(first, second))
        off = self.end.X - self.begin.X - self.length * mean
        return self.family.inner(off, off) > (_MOST_OFF * self.length) ** 2

    def may_miss(self) -> bool:
        """Whether the step may miss roots of test functions, or points that are not orbits."""
        first, second = self.begin[:3], self.end[:3]
        return bool(may_miss(self.family.system, *first, *second, self.length))

    def root(self, function: Callable[[np.ndarray], float]) -> np.ndarray | None:
        """Return the root of a function that changes its sign over the step; None if not found."""
        from scipy.optimize import brentq

        X, tangent = self.begin.X, self.begin.tangent

        def at(s: float) -> np.ndarray | None:
            return X if s == 0.0 else self.family.corrected(X + s * tangent, tangent[None, :])

        def along_step(s: float) -> float:
            Y = at(s)
            if Y is None:
                raise ArithmeticError
            return function(Y)

        try:
            s = brentq(along_step, 0.0, self.length, xtol=1e-16 * (1.0 + self.length), rtol=1e-14)
        except (ArithmeticError, ValueError):
            return None
        return at(float(s))


def continue_branch(family: OrbitFamily, start: Point) -> Iterator[ArclengthStep]:
    """Follow a path from a point along its tangent, until there are no more orbits.

    Yield the steps; only the last may have length 0.
    """
    here, length = start, _FIRST
    for number in range(MOST_POINTS):
        step = _step(family, here, length)
        if number > 3 and not step.last and _returns(step, start):
            step = replace(step, end=start, last=True, closed=True)
        yield step
        if step.last:
            return
        here = step.end
        fastest = max(1.0, float(np.abs(here.X[1 : 2 * family.q : 2]).max()))
        length = min(1.5 * step.length, _LONGEST * fastest)
    yield ArclengthStep(family, here, here, 0.0, last=True)


def lost_text(points: int, speeds: np.ndarray) -> str:
    """Return why a path of this many points is lost at an orbit with these speeds.

    The speed 0, of the impact that grazes all along a curve of grazes, says nothing.
    """
    text = "Newton's method fails or takes too long"
    if points >= MOST_POINTS:
        text = f"not at its end after {MOST_POINTS:,} points"
    speeds = speeds[speeds != 0.0]
    if speeds.size == 0:
        return text
    slowest, fastest = float(speeds.min()), float(speeds.max())
    return f"{text}; the slowest impact has {slowest / fastest:.0e} of the speed of the fastest"


def _step(family: OrbitFamily, begin: Point, length: float) -> ArclengthStep:
    """Return the longest step, of at most `length`, that turns little and misses nothing.

    If the orbits end within it, it is the last step and goes to the last orbit.
    """
    X, along = begin.X, begin.tangent
    while length > _SHORTEST:
        Y = family.corrected(X + length * along, along[None, :])
        if Y is not None and family.inner(Y - X, Y - X) < 4.0 * length * length:
            tangent = family.tangent(Y, along)
            if family.inner(tangent, along) > _LEAST_COSINE:
                end = family.point(Y, tangent)
                step = ArclengthStep(family, begin, end, length)
                if length > _RESOLVED and step.jumps():
                    length *= 0.5
                    continue
                if end.inadmissible is not None:
                    step = _to_last_orbit(step, end.inadmissible)
                ends = not step.last or step.margin < _ENDS
                if length < _RESOLVED or (ends and not step.may_miss()):
                    return step
        length *= 0.5
    margin = family.slowest(X)
    if family.kind:  # on a branch, a flight that touches the stop becomes inadmissible first
        margin = min(margin, -begin.maximum)
    return ArclengthStep(family, begin, begin, 0.0, last=True, margin=margin)


def _to_last_orbit(step: ArclengthStep, reason: Inadmissible) -> ArclengthStep:
    """Return the part of a step up to its last point that is an orbit."""
    family = step.family
    X, reason = _last_orbit(step, reason)
    end = family.point(X, family.tangent(X, step.begin.tangent))
    end.tests[0, np.abs(end.tests[0]) < ROUNDING] = math.nan  # a zero there is not within the step
    length, margin = step.place(X) * step.length, family.margin(end, reason)
    return ArclengthStep(
        family, step.begin, end, length, last=True, inadmissible=reason, margin=margin
    )


def _returns(step: ArclengthStep, start: Point) -> bool:
    """Whether a step passes the point where the path began, in the same direction."""
    family, place = step.family, step.place(start.X)
    along = step.begin.tangent
    if not (0.0 <= place <= 1.0 and family.inner(along, start.tangent) > 0.5):
        return False
    offset = step.begin.X + place * step.length * along - start.X
    return family.inner(offset, offset) < step.length**2


def _last_orbit(step: ArclengthStep, reason: Inadmissible) -> tuple[np.ndarray, Inadmissible]:
    """Return the last point of a step that is an orbit, and why the next is none.

    The margin of the reason is zero there. It is found by regula falsi with the Illinois rule
    (Dowell & Jarratt 1971), with bisection in every third trial and where the margin is unknown.
    """
    family, along, last, beyond = step.family, step.begin.tangent, step.begin, step.end
    low, high, far, moved = 0.0, step.length, step.length, 0
    above, below = (family.margin(point, reason) for point in (last, beyond))
    for trial in range(_MOST_TRIALS):
        if reason.kind == "edge":
            edge = _edge(step, reason, last.X, beyond.X)
            if edge is not None:
                return edge, reason
        known = high == far and trial % 3 < 2 and above >= 0.0 > below
        share = above / (above - below) if known else 0.5
        middle = low + share * (high - low)
        if middle in (low, high):
            middle = 0.5 * (low + high)
        if middle in (low, high) or 0.0 <= above < _AT_END:
            break
        guess = last.X + (middle - low) / (far - low) * (beyond.X - last.X)
        X = family.corrected(guess, along[None, :], most=_PATIENT)
        if X is None:  # for example near a point of codimension two, where the orbits end
            high = middle
            continue
        point = family.point(X, along)
        if point.inadmissible is None:
            low, last, above = middle, point, family.margin(point, reason)
            below, moved = (0.5 * below if moved < 0 else below), -1
        else:
            high, far, beyond, before, reason = middle, middle, point, reason, point.inadmissible
            below = family.margin(point, reason)
            if (reason.kind, reason.at) != (before.kind, before.at):
                above = family.margin(last, reason)
            elif moved > 0:
                above *= 0.5
            moved = 1
    return last.X, reason


def _edge(
    step: ArclengthStep, reason: Inadmissible, X: np.ndarray, Y: np.ndarray
) -> np.ndarray | None:
    """Return the orbit at the edge between X and a point Y beyond it; None if there is none."""
    family, axis = step.family, reason.at
    inside, beyond = family.values(X)[axis], family.values(Y)[axis]
    share = (reason.where - inside) / (beyond - inside)
    edge = family.at(X + share * (Y - X), reason.where, axis)
    if edge is None or not family.allows(family.point(edge, step.begin.tangent)):
        return None
    return edge if step.place(X) <= step.place(edge) <= step.place(Y) else None
