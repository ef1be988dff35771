"""Newton's method onto orbits, branches of them, and curves of bifurcations, in one function.

With k free parameters the orbits are a manifold of k dimensions in the space of (z, parameters):
k = 0 an orbit, k = 1 a branch, k = 2 a surface on which each kind of bifurcation is a curve. In
every iteration the flights' equations, linearised, leave a particular solution and k null vectors,
which the elimination finds without inverting anything that is singular in a fold. Of these the
further conditions choose one: planes that the predictor gives, and the bifurcation:

    flip, fold:  det(S + mu T) = 0 at mu = -1, +1 (``elimination.py``);      graze:  v_k = 0.

Derivatives with respect to z are exact. Those with respect to parameters, and of det(S + mu T), are
central differences: they steer the iteration, and what it ends at does not depend on them.

A vector of unknowns X has the phases and scaled speeds of q impacts in turn, and then the free
parameters in units of their spans.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import jit
from vibroimpact.orbits.elimination import characteristic, condense, expand_solution
from vibroimpact.orbits.flights import residuals

# Conditions.
NONE, FLIP, FOLD, GRAZE = range(4)

#: Step of the central differences, that of the least error.
_DIFFERENCE = 6e-6
#: The iteration ends after a step below the first, or one below the second that is no smaller than
#: half the one before it.
_CONVERGED, _STALLED = 1e-12, 1e-7
#: Newton's step is halved so often at most; a flight keeps this share of its length.
_HALVINGS, _SHORTEST = 8, 0.1
#: Rank is lost where so small a share of a row is left.
_RANK = 1e-14


class System(NamedTuple):
    """What does not change in an iteration.

    Attributes
    ----------
    values : ndarray, shape (6,)
        Parameters of the oscillator; those of `free` are taken from X.
    free : ndarray of int, shape (k,)
        Which are free, k <= 2.
    spans : ndarray, shape (k,)
        Their units in X.
    m, q : int
        Forcing periods and impacts.
    speed : float
        Unit of speeds.
    condition, graze : int
        The bifurcation to move onto, and the impact that grazes.
    """

    values: np.ndarray
    free: np.ndarray
    spans: np.ndarray
    m: int
    q: int
    speed: float
    condition: int
    graze: int


@jit
def inner(X, Y, q):
    """Return the inner product of two vectors of unknowns: the mean over the impacts."""
    total = 0.0
    for i in range(2 * q):
        total += X[i] * Y[i]
    total /= q
    for i in range(2 * q, X.size):
        total += X[i] * Y[i]
    return total


@jit
def parameters_at(system, X):
    """Return the parameters of the oscillator at a vector of unknowns, shape (6,)."""
    values = system.values.copy()
    for j in range(system.free.size):
        values[system.free[j]] = X[2 * system.q + j] * system.spans[j]
    return values


@jit
def linearised(system, X):
    """Return F, A and B of the flights at a vector of unknowns (``flights.residuals``)."""
    return residuals(parameters_at(system, X), system.m, system.speed, X, system.q)


@jit
def condition_value(system, X):
    """Return what is zero in the bifurcation; NaN where impacts are out of order."""
    if system.condition == GRAZE:
        return X[2 * system.graze + 1]
    F, A, B = linearised(system, X)
    if not _largest(F) < math.inf:
        return math.nan
    c0, c1, c2 = characteristic(A, B)
    return c0 + c2 + (c1 if system.condition == FOLD else -c1)


@jit
def _largest(F):
    largest = 0.0
    for i in range(F.shape[0]):
        largest = max(largest, abs(F[i, 0]), abs(F[i, 1]))
    return largest


@jit
def _right_hand_sides(system, X, F):
    """Return the negative residuals, and their derivatives with respect to the parameters."""
    q, values = system.q, parameters_at(system, X)
    right = np.empty((q, 2, 1 + system.free.size))
    for i in range(q):
        right[i, 0, 0], right[i, 1, 0] = -F[i, 0], -F[i, 1]
    for j in range(system.free.size):
        at, span = system.free[j], system.spans[j]
        value = values[at]
        step = _DIFFERENCE * min(span, max(abs(value), 0.1 * span))
        values[at] = value + step
        up, _, _ = residuals(values, system.m, system.speed, X, q)
        values[at] = value - step
        down, _, _ = residuals(values, system.m, system.speed, X, q)
        values[at] = value
        for i in range(q):
            for row in range(2):
                change = down[i, row] - up[i, row]
                right[i, row, 1 + j] = change * (0.5 * span / step)
    return right


@jit
def _orthogonalise(basis, count):
    """Make row `count` orthogonal to those before it and of length 1; return what it had left."""
    n, length = basis.shape[1], 0.0
    for _ in range(2):
        for j in range(count):
            product = 0.0
            for i in range(n):
                product += basis[count, i] * basis[j, i]
            for i in range(n):
                basis[count, i] -= product * basis[j, i]
    for i in range(n):
        length += basis[count, i] ** 2
    length = math.sqrt(length)
    for i in range(n):
        basis[count, i] /= length
    return length


@jit
def _short_basis(rows, basis):
    """Fill an orthonormal basis whose first two vectors span two rows; return if they do."""
    n = basis.shape[0]
    for i in range(2):
        size = 0.0
        for j in range(n):
            basis[i, j] = rows[i, j]
            size += rows[i, j] ** 2
        if not _orthogonalise(basis, i) > _RANK * math.sqrt(size):
            return False
    for i in range(2, n):
        largest, best = -1.0, 0
        for unit in range(n + 1):
            chosen = unit if unit < n else best
            for j in range(n):
                basis[i, j] = 1.0 if j == chosen else 0.0
            left = _orthogonalise(basis, i)
            if left > largest:
                largest, best = left, chosen
    return True


@jit
def solution_space(system, X, P, N):
    """Linearise the flights, and find all solutions of the linear equations.

    Parameters
    ----------
    P : ndarray, shape (2 q + k,)
        Receives the shortest solution.
    N : ndarray, shape (k, 2 q + k)
        Receives orthonormal null vectors.

    Returns
    -------
    float
        The largest residual; inf where impacts are out of order or the rank is lost.
    """
    q, k = system.q, system.free.size
    F, A, B = linearised(system, X)
    size = _largest(F)
    if not size < math.inf:
        return math.inf
    kept = np.empty((q, 2, 7 + k))
    W = condense(A, B, _right_hand_sides(system, X, F), kept)
    rows, basis = np.empty((2, 2 + k)), np.empty((2 + k, 2 + k))
    for i in range(2):
        for j in range(2):
            rows[i, j] = W[2 + i, 2 + j] + W[2 + i, 4 + j]
        for j in range(k):
            rows[i, 2 + j] = -W[2 + i, 7 + j]
    if not _short_basis(rows, basis):
        return math.inf
    _particular(W, rows, basis)
    weights = np.empty(1 + k)
    for i in range(1 + k):
        whole = N[i - 1] if i else P
        weights[0] = 0.0 if i else 1.0
        for j in range(2 + k):
            at = j if j < 2 else 2 * q + j - 2
            whole[at] = basis[1 + i, j]
        for j in range(k):
            weights[1 + j] = basis[1 + i, 2 + j]
        expand_solution(kept, whole, weights, 1.0)
    _orthonormalise(N, P, q)
    return size


@jit
def _orthonormalise(N, P, q):
    """Make null vectors orthonormal, and a solution the shortest one, which keeps slow impacts."""
    for i in range(N.shape[0] + 1):
        whole = N[i] if i < N.shape[0] else P
        for row in range(i):
            product = inner(whole, N[row], q)
            for j in range(whole.size):
                whole[j] -= product * N[row, j]
        length = math.sqrt(inner(whole, whole, q)) if i < N.shape[0] else 1.0
        for j in range(whole.size):
            whole[j] /= length


@jit
def _particular(W, rows, basis):
    """Replace the second vector of a basis by a solution in the span of the first two."""
    n, on = basis.shape[0], np.zeros((2, 2))  # the rows in the basis
    for i in range(2):
        for j in range(2):
            for unit in range(n):
                on[i, j] += rows[i, unit] * basis[j, unit]
    first = W[2, 6] / on[0, 0]
    second = (W[3, 6] - on[1, 0] * first) / on[1, 1]
    for unit in range(n):
        basis[1, unit] = first * basis[0, unit] + second * basis[1, unit]


@jit
def _gradient(system, X, along):
    """Return the derivative of the condition along a vector."""
    if system.condition == GRAZE:
        return along[2 * system.graze + 1]
    Y = np.empty(X.size)
    for i in range(X.size):
        Y[i] = X[i] + _DIFFERENCE * along[i]
    above = condition_value(system, Y)
    for i in range(X.size):
        Y[i] = X[i] - _DIFFERENCE * along[i]
    return (above - condition_value(system, Y)) / (2.0 * _DIFFERENCE)


@jit
def tangent(system, X):
    """Return the direction of a branch (k = 1) or a curve (k = 2); NaN where there is none."""
    k = system.free.size
    P, N = np.empty(X.size), np.empty((k, X.size))
    if not solution_space(system, X, P, N) < math.inf:
        P[0] = math.nan
        return P
    if k == 1:
        return N[0].copy()
    first, second = _gradient(system, X, N[0]), _gradient(system, X, N[1])
    for i in range(X.size):
        P[i] = second * N[0, i] - first * N[1, i]
    length = math.sqrt(inner(P, P, system.q))
    for i in range(X.size):
        P[i] /= length
    return P


@jit
def _choose(system, X, origin, planes, P, N):
    """Make P the one solution that meets the further conditions."""
    k, q = system.free.size, system.q
    G, g, Y = np.zeros((k, k)), np.zeros(k), np.empty(X.size)
    for i in range(X.size):
        Y[i] = X[i] + P[i]
    for i in range(planes.shape[0]):
        g[i] = inner(planes[i], origin, q) - inner(planes[i], Y, q)
        for j in range(k):
            G[i, j] = inner(planes[i], N[j], q)
    if planes.shape[0] < k:
        g[k - 1] = -condition_value(system, Y)
        for j in range(k):
            G[k - 1, j] = _gradient(system, Y, N[j])
    if k == 1:
        for i in range(X.size):
            P[i] += g[0] / G[0, 0] * N[0, i]
    elif k == 2:
        det = G[0, 0] * G[1, 1] - G[0, 1] * G[1, 0]
        first = (g[0] * G[1, 1] - g[1] * G[0, 1]) / det
        second = (g[1] * G[0, 0] - g[0] * G[1, 0]) / det
        for i in range(X.size):
            P[i] += first * N[0, i] + second * N[1, i]


@jit
def _room(system, X, step):
    """Return the share of a step, at most 1, that keeps every flight from all but vanishing."""
    share, q = 1.0, system.q
    for i in range(q):
        last = i + 1 == q
        following = 0 if last else 2 * i + 2
        now = X[following] - X[2 * i] + (2.0 * math.pi * system.m if last else 0.0)
        change = step[following] - step[2 * i]
        if now > 0.0 and now + share * change < _SHORTEST * now:
            share = (1.0 - _SHORTEST) * now / -change
    return share


@jit
def _decreasing(system, X, step, share, size):
    """Return the share of a step after which the residual is smaller, if a few halvings find it."""
    whole, Y = share, np.empty(X.size)
    for _ in range(_HALVINGS):
        for i in range(X.size):
            Y[i] = X[i] + share * step[i]
        if _largest(linearised(system, Y)[0]) < size:
            return share
        share *= 0.5
    return whole


@jit
def correct(system, X, planes, most):
    """Move a vector of unknowns onto the orbits, in place, by Newton's method.

    Parameters
    ----------
    system : System
    X : ndarray, shape (2 q + k,)
    planes : ndarray, shape (k or k - 1, 2 q + k)
        Vectors that the whole change is to be orthogonal to; with one fewer than k, the condition
        of the system is the last equation.
    most : int
        Iterations at the most.

    Returns
    -------
    int
        Iterations; -1 where the method does not converge.
    """
    k, q = system.free.size, system.q
    origin, P, N = X.copy(), np.empty(X.size), np.empty((k, X.size))
    before = math.inf
    for iteration in range(1, most + 1):
        size = solution_space(system, X, P, N)
        if not size < math.inf:
            return -1
        _choose(system, X, origin, planes, P, N)
        length = math.sqrt(inner(P, P, q))
        if not length < 1e6:
            return -1
        share = _room(system, X, P)
        if k == 0 and size > 1e-9:
            share = _decreasing(system, X, P, share, size)
        for i in range(X.size):
            X[i] += share * P[i]
        settled = length < _CONVERGED or (length < _STALLED and length > 0.5 * before)
        if share == 1.0 and settled:
            return iteration
        before = length
    return -1
