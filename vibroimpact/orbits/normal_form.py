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
from collections.abc import Iterable

import numpy as np

from vibroimpact.orbits import calls
from vibroimpact.orbits.corrector import System
from vibroimpact.orbits.flights import parameters_in
from vibroimpact.orbits.unknowns import free, impact_rows, unknowns

#: Greatest advance of an oscillation [rad], and greatest share of a flight, by which differences
#: displace an impact. They have five places, so their error is the fourth power of it.
_ADVANCE, _SHARE = 4e-3, 0.05
#: Weights of the five places in the first and in the second derivative.
_FIRST = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
_SECOND = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12.0


def cubic_coefficient(system: System, X: np.ndarray) -> float:
    """Return a number with the sign of c at a flip X, smooth along curves; NaN without any loss."""
    q, turn = system.q, np.array([2.0 * np.pi * system.m, 0.0])
    numbers = system.point.copy()
    numbers[system.free] = free(X, q) * system.spans
    pt = parameters_in.py_func(numbers)
    if pt.R == 1.0 and pt.h == 0.0:
        return math.nan
    z, (_, A, B) = impact_rows(X, q), calls.linearised(system, X)
    if not np.isfinite(A).all():
        return math.nan
    left, _, right = np.linalg.svd(_closed((A, B), -1.0))
    u, w = left[:, -1], right[-1] * math.sqrt(q)
    shares = np.diff(w[::2], append=-w[0]) / np.diff(z[:, 0], append=z[0, 0] + turn[0])
    rate = np.abs(w[::2]).max() * (1.0 + (2.0 * pt.h + pt.p) / pt.omega)
    step = 1.0 / max(rate / _ADVANCE, np.abs(shares).max() / _SHARE)
    doubled = system._replace(m=2 * system.m, q=2 * q)
    twice, way = np.concatenate([z, z + turn]), np.concatenate([w, -w]).reshape(-1, 2)
    places = (unknowns(twice + k * step * way, free(X, q)) for k in range(-2, 3))
    slopes = np.array([calls.linearised(doubled, Y)[1:] for Y in places])[:, :, :q]
    first = np.tensordot(_FIRST / step, slopes, 1)
    second = np.tensordot(_SECOND / step**2, slopes, 1)
    s = np.linalg.solve(_closed((A, B), 1.0), -_closed(first, -1.0) @ w)
    bend = u @ (_closed(second, -1.0) @ w / 6.0 + _closed(first, 1.0) @ s / 2.0)
    return float(-bend * np.sign(u[-2:] @ B[-1] @ w[:2]))


def _closed(factors: Iterable[np.ndarray], mu: float) -> np.ndarray:
    """Return J(mu), shape (2 q, 2 q), of the factors A and B of the impacts."""
    A, B = factors
    q = len(A)
    J = np.zeros((q, 2, q, 2))
    for i in range(q):
        J[i, :, i] += A[i]
        J[i, :, (i + 1) % q] += B[i] if i + 1 < q else mu * B[i]
    return J.reshape(2 * q, 2 * q)
