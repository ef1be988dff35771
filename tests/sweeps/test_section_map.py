"""The section map of a method: its Jacobian, its flip, its exponent."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sweeps.bench import section_map
from sweeps.bench.scenes import (
    CHAOS,
    EXACT,
    FLIP_BRACKET,
    FLIPPING,
    REGULAR,
    Method,
)
from vibroimpact import bifurcation, integrate, one_impact_orbit

ONE_IMPACT = next(scene for scene in REGULAR if scene.name == "one impact")


PLAIN, REDUCED, CUBIC = (Method("rk4", rule) for rule in ("plain", "reduced-step", "cubic"))


# The section map of a method


@pytest.mark.parametrize(("scene", "impacts"), [(ONE_IMPACT, 1), (REGULAR[2], 4)])
def test_the_determinant_of_the_jacobian(scene, impacts):
    """Closed form: R^2 for every impact and exp(-2 h T) for the flight; plain forgets x."""
    start = integrate(scene.points, transient=scene.periods, periods=1)
    points = scene.points.copy()
    points["x0"], points["v0"] = start["poincare_x"][:, 0], start["poincare_v"][:, 0]
    expected = points["R"] ** (2 * impacts) * np.exp(-4 * math.pi * points["h"] / points["omega"])
    _, J = section_map.jacobians(points, EXACT, 50)
    np.testing.assert_allclose(np.linalg.det(J), expected, rtol=1e-7)
    _, J = section_map.jacobians(points, Method("exact", "plain"), 50)
    assert np.abs(np.linalg.det(J)).max() < 1e-8


def test_the_jacobian_carries_a_small_displacement():
    points = np.repeat(FLIPPING.at(-0.32, 0.7), 2)
    points["x0"][1] += 1e-6
    points["v0"][1] += 2e-6
    images, J = section_map.jacobians(points, EXACT, 50)
    np.testing.assert_allclose(images[1] - images[0], J[0] @ [1e-6, 2e-6], rtol=1e-4)


def test_the_flip_of_the_exact_method_is_that_of_the_closed_form():
    found = section_map.flip_value(FLIPPING, FLIP_BRACKET, EXACT, 50)
    assert found == pytest.approx(2.65888454668484, abs=1e-10)
    other = replace(FLIPPING, h=0.1, R=0.5, omega=2.6)
    found = section_map.flip_value(other, (2.5, 2.9), EXACT, 50)
    assert found == pytest.approx(bifurcation(other, "flip", "omega", 2.6, 2.8), abs=1e-10)
    assert math.isnan(section_map.flip_value(FLIPPING, (2.4, 2.6), EXACT, 50))


def test_where_no_fixed_point_is_met_nothing_is_said_of_a_flip(monkeypatch):
    points = np.repeat(FLIPPING.at(-0.3, 0.7), 3)
    condition = section_map._flip_condition(points.copy(), EXACT, 50, None)
    assert np.isfinite(condition).all()
    monkeypatch.setattr(section_map, "_ITERATIONS", 2)
    assert np.isnan(section_map._flip_condition(points, EXACT, 50, None)).all()


@pytest.mark.slow
def test_a_flip_is_found_one_order_below_the_state():
    """The derivative of an error that jumps with the grid: order 1 and 3, and none with plain."""
    true = bifurcation(FLIPPING, "flip", "omega", 2.6, 2.7)

    def error(rule, around):
        steps = around + np.round(around * np.linspace(0.0, 0.2, 6)).astype(int)
        method = Method("exact", rule)
        found = [section_map.flip_value(FLIPPING, FLIP_BRACKET, method, int(n)) for n in steps]
        return np.sqrt(np.mean((np.array(found) - true) ** 2))

    for rule, order in (("reduced-step", 1.0), ("cubic", 3.0)):
        assert np.log2(error(rule, 50) / error(rule, 400)) / 3 == pytest.approx(order, abs=0.5)
    assert math.isnan(error("plain", 50))


def test_the_exponent_of_a_periodic_orbit_is_its_multiplier():
    osc = replace(FLIPPING, omega=2.655)
    multipliers = one_impact_orbit(osc).multipliers
    assert (multipliers.imag == 0.0).all()
    expected = math.log(np.abs(multipliers).max())
    points = np.repeat(osc.at(-0.3, 0.7), 2)
    found = section_map.largest_exponent(points, EXACT, 50, transient=4000, periods=500)
    assert found == pytest.approx(expected, abs=1e-6)


def test_the_exponent_of_chaos_is_that_of_the_kernel():
    """Over the same orbits; then with other methods, of which plain is not even chaotic."""
    run = integrate(CHAOS.points, transient=50, periods=400, impacts=0, lyapunov=True)
    expected = np.mean(run["lyapunov"][:, 0]) * 2 * math.pi / 2.95
    found = {
        method: section_map.largest_exponent(CHAOS.points, method, 100, 50, 400)
        for method in (EXACT, CUBIC, PLAIN)
    }
    assert expected == pytest.approx(0.40, abs=0.03)
    assert found[EXACT] == pytest.approx(expected, abs=0.01)
    assert found[CUBIC] == pytest.approx(expected, abs=0.02)
    assert found[PLAIN] < 0.0
