"""Branches of periodic orbits in one parameter, with every bifurcation on them.

A branch is walked from an orbit in both directions (``continuation.py``). On the way the signs of
det(S + mu T) at mu = -1 and +1 tell the flips and folds, and Newton's method with that condition
finds them to rounding. It ends in a graze, where an impact's speed or the height of a flight
between two impacts is zero: both are an impact of speed zero, found by one condition; in a flip of
an orbit of half the period; at the edge; or where the mass would rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from vibroimpact.orbits import newton
from vibroimpact.orbits.continuation import Axis, End, Orbits, Segment, walk
from vibroimpact.orbits.elimination import null_vector
from vibroimpact.orbits.flights import state_after
from vibroimpact.orbits.periodic import (
    OrbitError,
    PeriodicOrbit,
    free_amplitude,
    free_oscillation,
    orbit_of,
    solved,
)
from vibroimpact.oscillator import Oscillator

#: A bifurcation is that of a walk if it is this near to it, in scaled unknowns.
NEARBY_DISTANCE = 1e-3
#: Values of the parameter at which the free oscillation is looked at.
_FREE_VALUES = 201


class Special(NamedTuple):
    """A special point of a branch.

    Attributes
    ----------
    kind : str
        ``flip``, ``fold``, ``graze``; and the ends ``penetration`` (a flight meets the stop),
        ``rest`` (the mass cannot leave it), ``edge`` of the range, and ``lost`` where Newton's
        method fails or the branch is too long.
    value : float
        Of the parameter.
    orbit : PeriodicOrbit
        At a graze it has the impact of speed zero; at the flip in which a branch ends, it is the
        orbit of half the period.
    """

    kind: str
    value: float
    orbit: PeriodicOrbit


@dataclass(frozen=True, eq=False)
class Branch:
    """A branch of periodic orbits, in the order of its points along it.

    Attributes
    ----------
    parameter : str
    m, q : int
    values : ndarray, shape (n,)
        Of the parameter.
    stable : ndarray of bool, shape (n,)
        Whether both multipliers are inside the unit circle.
    phases, speeds : ndarray, shape (n, q)
        Of the impacts; phases are continuous along the branch.
    special : list of Special
        In the order of the branch.
    """

    parameter: str
    m: int
    q: int
    values: np.ndarray
    stable: np.ndarray
    phases: np.ndarray
    speeds: np.ndarray
    special: list[Special]
    start: PeriodicOrbit

    def orbit(self, i: int) -> PeriodicOrbit:
        """Return the orbit at a point of the branch."""
        osc = replace(self.start.oscillator, **{self.parameter: float(self.values[i])})
        if self.q == 0:
            return PeriodicOrbit(osc, 1, np.empty(0), np.empty(0))
        return orbit_of(osc, self.m, self.phases[i], self.speeds[i])

    def at(self, value: float) -> list[PeriodicOrbit]:
        """Return the orbits at a value of the parameter, in the order of the branch."""
        osc, orbits_there = replace(self.start.oscillator, **{self.parameter: float(value)}), []
        away = self.values - value
        crossed = (away[:-1] * away[1:] < 0.0) | (away[:-1] == 0.0)
        crossed[-1:] |= away[-1:] == 0.0
        for i in np.flatnonzero(crossed).tolist():
            share = away[i] / (away[i] - away[i + 1]) if away[i] else 0.0
            between = [
                (1.0 - share) * column[i] + share * column[i + 1]
                for column in (self.phases, self.speeds)
            ]
            try:
                orbit = solved(osc, self.m, *between)
            except OrbitError:  # beside a fold, or a point where the branch ends
                continue
            if (orbit.m, orbit.q) == (self.m, self.q):
                orbits_there.append(orbit)
        return orbits_there


def branch(orbit: PeriodicOrbit, parameter: str, low: float, high: float) -> Branch:
    """Follow a periodic orbit along a parameter, through its folds, in both directions.

    Parameters
    ----------
    orbit : PeriodicOrbit
        With its parameter in the range.
    parameter : str
        Name of a parameter of the oscillator.
    low, high : float
        The range, low < high.

    Returns
    -------
    Branch

    Raises
    ------
    TypeError, ValueError
        If a range is not valid, or the orbit outside it.
    """
    axis = Axis.of(orbit.oscillator, parameter, low, high)
    value = getattr(orbit.oscillator, parameter)
    if not low <= value <= high:
        raise ValueError(f"the orbit is at {parameter} = {value!r}, outside {low!r} to {high!r}")
    if orbit.q == 0:
        return free_branch(orbit, axis)
    orbits = Orbits(orbit, (axis,))
    tangent = orbits.tangent(orbits.start)
    if tangent[-1] < 0.0:
        tangent = -tangent
    forward = Walked(orbits, orbits.start, tangent)
    if forward.closed:
        return forward.branch(orbit)
    return Walked(orbits, orbits.start, -tangent).branch(orbit, forward)


class Walked:
    """A walk from a point along a tangent, with what was found on it."""

    def __init__(
        self, orbits: Orbits, X: np.ndarray, tangent: np.ndarray, singular: bool = False
    ) -> None:
        """Walk; where the start is `singular`, bifurcations are looked for after the first step."""
        self.orbits, self.closed = orbits, False
        self.points: list[np.ndarray] = [X]
        self.stable = [not singular and orbits.stable(X, orbits.polynomial(X))]
        self.special: list[Special] = []
        before = None if singular else orbits.polynomial(X)
        for part in walk(orbits, X, tangent):
            if isinstance(part, End):
                self.closed = part.closed
                self._end(part)
                return
            half = _halving(part) if before is not None else None
            if half is not None:
                self._add(half[0], False, Special("flip", half[1].value, half[1].orbit))
                return
            after = orbits.polynomial(part.Y)
            for kind, X_ in _bifurcations(part, before, after):
                self._add(X_, False, Special(kind, float(orbits.kept(X_)[0]), orbits.orbit(X_)))
            self._add(part.Y, orbits.stable(part.Y, after))
            before = after

    def _add(self, X: np.ndarray, stable: bool, special: Special | None = None) -> None:
        self.points.append(X)
        self.stable.append(stable)
        if special is not None:
            self.special.append(special)

    def _end(self, end: End) -> None:
        if self.closed:
            return
        X, objection, orbits = end.X, end.objection, self.orbits
        if objection is None:
            kind, orbit = "lost", orbits.orbit(X)
        elif objection.kind in ("edge", "rest"):
            kind, orbit = objection.kind, orbits.orbit(X)
        else:
            kind, X, orbit = graze_at_end(orbits, X, objection.kind, objection.at, objection.where)
        self.points[-1] = X
        if kind != "edge":
            self.stable[-1] = False
        else:
            self.stable[-1] = orbits.stable(X, orbits.polynomial(X))
        value = float(getattr(orbit.oscillator, orbits.axes[0].name))
        self.special.append(Special(kind, value, orbit))

    def branch(self, start: PeriodicOrbit, forward: Walked | None = None) -> Branch:
        """Return the branch, `forward` being the walk in the other direction."""
        points, stable, special = self.points, self.stable, self.special
        if forward is not None:
            points = points[::-1] + forward.points[1:]
            stable = stable[::-1] + forward.stable[1:]
            special = special[::-1] + forward.special
        X, orbits, q = np.array(points), self.orbits, self.orbits.q
        axis = orbits.axes[0]
        return Branch(
            axis.name,
            orbits.m,
            q,
            np.clip(X[:, -1] * orbits.spans[0], axis.low, axis.high),
            np.array(stable),
            X[:, : 2 * q : 2],
            np.maximum(X[:, 1 : 2 * q : 2], 0.0) * orbits.speed,
            special,
            start,
        )


def _bifurcations(
    step: Segment, before: Sequence[float] | None, after: Sequence[float]
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the flips and folds within a step, in order."""
    if before is None:
        return
    orbits, located = step.orbits, []
    for kind, condition, mu in (("flip", newton.FLIP, -1.0), ("fold", newton.FOLD, 1.0)):
        a, b = (c[0] + mu * c[1] + c[2] for c in (before, after))
        if not a * b < 0.0:
            continue
        guess = step.X + a / (a - b) * (step.Y - step.X)
        X = orbits.corrected(guess, np.empty((0, guess.size)), condition)
        if X is None or not (-0.01 <= step.place(X) <= 1.01 and _apart(orbits, X, guess) < 0.1):

            def test_function(X: np.ndarray, mu: float = mu) -> float:
                c = orbits.polynomial(X)
                return c[0] + mu * c[1] + c[2]

            X = step.root(test_function)
        if X is not None:
            located.append((step.place(X), kind, X))
    for _, kind, X in sorted(located, key=lambda item: item[0]):
        yield kind, X


def _apart(orbits: Orbits, X: np.ndarray, Y: np.ndarray) -> float:
    return math.sqrt(orbits.inner(X - Y, X - Y))


def graze_at_end(
    orbits: Orbits, X: np.ndarray, kind: str, at: int, where: float
) -> tuple[str, np.ndarray, PeriodicOrbit]:
    """Find the graze in which a branch ends.

    Parameters
    ----------
    orbits : Orbits
        Over one axis.
    X : ndarray
        The last point.
    kind : str
        ``speed``: the impact `at` has no speed left. ``pass``: the flight `at` touches the stop at
        the phase `where`.

    Returns
    -------
    kind : str
        ``graze``, or ``rest`` where the force presses, or ``penetration`` where no graze is found.
    X : ndarray
        The last point, corrected.
    orbit : PeriodicOrbit
        With the impact of speed zero.
    """
    wider, Y = (orbits, X) if kind == "speed" else with_touch(orbits, X, at, where)
    index = at if kind == "speed" else at + 1
    Z = wider.corrected(Y, np.empty((0, Y.size)), newton.GRAZE, index)
    if Z is None or not _apart(wider, Z, Y) < NEARBY_DISTANCE:
        return "penetration", X, orbits.orbit(X)
    osc = wider.oscillator(Z)
    pulls = -osc.f * math.sin(Z[2 * index]) - osc.p**2 * osc.clearance < 0.0
    last = Z if kind == "speed" else np.delete(Z, [2 * index, 2 * index + 1])
    return "graze" if pulls else "rest", last, wider.orbit(Z)


def with_touch(orbits: Orbits, X: np.ndarray, at: int, where: float) -> tuple[Orbits, np.ndarray]:
    """Return a point with one impact of speed zero more, where flight `at` is highest."""
    values, omega = newton.parameters_at(orbits.system, X), orbits.oscillator(X).omega
    theta, v = X[2 * at], X[2 * at + 1] * orbits.speed
    tau = (where - theta) / omega
    for _ in range(20):
        _, u, a = state_after(values, theta, v, tau)
        if not a < 0.0 or abs(u / a) < 1e-12 * tau:
            break
        tau = max(tau - u / a, 0.5 * tau)
    Y = np.insert(X, 2 * at + 2, (theta + omega * tau, 0.0))
    z = Y[: 2 * orbits.q + 2].reshape(-1, 2)
    touching = PeriodicOrbit(orbits.oscillator(X), orbits.m, z[:, 0], z[:, 1] * orbits.speed)
    return Orbits(touching, orbits.axes, speed=orbits.speed), Y


def _halving(step: Segment) -> tuple[np.ndarray, Special] | None:
    """Return the point within a step where the orbit becomes one of half the period, if any."""
    orbits, q = step.orbits, step.orbits.q
    if orbits.m % 2 or q % 2:
        return None
    unlike = [_unlike(orbits, X) for X in (step.X, step.Y)]
    if not np.sum(unlike[0] * unlike[1]) < 0.0:
        return None
    sizes = [float(np.abs(part).max()) for part in unlike]
    X = step.X + sizes[0] / sum(sizes) * (step.Y - step.X)
    z = X[: 2 * q].reshape(q, 2)
    mean = z[: q // 2] + 0.5 * _unlike(orbits, X).reshape(-1, 2)
    half = PeriodicOrbit(orbits.oscillator(X), orbits.m // 2, mean[:, 0], mean[:, 1] * orbits.speed)
    halves = Orbits(half, orbits.axes)
    Y = halves.corrected(halves.start, np.empty((0, halves.start.size)), newton.FLIP)
    if Y is None or halves.objection(Y) is not None:
        return None
    orbit = halves.orbit(Y)
    doubled, _ = doubling(halves, Y, orbits.speed)
    return doubled, Special("flip", float(halves.kept(Y)[0]), orbit)


def _unlike(orbits: Orbits, X: np.ndarray) -> np.ndarray:
    """Return by how much the second half of an orbit differs from the first."""
    q = orbits.q
    z = X[: 2 * q].reshape(q, 2)
    unlike = z[q // 2 :] - z[: q // 2]
    unlike[:, 0] -= math.pi * orbits.m
    return unlike.ravel()


def doubling(orbits: Orbits, X: np.ndarray, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a flip as a point of the orbits of twice the period, and the direction they take."""
    q = orbits.q
    z = X[: 2 * q].reshape(q, 2) * np.array([1.0, orbits.speed / speed])
    vector = null_vector(*orbits.derivatives(X), -1.0).reshape(q, 2) * np.array(
        [1.0, orbits.speed / speed]
    )
    vector /= math.sqrt(np.sum(vector**2) / q)
    second_round = z + np.array([2.0 * math.pi * orbits.m, 0.0])
    doubled = np.concatenate([z.ravel(), second_round.ravel(), X[2 * q :]])
    along = np.concatenate([vector.ravel(), -vector.ravel(), np.zeros(X.size - 2 * q)])
    return doubled, along


def free_branch(orbit: PeriodicOrbit, axis: Axis) -> Branch:
    """Follow the free oscillation from an orbit to where its amplitude is the clearance."""
    from scipy.optimize import brentq

    def gap_left(value: float) -> float:
        osc = replace(orbit.oscillator, **{axis.name: value})
        return osc.clearance - min(free_amplitude(osc), 1e300)

    start = float(getattr(orbit.oscillator, axis.name))
    values = np.linspace(axis.low, axis.high, _FREE_VALUES)
    special: list[Special] = []
    ends: list[float] = []
    for side in (values[values < start][::-1], values[values > start]):
        before, last = start, None
        for value in side.tolist():
            if not gap_left(value) > 0.0:
                last = start  # it grazes there, to rounding
                if gap_left(before) > 0.0:
                    last = float(brentq(gap_left, *sorted((before, value)), xtol=1e-15, rtol=1e-15))
                break
            before = value
        ends.append(before if last is None else last)
        osc = replace(orbit.oscillator, **{axis.name: ends[-1]})
        if last is None:
            special.append(Special("edge", before, PeriodicOrbit(osc, 1, np.empty(0), np.empty(0))))
        else:
            special.append(Special("graze", last, free_graze(osc)))
    inside = values[(values > ends[0]) & (values < ends[1])]
    values = np.unique(np.concatenate([[ends[0]], inside, [ends[1]]]))
    decays = orbit.oscillator.h > 0.0 or axis.name == "h"
    stable = np.full(values.size, decays)
    stable[[i for i in (0, -1) if special[i].kind == "graze"]] = False
    none = np.empty((values.size, 0))
    return Branch(axis.name, 1, 0, values, stable, none, none, special, orbit)


def free_graze(osc: Oscillator, m: int = 1) -> PeriodicOrbit:
    """Return the free oscillation that touches the stop, as an orbit with an impact of speed 0."""
    x, v = free_oscillation(osc, 0.0)
    phase = math.atan2(v / osc.omega, x)  # x = A sin(theta + a), greatest at theta = pi / 2 - a
    return PeriodicOrbit(osc, m, np.array([phase % (2.0 * math.pi)]), np.zeros(1))
