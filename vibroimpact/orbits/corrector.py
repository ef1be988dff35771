"""Damped Newton's method on a `System`, onto an orbit, or a point of a branch or curve.

With k free parameters the orbits are a manifold of k dimensions in the space of the unknowns
(``unknowns.py``): k = 0 is an orbit, k = 1 a branch, k = 2 a surface on which each kind of
bifurcation is a curve. The linearised flights (``flights.py``) and the planes given by a predictor
are linear equations. With one plane for each parameter their shortest solution is
the Newton step. With one plane less the condition of a bifurcation says how far to go along the
null vector,

    flip, fold:  det J(mu) = 0 at mu = -1, +1;      graze:  v_k = 0.

Derivatives with respect to z are exact. Those with respect to parameters, and those of
det J(mu), are central differences: they steer the iteration, but its limit does not depend on
them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import jit
from vibroimpact.orbits.flights import parameters_in, residuals, time_steps
from vibroimpact.orbits.unknowns import (
    Equations,
    characteristic_and_slopes,
    characteristic_polynomial,
    filled,
    free_at,
    inner,
    moved,
    pairs,
    phase_at,
    solve,
    speed_at,
    zero_rows,
)
from vibroimpact.step.elementary import larger

# Conditions of ``System``, by the kind of bifurcation at which all orbits are.
NONE, FLIP, FOLD, GRAZE = range(4)
CONDITIONS = {"": NONE, "flip": FLIP, "fold": FOLD, "graze": GRAZE}

#: Step of the central differences of flights; this one has the least error.
FLIGHT_DIFFERENCE = 6e-6
#: The iteration ends after a step shorter than the first, or after a step that is shorter than the
#: second and longer than half the step before it. The third is the same for the rounding of a
#: parameter in units of a narrow span, as a share of it.
_CONVERGED, _STALLED, _ROUNDED = 1e-12, 1e-7, 2.0**-50
#: Most halvings of a Newton step, and the share of its length that a flight keeps in a step.
_HALVINGS, _SHORTEST = 8, 0.1


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

    Return the largest residual, inf if impacts are out of order or the rank is lost, and the
    orientation of N (``unknowns.solve``).
    """
    q = system.q
    F, A, B = linearised_flights(system, X)
    size = _largest(F)
    if not size < math.inf:
        return math.inf, 0.0
    block = 2 + system.free.size
    right = filled(block * (q - 1) + 2 + planes.shape[0], 0.0)
    for i in range(q):
        right[block * i], right[block * i + 1] = -F[i, 0], -F[i, 1]
    for i in range(planes.shape[0]):
        at = block * (q - 1) + 2 + i
        right[at] = inner(planes[i], origin, q) - inner(planes[i], X, q)
    equations = Equations(A, B, _parameter_slopes(system, X), planes, right)
    orientation = solve(equations, P, N)
    return size if orientation != 0.0 else math.inf, orientation


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
    known = system.condition == FLIP or system.condition == FOLD
    if discriminant < 0.0 and not known:
        parts[0], parts[1], parts[2], parts[3] = 0.5 * trace, 0.5 * root, 0.5 * trace, -0.5 * root
    else:
        most = 0.5 * (trace + root)
        if known:  # near a graze the trace may have lost its digits
            most = 1.0 if system.condition == FOLD else -1.0
        parts[0], parts[1], parts[3] = most, 0.0, 0.0
        parts[2] = product / most if most != 0.0 else 0.0


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
    """Set P to the direction of a branch (k = 1) or a curve (k = 2); P[0] is NaN if it has none.

    All along a path it has the same orientation, which changes only where another path crosses.
    """
    k, N = system.free.size, zero_rows(system.free.size, X.size)
    size, orientation = _newton_step(system, X, X, zero_rows(0, X.size), P, N)
    if not size < math.inf:
        P[0] = math.nan
    elif k == 1:
        for i in range(X.size):
            P[i] = orientation * N[0, i]
    else:
        first, second = _gradient(system, X, N[0]), _gradient(system, X, N[1])
        size = math.hypot(first, second)
        for i in range(X.size):
            P[i] = orientation * (second * N[0, i] - first * N[1, i]) / size


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
        size, _ = _newton_step(system, X, origin, planes, P, N)
        if not size < math.inf:
            return False
        if k > planes.shape[0]:  # the condition decides how far to go along the null vector
            Y = moved(X, 1.0, P)
            P = moved(P, -_condition(system, Y) / _gradient(system, Y, N[0]), N[0])
        length = math.sqrt(inner(P, P, q))
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
