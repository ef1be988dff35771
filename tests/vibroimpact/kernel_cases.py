"""Points, methods and steps for the kernel, and what its results are compared with."""

import math

import numpy as np
import pytest

from vibroimpact import Oscillator, Status
from vibroimpact.oscillator import POINT
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.scheme import IMPACT_RULES, default_steps

#: Every integrator with every impact rule that takes it.
EVERY_METHOD = [
    (integrator, rule)
    for rule in IMPACT_RULES
    for integrator in INTEGRATORS
    if rule != "exact" or integrator == "exact"
]

# One integrator for every rule.
METHODS = pytest.mark.parametrize(
    ("rule", "integrator"), [(r, "exact" if r == "exact" else "newmark") for r in IMPACT_RULES]
)

ALL = pytest.mark.parametrize("integrator", INTEGRATORS)

# For what a rule does with short flights: a first-order step sees none that is shorter than it.
SECOND_ORDER = pytest.mark.parametrize(
    "integrator", [name for name, row in INTEGRATORS.items() if row.order != 1]
)

# What a run that went well reports.
DONE = dict.fromkeys(IMPACT_RULES, Status.COMPUTED) | {"exact": Status.CERTIFIED}
PERIOD = 2.0 * math.pi


def random_points(n, seed=11):
    """Points all over the valid domain, its corners among them."""
    rng = np.random.default_rng(seed)
    points = np.zeros(n, dtype=POINT)
    points["h"] = rng.choice([0.0, 0.05, 1.0, 3.0], n) * rng.choice([1.0, rng.random()], n)
    points["R"] = rng.choice([0.0, 0.3, 0.7, 0.95, 1.0], n)
    points["omega"] = rng.uniform(0.2, 5.0, n)
    points["f"] = rng.uniform(0.0, 3.0, n)
    points["p"] = rng.uniform(0.5, 2.0, n)
    points["clearance"] = rng.choice([0.0, 0.0, 1.0, -1.0], n) * rng.random(n)
    points["x0"] = points["clearance"] - rng.choice([0.0, 1.0, 1.0], n) * rng.random(n)
    points["v0"] = rng.choice([0.0, 1.0, -1.0], n) * rng.random(n)
    return points


def wide_points(n, seed):
    """Points at p = f = 1, omega evenly spread in its logarithm."""
    rng = np.random.default_rng(seed)
    points = np.zeros(n, dtype=POINT)
    points["h"] = rng.uniform(0.0, 2.0, n)
    points["R"] = rng.uniform(0.0, 1.0, n)
    points["omega"] = np.sort(0.05 * 400.0 ** rng.random(n))
    points["f"] = points["p"] = 1.0
    points["clearance"] = rng.uniform(-1.0, 1.0, n)
    points["x0"] = points["clearance"] - rng.exponential(1.0, n) * (rng.random(n) > 0.1)
    points["v0"] = rng.normal(0.0, 1.0, n)
    return points


def one(h=0.1, R=0.7, omega=2.3, f=1.0, clearance=0.0, x0=0.0, v0=0.0):
    """One parameter point."""
    return Oscillator(h=h, R=R, omega=omega, f=f, clearance=clearance).at(x0, v0)


def taken_apart(point):
    """The oscillator of a point, and the start."""
    given = {name: float(point[name]) for name in POINT.names}
    x0, v0 = given.pop("x0"), given.pop("v0")
    return Oscillator(**given), x0, v0


def steps_for(points, rule, otherwise=40):
    """Steps per period: few, but as many as the rule needs."""
    return default_steps(points, rule) if rule == "exact" else otherwise


def assert_same(ours, others):
    """Every array of two results is the same, bit for bit."""
    assert ours.keys() == others.keys()
    for name in ours:
        np.testing.assert_array_equal(ours[name], others[name], err_msg=name)
