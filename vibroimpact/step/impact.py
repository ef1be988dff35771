"""`meet_stop`, from `Flight` to `Impact`: `Guess`, series, proof that it is the first, rebound.

A step is a number of flights. The first begins with the step; each of the others begins with the
rebound from the impact that ended the one before. The last one ends with the step. A flight has
six stages without branches, which serve the columns of a vector and a single orbit alike;
``meet_stop`` runs all of them. They settle nearly every step that meets the stop. ``exact_step.py``
takes the other steps, from the flight on that they do not settle.

- The first guess of the impact. In the first flight: the root of a parabola, and one iteration of
  Newton's method on the cubic interpolant of the step. After a rebound: the root of the first terms
  of its series. If no impact is in sight: the middle of the flight.
- The flight is expanded about its start or about the end of the step, whichever is nearer, where
  16 powers are enough. Newton's method with two further terms of the reversed series is applied
  first to the terms up to t^8, then to all. The remaining error is estimated; if it is not below
  rounding, nothing is proved. The series about a rebound has no constant term, so that its values
  and its root keep their relative accuracy, however short the flight.
- The flights before and after the impact are below the stop if the Bernstein coefficients of
  ``propagator.py`` prove it: for the first, from (y_0, w_0) to (0, w_i) in the time u; for the
  second, from (0, -R w_i) to the end of the step in the time r. A flight without an impact is
  proved to be below the stop in two parts, before and after its middle.
- The state at the end of the step is that without impact, plus the response to the impulse of the
  impact.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibroimpact.jit import fma, inlined, jit, select
from vibroimpact.step.elementary import sin_cos
from vibroimpact.step.propagator import INVERSE_FACTORIALS, impulse

#: Newton's method has converged if the estimated error of the time of impact is below ``_RESIDUAL``
#: steps, and its last change below ``_LAST_CHANGE`` steps, so that the speed is right as well.
#: After a rebound they are shares of the length of the flight, if it is short.
_RESIDUAL, _LAST_CHANGE = 1e-17, 1e-5
#: Longest time, in steps, over which the series is used: 17th powers are below rounding.
_FARTHEST = 0.6

#: What is proved of a flight: nothing; that its first impact is found; that the rebound from this
#: impact does not return in the step; that the flight has no impact. Only the last two, with which
#: the step ends, are not negative.
NOTHING, FIRST, ONLY, FREE = -2.0, -1.0, 0.0, 1.0


class Flight(NamedTuple):
    """The start of a flight."""

    y: float
    w: float
    s: float  #: Sine and cosine of the phase.
    c: float
    begin: float  #: Phase since the start of the step.


class FreeEnd(NamedTuple):
    """The end of a step as if the flight met no stop, and the step's remainder bound."""

    y: float
    w: float
    bound: float


class Guess(NamedTuple):
    """A guess of an impact, from the end of its flight that is nearer."""

    late: float  #: 0. if `t` is the time from the start of the flight, 1. if from the step's end.
    t: float  #: Negative from the end.
    none: float  #: 1. if no impact is in sight, and `t` is the middle of the flight; else 0.


class Impact(NamedTuple):
    """The end of a flight, as far as `proved` says that its numbers are valid.

    With ``ONLY`` all numbers are valid, with ``FIRST`` all but that the rebound may return before
    the end of the step, with ``FREE`` `y` and `w`, with ``NOTHING`` none.
    """

    y: float  #: State at the end of the step, as if there were no further impact.
    w: float
    at: float  #: Phase of the impact since the start of the step.
    w_i: float  #: w just before the impact.
    proved: float  #: ``NOTHING``, ``FIRST``, ``ONLY`` or ``FREE``.
    free: FreeEnd  #: The end of the step as if there were no impact.


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
    """As ``first_terms``, but with all 17 terms, in two short chains: even and odd powers."""
    tt, p, q, dp, dq, ep, eq = t * t, k[16], k[15], 0.0, 0.0, 0.0, 0.0
    for i in range(14, -1, -2):  # y = p(t^2) + t q(t^2)
        ep, dp, p = fma(ep, tt, dp), fma(dp, tt, p), fma(p, tt, k[i])
    for i in range(13, 0, -2):
        eq, dq, q = fma(eq, tt, dq), fma(dq, tt, q), fma(q, tt, k[i])
    e = fma(t, fma(4.0 * tt, eq, 3.0 * dq), fma(4.0 * tt, ep, dp))
    return fma(t, q, p), fma(2.0 * t, fma(t, dq, dp), q), e


@inlined
def guess(flight, free, phase_step):
    """Return the ``Guess`` where the first flight of a step, to its free end, rises through 0."""
    # The place of the root and w at both ends, in units of the step and of the rise. Single
    # precision is enough for a guess, and faster. NaN is possible only without a crossing.
    inverse = 1.0 / (free.y - flight.y)
    u, a = np.float32(-flight.y * inverse), np.float32(flight.w * inverse * phase_step)
    b, one = np.float32(free.w * inverse * phase_step), np.float32(1.0)
    root = np.sqrt(a * a + np.float32(4.0) * u * (one - a))  # the slope of the parabola there
    n = np.float32(2.0) * u / (a + root)
    bend = a + b - np.float32(2.0)  # the cubic is the parabola and bend n^2 (n - 1)
    slope = root + bend * n * (np.float32(3.0) * n - np.float32(2.0))
    n -= bend * n * n * (n - one) / slope
    rises = free.y > 0.0
    late = select(rises & (n > np.float32(0.5)), 1.0, 0.0)
    t = select(rises, np.float64(n) - late, 0.5) * phase_step
    return Guess(late, t, select(rises, 0.0, 1.0))


@inlined
def guess_return(eq, launch, phase_step):
    """Return the ``Guess`` where a flight returns that begins with a rebound, a ``Flight``."""
    a, b, w = eq.of_w, eq.of_y, launch.w
    d2 = fma(a, w, fma(eq.of_sin, launch.s, eq.of_1))
    d3 = fma(a, d2, fma(b, w, eq.of_sin * launch.c))
    d4 = fma(a, d3, fma(b, d2, -eq.of_sin * launch.s))
    # The root of w + d2 / 2 t + d3 / 6 t^2, and an iteration of Newton with the next term.
    inverse, left = 1.0 / d2, phase_step - launch.begin
    t = -2.0 * w * inverse
    t = 2.0 * t / (1.0 + np.sqrt(fma(4.0 / 3.0 * t, d3 * inverse, 1.0)))
    t -= d4 * t * t * t / fma(fma(3.0 * d4, t, 8.0 * d3), t, 12.0 * d2)
    seen = (t > 0.0) & (t < left)  # not if t is NaN
    far = (t > 0.5 * phase_step) & (left >= _FARTHEST * phase_step)
    late = select(seen & far, 1.0, 0.0)
    return Guess(late, select(seen, t - late * left, 0.5 * left), select(seen, 0.0, 1.0))


@inlined
def expand_near(eq, flight, free, end_wave, late):
    """Expand a flight as ``series`` does, about its start or, if `late` is 1, the step's end.

    `end_wave` is sine and cosine of the phase at the end of the step.
    """
    at_end = late > 0.0
    y, w = select(at_end, free.y, flight.y), select(at_end, free.w, flight.w)
    s, c = select(at_end, end_wave[0], flight.s), select(at_end, end_wave[1], flight.c)
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
def approach(k, guessed, phase_step):
    """Improve the guess of a root, with the terms of a series up to t^8; return its `t`."""
    t = guessed.t
    y, d, e = first_terms(k, t)
    j = fma(fma(fma(20.0 * k[6], t, 10.0 * k[5]), t, 4.0 * k[4]), t, k[3])
    change, _ = newton_step(y, d, e, j, 1.0 / phase_step)
    return t - select(guessed.none > 0.0, 0.0, change)


@inlined
def own_end(k, flight, free, late, phase_step):
    """Return the free end of a flight after a rebound as its own series gives it, if that is near.

    So a short flight has the digits of its own height. `k` is the series of ``expand_near``.
    """
    left = phase_step - flight.begin
    near = (late == 0.0) & (left < _FARTHEST * phase_step)
    y, w, _ = all_terms(k, left)
    return FreeEnd(select(near, y, free.y), select(near, w, free.w), free.bound)


@inlined
def _is_below(y_0, w_0, y_1, w_1, t, bound, per_step):
    """Whether a curve from y_0 <= 0 to y_1 <= 0 in the time `t` is proved to be below the stop."""
    n = t * per_step
    n *= n
    middle = fma(bound, n * n, fma((w_0 - w_1) * (1.0 / 3.0), t, y_0 + y_1))
    return (fma(w_0, t, 4.0 * y_0) < 0.0) & (fma(-w_1, t, 4.0 * y_1) < 0.0) & (middle < 0.0)


@inlined
def end_flight(flight, free, guessed, k, values, phase_step):
    """Find an impact to rounding, and prove that it is the first, or that there is none.

    `guessed` is the improved guess, `k` the series about the place that it refers to, `values` the
    result of ``all_terms`` there. Returns the length of the flight, the time from its end to the
    end of the step, w_i, and ``NOTHING``, ``FIRST`` or ``FREE``.
    """
    (y, d, e), t, per_step = values, guessed.t, 1.0 / phase_step
    j = fma(fma(fma(fma(35.0 * k[7], t, 20.0 * k[6]), t, 10.0 * k[5]), t, 4.0 * k[4]), t, k[3])
    change, left = newton_step(y, d, e, j, per_step)
    fourth = fma(fma(60.0 * k[6], t, 20.0 * k[5]), t, 4.0 * k[4])  # derivative, over 3!
    w_i = fma(fma(fma(-fourth, change, 3.0 * j), change, -2.0 * e), change, d)
    none = guessed.none > 0.0
    t -= select(none, 0.0, change)
    # The unit of the error: a rebound that returns soon has a relative one.
    launched = (flight.y == 0.0) & (guessed.late == 0.0)
    unit, change = select(launched, t, phase_step), abs(change)
    converged = (left * change < _RESIDUAL * unit) & (change < _LAST_CHANGE * unit)
    rest = phase_step - flight.begin
    begin = guessed.late * rest
    u, r = t + begin, (rest - begin) - t
    y_1, w_1 = select(none, y, 0.0), select(none, d, w_i)
    within = (min(u, r) > 0.0) & (abs(t) < _FARTHEST * phase_step) & (flight.y <= 0.0)
    below = within & _is_below(flight.y, flight.w, y_1, w_1, u, free.bound, per_step)
    # The slack excludes near grazes, also at the ends of both parts: they are counted.
    slack = free.bound * (-1.0 / 16.0)
    clear = (y < slack) & (free.y < slack) & ((flight.y < slack) | (flight.y == 0.0))
    clear = clear & _is_below(y, d, free.y, free.w, r, free.bound, per_step)
    clear, first = clear & below, below & converged & (w_i > 0.0)
    proved = select(none, select(clear, FREE, NOTHING), select(first, FIRST, NOTHING))
    return u, r, w_i, proved


@inlined
def rebound(eq, free, r, w_i, proved, phase_step):
    """Continue from an impact to the end of the step, and prove that there is no other.

    Parameters as returned by ``end_flight``. Returns the state at the end of the step, and what is
    proved.
    """
    per_step = 1.0 / phase_step
    of_y, of_w = impulse(eq.of_w, eq.of_y, r)
    launch = eq.R * w_i
    kick = select(proved == FREE, 0.0, w_i + launch)
    y, w = fma(-kick, of_y, free.y), fma(-kick, of_w, free.w)
    n = r * per_step
    n *= n
    middle = fma(free.bound, n * n, fma((launch + w) * (-1.0 / 3.0), r, y))
    only = max(max(y, fma(-w, r, 4.0 * y)), middle) < 0.0
    return y, w, select(only & (proved == FIRST), ONLY, proved)


@inlined
def launch_after(eq, wave, at, w_i):
    """Return the ``Flight`` that begins with the rebound from an impact.

    `wave` is sine and cosine of the phase at the start of the step.
    """
    s, c = sin_cos(at)
    s, c = fma(wave[0], c, wave[1] * s), fma(wave[1], c, -wave[0] * s)
    return Flight(0.0, -eq.R * w_i, s, c, at)


@jit
def meet_stop(eq, flight, free, end_wave, phase_step):
    """Follow a flight to the stop or to the end of the step; return its ``Impact``."""
    launched = flight.begin > 0.0
    if launched:
        guessed = guess_return(eq, flight, phase_step)
    else:
        guessed = guess(flight, free, phase_step)
    k = expand_near(eq, flight, free, end_wave, guessed.late)
    if launched:
        free = own_end(k, flight, free, guessed.late, phase_step)
    guessed = Guess(guessed.late, approach(k, guessed, phase_step), guessed.none)
    values = all_terms(k, guessed.t)
    u, r, w_i, proved = end_flight(flight, free, guessed, k, values, phase_step)
    y, w, proved = rebound(eq, free, r, w_i, proved, phase_step)
    return Impact(y, w, flight.begin + u, w_i, proved, free)
