"""Takes pseudo-arclength steps along a path, shortens them; finds its end, as at a graze.

A step goes along the tangent and is corrected in the plane normal to it (Keller 1977), so folds are
passed like any other point. The step is shortened if Newton's method fails, if the tangent turns
too far or changes its orientation, or if the step may miss something. The path ends, to rounding,
at the last point that is an orbit.

Each reason why the next point is none has a margin, which is zero where it begins, and the last
orbit is where it is zero. At a graze the speed of an impact is zero, or a flight between two
impacts touches the stop. Both count as an impact of speed zero, so one condition finds them. Curves
of flips and folds end wherever their orbit grazes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from vibroimpact.orbits import calls
from vibroimpact.orbits.family import (
    NEARBY_DISTANCE,
    ArclengthStep,
    Inadmissible,
    OrbitFamily,
    Point,
)
from vibroimpact.orbits.orbit import PeriodicOrbit
from vibroimpact.orbits.unknowns import ROUNDING, free, impact_rows, phases, speeds, unknowns

#: How a path ends: the kind, the last point, and the orbit there.
End: TypeAlias = tuple[str, np.ndarray, PeriodicOrbit]
#: Lengths of steps in scaled unknowns: the first, the longest, and one below which the path is
#: given up.
_FIRST, _LONGEST, _SHORTEST = 5e-3, 0.08, 1e-9
#: A step shorter than this misses nothing but rounding.
_FINE_STEP = 1e-6
#: The orientation of the tangents changes where two paths cross, and in a jump to a path beside
#: this one. It changes in no step that is longer than this, unless the step goes beyond the last
#: orbit or the halves of its orbit change places.
_TURNED_OVER = 1e-4
#: Most points of a path; least cosine of the angle by which the tangent turns in one step.
MOST_POINTS, _LEAST_COSINE = 2000, 0.985
#: Where orbits vanish with the force, a force below this share of its range counts as zero: the
#: equations of the orbits are singular there.
_VANISHES = 1e-9
#: At the end of a path, an impact slower than this grazes; so does a flight that turns as near
#: to the stop. The value is not smaller because Newton's method fails at 1e-6 where all impacts of
#: a long orbit graze at once.
GRAZES = 1e-5
#: A path ends where the margin of an inadmissible point is below this. If it is not, the last orbit
#: is sought with a shorter step.
ENDS = 1e-9
#: Most bisections to find the last orbit of a path; a margin below the second is zero to rounding.
_MOST_TRIALS, _ZERO_MARGIN = 80, 1e-15
#: Where Newton's method fails this near to the last orbit of a curve or to an edge, its equations
#: are singular.
_SINGULAR = 1e-8
#: Most iterations at the end of a path, where each may only halve the error.
_MOST_AT_END = 60


def continue_branch(family: OrbitFamily, start: Point) -> Iterator[ArclengthStep]:
    """Yield the steps of a path from a point along its tangent; only the last may have length 0."""
    point, length, orientation = start, _FIRST, 0.0  # a branch may start where paths cross
    if family.kind:
        along = family.inner(family.tangent(start.X), start.tangent)
        orientation = math.copysign(1.0, along)
    for number in range(MOST_POINTS):
        step, orientation = _step(family, point, length, orientation)
        if number > 3 and not step.last and _returns(step, start):
            step = replace(step, end=start, last=True, closed=True)
        yield step
        if step.last:
            return
        point = step.end
        fastest = max(1.0, float(np.abs(speeds(point.X, family.q)).max()))
        length = min(1.5 * step.length, _LONGEST * fastest)
    yield ArclengthStep(family, point, point, 0.0, last=True)


def _step(
    family: OrbitFamily, begin: Point, length: float, orientation: float
) -> tuple[ArclengthStep, float]:
    """Return the longest step, of at most `length`, that turns little and misses nothing.

    If the orbits end within it, it is the last step and goes to the last orbit. The
    `orientation` is 1 or -1, as the path goes along the oriented tangents or against them, 0 if not
    yet known; it is also returned for the end.
    """
    while length > _SHORTEST:
        trial = _trial(family, begin, length, orientation)
        if trial is not None:
            step, _ = trial
            ends = not step.last or step.margin < ENDS
            if length < _FINE_STEP or (ends and not step.may_miss()):
                return trial
            length *= 1.0 if ends else 0.5  # the equations may be singular at the end
        length *= 0.5
    margin = family.slowest(begin.X)
    if family.kind:  # on a branch, a flight that touches the stop becomes inadmissible first
        margin = min(margin, -begin.maximum)
    return ArclengthStep(family, begin, begin, 0.0, last=True, margin=margin), orientation


def _trial(
    family: OrbitFamily, begin: Point, length: float, orientation: float
) -> tuple[ArclengthStep, float] | None:
    """Return a step of a length, at most to the last orbit; None if it fails, turns far or jumps.

    `orientation` and the other result are as of `_step`.
    """
    X, along = begin.X, begin.tangent
    Y = family.corrected(X + length * along, along[None, :])
    if Y is None or not family.inner(Y - X, Y - X) < 4.0 * length * length:
        return None
    tangent = family.tangent(Y)
    cosine = family.inner(tangent, along)
    if not abs(cosine) > _LEAST_COSINE:
        return None
    orientation_at_end = math.copysign(1.0, cosine)
    step = ArclengthStep(family, begin, family.point(Y, orientation_at_end * tangent), length)
    reason = step.end.inadmissible
    turned_over = length > _TURNED_OVER and orientation_at_end == -orientation and reason is None
    if turned_over and not step.exchanges_halves():
        return None
    if reason is not None:
        step = to_last_orbit(step, reason)
    if length > _FINE_STEP and step.jumps():
        return None
    return step, orientation_at_end


def _returns(step: ArclengthStep, start: Point) -> bool:
    """Whether a step passes the point where the path began."""
    family, share, along = step.family, step.share(start.X), step.begin.tangent
    if not 0.0 <= share <= 1.0:
        return False
    Y = family.corrected(step.begin.X + share * step.length * along, along[None, :])
    return Y is not None and family.distance(Y, start.X) < _FINE_STEP


def margin(family: OrbitFamily, point: Point, reason: Inadmissible) -> float:
    """Return a number that is 0 where a reason begins, negative beyond; NaN if unknown."""
    if reason.kind == "speed":
        return float(speeds(point.X, family.q)[reason.at])
    if reason.kind == "edge":
        parameter = family.parameters[reason.at]
        inside = (reason.where - float(family.free_values(point.X)[reason.at])) / parameter.span
        return inside if reason.where == parameter.high else -inside
    is_local = math.isfinite(point.maximum) and (point.maximum > 0.0) == (
        point.inadmissible is not None
    )
    return -point.maximum if reason.kind == "penetration" and is_local else math.nan


def to_last_orbit(step: ArclengthStep, reason: Inadmissible) -> ArclengthStep:
    """Return the part of a step up to its last point that is an orbit."""
    family = step.family
    X, reason = _last_orbit(step, reason)
    end = family.point(X, family.tangent(X, step.begin.tangent))
    end.tests[0, np.abs(end.tests[0]) < ROUNDING] = math.nan  # a zero there is not within the step
    length = step.share(X) * step.length
    return ArclengthStep(
        family, step.begin, end, length,
        last=True, inadmissible=reason, margin=margin(family, end, reason),
    )  # fmt: skip


def _last_orbit(step: ArclengthStep, reason: Inadmissible) -> tuple[np.ndarray, Inadmissible]:
    """Return the last point of a step that is an orbit, by bisection, and why the next is none."""
    family, along, last, beyond = step.family, step.begin.tangent, step.begin, step.end
    low, high, far = 0.0, step.length, step.length
    for _ in range(_MOST_TRIALS):
        if reason.kind == "edge":
            edge = _edge(step, reason, last.X, beyond.X)
            if edge is not None:
                return edge, reason
        middle = 0.5 * (low + high)
        if middle in (low, high) or 0.0 <= margin(family, last, reason) < _ZERO_MARGIN:
            break
        guess = last.X + (middle - low) / (far - low) * (beyond.X - last.X)
        X = family.corrected(guess, along[None, :], most=_MOST_AT_END)
        if X is None:  # for example near a point of codimension two, where the orbits end
            high = middle
            if family.kind and high - low < _SINGULAR:
                break
            continue
        point = family.point(X, along)
        if point.inadmissible is None:
            low, last = middle, point
        else:
            high, far, beyond, reason = middle, middle, point, point.inadmissible
    return last.X, reason


def _edge(
    step: ArclengthStep, reason: Inadmissible, X: np.ndarray, Y: np.ndarray
) -> np.ndarray | None:
    """Return the orbit at the edge between X and a point Y beyond it; None if there is none."""
    family, axis = step.family, reason.at
    inside, beyond = family.values(X)[axis], family.values(Y)[axis]
    share = (reason.where - inside) / (beyond - inside)
    guess, plane = X + share * (Y - X), np.zeros((1, X.size))
    free(guess, family.q)[axis] = reason.where / family.spans[axis]
    free(plane, family.q)[0, axis] = 1.0
    edge = family.corrected(guess, plane)
    if edge is None:
        return None
    point = family.point(edge, step.begin.tangent)
    why = point.inadmissible
    return edge if why is None or margin(family, point, why) > -ROUNDING else None


def ending(step: ArclengthStep) -> End:
    """Return how a path that is not closed ends, its last point, and the orbit there.

    It ends at an ``edge``, in a ``graze``, in ``rest`` if the mass cannot leave the stop, as at
    R = 0, in ``penetration``, or is ``lost``. At the graze of a branch the orbit has the impact of
    speed zero.
    """
    family, X, reason = step.family, step.end.X, step.inadmissible
    limit = _without_force(family, X)
    if limit is not None:
        return "edge", limit, family.orbit(limit)
    if reason is None or reason.kind == "rest":
        if (X_edge := _exit(family, step.end)) is not None:  # as at R = 0, where impacts may meet
            return "edge", X_edge, family.orbit(X_edge)
    kind = "lost" if reason is None or reason.kind == "speed" else "penetration"
    if reason is not None:
        if reason.kind in ("edge", "rest"):
            X = _at_edges(step, reason) if reason.kind == "edge" else X
            return reason.kind, X, family.orbit(X)
        touch = _graze(step, reason) if family.kind == "" else None
        if touch is not None:
            return touch
    if kind == "lost" and cannot_leave(family, X):
        return "rest", X, family.orbit(X)
    if not step.margin < GRAZES:
        return kind, X, family.orbit(X)
    X = _without_speed(step) if family.kind == "" and kind == "lost" else X
    return "graze", X, family.orbit(X)


def _exit(family: OrbitFamily, point: Point) -> np.ndarray | None:
    """Return the point of an edge of a range at which a path is that goes on beyond it; or None."""
    X = onto_edges(family, point.X)
    rows = zip(family.parameters, family.free_values(X), free(point.tangent, family.q), strict=True)
    leaves = any(
        value == (axis.low if along < 0.0 else axis.high) and along != 0.0
        for axis, value, along in rows
    )
    return X if leaves else None


def cannot_leave(family: OrbitFamily, X: np.ndarray) -> bool:
    """Whether a short flight begins without acceleration, so that its two impacts meet."""
    pt, short = calls.parameters(family.system, X), family.flights(X) < NEARBY_DISTANCE
    pushed = -pt.f * np.sin(phases(X, family.q)) - pt.p * pt.p * pt.clearance
    return bool((short & (np.abs(pushed) < GRAZES)).any())


def _without_force(family: OrbitFamily, X: np.ndarray) -> np.ndarray | None:
    """Return the limit at which orbits vanish with the force; None if X is not near it.

    They vanish if the clearance is 0, since x and v are then proportional to the force.
    """
    X = X.copy()
    values = free(X, family.q)
    for j, axis in enumerate(family.parameters):
        vanishes = axis.name == "clearance" or (axis.name in ("f", "a") and axis.low == 0.0)
        if vanishes and abs(values[j]) < _VANISHES:
            values[j] = 0.0
    osc = family.oscillator(X)
    if not osc.clearance == osc.force == 0.0:
        return None
    speeds(X, family.q)[:] = 0.0
    return X


def _at_edges(step: ArclengthStep, reason: Inadmissible) -> np.ndarray:
    """Return the end of a path at an edge, extrapolated along its last step to the edge itself.

    The equations of folds may be singular there, as just before a degenerate flip.
    """
    family, X, begin = step.family, step.end.X, step.begin.X
    value, before = (float(family.free_values(Y)[reason.at]) for Y in (X, begin))
    if value == reason.where or value == before:
        return X
    return onto_edges(family, X + (reason.where - value) / (value - before) * (X - begin))


def onto_edges(family: OrbitFamily, X: np.ndarray, near: float = _SINGULAR) -> np.ndarray:
    """Return a point whose free parameters are at edges if they are this near, in their spans."""
    X = X.copy()
    values = free(X, family.q)
    for j, axis in enumerate(family.parameters):
        for edge in (axis.low, axis.high):
            if abs(values[j] - edge / axis.span) < near:
                values[j] = edge / axis.span
    return X


def _without_speed(step: ArclengthStep) -> np.ndarray:
    """Return the end of a branch, on which an impact is slow, extrapolated to speed zero.

    Newton's method fails there where any natural vibration closes the orbit, as at h = 0 and
    omega = n p. The tangent may have no digits there, but the chord of the last step has.
    """
    X, q = step.end.X, step.family.q
    slowest, chord = int(np.argmin(speeds(X, q))), X - step.begin.X
    speed, change = speeds(X, q)[slowest], speeds(chord, q)[slowest]
    if -speed * step.length / NEARBY_DISTANCE > change:  # it becomes slower
        X = X - speed / change * chord
        speeds(X, q)[slowest] = 0.0
    return X


def _graze(step: ArclengthStep, reason: Inadmissible) -> End | None:
    """Return the graze near the end of a branch, as `ending` does; None if there is none.

    Where Newton's method misses it, a flight touches the stop at its highest point.
    """
    family, X = step.family, step.end.X
    grazing, Y, index = family, X, reason.at
    if reason.kind == "penetration":
        grazing, Y = _with_touch(family, X, reason)
        index += 1
    Z = grazing.bifurcation(Y, "graze", index)
    if Z is None or not grazing.distance(Z, Y) < NEARBY_DISTANCE:
        touches = reason.kind == "penetration" and step.margin < GRAZES
        return ("graze", X, grazing.orbit(Y)) if touches else None
    last = Z
    if grazing is not family:  # without the touch
        z = np.delete(impact_rows(Z, grazing.q), index, axis=0)
        last = unknowns(z, free(Z, grazing.q))
    return "graze", last, grazing.orbit(Z)


def _with_touch(
    family: OrbitFamily, X: np.ndarray, reason: Inadmissible
) -> tuple[OrbitFamily, np.ndarray]:
    """Return the family and the point with one more impact, of speed zero.

    This impact is at the highest point of the flight that crosses the stop.
    """
    at, z = reason.at, impact_rows(X, family.q)
    turns = calls.turning_points(family.system, X, at)
    least = turns[:, 1].max() - ROUNDING
    phase = turns[np.argmax(turns[:, 1] > least), 0]  # of those as high, the first
    z = np.insert(z, at + 1, (phase, 0.0), axis=0)
    return family.related(z, family.m), unknowns(z, free(X, family.q))
