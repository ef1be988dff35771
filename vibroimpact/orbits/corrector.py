"""The corrector: Newton's method onto an orbit, a point of a branch, or one of a curve.

With k free parameters the orbits are a manifold of k dimensions in the space of the unknowns
(``unknowns.py``): k = 0 is an orbit, k = 1 a branch, k = 2 a surface on which each kind of
bifurcation is a curve. The linearised flights (``flights.py``) and the planes given by a predictor
are linear equations (``linear.py``). With one plane for each parameter their shortest solution is
the Newton step. With one plane less the condition of a bifurcation says how far to go along the
null vector,

    flip, fold:  det J(mu) = 0 at mu = -1, +1;      graze:  v_k = 0.

Derivatives with respect to z are exact. Those with respect to parameters, and those of
det J(mu), are central differences: they steer the iteration, but its limit does not depend on
them.

**Whether a step may miss something.** Along a branch or a curve the test functions are smooth:

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
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import jit
from vibroimpact.orbits.flights import (
    is_below,
    parameters_in,
    phase_of_landing,
    polynomials,
    residuals,
    steps_of,
    time_steps,
    zeros_of,
)
from vibroimpact.orbits.linear import (
    Equations,
    characteristic_and_slopes,
    characteristic_polynomial,
    solve,
)
from vibroimpact.orbits.unknowns import (
    ROUNDING,
    distance_of_halves,
    filled,
    free_at,
    halves_may_meet,
    inner,
    moved,
    pairs,
    phase_at,
    speed_at,
    zero_rows,
)
from vibroimpact.step.elementary import larger, smaller
from vibroimpact.step.polynomial import TERMS, first_crossing

# Conditions of ``System``.
NONE, FLIP, FOLD, GRAZE = range(4)

#: Step of the central differences of flights; this one has the least error.
FLIGHT_DIFFERENCE = 6e-6
#: Step of the central differences of a condition. It is short because a condition varies over far
#: less than an orbit does where all impacts of a long orbit are slow. A parameter in units of a
#: narrow span is a large number: the step is at least ``_DIFFERENCE_SHARE`` of it, far above its
#: rounding, but at most the step for flights.
_DIFFERENCE, _DIFFERENCE_SHARE = 1e-9, 1e-12
#: The iteration ends after a step shorter than the first, or after a step that is shorter than the
#: second and longer than half the step before it. The third is the same for the rounding of a
#: parameter in units of a narrow span, as a share of it.
_CONVERGED, _STALLED, _ROUNDED = 1e-12, 1e-7, 2.0**-50
#: Most halvings of a Newton step, and the share of its length that a flight keeps in a step.
_HALVINGS, _SHORTEST = 8, 0.1
#: The natural oscillation of a flight advances by less than this in a step [rad].
_MOST_ADVANCE = 1.0
#: Where the parameters of a curve of folds move by less than this share of its tangent, their
#: direction is rounding.
HEADING = 1e-5


class System(NamedTuple):
    """The data that do not change in an iteration, in natural units."""

    point: np.ndarray  # the numbers of a ``POINT``; those of `free` are taken from X instead
    free: np.ndarray  # indices of the free parameters, (k,); k <= 2 in an iteration
    spans: np.ndarray  # their units in X, (k,)
    m: int  # forcing periods
    q: int  # impacts
    condition: int  # the bifurcation to move onto
    graze: int  # index of the impact that grazes
    touches: bool  # whether flights between the impacts touch the stop, too, and never cross it
    work: np.ndarray  # receives the number of time steps taken, (1,)


@jit
def _numbers_at(system, X):
    """Return the numbers of the ``POINT`` at a vector of unknowns."""
    numbers = system.point.copy()
    for j in range(system.free.size):
        numbers[system.free[j]] = X[free_at(system.q, j)] * system.spans[j]
    return numbers


@jit
def parameters_at(system, X):
    """Return the ``Parameters`` at a vector of unknowns."""
    return parameters_in(_numbers_at(system, X))


@jit
def linearised_flights(system, X):
    """Return F, A and B of the flights at a vector of unknowns (``flights.residuals``)."""
    pt = parameters_at(system, X)
    system.work[0] += time_steps(pt, system.m, system.q)
    return residuals(pt, system.m, X, system.q)


@jit
def _largest(F):
    size = 0.0
    for i in range(F.shape[0]):
        size = larger(larger(size, abs(F[i, 0])), abs(F[i, 1]))
    return size


@jit
def _parameter_slopes(system, X):
    """Return the derivatives of the residuals with respect to the free parameters, (q, 2, k)."""
    q, numbers = system.q, _numbers_at(system, X)
    D = pairs(q, system.free.size)
    steps = time_steps(parameters_in(numbers), system.m, q)
    system.work[0] += 2 * system.free.size * steps
    for j in range(system.free.size):
        at, span = system.free[j], system.spans[j]
        value = numbers[at]
        step = FLIGHT_DIFFERENCE * larger(abs(value), 0.1 * span)
        numbers[at] = value + step
        above, _, _ = residuals(parameters_in(numbers), system.m, X, q)
        numbers[at] = value - step
        below, _, _ = residuals(parameters_in(numbers), system.m, X, q)
        numbers[at] = value
        for i in range(q):
            for row in range(2):
                D[i, row, j] = (above[i, row] - below[i, row]) * (0.5 * span / step)
    return D


@jit
def _newton_step(system, X, origin, planes, P, N):
    """Set P to the shortest step onto the linearised orbits in planes, and N to null vectors.

    Return the largest residual; inf if impacts are out of order or the rank is lost.
    """
    q = system.q
    F, A, B = linearised_flights(system, X)
    size = _largest(F)
    if not size < math.inf:
        return math.inf
    block = 2 + system.free.size
    right = filled(block * (q - 1) + 2 + planes.shape[0], 0.0)
    for i in range(q):
        right[block * i], right[block * i + 1] = -F[i, 0], -F[i, 1]
    for i in range(planes.shape[0]):
        at = block * (q - 1) + 2 + i
        right[at] = inner(planes[i], origin, q) - inner(planes[i], X, q)
    equations = Equations(A, B, _parameter_slopes(system, X), planes, right)
    return size if solve(equations, P, N) else math.inf


@jit
def _condition(system, X):
    """Return the function that is zero at the bifurcation; NaN if impacts are out of order."""
    if system.condition == GRAZE:
        return X[speed_at(system.graze)]
    F, A, B = linearised_flights(system, X)
    if not _largest(F) < math.inf:
        return math.nan
    c0, c1, c2 = characteristic_polynomial(A, B)
    return c0 + c2 + (c1 if system.condition == FOLD else -c1)


@jit
def determinant(pt, m, q):
    """Return the product of both Floquet multipliers: R^(2q) exp(-4 pi h m / omega)."""
    return pt.R ** (2.0 * q) * math.exp(-4.0 * math.pi * pt.h * m / pt.omega)


@jit
def set_multipliers(system, X, parts):
    """Set the real and the imaginary parts of both multipliers, the larger first, (4,)."""
    _, A, B = linearised_flights(system, X)
    _, c1, c2 = characteristic_polynomial(A, B)
    trace = -c1 / c2 if c2 != 0.0 else math.inf
    product = determinant(parameters_at(system, X), system.m, system.q)
    discriminant = trace * trace - 4.0 * product
    root = math.copysign(math.sqrt(abs(discriminant)), trace)
    if discriminant < 0.0:
        parts[0], parts[1], parts[2], parts[3] = 0.5 * trace, 0.5 * root, 0.5 * trace, -0.5 * root
    else:
        most = 0.5 * (trace + root)
        parts[0], parts[1], parts[3] = most, 0.0, 0.0
        parts[2] = product / most if most != 0.0 else 0.0


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
def _gradient(system, X, along):
    """Return the derivative along a vector of the condition, where the condition is zero."""
    if system.condition == GRAZE:
        return along[speed_at(system.graze)]
    q, fastest = system.q, 0.0
    for i in range(q):  # no unknown moves by more than this share of its size
        fastest = larger(fastest, abs(along[phase_at(i)]))
        fastest = larger(fastest, abs(along[speed_at(i)]) / larger(abs(X[speed_at(i)]), 1.0))
    for i in range(free_at(q, 0), X.size):
        fastest = larger(fastest, abs(along[i]) / larger(abs(X[i]), 0.1))
    step = FLIGHT_DIFFERENCE / fastest
    _, above, above_B = linearised_flights(system, moved(X, step, along))
    _, A, B = linearised_flights(system, moved(X, -step, along))
    dA, dB = pairs(q, 2), pairs(q, 2)
    for i in range(q):
        for j in range(2):
            for k in range(2):
                dA[i, j, k] = (above[i, j, k] - A[i, j, k]) / (2.0 * step)
                dB[i, j, k] = (above_B[i, j, k] - B[i, j, k]) / (2.0 * step)
                A[i, j, k] += step * dA[i, j, k]  # now at X
                B[i, j, k] += step * dB[i, j, k]
    _, (s0, s1, s2) = characteristic_and_slopes(A, B, dA, dB)
    return s0 + s2 + (s1 if system.condition == FOLD else -s1)


@jit
def set_tangent(system, X, P):
    """Set P to the direction of a branch (k = 1) or a curve (k = 2); P[0] is NaN if it has none."""
    k, N = system.free.size, zero_rows(system.free.size, X.size)
    if not _newton_step(system, X, X, zero_rows(0, X.size), P, N) < math.inf:
        P[0] = math.nan
    elif k == 1:
        for i in range(X.size):
            P[i] = N[0, i]
    else:
        first, second = _gradient(system, X, N[0]), _gradient(system, X, N[1])
        size = math.hypot(first, second)
        for i in range(X.size):
            P[i] = (second * N[0, i] - first * N[1, i]) / size


@jit
def _room(system, X, step):
    """Return the share of a step, at most 1, that keeps every flight long enough."""
    share, q = 1.0, system.q
    for i in range(q):
        here, following = phase_at(i), phase_at((i + 1) % q)
        now = X[following] - X[here] + (2.0 * math.pi * system.m if i + 1 == q else 0.0)
        change = step[following] - step[here]
        if now > 0.0 and now + share * change < _SHORTEST * now:
            share = (1.0 - _SHORTEST) * now / -change
    return share


@jit
def _decreasing(system, X, step, share, size):
    """Return a share of a step that decreases the residual, or `share` if no halving finds one."""
    full_share = share
    for _ in range(_HALVINGS):
        if _largest(linearised_flights(system, moved(X, share, step))[0]) < size:
            return share
        share *= 0.5
    return full_share


@jit
def newton_method(system, X, planes, most):
    """Move X onto the orbits, in place, by Newton's method; return whether it converges.

    The whole change is orthogonal to `planes`, shape (k or k - 1, 2 q + k). If there are only k - 1
    planes, the condition of the system is the last equation. There are at most `most` iterations.
    """
    k, q = system.free.size, system.q
    origin, P = moved(X, 0.0, X), filled(X.size, 0.0)
    N = zero_rows(k - planes.shape[0], X.size)
    before, rounding = math.inf, 0.0
    for i in range(free_at(q, 0), X.size):
        rounding = larger(rounding, _ROUNDED * abs(X[i]))
    for _ in range(most):
        size = _newton_step(system, X, origin, planes, P, N)
        if not size < math.inf:
            return False
        if k > planes.shape[0]:  # the condition decides how far to go along the null vector
            Y = moved(X, 1.0, P)
            P = moved(P, -_condition(system, Y) / _gradient(system, Y, N[0]), N[0])
        length = math.sqrt(inner(P, P, q))
        if not length < 1e6:
            return False
        share = _room(system, X, P)
        if k == 0 and size > 1e-9:
            share = _decreasing(system, X, P, share, size)
        for i in range(X.size):
            X[i] += share * P[i]
        converged = length < larger(_CONVERGED, rounding) or (
            length < _STALLED and length > 0.5 * before
        )
        if share == 1.0 and converged:
            return True
        before = length
    return False


@jit
def _size_of_rounding(system):
    """Return a power of two to which the rounding of det J(mu) is proportional: that of the speeds.

    Over wide ranges the speeds of an orbit may be far below 1 in natural units.
    """
    pt = parameters_in(system.point)
    _, exponent = math.frexp(pt.f / (pt.omega + pt.p))
    return math.ldexp(1.0, exponent) if pt.f > 0.0 else 1.0


@jit
def _fill(system, X, bounds, values):
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
            first, second = c0 - c1 + c2, (c0 + c1 + c2) / distance_of_halves(X, system.m, q)
        else:  # c1 and its rounding decay with the flow over the m periods; undo this
            pt = parameters_at(system, X)
            T = 2.0 * math.pi * system.m / pt.omega
            first = c1 * math.exp(pt.h * T) / ((2.0 * pt.h + pt.p + pt.omega) * T)
    size = _size_of_rounding(system)
    values[2 * k], values[2 * k + 1] = first / size, second / size


@jit
def set_test_functions(system, X, tangent, bounds, tests):
    """Set the test functions at a point and their slopes along a tangent, shape (2, 2 k + 2).

    They are in the order of the docstring of this module; NaN where one does not apply. `bounds`,
    shape (k, 2), are the edges of the free parameters in their units in X.
    """
    q, k, step = system.q, system.free.size, difference(system, X)
    _fill(system, X, bounds, tests[0])
    _fill(system, moved(X, step, tangent), bounds, tests[1])
    for i in range(2 * k + 2):
        tests[1, i] = (tests[1, i] - tests[0, i]) / step
    for j in range(k):
        tests[1, 2 * j] = tangent[free_at(q, j)]
        tests[1, 2 * j + 1] = -tangent[free_at(q, j)]


@jit
def _may_have_more_roots(a, slope_a, b, slope_b):
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
def _may_meet(c, here, slopes, there, k, length):
    """Whether step k of a flight may meet the stop at the control point near an end; sets `c`."""
    for j in range(TERMS):
        c[j] = 4.0 * here[k, j] + 2.0 * length * slopes[k, j] - there[k, j]
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
    return size > HEADING * HEADING and together > 0.0 and middle < math.sqrt(size * bend)


@jit
def step_may_miss(system, here, there, length):
    """Whether a step may miss roots of the test functions, or points that are not orbits.

    It leads from a place to another (``calls.Place``); `length` is its length along the first
    tangent.
    """
    X, tangent, tests = here
    Y, tangent_Y, tests_Y = there
    if _oscillates_far(system, X, Y):
        return True
    length_Y = length / inner(tangent, tangent_Y, system.q)
    for i in range(tests.shape[1]):
        slopes = length * tests[1, i], length_Y * tests_Y[1, i]
        if _may_have_more_roots(tests[0, i], slopes[0], tests_Y[0, i], slopes[1]):
            return True
    if not system.touches and _may_penetrate(system, X, tangent, Y, tangent_Y, length, length_Y):
        return True
    if system.condition != FOLD:
        return False
    return halves_may_meet(X, Y, system.m, system.q) or _may_have_cusps(
        system, X, tangent, Y, tangent_Y, length
    )
