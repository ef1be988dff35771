"""The least and the greatest displacement of a step, also where the mass turns within it.

Between its ends a flight turns where its speed changes sign. With the rule ``exact`` its Taylor
series about its start is right to rounding over the whole step. With time stepping the cubic
Hermite interpolant of the flight takes its place, from one state of the method to the next. A turn
of this cubic beyond the stop counts as a turn at the stop; a state beyond the stop counts as it is.
"""

from __future__ import annotations

from vibroimpact.jit import inlined, jit
from vibroimpact.step.contact import DISPLACEMENT, IMPACT, KIND, REST, SPEED, TIME, pressing
from vibroimpact.step.elementary import sin_cos
from vibroimpact.step.polynomial import (
    curvature,
    expand,
    greatest_third_derivative,
    turn_between,
    value_and_slope,
)
from vibroimpact.step.scheme import COS, SIN, THETA

# A flight in which the mass may turn is searched in so many equal pieces, so that it turns at most
# twice in a piece.
_PIECES = 4


@inlined
def widen(reach, x):
    """Let the least and the greatest displacement, ``reach``, include `x`."""
    reach[0], reach[1] = min(reach[0], x), max(reach[1], x)


@inlined
def _may_turn(slope_0, second_0, slope_1, second_1):
    """Whether a curve may turn between its ends, given its first two derivatives there."""
    falls, rises = slope_0 < 0.0 and slope_1 < 0.0, slope_0 > 0.0 and slope_1 > 0.0
    if falls:
        return second_0 > 0.0 > second_1
    if rises:
        return second_0 < 0.0 < second_1
    return True


@inlined
def _keeps_sign(slope_0, second_0, slope_1, second_1, jerk, width):
    """Whether a slope with the same sign at both ends of a piece is proved to keep it between them.

    `jerk` bounds the third derivative. Each end vouches for the half of the piece beside it.
    """
    half = 0.5 * width
    least = min(abs(slope_0) - half * abs(second_0), abs(slope_1) - half * abs(second_1))
    return least > 0.5 * jerk * half * half


@jit
def _root_of_curvature(c, low, high):
    """Return where the second derivative of a polynomial changes sign between `low` and `high`."""
    negative = curvature(c, 0, low) < 0.0
    for _ in range(52):
        u = 0.5 * (low + high)
        if (curvature(c, 0, u) < 0.0) == negative:
            low = u
        else:
            high = u
    return 0.5 * (low + high)


@jit
def _widen_between(c, low, high, slope_0, slope_1, clearance, reach):
    """Widen `reach` by the turning point of a polynomial between `low` and `high`, if any."""
    if slope_0 > 0.0 >= slope_1:
        y, _ = value_and_slope(c, 0, turn_between(c, 0, low, high))
        widen(reach, min(y, 0.0) + clearance)
    elif slope_0 < 0.0 <= slope_1:
        for k in range(c.size):
            c[k] = -c[k]
        y, _ = value_and_slope(c, 0, turn_between(c, 0, low, high))
        widen(reach, clearance - y)
        for k in range(c.size):
            c[k] = -c[k]


@jit
def _widen_by_polynomial(c, end, clearance, reach):
    """Widen `reach` by the turning points of the polynomial x(u) - stop from 0 to u = `end`."""
    low, jerk = 0.0, greatest_third_derivative(c, 0)
    slope_0, second_0 = c[1], 2.0 * c[2]
    for j in range(_PIECES):
        high = end if j + 1 == _PIECES else end * ((j + 1) / _PIECES)
        _, slope_1 = value_and_slope(c, 0, high)
        second_1 = curvature(c, 0, high)
        proved = _keeps_sign(slope_0, second_0, slope_1, second_1, jerk, high - low)
        if slope_0 == 0.0:  # the curve begins with a turn
            slope_0 = second_0
        if _may_turn(slope_0, second_0, slope_1, second_1):
            middle, slope = high, slope_1
            if (slope_0 < 0.0) == (slope_1 < 0.0) and not proved:
                middle = _root_of_curvature(c, low, high)
                _, slope = value_and_slope(c, 0, middle)
            _widen_between(c, low, middle, slope_0, slope, clearance, reach)
            _widen_between(c, middle, high, slope, slope_1, clearance, reach)
        low, slope_0, second_0 = high, slope_1, second_1


@jit
def _widen_by_flight(eq, begin, end, span, phase_step, pt, coefficients, reach):
    """Widen `reach` by the turning points of an exact flight that lasts for the phase `span`.

    `begin` is y, w, and sine and cosine of the phase there; `end` is y, w and the sine there.
    """
    (y, w, s, c), (y_T, w_T, s_T) = begin, end
    a = eq.of_w * w + eq.of_y * y + eq.of_sin * s + eq.of_1
    a_T = eq.of_w * w_T + eq.of_y * y_T + eq.of_sin * s_T + eq.of_1
    if span > 0.0 and _may_turn(w, a, w_T, a_T):
        expand(eq, y, w, s, c, phase_step, coefficients)
        _widen_by_polynomial(coefficients, span / phase_step, pt.clearance, reach)


@jit
def widen_by_exact_step(prepared, ends, n_events, grid, n, pt, scratch, reach):
    """Widen `reach` by step `n` of a grid with the rule ``exact``, between two states (y, w).

    A chatter that is summed has its lowest point in its first flight.
    """
    (eq, _), ((y, w, resting), end), (events, coefficients, _) = prepared, ends, scratch
    table, phase_step = grid.table, grid.phase_step
    theta, s, c, at = table[THETA, n], table[SIN, n], table[COS, n], 0.0
    for k in range(n_events):
        kind, then = events[k, KIND], events[k, TIME] * pt.omega
        s_T, c_T = sin_cos(theta + then)
        w_T = events[k, SPEED] / pt.omega if kind == IMPACT else 0.0
        if not resting:
            _widen_by_flight(
                eq, (y, w, s, c), (0.0, w_T, s_T), then - at, phase_step, pt, coefficients, reach
            )
        widen(reach, pt.clearance)
        y, w, s, c, at, resting = 0.0, -pt.R * w_T, s_T, c_T, then, kind == REST
    if not resting:
        last = end[0], end[1], table[SIN, n + 1]
        span = phase_step - at
        _widen_by_flight(eq, (y, w, s, c), last, span, phase_step, pt, coefficients, reach)
    widen(reach, min(end[0], 0.0) + pt.clearance)


@jit
def _widen_by_cubic(x, v, x_T, v_T, T, pt, coefficients, reach):
    """Widen `reach` by the turning points of the cubic from (x, v) to (x_T, v_T) after `T`."""
    rise, c = x_T - x, coefficients[:4]
    c[0], c[1] = x - pt.clearance, T * v
    c[2], c[3] = 3.0 * rise - T * (2.0 * v + v_T), T * (v + v_T) - 2.0 * rise
    if T > 0.0 and _may_turn(c[1], c[2], T * v_T, c[2] + 3.0 * c[3]):
        _widen_by_polynomial(c, 1.0, pt.clearance, reach)


@jit
def widen_by_step(_, ends, n_events, grid, n, pt, scratch, reach):
    """Widen `reach` by step `n` of a grid with a rule of time stepping, between two states (x, v).

    The first flight of a chatter that is summed is a parabola, as its sum takes it to be.
    """
    ((x, v, resting), end), (events, coefficients, _) = ends, scratch
    at, launched = 0.0, False
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
                widen(reach, x - v * (0.5 * v / a))
            else:
                _widen_by_cubic(x, v, x_T, v_T, then - at, pt, coefficients, reach)
        widen(reach, x_T)
        launched, resting = kind == IMPACT, kind == REST
        x, v, at = pt.clearance, -pt.R * v_T, then
    if not resting:
        T = grid.phase_step / pt.omega
        _widen_by_cubic(x, v, end[0], end[1], T - at, pt, coefficients, reach)
    widen(reach, end[0])
