"""Newton's method onto orbits, branches of them, and curves of bifurcations, in one function.

In every iteration the linearised flights have a family of solutions (``linear_system.py``). Of
these the further conditions choose one: planes that the predictor gives, and the bifurcation:

    flip, fold:  det(S + mu T) = 0 at mu = -1, +1 (``elimination.py``);      graze:  v_k = 0.

The derivatives of det(S + mu T) are central differences.
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact.jit import jit
from vibroimpact.orbits.elimination import characteristic
from vibroimpact.orbits.linear_system import inner, largest, linearised, solution_space

# Conditions.
NONE, FLIP, FOLD, GRAZE = range(4)

#: Step of the central differences of a condition: it varies over far less than an orbit does where
#: all impacts of a long orbit are slow. A parameter in units of a narrow span is a large number:
#: the step is at least this share of it, far above its rounding, but at most that of an orbit.
_DIFFERENCE, _DIFFERENCE_SHARE, _LONGEST_DIFFERENCE = 1e-9, 1e-12, 6e-6
#: The iteration ends after a step below the first, or one below the second that is no smaller than
#: half the one before it.
_CONVERGED, _STALLED = 1e-12, 1e-7
#: Newton's step is halved so often at most; a flight keeps this share of its length.
_HALVINGS, _SHORTEST = 8, 0.1


@jit
def condition_value(system, X):
    """Return what is zero in the bifurcation; NaN where impacts are out of order."""
    if system.condition == GRAZE:
        return X[2 * system.graze + 1]
    F, A, B = linearised(system, X)
    if not largest(F) < math.inf:
        return math.nan
    c0, c1, c2 = characteristic(A, B)
    return c0 + c2 + (c1 if system.condition == FOLD else -c1)


@jit
def difference(system, X):
    """Return the step of a difference of conditions."""
    step = _DIFFERENCE
    for i in range(system.q):
        step = max(step, _DIFFERENCE * abs(X[2 * i + 1]))
    for i in range(2 * system.q, X.size):
        step = max(step, min(_DIFFERENCE_SHARE * abs(X[i]), _LONGEST_DIFFERENCE))
    return step


@jit
def _gradient(system, X, along):
    """Return the derivative of the condition along a vector."""
    if system.condition == GRAZE:
        return along[2 * system.graze + 1]
    Y, step = np.empty(X.size), difference(system, X)
    for i in range(X.size):
        Y[i] = X[i] + step * along[i]
    above = condition_value(system, Y)
    for i in range(X.size):
        Y[i] = X[i] - step * along[i]
    return (above - condition_value(system, Y)) / (2.0 * step)


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
        if largest(linearised(system, Y)[0]) < size:
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
