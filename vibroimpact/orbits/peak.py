"""The largest maximum of a flight between two impacts, with a proof that none was missed."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from vibroimpact.oscillator import Oscillator
from vibroimpact.step.integrators import exact

_EPS = float(np.finfo(float).eps)
# An interval of a flight is halved at most so often; what is left is shorter than any feature.
_MAX_HALVINGS = 50


class _Node(NamedTuple):
    """A time in a flight, the state there, its phase, and |x''|, the sign of x'' and |x'''|."""

    t: float
    x: float
    v: float
    s: float
    c: float
    a: float
    speeds_up: bool
    jerk: float


class _Flight:
    """The motion after an impact, in nodes."""

    def __init__(self, osc: Oscillator, phase: float) -> None:
        self.osc, self.phase, self.point = osc, phase, osc.at(osc.clearance)[0]

    def node(self, t: float, x: float, v: float) -> _Node:
        """Return a state of the flight with what its bounds need."""
        osc, theta = self.osc, self.phase + self.osc.omega * t
        s, c = math.sin(theta), math.cos(theta)
        a = -2.0 * osc.h * v - osc.p * osc.p * x - osc.f * s
        jerk = -2.0 * osc.h * a - osc.p * osc.p * v - osc.f * osc.omega * c
        return _Node(t, x, v, s, c, abs(a), a > 0.0, abs(jerk))

    def after(self, left: _Node, dt: float) -> tuple[float, float]:
        """Return x and v a time later, in closed form."""
        return exact(left.x, left.v, left.s, left.c, dt, self.point)

    def bounds(self, left: _Node, right: _Node) -> tuple[float, float]:
        """Return bounds on |x''| and |x'''| between two nodes.

        By their values at the nodes and a bound on |x''''|; that follows from the bound on the
        energy, d/dt hypot(x', p x) <= f, and eq. (1), differentiated twice.
        """
        h2, p, f, omega = 2.0 * self.osc.h, self.osc.p, self.osc.f, self.osc.omega
        w = right.t - left.t
        speed = math.hypot(left.v, p * left.x) + f * w
        a = (h2 + p) * speed + f
        jerk = h2 * a + p * p * speed + f * omega
        snap = h2 * jerk + p * p * a + f * omega * omega
        jerk = max(left.jerk, right.jerk) + 0.5 * w * snap
        return max(left.a, right.a) + 0.5 * w * jerk, jerk

    def top(self, left: _Node, right: _Node) -> float:
        """Return x at the maximum between two nodes with x' > 0 and x' <= 0."""
        w = right.t - left.t
        if self.after(left, w)[1] > 0.0:  # it is at the right node, to rounding
            return right.x
        return self.after(left, find_root(lambda dt: self.after(left, dt)[1], 0.0, w))[0]


def largest_maximum(osc: Oscillator, n: int, v: float, phase: float) -> float:
    """Return the largest local maximum of x - clearance between the impacts; -inf without one.

    The flight is halved until each piece is proved to hold no zero of x', or at most one
    because x'' keeps its sign: so no maximum is missed.
    """
    flight, T = _Flight(osc, phase), n * osc.forcing_period
    launch, landing = flight.node(0.0, osc.clearance, -osc.R * v), flight.node(T, osc.clearance, v)
    highest, undecided = -math.inf, [(launch, landing, 0)]
    while undecided:  # ends: an interval is halved so many times at the most
        left, right, halvings = undecided.pop()
        a, jerk = flight.bounds(left, right)
        w = right.t - left.t
        if left.v * right.v > 0.0 and abs(left.v) + abs(right.v) > a * w:
            continue
        if left.speeds_up == right.speeds_up and left.a + right.a > jerk * w:
            if left.v > 0.0 >= right.v:
                highest = max(highest, flight.top(left, right) - osc.clearance)
        elif halvings == _MAX_HALVINGS:
            highest = max(highest, left.x - osc.clearance, right.x - osc.clearance)
        else:
            t = 0.5 * (left.t + right.t)
            middle = flight.node(t, *flight.after(left, t - left.t))
            undecided += [(left, middle, halvings + 1), (middle, right, halvings + 1)]
    return highest


def find_root(function: Callable[[float], float], low: float, high: float) -> float:
    """Return the root in a bracket, to rounding."""
    xtol = _EPS * max(abs(low), abs(high))
    from scipy.optimize import brentq  # 0.3 s that a sweep need not pay

    return float(brentq(function, low, high, xtol=xtol, rtol=4.0 * _EPS))
