"""The unknowns X of an orbit; cyclic linear `Equations`, solved by planes; Floquet multipliers.

X holds the phases and scaled speeds of q impacts, alternating, z_1 .. z_q, and then k free
parameters in units of their spans. Compiled functions use the indices of single elements; the views
of arrays are for all others, also for many vectors at once, shape (..., 2 q + k). Vectors of 2 q
elements have no free parameters.

**Linear equations.** Each impact gets parameters of its own, so that an equation of a flight has
only the unknowns of two impacts,

    A_i z_i + D_i p_i + B_i z_{i+1} = r_i,    p_i - p_{i+1} = 0,    z_{q+1} = z_1.

Their matrix is factorised as J = L Q by Householder reflections (Golub & Van Loan, *Matrix
Computations*, ch. 5). With J x = r this gives the shortest solution, and the last rows of Q are an
orthonormal basis of the null space: at a fold like anywhere else, and also where an impact grazes.

J(mu) is the matrix of the flights with z_{q+1} = mu z_1. Its determinant is a quadratic in mu whose
roots are the Floquet multipliers. With z_{i+1} = M_i / det(B_i) z_i, M_i = -adj(B_i) A_i, it is

    det J(mu) = c0 + c1 mu + c2 mu^2 = prod det A_i - mu trace(M_q .. M_1) + mu^2 prod det B_i,

where no speed is divided by. It is divided by the volume of the rows of all flights but the last,
the product of the diagonal of L, and so is a smooth function of a convenient size, which is regular
where an impact grazes.

Loops are written out, because numba compiles them in a tenth of the time that it takes for slices
and array expressions.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import inlined, jit

#: Values of test functions below this are rounding.
ROUNDING = 1e-12
#: Equations count as dependent if only the root of this share of a row is orthogonal to the rows
#: before it.
_INDEPENDENT = 1e-14**2


@inlined
def phase_at(i):
    """Return the index of the phase of impact i."""
    return 2 * i


@inlined
def speed_at(i):
    """Return the index of the scaled speed of impact i."""
    return 2 * i + 1


@inlined
def free_at(q, j):
    """Return the index of free parameter j of orbits with q impacts."""
    return 2 * q + j


def impact_rows(X: np.ndarray, q: int) -> np.ndarray:
    """Return the phases and scaled speeds, shape (..., q, 2)."""
    return X[..., : 2 * q].reshape(*X.shape[:-1], q, 2)


def phases(X: np.ndarray, q: int) -> np.ndarray:
    """Return the phases as a view, shape (..., q)."""
    return X[..., : 2 * q : 2]


def speeds(X: np.ndarray, q: int) -> np.ndarray:
    """Return the scaled speeds as a view, shape (..., q)."""
    return X[..., 1 : 2 * q : 2]


def free(X: np.ndarray, q: int) -> np.ndarray:
    """Return the free parameters, in units of their spans, as a view, shape (..., k)."""
    return X[..., 2 * q :]


def unknowns(z: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """Return the vectors of impacts z, shape (..., q, 2), and of free parameters, (..., k)."""
    return np.concatenate([z.reshape(*z.shape[:-2], 2 * z.shape[-2]), parameters], axis=-1)


def differences_of_halves(X: np.ndarray, m: int, q: int) -> np.ndarray:
    """Return the second half of an orbit less the first, shape (q / 2, 2); empty if it has none."""
    if m % 2 or q % 2:
        return np.empty((0, 2))
    z = impact_rows(X, q)
    return z[q // 2 :] - z[: q // 2] - np.array([math.pi * m, 0.0])


@jit
def inner(X, Y, q):
    """Return the inner product of two vectors of unknowns, averaged over the impacts."""
    total = 0.0
    for i in range(free_at(q, 0)):
        total += X[i] * Y[i]
    total /= q
    for i in range(free_at(q, 0), X.size):
        total += X[i] * Y[i]
    return total


@jit
def moved(X, share, step):
    """Return X + share step."""
    Y = filled(X.size, 0.0)
    for i in range(X.size):
        Y[i] = X[i] + share * step[i]
    return Y


# New arrays of compiled code. Numba compiles ``np.empty`` and the like anew for every type of
# shape, each with machine code of its own, so each kind has one function, which is compiled once.


@jit
def filled(n, value):
    """Return a vector of n times a value."""
    vector = np.empty(n)
    for i in range(n):
        vector[i] = value
    return vector


@jit
def zero_rows(n, k):
    """Return n rows of k zeros."""
    rows = np.empty((n, k))
    for i in range(n):
        for j in range(k):
            rows[i, j] = 0.0
    return rows


@jit
def pairs(n, k):
    """Return n pairs of rows of k numbers, shape (n, 2, k), not yet set."""
    return np.empty((n, 2, k))


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
        planes, at = equations.planes, of_block - 2
        for k in range(q):
            w[block * k] = planes[at, phase_at(k)] / q
            w[block * k + 1] = planes[at, speed_at(k)] / q
            for j in range(2, block):
                w[block * k + j] = planes[at, free_at(q, j - 2)] / q


@jit
def _reflect(V, row, block, w):
    """Apply the Householder reflection I - v v^T to a vector, in place."""
    start, product = row - row % block, 0.0
    stop = start + V.shape[1]
    stop = stop if stop < w.size else w.size
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
        stop = block * (i + 2) if i + 2 < q else w.size
        for j in range(row, stop):
            rest += w[j] * w[j]
        if not rest > _INDEPENDENT * (before + rest):
            return False
        diagonal[row] = -math.copysign(math.sqrt(rest), w[row])
        y[row] = left / diagonal[row]
        w[row] -= diagonal[row]
        scale = 1.0 / math.sqrt(-diagonal[row] * w[row])
        for j in range(row, stop):
            V[row, j - block * i] = scale * w[j]
    return True


@jit
def solve(equations, P, N):
    """Find the shortest solution P and an orthonormal basis N, and return the orientation of N.

    It is the sign of the determinant of J with the rows of N below it, up to a sign that depends
    only on the number of rows. It does not change along a path: 1 or -1; 0 if the equations are
    dependent.
    """
    q, block, rows = equations.A.shape[0], 2 + equations.D.shape[2], equations.right.size
    V, w, y = zero_rows(rows, 2 * block), filled(q * block, 0.0), filled(q * block, 0.0)
    diagonal, orientation = filled(rows, 0.0), 1.0
    independent = _factorise(equations, V, diagonal, w, y)
    for row in range(rows):
        orientation = math.copysign(orientation, orientation * diagonal[row])
    for number in range(-1, N.shape[0]):
        vector = P if number < 0 else N[number]
        for j in range(w.size):
            w[j] = y[j] if number < 0 else 0.0
        if number >= 0:  # one of the last rows of Q, in units in which its ``inner`` is 1
            w[rows + number] = math.sqrt(q)
        for row in range(rows - 1, -1, -1):
            _reflect(V, row, block, w)
        for i in range(q):
            vector[phase_at(i)], vector[speed_at(i)] = w[block * i], w[block * i + 1]
        for j in range(2, block):
            vector[free_at(q, j - 2)] = w[j]
    return orientation if independent else 0.0


@jit
def _without_last(A, B):
    """Return the equations of all flights but the last."""
    q = A.shape[0]
    return Equations(A, B, pairs(q, 0), zero_rows(0, 2 * q), filled(2 * q - 2, 0.0))


@jit
def characteristic_polynomial(A, B):
    """Return c0, c1, c2 of det J(mu), divided by the volume of all flights but the last."""
    return characteristic_and_slopes(A, B, A, B)[0]  # they do not depend on the derivatives


@jit
def _determinant(A, dA):
    """Return the determinant of a 2 x 2 matrix and its derivative."""
    slope = dA[0, 0] * A[1, 1] + A[0, 0] * dA[1, 1] - dA[0, 1] * A[1, 0] - A[0, 1] * dA[1, 0]
    return A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0], slope


@jit
def characteristic_and_slopes(A, B, dA, dB):
    """Return c0, c1, c2 and their derivatives at a constant volume, given those of A and B."""
    q, c0, s0, c2, s2 = A.shape[0], 1.0, 0.0, 1.0, 0.0
    V, diagonal = zero_rows(2 * q - 2, 4), filled(2 * q, 1.0)
    _factorise(_without_last(A, B), V, diagonal, filled(2 * q, 0.0), filled(2 * q - 2, 0.0))
    M, dM = zero_rows(2, 2), zero_rows(2, 2)
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
def set_null_vector(A, B, mu, z):
    """Set z, (2 q,), so that A_i z_i + B_i z_{i+1} = 0, z_{q+1} = mu z_1, for a multiplier mu.

    Its first element, the phase of the first impact, is not negative.
    """
    n, largest = 2 * A.shape[0], -1.0
    N, last = zero_rows(2, n), filled(2, 0.0)
    solve(_without_last(A, B), z, N)
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
