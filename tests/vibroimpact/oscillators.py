"""Oscillators as tests name them: by position, and at random."""

from dataclasses import replace

import numpy as np
from scipy.optimize import bisect

from vibroimpact import Oscillator, one_impact_orbit


def oscillator(h, R, omega=1.0, clearance=0.0, f=1.0, p=1.0):
    """An oscillator by position."""
    return Oscillator(h=h, R=R, omega=omega, f=f, p=p, clearance=clearance)


def random_oscillators(count, seed, clearance=1.0):
    """Oscillators and n at random: a quarter each undamped, critical, over-damped, any."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        p = rng.uniform(0.5, 2.0)
        h = (0.0, p, p * rng.uniform(1.0, 2.0), p * rng.uniform())[k % 4]
        osc = oscillator(
            h,
            rng.uniform(),
            p * rng.uniform(0.3, 7.0),
            rng.uniform(-clearance, clearance),
            rng.uniform(0.5, 2.0),
            p,
        )
        yield osc, int(rng.integers(1, 4))


#: What changes its sign where a one-impact orbit bifurcates.
_SIGNS = {
    "flip": lambda orbit: np.real(np.prod(1.0 + orbit.multipliers)),
    "graze": lambda orbit: orbit.peak,
    "fold": lambda orbit: 1.0 if orbit.v > 0.0 else -1.0,
}


def bifurcation(osc, kind, parameter, low, high, n=1):
    """The value of a parameter at which the one-impact orbit bifurcates, by bisection."""

    def sign(value):
        return _SIGNS[kind](one_impact_orbit(replace(osc, **{parameter: value}), n))

    return bisect(sign, low, high, xtol=1e-300, rtol=4.0 * np.finfo(float).eps, maxiter=200)
