"""What times are measured in: a step of naive scalar code. Frozen: the limits are ratios to it."""

from __future__ import annotations

import math

from numba import njit

#: Steps in one call.
STEPS = 40_000
_H, _R, _OMEGA, _PER_PERIOD = 0.1, 0.8, 2.3, 100


@njit
def yardstick():
    """Do what a competent user writes in an afternoon: RK4 and the rule (2)-(5), one point."""
    T = 2.0 * math.pi / _OMEGA / _PER_PERIOD
    x = v = 0.0
    for k in range(STEPS):
        t = k * T
        s0, s1 = math.sin(_OMEGA * t), math.sin(_OMEGA * (t + T / 2))
        s2 = math.sin(_OMEGA * (t + T))
        k1 = -2 * _H * v - x - s0
        v2 = v + T / 2 * k1
        k2 = -2 * _H * v2 - (x + T / 2 * v) - s1
        v3 = v + T / 2 * k2
        k3 = -2 * _H * v3 - (x + T / 2 * v2) - s1
        v4 = v + T * k3
        k4 = -2 * _H * v4 - (x + T * v3) - s2
        x += T / 6 * (v + 2 * v2 + 2 * v3 + v4)
        v += T / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        if x >= 0.0 and v > 0.0:
            x, v = 0.0, -_R * v
    return x, v
