"""Paths of orbits, for branches and curves: their points, in order, and what is special on them.

A path is continued (``continuation.py``) to its end (``ends.py``, ``halves.py``). The special
points within each step are located (``special_points.py``).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from vibroimpact.orbits.continuation import continue_branch
from vibroimpact.orbits.detection import ROUNDING
from vibroimpact.orbits.ends import ending
from vibroimpact.orbits.family import ArclengthStep, OrbitFamily
from vibroimpact.orbits.halves import grazing_flip, parents_flip
from vibroimpact.orbits.orbit import PeriodicOrbit
from vibroimpact.orbits.special_points import special_points
from vibroimpact.orbits.standstill import standstill

#: Points of a path that are closer than this, in scaled unknowns, may be in a wrong order.
_SAME_POINT = 1e-7


class SpecialPoint(NamedTuple):
    """A special point of a branch or a curve.

    Attributes
    ----------
    kind : str
        On a branch ``flip`` or ``fold``. On a curve of folds ``cusp``; on a curve of grazes
        ``flip`` and ``fold``, where curves of these kinds meet it. The end of a curve of folds is a
        ``flip`` where the orbit of half the period has a degenerate one. The other ends are
        ``graze``: an impact has speed zero (on a curve another impact, to 1e-5 of the unit of
        speed), or a flight touches the stop; ``penetration``: a flight crosses the stop, and no
        touch is found; ``rest``: the mass cannot leave the stop; ``edge`` of a range; and ``lost``:
        Newton's method fails or the path is too long.
    value : float, or ndarray of shape (2,)
        Value of the parameter, or of the two parameters of a curve.
    orbit : PeriodicOrbit
        At the graze of a branch it has the impact of speed zero. At the flip in which a branch or
        a curve of folds ends it is the orbit of half the period.
    """

    kind: str
    value: Any
    orbit: PeriodicOrbit


@dataclass
class Path:
    """The points of a path with their stability, and its special points."""

    family: OrbitFamily
    points: list[tuple[np.ndarray, bool]] = field(default_factory=list)
    special: list[SpecialPoint] = field(default_factory=list)
    closed: bool = False

    def add(self, X: np.ndarray, stable: bool) -> None:
        """Add a special point; it takes the place of another that is the same to rounding."""
        if self.points and self.is_last(X):
            self.points.pop()
        self.points.append((X, stable))

    def is_last(self, X: np.ndarray) -> bool:
        """Whether a point is the last one, to rounding."""
        return self.family.distance(self.points[-1][0], X) < _SAME_POINT

    def note(self, kind: str, orbit: PeriodicOrbit) -> None:
        """Note what is special at an orbit."""
        value = np.array([getattr(orbit.oscillator, name) for name in self.family.names])
        self.special.append(SpecialPoint(kind, value if self.family.kind else value.item(), orbit))


def both_ways(family: OrbitFamily, tangent: np.ndarray) -> Path:
    """Continue a family along a tangent and, unless that path closes, also against it."""
    forward = one_way(family, family.start, tangent)
    if forward.closed:
        return forward
    back = one_way(family, family.start, -tangent)
    begin = (forward if back.points[0][0] is family.start else back).points[0]
    points = [*back.points[:0:-1], begin, *forward.points[1:]]
    return Path(family, points, back.special[::-1] + forward.special)


def one_way(family: OrbitFamily, X: np.ndarray, tangent: np.ndarray) -> Path:
    """Continue a family in one direction."""
    family.system.work[0] = 0.0  # each direction has its own limit of work
    start = family.point(X, tangent)
    if family.slowest(X) == 0.0:  # at a graze, zeros of tests belong to the start, not to the step
        start.tests[0, np.abs(start.tests[0]) < ROUNDING] = math.nan
    path = Path(family, [(X, family.stable(start))])
    for step in continue_branch(family, start):
        if step.length > 0.0 and _pass(path, step):
            break
        if step.closed:
            path.closed = True
        elif step.last:
            kept, (kind, X, orbit) = len(path.points) - 1, ending(step)
            stands = standstill(family, [X for X, _ in path.points]) if kind == "lost" else None
            if stands is not None:
                kept, X = stands
                kind, orbit = "graze", family.orbit(X)
            del path.points[kept:]
            # At an impact of speed zero the multipliers are infinite.
            moves = family.slowest(X) > 0.0
            path.add(X, moves and family.stable(family.point(X, tangent)))
            path.note(kind, orbit)
    return path


def _pass(path: Path, step: ArclengthStep) -> bool:
    """Add a step to a path, with what is special in it; return whether the path ends in it."""
    family, end = path.family, parents_flip(step) or grazing_flip(step)
    located = list(special_points(step, None if end is None else end[1]))
    for kind, X in located:
        if not family.kind:  # the branch may change its stability there
            path.add(X, False)
        path.note(kind, family.orbit(X))
    if end is not None:
        kind, X, orbit = end
        if located:  # the stability from the last of them to the end
            path.points += _middle(family, path.points[-1][0], X)
        path.add(X, False)
        path.note(kind, orbit)
    elif not (located and path.is_last(step.end.X)):
        path.points.append((step.end.X, family.stable(step.end)))
    return end is not None


def _middle(family: OrbitFamily, X: np.ndarray, Y: np.ndarray) -> Iterator[tuple[np.ndarray, bool]]:
    """Yield the point between two points of a branch, with its stability, if it is found."""
    middle = family.corrected(0.5 * (X + Y), (Y - X)[None, :])
    if middle is not None:
        yield middle, family.stable(family.point(middle, Y - X))
