"""A path of orbits with its special points, located to rounding; singular ends, as limits.

The test functions of flip and fold are det J(mu) at mu = -1 and +1 (``unknowns.py``). Cusps are
points on a curve of folds where both parameters turn back together. A curve of grazes meets curves
of flips and folds where the middle coefficient of det J(mu) vanishes.

A branch of orbits of twice the period ends at a flip of the half, where its halves change places.
A curve of folds of such orbits ends where this flip is degenerate (Kuznetsov, *Elements of Applied
Bifurcation Theory*, sec. 9.3). Its equations are singular there, and so are those of a curve on
which all impacts lose their speed at once: it ends in an orbit that touches the stop without speed,
as without damping where omega is a fraction of p.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from vibroimpact.orbits import calls
from vibroimpact.orbits.continuation import continue_branch, ending, is_orbit
from vibroimpact.orbits.family import NEARBY_DISTANCE, ArclengthStep, OrbitFamily
from vibroimpact.orbits.hidden_roots import HEADING
from vibroimpact.orbits.orbit import PeriodicOrbit
from vibroimpact.orbits.unknowns import ROUNDING, free, impact_rows, speeds, unknowns

#: Greatest difference of the halves of an orbit at which the test of a fold, divided by the square
#: of it, may be rounding.
_ALIKE = 1e-4
#: A bifurcation at an end of a step may lie beyond it by this share of the step, by rounding.
_AT_END = 1e-6
#: A curve of folds ends where the mean square difference of its halves is below this, and a curve
#: on which Newton's method fails where it is below the second, or all impacts are slower than that.
_MEETS, _MAY_MEET = 4e-4, 0.1
#: Its end is where it leads from at most so many of its last points, at which this difference or
#: speed is at least so many times that of the next one. It is known if with one point less it is
#: the same to this share of the ranges.
_POINTS, _APART, _PRECISE = 5, 1.5, 1e-8
#: Points of a path that are closer than this, in scaled unknowns, may be in a wrong order.
_SAME_POINT = 1e-7
#: A curve ends at this share of its ranges from where its equations are singular, or nearer.
_SAME_END = 1e-6


class SpecialPoint(NamedTuple):
    """A special point of a branch or a curve.

    Attributes
    ----------
    kind : str
        On a branch ``flip`` or ``fold``. On a curve of folds ``cusp``; on a curve of grazes
        ``flip`` and ``fold``, where curves of these kinds meet it. The end of a curve of folds is a
        ``flip`` where the orbit of half the period has a degenerate one. The other ends are
        ``graze``: an impact has speed zero (on a curve another impact, to 1e-5 of the natural
        unit), or a flight touches the stop; ``penetration``: a flight crosses the stop, and no
        touch is found; ``rest``: the mass cannot leave the stop; ``edge`` of a range; and ``lost``:
        Newton's method fails or the path is too long. Where the equations of a curve are singular,
        at a degenerate flip, where several impacts graze together, and at a rest, its end is right
        to 1e-6 of the ranges.
    value : float, or ndarray of shape (2,)
        Value of the parameter, or of the two parameters of a curve.
    orbit : PeriodicOrbit
        At the graze of a branch it has the impact of speed zero. At the flip in which a branch or
        a curve of folds ends it is the orbit of half the period.
    """

    kind: str
    value: Any
    orbit: PeriodicOrbit


def special_points(
    step: ArclengthStep, half: np.ndarray | None = None
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the kinds and the unknowns of the special points within a step, in order.

    These are the flips and folds of a branch, the cusps of a curve of folds, and on a curve of
    grazes the ``flip`` and ``fold`` where curves of these kinds meet it. If the orbit halves its
    period at `half`, they are those before it.
    """
    if step.family.kind == "":
        end = math.inf if half is None else step.place(half)
        located = [(step.place(X), kind, X) for kind, X in _bifurcations(step, end)]
        for place, kind, X in sorted(located, key=lambda item: item[0]):
            if place < end:
                yield kind, X
    elif step.family.kind == "graze":
        # Without damping the coefficient may be zero along the whole curve; its sign is then
        # rounding.
        crosses = _crossing(step, -2) is not None
        meeting = step.root(partial(step.family.test, -2)) if crosses else None
        if meeting is not None:
            yield from (("flip", meeting), ("fold", meeting))
    elif step.family.kind == "fold":
        # At a degenerate flip the heading turns back, too, but Newton's method fails there.
        # A curve may touch the edge of a range in a step as short as rounding.
        cusp = _cusp(step)
        if cusp is not None and step.family.inadmissible(cusp)[0] is None:
            yield "cusp", cusp


def _bifurcations(step: ArclengthStep, end: float) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the flip and the fold within a step of a branch that ends at a place of it."""
    family = step.family
    for test, kind in ((-2, "flip"), (-1, "fold")):
        share = _crossing(step, test)
        if share is None:
            continue
        X = family.bifurcation(step.between(share), kind)
        # Newton's method may also find the bifurcation of a step beside this one.
        if X is None or not -_AT_END <= step.place(X) <= min(1.0 + _AT_END, end):
            X = step.root(partial(family.test, test))
        if X is not None and not (kind == "fold" and _is_twice_its_half(family, X)):
            yield kind, X


def _crossing(step: ArclengthStep, test: int) -> float | None:
    """Return about where within a step a test function changes its sign; None if it does not."""
    a, b = (float(point.tests[0, test]) for point in (step.begin, step.end))
    # Zero counts as positive, so a path in both directions from a root has it once.
    changes = a * b <= 0.0 and (a < 0.0) != (b < 0.0) and max(abs(a), abs(b)) > ROUNDING
    return a / (a - b) if changes else None


def _cusp(step: ArclengthStep) -> np.ndarray | None:
    """Return the cusp within a step on a curve of folds, or None."""
    family = step.family
    before, after = (_heading(step, point.X) for point in (step.begin, step.end))
    # The slopes of the condition vanish with this, but their rounding does not.
    apart = min(1.0, calls.halves_apart(family.system, step.end.X))
    fastest = max(float(np.abs(free(heading, family.q)).max()) for heading in (before, after))
    seen = fastest * apart > HEADING
    if not (family.inner(before, after) < 0.0 and seen):
        return None
    change = after - before
    return step.root(lambda X: family.inner(_heading(step, X), change))


def _heading(step: ArclengthStep, X: np.ndarray) -> np.ndarray:
    """Return the tangent of a curve of folds without its part along the null vector of the fold.

    It vanishes only with the velocity of the parameters. Where they turn smoothly, it turns little.
    """
    family = step.family
    null = np.append(calls.null_vector(family.system, X, 1.0), np.zeros(2))
    tangent = family.tangent(X, step.begin.tangent)
    return tangent - family.inner(tangent, null) / family.inner(null, null) * null


def _is_twice_its_half(family: OrbitFamily, X: np.ndarray) -> bool:
    """Whether the halves of an orbit are so nearly equal that its test of a fold is rounding."""
    if family.m % 2 or family.q % 2:
        return False
    return float(np.abs(difference_of_halves(family, X)).max()) < _ALIKE


def parents_flip(step: ArclengthStep) -> tuple[np.ndarray, PeriodicOrbit] | None:
    """Return where in a step a branch meets the flip of its parent, of half its period; or None.

    The result is the point of the step and the parent.
    """
    family = step.family
    if family.kind or family.m % 2 or family.q % 2:
        return None
    differences = [difference_of_halves(family, X) for X in (step.begin.X, step.end.X)]
    sizes = [float(np.abs(part).max()) for part in differences]
    if sizes[0] < ROUNDING:
        return None
    if np.sum(differences[0] * differences[1]) >= 0.0 and sizes[1] ** 2 >= ROUNDING:
        return None
    halves, X = _half(family, step.between(sizes[0] / sum(sizes)))
    Y = halves.bifurcation(X, "flip")
    if Y is None or not is_orbit(halves, halves.point(Y, np.zeros(Y.size))):
        return None
    return doubling(halves, Y)[0], halves.orbit(Y)


def degenerate_flip(
    family: OrbitFamily, points: Sequence[np.ndarray], lost: bool
) -> tuple[str, np.ndarray, PeriodicOrbit] | None:
    """Return how a curve of folds ends beyond some points, where, and the orbit; None if not near.

    It ends in a ``flip`` of the half, or at an ``edge`` just before it if it is `lost` there. The
    mean of the halves is a smooth function of the square of their difference.
    """
    if family.kind != "fold" or family.m % 2 or family.q % 2:
        return None
    squares = np.array([calls.halves_apart(family.system, X) for X in points])
    if not squares[-1] < (_MAY_MEET if lost else _MEETS):
        return None
    means = np.array([mean_of_halves(family, X) for X in points])
    halves, _ = _half(family, points[-1], "flip")
    guess, error = _where_zero(squares, means)
    if not error < (NEARBY_DISTANCE if lost else _PRECISE):
        return None
    Y = halves.corrected(guess, halves.tangent(guess)[None, :])
    if Y is None or not halves.distance(Y, guess) < NEARBY_DISTANCE:
        return None
    if not lost and not speeds(Y, halves.q).max() > NEARBY_DISTANCE:  # it may stand still
        return None
    reason, _ = halves.inadmissible(Y)
    if reason is None:
        return "flip", doubling(halves, Y)[0], halves.orbit(Y)
    if not (lost and reason.kind == "edge"):
        return None
    chord = doubling(halves, Y)[0] - points[-1]
    inside, edge = free(points[-1], family.q)[reason.at], reason.where / family.spans[reason.at]
    X, axis = points[-1] + (edge - inside) / free(chord, family.q)[reason.at] * chord, 0.0 * chord
    free(X, family.q)[reason.at], free(axis, family.q)[reason.at] = edge, 1.0
    X = family.corrected(X, np.array([axis, chord]))
    return None if X is None else ("edge", X, family.orbit(X))


def standstill(
    family: OrbitFamily, points: Sequence[np.ndarray]
) -> tuple[str, np.ndarray, PeriodicOrbit] | None:
    """Return the ``graze`` in which all impacts of a lost curve lose their speed, as above."""
    if family.kind not in ("flip", "fold") or family.q == 1:
        return None
    fastest = np.array([speeds(X, family.q).max() for X in points])
    X, error = _where_zero(fastest, np.array(points))
    if not fastest[-1] < _MAY_MEET or not error < NEARBY_DISTANCE:
        return None
    speeds(X, family.q)[:] = 0.0
    missed = float(np.abs(calls.linearised(family.system, X)[0]).max())
    if not missed < NEARBY_DISTANCE or family.inadmissible(X)[0] is not None:
        return None
    return "graze", X, family.orbit(X)


def _where_zero(places: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the limit at the place 0 of values, shape (n, k), at decreasing places, and its error.

    It is that of the polynomial through some of the last values that changes least by one value
    more. The nearest values are less accurate.
    """
    kept = [len(places) - 1]
    for i in range(len(places) - 2, -1, -1):
        if _APART * places[kept[-1]] <= places[i] < _MAY_MEET:
            kept.append(i)
    best, least = values[-1], math.inf
    for first in range(len(kept)):
        before = None
        for last in range(first + 1, min(first + _POINTS, len(kept)) + 1):
            at = places[kept[first:last]]
            weights = np.prod(at / (at - at[:, None] + np.diag(at)), axis=1)
            limit = weights @ values[kept[first:last]]
            if before is not None and np.abs(limit - before).max() < least:
                best, least = limit, float(np.abs(limit - before).max())
            before = limit
    return best, least


def _half(
    family: OrbitFamily, X: np.ndarray, kind: str = "", graze: int = 0
) -> tuple[OrbitFamily, np.ndarray]:
    """Return the family of orbits of half the period, and the mean of the halves of a point."""
    mean = mean_of_halves(family, X)
    return family.related(impact_rows(mean, family.q // 2), family.m // 2, kind, graze), mean


def difference_of_halves(family: OrbitFamily, X: np.ndarray) -> np.ndarray:
    """Return the difference of the second half of an orbit from the first, shape (q / 2, 2)."""
    z, q = impact_rows(X, family.q), family.q // 2
    return z[q:] - z[:q] - np.array([math.pi * family.m, 0.0])


def mean_of_halves(family: OrbitFamily, X: np.ndarray) -> np.ndarray:
    """Return the mean of the halves of an orbit as a point of the orbits of half the period."""
    first = impact_rows(X, family.q)[: family.q // 2]
    return unknowns(first + 0.5 * difference_of_halves(family, X), free(X, family.q))


def doubling(family: OrbitFamily, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a flip X as a point of the orbits of twice the period, and their direction there."""
    q, z = family.q, impact_rows(X, family.q)
    vector = impact_rows(calls.null_vector(family.system, X, -1.0), q)
    vector /= math.sqrt(np.sum(vector**2) / q)
    second = z + np.array([2.0 * math.pi * family.m, 0.0])
    doubled = unknowns(np.concatenate([z, second]), free(X, q))
    along = unknowns(np.concatenate([vector, -vector]), np.zeros(len(family.parameters)))
    return doubled, along


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

    def drop_near(self, X: np.ndarray) -> None:
        """Drop the last special points that are at a point, as far as an end is known."""
        family = self.family
        while self.special:
            off = (self.special[-1].value - family.kept(X)) / family.spans
            if not np.abs(off).max() < _SAME_END:
                return
            self.special.pop()

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
            end = ending(step)
            if end[0] == "lost":
                points = [X for X, _ in path.points]
                end = standstill(family, points) or degenerate_flip(family, points, True) or end
            else:
                path.points.pop()
            kind, X, orbit = end
            if family.kind == kind == "graze":  # the test of a meeting is rounding at this end
                path.drop_near(X)
            # At an impact of speed zero the multipliers are infinite.
            moves = family.slowest(X) > 0.0
            path.add(X, moves and family.stable(family.point(X, tangent)))
            path.note(kind, orbit)
    return path


def _pass(path: Path, step: ArclengthStep) -> bool:
    """Add a step to a path, with what is special in it; return whether the path ends in it."""
    family, flip = path.family, parents_flip(step)
    end = None if flip is None else ("flip", *flip)
    if end is None and family.kind == "fold":
        end = degenerate_flip(family, [*(X for X, _ in path.points), step.end.X], False)
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
