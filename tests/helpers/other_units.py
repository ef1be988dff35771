"""Quantities in other units of length and time, which a power of two changes by no bit."""

import numpy as np

#: The powers of 1 / time and of length in the unit of each quantity; the others have none.
POWERS = {
    "h": (1, 0), "omega": (1, 0), "p": (1, 0), "f": (2, 1), "clearance": (0, 1), "a": (0, 1),
    "x0": (0, 1), "v0": (1, 1), "x": (0, 1), "v": (1, 1), "poincare_x": (0, 1),
    "poincare_v": (1, 1), "poincare_height": (0, 1), "impact_v": (1, 1), "slowest_impact": (1, 1),
    "fastest_impact": (1, 1), "impulse": (1, 1), "energy_lost": (2, 2), "max_penetration": (0, 1),
    "x_min": (0, 1), "x_max": (0, 1),
    "lyapunov": (1, 0), "section_x": (0, 1), "section_v": (1, 1), "speeds": (1, 1),
    "integrity_factor": (0, 1), "disc_x": (0, 1), "disc_v": (1, 1), "local_integrity": (0, 1),
    "knock_x": (0, 1), "knock_v": (1, 1), "knock_harmless": (1, 1), "knock_harmful": (1, 1),
}  # fmt: skip


def in_units(name, values, rate, length):
    """Return a quantity in units in which 1 / time and length have other numbers."""
    of_rate, of_length = POWERS.get(name, (0, 0))
    return np.multiply(values, rate**of_rate * length**of_length) if name in POWERS else values
