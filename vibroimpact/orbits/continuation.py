"""Pseudo-arclength continuation of orbits: one walk for branches and for curves of bifurcations.

A step goes along the tangent and is corrected in the plane across it (Keller 1977), so folds are
passed like any other point. The step is shortened where Newton's method fails or the tangent turns
too far, and where the orbit stops being one: the walk ends there, at the last orbit, to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np

from vibroimpact.orbits import newton
from vibroimpact.orbits.elimination import characteristic
from vibroimpact.orbits.flights import first_pass, values_of
from vibroimpact.orbits.orbit import PeriodicOrbit, determinant, orbit_of, unit_of_speed
from vibroimpact.oscillator import Oscillator

_NAMES = [field.name for field in fields(Oscillator)]
#: Steps of a walk, in units of the scaled unknowns: the first, the longest, and one so short that
#: the walk is given up.
_FIRST, _LONGEST, _SHORTEST = 5e-3, 0.08, 1e-9
#: Points of a walk at the most; the turn of the tangent in one step (its cosine); iterations.
MOST_POINTS, _LEAST_COSINE, _MOST_ITERATIONS = 600, 0.985, 8
#: Halvings to the last orbit of a walk.
_HALVINGS = 52
#: A speed below this, in units of the largest, counts as zero: a graze.
_ZERO_SPEED = 1e-12


@dataclass(frozen=True)
class Axis:
    """A free parameter and its range."""

    name: str
    low: float
    high: float

    @classmethod
    def of(cls, osc: Oscillator, name: str, low: float, high: float) -> Axis:
        """Check a range.

        Raises
        ------
        TypeError, ValueError
            If there is no such parameter, an end is not valid, or `low` is not below `high`.
        """
        if name not in _NAMES:
            raise ValueError(f"parameter must be one of {', '.join(_NAMES)}, not {name!r}")
        for value in (low, high):
            replace(osc, **{name: value})
        if not low < high:
            raise ValueError(f"the range of {name} must increase, not {low!r} to {high!r}")
        return cls(name, float(low), float(high))

    @property
    def span(self) -> float:
        """Its length."""
        return self.high - self.low

    @property
    def slack(self) -> float:
        """Rounding of its values."""
        return 1e-14 * max(abs(self.low), abs(self.high))


@dataclass(frozen=True)
class Objection:
    """Why a point of a walk is no orbit.

    Attributes
    ----------
    kind : str
        ``edge``, ``speed`` (an impact has left the stop), ``pass`` (a flight meets the stop before
        its end), ``rest`` (the mass cannot leave the stop).
    at : int
        Number of the axis, the impact or the flight.
    where : float
        The edge's value; the phase where a flight meets the stop.
    """

    kind: str
    at: int
    where: float = math.nan


class Orbits:
    """The orbits of m forcing periods and q impacts over one or two free parameters.

    A point is a vector X of phases and scaled speeds in turn, then of parameters over their spans.

    Parameters
    ----------
    orbit : PeriodicOrbit
        One of them, with q >= 1; gives the other parameters and the unit of speed.
    axes : sequence of Axis
    condition, index : int
        The bifurcation of a curve (``newton.py``); `index` is the impact that grazes.
    speed : float, optional
        The unit of speed, by default that of the orbit.
    """

    def __init__(
        self,
        orbit: PeriodicOrbit,
        axes: Sequence[Axis],
        condition: int = 0,
        index: int = 0,
        speed: float | None = None,
    ) -> None:
        self.osc, self.m, self.q, self.axes = orbit.oscillator, orbit.m, orbit.q, tuple(axes)
        self.speed = unit_of_speed(self.osc, orbit.speeds) if speed is None else speed
        free = np.array([_NAMES.index(axis.name) for axis in axes])
        self.spans = np.array([axis.span for axis in axes])
        self.system = newton.System(
            values_of(self.osc), free, self.spans, self.m, self.q, self.speed, condition, index
        )
        at = [getattr(self.osc, axis.name) / axis.span for axis in axes]
        z = np.column_stack([orbit.phases, orbit.speeds / self.speed])
        self.start = np.concatenate([z.ravel(), at])

    def values(self, X: np.ndarray) -> np.ndarray:
        """Return the free parameters at a point."""
        return X[2 * self.q :] * self.spans

    def kept(self, X: np.ndarray) -> np.ndarray:
        """Return the free parameters at points; an edge that rounding misses is met."""
        values = X[..., 2 * self.q :] * self.spans
        for j, axis in enumerate(self.axes):
            for edge in (axis.low, axis.high):
                values[..., j][np.abs(values[..., j] - edge) <= axis.slack] = edge
        return values

    def oscillator(self, X: np.ndarray) -> Oscillator:
        """Return the oscillator at a point, its parameters kept to their ranges."""
        names = [axis.name for axis in self.axes]
        return replace(self.osc, **dict(zip(names, self.kept(X).tolist(), strict=True)))

    def impacts(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return phases and speeds at points; a speed below 0, by rounding, is 0."""
        z = X[..., : 2 * self.q]
        return z[..., ::2], np.maximum(z[..., 1::2], 0.0) * self.speed

    def orbit(self, X: np.ndarray) -> PeriodicOrbit:
        """Return the orbit at a point; a speed that is zero to rounding is zero."""
        phases, speeds = self.impacts(X)
        speeds = np.where(speeds < _ZERO_SPEED * self.speed, 0.0, speeds)
        return orbit_of(self.oscillator(X), self.m, phases, speeds)

    def corrected(
        self, X: np.ndarray, planes: np.ndarray, condition: int | None = None, index: int = 0
    ) -> np.ndarray | None:
        """Return the point of the branch or curve in planes through X; None if none is found."""
        system = self.system
        if condition is not None:
            system = system._replace(condition=condition, graze=index)
        X = X.copy()
        if newton.correct(system, X, planes, _MOST_ITERATIONS) < 0:
            return None
        if system.condition == newton.GRAZE and len(planes) < len(self.axes):
            X[2 * system.graze + 1] = 0.0  # it is, to rounding
        return X

    def at(self, X: np.ndarray, value: float, axis: int = 0) -> np.ndarray | None:
        """Return the point near X at a value of an axis; None if none is found."""
        X, plane, at = X.copy(), np.zeros((1, X.size)), 2 * self.q + axis
        X[at], plane[0, at] = value / self.spans[axis], 1.0
        return self.corrected(X, plane)

    def tangent(self, X: np.ndarray) -> np.ndarray:
        """Return the direction of the branch or curve."""
        return newton.tangent(self.system, X)

    def inner(self, X: np.ndarray, Y: np.ndarray) -> float:
        """Return the inner product of the walk."""
        return float(newton.inner(X, Y, self.q))

    def polynomial(self, X: np.ndarray) -> tuple[float, float, float]:
        """Return c0, c1, c2, zero at the multipliers (``elimination.py``)."""
        return characteristic(*self.derivatives(X))

    def derivatives(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return A and B of the flights (``flights.residuals``)."""
        _, A, B = newton.linearised(self.system, X)
        return A, B

    def stable(self, X: np.ndarray, polynomial: tuple[float, float, float]) -> bool:
        """Whether both multipliers are inside the unit circle (Jury)."""
        _, c1, c2 = polynomial
        h, R, omega, *_ = newton.parameters_at(self.system, X)
        det = determinant(h, R, omega, self.m, self.q)
        return det < 1.0 and abs(c1) < (1.0 + det) * abs(c2)

    def objection(self, X: np.ndarray) -> Objection | None:
        """Say why a point is no orbit within the ranges; None if it is one."""
        for j, (axis, value) in enumerate(zip(self.axes, self.values(X).tolist(), strict=True)):
            if not axis.low - axis.slack <= value <= axis.high + axis.slack:
                return Objection("edge", j, axis.low if value < axis.low else axis.high)
        speeds = X[1 : 2 * self.q : 2]
        slowest = int(np.argmin(speeds))
        if speeds[slowest] < 0.0:
            return Objection("speed", slowest)
        flight, phase = first_pass(
            newton.parameters_at(self.system, X), self.m, self.speed, X, self.q
        )
        if flight < 0:
            return None
        kind = "rest" if phase == X[2 * flight] else "pass"
        return Objection(kind, int(flight), float(phase))


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
    """What was collected on a walk: its points, its special points, and whether it is closed."""

    points: list[Any]
    special: list[Any]
    closed: bool


def both_directions(walked: Callable[[np.ndarray], Track], tangent: np.ndarray) -> Track:
    """Walk along a tangent and, unless that comes back, against it; in the order along it."""
    forward = walked(tangent)
    if forward.closed:
        return forward
    backward = walked(-tangent)
    points = backward.points[::-1] + forward.points[1:]
    return Track(points, backward.special[::-1] + forward.special, closed=False)


@dataclass(frozen=True)
class End:
    """The last point of a walk, and what objects to going on; None where it is closed or lost."""

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
        All of whose points are orbits.
    End
        The last.
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
    low, high, last, Y = 0.0, segment.length, segment.X, segment.Y
    for _ in range(_HALVINGS):
        if objection.kind == "edge":
            edge = _edge(segment, objection, last, Y)
            if edge is not None:
                return edge, objection
        middle = 0.5 * (low + high)
        X = segment.at(middle)
        if X is None or middle in (low, high):
            break
        beyond = segment.orbits.objection(X)
        if beyond is None:
            low, last = middle, X
        else:
            high, objection, Y = middle, beyond, X
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
