"""Points, methods and steps for tests of the kernel, and comparisons of its results."""

import math

import numpy as np
import pytest

from vibroimpact import Oscillator, Status, integrate
from vibroimpact.oscillator import POINT
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.scheme import IMPACT_RULES, default_steps

#: Every integrator with every impact rule that accepts it.
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

# For short flights: a first-order step does not see flights shorter than itself.
SECOND_ORDER = pytest.mark.parametrize(
    "integrator", [name for name, row in INTEGRATORS.items() if row.order != 1]
)


def few_or_many(names, few, many):
    """Run a slow test for a few cases, and for many of them in a campaign."""

    def case(values, mark):
        return pytest.param(*(values if isinstance(values, tuple) else (values,)), marks=mark)

    cases = [case(few, pytest.mark.slow), case(many, pytest.mark.campaign)]
    return pytest.mark.parametrize(names, cases)


# Status of successful runs.
DONE = dict.fromkeys(IMPACT_RULES, Status.COMPUTED) | {"exact": Status.CERTIFIED}
PERIOD = 2.0 * math.pi


def random_points(n, seed=11):
    """Return points all over the valid domain, including its corners."""
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
    """Return points at p = f = 1 with logarithmically spaced omega."""
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


def one(h=0.1, R=0.7, omega=2.3, f=1.0, clearance=0.0, x0=0.0, v0=0.0, phase=0.0):
    """Return one parameter point."""
    return Oscillator(h=h, R=R, omega=omega, f=f, clearance=clearance).at(x0, v0, phase)


def taken_apart(point):
    """Return the oscillator of a point that starts at phase 0, and its start."""
    given = {name: float(point[name]) for name in POINT.names}
    x0, v0 = given.pop("x0"), given.pop("v0")
    assert given.pop("phase") == 0.0
    return Oscillator(**given), x0, v0


def steps_for(points, rule, otherwise=40):
    """Return steps per period: few, but enough for the rule."""
    return default_steps(points, rule) if rule == "exact" else otherwise


def integrated(points, integrator, rule, steps, transient=0, **options):
    """Integrate by a method, which is given in the order of `simulate`."""
    method = {"integrator": integrator, "impact": rule, "steps_per_period": steps}
    return integrate(points, **method, transient=transient, **options)


def assert_same(ours, others):
    """Compare every array of two results bit for bit."""
    assert ours.keys() == others.keys()
    for name in ours:
        np.testing.assert_array_equal(ours[name], others[name], err_msg=name)
