"""Sweeps of random numbers, to draw."""

import numpy as np

from sweep_files import random_results

FIXED = {"h": 0.1, "R": 0.8, "omega": 2.0, "f": 1.0, "p": 1.0, "clearance": 0.25, "x0": 0, "v0": 0}
OMEGA = np.array([0.8, 1.0, 1.5, 4.0])
R = np.array([0.5, 0.8])
SAMPLES = 40


def results(points, widths, seed=0):
    arrays = random_results(points, widths, seed, scale=1.0)
    random = np.random.default_rng(seed + 1)
    arrays["period"] = random.integers(0, 3, points)
    arrays["rest_fraction"] = random.integers(0, 2, points) / 4.0
    arrays["impact_v"][..., -1:] = np.nan
    np.minimum(arrays["poincare_x"], FIXED["clearance"], out=arrays["poincare_x"])
    return arrays
