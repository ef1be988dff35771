"""`Path`: steps one way or both, why it is lost; locates each `SpecialPoint` within.

The test functions of flip and fold are det J(mu) at mu = -1 and +1 (``unknowns.py``). Cusps are
points on a curve of folds where both parameters turn back together. A curve of grazes meets curves
of flips and folds where the middle coefficient of det J(mu) vanishes. On a curve of flips the
cubic coefficient (``normal_form.py``) changes its sign where they are degenerate.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from vibroimpact.orbits import calls
from vibroimpact.orbits.continuation import ENDS, GRAZES, MOST_POINTS, continue_branch, ending
from vibroimpact.orbits.family import ArclengthStep, OrbitFamily
from vibroimpact.orbits.hidden_roots import may_have_more_roots
from vibroimpact.orbits.normal_form import cubic_coefficient
from vibroimpact.orbits.orbit import PeriodicOrbit, repeats_freely
from vibroimpact.orbits.singular_ends import doubling, flip_that_touches, half_of, singular_end
from vibroimpact.orbits.unknowns import ROUNDING, differences_of_halves

#: Greatest difference of the halves of an orbit at which the test of a fold, divided by the square
#: of it, may be rounding.
_ALIKE = 1e-4
#: A curve that begins nearer to an end than this, in scaled unknowns, is begun again in the middle
#: of its other side, if that has more points than this.
_BESIDE, _FEW = 0.3, 8
#: Points of a path that are closer than this, in scaled unknowns, may be in a wrong order.
_SAME_POINT = 1e-7
#: A step of a curve of flips that is shorter, in scaled unknowns, has at most one degenerate flip;
#: and how far along the tangent a coefficient is compared for its slope.
_ONE_FLIP, _BEYOND = 1e-4, 1e-4
#: A curve ends at this share of its ranges from where its equations are singular, or nearer.
_SAME_END = 1e-6


class SpecialPoint(NamedTuple):
    """A special point of a branch or a curve.

    Attributes
    ----------
    kind : str
        On a branch ``flip`` or ``fold``. On a curve of folds ``cusp``; on a curve of flips
        ``degenerate``, where they change their criticality and a curve of folds of the orbits of
        twice the period ends; on a curve of grazes ``flip`` and ``fold``, where curves of these
        kinds meet it. The end of a curve of folds is a
        ``flip`` where the orbit of half the period has a degenerate one. The other ends are
        ``graze``: an impact has speed zero (on a curve another impact, to 1e-5 of the natural
        unit), or a flight touches the stop; ``penetration``: a flight crosses the stop, and no
        touch is found; ``rest``: the mass cannot leave the stop; ``edge`` of a range, also where
        the speeds of a curve become infinite there; and ``lost``: Newton's method fails, the path
        is too long, or, with hardly any damping and loss, its speeds become infinite. Where the
        equations of a curve are singular, at a degenerate flip, where several impacts graze
        together or meet, and where the force vanishes, its end is right to 1e-6 of the ranges,
        or to 2e-4 with hardly any damping, as seen at h = 3e-6. At h = 0 and R = 1 a branch does
        not list a loss of symmetry in time, and folds of orbits that share one value are rounding.
    value : float, or ndarray of shape (2,)
        Value of the parameter, or of the two parameters of a curve.
    orbit : PeriodicOrbit
        At the graze of a branch it has the impact of speed zero. At the flip in which a branch or
        a curve of folds ends it is the orbit of half the period.
    """

    kind: str
    value: Any
    orbit: PeriodicOrbit


def lost_text(points: int, impacts: np.ndarray) -> str:
    """Return why a path of this many points is lost at an orbit with these speeds."""
    text = "Newton's method fails or takes too long"
    if points >= MOST_POINTS:
        text = f"not at its end after {MOST_POINTS:,} points"
    moving = impacts[impacts != 0.0]  # without that which grazes all along a curve
    if moving.size < 2:
        return text
    slowest, fastest = float(moving.min()), float(moving.max())
    return f"{text}; the slowest impact has {slowest / fastest:.0e} of the speed of the fastest"


def special_points(
    step: ArclengthStep, half: np.ndarray | None = None
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the kinds and the unknowns of the special points within a step, in order.

    These are the flips and folds of a branch, the cusps of a curve of folds, and on a curve of
    grazes the ``flip`` and ``fold`` where curves of these kinds meet it. If the orbit halves its
    period at `half`, they are those before it.
    """
    if step.family.kind == "":
        end = math.inf if half is None else step.share(half)
        roots = [(step.share(X), kind, X) for kind, X in _bifurcations(step)]
        for share, kind, X in sorted(roots, key=lambda item: item[0]):
            if share < end:
                yield kind, X
    elif step.family.kind == "graze":
        # Without damping the coefficient may be zero along the whole curve; its sign is then
        # rounding. It also vanishes where the curve crosses one of free vibrations that touch.
        family, ends = step.family, step.end_values(-2)
        meeting = step.root(partial(family.test, -2), *ends) if _changes(*ends) else None
        if meeting is not None and not (
            family.q == 1 and repeats_freely(calls.parameters(family.system, meeting), family.m)
        ):
            yield from (("flip", meeting), ("fold", meeting))
    elif step.family.kind == "fold":
        # At a degenerate flip the heading turns back, too, but Newton's method fails there.
        cusp = _cusp(step)
        if cusp is not None:
            yield "cusp", cusp


def _bifurcations(step: ArclengthStep) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the flip and the fold within a step of a branch."""
    family = step.family
    for test, kind in ((-2, "flip"), (-1, "fold")):
        a, b = step.end_values(test)
        if not _changes(a, b):
            continue
        X = step.root(partial(family.test, test), a, b)
        if X is None or (kind == "fold" and _is_twice_its_half(family, X)):
            continue
        # From a graze at an edge a branch may fold just beyond the edge.
        if (np.abs(family.values(X) - family.within(X)) < ENDS * family.spans).all():
            yield kind, X


def _changes(a: float, b: float) -> bool:
    """Whether a function with these values at the ends of a step changes its sign.

    Zero counts as positive, so a path in both directions from a root has it once.
    """
    return a * b <= 0.0 and (a < 0.0) != (b < 0.0) and max(abs(a), abs(b)) > ROUNDING


def _note_degenerate_flips(path: Path, points: Sequence[np.ndarray]) -> None:
    """Note the degenerate flips between points of a curve of flips, in order.

    A chord that may have two of them is halved, as in ``hidden_roots.py``.
    """
    if path.family.kind != "flip" or len(points) < 2:
        return
    family, X = path.family, np.array(points)
    ways = np.array([*map(family.tangent, X, np.gradient(X, axis=0))])
    both = cubic_coefficient(family.system, np.concatenate([X, X + _BEYOND * ways]))
    values, slopes = both[: len(X)], (both[len(X) :] - both[: len(X)]) / _BEYOND
    for i, length in enumerate(map(family.distance, X, X[1:])):
        (a, b), (first, second) = values[i : i + 2].tolist(), (length * slopes[i : i + 2]).tolist()
        more = may_have_more_roots.py_func(a, first, b, second) and length > _ONE_FLIP
        across = (X[i + 1] - X[i])[None, :]
        middle = family.corrected(0.5 * (X[i] + X[i + 1]), across) if more else None
        if middle is not None:
            _note_degenerate_flips(path, [X[i], middle, X[i + 1]])
        elif _changes(a, b):
            step = ArclengthStep.chord(family, X[i], X[i + 1])
            turn = step.root(partial(cubic_coefficient, family.system), a, b)
            # Where an impact is as slow as at the end of a curve, the sign is rounding.
            if turn is not None and family.slowest(turn) > GRAZES:
                path.note("degenerate", family.orbit(turn))


def _cusp(step: ArclengthStep) -> np.ndarray | None:
    """Return the cusp within a step on a curve of folds, or None."""
    family = step.family
    before, after = (family.heading(point.X, point.tangent) for point in (step.begin, step.end))
    if not family.inner(before, after) < 0.0:
        return None
    change, along = after - before, step.begin.tangent
    return step.root(
        lambda X: family.inner(family.heading(X, family.tangent(X, along)), change),
        family.inner(before, change),
        family.inner(after, change),
    )


def _is_twice_its_half(family: OrbitFamily, X: np.ndarray) -> bool:
    """Whether the halves of an orbit are so nearly equal that its test of a fold is rounding."""
    difference = differences_of_halves(X, family.m, family.q)
    return difference.size > 0 and bool(np.abs(difference).max() < _ALIKE)


def parents_flip(step: ArclengthStep) -> tuple[np.ndarray, PeriodicOrbit] | None:
    """Return where in a step a branch meets the flip of its parent, and the parent; or None."""
    family = step.family
    differences = [differences_of_halves(X, family.m, family.q) for X in (step.begin.X, step.end.X)]
    sizes = [float(np.abs(part).max(initial=0.0)) for part in differences]
    if family.kind or sizes[0] < ROUNDING:
        return None
    if not step.exchanges_halves() and sizes[1] ** 2 >= ROUNDING:
        return None
    chord = step.end.X - step.begin.X
    halves, X = half_of(family, step.begin.X + sizes[0] / sum(sizes) * chord)
    Y = halves.bifurcation(X, "flip")
    return None if Y is None else (doubling(halves, Y)[0], halves.orbit(Y, "flip"))


@dataclass
class Path:
    """The points of a path with their stability, and its special points."""

    family: OrbitFamily
    points: list[tuple[np.ndarray, bool]] = field(default_factory=list)
    special: list[SpecialPoint] = field(default_factory=list)
    closed: bool = False

    def add(self, X: np.ndarray, stable: bool) -> None:
        """Add a special point; it takes the place of another that is the same to rounding."""
        if self.points and self.family.distance(self.points[-1][0], X) < _SAME_POINT:
            self.points.pop()
        self.points.append((X, stable))

    def note(self, kind: str, orbit: PeriodicOrbit) -> None:
        """Note what is special at an orbit."""
        value = np.array([getattr(orbit.oscillator, name) for name in self.family.names])
        self.special.append(SpecialPoint(kind, value if self.family.kind else value.item(), orbit))


def both_ways(family: OrbitFamily, tangent: np.ndarray, retakes: int = 3) -> Path:
    """Continue a family along a tangent and, unless that path closes, also against it."""
    forward = one_way(family, family.start, tangent)
    if forward.closed:
        _note_degenerate_flips(forward, [X for X, _ in forward.points])
        return forward
    back = one_way(family, family.start, -tangent)
    for near, far, sign in ((forward, back, -1.0), (back, forward, 1.0)):
        if family.kind and retakes and near.special[-1].kind != "edge":
            beside = family.distance(family.start, near.points[-1][0]) < _BESIDE
            if beside and len(far.points) > _FEW:  # the end may be singular, and the start inexact
                (before, _), (family.start, _) = far.points[len(far.points) // 2 - 1 :][:2]
                along = family.tangent(family.start, sign * (family.start - before))
                return both_ways(family, along, retakes - 1)
    begin = (forward if back.points[0][0] is family.start else back).points[0]
    points = [*back.points[:0:-1], begin, *forward.points[1:]]
    first, *special, last = back.special[::-1] + forward.special
    _note_degenerate_flips(Path(family, special=special), [X for X, _ in points])
    if family.kind:  # as far as an end is known, what lies there is the end
        away = [
            [np.abs((point.value - end.value) / family.spans).max() for end in (first, last)]
            for point in special
        ]
        special = [point for point, off in zip(special, away, strict=True) if min(off) > _SAME_END]
    return Path(family, points, [first, *special, last])


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
            end = ending(step)
            lost = end[0] == "lost"
            beyond = singular_end(family, [X for X, _ in path.points], lost)
            if beyond is None and not lost and step.inadmissible is not None:
                path.points.pop()
            end = beyond or end
            if end[0] == "graze":
                end = flip_that_touches(family, end[1]) or end
            kind, X, orbit = end
            path.add(X, family.stable(family.point(X, tangent)))
            path.note(kind, orbit)
    return path


def _pass(path: Path, step: ArclengthStep) -> bool:
    """Add a step to a path, with what is special in it; return whether the path ends in it."""
    family, flip = path.family, parents_flip(step)
    end = None if flip is None else ("flip", *flip)
    if end is None:
        end = singular_end(family, [*(X for X, _ in path.points), step.end.X])
    roots = list(special_points(step, None if end is None else end[1]))
    for kind, X in roots:
        if not family.kind:  # the branch may change its stability there
            path.add(X, False)
        path.note(kind, family.orbit(X, kind))
    if end is not None:
        kind, X, orbit = end
        if roots:  # the stability from the last of them to the end
            before = path.points[-1][0]
            middle = family.corrected(0.5 * (before + X), (X - before)[None, :])
            if middle is not None:
                path.points.append((middle, family.stable(family.point(middle, X - before))))
        path.add(X, False)
        path.note(kind, orbit)
    else:
        path.points.append((step.end.X, family.stable(step.end)))
    return end is not None
