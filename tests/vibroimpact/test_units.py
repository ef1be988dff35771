"""A change of units by powers of two changes no bit of what has no unit."""

import numpy as np
import pytest

from tests.helpers.kernel_cases import random_points
from vibroimpact.kernel.integrate import Length, run_points
from vibroimpact.oscillator import POINT
from vibroimpact.step.scheme import scheme_of

#: The powers of 1 / time and of length in the unit of each quantity; the others have none.
UNITS = {
    "h": (1, 0), "omega": (1, 0), "p": (1, 0), "f": (2, 1), "clearance": (0, 1), "x0": (0, 1),
    "v0": (1, 1), "poincare_x": (0, 1), "poincare_v": (1, 1), "impact_v": (1, 1),
    "slowest_impact": (1, 1), "fastest_impact": (1, 1), "impulse": (1, 1), "energy_lost": (2, 2),
    "max_penetration": (0, 1), "lyapunov": (1, 0), "x": (0, 1), "v": (1, 1),
}  # fmt: skip


def in_units(values, name, rate, length):
    """Return a quantity in units in which 1 / time and length have other numbers."""
    of_rate, of_length = UNITS.get(name, (0, 0))
    return values * (rate**of_rate * length**of_length) if name in UNITS else values


def run(points, integrator, rule):
    """Return all results, with those of the destination beside them."""
    scheme = scheme_of(points, integrator, rule, None, phase=0.3)
    length, flag = Length(20, 64, 8), np.zeros(1, np.int64)
    results = run_points(points, scheme, length, rule == "exact", None, flag, classes=True)
    del results["begun"]
    found = results.pop("destination")
    return results | {name: found[name] for name in found.dtype.names}


@pytest.mark.parametrize("rate", [2.0**10, 2.0**-7])
@pytest.mark.parametrize(
    ("integrator", "rule"), [("exact", "exact"), ("newmark", "reduced-step"), ("rk4", "plain")]
)
def test_units_change_no_bit(integrator, rule, rate):
    """Of random motions: sections, impacts, exponents, classes, evidence and status."""
    length, points = 2.0**5, random_points(300)
    results = run(points, integrator, rule)
    for name in POINT.names:
        points[name] = in_units(points[name], name, rate, length)
    for name, values in run(points, integrator, rule).items():
        expected = in_units(results[name], name, rate, length)
        np.testing.assert_array_equal(values, expected, err_msg=name)
