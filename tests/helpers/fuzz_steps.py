"""Steps from states of every magnitude, for test_termination.py, in a separate process.

``fuzz_steps.py SEED STEPS`` takes STEPS steps with every impact rule: half of them with floats made
of random bits, half in runs of valid points at and between the bounds of their parameters.
"""

import sys
import time

import numpy as np

from tests.helpers.kernel_cases import EVERY_METHOD
from vibroimpact import integrate
from vibroimpact.jit import jit
from vibroimpact.kernel.record import SUMS, list_impact
from vibroimpact.oscillator import PARAMETERS, POINT
from vibroimpact.status import Status
from vibroimpact.step.contact import EVENTS_SHAPE, IMPACT, KIND, SPEED, TIME, new_scratch
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.polynomial import LONGEST_STEP
from vibroimpact.step.propagator import (
    Coefficients,
    Forcing,
    Propagator,
    coefficients_of,
    propagator_of,
)
from vibroimpact.step.recorder import trace
from vibroimpact.step.scheme import EXACT, IMPACT_RULES, PLAIN, PhaseGrid, scheme_of
from vibroimpact.step.stepper import take_exact_step
from vibroimpact.step.time_stepping import plain, reduced_step

BATCH = 64
LARGEST, SMALLEST_NORMAL, SMALLEST = sys.float_info.max, sys.float_info.min, 5e-324


# --- floats made of random bits ---


@jit
def take_steps(method, states, points, rows, consistent, scratch, ring, sums):
    """Take one step from each state; the fields are floats but otherwise arbitrary."""
    most, table = 0, np.zeros((3, 2))
    for k in range(states.shape[0]):
        x, v, x_T, v_T, theta, s, c, step = states[k]
        pt, r, start, at = points[k], rows[k], (x, v, k % 2 == 0), (theta, s, c)
        if method[0] == PLAIN:
            n = plain(x_T, v_T, step / pt.omega, pt, scratch)[2]
        elif method[0] == EXACT:
            eq = Coefficients(r[0], r[1], r[2], r[3], r[4])
            flow = (
                Propagator(r[5], r[6], r[7], r[8], r[9], r[10], r[11]),
                Forcing(r[12], r[13], r[14], r[15], r[16], r[17]),
            )
            if consistent:
                eq = coefficients_of(pt)
                flow = propagator_of(eq, step, scratch.coefficients)
            table[:, 0], table[1:, 1] = at, (x_T, v_T)
            grid, reach = PhaseGrid(table, step, 1), (0.0, 0.0)
            n = take_exact_step((eq, flow), start, grid, 0, pt, scratch, reach, True)[1]
        else:
            n = reduced_step(method, start, (x_T, v_T), at, step / pt.omega, pt, scratch)[3]
        for j in range(n):
            if scratch.events[j, KIND] == IMPACT:
                phase = theta + pt.omega * scratch.events[j, TIME]
                list_impact(ring, sums[0], phase, scratch.events[j, SPEED])
        most = max(most, n)
    return most


def random_floats(rng, shape):
    """Return floats of random bits, or ordinary numbers mixed with special ones."""
    bits = rng.integers(0, 2**64, shape, dtype=np.uint64).view(float)
    special = np.array(
        [0.0, -0.0, 1.0, np.inf, -np.inf, np.nan, SMALLEST, SMALLEST_NORMAL, LARGEST, -LARGEST]
    )
    ordinary = np.where(rng.random(shape) < 0.3, rng.choice(special, shape), rng.normal(size=shape))
    return np.where(rng.random((shape[0],) + (1,) * (len(shape) - 1)) < 0.5, bits, ordinary)


def fuzz_bits(rng, integrator, rule, scratch):
    """Take a batch of steps from states of random bits."""
    points = random_floats(rng, (BATCH, len(PARAMETERS))).copy().view(POINT)[:, 0]
    most = take_steps(
        (IMPACT_RULES[rule].code, INTEGRATORS[integrator].code), random_floats(rng, (BATCH, 8)),
        points, random_floats(rng, (BATCH, 20)), bool(rng.random() < 0.7), scratch,
        np.empty((4, 2)), np.zeros(1, SUMS),
    )  # fmt: skip
    assert 0 <= most <= EVENTS_SHAPE[0]
    return BATCH


# --- runs of valid points ---


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
    scratch = new_scratch()
    for rule in IMPACT_RULES:
        integrators = [integrator for integrator, other in EVERY_METHOD if other == rule]
        rng = np.random.default_rng(seed)
        began, taken = time.perf_counter(), 0
        while taken < steps:
            integrator = str(rng.choice(integrators))
            taken += fuzz_bits(rng, integrator, rule, scratch)
            taken += fuzz_run(rng, integrator, rule)
        print(f"{rule}: {taken} steps in {time.perf_counter() - began:.3g} s", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
