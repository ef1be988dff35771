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
from collections.abc import Sequence

import numpy as np

from vibroimpact.orbits import calls
from vibroimpact.orbits.corrector import System
from vibroimpact.orbits.flights import parameters_in
from vibroimpact.orbits.unknowns import free, impact_rows

#: Greatest advance of an oscillation [rad], and greatest share of a flight, by which differences
#: displace an impact. They have five places, so their error is the fourth power of it.
_ADVANCE, _SHARE = 4e-3, 0.05
#: The least singular value of J(-1) at a flip is a smaller share of the next one.
_SINGULAR = 1e-4


def cubic_coefficient(system: System, X: np.ndarray) -> float:
    """Return a number with the sign of c at a flip X, smooth along curves; NaN if not known."""
    q, turn = system.q, np.array([2.0 * np.pi * system.m, 0.0])
    numbers = system.point.copy()
    numbers[system.free] = free(X, q) * system.spans
    pt = parameters_in.py_func(numbers)
    if pt.R == 1.0 and pt.h == 0.0:
        return math.nan
    here = calls.linearised(system, X)[1:]
    if not np.isfinite(here[0]).all():
        return math.nan
    left, sizes, right = np.linalg.svd(_closed(here, -1.0))
    if not sizes[-1] < _SINGULAR * sizes[-2]:  # near a graze, all digits of the multiplier are lost
        return math.nan
    u, w = left[:, -1], right[-1] * math.sqrt(q)
    z, wide = impact_rows(X, q), np.append(w[::2], -w[0])
    shares = (wide[1:] - wide[:-1]) / np.diff(z[:, 0], append=z[0, 0] + turn[0])
    rate = np.abs(w[::2]).max() * (1.0 + (2.0 * pt.h + pt.p) / pt.omega)
    step = 1.0 / max(rate / _ADVANCE, np.abs(shares).max() / _SHARE)
    doubled = system._replace(m=2 * system.m, q=2 * q)
    twice, way = np.concatenate([z, z + turn]).ravel(), np.concatenate([w, -w])
    places = (np.append(twice + k * step * way, X[2 * q :]) for k in (-2, -1, 1, 2))
    a, b, c, d = (np.array(calls.linearised(doubled, Y)[1:])[:, :q] for Y in places)
    first = (8.0 * (c - b) - (d - a)) / (12.0 * step)
    second = (16.0 * (b + c) - (a + d) - 30.0 * np.array(here)) / (12.0 * step**2)
    s = np.linalg.solve(_closed(here, 1.0), -_closed(first, -1.0) @ w)
    bend = u @ (_closed(second, -1.0) @ w / 6.0 + _closed(first, 1.0) @ s / 2.0)
    return float(-bend * np.sign(u[-2:] @ here[1][-1] @ w[:2]))


def _closed(factors: Sequence[np.ndarray] | np.ndarray, mu: float) -> np.ndarray:
    """Return J(mu), shape (2 q, 2 q), of the factors A and B of the impacts."""
    (A, B), q = factors, len(factors[0])
    J = np.zeros((2 * q, 2 * q))
    for i in range(q):
        J[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = A[i]
        if i + 1 < q:
            J[2 * i : 2 * i + 2, 2 * i + 2 : 2 * i + 4] = B[i]
    J[-2:, :2] += mu * B[-1]
    return J
