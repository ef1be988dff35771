"""Linear algebra of a closed chain of flights: every cost is proportional to the impacts.

The derivative of the flights (``flights.py``) couples an impact to the next one only,

    A_i z_i + B_i z_{i+1} = r_i,    z_{q+1} = mu z_1.

Givens rotations of determinant +1 and with positive pivots eliminate z_2 .. z_q one by one, as in
the structured solvers for boundary value problems (Ascher, Mattheij & Russell 1995, ch. 7). Left is
S z_1 + T z_{q+1} = r, and det(S + mu T) is that of the whole matrix J(mu), divided by the positive
pivots: a quadratic in mu, zero at the Floquet multipliers, and regular where an impact grazes.

Loops are written out: numba compiles them in a tenth of the time that it takes for slices.
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact.jit import jit


@jit
def _rotate(W, a, b, column):
    """Make W[b, column] zero by a rotation of the rows a and b; W[a, column] is >= 0 then."""
    r = math.hypot(W[a, column], W[b, column])
    if r == 0.0:
        return
    c, s = W[a, column] / r, W[b, column] / r
    for j in range(W.shape[1]):
        upper, lower = W[a, j], W[b, j]
        W[a, j] = c * upper + s * lower
        W[b, j] = c * lower - s * upper


@jit
def condense(A, B, right, kept):
    """Eliminate all impacts but the first.

    Parameters
    ----------
    A, B : ndarray, shape (q, 2, 2)
    right : ndarray, shape (q, 2, k)
        Right-hand sides.
    kept : ndarray, shape (q, 2, 6 + k)
        Receives the rows to find z_2 .. z_q from: their factors of z_i, z_1 and z_{i+1}, and the
        right-hand sides; the first is not used.

    Returns
    -------
    ndarray, shape (4, 6 + k)
        Its last two rows from the third column on: S, T, and the right-hand sides.
    """
    q, k = A.shape[0], right.shape[2]
    W = np.zeros((4, 6 + k))
    for i in range(q):
        for row in range(2):
            for j in range(2):
                # What is left of the flights so far becomes the upper rows: z_i was z_{i+1}.
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
def expand_solution(kept, z, weights, mu):
    """Fill z_2 .. z_q from z_1, with z_{q+1} = mu z_1.

    Parameters
    ----------
    kept : ndarray
        From `condense`.
    z : ndarray, shape (2 q, ...)
        With z_1 in front; receives the others.
    weights : ndarray, shape (k,)
        How much of each right-hand side is taken.
    """
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
    """Return z, shape (2 q,), with A_i z_i + B_i z_{i+1} = 0, z_{q+1} = mu z_1, mu a multiplier."""
    q = A.shape[0]
    kept, z = np.empty((q, 2, 6)), np.empty(2 * q)
    W = condense(A, B, np.empty((q, 2, 0)), kept)
    largest = -1.0
    for row in range(2, 4):
        first, second = W[row, 2] + mu * W[row, 4], W[row, 3] + mu * W[row, 5]
        if math.hypot(first, second) > largest:
            largest = math.hypot(first, second)
            z[0], z[1] = second, -first
    expand_solution(kept, z, np.empty(0), mu)
    return z


@jit
def characteristic(A, B):
    """Return c0, c1, c2 of det(S + mu T) = c0 + c1 mu + c2 mu^2."""
    q = A.shape[0]
    W = condense(A, B, np.empty((q, 2, 0)), np.empty((q, 2, 6)))
    a, b, c, d = W[2, 2], W[2, 3], W[3, 2], W[3, 3]  # S
    e, f, g, h = W[2, 4], W[2, 5], W[3, 4], W[3, 5]  # T
    return a * d - b * c, a * h + e * d - b * g - f * c, e * h - f * g
