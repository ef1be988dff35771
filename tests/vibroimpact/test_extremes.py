"""The least and the greatest displacement, against walks that share no code with the package."""

import math

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

from tests.helpers.kernel_cases import METHODS, integrated, random_points, steps_for, taken_apart
from tests.helpers.naive import ClosedForm
from tests.vibroimpact.test_repeats import in_pieces, mixed_points
from vibroimpact import Oscillator, Status, integrate, one_impact_orbits, periodic_orbit, simulate
from vibroimpact.step.scheme import default_steps

NAMES = "x_min", "x_max"


def turns_of_flight(osc, t, x, v, t_T):
    """Return x at the ends and at the turning points of a flight, from the closed form."""
    form = ClosedForm(osc, t, x, v)
    fastest = 2.0 * osc.h + osc.p + osc.omega
    grid = np.linspace(t, t_T, 20 + math.ceil((t_T - t) * fastest / 0.02))
    heights, slopes = form(grid)
    found = [x, heights[-1]]
    for i in np.flatnonzero((slopes[1:-1] < 0.0) != (slopes[2:] < 0.0)) + 1:
        found.append(form(brentq(lambda q: form(q)[1], grid[i], grid[i + 1], xtol=1e-14))[0])
    first = form(grid[1])
    if v * first[1] < 0.0:  # the first turn of a short flight
        found.append(form(brentq(lambda q: form(q)[1], t, grid[1], xtol=1e-300))[0])
    return found


def exact_extremes(osc, tr, x0, v0):
    """Return the extremes of a motion, from its impacts and rests and the closed form between."""
    later = tr.impact_t > 0.0
    starts = [(t, osc.clearance, -osc.R * v) for t, v in zip(tr.impact_t, tr.impact_v, strict=True)]
    if later.all() and not (len(tr.rests) and tr.rests[0, 0] == 0.0):
        starts.append((0.0, x0, v0))
    starts += [(end, osc.clearance, 0.0) for end in tr.rests[:, 1] if end < tr.t[-1]]
    events = np.sort(np.concatenate([tr.impact_t, tr.rests[:, 0], [tr.t[-1]]]))
    found = [x0] + [osc.clearance] * (len(tr.impact_t) + len(tr.rests) > 0)
    for t, x, v in starts:
        # An impact from which the mass does not rebound; the time of its rest is rounded anew.
        if (abs(t - tr.rests[:, 0]) <= 4.0 * np.spacing(t)).any():
            continue
        after = events[events > t]
        if len(after):
            found += turns_of_flight(osc, t, x, v, after[0])
    return min(found), min(max(found), osc.clearance)


def exact_points(count, seed):
    """Return random points at which the closed form of the test keeps its digits."""
    points, rng = random_points(count, seed), np.random.default_rng(seed)
    points["h"] = rng.uniform(0.0, 0.4, count) * rng.choice([1.0, 0.1], count)
    near = np.abs(points["omega"] - points["p"]) < 0.05
    points["omega"][near] += 0.1
    points["R"][::7] = 0.0  # motions that rest after every impact that presses them
    points["clearance"][3::5] = 30.0  # motions that meet no stop
    return points


def compare_with_walk(points, periods, share=1e-12):
    """Compare with the walk; return how many motions met the stop, and how many rested."""
    n, met, rested = default_steps(points, "exact"), 0, 0
    out = integrate(points, steps_per_period=n, transient=0, periods=periods, extremes=True)
    for i, point in enumerate(points):
        osc, x0, v0 = taken_apart(point)
        tr = simulate(osc, periods, steps_per_period=n, x0=x0, v0=v0)
        assert (out["x_min"][i], out["x_max"][i]) == (tr.x_min, tr.x_max)
        least, greatest = exact_extremes(osc, tr, x0, v0)
        size = max(greatest - least, abs(osc.clearance), 1e-300)
        assert abs(tr.x_min - least) <= share * size, point
        assert abs(tr.x_max - greatest) <= share * size, point
        if len(tr.impact_t) + len(tr.rests) > 0:
            assert tr.x_max == osc.clearance
        met, rested = met + (len(tr.impact_t) > 0), rested + (len(tr.rests) > 0)
    return met, rested


@pytest.mark.parametrize("count", [60, pytest.param(5000, marks=pytest.mark.campaign)])
def test_exact_motions_turn_where_the_closed_form_does(count):
    met, rested = compare_with_walk(exact_points(count, count), 6)
    assert met > 0.6 * count and rested > 0.1 * count


def test_a_motion_that_sticks_turns_where_its_flight_does():
    """The value is from 30 digits of the flight that follows the release at the phase 0."""
    osc = Oscillator(h=0.05, R=0.0, omega=1.56, f=1.0, p=1.3)
    assert compare_with_walk(osc.at(), 6) == (1, 1)
    x_min = integrate(osc.at(), transient=3, periods=6, extremes=True)["x_min"]
    assert x_min == pytest.approx(-0.786161452212077572, rel=1e-15)


def test_a_mass_at_rest_stays_at_the_stop():
    osc = Oscillator(h=0.1, R=0.5, omega=1.0, f=1.0, clearance=-2.0)
    out = integrate(osc.at(-2.0), transient=0, periods=2, extremes=True)
    assert out["rest_fraction"] == 1.0 and out["x_min"] == out["x_max"] == -2.0


def stepped_extremes(osc, tr, rule):
    """Return the extremes of the cubics between the rows of a trajectory by time steps."""
    least, greatest = tr.x.min(), tr.x.max()
    starts = set(tr.rests[:, 0])
    for k in range(len(tr.t) - 1):
        t, T = tr.t[k], tr.t[k + 1] - tr.t[k]
        if T <= 0.0 or any(begin <= t < end for begin, end in tr.rests):
            continue
        x, v = tr.x[k : k + 2], tr.v[k : k + 2]
        push = -osc.f * math.sin(osc.omega * t) - osc.p**2 * osc.clearance
        if tr.t[k + 1] in starts and k and x[0] == osc.clearance and 0.0 < -v[0] < push * T:
            turns = [osc.clearance - v[0] ** 2 / (2.0 * push)]
        else:
            cubic = CubicHermiteSpline([0.0, T], x, v)
            turns = cubic(cubic.derivative().roots(extrapolate=False))
        for turn in turns:
            least, greatest = min(least, turn), max(greatest, min(turn, osc.clearance))
    return least, greatest


@pytest.mark.parametrize(
    ("rule", "integrator"), [("plain", "rk4"), ("reduced-step", "newmark"), ("cubic", "rk4")]
)
def test_time_stepping_turns_where_its_cubics_do(rule, integrator):
    points = random_points(10, 8)
    out = integrated(points, integrator, rule, 40, periods=4, extremes=True)
    beyond = 0
    for i, point in enumerate(points):
        osc, x0, v0 = taken_apart(point)
        tr = simulate(osc, 4, integrator, rule, 40, x0, v0)
        assert (out["x_min"][i], out["x_max"][i]) == (tr.x_min, tr.x_max)
        least, greatest = stepped_extremes(osc, tr, rule)
        size = max(greatest - least, abs(osc.clearance), 1e-300)
        assert abs(tr.x_min - least) <= 1e-12 * size, point
        assert abs(tr.x_max - greatest) <= 1e-12 * size, point
        if tr.max_penetration > 0.0:
            beyond += 1
            assert tr.x_max - osc.clearance == tr.max_penetration
    assert (beyond > 3) == (rule == "plain")


@pytest.mark.parametrize(("integrator", "n", "transient"), [("rk4", 60, 0), ("verlet", 4, 1)])
def test_a_state_across_the_stop_is_seen(integrator, n, transient):
    """Also a fast step from before the stop to beyond it, and the state where the record begins."""
    points = random_points(1000, 1)
    points["f"] *= 1000.0
    method = {"impact": "plain", "integrator": integrator, "steps_per_period": n}
    out = integrate(points, transient=transient, periods=2, extremes=True, **method)
    beyond = out["max_penetration"] > 0.0
    greatest = (points["clearance"] + out["max_penetration"])[beyond]
    assert beyond.sum() > 500
    np.testing.assert_allclose(out["x_max"][beyond], greatest, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("h", [0.003, 0.03, 1.5])
def test_a_free_motion_is_watched_until_nothing_can_widen_its_reach(h):
    """Also near resonance, where it rises for long, and where it meets its stop late."""
    points = Oscillator(h=h, R=0.7, omega=1.0, f=1.0).at().repeat(60)
    points["omega"] = np.linspace(0.7, 1.6, 60)
    points["clearance"] = np.resize([0.8, 1.2, 3.0], 60) / (abs(1.0 - points["omega"]) + h)
    points["x0"] = np.resize([-0.3, 0.0, 0.2, -2.0], 60)
    n, periods = default_steps(points, "exact"), 40
    whole = integrate(points, transient=0, periods=periods, extremes=True, steps_per_period=n)
    free = whole["impacts_per_period"] == 0.0
    assert free.sum() > 10
    assert (~free).any() or h > 1.0
    pieces = in_pieces(points, 0, periods, 0, extremes=True, steps_per_period=n)
    for name in NAMES:
        np.testing.assert_array_equal(whole[name], pieces[name], err_msg=name)


def near_free_oscillations(count, seed):
    """Return motions that start by 1e-5 to 1e-17 of the amplitude off the free oscillation.

    Where the stop is as near, some meet it; where it is nearer, all do. Every fourth starts where
    it is just near, and soon is not, since x and v exchange their distances.
    """
    points, rng = exact_points(count, seed), np.random.default_rng(seed)
    points["h"] = rng.choice([0.003, 0.03, 0.3, 3.0], count)
    points["f"] = rng.uniform(0.5, 2.0, count)
    h, omega, p = points["h"], points["omega"], points["p"]
    response = -points["f"] / (p**2 - omega**2 + 2j * h * omega)
    off = 10.0 ** rng.uniform(-17.0, -5.0, count) * rng.choice([1.0, -1.0], count) * abs(response)
    of_x, of_v = rng.choice([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]], count).T
    off[::4], of_x[::4], of_v[::4] = 0.99 * 2.0**-27 * abs(response)[::4], 1.0, 1.0
    room = np.resize([1.0 + 1e-9, 1.0 + 1e-6, 1.0001, 1.0003, 3.0, 0.9], count)
    points["clearance"] = abs(response) * room
    points["x0"] = np.minimum(response.imag + off * of_x * omega / p, points["clearance"])
    points["v0"] = omega * (response.real + off * of_v)
    return points


def test_a_motion_near_its_free_oscillation_turns_where_the_closed_form_does():
    met, _ = compare_with_walk(near_free_oscillations(180, 7), 3, 1e-14)
    assert 20 < met < 60


def test_the_extremes_near_a_free_oscillation_do_not_depend_on_cuts_or_other_points():
    """While it comes near, and when only rounding is left."""
    points = near_free_oscillations(400, 4)
    points["h"][::5], points["omega"][::5] = 0.0, points["p"][::5]  # no free oscillation
    points["x0"][::5] = 0.0
    method = {"steps_per_period": default_steps(points, "exact"), "phase": 1.0, "extremes": True}
    whole = integrate(points, transient=0, periods=40, **method)
    pieces = in_pieces(points, 0, 40, 0, **method)
    reverse = integrate(points[::-1], transient=0, periods=40, **method)
    for name in NAMES:
        np.testing.assert_array_equal(whole[name], pieces[name], err_msg=name)
        np.testing.assert_array_equal(whole[name], reverse[name][::-1], err_msg=name)
    assert (whole["x_max"] >= whole["poincare_x"].max(axis=1)).all()
    assert (whole["x_min"] <= whole["poincare_x"].min(axis=1)).all()


def test_the_extremes_near_a_free_oscillation_include_sections_at_its_turns():
    """There rounding puts the turning point on one side of the section or on the other."""
    for seed in range(20):
        points, rng = near_free_oscillations(40, seed), np.random.default_rng(seed)
        for name in ("h", "omega", "p"):
            points[name] = points[name][0]
        h, omega, p = (points[name] for name in ("h", "omega", "p"))
        response = -points["f"] / (p**2 - omega**2 + 2j * h * omega)
        points["phase"] = phase = (
            rng.choice([0.5, 1.5]) * np.pi - np.angle(response[0])
        ) % math.tau
        turn, points["clearance"] = (response * np.exp(1j * phase)).imag, 4.0 * abs(response)
        points["x0"], points["v0"] = turn * (1.0 + 10.0 ** rng.uniform(-17.0, -9.0, 40)), 0.0
        method = {"steps_per_period": default_steps(points, "exact"), "phase": phase}
        out = integrate(points, transient=0, periods=20, extremes=True, **method)
        assert (out["x_max"] >= out["poincare_x"].max(axis=1)).all()
        assert (out["x_min"] <= out["poincare_x"].min(axis=1)).all()


@METHODS
def test_extremes_change_no_other_result(rule, integrator):
    points = mixed_points(100, 2)
    method = {"impact": rule, "integrator": integrator, "steps_per_period": steps_for(points, rule)}
    method |= {"transient": 10, "periods": 30, "lyapunov": rule == "exact"}
    without, out = integrate(points, **method), integrate(points, extremes=True, **method)
    assert set(out) - set(without) == set(NAMES)
    for name, values in without.items():
        np.testing.assert_array_equal(out[name], values, err_msg=name)


def test_what_fails_has_no_extremes():
    unstable = {"impact": "plain", "integrator": "euler", "steps_per_period": 1}
    slow = Oscillator(h=0.1, R=0.8, omega=0.05, f=1.0, clearance=1.0)
    out = integrate(slow.at(-1.0), transient=0, periods=400, extremes=True, **unstable)
    tr = simulate(slow, 400, **unstable, x0=-1.0)
    assert out["status"] == tr.status == Status.NON_FINITE
    assert np.isnan([out["x_min"][0], out["x_max"][0], tr.x_min, tr.x_max]).all()
    assert "x_min" not in integrate(slow.at(), transient=0, periods=1)


ORBITS = [
    (Oscillator(h=0.1, R=0.8, omega=2.7, f=1.0), 1),
    (Oscillator(h=0.0, R=0.7, omega=7.3, f=1.0, clearance=-0.002), 4),
    # From some starts, Newton's method for a turn leaves the flight by very many periods.
    (Oscillator(h=0.3, R=0.5747442432088077, omega=0.29093753635113206, f=1.0), 4),
]


def assert_as_wide_as_in_closed_form(orbit):
    osc = orbit.oscillator
    begin = orbit.phase / osc.omega
    end = begin + orbit.m * 2.0 * math.pi / osc.omega
    turns = turns_of_flight(osc, begin, osc.clearance, -osc.R * orbit.v, end)
    assert orbit.x_min == pytest.approx(min(turns), rel=1e-12, abs=1e-12 * orbit.v)
    if orbit.exists:
        assert orbit.x_max == osc.clearance
    else:  # its flight passes the stop
        assert orbit.x_max == pytest.approx(max(turns), rel=1e-12, abs=1e-12 * orbit.v)
        assert orbit.x_max > osc.clearance


@pytest.mark.parametrize(("osc", "n"), ORBITS)
def test_a_periodic_orbit_turns_where_the_closed_form_does(osc, n):
    """Stable or not, over one or several forcing periods, and with a fast natural vibration."""
    orbits = one_impact_orbits(osc, n)
    assert orbits
    for orbit in orbits:
        assert_as_wide_as_in_closed_form(orbit)


@pytest.mark.slow
def test_the_extremes_of_an_orbit_are_those_of_all_its_turns():
    """Of up to ninety in a flight, any may be the lowest, or beyond the stop the highest."""
    rng, passing = np.random.default_rng(3), 0
    for h, R, p, clearance, n in zip(
        rng.choice([0.0, 0.01, 0.05], 60), rng.uniform(0.3, 0.95, 60), rng.uniform(3.0, 30.0, 60),
        rng.choice([0.0, 0.01, 0.05], 60), rng.integers(1, 4, 60), strict=True,
    ):  # fmt: skip
        osc = Oscillator(h=h, R=R, omega=1.0, f=1.0, p=p, clearance=clearance)
        for orbit in one_impact_orbits(osc, int(n)):
            assert_as_wide_as_in_closed_form(orbit)
            passing += not orbit.exists
    assert passing > 10


def test_the_free_oscillation_turns_at_its_amplitude():
    osc = Oscillator(h=0.1, R=0.8, omega=1.3, f=1.0, clearance=3.0)
    orbit = periodic_orbit(osc, 0.0, 0.0)
    amplitude = 1.0 / math.hypot(1.0 - 1.3**2, 2.0 * 0.1 * 1.3)
    assert orbit.q == 0
    assert (orbit.x_min, orbit.x_max) == pytest.approx((-amplitude, amplitude), rel=1e-14)
