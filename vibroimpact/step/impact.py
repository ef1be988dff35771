"""A step with a single impact: find it, prove that it is the first and only one, and correct.

There are six stages without branches, which serve the columns of a vector and a single orbit alike;
``single_impact`` runs all of them. They settle nearly every step that meets the stop. ``exact.py``
takes the other steps.

- The first guess of the impact is the inverse cubic interpolant of the step if it rises steeply at
  both ends, else a parabola. The flight is expanded about the nearer end of the step, where 16
  powers are enough. Newton's method with two further terms of the reversed series is applied first
  to the terms up to t^8, then to all. The remaining error is estimated; if it is not below
  rounding, nothing is proved.
- The flights before and after the impact are below the stop if the Bernstein coefficients of
  ``propagator.py`` prove it: for the first, from (y_0, w_0) to (0, w_i) in the time u; for the
  second, from (0, -R w_i) to the end of the step in the time r.
- The state at the end of the step is that without impact, plus the response to the impulse of the
  impact.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibroimpact.jit import fma, inlined, jit, select
from vibroimpact.step.propagator import INVERSE_FACTORIALS, impulse

#: Newton's method has converged if the estimated error of the time of impact is below ``_RESIDUAL``
#: steps, and its last change below ``_LAST_CHANGE`` steps, so that the speed is right as well.
_RESIDUAL, _LAST_CHANGE = 1e-17, 1e-5

#: What ``single_impact`` has proved: nothing; that it found the first impact of the step; that this
#: impact is also the only one, which alone is not negative.
NOTHING, FIRST, ONLY = -2.0, -1.0, 0.0


class FreeEnd(NamedTuple):
    """The end of a step as if there were no stop, and its remainder bound; see ``propagate``."""

    y: float
    w: float
    bound: float


class Waves(NamedTuple):
    """Sine and cosine of the phase at the start of a step, and at its end."""

    s: float
    c: float
    s_end: float
    c_end: float


class Guess(NamedTuple):
    """A guess of an impact, from the end of its step that is nearer."""

    late: float  #: 0. if the impact is in the first half of the step, 1. if in the second.
    t: float  #: The time from the start of the step, or the negative time from its end.


class Impact(NamedTuple):
    """The impact of a step, as far as `proved` says that its numbers are valid.

    With ``ONLY`` all numbers are valid, with ``FIRST`` only `u` and `w_i`, with ``NOTHING`` none.
    """

    y: float  #: State at the end of the step, with the impact.
    w: float
    u: float  #: Phase of the impact since the start of the step.
    w_i: float  #: w just before the impact.
    proved: float  #: ``NOTHING``, ``FIRST`` or ``ONLY``.


@inlined
def series(eq, y, w, s, c):
    """Return the coefficients of the Taylor series of y about a state, up to the 16th power.

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


@inlined
def first_terms(k, t):
    """Return value, slope and half the second derivative of the terms of a series up to t^8."""
    e, d, y = 0.0, k[8], fma(k[8], t, k[7])
    e, d, y = d, fma(d, t, y), fma(y, t, k[6])
    for i in range(5, 0, -1):
        e, d, y = fma(e, t, d), fma(d, t, y), fma(y, t, k[i])
    return fma(y, t, k[0]), fma(d, t, y), fma(e, t, d)


@inlined
def all_terms(k, t):
    """As ``first_terms``, but with all 17 terms."""
    e, d, y = 0.0, k[16], fma(k[16], t, k[15])
    e, d, y = d, fma(d, t, y), fma(y, t, k[14])
    for i in range(13, 0, -1):
        e, d, y = fma(e, t, d), fma(d, t, y), fma(y, t, k[i])
    return fma(y, t, k[0]), fma(d, t, y), fma(e, t, d)


@inlined
def guess(start, free, phase_step):
    """Return the ``Guess`` where a step from `start`, (y, w), to its free end rises through 0."""
    # The place of the root and w at both ends, in units of the step and of the rise.
    inverse = 1.0 / (free.y - start[0])
    u, a, b = -start[0] * inverse, start[1] * inverse * phase_step, free.w * inverse * phase_step
    steep = (a > 0.25) & (b > 0.25)
    cubic = u * (1.0 - u) * fma((1.0 - u) * b, 1.0 - a, -u * a * (1.0 - b))
    # Single precision is enough for a guess, and faster. NaN is possible only without a crossing.
    root = np.sqrt(np.float32(fma(4.0 * u, 1.0 - a, a * a)))
    over, under = select(steep, cubic, 2.0 * u), select(steep, a * b, a + np.float64(root))
    u = select(steep, u, 0.0) + np.float64(np.float32(over) / np.float32(under))
    late = select(u > 0.5, 1.0, 0.0)
    return Guess(late, (u - late) * phase_step)


@inlined
def expand_near(eq, start, free, waves, late):
    """Expand a step as ``series`` does, about its start (`late` is 0) or its end (`late` is 1)."""
    at_end = late > 0.0
    y, w = select(at_end, free.y, start[0]), select(at_end, free.w, start[1])
    s, c = select(at_end, waves.s_end, waves.s), select(at_end, waves.c_end, waves.c)
    return series(eq, y, w, s, c)


@inlined
def newton_step(y, d, e, j, per_step):
    """Return the excess of t over a root of y, and the estimated relative error of this excess.

    `d`, `e`, `j` are the first three derivatives over 1!, 2!, 3!. The excess follows from the
    reversion of the Taylor series, n + a n^2 + (2 a^2 - b) n^3 with n = y / d, a = e / d,
    b = j / d. Its error is estimated by the next terms.
    """
    inverse = 1.0 / d
    n = y * inverse
    q, r, u = n * (e * inverse), n * n * (j * inverse), n * per_step
    most = max(max(q * q, abs(r)), u * u)
    return n * (1.0 + fma(2.0 * q, q, q - r)), most * max(max(abs(q), abs(u)), most)


@inlined
def approach(k, t, phase_step):
    """Improve the guess `t` of a root, with the terms of a series up to t^8."""
    y, d, e = first_terms(k, t)
    j = fma(fma(fma(20.0 * k[6], t, 10.0 * k[5]), t, 4.0 * k[4]), t, k[3])
    change, _ = newton_step(y, d, e, j, 1.0 / phase_step)
    return t - change


@inlined
def first_impact(start, free, guessed, k, values, phase_step):
    """Find an impact to rounding, and prove that it is the first.

    `guessed` is the improved ``guess``, `k` the series about the end of the step that it refers to,
    `values` the result of ``all_terms`` there. Returns the time of the impact since the start of
    the step, the time from it to the end, w_i, and ``NOTHING`` or ``FIRST``.
    """
    (y_0, w_0), (y, d, e), t, per_step = start, values, guessed.t, 1.0 / phase_step
    j = fma(fma(fma(fma(35.0 * k[7], t, 20.0 * k[6]), t, 10.0 * k[5]), t, 4.0 * k[4]), t, k[3])
    change, left = newton_step(y, d, e, j, per_step)
    fourth = fma(fma(60.0 * k[6], t, 20.0 * k[5]), t, 4.0 * k[4])  # derivative, over 3!
    w_i = fma(fma(fma(-fourth, change, 3.0 * j), change, -2.0 * e), change, d)
    t -= change
    change = abs(change) * per_step
    converged = (left * change < _RESIDUAL) & (change < _LAST_CHANGE)
    begin = guessed.late * phase_step
    u, r = t + begin, (phase_step - begin) - t
    n = u * per_step
    n *= n
    middle = fma(free.bound, n * n, fma((w_0 - w_i) * (1.0 / 3.0), u, y_0))
    below = max(max(y_0, fma(w_0, u, 4.0 * y_0)), middle) < 0.0
    first = below & converged & (min(min(free.y, w_i), min(u, r)) > 0.0)
    return u, r, w_i, select(first, FIRST, NOTHING)


@inlined
def rebound(eq, free, r, w_i, proved, phase_step):
    """Continue from an impact to the end of the step, and prove that there is no other.

    Parameters as returned by ``first_impact``, results as of ``single_impact``.
    """
    per_step = 1.0 / phase_step
    of_y, of_w = impulse(eq.of_w, eq.of_y, r)
    launch = eq.R * w_i
    kick = w_i + launch
    y, w = fma(-kick, of_y, free.y), fma(-kick, of_w, free.w)
    n = r * per_step
    n *= n
    middle = fma(free.bound, n * n, fma((launch + w) * (-1.0 / 3.0), r, y))
    only = max(max(y, fma(-w, r, 4.0 * y)), middle) < 0.0
    return y, w, select(only & (proved == FIRST), ONLY, proved)


@jit
def single_impact(eq, start, free, waves, phase_step, polish):
    """Correct a step that may have met the stop; return its ``Impact``.

    `start` is (y, w). The guess is improved `polish` times; once is mostly enough.
    """
    late, t = guess(start, free, phase_step)
    k = expand_near(eq, start, free, waves, late)
    for _ in range(polish):
        t = approach(k, t, phase_step)
    guessed = Guess(late, t)
    u, r, w_i, proved = first_impact(start, free, guessed, k, all_terms(k, t), phase_step)
    y, w, proved = rebound(eq, free, r, w_i, proved, phase_step)
    return Impact(y, w, u, w_i, proved)
