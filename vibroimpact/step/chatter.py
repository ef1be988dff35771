"""Rebounds that return soon, and the sum of a chatter.

- A rebound that returns within half a step: its series is divided by the root at its start,
  Halley's method finds the next root, and the Bernstein coefficients of ``propagator.py`` prove
  that no root lies between.
- A short bounce: the reversion of its series (Abramowitz and Stegun, 3.6.25), and one iteration of
  Newton's method.

**Chatter.** Let a be the acceleration that presses the mass at rest, epsilon = v / a after a
rebound at speed v, and beta = a' / a = -f omega cos(omega t) / a. Expand one flight and one impact
in epsilon: the flight takes 2 epsilon (1 - 2/3 (beta + h) epsilon), and the next epsilon is R
epsilon (1 - 4/3 (beta + h) epsilon). The first terms are the geometric series of Budd and Dux
(1994); the sum over all flights is, with eta = epsilon / (1 - R),

    time to rest = 2 eta - 4/3 (beta + h) eta^2 + O(eta^3).

The sum replaces the flights once eta is so small that the neglected term is below rounding. With
R near 1 this takes more bounces than can be followed, and at R = 1 the bounces never end.
"""

from __future__ import annotations

import math

from vibroimpact.jit import fma, inlined, jit
from vibroimpact.status import Status
from vibroimpact.step.contact import pressing, time_to_release
from vibroimpact.step.elementary import sin_cos
from vibroimpact.step.impact import all_terms, series

# The tail of a chatter is summed when eta times the rates of the system is below this. The
# neglected third-order term, relative to the first, is of the order of the square of this product.
_SHORTEST_TAIL = 1e-5
# Above this R a chatter takes too many bounces to follow, or never ends. Bounces whose epsilon
# times the rates of the system is below ``_SHORTEST_BOUNCE`` are then taken for rest, and the point
# is not certified: Status.CUT_SHORT.
_ENDLESS = 0.999
_SHORTEST_BOUNCE = 1e-3
# A bounce is short if its length times the rates of the system is below ``_SHORT``: its series up
# to the eighth power is enough. Below ``_SHORTEST`` the terms of the reversion alone are enough.
_SHORT, _SHORTEST = 0.03, 1e-3

_CERTIFIED, _CUT_SHORT = int(Status.CERTIFIED), int(Status.CUT_SHORT)


@inlined
def rates_of(eq):
    """Return the sum of the rates of the system, (2h + p + omega) / omega."""
    return math.sqrt(-eq.of_y) - eq.of_w + 1.0


@inlined
def is_first(w, w_i, t, bound, phase_step):
    """Whether the return at `t` is proved to be the first of a flight from the stop with w < 0."""
    n = t / phase_step
    n *= n
    return (w_i > 0.0) & (fma(bound, n * n, (w - w_i) * t * (1.0 / 3.0)) < 0.0)


@jit
def bounce(eq, launch, phase_step):
    """Return the length of a rebound that returns within half a step, and w at its end.

    They are -1 and 0 if no return is found. `is_first` proves that it is the first.
    """
    w = launch.w
    k = series(eq, 0.0, w, launch.s, launch.c)
    rest = (*k[1:], 0.0)
    t = -w / k[2]
    t *= 2.0 / (1.0 + math.sqrt(1.0 + 4.0 * t * k[3] / k[2]))  # NaN if the parabola has no root
    for _ in range(6):
        if not 0.0 < t < 0.5 * phase_step:
            break
        g, d, e = all_terms(rest, t)
        newton = g / d
        change = fma(newton * newton, e / d, newton)
        t -= change
        # Relative to t, the next change would be about the cube of this one; the change of the
        # slope would be about its square.
        if abs(change) <= 1e-6 * t:
            return t, t * fma(-2.0 * e, change, d)
    return -1.0, 0.0


@jit
def short_bounce(eq, launch):
    """As ``bounce``, for a short rebound, by series reversion; -1 and 0 if it is not short."""
    w, fs, fc = launch.w, eq.of_sin * launch.s, eq.of_sin * launch.c
    rates = rates_of(eq)
    a, b = eq.of_w, eq.of_y
    d2 = fma(a, w, fs + eq.of_1)
    d3 = fma(a, d2, fma(b, w, fc))
    inverse = 1.0 / d2
    tau = -2.0 * w * inverse
    x = tau * fma(abs(d3), inverse, rates)
    xx = tau * tau * abs(eq.of_sin) * inverse
    if not (d2 > 0.0 and x < _SHORT and xx < _SHORT * _SHORT):
        return -1.0, 0.0
    d4 = fma(a, d3, fma(b, d2, -fs))
    d5 = fma(a, d4, fma(b, d3, -fc))
    d6 = fma(a, d5, fma(b, d4, fs))
    d7 = fma(a, d6, fma(b, d5, fc))
    d8 = fma(a, d7, fma(b, d6, -fs))
    # y = d2 / 2 t (t - tau + k1 t^2 + k2 t^3 + ...)
    k1, k2, k3 = d3 * inverse / 3.0, d4 * inverse / 12.0, d5 * inverse / 60.0
    k4, kk = d6 * inverse / 360.0, k1 * k1
    c3, c4 = 2.0 * kk - k2, 5.0 * k1 * (k2 - kk) - k3
    c5 = kk * (14.0 * kk - 21.0 * k2) + 6.0 * k1 * k3 + 3.0 * k2 * k2 - k4
    t = tau * fma(tau, fma(tau, fma(tau, fma(tau, c5, c4), c3), -k1), 1.0)
    if x > _SHORTEST or xx > _SHORTEST * _SHORTEST:
        k5, k6 = d7 * inverse / 2520.0, d8 * inverse / 20160.0
        g = fma(t, fma(t, fma(t, fma(t, fma(t, k6, k5), k4), k3), k2), k1)
        slope = fma(
            t, fma(t, fma(t, fma(t, fma(t, 7.0 * k6, 6.0 * k5), 5.0 * k4), 4.0 * k3), 3.0 * k2),
            2.0 * k1,
        )  # fmt: skip
        t -= (fma(t, fma(t, g, 1.0), -tau)) / fma(t, slope, 1.0)
    w_i = fma(t, fma(t, fma(t, d8 / 5040.0, d7 / 720.0), d6 / 120.0), d5 / 24.0)
    w_i = fma(t, fma(t, fma(t, w_i, d4 / 6.0), 0.5 * d3), d2)
    return t, fma(t, w_i, w)


@inlined
def wave_after(s, c, dtheta, theta):
    """Return sine and cosine of the phase `theta`, given those of theta - dtheta, `s` and `c`."""
    if dtheta >= _SHORT:
        return sin_cos(theta)
    z = dtheta * dtheta
    sin = dtheta * fma(z, fma(z, fma(z, -1.0 / 5040.0, 1.0 / 120.0), -1.0 / 6.0), 1.0)
    cos = fma(z, fma(z, fma(z, -1.0 / 720.0, 1.0 / 24.0), -0.5), 1.0)
    return fma(s, cos, c * sin), fma(c, cos, -s * sin)


@jit
def time_to_rest(v, theta, s, c, left, pt):
    """Return the time until the chatter after a rebound at speed `v` is complete, and the status.

    The chatter begins at phase `theta`, with sine `s` and cosine `c`. The time is inf if the
    chatter is not complete within the time `left`, or if its sum is not yet exact to rounding. If R
    is so near to 1 that the chatter would take too many bounces, the time is 0 once the bounces are
    short, and the status is ``CUT_SHORT``.
    """
    a = pressing(s, pt)
    if not a > 0.0:
        return math.inf, _CERTIFIED
    if v == 0.0:
        return 0.0, _CERTIFIED
    beta = -pt.f * pt.omega * c / a
    # The rates of the system; one of them is sqrt(|a''| / a), a'' / a = f omega^2 sin(omega t) / a.
    rates = abs(beta) + pt.h + pt.p + pt.omega * (1.0 + math.sqrt(pt.f / a))
    shortness = rates * v / a
    if pt.R > _ENDLESS and shortness < _SHORTEST_BOUNCE:
        return 0.0, _CUT_SHORT
    if not shortness < _SHORTEST_TAIL * (1.0 - pt.R):
        return math.inf, _CERTIFIED
    eta = v / a / (1.0 - pt.R)
    tail = 2.0 * eta - 4.0 / 3.0 * (beta + pt.h) * eta * eta
    complete = tail <= min(left, time_to_release(theta, pt))
    return tail if complete else math.inf, _CERTIFIED


@inlined
def may_rest(eq, launch):
    """Whether a rebound is so slow that the mass may come to rest; a fast one clearly does not."""
    press = fma(eq.of_sin, launch.s, eq.of_1)
    shortest = _SHORTEST_TAIL * (1.0 - eq.R) if eq.R <= _ENDLESS else 2.0 * _SHORTEST_BOUNCE
    return -launch.w * rates_of(eq) <= shortest * press


@inlined
def phase_to_rest(eq, launch, theta, left, pt):
    """As ``time_to_rest``, but as a phase, and infinite for impacts that are clearly too fast."""
    if not may_rest(eq, launch):
        return math.inf, _CERTIFIED
    speed, per_time = -launch.w * pt.omega, 1.0 / pt.omega
    wait, status = time_to_rest(speed, theta, launch.s, launch.c, left * per_time, pt)
    return wait * pt.omega, status
