"""The vector of unknowns X, and where the phases, speeds and free parameters are in it.

X holds the phases and scaled speeds of q impacts, alternating, z_1 .. z_q, and then k free
parameters in units of their spans. Compiled functions use the indices of single elements; the views
of arrays are for all others, also for many vectors at once, shape (..., 2 q + k). Vectors of 2 q
elements have no free parameters.
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact.jit import inlined, jit

#: Values of test functions below this are rounding.
ROUNDING = 1e-12
#: The difference of the halves of an orbit falls in a step along a curve of folds to no less than
#: this share. The curve ends where it vanishes (``special_points.py``).
_LEAST_SHARE = 0.25


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


@jit
def _apart(X, m, q, i):
    """Return how far impact i of the second half is from that of the first: phase and speed."""
    j = i + q // 2
    phase = X[phase_at(j)] - X[phase_at(i)] - math.pi * m
    return phase, X[speed_at(j)] - X[speed_at(i)]


@jit
def distance_of_halves(X, m, q):
    """Return the mean square difference of the two halves of an orbit; 1 if it has no halves.

    NaN if they are equal to rounding.
    """
    if m % 2 or q % 2:
        return 1.0
    square = 0.0
    for i in range(q // 2):
        phase, speed = _apart(X, m, q, i)
        square += phase * phase / q
        square += speed * speed / q
    return square if square > ROUNDING else math.nan


@jit
def halves_may_meet(X, Y, m, q):
    """Whether the difference of the halves of an orbit falls so far that they may change places."""
    if m % 2 or q % 2:
        return False
    product, square = 0.0, 0.0
    for i in range(q // 2):
        phase, speed = _apart(X, m, q, i)
        phase_Y, speed_Y = _apart(Y, m, q, i)
        product += phase * phase_Y
        product += speed * speed_Y
        square += phase * phase
        square += speed * speed
    return product < _LEAST_SHARE * square
