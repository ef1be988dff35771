"""The vector of unknowns X, and where the phases, speeds and free parameters are in it.

X holds the phases and scaled speeds of q impacts, alternating, z_1 .. z_q, and then k free
parameters in units of their spans. Compiled functions use the indices of single elements; the views
of arrays are for all others, also for many vectors at once, shape (..., 2 q + k). Vectors of 2 q
elements have no free parameters.
"""

from __future__ import annotations

import numpy as np

from vibroimpact.jit import inlined, jit
from vibroimpact.orbits.arrays import filled


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


def impacts(X: np.ndarray, q: int) -> np.ndarray:
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
