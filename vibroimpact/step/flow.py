"""The exact flow of one step, in the phase of the force as time.

With the phase theta = omega t as time, every point of a sweep has the same step 2 pi / N. The state
is y = x - clearance, which keeps the digits of short bounces at any clearance, and
w = dy / dtheta = v / omega. Eq. (1) is then

    y'' = of_w w + of_y y + of_sin sin(theta) + of_1,                                          (P)

of_w = -2h / omega, of_y = -p^2 / omega^2, of_sin = -f / omega^2, of_1 = of_y clearance.

**Bound of the fourth derivative.** Without impacts hypot(w, p y / omega) grows by no more than
(|of_sin| + |of_1|) step in a step, damping and impacts only lower it. So with V the sum of |w| and
p |y| / omega at the start of the step, and V_0 that growth, |w| and p |y| / omega stay below
V + V_0, and differentiating (P), with a = -of_w and b = -of_y,

    |y''|   <= A_2 = (a + sqrt(b)) (V + V_0) + |of_sin| + |of_1|,
    |y'''|  <= A_3 = a A_2 + b (V + V_0) + |of_sin|,
    |y''''| <= A_4 = a A_3 + b A_2 + |of_sin|,

all linear in V. ``Equation.bend_v`` and ``bend_1`` are the factors of V and 1 in A_4 step^4 / 72.

**A curve below the stop.** Let a curve run from (y_0, w_0) to (y_1, w_1) in the time t, and
E = A_4 t^4 / 72. It differs from its cubic Hermite interpolant by y''''(xi) s^2 (t - s)^2 / 24, and
so it is below the quartic with the Bernstein coefficients

    y_0,  (4 y_0 + w_0 t) / 4,  (y_0 + y_1 + (w_0 - w_1) t / 3 + E) / 2,  (4 y_1 - w_1 t) / 4,  y_1.

Where none of these is positive and one inside is negative, the curve is below the stop between its
ends. The **guard** is a bound of them all over a whole step: with P = y_0 + w_0 step / 3 and
Q = y_1 - w_1 step / 3, a step from y_0 <= 0 is safe if max(P, Q) + E / 2 < 0 and y_1 < 0. A share
``SLACK`` of what the step covers is added to it, for rounding, and so that no near graze is safe.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from vibroimpact.jit import fma, jit
from vibroimpact.step.flight import expand, value_and_slope

#: The guard keeps this share of what a step covers away from the stop.
SLACK = 1e-8

#: 1 / k!, the coefficients of the exponential series.
INVERSE_FACTORIALS = tuple(1.0 / math.factorial(k) for k in range(21))


class Equation(NamedTuple):
    """Equation (P) of one parameter point, and the bound of the fourth derivative over a step.

    ``root`` is p / omega.
    """

    of_w: float
    of_y: float
    of_sin: float
    of_1: float
    R: float
    root: float
    bend_v: float
    bend_1: float


class Flow(NamedTuple):
    """The map of a step without impacts, and the guard.

    y_T - y = yy y + yw w + ys sin(theta) + yc cos(theta) + y1, and the same for w_T - w: with the
    differences, what rounding leaves of the map does not add up over many short steps.
    """

    yy: float
    yw: float
    ys: float
    yc: float
    y1: float
    wy: float
    ww: float
    ws: float
    wc: float
    w1: float
    guard_y: float
    guard_1: float


@jit
def equation_of(pt, step):
    """Return the ``Equation`` of a parameter point for steps of that length."""
    ww = pt.omega * pt.omega
    a, b, f = 2.0 * pt.h / pt.omega, pt.p * pt.p / ww, pt.f / ww
    load = pt.p * pt.p * pt.clearance / ww
    root, greatest = pt.p / pt.omega, f + abs(load)
    # The factors of V and of 1 in the bounds of the derivatives.
    V_0 = greatest * step
    two_V, two_1 = a + root, (a + root) * V_0 + greatest
    three_V, three_1 = a * two_V + b, a * two_1 + b * V_0 + f
    share = step**4 / 72.0 * (1.0 + 1e-9)  # rounded up
    bend_v = share * (a * three_V + b * two_V)
    return Equation(
        -a, -b, -f, -load, pt.R, root, bend_v, share * (a * three_1 + b * two_1 + f)
    )  # fmt: skip


@jit
def flow_of(eq, step, c):
    """Return the ``Flow`` of steps of that length; `c` is memory for the terms of a series."""
    free = Equation(eq.of_w, eq.of_y, eq.of_sin, 0.0, eq.R, eq.root, eq.bend_v, eq.bend_1)
    expand(free, 1.0, 0.0, 0.0, 0.0, step, c)
    c[0] = 0.0
    yy, wy = value_and_slope(c, 0, 1.0)
    expand(free, 0.0, 1.0, 0.0, 0.0, step, c)
    yw, _ = value_and_slope(c, 0, 1.0)
    c[1] = 0.0
    _, ww = value_and_slope(c, 0, 1.0)
    expand(free, 0.0, 0.0, 1.0, 0.0, step, c)
    ys, ws = value_and_slope(c, 0, 1.0)
    expand(free, 0.0, 0.0, 0.0, 1.0, step, c)
    yc, wc = value_and_slope(c, 0, 1.0)
    expand(eq, 0.0, 0.0, 0.0, 0.0, step, c)
    y1, w1 = value_and_slope(c, 0, 1.0)
    greatest = abs(eq.of_sin) + abs(eq.of_1)
    guard_y = 0.5 * eq.bend_v * (1.0 + eq.root) + SLACK
    guard_1 = 0.5 * eq.bend_1 + SLACK * greatest * step * step
    return Flow(
        yy, yw, ys, yc, y1, wy / step, ww / step, ws / step, wc / step, w1 / step, guard_y, guard_1
    )


@jit(inline=True)
def glide(flow, y, w, s, c, third):
    """Take a state at phase (s, c) over a step as if there were no stop.

    Parameters
    ----------
    third : float
        A third of the step.

    Returns
    -------
    y_T, w_T : float
    high : float
        Below 0 only where the mass cannot have met the stop in the step.
    """
    y_T = y + fma(flow.yy, y, fma(flow.yw, w, fma(flow.ys, s, fma(flow.yc, c, flow.y1))))
    w_T = w + fma(flow.wy, y, fma(flow.ww, w, fma(flow.ws, s, fma(flow.wc, c, flow.w1))))
    band = fma(max(abs(y), abs(w)), flow.guard_y, flow.guard_1)
    return y_T, w_T, max(max(fma(third, w, y), fma(-third, w_T, y_T)) + band, y_T)


@jit(inline=True)
def enter(x, v, pt):
    """Return the state (y, w) of (x, v)."""
    return x - pt.clearance, v / pt.omega


@jit(inline=True)
def leave(y, w, pt):
    """Return the state (x, v) of (y, w)."""
    return y + pt.clearance, w * pt.omega


@jit(inline=True)
def bend(eq, y, w):
    """Return A_4 step^4 / 72 for a step from (y, w)."""
    return fma(eq.bend_v, fma(eq.root, abs(y), abs(w)), eq.bend_1)


@jit(forced_inline=True)
def impulse(of_w, of_y, r):
    """Return the response of y and of w to a unit impulse, after the time `r` of at most a step.

    exp(-a r / 2) times sin(k r) / k and its derivative, k^2 = b - a^2 / 4 of any sign: by series
    in z = -k^2 r^2, |z| <= 1.72, so that critical damping is not special.
    """
    h, F = -0.5 * of_w, INVERSE_FACTORIALS
    z, x = fma(h, h, of_y) * (r * r), -h * r
    e = fma(x, F[16], F[15])
    e = fma(fma(fma(e, x, F[14]), x, F[13]), x, F[12])
    e = fma(fma(fma(e, x, F[11]), x, F[10]), x, F[9])
    e = fma(fma(fma(e, x, F[8]), x, F[7]), x, F[6])
    e = fma(fma(fma(e, x, F[5]), x, F[4]), x, F[3])
    e = fma(fma(fma(e, x, F[2]), x, 1.0), x, 1.0)
    s, c = fma(z, F[19], F[17]), fma(z, F[20], F[18])
    s, c = fma(s, z, F[15]), fma(c, z, F[16])
    s, c = fma(s, z, F[13]), fma(c, z, F[14])
    s, c = fma(s, z, F[11]), fma(c, z, F[12])
    s, c = fma(s, z, F[9]), fma(c, z, F[10])
    s, c = fma(s, z, F[7]), fma(c, z, F[8])
    s, c = fma(s, z, F[5]), fma(c, z, F[6])
    s, c = fma(s, z, F[3]), fma(c, z, F[4])
    s, c = fma(s, z, 1.0) * r, fma(c, z, F[2])
    return e * s, e * fma(-h, s, fma(c, z, 1.0))
