"""The exact rule at random points and at touches of a chosen depth, and the tail of a chatter."""

import math

import mpmath as mp
import naive
import numpy as np
import pytest

from vibroimpact import Oscillator, Status, integrate, simulate
from vibroimpact.oscillator import POINT
from vibroimpact.step.chatter import time_to_rest

PERIOD = 2.0 * math.pi


# --- random points ---


def random_points(n, seed):
    """Points all over the domain, omega / p evenly spread in its logarithm."""
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


@pytest.mark.slow
def test_random_points_end_decided():
    """2000 points, 50 periods: no NaN, nothing beyond the stop, a status that says what it is."""
    points = random_points(2000, 17)
    for part in np.array_split(points, 10):
        out = integrate(part, transient=0, periods=50, lyapunov=True)
        for name in ("poincare_x", "poincare_v", "impacts_per_period", "rest_fraction"):
            assert np.isfinite(out[name]).all()
        assert not np.isnan(out["lyapunov"]).any()
        assert (out["max_penetration"] <= 1e-12).all()
        assert (out["poincare_x"] <= part["clearance"][:, None]).all()
        assert ((out["rest_fraction"] >= 0.0) & (out["rest_fraction"] <= 1.0 + 1e-12)).all()
        decided = (Status.CERTIFIED, Status.SETTLED, Status.UNBOUNDED)
        assert np.isin(out["status"], decided).all()
        assert (part["R"][out["status"] == Status.SETTLED] > 0.99).all()
        assert not (out["status"] == Status.UNBOUNDED).any()


@pytest.mark.parametrize(
    "every",
    [pytest.param(240, marks=pytest.mark.slow), pytest.param(1, marks=pytest.mark.campaign)],
)
def test_random_points_are_those_of_the_slow_solver(every):
    """2000 points, or 25 of them: sections, impacts and rests to 1e-9.

    50 periods or 500 impacts, chatters included, while a rounding stays below 1e-11; from a graze
    within 1e-6 on, none is compared.
    """
    points = random_points(2000, 23)[::every]
    grazed, lost, sections, impacts, rested = 0, 0, 0, 0, 0
    for point in points:
        given = {name: float(point[name]) for name in POINT.names}
        x0, v0 = given.pop("x0"), given.pop("v0")
        slow = naive.ExactOrbit(naive.oscillator(**given), 50, x0, v0, most=500)
        tr = simulate(Oscillator(**given), 50, x0=x0, v0=v0)
        period = PERIOD / given["omega"]
        known = np.array(slow.sections).reshape(-1, 3)
        bad = np.flatnonzero(known[:, 2] > 1e-11)
        end = min(slow.graze, slow.reached, (bad[0] if bad.size else 50) * period) * (1 + 1e-13)
        grazed += slow.graze < slow.reached
        lost += bad.size > 0
        compared = int((np.arange(1, len(known) + 1) * period <= end).sum())
        ours = np.column_stack([tr.section_x, tr.section_v])
        np.testing.assert_allclose(ours[:compared], known[:compared, :2], atol=1e-9)
        hits = np.array(slow.impacts).reshape(-1, 3)
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
    print(f"{grazed} graze, {lost} lose their digits of {len(points)};",
          f"{sections} sections, {impacts} impacts, {rested} rests")  # fmt: skip
    assert 10 * (grazed + lost) < len(points)
    assert sections > 5 * len(points) and impacts > 10 * len(points) and rested > len(points)


# --- touches of a chosen depth ---


def free_flight(osc, x0, t):
    """x at time t of the free flight from (x0, 0), h < p, to the digits of mpmath."""
    h, p, w, x0 = mp.mpf(osc.h), mp.mpf(osc.p), mp.mpf(osc.omega), mp.mpf(x0)
    root = mp.sqrt(p * p - h * h)
    steady = -mp.mpf(osc.f) / (p * p - w * w + 2j * h * w)
    x, v = x0 - steady.imag, -(1j * w * steady).imag
    free = mp.exp(-h * t) * (x * mp.cos(root * t) + (v + h * x) / root * mp.sin(root * t))
    return free + (steady * mp.exp(1j * w * t)).imag


def first_top(osc, x0, guess):
    """Time, height and -x'' of the maximum of the free flight nearest to a guess."""
    t = mp.findroot(lambda q: mp.diff(lambda s: free_flight(osc, x0, s), q), guess)
    return t, free_flight(osc, x0, t), -mp.diff(lambda s: free_flight(osc, x0, s), t, 2)


# h, omega, x0: in the first two the top lies 0.45 steps of 100 from the next grid point.
FAMILIES = [(0.1, 0.5, -1.5), (0.05, 0.8, -2.5), (0.3, 0.9, -0.7), (0.02, 0.55, -3.0)]


def guess_top(osc, x0):
    """The first maximum on a coarse grid."""
    grid = np.linspace(0.05, osc.forcing_period * 0.95, 400)
    x = np.array([float(free_flight(osc, x0, q)) for q in grid])
    top = np.flatnonzero((x[1:-1] > x[:-2]) & (x[1:-1] > x[2:]))[0] + 1
    assert x[top] > x0
    return grid[top]


@pytest.mark.parametrize(("h", "omega", "x0"), FAMILIES)
def test_every_touch_deeper_than_rounding_is_found(h, omega, x0):
    """The stop `depth` below the top of the first flight: an impact with its time and speed.

    At -1e-13 and above the top there is none. The depth of the rounded stop is known exactly.
    """
    with mp.workdps(40):
        free = Oscillator(h=h, R=0.8, omega=omega, f=1.0)
        top, height, a = first_top(free, x0, guess_top(free, x0))
        scale = max(1.0, abs(float(height)), abs(x0))
        for exponent in np.arange(2.0, 13.01):
            for sign in (1, -1):
                stop = float(height - sign * mp.mpf(10) ** -mp.mpf(exponent) * scale)
                osc = Oscillator(h=h, R=0.8, omega=omega, f=1.0, clearance=stop)
                for n in (None, 57, 200):
                    tr = simulate(osc, 1, steps_per_period=n, x0=x0)
                    early = tr.impact_t < float(top) + 1e-6
                    assert tr.status is Status.CERTIFIED
                    assert early.sum() == (sign > 0), (exponent, sign, n)
                    if sign < 0:
                        continue
                    depth = height - mp.mpf(stop)
                    before = mp.sqrt(2 * depth / a)
                    t = mp.findroot(
                        lambda q, at=stop: free_flight(free, x0, q) - at,
                        (top - 1.5 * before, top),
                        solver="anderson",
                        tol=1e-60,
                    )
                    v = mp.diff(lambda s: free_flight(free, x0, s), t)
                    assert 0 < v and t < top
                    rounding = 3e-15 * scale * max(1.0, (n or 0) / 32)
                    assert abs(tr.impact_t[0] - t) <= rounding + rounding / v
                    assert abs(tr.impact_v[0] - v) <= rounding + float(a) * rounding / v


@pytest.mark.parametrize(("h", "omega", "x0"), FAMILIES)
def test_runge_kutta_with_the_reduced_step_misses_what_lies_between_grid_points(h, omega, x0):
    """At 100 steps a touch is seen from the depth a d^2 / 2 on, d from the top to the next point.

    That is |a| T^2 / 8 in the worst case: from there on all are seen. The first two families
    are near it, and miss all that is below 0.79 of it.
    """
    free = Oscillator(h=h, R=0.8, omega=omega, f=1.0)
    top, height, a = map(float, first_top(free, x0, guess_top(free, x0)))
    T = free.forcing_period / 100
    d = abs(top / T - round(top / T)) * T
    from_depth, worst = a * d * d / 2, a * T * T / 8
    assert 1e-6 < from_depth <= worst
    assert from_depth > 0.79 * worst or h > 0.1 or omega == 0.55

    def sees(depth, method):
        osc = Oscillator(h=h, R=0.8, omega=omega, f=1.0, clearance=height - depth)
        tr = simulate(osc, 1, *method, x0=x0)
        return bool((tr.impact_t < top + T).any())

    scheme = ("rk4", "reduced-step", 100)
    for factor in (1.1, 2.0, 10.0):
        assert sees(factor * from_depth, scheme)
    for factor in (0.9, 0.5, 0.1, 1e-3, 1e-6):
        assert not sees(factor * from_depth, scheme)
        assert sees(max(factor * from_depth, 1e-13), ("exact", "exact", None))
        assert sees(max(factor * from_depth, 1e-13), ("exact", "exact", 100))
    assert sees(1.05 * worst, scheme)


# --- the tail of a chatter ---


def horner(c, q):
    """sum_k c[k] q^k."""
    total = mp.mpf(0)
    for coefficient in reversed(c):
        total = total * q + coefficient
    return total


def brute_force(osc, theta, v, dps=40):
    """Time to the end of a chatter, flight by flight down to 1e-20 of the speed, in mpmath."""
    with mp.workdps(dps):
        h2, pp, w, f = 2 * mp.mpf(osc.h), mp.mpf(osc.p) ** 2, mp.mpf(osc.omega), mp.mpf(osc.f)
        load, t, speed = pp * mp.mpf(osc.clearance), mp.mpf(0), mp.mpf(v)
        while speed > mp.mpf(10) ** -20 * mp.mpf(v):
            c = [mp.mpf(0), -speed]
            wave = f * mp.expj(mp.mpf(theta) + w * t)
            for k in range(12):
                pull = h2 * (k + 1) * c[k + 1] + pp * c[k] + wave.imag + (load if k == 0 else 0)
                c.append(-pull / ((k + 1) * (k + 2)))
                wave *= 1j * w / (k + 1)
            flight = mp.findroot(lambda q, c=c: horner(c[1:], q), -c[1] / c[2])
            slope = horner([k * c[k] for k in range(1, len(c))], flight)
            t, speed = t + flight, mp.mpf(osc.R) * slope
        return t


@pytest.mark.slow
@pytest.mark.parametrize("R", [0.0, 0.3, 0.8])
@pytest.mark.parametrize(
    ("h", "omega", "clearance", "theta"),
    [(0.0, 0.3, 0.0, 4.0), (0.5, 1.0, 0.0, 5.5), (2.0, 3.0, -0.4, 3.6), (0.1, 10.0, 0.2, 4.4)],
)
def test_the_tail_of_a_chatter_is_the_sum_of_its_flights(R, h, omega, clearance, theta):
    """Where the sum is taken it is right to 2e-10 of itself, and 1e-15 of the times around it."""
    osc = Oscillator(h=h, R=R, omega=omega, f=1.0, clearance=clearance)
    pt = osc.at(min(0.0, clearance))[0]
    taken = 0
    for v in 10.0 ** np.arange(-9.0, -2.0):
        tail, status = time_to_rest(v, theta, math.sin(theta), math.cos(theta), math.inf, pt)
        assert status == Status.CERTIFIED
        if tail < math.inf:
            true = brute_force(osc, theta, v)
            assert abs(tail - true) <= 5e-10 * true
            assert abs(tail - true) <= 2e-15 * min(1.0, 1.0 / omega)
            taken += 1
    assert taken >= 2
    s, c = math.sin(theta), math.cos(theta)
    assert time_to_rest(0.0, theta, s, c, 1.0, pt)[0] == 0.0
    assert time_to_rest(1e-9, theta - math.pi, -s, -c, 1.0, pt)[0] == math.inf


# --- growth, company, rest ---


def test_growth_without_bound_is_said_and_disturbs_nobody():
    """R = 1, h = 0, omega = 2: t = k pi, v = 4 k / 3; the neighbours keep every bit."""
    osc = Oscillator(h=0.0, R=1.0, omega=2.0, f=1.0)
    tr = simulate(osc, 100)
    k = np.arange(1, len(tr.impact_t) + 1)
    assert len(k) >= 99
    np.testing.assert_allclose(tr.impact_t, k * math.pi, rtol=1e-13)
    np.testing.assert_allclose(tr.impact_v, 4 * k / 3, rtol=1e-12)
    points = random_points(70, 3)
    points["omega"] = np.random.default_rng(0).uniform(0.5, 5.0, 70)
    mixed = points.copy()
    grows = np.zeros(70, dtype=bool)
    grows[[0, 13, 34, 69]] = True
    mixed[grows] = osc.at()[0]
    arguments = {"steps_per_period": 110, "transient": 5, "periods": 60, "lyapunov": True}
    out, clean = integrate(mixed, **arguments), integrate(points[~grows], **arguments)
    assert (out["status"][grows] == Status.UNBOUNDED).all()
    assert not (out["status"][~grows] == Status.UNBOUNDED).any()
    for name in clean:
        np.testing.assert_array_equal(out[name][~grows], clean[name])
