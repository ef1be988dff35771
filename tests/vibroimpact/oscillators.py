"""Oscillators as tests name them: by position, and at random."""

import numpy as np

from vibroimpact import Oscillator


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
