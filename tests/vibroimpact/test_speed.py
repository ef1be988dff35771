"""The kernel against a frozen yardstick, on the machine at hand: no time is absolute."""

import math
import time

import numpy as np
from numba import njit, prange

from vibroimpact import Oscillator
from vibroimpact.attractors import integrate

H, R, N = 0.1, 0.8, 100


@njit
def _one(omega, periods):
    T = 2.0 * math.pi / omega / N
    x = v = 0.0
    for k in range(periods * N):
        t = k * T
        s0, s1 = math.sin(omega * t), math.sin(omega * (t + T / 2))
        s2 = math.sin(omega * (t + T))
        k1 = -2 * H * v - x - s0
        v2 = v + T / 2 * k1
        k2 = -2 * H * v2 - (x + T / 2 * v) - s1
        v3 = v + T / 2 * k2
        k3 = -2 * H * v3 - (x + T / 2 * v2) - s1
        v4 = v + T * k3
        k4 = -2 * H * v4 - (x + T * v3) - s2
        x += T / 6 * (v + 2 * v2 + 2 * v3 + v4)
        v += T / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        if x >= 0.0 and v > 0.0:
            x, v = 0.0, -R * v
    return x, v


@njit(parallel=True)
def yardstick(omegas, periods, out):
    """Do what a competent user writes in an afternoon: scalar RK4, one point per iteration."""
    for i in prange(omegas.size):
        out[i, 0], out[i, 1] = _one(omegas[i], periods)


def clocked(function):
    """Seconds one call takes."""
    begin = time.perf_counter()
    function()
    return time.perf_counter() - begin


def test_the_kernel_is_several_times_faster_than_the_yardstick():
    """Plain rule, RK4, 100 steps: at least four times, in the best of interleaved runs."""
    periods = 20
    omegas = np.linspace(2.0, 2.6, 2048)  # one stable orbit: the answers can be compared
    points = np.concatenate([Oscillator(h=H, R=R, omega=w, f=1.0).at() for w in omegas])
    out = np.empty((omegas.size, 2))
    found = {}

    def ours():
        found.update(
            integrate(
                points,
                integrator="rk4",
                impact="plain",
                steps_per_period=N,
                transient=periods - 1,
                periods=1,
                impacts=0,
            )
        )

    def theirs():
        yardstick(omegas, periods, out)

    ours()
    theirs()
    same = np.isclose(found["poincare_x"][:, 0], out[:, 0], atol=1e-9)
    assert same.mean() > 0.99  # an impact at a step's very end may fall on either side
    rounds = [(clocked(ours), clocked(theirs)) for _ in range(7)]
    fast, slow = np.min(rounds, axis=0)
    assert slow > 4.0 * fast, f"{slow / fast:.1f} times"
