"""A flight as a Taylor polynomial: bounds of its derivatives, its first root.

Over one step the exact solution of eq. (1) is its Taylor series about the start of the step, here
in the units of ``propagator.py``,

    y(u) = sum_k c_k u^k,    u = (theta - theta_0) / step in [0, 1].

With (2h + p + omega) T <= ``LONGEST_STEP`` the remainder of the series is below rounding.

The search for the first root covers the whole interval; it does not sample. On an interval where
the second derivative is proved to keep its sign, a polynomial has at most one maximum, so even the
shortest touch is seen. Where a flight starts on the stop, the polynomial is divided by its root at
u = 0, so that short flights lose no digits.
"""

from __future__ import annotations

import math

from vibroimpact.jit import fma, inlined, jit
from vibroimpact.step.elementary import larger, smaller
from vibroimpact.step.scheme import LONGEST_STEP as LONGEST_STEP

#: Number of Taylor coefficients, enough for ``LONGEST_STEP``.
TERMS = 22

#: The smallest normal number. A flight with only smaller coefficients has no significant digits.
SMALLEST_NORMAL = 2.0**-1022

# An interval is not made narrower than this to separate a change of sign of the curvature. There
# the curve exceeds its chord by at most width^3 / 4 times the third derivative, which is rounding.
_NARROWEST = 2.0**-17
# Bound of the iterations of ``first_crossing``. Every interval that is passed, except the last, is
# wider than _NARROWEST / 2, so at most 2^18 fill a step. Any other interval is halved, which
# undoes the doubling after a passed interval or is one of the first 18 halvings.
_MOST_INTERVALS = 2**19 + 20


@jit
def expand(eq, y, w, s, c, phase_step, coefficients):
    """Set the Taylor coefficients of y(u) for a flight from (y, w), at sine `s` and cosine `c`.

    Differentiating (P) k times: y(k+2) = of_w y(k+1) + of_y y(k) + of_sin sin(k)(theta).
    """
    weight, constant = 1.0, eq.of_1
    for k in range(coefficients.size):
        coefficients[k] = y * weight
        y, w = w, fma(eq.of_w, w, fma(eq.of_y, y, fma(eq.of_sin, s, constant)))
        s, c, constant = c, -s, 0.0
        weight *= phase_step / (k + 1)


@jit
def value_and_slope(c, m, u):
    """Return sum_k c[m + k] u^k and its derivative."""
    # Horner's scheme in u^2: four short chains of fused operations have less latency than two.
    uu = u * u
    last = c.size - 1
    p, q = c[last], c[last - 1]
    dp, dq = 0.0, 0.0
    k = last - 2
    while k > m:  # terminates: k falls by 2
        dp, p = fma(dp, uu, p), fma(p, uu, c[k])
        dq, q = fma(dq, uu, q), fma(q, uu, c[k - 1])
        k -= 2
    if k == m:
        dp, p = fma(dp, uu, p), fma(p, uu, c[k])
        p, q, dp, dq = q, p, dq, dp
    # Now q holds the even powers and p the odd ones.
    return fma(u, p, q), fma(2.0 * u, fma(u, dp, dq), p)


@inlined
def curvature(c, m, u):
    """Return the second derivative of sum_k c[m + k] u^k."""
    if u == 0.0:
        return 2.0 * c[m + 2]
    second = 0.0
    for k in range(c.size - 1, m + 1, -1):
        second = fma(second, u, (k - m) * (k - m - 1) * c[k])
    return second


@inlined
def greatest_third_derivative(c, m):
    """Return a bound of the third derivative of sum_k c[m + k] u^k on [0, 1]."""
    even, odd = 0.0, 0.0  # two sums, to shorten the chain of additions
    for k in range(m + 3, c.size - 1, 2):
        even += (k - m) * (k - m - 1) * (k - m - 2) * abs(c[k])
        odd += (k + 1 - m) * (k - m) * (k - m - 1) * abs(c[k + 1])
    k = c.size - 1  # counted twice if the number of terms is even: still a bound
    return even + odd + (k - m) * (k - m - 1) * (k - m - 2) * abs(c[k])


@inlined
def _first_guess(low, value_low, slope_low, high, value, slope):
    """Guess the root of a rising polynomial by inverse cubic interpolation from its ends."""
    rise = value - value_low
    chord = rise / (high - low)
    if not (slope_low > 0.25 * chord and slope > 0.25 * chord):
        return high - value / slope if slope > 0.0 else -1.0
    t = -value_low / rise
    t_high = 1.0 - t
    bend = t * t_high * (t_high * (chord / slope_low - 1.0) - t * (chord / slope - 1.0))
    return low + (high - low) * (t + bend)


@jit
def _root(c, m, low, high, u):
    """Return the only root in (low, high) of a rising polynomial, by Newton's method from `u`."""
    if not low < u < high:
        u = 0.5 * (low + high)
    for _ in range(100):
        value, slope = value_and_slope(c, m, u)
        if value > 0.0:
            high = u
        else:
            low = u
        new = u - value / slope if slope > 0.0 else -1.0
        # Newton's method squares the error: the next change would be below rounding.
        if abs(new - u) <= 1e-8 * u or high - low <= 4e-16 * high:
            return smaller(larger(new, low), high)
        u = new if low < new < high else 0.5 * (low + high)
    return u


@jit
def turn_between(c, m, low, high):
    """Return where the slope of a polynomial falls through zero between `low` and `high`."""
    for _ in range(60):
        u = 0.5 * (low + high)
        for _ in range(8):
            _, slope = value_and_slope(c, m, u)
            if slope > 0.0:
                low = u
            else:
                high = u
            second = curvature(c, m, u)
            new = u - slope / second if second < 0.0 else -1.0
            if abs(new - u) <= 1e-8 * u:
                return smaller(larger(new, low), high)
            if not low < new < high:
                break
            u = new
        if high - low <= 4e-16 * high:
            break
    return 0.5 * (low + high)


@jit
def first_crossing(c, m, end):
    """Return the first u in (0, end <= 1] at which a flight meets the stop, and its highest turn.

    The first `m` coefficients of x(u) - stop are zero; they are divided out. u is -1 if the flight
    does not meet the stop, and NaN if a coefficient or a derivative is not finite. The turn is the
    greatest x - stop of the turning points before u, -inf if there is none.
    """
    jerk = greatest_third_derivative(c, m)
    turn, a, width = -math.inf, 0.0, end
    value_a, slope_a = c[m], c[m + 1]
    if not jerk < math.inf:
        return math.nan, turn
    for _ in range(_MOST_INTERVALS):
        if not a < end:
            return -1.0, turn
        b = end if a + width >= end else a + width
        second = curvature(c, m, a)
        if abs(second) < jerk * (b - a) and b - a > _NARROWEST:
            width = 0.5 * (b - a)
            continue
        value, slope = value_and_slope(c, m, b)
        if slope_a > 0.0 and slope <= 0.0:
            top = turn_between(c, m, a, b)
            height, _ = value_and_slope(c, m, top)
            turn = larger(turn, height * top**m)
            if height > 0.0:
                return _root(c, m, a, top, -1.0), turn
        if value > 0.0:
            guess = _first_guess(a, value_a, slope_a, b, value, slope)
            return _root(c, m, a, b, guess), turn
        width = 2.0 * (b - a)
        a, value_a, slope_a = b, value, slope
    return math.nan, turn
