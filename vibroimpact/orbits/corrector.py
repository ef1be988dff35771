"""Newton's method onto orbits, branches of them and curves of bifurcations: one corrector.

A vector of unknowns X holds the phases and scaled speeds of q impacts, alternating, z_1 .. z_q, and
then k free parameters p in units of their spans. With k free parameters the orbits are a manifold
of k dimensions: k = 0 is an orbit, k = 1 a branch, k = 2 a surface on which each kind of
bifurcation is a curve. The linearised flights (``flights.py``) and the planes given by a predictor
are linear equations. Each impact gets parameters of its own, so that an equation of a flight has
only the unknowns of two impacts,

    A_i z_i + D_i p_i + B_i z_{i+1} = r_i,    p_i - p_{i+1} = 0,    z_{q+1} = z_1.

Their matrix is factorised as J = L Q by Householder reflections (Golub & Van Loan, *Matrix
Computations*, ch. 5). With J x = r this gives the shortest solution, and the last rows of Q are an
orthonormal basis of the null space: at a fold like anywhere else, and also where an impact grazes.
With one plane for each parameter the shortest solution is the Newton step. With one plane less the
condition of a bifurcation says how far to go along the null vector,

    flip, fold:  det J(mu) = 0 at mu = -1, +1;      graze:  v_k = 0.

J(mu) is the matrix of the flights with z_{q+1} = mu z_1. Its determinant is a quadratic in mu whose
roots are the Floquet multipliers. With z_{i+1} = M_i / det(B_i) z_i, M_i = -adj(B_i) A_i, it is

    det J(mu) = c0 + c1 mu + c2 mu^2 = prod det A_i - mu trace(M_q .. M_1) + mu^2 prod det B_i,

where no speed is divided by. It is divided by the volume of the rows of all flights but the last,
the product of the diagonal of L, and so is a smooth function of a convenient size, which is regular
where an impact grazes.

Derivatives with respect to z are exact. Those with respect to parameters, and those of
det J(mu), are central differences: they steer the iteration, but its limit does not depend on
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
#: Equations count as dependent if only this share of a row is orthogonal to the rows before it.
_INDEPENDENT = 1e-14
#: The iteration ends after a step shorter than the first, or after a step that is shorter than the
#: second and longer than half the step before it. The third is the same for the rounding of a
#: parameter in units of a narrow span, as a share of it.
_CONVERGED, _STALLED, _ROUNDED = 1e-12, 1e-7, 2.0**-50
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


class Equations(NamedTuple):
    """The linearised flights and planes, with k parameters; the last impact has l planes.

    Each impact has a block of 2 + k unknowns and as many equations; the last has 2 + l equations.
    """

    A: np.ndarray  # factors of the impact before each flight, (q, 2, 2)
    B: np.ndarray  # factors of the impact after it, (q, 2, 2)
    D: np.ndarray  # factors of the parameters, (q, 2, k)
    planes: np.ndarray  # vectors of which `inner` is taken with the solution, (l, 2 q + k)
    right: np.ndarray  # right-hand sides of the equations that are solved


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
def _set_row(equations, row, w):
    """Set w to a row of J."""
    A, B, D = equations.A, equations.B, equations.D
    q, block = A.shape[0], 2 + D.shape[2]
    i, of_block = row // block, row % block
    for j in range(w.size):
        w[j] = 0.0
    if of_block < 2:
        for j in range(2):
            w[block * i + j] = A[i, of_block, j]
        for j in range(2, block):
            w[block * i + j] = D[i, of_block, j - 2]
        for j in range(2):
            w[block * ((i + 1) % q) + j] += B[i, of_block, j]
    elif i + 1 < q:
        w[row], w[row + block] = 1.0, -1.0
    else:
        for j in range(w.size):
            at = 2 * (j // block) + j % block if j % block < 2 else 2 * q + j % block - 2
            w[j] = equations.planes[of_block - 2, at] / q


@jit
def _reflect(V, row, block, w):
    """Apply the Householder reflection I - v v^T to a vector, in place."""
    start, product = row - row % block, 0.0
    stop = min(start + V.shape[1], w.size)
    for j in range(start, stop):
        product += V[row, j - start] * w[j]
    for j in range(start, stop):
        w[j] -= product * V[row, j - start]


@jit
def _factorise(equations, V, diagonal, w, y):
    """Find Q as reflections, the diagonal of L, and y, with L y = r; False if rows are dependent.

    Each v has elements in the block of its row and in the next, which are a row of V, shape
    (rows, 2 (2 + k)). `w` is overwritten.
    """
    q, block = equations.A.shape[0], 2 + equations.D.shape[2]
    for row in range(equations.right.size):
        _set_row(equations, row, w)
        i = row // block
        # Only the last impact shares unknowns with impacts other than those beside it.
        first = block * (i - 1) if 0 < i < q - 1 else 0
        left, before, rest = equations.right[row], 0.0, 0.0
        for j in range(first, row):
            _reflect(V, j, block, w)
        for j in range(first, row):
            left -= w[j] * y[j]
            before += w[j] * w[j]
        stop = min(block * (i + 2), w.size)
        for j in range(row, stop):
            rest += w[j] * w[j]
        if not rest > _INDEPENDENT**2 * (before + rest):
            return False
        diagonal[row] = -math.copysign(math.sqrt(rest), w[row])
        y[row] = left / diagonal[row]
        w[row] -= diagonal[row]
        scale = 1.0 / math.sqrt(-diagonal[row] * w[row])
        for j in range(row, stop):
            V[row, j - block * i] = scale * w[j]
    return True


@jit
def _solve(equations, P, N):
    """Find the shortest solution P and an orthonormal basis N; False if equations are dependent."""
    q, block, rows = equations.A.shape[0], 2 + equations.D.shape[2], equations.right.size
    V, w, y = np.zeros((rows, 2 * block)), np.empty(q * block), np.zeros(q * block)
    independent = _factorise(equations, V, np.empty(rows), w, y)
    for number in range(-1, N.shape[0]):
        vector = P if number < 0 else N[number]
        for j in range(w.size):
            w[j] = y[j] if number < 0 else 0.0
        if number >= 0:  # one of the last rows of Q, in units in which its ``inner`` is 1
            w[rows + number] = math.sqrt(q)
        for row in range(rows - 1, -1, -1):
            _reflect(V, row, block, w)
        for j in range(2 * q):
            vector[j] = w[block * (j // 2) + j % 2]
        for j in range(2, block):
            vector[2 * q + j - 2] = w[j]
    return independent


@jit
def _without_last(A, B):
    """Return the equations of all flights but the last."""
    q = A.shape[0]
    return Equations(A, B, np.empty((q, 2, 0)), np.empty((0, 2 * q)), np.zeros(2 * q - 2))


@jit
def characteristic(A, B):
    """Return c0, c1, c2 of det J(mu), divided by the volume of all flights but the last."""
    return _characteristic_and_slopes(A, B, np.zeros(A.shape), np.zeros(B.shape))[0]


@jit
def _determinant(A, dA):
    """Return the determinant of a 2 x 2 matrix and its derivative."""
    slope = dA[0, 0] * A[1, 1] + A[0, 0] * dA[1, 1] - dA[0, 1] * A[1, 0] - A[0, 1] * dA[1, 0]
    return A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0], slope


@jit
def _characteristic_and_slopes(A, B, dA, dB):
    """Return c0, c1, c2 as `characteristic`, and their derivatives at a constant volume.

    dA and dB are the derivatives of A and B.
    """
    q, c0, s0, c2, s2 = A.shape[0], 1.0, 0.0, 1.0, 0.0
    V, diagonal = np.zeros((2 * q - 2, 4)), np.ones(2 * q)
    _factorise(_without_last(A, B), V, diagonal, np.empty(2 * q), np.empty(2 * q - 2))
    M, dM = np.zeros((2, 2)), np.zeros((2, 2))
    M[0, 0] = M[1, 1] = 1.0
    for i in range(q):
        volume = abs(diagonal[2 * i] * diagonal[2 * i + 1])
        det, slope = _determinant(A[i], dA[i])
        c0, s0 = c0 * (det / volume), s0 * (det / volume) + c0 * (slope / volume)
        det, slope = _determinant(B[i], dB[i])
        c2, s2 = c2 * (det / volume), s2 * (det / volume) + c2 * (slope / volume)
        for j in range(2):  # M becomes -adj(B_i) A_i M
            x, y, dx, dy = M[0, j], M[1, j], dM[0, j], dM[1, j]
            upper = (A[i, 0, 0] * x + A[i, 0, 1] * y) / volume
            lower = (A[i, 1, 0] * x + A[i, 1, 1] * y) / volume
            d_upper = dA[i, 0, 0] * x + dA[i, 0, 1] * y + A[i, 0, 0] * dx + A[i, 0, 1] * dy
            d_lower = dA[i, 1, 0] * x + dA[i, 1, 1] * y + A[i, 1, 0] * dx + A[i, 1, 1] * dy
            d_upper, d_lower = d_upper / volume, d_lower / volume
            M[0, j] = B[i, 0, 1] * lower - B[i, 1, 1] * upper
            M[1, j] = B[i, 1, 0] * upper - B[i, 0, 0] * lower
            dM[0, j] = dB[i, 0, 1] * lower - dB[i, 1, 1] * upper
            dM[0, j] += B[i, 0, 1] * d_lower - B[i, 1, 1] * d_upper
            dM[1, j] = dB[i, 1, 0] * upper - dB[i, 0, 0] * lower
            dM[1, j] += B[i, 1, 0] * d_upper - B[i, 0, 0] * d_lower
    return (c0, -M[0, 0] - M[1, 1], c2), (s0, -dM[0, 0] - dM[1, 1], s2)


@jit
def null_vector(A, B, mu):
    """Return z, (2 q,), with A_i z_i + B_i z_{i+1} = 0, z_{q+1} = mu z_1, for a multiplier mu.

    Its first element, the phase of the first impact, is not negative.
    """
    n, largest = 2 * A.shape[0], -1.0
    N, z, last = np.empty((2, n)), np.empty(n), np.zeros(2)
    _solve(_without_last(A, B), np.empty(n), N)
    for row in range(2):
        for i in range(2):
            last[i] = 0.0
            for j in range(2):
                last[i] += A[-1, row, j] * N[i, n - 2 + j] + mu * B[-1, row, j] * N[i, j]
        if math.hypot(last[0], last[1]) > largest:
            largest = math.hypot(last[0], last[1])
            for j in range(n):
                z[j] = last[1] * N[0, j] - last[0] * N[1, j]
    if z[0] < 0.0:
        for j in range(n):
            z[j] = -z[j]
    return z


@jit
def _parameter_slopes(system, X):
    """Return the derivatives of the residuals with respect to the free parameters, (q, 2, k)."""
    q, values = system.q, parameters_at(system, X)
    D = np.empty((q, 2, system.free.size))
    system.work[0] += 2 * system.free.size * time_steps(values, system.m, q)
    for j in range(system.free.size):
        at, span = system.free[j], system.spans[j]
        value = values[at]
        step = FLIGHT_DIFFERENCE * max(abs(value), 0.1 * span)
        values[at] = value + step
        above, _, _ = residuals(values, system.m, system.speed, X, q)
        values[at] = value - step
        below, _, _ = residuals(values, system.m, system.speed, X, q)
        values[at] = value
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
    F, A, B = linearised(system, X)
    size = _largest(F)
    if not size < math.inf:
        return math.inf
    block = 2 + system.free.size
    right = np.zeros(block * (q - 1) + 2 + planes.shape[0])
    for i in range(q):
        right[block * i], right[block * i + 1] = -F[i, 0], -F[i, 1]
    for i in range(planes.shape[0]):
        at = block * (q - 1) + 2 + i
        right[at] = inner(planes[i], origin, q) - inner(planes[i], X, q)
    equations = Equations(A, B, _parameter_slopes(system, X), planes, right)
    return size if _solve(equations, P, N) else math.inf


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
    """Return the derivative along a vector of the condition, where the condition is zero."""
    if system.condition == GRAZE:
        return along[2 * system.graze + 1]
    q, fastest = system.q, 0.0
    for i in range(X.size):  # no unknown moves by more than this share of its size
        size = max(abs(X[i]), 0.1) if i >= 2 * q else 1.0 if i % 2 == 0 else max(abs(X[i]), 1.0)
        fastest = max(fastest, abs(along[i]) / size)
    step = FLIGHT_DIFFERENCE / fastest
    _, above, above_B = linearised(system, moved(X, step, along))
    _, A, B = linearised(system, moved(X, -step, along))
    dA, dB = np.empty(A.shape), np.empty(B.shape)
    for i in range(q):
        for j in range(2):
            for k in range(2):
                dA[i, j, k] = (above[i, j, k] - A[i, j, k]) / (2.0 * step)
                dB[i, j, k] = (above_B[i, j, k] - B[i, j, k]) / (2.0 * step)
                A[i, j, k] += step * dA[i, j, k]  # now at X
                B[i, j, k] += step * dB[i, j, k]
    _, (s0, s1, s2) = _characteristic_and_slopes(A, B, dA, dB)
    return s0 + s2 + (s1 if system.condition == FOLD else -s1)


@jit
def tangent(system, X):
    """Return the direction of a branch (k = 1) or a curve (k = 2); NaN if there is none."""
    k, P = system.free.size, np.empty(X.size)
    N = np.empty((k, X.size))
    if not _newton_step(system, X, X, np.empty((0, X.size)), P, N) < math.inf:
        P[0] = math.nan
        return P
    if k == 1:
        return N[0].copy()
    first, second = _gradient(system, X, N[0]), _gradient(system, X, N[1])
    size = math.hypot(first, second)
    for i in range(X.size):
        P[i] = (second * N[0, i] - first * N[1, i]) / size
    return P


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
    origin, P, N = X.copy(), np.empty(X.size), np.empty((k - planes.shape[0], X.size))
    before, rounding = math.inf, 0.0
    for i in range(2 * q, X.size):
        rounding = max(rounding, _ROUNDED * abs(X[i]))
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
        converged = length < max(_CONVERGED, rounding) or (
            length < _STALLED and length > 0.5 * before
        )
        if share == 1.0 and converged:
            return True
        before = length
    return False
