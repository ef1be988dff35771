"""The flights of an orbit between impacts: residuals, derivatives, a proof of no other impact.

An orbit of m forcing periods with q impacts is given by the phases theta_i and the speeds before
impact v_i, i = 1..q. Flight i leaves the stop at theta_i with the speed -R v_i and ends after
tau_i = (theta_{i+1} - theta_i) / omega; the last flight ends at theta_1 + 2 pi m. With x(tau),
x'(tau) the exact state at the end of a flight, the orbit is a root of the 2q equations

    x(tau_i) - clearance = 0,    x'(tau_i) - v_{i+1} = 0.

Let M be the matrix of the flow over the flight, a- the acceleration at its end and a+ the
acceleration just after its launch. The derivatives of flight i are

    d/d theta_{i+1} = (x', a-) / omega,          d/d v_{i+1} = (0, -1),
    d/d theta_i = -M (-R v_i, a+) / omega,       d/d v_i = M (0, -R).

There is no division by a speed, so the equations stay regular where an impact grazes. Every flight
is taken in equal steps on the Taylor series of ``step.polynomial``, which is the exact flow to
rounding.

A root may pass through the stop between its impacts. It does not if no flight meets the stop before
its end. This is proved for every step as in the rule ``exact``, by ``first_crossing`` of
``step.polynomial``; the roots at the launch and at the landing are divided out.

All numbers are in natural units (``natural_units.py``), and displacements in those of v / omega, so
that they are of order 1.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from vibroimpact.jit import inlined, jit
from vibroimpact.orbits.unknowns import filled, pairs, phase_at, speed_at, zero_rows
from vibroimpact.step.elementary import larger, sin_cos, smaller
from vibroimpact.step.integrators import Parameters
from vibroimpact.step.polynomial import LONGEST_STEP, TERMS, expand, first_crossing, value_and_slope
from vibroimpact.step.propagator import Coefficients, coefficients_of, impulse

#: A flight counts as below the stop if it passes the stop by less than this number of roundings.
_ROUNDINGS = 32.0 * 2.0**-52
#: Most iterations to the turning point of a flight.
_MOST_TO_TURN = 20
#: Most time steps of a repetition.
MOST_ORBIT_STEPS = 2**15


class TimeSteps(NamedTuple):
    """The steps of a flight: their number, their length as time and as phase, and the equation."""

    n: int
    T: float
    phase_step: float
    eq: Coefficients


@jit
def parameters_in(numbers):
    """Return the ``Parameters`` in the numbers of a ``POINT``, with the whole force as f."""
    force = numbers[3] + numbers[6] * numbers[2] * numbers[2]
    return Parameters(numbers[0], numbers[1], numbers[2], force, numbers[4], numbers[5])


@jit
def time_steps(pt, m, q):
    """Return the approximate number of time steps that the flights of a repetition take."""
    return abs(m * 2.0 * math.pi * ((2.0 * pt.h + pt.p) / pt.omega + 1.0) / LONGEST_STEP) + q


@jit
def _divide(tau, pt, least):
    """Divide a flight into time steps, at least `least`."""
    n = larger(float(least), math.ceil((2.0 * pt.h + pt.p + pt.omega) * tau / LONGEST_STEP))
    T = tau / n
    return TimeSteps(int(n), T, pt.omega * T, coefficients_of(pt))


@jit
def _advance(flight, phase, y, u, pt, c):
    """Expand a flight over the step from a phase; return x - clearance and x' at its end."""
    sine, cosine = sin_cos(phase)
    expand(flight.eq, y, u / pt.omega, sine, cosine, flight.phase_step, c)
    y, slope = value_and_slope(c, 0, 1.0)
    return y, slope / flight.T


@jit
def _land(flight, theta, v, pt, coefficients, M):
    """Follow a flight from an impact; return x - clearance and x' at its end, and set M."""
    M[0, 0], M[0, 1], M[1, 0], M[1, 1] = 1.0, 0.0, 0.0, 1.0
    y, u, eq = 0.0, -pt.R * v, flight.eq
    if not flight.T > 0.0:  # impacts meet at a rest
        return y, u
    of_y, vv = impulse(eq.of_w, eq.of_y, flight.phase_step)
    xx, xv, vx = vv - eq.of_w * of_y, of_y / pt.omega, eq.of_y * of_y * pt.omega
    for k in range(flight.n):
        y, u = _advance(flight, theta + pt.omega * flight.T * k, y, u, pt, coefficients)
        for j in range(2):
            M[0, j], M[1, j] = xx * M[0, j] + xv * M[1, j], vx * M[0, j] + vv * M[1, j]
    return y, u


@inlined
def phase_of_landing(m, X, q, i):
    """Return the phase at the end of flight i."""
    return X[phase_at(0)] + 2.0 * math.pi * m if i + 1 == q else X[phase_at(i + 1)]


@jit
def residuals(pt, m, X, q):
    """Return the residuals of all flights and their derivatives.

    `pt` are the ``Parameters``, X the unknowns (``unknowns.py``), of which free parameters are
    ignored. F, shape (q, 2), is inf if an impact comes before the previous one, or if the
    repetition has more time steps than ``MOST_ORBIT_STEPS``. A and B, shape (q, 2, 2), are the
    derivatives with respect to the impact before the flight and the impact after it.
    """
    F, A, B = zero_rows(q, 2), pairs(q, 2), pairs(q, 2)
    coefficients, M = filled(TERMS, 0.0), zero_rows(2, 2)
    in_order = time_steps(pt, m, 0) <= MOST_ORBIT_STEPS
    for i in range(q):
        in_order = in_order and X[phase_at(i)] <= phase_of_landing(m, X, q, i)
    if not in_order:
        for i in range(q):
            for row in range(2):
                F[i, row] = math.inf
                for j in range(2):
                    A[i, row, j] = B[i, row, j] = math.nan
        return F, A, B
    for i in range(q):
        theta, v = X[phase_at(i)], X[speed_at(i)]
        end, arrival = phase_of_landing(m, X, q, i), X[speed_at((i + 1) % q)]
        tau = (end - theta) / pt.omega
        y, u = _land(_divide(tau, pt, 1), theta, v, pt, coefficients, M)
        push = -pt.p * pt.p * pt.clearance
        launched = 2.0 * pt.h * pt.R * v + push - pt.f * sin_cos(theta)[0]
        landed = -2.0 * pt.h * u - pt.p * pt.p * y + push - pt.f * sin_cos(end)[0]
        F[i, 0], F[i, 1] = y * pt.omega, u - arrival
        for j in range(2):
            scale = pt.omega if j == 0 else 1.0
            A[i, j, 0] = (pt.R * v * M[j, 0] - launched * M[j, 1]) * (scale / pt.omega)
            A[i, j, 1] = -pt.R * M[j, 1] * scale
        B[i, 0, 0], B[i, 0, 1] = u, 0.0
        B[i, 1, 0], B[i, 1, 1] = landed / pt.omega, -1.0
    return F, A, B


@jit
def _without_launch(c, zeros):
    """Divide the polynomial of the first step of a flight by u^zeros, its root at the launch."""
    for j in range(TERMS):
        c[j] = c[j + zeros] if j + zeros < TERMS else 0.0


@jit
def _without_landing(c):
    """Divide the polynomial of the last step of a flight by 1 - u, its root at the landing."""
    total = 0.0
    for j in range(TERMS - 1, 0, -1):
        total -= c[j]
        c[j] = total
    for j in range(TERMS - 1):
        c[j] = c[j + 1]
    c[TERMS - 1] = 0.0


@jit
def zeros_of(R, X, q, i):
    """Return the multiplicities of the roots of flight i at both ends: 1, or 2 at a graze."""
    landing = X[speed_at((i + 1) % q)]
    return 2 if R * X[speed_at(i)] == 0.0 else 1, 2 if landing == 0.0 else 1


@jit
def steps_of(pt, m, X, q, i):
    """Return the number of steps in which flight i is taken."""
    return _divide((phase_of_landing(m, X, q, i) - X[phase_at(i)]) / pt.omega, pt, 1).n


@jit
def polynomials(pt, m, X, q, i, n, zeros):
    """Return x - clearance on flight i, divided by its roots at both ends, and its rounding.

    The flight is taken in at least n steps. `zeros` are the multiplicities of the roots at launch
    and landing that are divided out. The polynomial of each step, shape (n, TERMS), is in powers of
    u from 0 to 1. The rounding, shape (n,), is that of its value.
    """
    theta = X[phase_at(i)]
    flight = _divide((phase_of_landing(m, X, q, i) - theta) / pt.omega, pt, n)
    C, rounding = zero_rows(flight.n, TERMS), filled(flight.n, 0.0)
    y, u = 0.0, -pt.R * X[speed_at(i)]
    for k in range(flight.n):
        y, u = _advance(flight, theta + pt.omega * flight.T * k, y, u, pt, C[k])
        for j in range(TERMS):
            rounding[k] += _ROUNDINGS * flight.n * abs(C[k, j])
    _without_launch(C[0], zeros[0])
    for _ in range(zeros[1]):
        _without_landing(C[flight.n - 1])
    return C, rounding


@jit
def is_below(c):
    """Whether a polynomial is proved negative on [0, 1] by its ends and its second derivative."""
    end, bend = 0.0, 0.0
    for j in range(TERMS):
        end += c[j]
        bend += j * (j - 1) * abs(c[j])
    return larger(c[0], end) + 0.125 * bend < 0.0


@jit
def find_penetration(pt, m, X, q):
    """Find the first flight that meets the stop before its end; arguments as for `residuals`.

    An impact of speed 0 grazes, and is a double root of both its flights. Returns the number of the
    flight; the phase where it meets the stop, or that of its launch if it cannot leave the stop;
    and the greatest local maximum near the stop, divided by the roots of its flight,
    -inf if there is none. The number is -1 if no flight meets the stop. This proves that the orbit
    stays below the stop between its impacts.
    """
    highest = -math.inf
    for i in range(q):
        n = steps_of(pt, m, X, q, i)
        C, rounding = polynomials(pt, m, X, q, i, n, zeros_of(pt.R, X, q, i))
        if C[0, 0] > 0.0:
            return i, X[phase_at(i)], highest
        for k in range(n):
            C[k, 0] -= rounding[k]
            if is_below(C[k]):
                continue
            crossing, maximum = first_crossing(C[k], 0, 1.0)
            highest = larger(highest, maximum)
            if crossing >= 0.0:
                length = phase_of_landing(m, X, q, i) - X[phase_at(i)]
                return i, X[phase_at(i)] + length * (k + crossing) / n, highest
    return -1, 0.0, highest


@jit
def _state_at(pt, theta, v, phase):
    """Return x - clearance and x' at a phase after the impact at phase theta with speed v."""
    flight = _divide((phase - theta) / pt.omega, pt, 1)
    return _land(flight, theta, v, pt, filled(TERMS, 0.0), zero_rows(2, 2))


@jit
def find_turning_point(pt, X, i, phase):
    """Return the phase and x - clearance of the turning point of flight i near a phase."""
    theta, v = X[phase_at(i)], X[speed_at(i)]
    longest = MOST_ORBIT_STEPS * LONGEST_STEP * pt.omega / (2.0 * pt.h + pt.p + pt.omega)
    for _ in range(_MOST_TO_TURN):
        y, u = _state_at(pt, theta, v, phase)
        s = sin_cos(phase)[0]
        a = -2.0 * pt.h * u - pt.p * pt.p * (y + pt.clearance) - pt.f * s
        change = pt.omega * u / a
        if not abs(change) > 1e-12 * (phase - theta):
            return phase, y
        phase -= change
        if phase - theta > longest:  # beyond every flight, perhaps by more steps than can be taken
            return phase, math.nan
    return phase, _state_at(pt, theta, v, phase)[0]


@jit
def set_sections(pt, m, X, q, phase, states):
    """Set x and v of an orbit at omega t = phase mod 2 pi, in time order, (2 m,)."""
    first = X[phase_at(0)]
    for j in range(m):
        at = phase % (2.0 * math.pi) + 2.0 * math.pi * j
        theta, i = first + (at - first) % (2.0 * math.pi * m), 0
        while i + 1 < q and X[phase_at(i + 1)] <= theta:
            i += 1
        y, u = _state_at(pt, X[phase_at(i)], X[speed_at(i)], theta)
        states[2 * j], states[2 * j + 1] = smaller(y + pt.clearance, pt.clearance), u
