"""Newton's method onto orbits, branches of them and curves of bifurcations: one corrector.

A vector of unknowns X holds the phases and scaled speeds of q impacts, alternating, z_1 .. z_q, and
then k free parameters in units of their spans. With k free parameters the orbits are a manifold of
k dimensions: k = 0 is an orbit, k = 1 a branch, k = 2 a surface on which each kind of bifurcation
is a curve. The linearised flights (``flights.py``) couple an impact only to the next one,

    A_i z_i + B_i z_{i+1} = r_i,    z_{q+1} = mu z_1,    mu = 1.

Givens rotations of determinant +1 with positive pivots eliminate z_2 .. z_q one by one, as in the
structured solvers for boundary value problems (Ascher, Mattheij & Russell 1995, ch. 7), so every
cost is proportional to the number of impacts. What remains is S z_1 + T z_{q+1} = r. det(S + mu T)
is the determinant of the whole matrix J(mu) divided by the positive pivots: a quadratic in mu whose
roots are the Floquet multipliers, and which is regular where an impact grazes. The remaining two
equations have a particular solution and k null vectors. They are found without inverting anything
that is singular at a fold.

Further conditions choose one of these solutions: planes given by the predictor, and the
bifurcation,

    flip, fold:  det(S + mu T) = 0 at mu = -1, +1;      graze:  v_k = 0.

Derivatives with respect to z are exact. Those with respect to parameters, and those of
det(S + mu T), are central differences: they steer the iteration, but its limit does not depend on
them. Loops are written out, because numba compiles them in a tenth of the time that it takes for
slices and array expressions.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import jit
from vibroimpact.orbits.flights import residuals, time_steps

# Conditions of ``System``.
NONE, FLIP, FOLD, GRAZE = range(4)

#: Step of the central differences of flights; this one has the least error.
FLIGHT_DIFFERENCE = 6e-6
#: Step of the central differences of a condition. It is short because a condition varies over far
#: less than an orbit does where all impacts of a long orbit are slow. A parameter in units of a
#: narrow span is a large number: the step is at least ``_DIFFERENCE_SHARE`` of it, far above its
#: rounding, but at most the step for flights.
_DIFFERENCE, _DIFFERENCE_SHARE = 1e-9, 1e-12
#: The rank is lost if only this share of a row remains when it is orthogonalised.
_RANK = 1e-14
#: The iteration ends after a step shorter than the first, or after a step that is shorter than the
#: second and longer than half the step before it.
_CONVERGED, _STALLED = 1e-12, 1e-7
#: Most halvings of a Newton step, and the share of its length that a flight keeps in a step.
_HALVINGS, _SHORTEST = 8, 0.1


class System(NamedTuple):
    """The data that do not change in an iteration."""

    values: np.ndarray  # parameters of the oscillator, (6,); those of `free` are taken from X
    free: np.ndarray  # indices of the free parameters, (k,), k <= 2
    spans: np.ndarray  # their units in X, (k,)
    m: int  # forcing periods
    q: int  # impacts
    speed: float  # unit of speeds
    condition: int  # the bifurcation to move onto
    graze: int  # index of the impact that grazes
    work: np.ndarray  # receives the number of time steps taken, (1,)


@jit
def inner(X, Y, q):
    """Return the inner product of two vectors of unknowns, averaged over the impacts."""
    total = 0.0
    for i in range(2 * q):
        total += X[i] * Y[i]
    total /= q
    for i in range(2 * q, X.size):
        total += X[i] * Y[i]
    return total


@jit
def moved(X, share, step):
    """Return X + share step."""
    Y = np.empty(X.size)
    for i in range(X.size):
        Y[i] = X[i] + share * step[i]
    return Y


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
def _largest(F):
    size = 0.0
    for i in range(F.shape[0]):
        size = max(size, abs(F[i, 0]), abs(F[i, 1]))
    return size


@jit
def _rotate(W, a, b, column):
    """Make W[b, column] zero by rotating the rows a and b; W[a, column] is then >= 0."""
    r = math.hypot(W[a, column], W[b, column])
    if r == 0.0:
        return
    c, s = W[a, column] / r, W[b, column] / r
    for j in range(W.shape[1]):
        upper, lower = W[a, j], W[b, j]
        W[a, j] = c * upper + s * lower
        W[b, j] = c * lower - s * upper


@jit
def _condense(A, B, right, kept):
    """Eliminate all impacts but the first from flights with right-hand sides, shape (q, 2, k).

    The last two rows of the result, shape (4, 6 + k), contain S, T and their right-hand sides, from
    the third column on. `kept`, shape (q, 2, 6 + k), receives the rows from which z_2 .. z_q are
    found: their factors of z_i, z_1 and z_{i+1}, and the right-hand sides. Its first entry is not
    used.
    """
    q, k = A.shape[0], right.shape[2]
    W = np.zeros((4, 6 + k))
    for i in range(q):
        for row in range(2):
            for j in range(2):
                # The remainder of the flights so far becomes the upper rows: z_i was z_{i+1}.
                W[row, j], W[row, 2 + j], W[row, 4 + j] = W[2 + row, 4 + j], W[2 + row, 2 + j], 0.0
                W[2 + row, j], W[2 + row, 2 + j] = A[i, row, j], 0.0
                W[2 + row, 4 + j] = B[i, row, j]
            for j in range(k):
                W[row, 6 + j], W[2 + row, 6 + j] = W[2 + row, 6 + j], right[i, row, j]
        if i == 0:
            for row in range(2, 4):
                for j in range(2):
                    W[row, j], W[row, 2 + j] = 0.0, W[row, j]
            continue
        for row in range(1, 4):
            _rotate(W, 0, row, 0)
        for row in range(2, 4):
            _rotate(W, 1, row, 1)
        for row in range(2):
            for j in range(6 + k):
                kept[i, row, j] = W[row, j]
    return W


@jit
def _expand(kept, z, weights, mu):
    """Fill z_2 .. z_q from z_1, with z_{q+1} = mu z_1; `weights` combine the right-hand sides."""
    q = kept.shape[0]
    for i in range(q - 1, 0, -1):
        factor, at = (mu, 0) if i + 1 == q else (1.0, 2 * i + 2)
        for row in range(1, -1, -1):
            left = 0.0
            for j in range(weights.size):
                left += kept[i, row, 6 + j] * weights[j]
            for j in range(2):
                left -= kept[i, row, 2 + j] * z[j] + kept[i, row, 4 + j] * factor * z[at + j]
            if row == 0:
                left -= kept[i, 0, 1] * z[2 * i + 1]
            z[2 * i + row] = left / kept[i, row, row]


@jit
def null_vector(A, B, mu):
    """Return z, (2 q,), with A_i z_i + B_i z_{i+1} = 0, z_{q+1} = mu z_1, for a multiplier mu."""
    q = A.shape[0]
    kept, z = np.empty((q, 2, 6)), np.empty(2 * q)
    W = _condense(A, B, np.empty((q, 2, 0)), kept)
    largest = -1.0
    for row in range(2, 4):
        first, second = W[row, 2] + mu * W[row, 4], W[row, 3] + mu * W[row, 5]
        if math.hypot(first, second) > largest:
            largest = math.hypot(first, second)
            z[0], z[1] = second, -first
    _expand(kept, z, np.empty(0), mu)
    return z


@jit
def characteristic(A, B):
    """Return c0, c1, c2 of det(S + mu T) = c0 + c1 mu + c2 mu^2."""
    q = A.shape[0]
    W = _condense(A, B, np.empty((q, 2, 0)), np.empty((q, 2, 6)))
    a, b, c, d = W[2, 2], W[2, 3], W[3, 2], W[3, 3]  # S
    e, f, g, h = W[2, 4], W[2, 5], W[3, 4], W[3, 5]  # T
    return a * d - b * c, a * h + e * d - b * g - f * c, e * h - f * g


@jit
def _right_hand_sides(system, X, F):
    """Return the negative residuals and their derivatives with respect to the parameters."""
    q, values = system.q, parameters_at(system, X)
    right = np.empty((q, 2, 1 + system.free.size))
    for i in range(q):
        right[i, 0, 0], right[i, 1, 0] = -F[i, 0], -F[i, 1]
    system.work[0] += 2 * system.free.size * time_steps(values, system.m, q)
    for j in range(system.free.size):
        at, span = system.free[j], system.spans[j]
        value = values[at]
        step = FLIGHT_DIFFERENCE * min(span, max(abs(value), 0.1 * span))
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
    """Make row `count` orthogonal to the rows before it; return its length, then make it 1."""
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
    """Fill an orthonormal basis whose first two vectors span two rows; False if there is none."""
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
def _orthonormalise(N, P, q):
    """Make null vectors orthonormal, and take the shortest solution, which keeps slow impacts."""
    for i in range(N.shape[0] + 1):
        vector = N[i] if i < N.shape[0] else P
        for row in range(i):
            product = inner(vector, N[row], q)
            for j in range(vector.size):
                vector[j] -= product * N[row, j]
        length = math.sqrt(inner(vector, vector, q)) if i < N.shape[0] else 1.0
        for j in range(vector.size):
            vector[j] /= length


@jit
def _solution_space(system, X, P, N):
    """Find all solutions of the linearised flights: the shortest, P, and null vectors, N (k, n).

    Return the largest residual; inf if impacts are out of order or the rank is lost.
    """
    q, k = system.q, system.free.size
    F, A, B = linearised(system, X)
    size = _largest(F)
    if not size < math.inf:
        return math.inf
    kept = np.empty((q, 2, 7 + k))
    W = _condense(A, B, _right_hand_sides(system, X, F), kept)
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
        vector = N[i - 1] if i else P
        weights[0] = 0.0 if i else 1.0
        for j in range(2 + k):
            at = j if j < 2 else 2 * q + j - 2
            vector[at] = basis[1 + i, j]
        for j in range(k):
            weights[1 + j] = basis[1 + i, 2 + j]
        _expand(kept, vector, weights, 1.0)
    _orthonormalise(N, P, q)
    return size


@jit
def _condition(system, X):
    """Return the function that is zero at the bifurcation; NaN if impacts are out of order."""
    if system.condition == GRAZE:
        return X[2 * system.graze + 1]
    F, A, B = linearised(system, X)
    if not _largest(F) < math.inf:
        return math.nan
    c0, c1, c2 = characteristic(A, B)
    return c0 + c2 + (c1 if system.condition == FOLD else -c1)


@jit
def difference(system, X):
    """Return the step for the difference of a condition."""
    step = _DIFFERENCE
    for i in range(system.q):
        step = max(step, _DIFFERENCE * abs(X[2 * i + 1]))
    for i in range(2 * system.q, X.size):
        step = max(step, min(_DIFFERENCE_SHARE * abs(X[i]), FLIGHT_DIFFERENCE))
    return step


@jit
def _gradient(system, X, along):
    """Return the derivative of the condition along a vector."""
    if system.condition == GRAZE:
        return along[2 * system.graze + 1]
    step = difference(system, X)
    above = _condition(system, moved(X, step, along))
    return (above - _condition(system, moved(X, -step, along))) / (2.0 * step)


@jit
def tangent(system, X):
    """Return the direction of a branch (k = 1) or a curve (k = 2); NaN if there is none."""
    k = system.free.size
    P, N = np.empty(X.size), np.empty((k, X.size))
    if not _solution_space(system, X, P, N) < math.inf:
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
    """Make P the only solution that meets the further conditions."""
    k, q = system.free.size, system.q
    G, g, Y = np.zeros((k, k)), np.zeros(k), moved(X, 1.0, P)
    for i in range(planes.shape[0]):
        g[i] = inner(planes[i], origin, q) - inner(planes[i], Y, q)
        for j in range(k):
            G[i, j] = inner(planes[i], N[j], q)
    if planes.shape[0] < k:
        g[k - 1] = -_condition(system, Y)
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
    """Return the share of a step, at most 1, that keeps every flight long enough."""
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
    """Return a share of a step that decreases the residual, or `share` if no halving finds one."""
    full_share = share
    for _ in range(_HALVINGS):
        if _largest(linearised(system, moved(X, share, step))[0]) < size:
            return share
        share *= 0.5
    return full_share


@jit
def correct(system, X, planes, most):
    """Move X onto the orbits, in place, by Newton's method; return whether it converges.

    The whole change is orthogonal to `planes`, shape (k or k - 1, 2 q + k). If there are only k - 1
    planes, the condition of the system is the last equation. There are at most `most` iterations.
    """
    k, q = system.free.size, system.q
    origin, P, N = X.copy(), np.empty(X.size), np.empty((k, X.size))
    before = math.inf
    for _ in range(most):
        size = _solution_space(system, X, P, N)
        if not size < math.inf:
            return False
        _choose(system, X, origin, planes, P, N)
        length = math.sqrt(inner(P, P, q))
        if not length < 1e6:
            return False
        share = _room(system, X, P)
        if k == 0 and size > 1e-9:
            share = _decreasing(system, X, P, share, size)
        for i in range(X.size):
            X[i] += share * P[i]
        converged = length < _CONVERGED or (length < _STALLED and length > 0.5 * before)
        if share == 1.0 and converged:
            return True
        before = length
    return False
