"""`Propagator`, the exact map of a step without impacts; its guard; free oscillation.

With the phase theta = omega t as time, every point of a sweep has the same step 2 pi / N. The state
is y = x - clearance, which keeps the digits of short bounces at any clearance, and
w = dy / dtheta = v / omega. Eq. (1) is then

    y'' = of_w w + of_y y + of_sin sin(theta) + of_1,                                          (P)

of_w = -2h / omega, of_y = -p^2 / omega^2, of_sin = -f / omega^2, of_1 = of_y clearance.

**Bound of the fourth derivative.** In one step without impacts, hypot(w, p y / omega) grows by at
most V_0 = (|of_sin| + |of_1|) step; damping and impacts only lower it. Let V be the sum of |w| and
p |y| / omega at the start of the step. Then |w| and p |y| / omega stay below V + V_0.
Differentiating (P) gives, with a = -of_w and b = -of_y,

    |y''|   <= A_2 = (a + sqrt(b)) (V + V_0) + |of_sin| + |of_1|,
    |y'''|  <= A_3 = a A_2 + b (V + V_0) + |of_sin|,
    |y''''| <= A_4 = a A_3 + b A_2 + |of_sin|,

all linear in V.

**A curve below the stop.** Let a curve run from (y_0, w_0) to (y_1, w_1) in the time t, and let
E = A_4 t^4 / 72. The curve differs from its cubic Hermite interpolant by
y''''(xi) s^2 (t - s)^2 / 24, so it lies below the quartic with the Bernstein coefficients

    y_0,  (4 y_0 + w_0 t) / 4,  (y_0 + y_1 + (w_0 - w_1) t / 3 + E) / 2,  (4 y_1 - w_1 t) / 4,  y_1.

If none of them is positive and one of the inner three is negative, the curve is below the stop
between its ends. The **guard** bounds all of them over a whole step: with P = y_0 + w_0 step / 3
and Q = y_1 - w_1 step / 3, a step from y_0 <= 0 is safe if max(P, Q) + E / 2 < 0 and y_1 < 0.

All proofs use the remainder bound of ``propagate``: the E of a whole step, plus a slack for
rounding of 2 ``SLACK`` times |y| + |w| + S. The ``extent`` S of the motion does not depend on the
step. The slack also keeps a near graze from being taken for safe. The bound of a part t of the step
is that of the whole step times (t / step)^4.

In a step without impact, x follows (P) without of_1, and so has such a bound, too, with |x| instead
of |y|. A distant stop does not make it large, so turning points are proved by it.

**Near the free oscillation** Y, of the amplitude A. Let a motion be free, and let y - Y be d, which
follows eq. (P) without force. In the norm hypot(d, d' omega / p) it does not grow. If |d'| and
|d| p / omega are below 2^-27 A at a section, the motion then turns where Y does, at a height that
differs from that of Y + d there by d'^2 / (2 A), less than half a unit in the last place. So both
turns of a period are linear forms of d at its section.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from vibroimpact.jit import fma, inlined, jit
from vibroimpact.step.elementary import asin
from vibroimpact.step.polynomial import expand, value_and_slope
from vibroimpact.step.scheme import COS, SIN

#: A curve is proved to be below the stop only if it stays away from the stop by this share of
#: |y| + |w| + S.
SLACK = 1e-8
# Of a motion near the free oscillation, w differs by less than this share of the amplitude.
_NEAR = 2.0**-27
# Rounding of a step, as a share of a displacement.
_ROUNDING = 2.0**-52

#: 1 / k!, the coefficients of the exponential series.
INVERSE_FACTORIALS = tuple(1.0 / math.factorial(k) for k in range(21))


class Coefficients(NamedTuple):
    """The coefficients of equation (P) for one parameter point."""

    of_w: float
    of_y: float
    of_sin: float
    of_1: float
    R: float


class Propagator(NamedTuple):
    """The map of a step without impacts and force, and the factors of its remainder bound.

    The map gives the changes y_T - y = yy y + yw w and w_T - w = wy y + ww w, so that its rounding
    errors do not add up over many short steps. The factors are those of |y|, |w| and 1.
    """

    yy: float
    yw: float
    wy: float
    ww: float
    bound_y: float
    bound_w: float
    bound_1: float


class Forcing(NamedTuple):
    """What force and clearance add to y in a step: ys sin(theta) + yc cos(theta) + y1; w alike."""

    ys: float
    yc: float
    y1: float
    ws: float
    wc: float
    w1: float


@jit
def coefficients_of(pt):
    """Return the ``Coefficients`` of a parameter point."""
    ww, pp = pt.omega * pt.omega, pt.p * pt.p
    return Coefficients(-2.0 * pt.h / pt.omega, -pp / ww, -pt.f / ww, -pp * pt.clearance / ww, pt.R)


@inlined
def extent(eq):
    """Return (f + p^2 |clearance|) / (omega^2 + 2 h omega + p^2), the extent of the motion.

    A free oscillation that touches the stop has an amplitude of half to twice the extent.
    """
    return (abs(eq.of_sin) + abs(eq.of_1)) / (1.0 - eq.of_w - eq.of_y)


@jit
def propagator_of(eq, phase_step, c):
    """Return ``Propagator`` and ``Forcing`` of a `phase_step`; `c` is scratch memory."""
    unloaded = Coefficients(eq.of_w, eq.of_y, eq.of_sin, 0.0, eq.R)
    expand(unloaded, 1.0, 0.0, 0.0, 0.0, phase_step, c)
    c[0] = 0.0
    yy, wy = value_and_slope(c, 0, 1.0)
    expand(unloaded, 0.0, 1.0, 0.0, 0.0, phase_step, c)
    yw, _ = value_and_slope(c, 0, 1.0)
    c[1] = 0.0
    _, ww = value_and_slope(c, 0, 1.0)
    expand(unloaded, 0.0, 0.0, 1.0, 0.0, phase_step, c)
    ys, ws = value_and_slope(c, 0, 1.0)
    expand(unloaded, 0.0, 0.0, 0.0, 1.0, phase_step, c)
    yc, wc = value_and_slope(c, 0, 1.0)
    expand(eq, 0.0, 0.0, 0.0, 0.0, phase_step, c)
    y1, w1 = value_and_slope(c, 0, 1.0)
    bound_y, bound_w, bound_1 = bound_factors(eq, abs(eq.of_1), phase_step)
    propagator = Propagator(yy, yw, wy / phase_step, ww / phase_step, bound_y, bound_w, bound_1)
    return propagator, Forcing(ys, yc, y1, ws / phase_step, wc / phase_step, w1 / phase_step)


@inlined
def bound_factors(eq, load, phase_step):
    """Return the factors of |y|, |w| and 1 in the remainder bound of a whole step.

    The `load` is |of_1|, or 0 for factors of |x|, |w| and 1.
    """
    a, b, f = -eq.of_w, -eq.of_y, -eq.of_sin
    root, greatest = math.sqrt(b), f + load
    # The factors of V and of 1 in the bounds of the derivatives.
    V_0 = greatest * phase_step
    two_V, two_1 = a + root, (a + root) * V_0 + greatest
    three_V, three_1 = a * two_V + b, a * two_1 + b * V_0 + f
    share = phase_step**4 / 72.0 * (1.0 + 1e-9)  # rounded up
    of_V, of_1 = share * (a * three_V + b * two_V), share * (a * three_1 + b * two_1 + f)
    slack = 2.0 * SLACK
    return of_V * root + slack, of_V + slack, of_1 + slack * extent(eq)


@inlined
def forced(forcing, s, c):
    """Return what a step from the phase with sine `s` and cosine `c` adds to y and w."""
    added_y = fma(forcing.ys, s, fma(forcing.yc, c, forcing.y1))
    return added_y, fma(forcing.ws, s, fma(forcing.wc, c, forcing.w1))


@inlined
def remainder_bound(factors, y, w):
    """Return the remainder bound of a whole step from a state, by its ``bound_factors``."""
    of_y, of_w, of_1 = factors
    return fma(of_w, abs(w), fma(of_y, abs(y), of_1))


@inlined
def propagate(propagator, y, w, added, phase_step):
    """Take a state over a step as if there were no stop; return y_T, w_T, and bounds of its flight.

    `added` is from ``forced``. The bounds are the remainder bound, the guard and the floor: apart
    from its ends, the flight is between floor and guard. A guard below 0 proves that the mass did
    not meet the stop.
    """
    third = phase_step * (1.0 / 3.0)
    y_T = y + fma(propagator.yy, y, fma(propagator.yw, w, added[0]))
    w_T = w + fma(propagator.wy, y, fma(propagator.ww, w, added[1]))
    bound = remainder_bound((propagator.bound_y, propagator.bound_w, propagator.bound_1), y, w)
    P, Q = fma(third, w, y), fma(-third, w_T, y_T)
    guard = max(fma(0.5, bound, max(P, Q)), y_T)
    return y_T, w_T, bound, guard, fma(-0.5, bound, min(P, Q))


@inlined
def to_dimensionless(x, v, clearance, omega):
    """Return the state (y, w) for (x, v)."""
    return x - clearance, v / omega


@inlined
def from_dimensionless(y, w, clearance, omega):
    """Return the state (x, v) for (y, w)."""
    return y + clearance, w * omega


@inlined
def impulse(of_w, of_y, r):
    """Return the response of y and of w to a unit impulse, after the time `r` of at most a step.

    The response is exp(-a r / 2) sin(k r) / k and its derivative, with k^2 = b - a^2 / 4 of any
    sign. The series in z = -k^2 r^2, |z| <= 1.72, needs no special case at critical damping.
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


@jit
def steady_response(pt, sine, cosine):
    """Return the state (x, v) of the free oscillation at a phase, and its amplitude.

    x = Im X exp(i omega t) with X = -f / (p^2 - omega^2 + 2 i h omega).
    """
    real, imaginary = (pt.p - pt.omega) * (pt.p + pt.omega), 2.0 * pt.h * pt.omega
    if pt.f == 0.0:
        return 0.0, 0.0, 0.0
    # In a unit of a power of two, which changes no digit, no square overflows or vanishes.
    size, unit = math.frexp(max(abs(real), abs(imaginary)))
    if not 0.0 < size < math.inf:
        return math.inf, math.inf, math.inf
    real, imaginary = math.ldexp(real, -unit), math.ldexp(imaginary, -unit)
    square, force = real * real + imaginary * imaginary, math.ldexp(pt.f, -unit)
    x = -force / square * (real * sine - imaginary * cosine)
    v = -force * pt.omega / square * (real * cosine + imaginary * sine)
    return x, v, force / math.sqrt(square)


class Steady(NamedTuple):
    """The free oscillation of a point."""

    y: float  #: Its state at the section.
    w: float
    low: float  #: Its least and greatest y.
    high: float
    rounding: float  #: By so much a motion may differ from it by rounding.
    ratio: float  #: omega / p
    limit: float  #: By how much w may differ from it in a motion near it.


@jit
def steady_of(pt, grid):
    """Return the ``Steady`` of a point for the sections of a grid."""
    x, v, amplitude = steady_response(pt, grid.table[SIN, 0], grid.table[COS, 0])
    ratio, clearance, limit = pt.omega / pt.p, pt.clearance, _NEAR * amplitude
    # Each step may be wrong by a rounding error, which is damped from then on.
    rounding = _ROUNDING * grid.size * (1.0 + 0.2 * pt.omega / pt.h) * (amplitude + abs(clearance))
    if not amplitude + 2.0 * ratio * limit + rounding < clearance:
        limit = 0.0
    low, high = -amplitude - clearance, amplitude - clearance
    return Steady(x - clearance, v / pt.omega, low, high, rounding, ratio, limit)


@inlined
def is_near(steady, y, w):
    """Whether a motion from a state at a section is near its free oscillation."""
    near = abs(w - steady.w) < steady.limit
    return near & (abs(y - steady.y) < steady.ratio * steady.limit)


@inlined
def stays_within(steady, y, w, extremes):
    """Whether a motion from a state at a section never widens its extremes again.

    In the norm hypot(y, omega w / p) a motion comes ever nearer to the free oscillation, as long as
    it is free; and it is free if its extremes include the free oscillation and this distance.
    """
    room = min(steady.low - extremes[0], extremes[1] - steady.high) - steady.rounding
    off, rate = y - steady.y, steady.ratio * (w - steady.w)
    return (room > 0.0) & (room * room > fma(off, off, rate * rate))


@jit
def _response_after(eq, phase, phase_step):
    """Return the factors of y and w in the y that follows from them after a `phase`."""
    doublings = 0
    while phase > phase_step:
        phase, doublings = 0.5 * phase, doublings + 1
    y, w = impulse(eq.of_w, eq.of_y, phase)
    for _ in range(doublings):
        y, w = y * fma(-eq.of_w, y, 2.0 * w), fma(eq.of_y * y, y, w * w)
    return fma(-eq.of_w, y, w), y


@jit
def turns_near(eq, steady, phase_step):
    """Return the linear forms of the lowest and the highest point of motions near ``Steady``."""
    share = (2.0 * steady.y - steady.high - steady.low) / (steady.high - steady.low)
    angle, rises = asin(min(max(share, -1.0), 1.0)), steady.w >= 0.0
    turn = 0.5 * math.pi - (angle if rises else -angle)
    lowest = _response_after(eq, turn + math.pi if rises else turn, phase_step)
    return lowest, _response_after(eq, turn if rises else turn + math.pi, phase_step)
