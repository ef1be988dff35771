"""Lyapunov exponents: tangent vectors through flights, impacts and rests.

Between impacts the tangent vectors follow the flow's own matrix M. An impact at speed v, where the
acceleration is a_- before and a_+ after it, comes earlier by delta x / v on a neighbouring orbit;
transforming its state back to the common time gives the saltation matrix

    S = [[-R, 0], [(R a_- + a_+) / v, -R]]

with R a_- + a_+ = (1 + R) (-f sin(omega t) - p^2 clearance): the damping cancels. det S = R^2 and
det M = exp(-2 h t), so the exponents add up to -2 h + 2 ln R * (impacts per unit time). A rest
maps every neighbour to the same state: it leaves no tangent vector, and both exponents are -inf.
"""

from __future__ import annotations

import math

from vibroimpact.jit import fma, jit
from vibroimpact.step.flight import value_and_slope
from vibroimpact.step.stop import IMPACT, KIND, SPEED, TIME, pressing
from vibroimpact.step.trigonometry import sin_cos


@jit(leaf=True, internal=True)
def _fly(tangents, dt, T, rows):
    """Carry two tangent vectors, (x, v) after (x, v), over a flight of length `dt` <= `T`."""
    xx, vx = value_and_slope(rows[0], 0, dt / T)
    xv, vv = value_and_slope(rows[1], 0, dt / T)
    for k in range(0, 4, 2):
        x, v = tangents[k], tangents[k + 1]
        tangents[k] = xx * x + xv * v
        tangents[k + 1] = (vx * x + vv * v) / T


@jit(inline=True)
def glide_tangent(x, v, to_x, to_v):
    """Carry one tangent vector over a step without impacts, by the affine map of the step."""
    return fma(to_x[0], x, to_x[1] * v), fma(to_v[0], x, to_v[1] * v)


@jit(leaf=True, internal=True)
def carry_tangents(tangents, to_x, to_v, events, n, theta, T, rows, pt):
    """Carry two tangent vectors through a step with `n` events."""
    if n == 0:
        tangents[0], tangents[1] = glide_tangent(tangents[0], tangents[1], to_x, to_v)
        tangents[2], tangents[3] = glide_tangent(tangents[2], tangents[3], to_x, to_v)
        return
    at = 0.0
    for k in range(n):
        _fly(tangents, events[k, TIME] - at, T, rows)
        at = events[k, TIME]
        if events[k, KIND] == IMPACT:
            speed = max(events[k, SPEED], 1e-150)  # a graze stretches without bound
            turn = (1.0 + pt.R) * pressing(sin_cos(theta + pt.omega * at)[0], pt) / speed
            for j in range(0, 4, 2):
                x, v = tangents[j], tangents[j + 1]
                tangents[j] = -pt.R * x
                tangents[j + 1] = turn * x - pt.R * v
        else:
            for j in range(4):
                tangents[j] = 0.0
    _fly(tangents, T - at, T, rows)


@jit(leaf=True)
def orthonormalise(tangents):
    """Orthonormalise two tangent vectors in place; return the logarithms of their lengths."""
    ax, av, bx, bv = tangents[0], tangents[1], tangents[2], tangents[3]
    a = math.hypot(ax, av)
    if a == 0.0:
        return -math.inf, -math.inf
    ax, av = ax / a, av / a
    area = ax * bv - av * bx  # the second vector is orthogonal to the first: that much is left
    tangents[0], tangents[1] = ax, av
    tangents[2], tangents[3] = (-av, ax) if area >= 0.0 else (av, -ax)
    return math.log(a), math.log(abs(area)) if area != 0.0 else -math.inf
