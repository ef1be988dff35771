"""A change of units by powers of two changes no bit of what has no unit."""

import numpy as np
import pytest

from tests.helpers.kernel_cases import random_points
from tests.helpers.oscillators import random_oscillators
from vibroimpact import Oscillator
from vibroimpact.kernel.integrate import Length, run_points
from vibroimpact.natural_units import NaturalUnits
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


def test_natural_units_are_near_those_of_the_motion():
    """The extent f / (omega^2 + 2 h omega + p^2) = 10 / 16 is 1.25 L, and omega = 1 / T."""
    osc = Oscillator(h=1.0, R=0.5, omega=2.0, f=10.0, p=8.0**0.5)
    points = np.concatenate([osc.at(), osc.at(-1.0, 3.0)])
    points["omega"][0], points["f"][0] = 1.5, 1.0
    units = NaturalUnits.of(points)
    assert units == (-1, -1)
    inside = units.points_into(points)
    assert [inside[name][1] for name in ("omega", "f", "x0", "v0")] == [1.0, 5.0, -2.0, 3.0]
    points["clearance"] = -3.0
    assert NaturalUnits.of(points).length == 1


@pytest.mark.parametrize("exponents", [(-900, 0), (40, 20), (-40, -20), (0, 500), (-300, -300)])
def test_natural_oscillators_do_not_depend_on_the_units(exponents):
    other = NaturalUnits(*exponents)
    for osc, _ in random_oscillators(40, 3):
        scaled = other.oscillator_into(osc)
        natural, same = (NaturalUnits.of(o.at(o.clearance)) for o in (osc, scaled))
        assert natural.oscillator_into(osc) == same.oscillator_into(scaled)
        assert other.oscillator_out_of(scaled) == osc
        assert 1.0 <= natural.oscillator_into(osc).omega < 2.0


@pytest.mark.parametrize(
    "values",
    [
        {"f": 1e308, "h": 1e300, "omega": 1e-300},
        {"f": 0.0, "a": 1e-310, "omega": 1e300, "p": 1e-300},
        {"f": 0.0, "a": 0.0},
        {"f": 0.0, "a": 0.0, "clearance": -1e308},
        {"f": 1e-320, "p": 1e300},
    ],
)
def test_natural_units_of_extreme_numbers_are_numbers(values):
    points = Oscillator(h=0.1, R=0.5, omega=1.0, f=1.0).at()
    for name, value in values.items():
        points[name] = value
    assert abs(NaturalUnits.of(points).length) < 10_000
