"""The criticality of flips, in 60 digits.

That of the first flip of a cascade, beyond which stable orbits of twice the period begin, is tested
in test_cascades.py.
"""

from itertools import islice

import mpmath as mp
import numpy as np
import pytest

from tests.helpers.oscillators import SectionMap
from vibroimpact import Oscillator, branch, integrate, periodic_orbit
from vibroimpact.orbits.periodic import OrbitError


def random_flips(seed):
    """Yield flips of random periodic motions: the parameter and the special point."""
    rng = np.random.default_rng(seed)
    while True:
        osc = Oscillator(
            h=rng.choice([0.0, 10 ** rng.uniform(-3.0, -0.5)]), R=rng.uniform(0.4, 0.97),
            omega=rng.uniform(0.5, 5.0), f=1.0, clearance=rng.choice([0.0, rng.uniform(-0.5, 1.5)]),
        )  # fmt: skip
        points = osc.at(min(0.0, osc.clearance))
        x, v = (integrate(points, transient=400, periods=9)[name][0] for name in
                ("poincare_x", "poincare_v"))  # fmt: skip
        repeats = [m for m in range(1, 8) if abs(x[-1] - x[-1 - m]) < 1e-8]
        if not repeats or np.isnan(x[-1]):
            continue
        name = str(rng.choice(["omega", "R", "clearance"]))
        value = getattr(osc, name)
        low, high = (0.01, 1.0) if name == "R" else (value - 0.2, value + 0.2)
        try:
            found = branch(periodic_orbit(osc, x[-1], v[-1], repeats[0]), name, low, high)
        except OrbitError:
            continue
        flips = [point for point in found.special if point.kind == "flip"]
        yield from ((name, flip) for flip in flips if flip.orbit.speeds.min() > 1e-3)


def in_digits(name, flip):
    """Return the criticality of a flip in 60 digits."""
    with mp.workdps(60):
        there = SectionMap(flip.orbit)
        there.bifurcation("flip", name)
        return "supercritical" if there.cubic_coefficient() > 0 else "subcritical"


@pytest.mark.parametrize(
    "count",
    [pytest.param(6, marks=pytest.mark.slow), pytest.param(400, marks=pytest.mark.campaign)],
)
def test_the_criticality_is_that_of_the_cubic_coefficient_in_60_digits(count):
    for name, flip in islice(random_flips(seed=1), count):
        assert flip.orbit.criticality == in_digits(name, flip), flip
