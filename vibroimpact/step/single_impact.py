"""A step with a single impact: found, proved to be the first and the only one, and mended.

One function without a branch, ``single_impact``, for a column of a vector as for a single orbit.
It holds for nearly every step that meets the stop; the other steps are left to ``exact.py``.

- The first guess of the impact is the inverse cubic interpolant of the step where it rises steeply
  at both ends, else a parabola. The flight is expanded about the nearer end of the step, where 16
  powers are enough, and Newton's method with two further terms of the reversed series is applied
  twice, first to the terms up to t^8. The error that is left is estimated; if it is not below
  rounding, nothing is proved.
- The flight before the impact is below the stop, and so is that after it, if the Bernstein
  coefficients of ``flow.py`` say so: for the first, from (y_0, w_0) to (0, w_i) in the time u; for
  the second, from (0, -R w_i) to the end of the step in the time r.
- The end of the step is its undisturbed end and the response to the impulse of the impact.
"""

from __future__ import annotations

import math

from vibroimpact.jit import fma, jit, select
from vibroimpact.step.flow import INVERSE_FACTORIALS, bend, impulse

#: What Newton's method may leave of the time of an impact, as a share of the step, and its last
#: change, for the speed.
_RESIDUAL, _LAST_CHANGE = 1e-17, 1e-5

#: What ``single_impact`` has proved: nothing, that it has the first impact of the step, and that
#: this is the only one.
NOTHING, FIRST, ONLY = 0.0, 1.0, 2.0


@jit(forced_inline=True)
def series(eq, y, w, s, c):
    """Return the coefficients of the Taylor series of y from a state, up to the 16th power.

    The derivatives follow from (P): y(k+2) = of_w y(k+1) + of_y y(k) + of_sin sin(k)(theta).
    """
    F, a, b, fs, fc = INVERSE_FACTORIALS, eq.of_w, eq.of_y, eq.of_sin * s, eq.of_sin * c
    d2 = fma(a, w, fma(b, y, fs + eq.of_1))
    d3 = fma(a, d2, fma(b, w, fc))
    d4 = fma(a, d3, fma(b, d2, -fs))
    d5 = fma(a, d4, fma(b, d3, -fc))
    d6 = fma(a, d5, fma(b, d4, fs))
    d7 = fma(a, d6, fma(b, d5, fc))
    d8 = fma(a, d7, fma(b, d6, -fs))
    d9 = fma(a, d8, fma(b, d7, -fc))
    d10 = fma(a, d9, fma(b, d8, fs))
    d11 = fma(a, d10, fma(b, d9, fc))
    d12 = fma(a, d11, fma(b, d10, -fs))
    d13 = fma(a, d12, fma(b, d11, -fc))
    d14 = fma(a, d13, fma(b, d12, fs))
    d15 = fma(a, d14, fma(b, d13, fc))
    d16 = fma(a, d15, fma(b, d14, -fs))
    return (
        y, w, F[2] * d2, F[3] * d3, F[4] * d4, F[5] * d5, F[6] * d6, F[7] * d7, F[8] * d8,
        F[9] * d9, F[10] * d10, F[11] * d11, F[12] * d12, F[13] * d13, F[14] * d14, F[15] * d15,
        F[16] * d16,
    )  # fmt: skip


@jit(forced_inline=True)
def first_terms(k, t):
    """Return value, slope and half the second derivative of the terms of a series up to t^8."""
    e, d, y = 0.0, k[8], fma(k[8], t, k[7])
    e, d, y = d, fma(d, t, y), fma(y, t, k[6])
    for i in range(5, 0, -1):
        e, d, y = fma(e, t, d), fma(d, t, y), fma(y, t, k[i])
    return fma(y, t, k[0]), fma(d, t, y), fma(e, t, d)


@jit(forced_inline=True)
def all_terms(k, t):
    """As ``first_terms``, of all 17 terms."""
    e, d, y = 0.0, k[16], fma(k[16], t, k[15])
    e, d, y = d, fma(d, t, y), fma(y, t, k[14])
    for i in range(13, 0, -1):
        e, d, y = fma(e, t, d), fma(d, t, y), fma(y, t, k[i])
    return fma(y, t, k[0]), fma(d, t, y), fma(e, t, d)


@jit(forced_inline=True)
def newton_step(y, d, e, j, per_step):
    """Return by how much t exceeds a root of y, and what that leaves of the excess, as a share.

    `d`, `e`, `j` are the first three derivatives over 1!, 2!, 3!. The reversion of the Taylor
    series is n + a n^2 + (2 a^2 - b) n^3 with n = y / d, a = e / d, b = j / d; what it leaves is
    estimated by the terms that follow.
    """
    inverse = 1.0 / d
    n = y * inverse
    q, r, u = n * (e * inverse), n * n * (j * inverse), n * per_step
    most = max(max(q * q, abs(r)), u * u)
    return n * (1.0 + fma(2.0 * q, q, q - r)), most * max(max(abs(q), abs(u)), most)


@jit(forced_inline=True)
def guess(start, end, step):
    """Guess where a step from `start` to `end`, states (y, w), rises through 0; as a share."""
    y_0, w_0 = start
    rise, w_0, w_1 = end[0] - y_0, step * w_0, step * end[1]
    u = -y_0 / rise
    left = 1.0 - u
    cubic = u + u * left * (left * (rise / w_0 - 1.0) - u * (rise / w_1 - 1.0))
    steep = (w_0 > 0.25 * rise) & (w_1 > 0.25 * rise)
    root = math.sqrt(max(fma(-4.0 * (rise - w_0), y_0, w_0 * w_0), 0.0))
    return select(steep, cubic, -2.0 * y_0 / (w_0 + root))


@jit(forced_inline=True)
def single_impact(eq, start, end, waves, step, polish):
    """Mend a step that may have met the stop.

    Parameters
    ----------
    eq : Equation
    start, end : (float, float)
        The state (y, w) at the start of the step, and at its undisturbed end.
    waves : 4 floats
        Sine and cosine of the phase at the start of the step, and at its end.
    step : float
    polish : int
        How often Newton's method is applied to all terms of the series: once is mostly enough.

    Returns
    -------
    y, w : float
        State at the end of the step, after the impact.
    u, w_i : float
        Time of the impact since the start of the step, and w before it.
    proved : float
        ``NOTHING``, ``FIRST`` or ``ONLY``. With ``ONLY`` y, w, u and w_i hold; with ``FIRST`` only
        u and w_i; with ``NOTHING`` none.
    """
    (y_0, w_0), (y_T, w_T), (s_0, c_0, s_T, c_T), per_step = start, end, waves, 1.0 / step
    u = guess(start, end, step)
    late = u > 0.5
    begin, t = select(late, step, 0.0), step * select(late, u - 1.0, u)
    k = series(
        eq, select(late, y_T, y_0), select(late, w_T, w_0), select(late, s_T, s_0),
        select(late, c_T, c_0),
    )  # fmt: skip
    y, d, e = first_terms(k, t)
    j = fma(fma(fma(20.0 * k[6], t, 10.0 * k[5]), t, 4.0 * k[4]), t, k[3])
    change, _ = newton_step(y, d, e, j, per_step)
    t -= change
    w_i, left, change = 0.0, 1.0, 1.0
    for _ in range(polish):
        y, d, e = all_terms(k, t)
        j = fma(fma(fma(fma(35.0 * k[7], t, 20.0 * k[6]), t, 10.0 * k[5]), t, 4.0 * k[4]), t, k[3])
        change, left = newton_step(y, d, e, j, per_step)
        fourth = fma(fma(60.0 * k[6], t, 20.0 * k[5]), t, 4.0 * k[4])  # derivative, over 3!
        w_i = fma(fma(fma(-fourth, change, 3.0 * j), change, -2.0 * e), change, d)
        t -= change
        change = abs(change) * per_step
        left *= change
    converged = (left < _RESIDUAL) & (change < _LAST_CHANGE)
    u, r = t + begin, (step - begin) - t
    E = bend(eq, y_0, w_0)
    n = u * per_step
    n *= n
    middle = fma(E, n * n, fma((w_0 - w_i) * (1.0 / 3.0), u, y_0))
    below = max(max(y_0, fma(w_0, u, 4.0 * y_0)), middle) < 0.0
    first = below & converged & (min(min(y_T, w_i), min(u, r)) > 0.0)
    of_y, of_w = impulse(eq.of_w, eq.of_y, r)
    launch = eq.R * w_i
    kick = w_i + launch
    y, w = fma(-kick, of_y, y_T), fma(-kick, of_w, w_T)
    n = r * per_step
    n *= n
    middle = fma(E, n * n, fma((launch + w) * (-1.0 / 3.0), r, y))
    only = max(max(y, fma(-w, r, 4.0 * y)), middle) < 0.0
    return y, w, u, w_i, select(first, select(only, ONLY, FIRST), NOTHING)
