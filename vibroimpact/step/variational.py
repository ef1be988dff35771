"""Carries a tangent vector through flights, impacts (saltation), rests: Lyapunov exponents.

Between impacts a tangent vector follows the matrix M of the flow. Let an impact have the speed v,
the acceleration a_- before and a_+ after it. On a neighbouring orbit it comes earlier by
delta x / v; transforming the state back to the common time gives the saltation matrix

    S = [[-R, 0], [(R a_- + a_+) / v, -R]]

with R a_- + a_+ = (1 + R) (-f sin(omega t) - p^2 clearance): the damping cancels. det S = R^2 and
det M = exp(-2 h t), so the exponents add up to -2 h + 2 ln R * (impacts per unit time). This gives
the second one: the area between two vectors would lose its digits at every graze. A rest maps every
neighbour to the same state: no tangent vector remains, and both exponents are -inf. An impact with
R = 0 maps all neighbours onto a line: the second exponent is -inf.

Lengths are measured in the norm dx^2 + (dv / p)^2 at both ends of a record, so that exponents do
not depend on the units. Between them (y, w) have the same unit.
"""

from __future__ import annotations

from vibroimpact.jit import fma, inlined, jit
from vibroimpact.step.contact import IMPACT, KIND, REST, SPEED, TIME
from vibroimpact.step.elementary import sin_cos
from vibroimpact.step.propagator import impulse


@inlined
def propagate_tangent(M, tangent):
    """Carry a tangent vector (y, w) over a step without impacts by its ``Propagator`` M."""
    y, w = tangent
    return y + fma(M.yy, y, M.yw * w), w + fma(M.wy, y, M.ww * w)


@inlined
def fly_tangent(eq, tangent, dt):
    """Carry a tangent vector over a flight of length `dt`, of at most a step."""
    y, w = tangent
    of_y, of_w = impulse(eq.of_w, eq.of_y, dt)
    return fma(fma(-eq.of_w, of_y, of_w), y, of_y * w), fma(eq.of_y * of_y, y, of_w * w)


@inlined
def apply_saltation(eq, tangent, w_i, s):
    """Carry a tangent vector through an impact at `w_i` and a phase with the sine `s`."""
    y, w = tangent
    # The limit keeps the stretching by a graze finite. It is a share of the acceleration, since
    # motions with a force of 1e-200 are as good as any.
    least = fma(abs(eq.of_sin) + abs(eq.of_1), 1e-150, 1e-307)
    turn = (1.0 + eq.R) * fma(eq.of_sin, s, eq.of_1) / max(w_i, least)
    return -eq.R * y, fma(turn, y, -eq.R * w)


@inlined
def tangent_after_impact(eq, tangent, flight, wave):
    """Carry a tangent vector through a flight and the impact that ends it.

    `flight` is its length, the phase since the start of the step at its end, and w there; `wave` is
    sine and cosine of the phase at the start of the step.
    """
    length, at, w_i = flight
    sin, cos = sin_cos(at)
    tangent = fly_tangent(eq, tangent, length)
    return apply_saltation(eq, tangent, w_i, wave[0] * cos + wave[1] * sin)


@jit
def carry_tangents(prepared, pair, events, n, begin, theta, phase_step, omega):
    """Carry two tangent vectors (y, w) through a step with `n` events, from the phase `theta`.

    They are those at the time `begin` of the step, as a phase; the events come after it.
    """
    (eq, propagator), (a, b) = prepared, pair
    if n == 0 and begin == 0.0:
        return propagate_tangent(propagator, a), propagate_tangent(propagator, b)
    at = begin
    for k in range(n):
        dt, at = events[k, TIME] * omega - at, events[k, TIME] * omega
        a, b = fly_tangent(eq, a, dt), fly_tangent(eq, b, dt)
        if events[k, KIND] == IMPACT:
            speed, s = events[k, SPEED] / omega, sin_cos(theta + at)[0]
            a, b = apply_saltation(eq, a, speed, s), apply_saltation(eq, b, speed, s)
        elif events[k, KIND] == REST:
            a = b = 0.0, 0.0
    left = max(phase_step - at, 0.0)
    return fly_tangent(eq, a, left), fly_tangent(eq, b, left)
