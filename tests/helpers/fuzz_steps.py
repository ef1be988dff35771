"""Runs of valid points of every magnitude, at and between the bounds of their parameters."""

import sys

import numpy as np

from tests.helpers.kernel_cases import EVERY_METHOD
from vibroimpact import integrate
from vibroimpact.oscillator import PARAMETERS, POINT
from vibroimpact.status import Status
from vibroimpact.step.polynomial import LONGEST_STEP
from vibroimpact.step.recorder import trace
from vibroimpact.step.scheme import IMPACT_RULES, scheme_of

BATCH = 64
LARGEST, SMALLEST_NORMAL, SMALLEST = sys.float_info.max, sys.float_info.min, 5e-324


def any_magnitude(rng, n):
    """Return positive numbers: of every magnitude, the bounds, and ordinary ones."""
    bounds = rng.choice([0.0, SMALLEST, SMALLEST_NORMAL, LARGEST, 1.0], n)
    ordinary = rng.uniform(0.0, 3.0, n)
    every = 10.0 ** rng.uniform(-323.0, 308.0, n)
    return np.choose(rng.integers(0, 3, n), [bounds, ordinary, every])


def random_points(rng, rule):
    """Return valid points; for the rule ``exact``, only points that need few steps."""
    n = 8 * BATCH
    points = np.zeros(n, POINT)
    points["omega"] = np.where(rng.random(n) < 0.5, 1.0, any_magnitude(rng, n))
    for name in ("h", "p"):
        ratio = rng.choice([0.0, 0.3, 1.0, 3.0], n) * rng.random(n)
        with np.errstate(over="ignore"):
            near = points["omega"] * (ratio if name == "h" else ratio + 1e-3)
        points[name] = np.where(rng.random(n) < 0.8, near, any_magnitude(rng, n))
    restitution = np.array([0.0, 1.0, 1.0 - 2.0**-53, 0.9995, SMALLEST, 0.5, 0.8])
    points["R"] = np.where(rng.random(n) < 0.5, rng.choice(restitution, n), rng.random(n))
    points["f"] = rng.choice([0.0, 1.0], n) * any_magnitude(rng, n)
    signs = rng.choice([-1.0, 1.0], (3, n))
    points["clearance"] = rng.choice([0.0, 0.0, 1.0], n) * signs[0] * any_magnitude(rng, n)
    points["x0"] = np.minimum(signs[1] * any_magnitude(rng, n), points["clearance"])
    points["v0"] = signs[2] * any_magnitude(rng, n)
    valid = np.all([[p.accepts(q) for q in points[k]] for k, p in PARAMETERS.items()], axis=0)
    if rule == "exact":
        with np.errstate(all="ignore"):
            rates = (2.0 * points["h"] + points["p"]) / points["omega"] + 1.0
            valid &= 2.0 * np.pi * rates <= 100 * LONGEST_STEP
    return points[valid][:BATCH]


def fuzz_run(rng, integrator, rule):
    """Run valid points: finite or failed, no gain of energy, the same results as alone."""
    points = random_points(rng, rule)
    method = {"integrator": integrator, "impact": rule, "periods": 1}
    method["phase"] = float(rng.choice([0.0, 1.3, 6.28]))
    # At the section, before it or beyond it.
    points["phase"] = rng.choice([method["phase"], 0.0, 3.0, 6.2], points.size)
    method["steps_per_period"] = 100 if rule == "exact" else int(rng.choice([1, 7, 40]))
    out = integrate(points, transient=0, impacts=4, threads=1, **method)
    done = out["status"] < Status.UNRESOLVED
    x, v = out["poincare_x"][:, 0], out["poincare_v"][:, 0]
    assert (np.isfinite(x[done]) & np.isfinite(v[done])).all(), points[done]
    if rule == "exact":
        assert (x[done] <= points["clearance"][done]).all(), points[done]
        free = done & (out["status"] != Status.COMPUTED) & (points["f"] == 0.0)
        p = points["p"]
        with np.errstate(over="ignore"):
            before, after = np.hypot(points["v0"], p * points["x0"]), np.hypot(v, p * x)
            allowed = before * (1.0 + 1e-12) + SMALLEST_NORMAL * (1.0 + p + points["omega"])
            # The state is x - clearance, with rounding errors.
            allowed += 1e-13 * p * np.abs(points["clearance"])
        assert (after <= allowed)[free].all(), points[free & ~(after <= allowed)]
    i = int(rng.integers(points.size))
    scheme = scheme_of(
        points[i : i + 1], integrator, rule, method["steps_per_period"], method["phase"]
    )
    log, status = trace(points[i : i + 1], scheme, periods=1)
    if done[i]:
        alone, beside = (log[-1, 2], log[-1, 3], status), (x[i], v[i], out["status"][i])
        assert alone == beside, (method, points[i], alone, beside)
    return points.size * method["steps_per_period"]


def main(seed, steps):
    """Take at least `steps` steps with every rule."""
    for rule in IMPACT_RULES:
        integrators = [integrator for integrator, other in EVERY_METHOD if other == rule]
        rng, taken = np.random.default_rng(seed), 0
        while taken < steps:
            integrator = str(rng.choice(integrators))
            taken += fuzz_run(rng, integrator, rule)
