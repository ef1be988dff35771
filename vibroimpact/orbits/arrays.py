"""New arrays of compiled code: each kind in one function, which is compiled once.

Numba compiles ``np.empty`` and the like anew for every type of shape, each with machine code of its
own. A shape of constants and integers has a type for each constant.
"""

from __future__ import annotations

import numpy as np

from vibroimpact.jit import jit


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
