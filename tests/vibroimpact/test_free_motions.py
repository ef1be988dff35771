"""Motions that have no impact any more: whether one has is decided exactly."""

import math

import numpy as np
import pytest

from tests.helpers import naive
from tests.vibroimpact.test_destination import spec_of
from vibroimpact import integrate
from vibroimpact.destination.free_motion import first_within
from vibroimpact.oscillator import POINT
from vibroimpact.points.computation import compute_points
from vibroimpact.status import Evidence


def found_of(points, transient, periods, phase=0.0):
    """Return the results of points with their classes, and the steps per period."""
    spec = spec_of(points, "exact", transient, periods, phase)
    return compute_points(spec, points, None), spec.steps_per_period


def weakly_damped(n, low, high, seed):
    """Return points whose free oscillation has 1/2 to .99 of the clearance as amplitude."""
    rng, points = np.random.default_rng(seed), np.zeros(n, POINT)
    points["h"], points["R"] = 10.0 ** rng.uniform(low, high, n), rng.uniform(0.0, 1.0, n)
    points["omega"], points["p"] = rng.uniform(0.2, 6.0, n), rng.uniform(0.5, 2.0, n)
    points["f"] = rng.uniform(0.2, 2.0, n)
    h, omega, f, p = (points[name] for name in ("h", "omega", "f", "p"))
    amplitude = f / np.hypot(p**2 - omega**2, 2.0 * h * omega)
    points["clearance"] = amplitude * rng.uniform(1.01, 2.0, n)
    points["x0"] = points["clearance"] - amplitude * rng.uniform(0.0, 2.0, n)
    points["v0"] = rng.normal(size=n) * amplitude * points["omega"]
    return points


def greatest_x(point, phase, x, v):
    """Return the greatest x of a flight from a section, without a stop, by dense sampling."""
    osc = naive.oscillator(*(float(point[name]) for name in ("h", "R", "omega", "f", "p")))
    form = naive.ClosedForm(osc, phase / osc.omega, x, v)
    amplitude, wave = abs(form.weights[2]), np.abs(form.weights[:2]).sum()
    spacing, greatest, t = 2.0 * math.pi / (osc.omega + osc.p) / 60.0, -math.inf, form.t0
    while amplitude + wave * math.exp(-osc.h * (t - form.t0)) > max(greatest, point["clearance"]):
        now, speed = form(t + spacing * np.arange(20_001))
        t += 20_000 * spacing
        k = int(now.argmax())  # a parabola about the highest sample
        bend = np.gradient(speed, spacing)[k]
        rate = speed[k] if k else max(speed[k], 0.0)  # a turn before the flight is none of it
        greatest = max(greatest, now[k] - 0.5 * min(rate**2 / bend, 0.0))
        if greatest > point["clearance"]:
            break
    return greatest


@pytest.mark.parametrize(("transient", "phase"), [(0, 0.0), (40, 2.0), (1000, 5.0)])
def test_a_class_without_impacts_is_given_where_no_impact_follows(transient, phase):
    points = weakly_damped(80, -3.3, -1.0, transient)
    points["h"][:10] = 1.5 * points["p"][:10]  # does not oscillate
    out, _ = found_of(points, transient, 33, phase)
    last = [out[f"poincare_{name}"][:, -1] for name in "xv"]
    highest = np.array([greatest_x(*row) for row in zip(points, [phase] * 80, *last, strict=True)])
    stays = highest < points["clearance"]
    assert np.abs(highest / points["clearance"] - 1.0).min() > 1e-7  # else sampling may be wrong
    assert 16 < stays.sum() < 64
    free = (out["period"] == 1) & (out["period_impacts"] == 0)
    np.testing.assert_array_equal(free, stays)
    assert (out["class_evidence"][free] == Evidence.FREE).all()


def test_a_heavily_damped_motion_is_free_long_before_it_has_settled():
    """It falls by exp(-p^2 t / 2 h); the bound of oscillating motions takes too long to show it."""
    points = np.zeros(4, POINT)
    points["h"], points["omega"], points["R"] = [50.0, 100.0, 200.0, 400.0], 300.0, 0.8
    points["f"], points["p"], points["clearance"] = 1.0, 1.0, 1.5
    points["x0"], points["v0"] = 1.2, 1000.0
    assert (found_of(points, 1000, 33)[0]["class_evidence"] == Evidence.FREE).all()


def test_motions_damped_over_a_hundred_thousand_periods():
    """Those with the class 1/0 meet the stop no more, and some others do after a long time."""
    points, transient, phase = weakly_damped(200, -6.0, -3.5, 3), 300, 1.0
    out, steps = found_of(points, transient, 33, phase)
    for name in "xv":
        points[f"{name}0"] = out[f"poincare_{name}"][:, -1]
    how = {"steps_per_period": steps, "phase": phase, "at_section": True, "impacts": 0}
    later = integrate(points, transient=0, periods=20_000, **how)
    free = (out["period"] == 1) & (out["period_impacts"] == 0)
    assert free.sum() > 15 and (out["class_evidence"][free] == Evidence.FREE).all()
    assert not later["impacts_per_period"][free].any()
    assert later["impacts_per_period"][out["class_evidence"] <= Evidence.UNREACHED].all()


def test_a_motion_that_keeps_meeting_the_stop_is_not_free():
    """A beat of the weakly damped transient leads to the stop again and again."""
    point = np.zeros(1, POINT)
    point["h"], point["R"], point["omega"] = 2.0585597301148978e-05, 0.0, 4.989606812339067
    point["f"], point["p"] = 0.7275900561147289, 1.226172184144561
    point["clearance"], point["a"] = 0.06851556136636196, 0.029224972219523544
    point["phase"] = 5.850149461978729
    out, _ = found_of(point, 1000, 33, 1.1375526169090153)
    assert out["period"] == 0 and out["class_evidence"] == Evidence.UNREACHED


def test_the_first_multiple_within_an_interval():
    rng, stack = np.random.default_rng(2), np.zeros((64, 4))
    for _ in range(2000):
        step = rng.random() if rng.random() < 0.5 else rng.integers(1, 9) / rng.integers(1, 9)
        step += rng.choice([0.0, 1e-3, -1e-4]) * rng.random()
        start, half = rng.uniform(-3.0, 3.0), 10.0 ** rng.uniform(-3.5, -0.2)
        turns = start + step * np.arange(4000)
        hits = np.flatnonzero(np.abs(turns - np.rint(turns)) <= half)
        found = first_within(start, step, half, stack)
        assert found == hits[0] if hits.size else found >= 4000


@pytest.mark.parametrize("clearance", [0.5, 0.2])
def test_the_free_oscillation_is_the_same_in_any_unit_of_time(clearance):
    """Its squares would overflow or lose all digits; then its amplitude was 0, the class 1/0."""
    out = []
    for time in (1.0, 2.0**-330, 2.0**330):  # a power of two keeps all bits
        points = np.zeros(1, POINT)
        for name, value in (("h", 0.1), ("R", 0.8), ("omega", 2.0), ("p", 1.0), ("f", 0.9)):
            points[name] = value / (time**2 if name == "f" else 1.0 if name == "R" else time)
        points["clearance"] = clearance
        found, _ = found_of(points, 300, 8)
        out.append([found["period"], found["period_impacts"], found["class_evidence"],
                    found["orbit_x"], found["orbit_v"] * time])  # fmt: skip
    np.testing.assert_allclose(out[1], out[0], rtol=1e-14)
    np.testing.assert_allclose(out[2], out[0], rtol=1e-14)
    assert (out[0][1] == 0) == (clearance > 0.3)  # its amplitude
