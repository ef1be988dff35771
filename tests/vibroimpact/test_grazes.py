"""Constructed grazes: flights whose highest point is a given distance beyond or below the stop."""

import math

import naive
import numpy as np
import pytest

from kernel_cases import PERIOD
from vibroimpact import integrate
from vibroimpact.oscillator import POINT
from vibroimpact.step.scheme import default_steps


def graze(rng):
    """A point, the time of its highest point, the acceleration there, and how far beyond it lies.

    The flight is followed back from there with 40 digits; None where it meets the stop before, or
    where rounding its start moves that point by a hundredth of the distance.
    """
    osc = naive.oscillator(
        h=rng.choice([0.0, rng.uniform(0, 1)]), R=0.9 * rng.random(),
        omega=0.3 * 15.0 ** rng.random(), f=rng.uniform(0.2, 3), p=rng.uniform(0.5, 2),
        clearance=rng.choice([0.0, rng.normal()]),
    )  # fmt: skip
    height = rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-12, -5)
    top = rng.uniform(0.02, 0.98) * PERIOD / osc.omega
    s, c = math.sin(osc.omega * top), math.cos(osc.omega * top)
    a = -osc.f * s - osc.p**2 * osc.clearance
    if a > -0.1:
        return None
    x, v = naive.flow(osc, osc.clearance + height, 0.0, s, c, -top)
    before = np.arange(0.0, top - 0.02, 0.005)
    path, _ = naive.ClosedForm(osc, 0.0, x, v)(before)
    if (
        abs(height) < 1e-14 * (abs(x) + abs(v))
        or before.size == 0
        or path.max() > osc.clearance - 1e-4
    ):
        return None
    values = osc.h, osc.R, osc.omega, osc.f, osc.p, osc.clearance, x, v
    return values, top, a, height


@pytest.mark.parametrize(
    "count",
    [pytest.param(300, marks=pytest.mark.slow), pytest.param(20_000, marks=pytest.mark.campaign)],
)
def test_a_touch_is_seen_and_a_miss_is_none(count):
    """From 1e-12 to 1e-5 beyond the stop, or below it, anywhere in a step of any length."""
    rng = np.random.default_rng(17)
    made = (graze(rng) for _ in range(100 * count))
    found = [one for one, _ in zip(filter(None, made), range(count), strict=False)]
    values, top, a, height = (np.array(column) for column in zip(*found, strict=True))
    points = np.zeros(count, POINT)
    for name, column in zip(POINT.names, values.T, strict=True):
        points[name] = column
    phase, touches = points["omega"] * top, height > 0.0
    assert 0.3 < touches.mean() < 0.7
    for share in (1, 2, 5):
        steps = share * default_steps(points, "exact")
        out = integrate(points, steps_per_period=steps, transient=0, periods=1, impacts=500)
        assert (out["impacts_per_period"] < 500).all()
        with np.errstate(invalid="ignore"):  # no number where there was no impact
            early = out["impact_phase"][:, 0] < phase + 0.01 * points["omega"]
        np.testing.assert_array_equal(early, touches)
        time = out["impact_phase"][touches, 0] / points["omega"][touches]
        half = np.sqrt(2.0 * height / np.abs(a), where=touches, out=np.zeros(count))[touches]
        np.testing.assert_allclose(top[touches] - time, half, rtol=0.05)
        speed = out["impact_v"][touches, 0]
        np.testing.assert_allclose(speed, half * np.abs(a[touches]), rtol=0.05)
