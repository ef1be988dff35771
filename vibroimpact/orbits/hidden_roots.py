"""Proves that a step along a path hides no roots of test functions.

Along a branch or a curve the test functions are smooth:

    the distances of the free parameters from both edges of their ranges;
    on a branch the flip and the fold, det J(mu) at mu = -1 and +1; on a curve of grazes their
    meeting, the middle coefficient of det J(mu).

The signs at both ends of a step show one root, but not two. The values and slopes there give the
cubic Hermite interpolant. It has no more roots than the control polygon of its Bernstein form has
changes of sign (Farin 2002, ch. 5). The inner points of the polygon are allowed an error as large
as their distance from the chord. If even with this error the polygon has only the changes of sign
that its ends show, the step misses nothing; otherwise it is halved. With a, b at the ends and
a', b' the slopes times the length, the inner points that are farther from the chord by this error
are

    (4 a + 2 a' - b) / 3,    (4 b - 2 b' - a) / 3.

Flights are tested alike: if the polynomials of a flight at these points are below the stop, so is
every flight within the step. The polynomials are divided by their roots at the ends, so this also
proves that the impacts have positive speeds. A step is also halved if the natural oscillation of a
flight advances so far over it that the functions might oscillate unseen.
"""

from __future__ import annotations

import math

from vibroimpact.jit import jit
from vibroimpact.orbits.corrector import (
    FLIGHT_DIFFERENCE,
    FOLD,
    GRAZE,
    NONE,
    linearised_flights,
    parameters_at,
)
from vibroimpact.orbits.flights import (
    is_below,
    parameters_in,
    phase_of_landing,
    polynomials,
    steps_of,
    zeros_of,
)
from vibroimpact.orbits.unknowns import (
    ROUNDING,
    characteristic_polynomial,
    filled,
    free_at,
    inner,
    moved,
    phase_at,
    speed_at,
)
from vibroimpact.step.elementary import larger, smaller
from vibroimpact.step.polynomial import TERMS, first_crossing

#: Step of the central differences of a condition. It is short because a condition varies over far
#: less than an orbit does where all impacts of a long orbit are slow. A parameter in units of a
#: narrow span is a large number: the step is at least ``_DIFFERENCE_SHARE`` of it, far above its
#: rounding, but at most the step for flights.
_DIFFERENCE, _DIFFERENCE_SHARE = 1e-9, 1e-12
#: A change of a test function over this step is rounding if it is less than this share of the
#: larger of the two tests at the point; its slope is then zero.
_ROUNDINGS = 16.0 * 2.0**-52
#: The natural oscillation of a flight advances by less than this in a step [rad].
_MOST_ADVANCE = 1.0
#: The difference of the halves of an orbit falls in a step along a curve of folds to no less than
#: this share. The curve ends where it vanishes (``singular_ends.py``).
_LEAST_LEFT = 0.25


@jit
def difference(system, X):
    """Return the step for the difference of a condition."""
    step = _DIFFERENCE
    for i in range(system.q):
        step = larger(step, _DIFFERENCE * abs(X[speed_at(i)]))
    for i in range(free_at(system.q, 0), X.size):
        step = larger(step, smaller(_DIFFERENCE_SHARE * abs(X[i]), FLIGHT_DIFFERENCE))
    return step


@jit
def _size_of_rounding(system):
    """Return a power of two to which the rounding of det J(mu) is proportional: that of the speeds.

    Over wide ranges the speeds of an orbit may be far below 1 in natural units.
    """
    pt = parameters_in(system.point)
    _, exponent = math.frexp(pt.f / (pt.omega + pt.p))
    return math.ldexp(1.0, exponent)


@jit
def _fill_tests(system, X, bounds, values):
    """Set the test functions at a point."""
    q, k = system.q, system.free.size
    for j in range(k):
        values[2 * j] = X[free_at(q, j)] - bounds[j, 0]
        values[2 * j + 1] = bounds[j, 1] - X[free_at(q, j)]
    first, second = math.nan, math.nan
    if system.condition == NONE or system.condition == GRAZE:
        _, A, B = linearised_flights(system, X)
        c0, c1, c2 = characteristic_polynomial(A, B)
        if system.condition == NONE:
            # Where an orbit becomes one of half its period, the double root of the fold is
            # divided out.
            square = _product_of_halves(X, X, system.m, q)
            first = c0 - c1 + c2
            second = (c0 + c1 + c2) / square if square > ROUNDING else math.nan
        else:  # c1 and its rounding decay with the flow over the m periods; undo this
            pt = parameters_at(system, X)
            T = 2.0 * math.pi * system.m / pt.omega
            first = c1 * math.exp(pt.h * T) / ((2.0 * pt.h + pt.p + pt.omega) * T)
    size = _size_of_rounding(system)
    values[2 * k], values[2 * k + 1] = first / size, second / size


@jit
def _product_of_halves(X, Y, m, q):
    """Return the mean product of the differences of the halves of two orbits; 1 without halves."""
    if m % 2 or q % 2:
        return 1.0
    product, turn = 0.0, math.pi * m
    for i in range(q // 2):
        j = i + q // 2
        phase = X[phase_at(j)] - X[phase_at(i)] - turn
        speed = X[speed_at(j)] - X[speed_at(i)]
        product += phase * (Y[phase_at(j)] - Y[phase_at(i)] - turn) / q
        product += speed * (Y[speed_at(j)] - Y[speed_at(i)]) / q
    return product


@jit
def set_test_functions(system, X, tangent, bounds, tests):
    """Set the test functions at a point and their slopes along a tangent, shape (2, 2 k + 2).

    They are in the order of the docstring of this module; NaN where one does not apply. `bounds`,
    shape (k, 2), are the edges of the free parameters in their units in X.
    """
    q, k, step = system.q, system.free.size, difference(system, X)
    _fill_tests(system, X, bounds, tests[0])
    _fill_tests(system, moved(X, step, tangent), bounds, tests[1])
    first, second = abs(tests[0, 2 * k]), abs(tests[0, 2 * k + 1])  # the second may be NaN
    rounding = _ROUNDINGS * larger(first, second)
    for i in range(2 * k + 2):
        change = tests[1, i] - tests[0, i]
        tests[1, i] = 0.0 if abs(change) <= rounding else change / step
    for j in range(k):
        tests[1, 2 * j] = tangent[free_at(q, j)]
        tests[1, 2 * j + 1] = -tangent[free_at(q, j)]


@jit
def may_have_more_roots(a, slope_a, b, slope_b):
    """Whether a function may have more roots in a step than the signs at its ends show."""
    start = a if abs(a) > ROUNDING else b
    if not abs(start) > ROUNDING:
        return False
    sign = 1.0 if start > 0.0 else -1.0
    first, second = sign * (4.0 * a + 2.0 * slope_a - b), sign * (4.0 * b - 2.0 * slope_b - a)
    if sign * b > 0.0 or not abs(b) > ROUNDING:
        return first < 0.0 or second < 0.0
    least, greatest = smaller(first, sign * (2.0 * a + b)), larger(second, sign * (2.0 * b + a))
    return least < 0.0 and greatest > 0.0


@jit
def _oscillates_far(system, X, Y):
    """Whether the natural oscillation of a flight advances far between two points."""
    pt, pt_Y, q = parameters_at(system, X), parameters_at(system, Y), system.q
    for i in range(q):
        flight = phase_of_landing(system.m, X, q, i) - X[phase_at(i)]
        flight_Y = phase_of_landing(system.m, Y, q, i) - Y[phase_at(i)]
        advance, advance_Y = flight * pt.p / pt.omega, flight_Y * pt_Y.p / pt_Y.omega
        if abs(advance_Y - advance) > _MOST_ADVANCE:
            return True
    return False


@jit
def _flights(system, X, tangent, i, n, zeros):
    """Return the polynomials of a flight and their slopes along the tangent."""
    step = larger(FLIGHT_DIFFERENCE, difference(system, X))
    above, below = moved(X, step, tangent), moved(X, -step, tangent)
    m, q = system.m, system.q
    C, _ = polynomials(parameters_at(system, X), m, X, q, i, n, zeros)
    slopes, _ = polynomials(parameters_at(system, above), m, above, q, i, n, zeros)
    down, _ = polynomials(parameters_at(system, below), m, below, q, i, n, zeros)
    for k in range(n):
        for j in range(TERMS):
            slopes[k, j] = (slopes[k, j] - down[k, j]) / (2.0 * step)
    return C, slopes


@jit
def _may_meet(c, begin, slopes, end, k, length):
    """Whether step k of a flight may meet the stop at the control point near an end; sets `c`."""
    for j in range(TERMS):
        c[j] = 4.0 * begin[k, j] + 2.0 * length * slopes[k, j] - end[k, j]
    return not is_below(c) and first_crossing(c, 0, 1.0)[0] >= 0.0


@jit
def _may_penetrate(system, X, tangent, Y, tangent_Y, length, length_Y):
    """Whether a flight may meet the stop within a step from X to Y."""
    m, q, c = system.m, system.q, filled(TERMS, 0.0)
    pt, pt_Y = parameters_at(system, X), parameters_at(system, Y)
    for i in range(q):
        # The flights of a difference must have the same number of steps.
        n, n_Y = 1 + steps_of(pt, m, X, q, i), 1 + steps_of(pt_Y, m, Y, q, i)
        n = n if n > n_Y else n_Y
        first, last = zeros_of(pt.R, X, q, i)
        first_Y, last_Y = zeros_of(pt_Y.R, Y, q, i)
        zeros = first if first < first_Y else first_Y, last if last < last_Y else last_Y
        a, a_slope = _flights(system, X, tangent, i, n, zeros)
        b, b_slope = _flights(system, Y, tangent_Y, i, n, zeros)
        for k in range(n):
            if _may_meet(c, a, a_slope, b, k, length):
                return True
            if _may_meet(c, b, b_slope, a, k, -length_Y):
                return True
    return False


@jit
def _may_have_cusps(system, X, tangent, Y, tangent_Y, length):
    """Whether both parameters may turn back twice, by the control points of their derivative."""
    together, middle, bend, size = 0.0, 0.0, 0.0, 0.0
    cosine = inner(tangent, tangent_Y, system.q)
    for j in range(free_at(system.q, 0), X.size):
        a, b = tangent[j], tangent_Y[j] / cosine
        c = 3.0 * (Y[j] - X[j]) / length - a - b
        together, size = together + a * b, size + a * a
        off = c - 0.5 * (a + b)
        middle, bend = middle + a * c, bend + off * off
    return together > 0.0 and middle < math.sqrt(size * bend)


@jit
def step_may_miss(system, begin, end, length):
    """Whether a step may miss roots of the test functions, or points that are not orbits.

    It leads from a point to another (`PlainPoint`); `length` is its length along the first
    tangent.
    """
    X, tangent, tests = begin
    Y, tangent_Y, tests_Y = end
    if _oscillates_far(system, X, Y):
        return True
    length_Y = length / inner(tangent, tangent_Y, system.q)
    for i in range(tests.shape[1]):
        slopes = length * tests[1, i], length_Y * tests_Y[1, i]
        if may_have_more_roots(tests[0, i], slopes[0], tests_Y[0, i], slopes[1]):
            return True
    if not system.touches and _may_penetrate(system, X, tangent, Y, tangent_Y, length, length_Y):
        return True
    if system.condition != FOLD:
        return False
    m, q = system.m, system.q  # the halves may change places where their difference falls so far
    if _product_of_halves(X, Y, m, q) < _LEAST_LEFT * _product_of_halves(X, X, m, q):
        return True
    return _may_have_cusps(system, X, tangent, Y, tangent_Y, length)
