"""Bounds a flight; widens the extremes (least, greatest x), also where the mass turns.

The extremes are a pair, of x, or with the rule ``exact`` of y in the units of ``propagator.py``. A
flight that is proved to stay within the extremes so far is not searched. Between its ends a flight
turns where its speed changes sign.

**Exact impacts.** Let a flight go from (y_0, w_0) to (y_1, w_1) in the time t. Its cubic Hermite
interpolant has the Bernstein coefficients y_0, P = y_0 + w_0 t / 3, Q = y_1 - w_1 t / 3 and y_1.
With |y''''| <= A_4 and E = A_4 t^4 / 72, as in ``propagator.py``, the flight differs from it by
less than E / 2. The first two derivatives differ by at most sqrt(3) / 216 A_4 t^3 and A_4 t^2 / 12
(Birkhoff and Priver, 1967). With A = w_0 t, M = 3 (Q - P) and B = w_1 t, the Bernstein coefficients
of t y', this proves:

- If M - A and B - M exceed 3 E, the flight is convex, and turns once if A < 0 < B. It is concave if
  both are below -3 E.
- If A, M and B all exceed .6 E, or are all below -.6 E, the flight does not turn.

A single turn is found in three stages without branches, which serve the columns of a vector and a
single orbit alike. The interpolant gives a guess. The flight is expanded about the nearer of its
start and the end of the step, and Newton's method, with two further terms of the reversed series,
is applied to the speed. There y is evaluated, less w^2 / (2 y''), which leaves an error of third
order. Any other flight is cut into eighths until this proves something of its pieces. Near the free
oscillation nothing is searched, see ``propagator.py``.

**Time stepping.** The cubic Hermite interpolant takes the place of the flight, from one state of
the method to the next. A turn of this cubic beyond the stop counts as a turn at the stop; a state
beyond the stop counts as it is.
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact.jit import fma, inlined, jit, select
from vibroimpact.step.contact import DISPLACEMENT, IMPACT, KIND, REST, SPEED, TIME, pressing
from vibroimpact.step.elementary import sin_cos
from vibroimpact.step.impact import (
    FREE,
    NOTHING,
    ONLY,
    FreeEnd,
    all_terms,
    expand_near,
    first_terms,
    launch_after,
    newton_step,
)
from vibroimpact.step.polynomial import expand, turn_between, value_and_slope
from vibroimpact.step.scheme import THETA

#: The extremes of a motion that is not recorded: nothing widens them.
EVERYTHING = -math.inf, math.inf

# Newton's method has converged if its next change is below this share of the flight: the error of y
# is of third order.
_LAST_CHANGE = 1e-6
# Pieces narrower than this share of a step turn by rounding only.
_NARROWEST = 2.0**-17
_MOST_PIECES = 2**19


@inlined
def extremes_with(extremes, low, high):
    """Return the extremes that include `low` and `high`."""
    return min(extremes[0], low), max(extremes[1], high)


@inlined
def extremes_of_x(extremes, first, last, clearance, exactly):
    """Return the extremes of x from `first` to `last`, given those of x or, if `exactly`, of y."""
    low, high = extremes
    if exactly:
        low, high = low + clearance, high + clearance
    return min(low, min(first, last)), max(high, max(first, last))


@inlined
def widen_near(steady, forms, y, w, extremes):
    """Return the extremes that include a period of a motion that is near at its start."""
    (low_y, low_w), (high_y, high_w) = forms
    off, rate = y - steady.y, w - steady.w
    low = fma(low_y, off, fma(low_w, rate, steady.low))
    high = fma(high_y, off, fma(high_w, rate, steady.high))
    return extremes_with(extremes, min(low, y), max(high, y))


@inlined
def bounds(y_0, w_0, y_1, w_1, t, bound):
    """Return bounds of a flight in the time `t`, apart from its start; E is `bound`."""
    P, Q = fma(w_0, t * (1.0 / 3.0), y_0), fma(-w_1, t * (1.0 / 3.0), y_1)
    return fma(-0.5, bound, min(min(P, Q), y_1)), fma(0.5, bound, max(max(P, Q), y_1))


@inlined
def may_widen(extremes, limits):
    """Whether a flight with these ``bounds`` may widen extremes of y, which the stop limits."""
    return limits[0] < extremes[0] or min(limits[1], 0.0) > extremes[1]


@inlined
def part_of(bound, t, phase_step):
    """Return the E of the part `t` of a step, given that of the step."""
    n = t / phase_step
    n *= n
    return bound * (n * n)


@inlined
def guess_turn(y_0, w_0, y_1, w_1, t, bound):
    """Return where a flight in the time `t` turns, as a share of `t`, and whether it does.

    It turns once or not at all if the third value is true; else nothing is proved. Single precision
    is enough for a guess.
    """
    A, B = w_0 * t, w_1 * t
    M = fma(3.0, y_1 - y_0, -(A + B))
    least, most = min(M - A, B - M), max(M - A, B - M)
    bent = (least > 3.0 * bound) | (most < -3.0 * bound)
    inverse = 1.0 / abs(A)
    q, p = np.float32(select(A < 0.0, M, -M) * inverse), np.float32(abs(B) * inverse)
    n = np.float32(1.0) / (np.float32(1.0) + q + np.sqrt(q * q + p))
    return (
        np.float64(n),
        bent & (min(A, B) < 0.0) & (max(A, B) > 0.0),
        bent | goes_one_way(y_0, w_0, y_1, w_1, t, bound),
    )


@inlined
def goes_one_way(y_0, w_0, y_1, w_1, t, bound):
    """Whether ``guess_turn`` finds that a flight in the time `t` does not turn."""
    A, B = w_0 * t, w_1 * t
    M = fma(3.0, y_1 - y_0, -(A + B))
    return max(min(min(A, M), B), -max(max(A, M), B)) > 0.6 * bound


@inlined
def late_from(t, rest, phase_step):
    """Return 1. if `t` is nearer to the end of the step, `rest` after the start, else 0."""
    return select((t > 0.5 * phase_step) & (rest - t < t), 1.0, 0.0)


@inlined
def approach_turn(k, t, phase_step):
    """Improve the guess `t` of a turn, with terms of a series up to t^8; return it and y'' / 2."""
    _, d, e = first_terms(k, t)
    j = fma(fma(fma(fma(35.0 * k[7], t, 20.0 * k[6]), t, 10.0 * k[5]), t, 4.0 * k[4]), t, k[3])
    fourth = fma(fma(60.0 * k[6], t, 20.0 * k[5]), t, 4.0 * k[4])
    change, _ = newton_step(d, 2.0 * e, 3.0 * j, fourth, 1.0 / phase_step)
    return t - change, fma(-3.0 * j, change, e)


@inlined
def turn_at(k, t, bend):
    """Return y where a series turns near `t`, and how far from it; `bend` is y'' / 2 there."""
    y, d, _ = all_terms(k, t)
    change = d * (0.5 / bend)
    return fma(-0.5 * d, change, y), change


@inlined
def is_settled(t, change, length):
    """Whether the turn of a flight, at the time `t` of its `length`, is found."""
    return (abs(change) < _LAST_CHANGE * length) & (t > 0.0) & (t < length)


@jit
def _search(eq, start, span, bound, phase_step, c, extremes):
    """Return the extremes that include a flight for the phase `span` from a `start` y, w, s, c."""
    y, w, s, wave = start
    expand(eq, y, w, s, wave, phase_step, c)
    end, a, width = span / phase_step, 0.0, span / phase_step
    y_0, w_0 = c[0], c[1]
    for _ in range(_MOST_PIECES):
        if not (a < end and bound < math.inf):
            break
        b = end if a + width >= end else a + width
        y_1, w_1 = value_and_slope(c, 0, b)
        h = b - a
        of_piece = part_of(bound, h, 1.0)
        if may_widen(extremes, bounds(y_0, w_0, y_1, w_1, h, of_piece)):
            _, turns, sure = guess_turn(y_0, w_0, y_1, w_1, h, of_piece)
            if not sure and h > _NARROWEST:
                width = 0.125 * h
                continue
            extremes = extremes_with(extremes, y_1, min(y_1, 0.0))
            if turns:
                sign = -1.0 if w_0 < 0.0 else 1.0
                for k in range(c.size):
                    c[k] *= sign
                y, _ = value_and_slope(c, 0, turn_between(c, 0, a, b))
                for k in range(c.size):
                    c[k] *= sign
                extremes = extremes_with(extremes, sign * y, min(sign * y, 0.0))
        a, y_0, w_0, width = b, y_1, w_1, 8.0 * h
    return extremes


@jit
def widen_by_flight(eq, flight, free, end_wave, end, phase_step, c, extremes):
    """Return the extremes that include a flight of a step with the rule ``exact``.

    `free` and `end_wave` are the end of the step without impacts, and sine and cosine of the phase
    there. `end` is y and w at the end of the flight, and its length.
    """
    y_1, w_1, t = end
    bound, rest = part_of(free.bound, t, phase_step), phase_step - flight.begin
    if not may_widen(extremes, bounds(flight.y, flight.w, y_1, w_1, t, bound)):
        return extremes
    n, turns, sure = guess_turn(flight.y, flight.w, y_1, w_1, t, bound)
    if sure:
        extremes = extremes_with(extremes, y_1, min(y_1, 0.0))
        if not turns:
            return extremes
        late = late_from(n * t, rest, phase_step)
        k = expand_near(eq, flight, free, end_wave, late)
        u, bend = approach_turn(k, n * t - late * rest, phase_step)
        y, change = turn_at(k, u, bend)
        if is_settled(u + late * rest, change, t):
            return extremes_with(extremes, y, min(y, 0.0))
    start = flight.y, flight.w, flight.s, flight.c
    return _search(eq, start, t, free.bound, phase_step, c, extremes)


@jit
def widen_by_impact(eq, flight, impact, waves, phase_step, c, extremes):
    """Return the extremes that include a flight with its ``Impact``, and with ``ONLY`` the next.

    `waves` holds sine and cosine of the phase at the start of the step, and at its end.
    """
    (y, w, at, w_i, proved, free), (wave, end_wave) = impact, waves
    if proved == FREE:
        end = y, w, phase_step - flight.begin
        return widen_by_flight(eq, flight, free, end_wave, end, phase_step, c, extremes)
    if proved == NOTHING:
        return extremes
    extremes, left = extremes_with(extremes, 0.0, 0.0), phase_step - at
    end = 0.0, w_i, at - flight.begin
    extremes = widen_by_flight(eq, flight, free, end_wave, end, phase_step, c, extremes)
    bound = part_of(free.bound, left, phase_step)
    if proved == ONLY and bounds(0.0, -eq.R * w_i, y, w, left, bound)[0] < extremes[0]:
        flight, free = launch_after(eq, wave, at, w_i), FreeEnd(y, w, free.bound)
        end = y, w, left
        extremes = widen_by_flight(eq, flight, free, end_wave, end, phase_step, c, extremes)
    return extremes


@jit
def widen_by_events(
    eq, flight, resting, end, rows, theta, bound, phase_step, pt, scratch, extremes
):
    """Return the extremes that include all from a `flight`, or a rest, to `end` of ``exact_step``.

    `rows` are the first of its events and the one after the last. A chatter that is summed has its
    lowest point in its first flight.
    """
    (y, w, s, c, at), (events, coefficients, _) = flight, scratch
    for k in range(rows[0], rows[1]):
        kind, then = events[k, KIND], events[k, TIME] * pt.omega
        w_T, low = 0.0, -math.inf
        if kind == IMPACT:
            w_T = events[k, SPEED] / pt.omega
            low, _ = bounds(y, w, 0.0, w_T, then - at, part_of(bound, then - at, phase_step))
        if not resting and low < extremes[0]:
            start = y, w, s, c
            extremes = _search(eq, start, then - at, bound, phase_step, coefficients, extremes)
        extremes = extremes_with(extremes, 0.0, 0.0)
        s, c = sin_cos(theta + then)
        y, w, at, resting = 0.0, -pt.R * w_T, then, kind == REST
    if resting:
        return extremes_with(extremes, 0.0, 0.0)
    left = phase_step - at
    limits = bounds(y, w, end[0], end[1], left, part_of(bound, left, phase_step))
    if may_widen(extremes, limits):
        extremes = _search(eq, (y, w, s, c), left, bound, phase_step, coefficients, extremes)
    return extremes_with(extremes, min(end[0], 0.0), min(end[0], 0.0))


@jit
def _widen_by_cubic(x, v, x_T, v_T, T, stop, extremes):
    """Return the extremes that include the turning points of a cubic from (x, v) to (x_T, v_T)."""
    low, high = bounds(x, v, x_T, v_T, T, 0.0)
    size = max(abs(v), abs(v_T)) * T + abs(x_T - x)
    if (low < extremes[0] or high > extremes[1]) and 0.0 < size < math.inf:
        # As in the text above, in units of the size, so that squares neither overflow nor vanish.
        A, B = v * T / size, v_T * T / size
        M = 3.0 * ((x_T - x) / size) - (A + B)
        bend, third, square = M - A, A + B - 2.0 * M, M * M - A * B
        if square >= 0.0:
            q = -(bend + math.copysign(math.sqrt(square), bend))
            for n in (q / third, A / q):
                if 0.0 < n < 1.0:
                    y = x + size * (n * (A + n * (bend + n * third / 3.0)))
                    y = min(max(y, min(x, low)), max(x, high))  # not beyond, by rounding
                    extremes = extremes_with(extremes, y, min(y, stop))
    return extremes


@jit
def widen_by_step(start, end, n_events, grid, n, pt, events, extremes):
    """Return the extremes that include step `n` of a grid with a rule of time stepping.

    `start` and `end` are states (x, v, resting). The first flight of a chatter that is summed is a
    parabola, as its sum takes it to be.
    """
    (x, v, resting), at, launched = start, 0.0, False
    for k in range(n_events):
        kind, then = events[k, KIND], events[k, TIME]
        x_T, v_T = pt.clearance, 0.0
        if kind == IMPACT:
            x_T, v_T = events[k, DISPLACEMENT], events[k, SPEED]
        if not resting:
            a = 0.0
            if launched and kind == REST:
                a = pressing(sin_cos(grid.table[THETA, n] + pt.omega * at)[0], pt)
            if -v <= a * (then - at) and a > 0.0:
                low = x - v * (0.5 * v / a)
                extremes = extremes_with(extremes, low, low)
            else:
                extremes = _widen_by_cubic(x, v, x_T, v_T, then - at, pt.clearance, extremes)
        extremes = extremes_with(extremes, x_T, x_T)
        launched, resting = kind == IMPACT, kind == REST
        x, v, at = pt.clearance, -pt.R * v_T, then
    if not resting:
        T = grid.phase_step / pt.omega - at
        extremes = _widen_by_cubic(x, v, end[0], end[1], T, pt.clearance, extremes)
    return extremes_with(extremes, end[0], end[0])
