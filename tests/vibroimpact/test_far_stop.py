"""A stop so far from the rest position that x has few digits for the motion near it."""

from dataclasses import replace
from decimal import Decimal

import numpy as np
import pytest

from tests.helpers import naive
from tests.vibroimpact.test_destination import spec_of
from tests.vibroimpact.test_free_motions import found_of
from vibroimpact import Oscillator, Status, integrate, one_impact_orbits, simulate
from vibroimpact.oscillator import POINT, oscillator_of
from vibroimpact.points.computation import classified_later, compute_points
from vibroimpact.points.regimes import is_chaotic
from vibroimpact.status import Evidence
from vibroimpact.step.contact import with_near_stop
from vibroimpact.step.scheme import default_steps


def balls(p, R, gamma):
    """Return balls on a table with accelerations `gamma`, in units of gravity."""
    stop = -1.0 / p**2
    osc = Oscillator(h=0.0, R=R, omega=1.0, f=1.0, p=p, clearance=stop)
    points = osc.at(stop).repeat(len(gamma))
    points["f"], points["x0"] = gamma, stop - np.linspace(0.5, 3.0, len(gamma))
    return points


def test_chaos_that_rounding_makes_periodic_has_no_class():
    """At p = 1e-7, x is a multiple of 1/64 at the sections, and chaos comes back to the same."""
    gamma, periods = np.linspace(2.0, 20.0, 300), 512
    points = np.concatenate([balls(1e-7, R, gamma) for R in (0.4, 0.6, 0.65)])
    long = integrate(points, transient=500, periods=periods, lyapunov=True, impacts=0)
    chaotic = is_chaotic(long["lyapunov"], points["omega"], periods)  # some come to rest later
    last = integrate(points, transient=2000, periods=100, impacts=0)
    states = np.stack([last["poincare_x"], last["poincare_v"]], axis=2)
    came_back = (states[:, -65:-1] == states[:, -1:]).all(axis=2).any(axis=1)
    assert (chaotic & came_back & (last["chatters"] == 0)).sum() > 2
    out, _ = found_of(points, 2000, 100)
    chaotic &= out["rest_fraction"] == 0.0
    assert not out["period"][chaotic].any()
    assert (out["class_evidence"][chaotic] <= Evidence.UNSTABLE).all()
    assert (out["status"][chaotic] == Status.COMPUTED).all()


def test_a_motion_that_rests_only_repeats_as_it_does_with_more_digits():
    """At p = 1e-7 rounding at the sections makes many repeat; at p = 1e-3 x has eight digits more.

    Some balls move differently at p = 1e-3, or so that a rounding decides where they rest.
    """
    gamma = np.linspace(2.0, 12.0, 100)
    kinds = [
        np.concatenate([balls(p, R, gamma) for R in (0.1, 0.3, 0.4, 0.5)]) for p in (1e-3, 1e-7)
    ]
    fine, coarse = (found_of(points, 100, 70)[0] for points in kinds)
    known = (coarse["rest_fraction"] > 0.0) & (coarse["period"] > 0)
    assert known.sum() > 100
    assert (fine["period"] != coarse["period"])[known].mean() < 0.07


@pytest.mark.parametrize(("p", "status"), [(1e-3, 1), (1e-4, 1), (1e-5, 0), (1e-7, 0)])
def test_orbits_keep_their_class(p, status):
    """The ball jumps once a period, from beside its stable orbit on and from the unstable one."""
    osc = Oscillator(h=0.0, R=0.5, omega=1.0, f=1.3, p=p, clearance=-1.0 / p**2)
    unstable, stable = one_impact_orbits(osc)
    assert stable.stable and not unstable.stable
    x, v = stable.sections(0.0)[0]
    out, _ = found_of(osc.at(x - 0.1, v), 2000, 100)
    assert (out["period"], out["period_impacts"], out["status"]) == (1, 1, status)
    assert simulate(osc, 5, x0=x - 0.1, v0=v).status == status
    out, _ = found_of(osc.at(*unstable.sections(0.0)[0]), 0, 2)
    assert (out["period"], out["period_impacts"]) != (1, 1)


def random_points(n, seed):
    """Return points of random oscillators at p = 1 that start near the rest position."""
    rng, points = np.random.default_rng(seed), np.zeros(n, POINT)
    points["h"] = np.where(rng.uniform(size=n) < 0.2, 0.0, 10.0 ** rng.uniform(-3.0, 0.3, n))
    points["R"], points["omega"] = rng.uniform(size=n), 10.0 ** rng.uniform(-0.6, 0.8, n)
    points["f"], points["p"] = 10.0 ** rng.uniform(-1.0, 1.0, n), 1.0
    points["clearance"] = 10.0 ** rng.uniform(8.5, 15.0, n)
    points["x0"], points["v0"] = -rng.uniform(0.0, 2.0, n), rng.normal(size=n)
    points["phase"] = rng.uniform(0.0, 2.0 * np.pi, n)
    return points


@pytest.mark.parametrize(("transient", "n"), [(0, 50), (300, 100)])
def test_a_free_motion_keeps_all_digits_however_far_the_stop_is(transient, n):
    """It is the closed form, also its turning points, with the class that it has for any stop."""
    points, periods = random_points(n, transient), 20
    out = integrate(points, transient=transient, periods=periods, phase=0.5, extremes=True)
    assert (out["status"] == Status.CERTIFIED).all() and not out["impacts_per_period"].any()
    classes, _ = found_of(points, transient, periods, 0.5)
    settles = points["h"] > 0.0
    assert (classes["class_evidence"][settles] == Evidence.FREE).all()
    for i, point in enumerate(points):
        osc, lead = oscillator_of(point), (0.5 - point["phase"]) % (2.0 * np.pi)
        form = naive.ClosedForm(osc, point["phase"] / osc.omega, point["x0"], point["v0"])
        ends = transient + 1 + np.arange(periods)
        x, v = form(form.t0 + (lead + 2.0 * np.pi * ends) / osc.omega)
        size = max(abs(form.weights[2]), np.abs(x).max())
        np.testing.assert_allclose(out["poincare_x"][i], x, atol=1e-10 * size)
        np.testing.assert_allclose(out["poincare_v"][i], v, atol=1e-10 * size * (1.0 + osc.omega))
        span = transient + periods * np.linspace(0.0, 1.0, 12_001)
        dense, _ = form(form.t0 + (lead + 2.0 * np.pi * span) / osc.omega)
        reach = out["x_min"][i], out["x_max"][i]
        np.testing.assert_allclose(reach, (dense.min(), dense.max()), atol=1e-3 * size)
        if settles[i]:
            orbit = naive.ClosedForm(osc, 0.5 / osc.omega, x[-1], v[-1])
            steady = orbit.weights[2].real, (orbit.weights[2] * orbit.rates[2]).real
            off = np.abs(np.array((x[-1], v[-1])) - steady)
            sizes = size, max(osc.omega, 1.0) * size
            assert classes["orbit_distance"][i] >= 0.3 * (off / sizes).max() - 1e-10


@pytest.mark.parametrize(
    ("changed", "start"),
    [
        ({"h": 0.0, "omega": 1.0}, {}),  # resonance: no bound
        ({"h": 1e-14, "omega": 1.0}, {}),
        ({}, {"x0": -1e9}),  # the start has faded when the record begins
        ({}, {"v0": -1e9}),
    ],
)
def test_a_free_motion_without_digits_is_not_certified(changed, start):
    osc = replace(Oscillator(h=0.1, R=0.8, omega=2.3, f=1.0, clearance=1e13), **changed)
    out = integrate(osc.at(**start), transient=300, periods=20)
    assert out["status"] == Status.COMPUTED and not out["impacts_per_period"]
    assert simulate(osc, 20, transient=300, **start).status is Status.COMPUTED


def test_a_mass_without_force_stays_at_its_rest_position():
    osc = Oscillator(h=0.0, R=0.8, omega=1.4, f=0.0, clearance=1e15)
    out = integrate(osc.at(), transient=300, periods=20, extremes=True)
    assert out["status"] == Status.CERTIFIED
    assert not out["poincare_x"].any() and out["x_min"] == out["x_max"] == 0.0


def test_only_a_far_stop_moves():
    """A stop up to thousands of amplitudes away stays, and so does every bit of the motion."""
    points = random_points(500, 6)
    resistance = np.hypot(1.0 - points["omega"] ** 2, 2.0 * points["h"] * points["omega"])
    reach = points["f"] / resistance + np.abs(points["x0"]) + np.abs(points["v0"])
    for share in (-1e12, -1.0, 0.0, 1.0, 100.0, 8000.0):
        points["clearance"] = share * reach
        assert (with_near_stop(points, "exact") == points).all()
    points["clearance"] = 1e6 * reach
    assert (with_near_stop(points, "plain") == points).all()
    moved = with_near_stop(points, "exact")["clearance"]
    assert (moved >= 4.0 * reach).all() and (moved < 0.01 * points["clearance"]).all()


@pytest.mark.parametrize("rule", ["plain", "reduced-step", "cubic"])
def test_a_motion_by_time_steps_repeats_only_as_it_does_in_front_of_a_near_stop(rule):
    """It is still settling after 100 periods, and not after 3000; also without a force."""
    for f, transient, period in ((1.0, 100, 0), (1.0, 3000, 1), (0.0, 3000, 1)):
        for clearance in (2.0, 1e9, 1e15):
            osc = Oscillator(h=0.01, R=0.8, omega=2.3, f=f, clearance=clearance)
            spec = spec_of(osc.at(-0.5), rule, transient, 20, 0.5, "rk4", steps=100)
            out = compute_points(spec, osc.at(-0.5), None)
            assert (out["period"], out["period_impacts"]) == (period, 0)


def bound_of(point):
    """Return a bound of a free motion, in numbers that neither underflow nor overflow."""
    names = "h", "omega", "f", "p", "x0", "v0"
    h, omega, f, p, x0, v0 = (Decimal(float(point[name])) for name in names)
    amplitude = f / ((p * p - omega * omega) ** 2 + (2 * h * omega) ** 2).sqrt()
    return abs(x0) + abs(v0) / p + amplitude * (1 + max(1, omega / p))


def test_a_stop_moves_only_beyond_the_motion_in_any_units():
    """Squares of a frequency underflow or overflow; near resonance with hardly any damping, too."""
    rng, points = np.random.default_rng(11), random_points(2000, 11)
    rate = 10.0 ** rng.uniform(-200.0, 140.0, points.size)
    near = rng.uniform(size=points.size) < 0.3
    points["omega"][near] = 1.0 + 10.0 ** rng.uniform(-14.0, -1.0, near.sum())
    points["omega"] *= 10.0 ** np.where(rng.uniform(size=points.size) < 0.2, 160.0, 0.0)
    for name in ("h", "omega", "p", "v0"):
        points[name] *= rate
    points["f"] *= 10.0 ** rng.uniform(-300.0, 300.0, points.size)
    points["clearance"] = 10.0 ** rng.uniform(0.0, 300.0, points.size)
    moved = with_near_stop(points, "exact")["clearance"]
    rows = np.flatnonzero(moved != points["clearance"])
    assert rows.size > 500
    for row in rows:
        assert Decimal(float(moved[row])) > 2 * bound_of(points[row]), points[row]


@pytest.mark.parametrize(
    ("integrator", "impact"), [("exact", "exact"), ("rk4", "plain"), ("newmark", "reduced-step")]
)
def test_a_class_does_not_depend_on_how_a_run_is_divided(integrator, impact):
    """The start is far larger than the motion to which it fades, but not for each part of a run."""
    points = random_points(150, 12)
    points["h"], rng = np.clip(points["h"], 0.001, 0.4), np.random.default_rng(12)
    points["f"] = 10.0 ** rng.uniform(-14.0, 0.0, points.size)
    points["clearance"] = 10.0 ** rng.uniform(0.5, 14.0, points.size)
    steps = max(default_steps(points, impact), 60)
    spec = spec_of(points, impact, 0, 20, 0.5, integrator, longest=300, impacts=4, steps=steps)
    swept = compute_points(spec, points, None)
    names = ("period", "period_impacts", "orbit_x", "orbit_v", "orbit_distance", "class_evidence")
    for transient in np.unique(swept["transient"]).tolist():
        rows = np.flatnonzero(swept["transient"] == transient)
        whole = replace(spec, transient=transient, longest=None)
        bare = compute_points(replace(whole, period=False), points[rows], None)
        once = compute_points(whole, points[rows], None)
        later = classified_later(whole, points[rows], bare)
        for name in names:
            np.testing.assert_array_equal(once[name], swept[name][rows], err_msg=name)
            np.testing.assert_array_equal(later[name], once[name], err_msg=name)


def resting_points(n, seed, low, high):
    """Return points on preloaded stops between 10^low and 10^high away, which the force leaves."""
    rng, points = np.random.default_rng(seed), random_points(n, seed)
    points["R"] = rng.uniform(0.0, 0.7, n)
    points["clearance"] = -(10.0 ** rng.uniform(low, high, n))
    points["p"] = np.sqrt(points["f"] * rng.uniform(0.05, 0.98, n) / -points["clearance"])
    points["x0"] = points["clearance"] - rng.uniform(0.0, 1.0, n)
    return points


@pytest.mark.parametrize("transient", [0, 100])
def test_a_moving_mass_with_few_digits_is_not_certified_because_it_rests(transient):
    points = resting_points(100, 7, 9.5, 15.0)
    out = integrate(points, transient=transient, periods=12, extremes=True)
    height = points["clearance"] - out["x_min"]
    few = height < 1e8 * 0.5 * np.spacing(-points["clearance"])
    few &= (out["rest_fraction"] > 0.0) & (out["rest_fraction"] < 1.0)
    assert few.sum() > 60
    assert (out["status"][few] == Status.COMPUTED).all()
    for i in np.flatnonzero(few)[:10]:
        start = {name: float(points[name][i]) for name in ("x0", "v0", "phase")}
        tr = simulate(oscillator_of(points[i]), 12, transient=transient, **start)
        assert len(tr.rests) and tr.status is Status.COMPUTED


def test_a_mass_that_is_held_keeps_its_digits():
    points = resting_points(100, 8, 9.5, 15.0)
    points["f"] *= 0.04
    for transient in (100, 0):
        out = integrate(points, transient=transient, periods=12)
        assert (out["rest_fraction"] > 1.0 - 1e-12).all()
        assert (out["status"] == Status.CERTIFIED).all()
        points["x0"], points["v0"] = points["clearance"], 0.0
    assert simulate(oscillator_of(points[0]), 9, x0=points["x0"][0]).status is Status.CERTIFIED


@pytest.mark.parametrize("f", [0.0, 0.5])
def test_a_mass_that_lands_before_the_first_section_is_certified(f):
    """It is held at every section."""
    osc = Oscillator(h=0.1, R=0.2, omega=0.5, f=f, clearance=-1.0)
    out = integrate(osc.at(-1.001), transient=0, periods=5)
    assert (out["poincare_x"] == -1.0).all() and 0.9 < out["rest_fraction"] < 1.0
    assert out["status"] == simulate(osc, 5, x0=-1.001).status == Status.CERTIFIED


def test_a_rest_near_the_rest_position_is_certified():
    points = resting_points(500, 9, -2.0, 2.0)
    out = integrate(points, transient=100, periods=12)
    assert (out["rest_fraction"] > 0.0).sum() > 350
    assert (out["status"] == Status.CERTIFIED).all()


@pytest.mark.parametrize(("p", "status"), [(1.0, 1), (1e-2, 1), (1e-4, 0)])
def test_a_force_that_barely_exceeds_a_preload_makes_a_small_motion(p, status):
    """Over 1 % it lifts the mass by 4.5e-4 f / omega^2, not by f / omega^2."""
    osc = Oscillator(h=0.0, R=0.0, omega=1.0, f=1.01, p=p, clearance=-1.0 / p**2)
    out = integrate(osc.at(osc.clearance), transient=10, periods=5, extremes=True)
    height = osc.clearance - out["x_min"][0]
    assert 0.5 < out["rest_fraction"][0] < 1.0 and height < 1e-3
    assert (height > 1e8 * 0.5 * np.spacing(-osc.clearance)) == status
    assert out["status"] == status
    assert simulate(osc, 5, x0=osc.clearance).status == status


@pytest.mark.parametrize(("f", "right"), [(1e-298, True), (1e-306, False), (1e-307, False)])
def test_a_motion_near_the_smallest_numbers_is_not_certified(f, right):
    """At 1e-306 of f it has 9 digits, and at 1e-307 it had no impact."""
    osc = Oscillator(h=0.1, R=0.5, omega=2.0, f=f)
    out, tr = integrate(osc.at(), transient=5, periods=5), simulate(osc, 10)
    assert out["status"] == tr.status == (Status.CERTIFIED if right else Status.COMPUTED)
