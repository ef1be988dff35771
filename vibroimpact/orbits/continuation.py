"""Pseudo-arclength continuation of orbits, for branches and for curves of bifurcations.

A step goes along the tangent and is corrected in the plane normal to it (Keller 1977), so folds are
passed like any other point. The step is shortened if Newton's method fails, if the tangent turns
too far, or if the step may miss something. The path ends, to rounding, at the last point that is an
orbit (``ends.py``).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from vibroimpact.orbits.ends import ENDS, to_last_orbit
from vibroimpact.orbits.family import ArclengthStep, OrbitFamily, Point
from vibroimpact.orbits.unknowns import speeds

#: Lengths of steps in scaled unknowns: the first, the longest, and one below which the path is
#: given up.
_FIRST, _LONGEST, _SHORTEST = 5e-3, 0.08, 1e-9
#: A step shorter than this misses nothing but rounding.
_RESOLVED = 1e-6
#: Most points of a path; least cosine of the angle by which the tangent turns in one step.
MOST_POINTS, _LEAST_COSINE = 2000, 0.985


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
        fastest = max(1.0, float(np.abs(speeds(here.X, family.q)).max()))
        length = min(1.5 * step.length, _LONGEST * fastest)
    yield ArclengthStep(family, here, here, 0.0, last=True)


def lost_text(points: int, impacts: np.ndarray) -> str:
    """Return why a path of this many points is lost at an orbit with these speeds.

    The speed 0, of the impact that grazes all along a curve of grazes, says nothing.
    """
    text = "Newton's method fails or takes too long"
    if points >= MOST_POINTS:
        text = f"not at its end after {MOST_POINTS:,} points"
    moving = impacts[impacts != 0.0]
    if moving.size == 0:
        return text
    slowest, fastest = float(moving.min()), float(moving.max())
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
                    step = to_last_orbit(step, end.inadmissible)
                ends = not step.last or step.margin < ENDS
                if length < _RESOLVED or (ends and not step.may_miss()):
                    return step
        length *= 0.5
    margin = family.slowest(X)
    if family.kind:  # on a branch, a flight that touches the stop becomes inadmissible first
        margin = min(margin, -begin.maximum)
    return ArclengthStep(family, begin, begin, 0.0, last=True, margin=margin)


def _returns(step: ArclengthStep, start: Point) -> bool:
    """Whether a step passes the point where the path began, in the same direction."""
    family, place = step.family, step.place(start.X)
    along = step.begin.tangent
    if not (0.0 <= place <= 1.0 and family.inner(along, start.tangent) > 0.5):
        return False
    offset = step.begin.X + place * step.length * along - start.X
    return family.inner(offset, offset) < step.length**2
