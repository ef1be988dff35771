"""The flights of an orbit between its impacts: what closes them, the derivatives, and the proof.

An orbit of m forcing periods with q impacts is known by the phases theta_i and the speeds before
impact v_i, i = 1..q. Flight i leaves the stop at theta_i with the speed -R v_i and ends after
tau_i = (theta_{i+1} - theta_i) / omega; the last one ends at theta_1 + 2 pi m. With x(tau), x'(tau)
its exact state there, the orbit is a root of the 2q equations

    x(tau_i) - clearance = 0,    x'(tau_i) - v_{i+1} = 0.

With M the matrix of the flow over the flight, a- the acceleration at its end and a+ the one just
after its launch, the derivatives of flight i are

    d/d theta_{i+1} = (x', a-) / omega,          d/d v_{i+1} = (0, -1),
    d/d theta_i = -M (-R v_i, a+) / omega,       d/d v_i = M (0, -R).

Nothing is divided by a speed: the equations stay regular where an impact grazes. Every flight is
taken in equal steps on the Taylor series of ``step.flight``, which is the exact flow to rounding.

A root may pass through the stop between its impacts. It does not where no flight meets the stop
before its end. That is proved on every step as the exact engine does it, by
``step.flight.first_crossing``; the roots at the launch and at the landing are divided out.

Unknowns are scaled: speeds by V, displacements by V / omega, so that all are of the order of 1.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import jit
from vibroimpact.oscillator import Oscillator
from vibroimpact.step.flight import (
    LONGEST_STEP,
    TERMS,
    expand,
    first_crossing,
    value_and_slope,
)
from vibroimpact.step.flow import Equation, equation_of, impulse
from vibroimpact.step.integrators import Parameters
from vibroimpact.step.trigonometry import sin_cos

#: A flight counts as below the stop where it passes it by less than so many roundings.
_ROUNDINGS = 32.0 * 2.0**-52
#: Longest flight, in units of the fastest rate of the system.
_LONGEST = 1e6
#: The limits of the work: time steps of a repetition, and those that a search or a walk takes.
MOST_STEPS, MOST_WORK = 2**15, 2**19


class Flight(NamedTuple):
    """The step of a flight: how many there are, how long, as a phase too, and its equation."""

    n: int
    T: float
    step: float
    eq: Equation


@jit
def parameters(values):
    """Return the parameters in an array of six by name."""
    return Parameters(values[0], values[1], values[2], values[3], values[4], values[5])


def values_of(osc: Oscillator) -> np.ndarray:
    """Return the parameters of an oscillator in an array of six."""
    return np.array([osc.h, osc.R, osc.omega, osc.f, osc.p, osc.clearance])


@jit
def time_steps(values, m, q):
    """Return about how many time steps the flights of a repetition are divided into."""
    pt = parameters(values)
    return abs(m * 2.0 * math.pi * ((2.0 * pt.h + pt.p) / pt.omega + 1.0) / LONGEST_STEP) + q


@jit
def _divide(tau, pt):
    """Divide a flight into steps."""
    n = max(1.0, math.ceil((2.0 * pt.h + pt.p + pt.omega) * tau / LONGEST_STEP))
    T = tau / n
    return Flight(int(n), T, pt.omega * T, equation_of(pt))


@jit
def _advance(flight, phase, y, u, pt, c):
    """Expand a flight over the step from a phase; return x - clearance and x' at its end."""
    sine, cosine = sin_cos(phase)
    expand(flight.eq, y, u / pt.omega, sine, cosine, flight.step, c)
    y, slope = value_and_slope(c, 0, 1.0)
    return y, slope / flight.T


@jit
def _land(flight, theta, v, pt, coefficients, M):
    """Follow a flight from an impact; return x - clearance and x' at its end, and set M."""
    y, u, eq = 0.0, -pt.R * v, flight.eq
    of_y, vv = impulse(eq.of_w, eq.of_y, flight.step)
    xx, xv, vx = vv - eq.of_w * of_y, of_y / pt.omega, eq.of_y * of_y * pt.omega
    M[0, 0], M[0, 1], M[1, 0], M[1, 1] = 1.0, 0.0, 0.0, 1.0
    for k in range(flight.n):
        y, u = _advance(flight, theta + pt.omega * flight.T * k, y, u, pt, coefficients)
        for j in range(2):
            M[0, j], M[1, j] = xx * M[0, j] + xv * M[1, j], vx * M[0, j] + vv * M[1, j]
    return y, u


@jit
def residuals(values, m, speed, X, q):
    """Return the residuals of all flights and their derivatives.

    Parameters
    ----------
    values : ndarray, shape (6,)
        Parameters of the oscillator.
    m : int
        Forcing periods.
    speed : float
        The unit of speeds, V.
    X : ndarray, shape (2 q, ...)
        Phase of each impact, and its speed in units of V, in turn; what follows is not looked at.
    q : int
        Impacts.

    Returns
    -------
    F : ndarray, shape (q, 2)
        The residuals; inf where an impact does not come after the one before it.
    A, B : ndarray, shape (q, 2, 2)
        The derivatives with respect to the impact before the flight and that after it.
    """
    pt = parameters(values)
    F, A, B = np.empty((q, 2)), np.empty((q, 2, 2)), np.empty((q, 2, 2))
    coefficients, M = np.empty(TERMS), np.empty((2, 2))
    length = speed / pt.omega
    for i in range(q):
        theta, v = X[2 * i], X[2 * i + 1] * speed
        last = i + 1 == q
        end = X[0] + 2.0 * math.pi * m if last else X[2 * i + 2]
        arrival = X[1] if last else X[2 * i + 3]
        tau = (end - theta) / pt.omega
        if not 0.0 < tau < _LONGEST / (2.0 * pt.h + pt.p + pt.omega):
            F[:] = math.inf
            return F, A, B
        y, u = _land(_divide(tau, pt), theta, v, pt, coefficients, M)
        push = -pt.p * pt.p * pt.clearance
        launched = 2.0 * pt.h * pt.R * v + push - pt.f * sin_cos(theta)[0]
        landed = -2.0 * pt.h * u - pt.p * pt.p * y + push - pt.f * sin_cos(end)[0]
        F[i, 0], F[i, 1] = y / length, u / speed - arrival
        for j in range(2):
            unit = length if j == 0 else speed
            A[i, j, 0] = (pt.R * v * M[j, 0] - launched * M[j, 1]) / (pt.omega * unit)
            A[i, j, 1] = -pt.R * M[j, 1] * speed / unit
        B[i, 0, 0], B[i, 0, 1] = u / speed, 0.0
        B[i, 1, 0], B[i, 1, 1] = landed / (pt.omega * speed), -1.0
    return F, A, B


@jit
def first_pass(values, m, speed, X, q):
    """Find the first flight that meets the stop before its end, and where.

    Parameters
    ----------
    As for `residuals`.

    Returns
    -------
    flight : int
        -1 if none does: the proof that the orbit stays below the stop between its impacts.
    phase : float
        Where it meets the stop; that of its launch where it cannot leave the stop.
    """
    pt = parameters(values)
    c = np.empty(TERMS)
    for i in range(q):
        end = X[0] + 2.0 * math.pi * m if i + 1 == q else X[2 * i + 2]
        flight = _divide((end - X[2 * i]) / pt.omega, pt)
        y, u = 0.0, -pt.R * X[2 * i + 1] * speed
        for k in range(flight.n):
            theta = X[2 * i] + pt.omega * flight.T * k
            y, u = _advance(flight, theta, y, u, pt, c)
            zeros = 0
            if k == 0:
                zeros = 1 if c[1] != 0.0 else 2
                if c[zeros] > 0.0:
                    return i, theta
            size = 0.0
            for j in range(TERMS):
                size += abs(c[j])
            if k + 1 == flight.n:  # divide by 1 - u, the root at the landing
                total = 0.0
                for j in range(TERMS - 1, zeros, -1):
                    total -= c[j]
                    c[j] = total
                for j in range(zeros, TERMS - 1):
                    c[j] = c[j + 1]
                c[TERMS - 1] = 0.0
            c[zeros] -= _ROUNDINGS * flight.n * size
            crossing, _ = first_crossing(c, zeros, 1.0)
            if crossing >= 0.0:
                return i, theta + pt.omega * flight.T * crossing
    return -1, 0.0


@jit
def highest_turn(values, theta, v, tau):
    """Return the greatest local maximum of x - clearance in a flight; -inf if it has none.

    Parameters
    ----------
    values : ndarray, shape (6,)
    theta, v : float
        Phase of the impact that the flight begins with, and the speed before it.
    tau : float
        Length of the flight [time].
    """
    pt = parameters(values)
    flight, c = _divide(tau, pt), np.empty(TERMS)
    y, u, highest = 0.0, -pt.R * v, -math.inf
    for k in range(flight.n):
        y, u = _advance(flight, theta + pt.omega * flight.T * k, y, u, pt, c)
        depth = 0.0
        for j in range(TERMS):
            depth += abs(c[j])
        # So far below the stop it is met nowhere, and every turning point is seen.
        c[0] -= 2.0 * depth
        _, turn = first_crossing(c, 0, 1.0)
        highest = max(highest, turn + 2.0 * depth)
    return highest


@jit
def state_after(values, theta, v, tau):
    """Return x - clearance, x' and x'' at a time after the impact at phase `theta`, speed `v`."""
    pt = parameters(values)
    if not tau > 0.0:
        y, u = 0.0, -pt.R * v
    else:
        flight = _divide(tau, pt)
        y, u = _land(flight, theta, v, pt, np.empty(TERMS), np.empty((2, 2)))
    s = sin_cos(theta + pt.omega * tau)[0]
    return y, u, -2.0 * pt.h * u - pt.p * pt.p * (y + pt.clearance) - pt.f * s
