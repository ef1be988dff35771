"""The normal form of a flip: its criticality.

At a flip the map of m forcing periods has the normal form a -> -(1 + delta) a + c a^3 along the
vector of the multiplier -1 (Kuznetsov, *Elements of Applied Bifurcation Theory*, sec. 5.4 and 9.3).
Orbits of twice the period have a^2 = delta / c. If c > 0, they are stable and exist where the orbit
itself is unstable; if c < 0, they are unstable and exist where it is stable.

The flights F (``flights.py``) of the orbit taken twice are reduced by the method of Lyapunov and
Schmidt: it is displaced by a (w, -w) + a^2 / 2 (s, s). With J(mu) as in ``unknowns.py``, and with
the null vectors w and u of J(-1) and of its transpose,

    J(1) s = -F''[w, w],    (u . J'(-1) w) c = -u . (F'''[w, w, w] / 6 + F''[w, s] / 2).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vibroimpact.orbits import calls
from vibroimpact.orbits.corrector import System
from vibroimpact.orbits.unknowns import free, impact_rows, unknowns

#: Greatest advance of an oscillation [rad] by which differences displace an impact. They have five
#: places, so their error is the fourth power of it.
_ADVANCE = 4e-3
#: At a flip, two iterations to the null vector of J(-1) differ by about the share of its least
#: singular value in the next one, which is smaller. J(-1) is moved by a share far above its
#: rounding, so that it has an inverse.
_SINGULAR_SHARE, _MOVED = 1e-4, 1e-12


def cubic_coefficient(system: System, flips: np.ndarray) -> Any:
    """Return a number with the sign of c, smooth along curves, of each flip; NaN if not known."""
    X = np.atleast_2d(flips)
    values = np.full(len(X), np.nan)
    pt, AB = calls.parameters(system, X), np.array(calls.linearised(system, X)[1:])
    finite = np.flatnonzero(np.isfinite(AB).all(axis=(0, 2, 3, 4)) & ((pt.R < 1.0) | (pt.h > 0.0)))
    if finite.size:
        rates = np.asarray(1.0 + (2.0 * pt.h + pt.p) / pt.omega)
        values[finite] = _coefficients(system, X[finite], AB[:, finite], rates[finite])
    return values.reshape(flips.shape[:-1])[()]


def _coefficients(system: System, X: np.ndarray, AB: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Return the numbers of `cubic_coefficient` where the factors `AB` of J are finite."""
    q, turn = system.q, np.array([2.0 * np.pi * system.m, 0.0])
    u, w, lost = _null_vectors(_closed(AB, -1.0))
    w *= math.sqrt(q)
    z = impact_rows(X, q)
    step = _ADVANCE / (np.abs(w[:, ::2]).max(axis=1) * rates)
    doubled, direction = system._replace(m=2 * system.m, q=2 * q), np.concatenate([w, -w], axis=1)
    twice = unknowns(np.concatenate([z, z + turn], axis=1), free(X, q))
    beside = np.repeat(twice[None], 2, axis=0)
    beside[..., : 4 * q] += np.multiply.outer([1.0, 2.0], step[:, None] * direction)
    displaced = np.array(calls.linearised(doubled, beside.reshape(-1, twice.shape[1]))[1:])
    # The second half of a displaced orbit is the first half of the one displaced the other way.
    (c, d), (b, a) = np.moveaxis(displaced.reshape(2, 2, -1, 2, q, 2, 2), (3, 1), (0, 1))
    step = step[:, None, None, None]
    first = (8.0 * (c - b) - (d - a)) / (12.0 * step)
    second = (16.0 * (b + c) - (a + d) - 30.0 * AB) / (12.0 * step**2)
    w = w[:, :, None]
    J = _closed(AB, 1.0)
    lost |= np.linalg.det(J) == 0.0
    J[lost] = np.eye(2 * q)
    s = np.linalg.solve(J, -_closed(first, -1.0) @ w)
    bend = u[:, None] @ (_closed(second, -1.0) @ w / 6.0 + _closed(first, 1.0) @ s / 2.0)
    slope = u[:, None, -2:] @ AB[1][:, -1] @ w[:, :2]
    return np.where(lost, np.nan, (-bend * np.sign(slope))[:, 0, 0])


def _null_vectors(J: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return unit null vectors u and w of the transposes of J and of J, and where J has none.

    Near a graze it has none, as all digits of the multiplier are lost. The iteration with the
    inverse (Golub & Van Loan, ch. 8) takes far less time than singular values of large matrices.
    """
    J = J + _MOVED * np.abs(J).max(axis=(1, 2), keepdims=True) * np.eye(J.shape[1])
    singular = np.linalg.det(J) == 0.0
    J[singular] = np.eye(J.shape[1])
    inverse = np.linalg.inv(J)
    w = np.broadcast_to(np.cos(np.arange(J.shape[1])), J.shape[:2])
    for _ in range(2):
        before = w
        u = _unit((w[:, None] @ inverse)[:, 0])
        w = _unit((inverse @ u[:, :, None])[:, :, 0])
    off = 1.0 - np.abs(np.sum(w * before, axis=1))
    return u, w, singular | ~(off < _SINGULAR_SHARE**2)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Return the rows, each of length 1."""
    unit: np.ndarray = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return unit


def _closed(factors: np.ndarray, mu: float) -> np.ndarray:
    """Return J(mu), shape (n, 2 q, 2 q), of the factors A and B of the impacts, (2, n, q, 2, 2)."""
    A, B = factors
    n, q = A.shape[:2]
    J, at = np.zeros((n, q, 2, q, 2)), np.arange(q)
    J[:, at, :, at] = A.swapaxes(0, 1)
    J[:, at[:-1], :, at[1:]] = B[:, :-1].swapaxes(0, 1)
    J[:, -1, :, 0] += mu * B[:, -1]
    return J.reshape(n, 2 * q, 2 * q)
