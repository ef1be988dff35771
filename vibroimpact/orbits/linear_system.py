"""The linearised flights of orbits with free parameters, and all solutions of these equations.

With k free parameters the orbits are a manifold of k dimensions in the space of (z, parameters):
k = 0 an orbit, k = 1 a branch, k = 2 a surface on which each kind of bifurcation is a curve. The
flights' equations, linearised, leave a particular solution and k null vectors, which the
elimination finds without inverting anything that is singular in a fold.

Derivatives with respect to z are exact. Those with respect to parameters are central differences:
they steer the iteration, and what it ends at does not depend on them.

A vector of unknowns X has the phases and scaled speeds of q impacts in turn, and then the free
parameters in units of their spans.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import jit
from vibroimpact.orbits.elimination import condense, expand_solution
from vibroimpact.orbits.flights import residuals, time_steps

#: Step of the central differences, that of the least error.
_DIFFERENCE = 6e-6
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
    work : ndarray, shape (1,)
        Receives the number of time steps that were taken.
    """

    values: np.ndarray
    free: np.ndarray
    spans: np.ndarray
    m: int
    q: int
    speed: float
    condition: int
    graze: int
    work: np.ndarray


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
    values = parameters_at(system, X)
    system.work[0] += time_steps(values, system.m, system.q)
    return residuals(values, system.m, system.speed, X, system.q)


@jit
def largest(F):
    """Return the largest residual."""
    size = 0.0
    for i in range(F.shape[0]):
        size = max(size, abs(F[i, 0]), abs(F[i, 1]))
    return size


@jit
def _right_hand_sides(system, X, F):
    """Return the negative residuals, and their derivatives with respect to the parameters."""
    q, values = system.q, parameters_at(system, X)
    right = np.empty((q, 2, 1 + system.free.size))
    for i in range(q):
        right[i, 0, 0], right[i, 1, 0] = -F[i, 0], -F[i, 1]
    system.work[0] += 2 * system.free.size * time_steps(values, system.m, q)
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
        most, best = -1.0, 0
        for unit in range(n + 1):
            chosen = unit if unit < n else best
            for j in range(n):
                basis[i, j] = 1.0 if j == chosen else 0.0
            left = _orthogonalise(basis, i)
            if left > most:
                most, best = left, chosen
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
    size = largest(F)
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
