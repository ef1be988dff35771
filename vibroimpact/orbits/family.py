"""A family of orbits over free parameters, as the points that a continuation walks on.

A point is a vector X of phases and scaled speeds in turn, then of parameters over their spans
(``corrector.py``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np

from vibroimpact.orbits.corrector import (
    GRAZE,
    System,
    correct,
    inner,
    linearised,
    parameters_at,
    tangent,
)
from vibroimpact.orbits.detection import ROUNDING, test_functions
from vibroimpact.orbits.flights import first_pass, values_of
from vibroimpact.orbits.orbit import PeriodicOrbit, determinant, orbit_of, unit_of_speed
from vibroimpact.oscillator import Oscillator

_NAMES = [field.name for field in fields(Oscillator)]
#: Time steps of all evaluations of the flights, after which no further point is found.
MOST_WORK = 2**24
#: Iterations of the corrector.
_MOST_ITERATIONS = 8
#: A speed smaller than this, in the unit of speed, is zero to rounding: a graze.
_ZERO_SPEED = 1e-12
#: A force smaller than this share of its range is zero where orbits vanish with it: their
#: equations are singular there.
_VANISHES = 1e-9


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
        """Length of the range."""
        return self.high - self.low

    @property
    def slack(self) -> float:
        """Rounding error of a value in the range."""
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


class Point(NamedTuple):
    """A point of a walk: its unknowns, the walk's direction, and what is known of it.

    Attributes
    ----------
    X, tangent : ndarray, shape (2 q + k,)
    tests : ndarray, shape (2, n)
        The test functions and their slopes along the tangent (``detection.py``).
    turn : float
        How high a flight turns that comes near the stop (``flights.first_pass``).
    objection : Objection or None
        Why it is no orbit.
    """

    X: np.ndarray
    tangent: np.ndarray
    tests: np.ndarray
    turn: float
    objection: Objection | None


class Orbits:
    """The orbits of m forcing periods and q impacts over one or two free parameters.

    A point is a vector X of phases and scaled speeds in turn, then of parameters over their spans.

    Parameters
    ----------
    orbit : PeriodicOrbit
        One of these orbits, with q >= 1; gives the other parameters and the unit of speed.
    axes : sequence of Axis
    condition, index : int
        The bifurcation of a curve (``corrector.py``); `index` is the impact that grazes.
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
        self.system = System(
            values_of(self.osc), free, self.spans, self.m, self.q, self.speed, condition, index,
            np.zeros(1),
        )  # fmt: skip
        ends = [(axis.low - axis.slack, axis.high + axis.slack) for axis in axes]
        self.bounds = np.array(ends) / self.spans[:, None]
        at = [getattr(self.osc, axis.name) / axis.span for axis in axes]
        z = np.column_stack([orbit.phases, orbit.speeds / self.speed])
        self.start = np.concatenate([z.ravel(), at])

    def values(self, X: np.ndarray) -> np.ndarray:
        """Return the free parameters at a point."""
        return X[2 * self.q :] * self.spans

    def kept(self, X: np.ndarray) -> np.ndarray:
        """Return the free parameters at points.

        A value within rounding of an edge is set to that edge.
        """
        values = X[..., 2 * self.q :] * self.spans
        for j, axis in enumerate(self.axes):
            for edge in (axis.low, axis.high):
                values[..., j][np.abs(values[..., j] - edge) <= axis.slack] = edge
        return values

    def without_force(self, X: np.ndarray) -> np.ndarray | None:
        """Return the limit of orbits that vanish with the force; None if they do not beside X.

        They do where there is no clearance, as x and v are proportional to f.
        """
        for j, axis in enumerate(self.axes):
            if axis.name == "f" and axis.low == 0.0 and X[2 * self.q + j] < _VANISHES:
                if self.oscillator(X).clearance == 0.0:
                    X = X.copy()
                    X[1 : 2 * self.q : 2] = X[2 * self.q + j] = 0.0
                    return X
        return None

    def oscillator(self, X: np.ndarray) -> Oscillator:
        """Return the oscillator at a point, its parameters kept to their ranges."""
        names = [axis.name for axis in self.axes]
        return replace(self.osc, **dict(zip(names, self.kept(X).tolist(), strict=True)))

    def impacts(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return phases and speeds at points; a speed that is zero to rounding is zero."""
        phases, speeds = X[..., : 2 * self.q : 2], X[..., 1 : 2 * self.q : 2]
        return phases, np.where(np.abs(speeds) < _ZERO_SPEED, 0.0, speeds) * self.speed

    def orbit(self, X: np.ndarray) -> PeriodicOrbit:
        """Return the orbit at a point."""
        return orbit_of(self.oscillator(X), self.m, *self.impacts(X))

    def corrected(
        self,
        X: np.ndarray,
        planes: np.ndarray,
        condition: int | None = None,
        index: int = 0,
        most: int = _MOST_ITERATIONS,
    ) -> np.ndarray | None:
        """Return the point of the branch or curve in planes through X; None if none is found.

        None also once all points together have taken more than ``MOST_WORK`` time steps.
        """
        system = self.system
        if system.work[0] > MOST_WORK:
            return None
        if condition is not None:
            system = system._replace(condition=condition, graze=index)
        X = X.copy()
        if not correct(system, X, planes, most):
            return None
        if system.condition == GRAZE and len(planes) < len(self.axes):
            X[2 * system.graze + 1] = 0.0  # the speed is, to rounding
        return X

    def at(self, X: np.ndarray, value: float, axis: int = 0) -> np.ndarray | None:
        """Return the point near X at a value of an axis; None if none is found."""
        X, plane, at = X.copy(), np.zeros((1, X.size)), 2 * self.q + axis
        X[at], plane[0, at] = value / self.spans[axis], 1.0
        return self.corrected(X, plane)

    def tangent(self, X: np.ndarray) -> np.ndarray:
        """Return the direction of the branch or curve."""
        return tangent(self.system, X)

    def inner(self, X: np.ndarray, Y: np.ndarray) -> float:
        """Return the inner product of the walk."""
        return float(inner(X, Y, self.q))

    def derivatives(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return A and B of the flights (``flights.residuals``)."""
        _, A, B = linearised(self.system, X)
        return A, B

    def stable(self, point: Point) -> bool:
        """Whether both multipliers are inside the unit circle (Jury)."""
        h, R, omega, *_ = parameters_at(self.system, point.X)
        flip, fold = point.tests[0, -2:]
        return bool(flip * fold > 0.0) and determinant(h, R, omega, self.m, self.q) < 1.0

    def point(self, X: np.ndarray, tangent: np.ndarray) -> Point:
        """Return a point of a walk in the direction of a tangent."""
        tests = test_functions(self.system, X, tangent, self.bounds)
        objection, turn = self._objection(X)
        return Point(X, tangent, tests, turn, objection)

    def test(self, number: int, X: np.ndarray) -> float:
        """Return a test function."""
        return float(test_functions(self.system, X, np.zeros(X.size), self.bounds)[0, number])

    def margin(self, point: Point, objection: Objection) -> float:
        """Return what is zero where an objection begins, and negative beyond; NaN if unknown."""
        if objection.kind == "speed":
            return float(point.X[2 * objection.at + 1])
        if objection.kind == "edge":
            axis = self.axes[objection.at]
            inside = (objection.where - float(self.kept(point.X)[objection.at])) / axis.span
            return inside if objection.where == axis.high else -inside
        seen = math.isfinite(point.turn) and (point.turn > 0.0) == (point.objection is not None)
        return -point.turn if objection.kind == "pass" and seen else math.nan

    def allows(self, point: Point) -> bool:
        """Whether a point is an orbit, or only rounding objects."""
        return point.objection is None or self.margin(point, point.objection) > -ROUNDING

    def slowest(self, X: np.ndarray) -> float:
        """Return the slowest speed, on a curve of grazes that of the other impacts; inf if none."""
        speeds = X[1 : 2 * self.q : 2]
        if self.system.condition == GRAZE:
            speeds = np.delete(speeds, self.system.graze)
        return float(speeds.min(initial=math.inf))

    def objection(self, X: np.ndarray) -> Objection | None:
        """Say why a point is no orbit within the ranges; None if it is one."""
        return self._objection(X)[0]

    def _objection(self, X: np.ndarray) -> tuple[Objection | None, float]:
        """Return an objection, and how high a flight turns that comes near the stop."""
        for j, (axis, value) in enumerate(zip(self.axes, self.values(X).tolist(), strict=True)):
            if not axis.low - axis.slack <= value <= axis.high + axis.slack:
                edge = axis.low if value < axis.low else axis.high
                return Objection("edge", j, edge), math.nan
        speeds = X[1 : 2 * self.q : 2]
        slowest = int(np.argmin(speeds))
        if speeds[slowest] < 0.0:
            return Objection("speed", slowest), math.nan
        flight, phase, turn = first_pass(
            parameters_at(self.system, X), self.m, self.speed, X, self.q
        )
        if flight < 0:
            return None, turn
        kind = "rest" if phase == X[2 * flight] else "pass"
        return Objection(kind, int(flight), float(phase)), turn
