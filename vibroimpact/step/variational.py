"""Lyapunov exponents: tangent vectors through flights, impacts and rests.

Between impacts the tangent vectors follow the matrix M of the flow. Let an impact have the speed v,
the acceleration a_- before and a_+ after it. On a neighbouring orbit it comes earlier by
delta x / v; transforming the state back to the common time gives the saltation matrix

    S = [[-R, 0], [(R a_- + a_+) / v, -R]]

with R a_- + a_+ = (1 + R) (-f sin(omega t) - p^2 clearance): the damping cancels. det S = R^2 and
det M = exp(-2 h t), so the exponents add up to -2 h + 2 ln R * (impacts per unit time). A rest
maps every neighbour to the same state: no tangent vector remains, and both exponents are -inf.
An impact with R = 0 maps all neighbours onto a line: the second exponent is -inf.

Lengths are measured in the norm dx^2 + (dv / p)^2 at both ends of a record, so that exponents do
not depend on the units. Between them (y, w) have the same unit.
"""

from __future__ import annotations

import math

from vibroimpact.jit import fma, inlined, jit
from vibroimpact.step.contact import IMPACT, KIND, SPEED, TIME
from vibroimpact.step.elementary import hypot, log, sin_cos
from vibroimpact.step.propagator import impulse


@inlined
def propagate_tangents(M, pair):
    """Carry two tangent vectors (y, w) over a step without impacts by its ``Propagator`` M."""
    ay, aw, by, bw = pair
    return (
        ay + fma(M.yy, ay, M.yw * aw), aw + fma(M.wy, ay, M.ww * aw),
        by + fma(M.yy, by, M.yw * bw), bw + fma(M.wy, by, M.ww * bw),
    )  # fmt: skip


@inlined
def fly_tangents(eq, pair, dt):
    """Carry two tangent vectors over a flight of length `dt`, of at most a step."""
    ay, aw, by, bw = pair
    of_y, of_w = impulse(eq.of_w, eq.of_y, dt)
    yy, wy = fma(-eq.of_w, of_y, of_w), eq.of_y * of_y
    return (
        fma(yy, ay, of_y * aw), fma(wy, ay, of_w * aw),
        fma(yy, by, of_y * bw), fma(wy, by, of_w * bw),
    )  # fmt: skip


@inlined
def apply_saltation(eq, pair, w_i, s):
    """Carry two tangent vectors through an impact at `w_i` and a phase with the sine `s`."""
    ay, aw, by, bw = pair
    # The limit keeps the stretching by a graze finite. It is a share of the acceleration, since
    # motions with a force of 1e-200 are as good as any.
    least = fma(abs(eq.of_sin) + abs(eq.of_1), 1e-150, 1e-307)
    turn = (1.0 + eq.R) * fma(eq.of_sin, s, eq.of_1) / max(w_i, least)
    return (-eq.R * ay, fma(turn, ay, -eq.R * aw), -eq.R * by, fma(turn, by, -eq.R * bw))


@inlined
def tangents_after_impact(eq, pair, flight, wave):
    """Carry two tangent vectors through a flight and the impact that ends it.

    `flight` is its length, the phase since the start of the step at its end, and w there; `wave` is
    sine and cosine of the phase at the start of the step.
    """
    length, at, w_i = flight
    sin, cos = sin_cos(at)
    pair = fly_tangents(eq, pair, length)
    return apply_saltation(eq, pair, w_i, wave[0] * cos + wave[1] * sin)


@jit
def carry_tangents(prepared, pair, events, n, begin, theta, phase_step, omega):
    """Carry two tangent vectors (y, w) through a step with `n` events, from the phase `theta`.

    They are those at the time `begin` of the step, as a phase; the events come after it.
    """
    eq, propagator = prepared
    if n == 0 and begin == 0.0:
        return propagate_tangents(propagator, pair)
    at = begin
    for k in range(n):
        u = events[k, TIME] * omega
        pair, at = fly_tangents(eq, pair, u - at), u
        if events[k, KIND] == IMPACT:
            pair = apply_saltation(eq, pair, events[k, SPEED] / omega, sin_cos(theta + at)[0])
        else:
            pair = 0.0, 0.0, 0.0, 0.0
    return fly_tangents(eq, pair, max(phase_step - at, 0.0))


@jit
def orthonormalise(pair):
    """Orthonormalise two tangent vectors; return them, and the logarithms of their lengths."""
    ax, av, bx, bv = pair
    a = hypot(ax, av)
    if a == 0.0:
        return pair, -math.inf, -math.inf
    ax, av = ax / a, av / a
    area = ax * bv - av * bx  # length of the part of the second vector orthogonal to the first
    second = (-av, ax) if area >= 0.0 else (av, -ax)
    growth = log(abs(area)) if area != 0.0 else -math.inf
    return (ax, av, second[0], second[1]), log(a), growth
