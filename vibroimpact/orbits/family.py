"""`OrbitFamily`: ranges of its parameters; corrects points; `Inadmissible`; `ArclengthStep`.

A point is a vector of unknowns (``unknowns.py``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np

from vibroimpact.inputs import input_text, one_of
from vibroimpact.natural_units import NaturalUnits
from vibroimpact.orbits import calls
from vibroimpact.orbits.corrector import CONDITIONS, GRAZE, System, determinant
from vibroimpact.orbits.orbit import NAMES, Orbits, PeriodicOrbit, numbers_in, orbit_of
from vibroimpact.orbits.unknowns import differences_of_halves, free, inner, phases, speeds, unknowns
from vibroimpact.oscillator import PARAMETERS, Oscillator, mesh, point_of

#: Most time steps of all evaluations of the flights in one direction; then no point is found.
MOST_WORK = 2**24
#: Most iterations of the corrector.
_MOST_ITERATIONS = 8
#: A bifurcation that was found belongs to the path if it is closer to it than this, in scaled
#: unknowns.
NEARBY_DISTANCE = 1e-3
#: A speed below this is zero to rounding: a graze.
_ZERO_SPEED = 1e-12
#: By rounding, a flight that is known to touch the stop passes it by at most this length.
_TOUCHES = 1e-9
#: The chord of a step deviates from the mean of both tangents by less than this share of the step.
#: On a circle it does not deviate at all; of 20,000 steps, 11 deviate by more.
_MOST_OFF = 0.05


@dataclass(frozen=True)
class ContinuationParameter:
    """A free parameter and its range."""

    name: str
    low: float
    high: float

    @classmethod
    def of(cls, osc: Oscillator, name: str, low: float, high: float) -> ContinuationParameter:
        """Check a range; TypeError or ValueError if the parameter or the range is not valid."""
        one_of(NAMES).checked("parameter", name)
        for value in (low, high):
            replace(osc, **{name: value})
        if not low < high:
            given = f"{input_text(low)} to {input_text(high)}"
            raise ValueError(f"the range of {name} must increase, not {given}")
        return cls(name, float(low), float(high))

    @property
    def span(self) -> float:
        """Length of the range."""
        return self.high - self.low

    @property
    def slack(self) -> float:
        """Rounding error of a value in the range."""
        return 1e-14 * max(abs(self.low), abs(self.high))

    def holds(self, value: float) -> bool:
        """Whether a value is in the range, to rounding."""
        return self.low - self.slack <= value <= self.high + self.slack

    def outside(self, value: float) -> str:
        """Say that an orbit at this value is outside the range."""
        return f"the orbit is at {self.name} = {value!r}, outside {self.low!r} to {self.high!r}"


def units_along(osc: Oscillator, axes: Sequence[ContinuationParameter]) -> NaturalUnits:
    """Return the natural units of an oscillator over the ranges of some parameters."""
    ranges = {axis.name: np.array([axis.low, axis.high]) for axis in axes}
    point = point_of(osc)
    return NaturalUnits.of(mesh(ranges, {name: point[name][0] for name in PARAMETERS}))


@dataclass(frozen=True)
class Inadmissible:
    """Why a point is inadmissible, that is, not an orbit within the ranges.

    Its kind is ``edge``, ``speed`` (an impact leaves the stop instead of meeting it),
    ``penetration`` (a flight meets the stop before its end) or ``rest`` (the mass cannot leave the
    stop).
    """

    kind: str
    at: int  # index of the parameter, the impact or the flight
    where: float = math.nan  # value of the edge, or phase where a flight meets the stop


class Point(NamedTuple):
    """A point of a path, and its properties."""

    X: np.ndarray  # (2 q + k,)
    tangent: np.ndarray  # the direction of the path, (2 q + k,)
    tests: np.ndarray  # the test functions and their slopes along it (``hidden_roots.py``), (2, n)
    maximum: float  # greatest local maximum near the stop (``first_penetration``)
    inadmissible: Inadmissible | None


class OrbitFamily:
    """The orbits of m forcing periods and q >= 1 impacts over at most two free parameters.

    With a `kind`, all orbits are at this bifurcation; at a graze, `graze` is the index of the
    grazing impact. The first orbit gives the other parameters. Vectors of unknowns and all that is
    computed from them are in natural units; orbits and their parameters are in those of the user.
    """

    def __init__(
        self,
        orbit: PeriodicOrbit,
        parameters: Sequence[ContinuationParameter],
        kind: str = "",
        graze: int = 0,
    ) -> None:
        self.osc, self.m, self.q, self.kind = orbit.oscillator, orbit.m, orbit.q, kind
        self.parameters = tuple(parameters)
        self.names = tuple(parameter.name for parameter in parameters)
        self.units = units_along(self.osc, self.parameters)
        self.spans = np.array([axis.span for axis in parameters])
        units = [PARAMETERS[name].unit for name in self.names]
        spans = np.array([*map(self.units.into, units, self.spans)])
        indices = np.array([*map(NAMES.index, self.names)], np.int64)
        (point,) = numbers_in(self.units, point_of(self.osc))
        condition, work = CONDITIONS[kind], np.zeros(1)
        self.system = System(
            point, indices, spans, self.m, self.q, condition, graze, touches=False, work=work
        )
        limits = [(axis.low - axis.slack, axis.high + axis.slack) for axis in parameters]
        self.bounds = np.reshape(limits, (-1, 2)) / self.spans[:, None]
        at = [getattr(self.osc, axis.name) for axis in parameters]
        self.start = self.unknowns(orbit.phases, orbit.speeds, np.array(at))
        if kind == "graze":
            self.system = self.system._replace(touches=self._touches())

    def _touches(self) -> bool:
        """Whether flights touch the stop all along a curve of grazes.

        The free oscillation touches the stop once in each of m periods. An orbit that is symmetric
        in time, without damping and loss, has each touch twice.
        """
        maximum = calls.first_penetration(self.system, self.start)[2]
        symmetric = self.osc.h == 0.0 and self.osc.R == 1.0
        return self.q == 1 or (symmetric and bool(abs(maximum) < _TOUCHES))

    def unknowns(self, phases: np.ndarray, speeds: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return the points of impacts, shape (..., q) each, at values of the parameters."""
        z = np.stack([phases, self.units.into("length/time", speeds)], axis=-1)
        return unknowns(z, values / self.spans)

    def values(self, X: np.ndarray) -> np.ndarray:
        """Return the free parameters at points."""
        return free(X, self.q) * self.spans

    def free_values(self, X: np.ndarray) -> np.ndarray:
        """Return the free parameters at points; a value within rounding of an edge becomes it."""
        values = self.values(X)
        for j, axis in enumerate(self.parameters):
            for edge in (axis.low, axis.high):
                values[..., j][np.abs(values[..., j] - edge) <= axis.slack] = edge
        return values

    def within(self, X: np.ndarray) -> np.ndarray:
        """Return the free parameters at points of a path, which rounding may put beyond an edge."""
        edges = np.reshape([(axis.low, axis.high) for axis in self.parameters], (-1, 2))
        values: np.ndarray = self.free_values(X).clip(*edges.T)
        return values

    def oscillator(self, X: np.ndarray) -> Oscillator:
        """Return the oscillator at a point; its parameters stay in their ranges."""
        return replace(self.osc, **dict(zip(self.names, self.within(X).tolist(), strict=True)))

    def impacts(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return phases and speeds at points; a speed that is zero to rounding becomes zero."""
        v = speeds(X, self.q)
        v = np.where(np.abs(v) < _ZERO_SPEED, 0.0, v)
        return phases(X, self.q), self.units.out_of("length/time", v)

    def orbit(self, X: np.ndarray, kind: str = "") -> PeriodicOrbit:
        """Return the orbit at a point, which may be a bifurcation of a branch."""
        return orbit_of(self.oscillator(X), self.m, *self.impacts(X), self.kind or kind)

    def related(self, z: np.ndarray, m: int, kind: str = "") -> OrbitFamily:
        """Return the family of other orbits of the same oscillators: those near impacts z."""
        speeds = self.units.out_of("length/time", z[:, 1])
        return OrbitFamily(PeriodicOrbit(self.osc, m, z[:, 0], speeds), self.parameters, kind)

    def orbits(self, X: np.ndarray) -> Orbits:
        """Return the orbits at points, shape (n, 2 q + k), with impacts numbered as there."""
        return Orbits.along(
            self.osc, self.names, self.within(X), self.m, *self.impacts(X), self.kind
        )

    def corrected(
        self,
        X: np.ndarray,
        planes: np.ndarray,
        most: int = _MOST_ITERATIONS,
        system: System | None = None,
    ) -> np.ndarray | None:
        """Return the point of the family in planes through X; None if none is found.

        None also once all calls together have taken more than ``MOST_WORK`` time steps.
        """
        X, system = X.copy(), system or self.system
        if system.work[0] > MOST_WORK or not calls.correct(system, X, planes, most).all():
            return None
        if system.condition == GRAZE and len(planes) < len(self.parameters):
            speeds(X, self.q)[system.graze] = 0.0  # it is zero to rounding
        return X

    def corrected_each(self, X: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the points of a branch near each row of X, and whether one is found, (n,).

        Row i moves in the plane across row i of `along`.
        """
        X = X.copy()
        return X, calls.correct(self.system, X, along, _MOST_ITERATIONS)

    def bifurcation(self, X: np.ndarray, kind: str, graze: int = 0) -> np.ndarray | None:
        """Return the bifurcation near a point of a branch; None in the cases of `corrected`."""
        system = self.system._replace(condition=CONDITIONS[kind], graze=graze)
        return self.corrected(X, np.empty((0, X.size)), system=system)

    def tangent(self, X: np.ndarray, along: np.ndarray | None = None) -> np.ndarray:
        """Return the direction of the family; with `along`, that which goes the same way."""
        tangent = calls.tangent(self.system, X)
        return -tangent if along is not None and self.inner(tangent, along) < 0.0 else tangent

    def heading(self, X: np.ndarray, tangent: np.ndarray) -> np.ndarray:
        """Return the tangent of a curve of folds without its part along the null vector.

        It vanishes only with the velocity of the parameters. Where they turn smoothly, it turns
        little. It does not depend on the spans of the parameters.
        """
        null = np.append(calls.null_vector(self.system, X, 1.0), np.zeros(2))
        return tangent - self.inner(tangent, null) / self.inner(null, null) * null

    def inner(self, X: np.ndarray, Y: np.ndarray) -> float:
        """Return the inner product of the continuation."""
        return float(inner(X, Y, self.q))

    def distance(self, X: np.ndarray, Y: np.ndarray) -> float:
        """Return the distance of two points."""
        return math.sqrt(self.inner(X - Y, X - Y))

    def stable(self, point: Point) -> bool:
        """Whether both multipliers are inside the unit circle (Jury); False at a bifurcation."""
        flip, fold = point.tests[0, -2:]
        if not flip * fold > 0.0:
            return False
        pt = calls.parameters(self.system, point.X)
        return bool(determinant.py_func(pt, self.m, self.q) < 1.0)

    def point(self, X: np.ndarray, tangent: np.ndarray) -> Point:
        """Return the point X of a path that has this tangent."""
        tests = calls.test_functions(self.system, X, tangent, self.bounds)
        reason, maximum = self.inadmissible(X)
        return Point(X, tangent, tests, maximum, reason)

    def test(self, number: int, X: np.ndarray) -> float:
        """Return one of the test functions."""
        tests = calls.test_functions(self.system, X, np.zeros(X.size), self.bounds)
        return float(tests[0, number])

    def slowest(self, X: np.ndarray) -> float:
        """Return the slowest speed; on a curve of grazes that of the other impacts, inf if none."""
        v = speeds(X, self.q)
        if self.kind == "graze":
            v = np.delete(v, self.system.graze)
        return float(v.min(initial=math.inf))

    def flights(self, X: np.ndarray) -> np.ndarray:
        """Return the lengths of the flights, as phases."""
        theta = phases(X, self.q)
        lengths: np.ndarray = np.diff(theta, append=theta[0] + 2.0 * math.pi * self.m)
        return lengths

    def fastest(self, X: np.ndarray) -> float:
        """Return the fastest speed."""
        return float(speeds(X, self.q).max())

    def inadmissible(self, X: np.ndarray) -> tuple[Inadmissible | None, float]:
        """Return why a point is inadmissible, and the greatest local maximum near the stop."""
        values = self.values(X).tolist()
        for j, axis in enumerate(self.parameters):
            if not axis.holds(values[j]):
                edge = axis.low if values[j] < axis.low else axis.high
                return Inadmissible("edge", j, edge), math.nan
        slowest = int(np.argmin(speeds(X, self.q)))
        if speeds(X, self.q)[slowest] < 0.0:
            return Inadmissible("speed", slowest), math.nan
        flight, phase, maximum = calls.first_penetration(self.system, X)
        if flight < 0:
            return None, maximum
        if phase == phases(X, self.q)[flight]:
            return Inadmissible("rest", flight, phase), maximum
        if self.system.touches and maximum < _TOUCHES:
            return None, maximum
        return Inadmissible("penetration", flight, phase), maximum


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

    @classmethod
    def chord(cls, family: OrbitFamily, X: np.ndarray, Y: np.ndarray) -> Self:
        """Return the step from X to Y along their chord, within which a `root` is sought."""
        length = family.distance(X, Y)
        begin = Point(X, (Y - X) / length, X[:0], math.nan, None)
        return cls(family, begin, begin._replace(X=Y), length)

    def share(self, X: np.ndarray) -> float:
        """Return the position of a point along the tangent, as a share of the step."""
        return self.family.inner(self.begin.tangent, X - self.begin.X) / self.length

    def end_values(self, test: int) -> tuple[float, float]:
        """Return the values of a test function at both ends."""
        return float(self.begin.tests[0, test]), float(self.end.tests[0, test])

    def jumps(self) -> bool:
        """Whether the chord deviates from the mean tangent, as in a jump to another path."""
        first, second = self.begin.tangent, self.end.tangent
        mean = (first + second) / (1.0 + self.family.inner(first, second))
        off = self.end.X - self.begin.X - self.length * mean
        return self.family.inner(off, off) > (_MOST_OFF * self.length) ** 2

    def exchanges_halves(self) -> bool:
        """Whether the halves of an orbit change places, at the flip of the half."""
        m, q = self.family.m, self.family.q
        first, last = (differences_of_halves(point.X, m, q) for point in (self.begin, self.end))
        return bool(np.sum(first * last) < 0.0)

    def may_miss(self) -> bool:
        """Whether the step may miss roots of test functions, or points that are not orbits."""
        return calls.may_miss(self.family.system, self.begin[:3], self.end[:3], self.length)

    def root(
        self, function: Callable[[np.ndarray], float], first: float, last: float
    ) -> np.ndarray | None:
        """Return the root of a function whose values at the ends differ in sign; None if not found.

        At the ends Newton's method may fail, and another sum of the same terms have another sign.
        """
        from scipy.optimize import brentq

        X, tangent = self.begin.X, self.begin.tangent
        values_at_ends = {0.0: (X, first), self.length: (self.end.X, last)}

        def at(s: float) -> np.ndarray | None:
            if s in values_at_ends:
                return values_at_ends[s][0]
            return self.family.corrected(X + s * tangent, tangent[None, :])

        def along_step(s: float) -> float:
            if s in values_at_ends:
                return values_at_ends[s][1]
            Y = at(s)
            if Y is None:
                raise ArithmeticError
            return function(Y)

        try:
            s = brentq(along_step, 0.0, self.length, xtol=1e-16 * (1.0 + self.length), rtol=1e-14)
        except (ArithmeticError, ValueError):
            return None
        return at(float(s))
