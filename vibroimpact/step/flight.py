"""One flight between impacts as a polynomial, and the first time it meets the stop.

Over one step the exact solution of eq. (1) is its Taylor series about the step's start,

    x(u) = sum_k c_k u^k,    u = t / T in [0, 1],

and each c_k is a fixed linear combination of x, v, sin theta, cos theta there: four rows of
coefficients per parameter point, filled once. With (2h + p + omega) T <= ``LONGEST_STEP`` what
the series leaves out is below rounding.

A polynomial is searched for its first root as a whole, not sampled: an interval on which the
second derivative is proved to keep its sign has at most one maximum, and so every touch is seen,
however short. Polynomials are divided by their root at u = 0 where a flight starts on the stop,
so that short flights lose no digits.
"""

from __future__ import annotations

import math

from vibroimpact.jit import fma, jit

#: Number of Taylor coefficients: two vectors of eight.
TERMS = 16
#: Largest (2h + p + omega) T: the first term left out is below 0.65^16 / 16! = 5e-17 in x, and
#: 16 times that in its slope.
LONGEST_STEP = 0.65

#: The smallest normal number. A flight none of whose coefficients reaches it has no digits.
SMALLEST_NORMAL = 2.0**-1022

# Below this width the excess of a curve over its chord, at most width^3 / 4 of the third
# derivative where the curvature changes its sign, is rounding.
_NARROWEST = 2.0**-17
# Intervals that are passed are wider than half of that, but for the last one: 2^18 fill a step. The
# others are halved, which undoes the doubling after a passed one, or is one of the first 18.
_MOST_INTERVALS = 2**19 + 20
_NO_TURN = -math.inf


@jit(leaf=True)
def fill_rows(rows, T, pt):
    """Fill the Taylor rows of x for a unit x, v, sin theta, cos theta, in powers of u = t / T.

    From eq. (1): (k+1)(k+2) c_{k+2} = -2h T (k+1) c_{k+1} - p^2 T^2 c_k - f T^2 s_k, with the
    rows s, c of sin and cos themselves: (k+1) s_{k+1} = omega T c_k, (k+1) c_{k+1} = -omega T s_k.
    """
    for q in range(4):
        row = rows[q]
        row[0] = 1.0 if q == 0 else 0.0
        row[1] = T if q == 1 else 0.0
        s = 1.0 if q == 2 else 0.0
        c = 1.0 if q == 3 else 0.0
        for k in range(TERMS - 2):
            pull = 2.0 * pt.h * T * (k + 1) * row[k + 1] + T * T * (pt.p * pt.p * row[k] + pt.f * s)
            row[k + 2] = -pull / ((k + 1) * (k + 2))
            s, c = pt.omega * T * c / (k + 1), -pt.omega * T * s / (k + 1)


@jit(leaf=True)
def expand(rows, x, v, s, c, stop, coefficients):
    """Set the coefficients of x(u) - stop for the flight from (x, v) at phase (s, c)."""
    for k in range(rows.shape[1]):  # a constant would be unrolled, not vectorised
        coefficients[k] = rows[0, k] * x + rows[1, k] * v + (rows[2, k] * s + rows[3, k] * c)
    coefficients[0] = x - stop


@jit(leaf=True)
def value_and_slope(c, m, u):
    """Return sum_k c[m + k] u^k and its derivative.

    Horner's scheme in u^2 on every other coefficient: four short chains of fused operations
    instead of two long ones, because their latency is what an impact costs.
    """
    uu = u * u
    last = c.size - 1
    p, q = c[last], c[last - 1]
    dp, dq = 0.0, 0.0
    k = last - 2
    while k > m:  # ends: k falls by 2
        dp, p = fma(dp, uu, p), fma(p, uu, c[k])
        dq, q = fma(dq, uu, q), fma(q, uu, c[k - 1])
        k -= 2
    if k == m:
        dp, p = fma(dp, uu, p), fma(p, uu, c[k])
        p, q, dp, dq = q, p, dq, dp
    # Now q holds the even powers and p the odd ones.
    return fma(u, p, q), fma(2.0 * u, fma(u, dp, dq), p)


@jit(leaf=True, internal=True)
def expansion(c, u):
    """Return sum_k c[k] u^k over all ``TERMS``, and its first two derivatives.

    Horner's scheme in u^4 on every fourth coefficient: short chains of fused operations, because
    their latency is what an impact costs.
    """
    uu = u * u
    u4 = uu * uu
    p, q, r, s = c[12], c[13], c[14], c[15]
    dp, dq, dr, ds = 13.0 * c[13], 14.0 * c[14], 15.0 * c[15], 0.0
    ddp, ddq, ddr, dds = 182.0 * c[14], 210.0 * c[15], 0.0, 0.0
    for k in range(8, -1, -4):
        p, q = fma(p, u4, c[k]), fma(q, u4, c[k + 1])
        r, s = fma(r, u4, c[k + 2]), fma(s, u4, c[k + 3])
        dp, dq = fma(dp, u4, (k + 1) * c[k + 1]), fma(dq, u4, (k + 2) * c[k + 2])
        dr, ds = fma(dr, u4, (k + 3) * c[k + 3]), fma(ds, u4, (k + 4) * c[k + 4])
        ddp = fma(ddp, u4, (k + 2) * (k + 1) * c[k + 2])
        ddq = fma(ddq, u4, (k + 3) * (k + 2) * c[k + 3])
        ddr = fma(ddr, u4, (k + 4) * (k + 3) * c[k + 4])
        dds = fma(dds, u4, (k + 5) * (k + 4) * c[k + 5])
    return (
        fma(uu, fma(u, s, r), fma(u, q, p)),
        fma(uu, fma(u, ds, dr), fma(u, dq, dp)),
        fma(uu, fma(u, dds, ddr), fma(u, ddq, ddp)),
    )


@jit(inline=True)
def _curvature(c, m, u):
    """Second derivative of sum_k c[m + k] u^k."""
    if u == 0.0:
        return 2.0 * c[m + 2]
    second = 0.0
    for k in range(c.size - 1, m + 1, -1):
        second = fma(second, u, (k - m) * (k - m - 1) * c[k])
    return second


@jit(inline=True)
def _greatest_third_derivative(c, m):
    """Bound of the third derivative of sum_k c[m + k] u^k on [0, 1]."""
    even, odd = 0.0, 0.0  # two sums, for their latency
    for k in range(m + 3, c.size - 1, 2):
        even += (k - m) * (k - m - 1) * (k - m - 2) * abs(c[k])
        odd += (k + 1 - m) * (k - m) * (k - m - 1) * abs(c[k + 1])
    k = c.size - 1  # counted twice where the number of terms is even: a bound all the same
    return even + odd + (k - m) * (k - m - 1) * (k - m - 2) * abs(c[k])


@jit(inline=True)
def _first_guess(low, value_low, slope_low, high, value, slope):
    """Guess the root of a rising polynomial from its ends: inverse cubic interpolation."""
    rise = value - value_low
    chord = rise / (high - low)
    if not (slope_low > 0.25 * chord and slope > 0.25 * chord):
        return high - value / slope if slope > 0.0 else -1.0
    t = -value_low / rise
    t_high = 1.0 - t
    bend = t * t_high * (t_high * (chord / slope_low - 1.0) - t * (chord / slope - 1.0))
    return low + (high - low) * (t + bend)


@jit(leaf=True, internal=True)
def _root(c, m, low, high, u):
    """The one root in (low, high) of a polynomial that rises through it.

    Newton's method from `u`, kept inside its bracket.
    """
    if not low < u < high:
        u = 0.5 * (low + high)
    for _ in range(100):
        value, slope = value_and_slope(c, m, u)
        if value > 0.0:
            high = u
        else:
            low = u
        new = u - value / slope if slope > 0.0 else -1.0
        # Newton's error is squared in each iteration: the next one would be below rounding.
        if abs(new - u) <= 1e-8 * u or high - low <= 4e-16 * high:
            return min(max(new, low), high)
        u = new if low < new < high else 0.5 * (low + high)
    return u


@jit(leaf=True, internal=True)
def _turning_point(c, m, low, high):
    """Where the slope of a polynomial falls through zero between `low` and `high`."""
    for _ in range(60):
        u = 0.5 * (low + high)
        for _ in range(8):
            _, slope = value_and_slope(c, m, u)
            if slope > 0.0:
                low = u
            else:
                high = u
            second = _curvature(c, m, u)
            new = u - slope / second if second < 0.0 else -1.0
            if abs(new - u) <= 1e-8 * u:
                return min(max(new, low), high)
            if not low < new < high:
                break
            u = new
        if high - low <= 4e-16 * high:
            break
    return 0.5 * (low + high)


@jit(leaf=True)
def first_crossing(c, m, end):
    """The first u in (0, end] at which a flight meets the stop.

    Parameters
    ----------
    c : ndarray, shape (TERMS,)
        Coefficients of x(u) - stop; the first `m` are zero and divided out.
    m : int
    end : float
        Where the search ends, <= 1.

    Returns
    -------
    u : float
        -1 if the flight does not meet the stop; NaN if a coefficient is not finite, or so great
        that a derivative is not.
    turn : float
        Greatest x - stop among the turning points seen on the way; -inf if there was none.
    """
    jerk = _greatest_third_derivative(c, m)
    turn = _NO_TURN
    a, width = 0.0, end
    value_a, slope_a = c[m], c[m + 1]
    if not jerk < math.inf:
        return math.nan, turn
    for _ in range(_MOST_INTERVALS):
        if not a < end:
            return -1.0, turn
        b = end if a + width >= end else a + width
        second = _curvature(c, m, a)
        if abs(second) < jerk * (b - a) and b - a > _NARROWEST:
            width = 0.5 * (b - a)
            continue
        value, slope = value_and_slope(c, m, b)
        if slope_a > 0.0 and slope <= 0.0:
            top = _turning_point(c, m, a, b)
            height, _ = value_and_slope(c, m, top)
            turn = max(turn, height * top**m)
            if height > 0.0:
                return _root(c, m, a, top, -1.0), turn
        if value > 0.0:
            guess = _first_guess(a, value_a, slope_a, b, value, slope)
            return _root(c, m, a, b, guess), turn
        width = 2.0 * (b - a)
        a, value_a, slope_a = b, value, slope
    return math.nan, turn


@jit(leaf=True, internal=True)
def rising_root(c, value, slope):
    """The first crossing of a flight known to rise from u = 0 to u = 1, and its slope there.

    Halley's method; where it leaves the bracket, ``_root``.

    Parameters
    ----------
    value, slope : float
        x - stop and its derivative at u = 1.

    Returns
    -------
    u, slope : float
        -1 and 0 if the flight does not cross.
    """
    if not value > 0.0:
        return -1.0, 0.0
    u = _first_guess(0.0, c[0], c[1], 1.0, value, slope)
    for _ in range(3):
        if not 0.0 < u < 1.0:
            break
        y, dy, ddy = expansion(c, u)
        inverse = 1.0 / dy
        newton = -y * inverse
        change = newton - 0.5 * newton * newton * (ddy * inverse)
        u += change
        # The next change would be its cube; the slope's next term is its square. An overflow is
        # not taken for a root.
        if abs(change) <= 1e-8 * min(u, 1.0):
            return u, fma(ddy, change, dy)
    u = _root(c, 0, 0.0, 1.0, u)
    return u, value_and_slope(c, 0, u)[1]
