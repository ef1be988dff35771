"""Lanes that overflow, rest, hang or are interrupted, and arguments that are refused."""

import math

import numpy as np
import pytest

from tests.helpers.kernel_cases import (
    PERIOD,
    assert_same,
    integrated,
    one,
    random_points,
    wide_points,
)
from vibroimpact import Oscillator, Status, integrate, simulate
from vibroimpact.step.polynomial import LONGEST_STEP
from vibroimpact.step.scheme import default_steps


@pytest.mark.parametrize("omega", [1e-161, 1.3e-160, 1e-153, 1.0, 1.3e154, 1.4e154])
def test_a_motion_whose_squared_frequency_is_no_normal_number_is_not_certified(omega):
    """After an impact at the start, a cosine; its error is 60 % at 1e-161, 130 % at 1.4e154."""
    osc = Oscillator(h=0.0, R=0.8, omega=omega, f=0.0, p=0.2 * omega)
    tr = simulate(osc, 1, v0=1.0)
    out = integrate(osc.at(0.0, 1.0), transient=0, periods=1)
    right = abs(tr.v[-1] + 0.8 * math.cos(0.4 * math.pi)) < 1e-14
    assert right == (1e-154 < omega < 1.34e154)
    assert out["status"] == tr.status == (Status.CERTIFIED if right else Status.COMPUTED)


def test_an_unstable_lane_ends_as_not_a_number_and_leaves_its_neighbours_alone():
    points = random_points(40)
    bad = np.zeros(points.size, dtype=bool)
    bad[[0, 7, 35]] = True
    mixed = points.copy()
    mixed[bad] = one(50.0, 0.8, 2.0)
    method = {"integrator": "rk4", "impact": "plain", "steps_per_period": 20}
    arguments = method | {"transient": 0, "periods": 40}
    clean = integrate(points[~bad], **arguments)
    out = integrate(mixed, **arguments)
    assert_same({name: values[~bad] for name, values in out.items()}, clean)
    assert (out["status"][bad] == Status.NON_FINITE).all()
    assert np.isnan(out["poincare_x"][bad, -1]).all()
    assert np.isnan(out["poincare_v"][bad, -1]).all()
    for name in ("impacts_per_period", "max_penetration", "rest_fraction"):
        assert np.isnan(out[name][bad]).all()
    assert not np.isinf(out["poincare_x"]).any()
    once_lost = np.isnan(out["poincare_x"][bad])
    assert (np.diff(once_lost.astype(int), axis=1) >= 0).all()


def test_the_impacts_before_an_overflow_are_kept_in_time_order():
    """An unstable step gains speed up to an impact of infinite speed, which is not kept."""
    for omega in (1.2, 1.4, 1.5):
        osc = Oscillator(h=0.0, R=1.0, omega=omega, f=1e150, p=30.0)
        out = integrated(osc.at(), "rk4", "plain", 40, periods=40, impacts=4)
        assert out["status"] == Status.NON_FINITE
        assert (np.diff(out["impact_v"]) > 0.0).all()


def test_an_overflow_in_the_transient_is_seen():
    """The record of a lane that failed before its record began is NaN throughout."""
    for rule in ("plain", "reduced-step", "cubic"):
        point = one(1.9, 0.85, 0.06, clearance=0.42, x0=-0.7, v0=0.8)
        out = integrated(point, "rk4", rule, 50, transient=400, periods=3)
        assert out["status"] == Status.NON_FINITE
        assert np.isnan(out["poincare_x"]).all()
        assert np.isnan(out["impacts_per_period"]).all()


def test_a_chatter_whose_sum_overflows_is_no_result():
    def out(unit):
        osc = Oscillator(h=0.1 / unit, R=0.0, omega=1.745 / unit, f=0.0, p=1.0 / unit, a=0.3)
        return integrate(osc.at(-1.0, -1.0 / unit), transient=0, periods=20)

    small, one = out(2.0**-300), out(1.0)
    assert small["status"] == Status.CERTIFIED
    assert small["impulse"] == one["impulse"] * 2.0**300
    overflowed = out(2.0**-450)  # omega^3 overflows
    assert overflowed["status"] == Status.NON_FINITE and np.isnan(overflowed["impulse"])


@pytest.mark.parametrize("integrator", ["newmark", "exact"])
@pytest.mark.parametrize("rule", ["plain", "reduced-step", "cubic"])
def test_nothing_hangs_anywhere(rule, integrator):
    """2000 points all over the domain, coarse steps: all computed, none beyond the stop."""
    points = wide_points(2000, 5)
    out = integrated(points, integrator, rule, 50, periods=20)
    assert (out["status"] == Status.COMPUTED).all()
    assert np.isfinite(out["poincare_x"]).all()
    assert np.isfinite(out["poincare_v"]).all()
    assert (out["impacts_per_period"] > 0.0).mean() > 0.4
    if rule != "plain":
        assert (out["poincare_x"] <= points["clearance"][:, None]).all()
        assert (out["max_penetration"] == 0.0).all()
        assert ((out["rest_fraction"] >= 0.0) & (out["rest_fraction"] <= 1.0)).all()
        assert (out["rest_fraction"] > 0.5).any()
    else:
        assert (out["rest_fraction"] == 0.0).all()


@pytest.mark.parametrize("phase", [0.0, 0.3, 5.1, 6.2])
def test_a_start_on_the_stop_where_the_force_begins_to_pull_is_no_rest(rule, integrator, phase):
    """Rounding decides the sign of the force there; a start shortly after it certainly flies."""
    rng, n = np.random.default_rng(2), 60
    points = Oscillator(h=0.1, R=0.8, omega=2.0, f=1.0).at().repeat(n)
    points["h"], points["R"] = rng.uniform(0.0, 0.3, n), rng.uniform(0.3, 1.0, n)
    points["omega"], points["p"] = rng.uniform(1.5, 4.0, n), rng.choice([1.0, 1.3], n)
    points["f"] = rng.uniform(0.5, 2.0, n)
    points["clearance"] = points["x0"] = -points["f"] / points["p"] ** 2 * math.sin(phase)
    options = {"integrator": integrator, "impact": rule, "transient": 0, "periods": 2}
    options |= {"lyapunov": rule == "exact", "at_section": True}
    out, after = (integrate(points, phase=at, **options) for at in (phase, phase + 1e-9))
    flies = after["rest_fraction"] == 0.0
    assert flies.sum() >= n // 5
    assert (out["chatters"][flies] == 0).all()
    assert (out["rest_fraction"][flies] == 0.0).all()
    if rule == "exact":
        assert np.isfinite(out["lyapunov"][flies]).all()
    names = ("h", "R", "omega", "f", "p", "clearance")
    for pt in points[flies][:5]:
        osc = Oscillator(**{name: pt[name] for name in names})
        tr = simulate(osc, 2, integrator, rule, x0=osc.clearance, phase=phase)
        assert len(tr.rests) == 0


@pytest.mark.parametrize("transient", [1, 2])
def test_a_record_that_begins_at_the_end_of_a_rest_has_no_rest(transient):
    """A shaken base: the last rest ends at the first section; the motion never rests again."""
    h, omega, a = 0.016204919189485998, 0.31822657272386123, 3.3237286974954467
    osc = Oscillator(h=h, R=0.95, omega=omega, f=0.0, a=a)
    start = osc.at(-0.04209741582165098)
    out = integrate(start, transient=transient, periods=20, lyapunov=True)
    assert (out["chatters"], out["rest_fraction"]) == (0, 0.0)
    assert np.isfinite(out["lyapunov"]).all()
    assert len(simulate(osc, 20, x0=start["x0"][0], transient=transient).rests) == 0


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("x0", 0.1, "at most the clearance"),
        ("x0", math.nan, "a finite number"),
        ("R", -3.0, "a number from 0 to 1"),
        ("h", -0.1, "a finite number >= 0"),
        ("omega", 0.0, "a finite number > 0"),
        ("p", math.inf, "a finite number > 0"),
    ],
)
def test_a_point_that_is_not_valid_is_named(name, value, allowed):
    points = random_points(5)
    points["clearance"] = points["x0"] = 0.0
    points[name][3] = value
    said = rf"^points\[3\]: {name} .* = {value} is not allowed; expected: {allowed}"
    with pytest.raises(ValueError, match=said):
        integrate(points)


def test_what_is_no_array_of_points_is_refused():
    points = random_points(4)
    others = np.ma.array(points), Oscillator(0.1, 0.5, 1.0, 1.0)
    for wrong in (None, points.tolist(), points["h"], *others):
        with pytest.raises(TypeError, match=r"points = .*; expected: an array of the dtype POINT"):
            integrate(wrong)
    with pytest.raises(ValueError, match=r"points of the shape \(2, 2\) .* the shape \(n,\)"):
        integrate(points.reshape(2, 2))
    expected = integrate(points[::2].copy(), transient=0, periods=2)
    assert_same(integrate(points[::2], transient=0, periods=2), expected)


def test_the_plain_rule_goes_on_from_beyond_the_stop():
    points = one()
    points["x0"] = 0.01
    plain = {"integrator": "newmark", "impact": "plain", "transient": 0, "periods": 1}
    assert integrate(points, **plain, at_section=True)["status"] == Status.COMPUTED
    for other in (plain, plain | {"impact": "cubic", "at_section": True}):
        with pytest.raises(ValueError, match=r"x0 .* = 0\.01 .*; expected: at most the clearance"):
            integrate(points, **other)


@pytest.mark.parametrize(("R", "v0"), [(1.0, 3e307), (0.5, 1e200)])
def test_a_result_that_overflows_is_no_certified_one(R, v0):
    """The impulse of finite speeds, and the energy: both are beyond the largest number."""
    osc = Oscillator(0.0, R, 1.0, 1.0)
    out = integrate(osc.at(-1.0, v0), transient=0, periods=3)
    assert out["status"] == simulate(osc, 3, x0=-1.0, v0=v0).status == Status.NON_FINITE
    assert np.isnan(out["impulse"]) and np.isnan(out["energy_lost"])
    smaller = integrate(osc.at(-1.0, 1e-60 * v0), transient=0, periods=3)
    alone = simulate(osc, 3, x0=-1.0, v0=1e-60 * v0)
    assert smaller["status"] == alone.status == Status.CERTIFIED
    assert np.isfinite(smaller["impulse"])


def test_what_the_exact_rule_needs_is_said():
    with pytest.raises(ValueError, match="impact 'exact' needs the integrator 'exact', not 'rk4'"):
        integrate(one(), integrator="rk4")
    points = np.concatenate([one(omega=2.3), one(omega=0.3), one(h=0.0, omega=5.0)])
    least = math.ceil(PERIOD * (1.2 / 0.3 + 1) / LONGEST_STEP)
    assert default_steps(points, "exact") == least
    with pytest.raises(ValueError, match=f"steps_per_period = {least - 1} .* from {least} to"):
        integrate(points, steps_per_period=least - 1)
    out = integrate(points, steps_per_period=least, transient=1, periods=1)
    assert_same(out, integrate(points, transient=1, periods=1))
    for rule in ("plain", "reduced-step", "cubic"):
        assert default_steps(points, rule) == 100
        with pytest.raises(ValueError, match="lyapunov needs the impact rule 'exact'"):
            integrate(points, impact=rule, lyapunov=True)
