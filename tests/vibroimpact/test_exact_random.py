"""The exact rule at random points, at constructed grazes, and for growing motions."""

import cmath
import math

import numpy as np
import pytest

from tests.helpers import naive
from tests.helpers.kernel_cases import PERIOD, few_or_many, taken_apart, wide_points
from vibroimpact import Oscillator, Status, integrate, simulate
from vibroimpact.oscillator import POINT
from vibroimpact.step.scheme import default_steps


@pytest.mark.slow
def test_random_points_end_decided():
    """2000 points, 50 periods: no NaN, nothing beyond the stop, a matching status."""
    points = wide_points(2000, 17)
    for part in np.array_split(points, 10):
        out = integrate(part, transient=0, periods=50, lyapunov=True)
        for name in ("poincare_x", "poincare_v", "impacts_per_period", "rest_fraction"):
            assert np.isfinite(out[name]).all()
        assert not np.isnan(out["lyapunov"]).any()
        assert (out["max_penetration"] <= 1e-12).all()
        assert (out["poincare_x"] <= part["clearance"][:, None]).all()
        assert ((out["rest_fraction"] >= 0.0) & (out["rest_fraction"] <= 1.0 + 1e-12)).all()
        decided = (Status.CERTIFIED, Status.CUT_SHORT, Status.UNBOUNDED)
        assert np.isin(out["status"], decided).all()
        assert (part["R"][out["status"] == Status.CUT_SHORT] > 0.99).all()
        assert not (out["status"] == Status.UNBOUNDED).any()


@pytest.mark.slow
def test_no_impact_depends_on_how_many_share_a_step():
    """4000 points, 4 periods, with long steps and short ones: the same impacts, speeds, sections.

    In long steps flights follow one another. Where a chatter was summed up or R is nearly 1, the
    number of impacts, or what becomes of a rounding, depends on the steps.
    """
    points, alike = wide_points(4000, 31), 0
    points["h"] *= 0.3
    points["omega"] = np.geomspace(0.3, 6.0, points.size)
    for part in np.array_split(points, 20):
        most = default_steps(part, "exact")
        how = {"transient": 0, "periods": 4}
        few, many = (integrate(part, steps_per_period=n, **how) for n in (most, 4 * most + 1))
        np.testing.assert_array_equal(few["status"], many["status"])
        same = (few["chatters"] == 0) & (part["R"] < 0.99) & (few["slowest_impact"] > 1e-4)
        np.testing.assert_array_equal(few["chatters"][same], many["chatters"][same])
        impacts = few["impacts_per_period"][same]
        np.testing.assert_array_equal(impacts, many["impacts_per_period"][same])
        for name in ("poincare_x", "poincare_v", "slowest_impact", "fastest_impact"):
            np.testing.assert_allclose(few[name][same], many[name][same], atol=1e-7)
        alike += (impacts > 1.0).sum()
    assert alike > 500


@few_or_many("every", 400, 1)
@pytest.mark.parametrize("shaken", [False, True])
def test_random_points_are_those_of_the_slow_solver(every, shaken):
    """2000 points, or 5: sections, impacts and rests to 1e-9, with a force or with a shaken base.

    10 periods or 500 impacts, chatters included; from a graze within 1e-6 on, none is compared.
    """
    points = wide_points(2000, 23)[::every]
    if shaken:
        rng = np.random.default_rng(24)
        points["a"] = rng.uniform(0.2, 2.0, len(points)) / (1.0 + points["omega"] ** 2)
        points["f"] *= rng.choice([0.0, 0.5], len(points))
    grazed, sections, impacts, rested = 0, 0, 0, 0
    for point in points:
        osc, x0, v0 = taken_apart(point)
        slow = naive.ExactOrbit(osc, 10, x0, v0, most=500)
        tr = simulate(osc, 10, x0=x0, v0=v0)
        known = np.array(slow.sections).reshape(-1, 2)
        end = min(slow.graze, slow.reached) * (1 + 1e-13)
        grazed += slow.graze < slow.reached
        compared = int((np.arange(1, len(known) + 1) * osc.forcing_period <= end).sum())
        ours = np.column_stack([tr.section_x, tr.section_v])
        np.testing.assert_allclose(ours[:compared], known[:compared], atol=1e-9)
        hits = np.array(slow.impacts).reshape(-1, 2)
        hits = hits[(hits[:, 0] < end - 1e-6) & (hits[:, 1] > 1e-4)]
        if len(hits):
            nearest = np.abs(tr.impact_t[:, None] - hits[:, 0]).argmin(axis=0)
            np.testing.assert_allclose(tr.impact_t[nearest], hits[:, 0], atol=1e-9)
            np.testing.assert_allclose(tr.impact_v[nearest], hits[:, 1], atol=1e-9)
        rests = np.array([r for r in slow.rests if r[1] < end]).reshape(-1, 2)
        np.testing.assert_allclose(tr.rests[: len(rests)], rests, atol=1e-9)
        sections += compared
        impacts += len(hits)
        rested += len(rests)
    assert 10 * grazed < len(points)
    assert sections > 5 * len(points) and impacts > 10 * len(points) and rested > len(points)


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
    values = osc.h, osc.R, osc.omega, osc.f, osc.p, osc.clearance, 0.0, x, v, 0.0
    return values, top, a, height


@few_or_many("count", 300, 20_000)
def test_a_touch_is_seen_and_a_miss_is_none(count):
    """From 1e-12 to 1e-5 beyond the stop, or below it, anywhere in a step of any length.

    A miss by less than 1e-9 of the extent of the motion is a near graze.
    """
    rng = np.random.default_rng(17)
    made = (graze(rng) for _ in range(100 * count))
    found = [one for one, _ in zip(filter(None, made), range(count), strict=False)]
    values, top, a, height = (np.array(column) for column in zip(*found, strict=True))
    points = np.zeros(count, POINT)
    for name, column in zip(POINT.names, values.T, strict=True):
        points[name] = column
    phase, touches = points["omega"] * top, height > 0.0
    assert 0.3 < touches.mean() < 0.7
    h, omega, f, p, stop = (points[name] for name in ("h", "omega", "f", "p", "clearance"))
    extent = (f + p**2 * abs(stop)) / (omega**2 + 2.0 * h * omega + p**2)
    gap = -height / extent
    clear = abs(gap - 1e-9) > 1e-10  # to a tenth, the rounding of the start moves the highest point
    for share in (1, 2, 5, 20):
        steps = share * default_steps(points, "exact")
        out = integrate(points, steps_per_period=steps, transient=0, periods=1, impacts=500)
        assert (out["impacts_per_period"] < 500).all()
        with np.errstate(invalid="ignore"):  # NaN without an impact
            early = out["impact_phase"][:, 0] < phase + 0.01 * points["omega"]
        np.testing.assert_array_equal(early, touches)
        near = (gap > 0.0) & (gap < 1e-9)
        np.testing.assert_array_equal(out["near_grazes"][clear], near[clear])
        time = out["impact_phase"][touches, 0] / points["omega"][touches]
        half = np.sqrt(2.0 * height / np.abs(a), where=touches, out=np.zeros(count))[touches]
        np.testing.assert_allclose(top[touches] - time, half, rtol=0.05)
        speed = out["impact_v"][touches, 0]
        np.testing.assert_allclose(speed, half * np.abs(a[touches]), rtol=0.05)


@pytest.mark.parametrize("share", [0.0, 1e-9, 0.25, 0.5, 0.9, 1.0 - 1e-9])
@pytest.mark.parametrize("h", [0.0, 0.1, 0.7])
def test_every_near_graze_of_the_free_oscillation_is_counted(h, share):
    """One per period if it turns within 1e-9 of its extent below the stop, else none.

    It turns after this share of a step, whatever the number of steps. At 0 the end of the step is
    the turning point, to rounding.
    """
    for omega in (0.6, 0.8, 1.7, 2.0):
        X = -1.0 / complex(1.0 - omega**2, 2.0 * h * omega)
        extent = (1.0 + abs(X)) / (omega**2 + 2.0 * h * omega + 1.0)
        gaps = 1e-9 * extent * np.array([0.1, 0.5, 0.98, 1.02, 5.0])
        oscillators = [Oscillator(h, 0.8, omega, 1.0, clearance=abs(X) + gap) for gap in gaps]
        points = np.concatenate([osc.at(X.imag, omega * X.real) for osc in oscillators])
        for steps in (None, 27, 40, 64, 100, 400):
            begin = 0.5 * math.pi - cmath.phase(X) - (3.0 + share) * PERIOD / (steps or 40)
            how = {"steps_per_period": steps, "phase": begin % PERIOD}
            out = integrate(points, transient=0, periods=10, **how)
            np.testing.assert_array_equal(out["near_grazes"], [10, 10, 10, 0, 0])
            assert (out["impacts_per_period"] == 0.0).all()


def test_growth_without_bound_is_the_closed_form():
    """R = 1, h = 0, omega = 2: t = k pi, v = 4 k / 3."""
    osc = Oscillator(h=0.0, R=1.0, omega=2.0, f=1.0)
    tr = simulate(osc, 100)
    k = np.arange(1, len(tr.impact_t) + 1)
    assert len(k) >= 99
    np.testing.assert_allclose(tr.impact_t, k * math.pi, rtol=1e-13)
    np.testing.assert_allclose(tr.impact_v, 4 * k / 3, rtol=1e-12)
