"""Many points at once: lanes and single orbits, records, overflows, rests, what is refused."""

import math

import numpy as np
import pytest

from tests.helpers.kernel_cases import (
    DONE,
    METHODS,
    PERIOD,
    assert_same,
    integrated,
    one,
    random_points,
    steps_for,
    taken_apart,
    wide_points,
)
from vibroimpact import Oscillator, Status, integrate, simulate
from vibroimpact.kernel.lane import move_lane
from vibroimpact.kernel.threads import aligned, new_workspace
from vibroimpact.kernel.workspace import COEFFICIENTS, LANES, ROW
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.polynomial import LONGEST_STEP
from vibroimpact.step.recorder import trajectories
from vibroimpact.step.scheme import default_steps, scheme_of


def assert_as_alone(points, integrator, rule, n):
    """Six periods record what `simulate` finds; return how many points had impacts and rests."""
    periods, met, rested = 6, 0, 0
    out = integrated(points, integrator, rule, n, periods=periods, impacts=12)
    for i, point in enumerate(points):
        osc, x0, v0 = taken_apart(point)
        tr = simulate(osc, periods, integrator, rule, n, x0, v0)
        np.testing.assert_array_equal(out["poincare_x"][i], tr.section_x)
        np.testing.assert_array_equal(out["poincare_v"][i], tr.section_v)
        # `simulate` does not detect growth.
        unbounded = out["status"][i] == Status.UNBOUNDED and osc.R == 1.0 and osc.h == 0.0
        assert unbounded or out["status"][i] == tr.status
        assert tr.status in ((DONE[rule], Status.CUT_SHORT) if rule == "exact" else (DONE[rule],))
        # The record counts impacts during steps; the start belongs to no step.
        later = tr.impact_t > 0.0
        speeds = np.full(12, np.nan)
        speeds[: min(12, later.sum())] = tr.impact_v[later][-12:]
        np.testing.assert_array_equal(out["impact_v"][i], speeds)
        assert out["impacts_per_period"][i] * periods == pytest.approx(later.sum(), rel=1e-14)
        assert out["max_penetration"][i] == tr.max_penetration
        lengths = np.minimum(tr.rests[:, 1], tr.t[-1]) - tr.rests[:, 0]
        fraction = lengths.sum() / (periods * osc.forcing_period)
        assert out["rest_fraction"][i] == pytest.approx(fraction, abs=1e-11)
        met += later.any()
        rested += len(tr.rests) > 0
    return met, rested


def test_a_lane_is_the_single_orbit_bit_for_bit(rule, integrator):
    points = random_points(36)
    met, rested = assert_as_alone(points, integrator, rule, steps_for(points, rule))
    assert met > 24
    assert (rested > 4) == (rule != "plain")


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_rest_after_the_first_impact_of_a_stride_is_the_single_orbits(integrator):
    """A small R: the chatter is complete within the step in which it begins, or not quite."""
    omegas = np.linspace(0.5, 2.0, 30)
    points = np.concatenate([one(0.1, R, omega) for R in (0.0, 0.01) for omega in omegas])
    _, rested = assert_as_alone(points, integrator, "reduced-step", 50)
    assert rested > 20


@pytest.mark.parametrize("n", [64, 65])
def test_lanes_whose_forces_are_kept_or_computed_step_by_step(n):
    """The most steps per period with a stored force, and one more: lanes equal single orbits."""
    points = random_points(30, seed=3)
    points["omega"] += 1.0
    arguments = {"steps_per_period": n, "phase": 1.0}
    out = integrate(points, transient=2, periods=2, at_section=True, **arguments)
    for i, point in enumerate(points):
        osc, x0, v0 = taken_apart(point)
        tr = simulate(osc, 4, x0=x0, v0=v0, **arguments)
        np.testing.assert_array_equal(out["poincare_x"][i], tr.section_x[-2:])
        np.testing.assert_array_equal(out["poincare_v"][i], tr.section_v[-2:])


@METHODS
def test_any_company_leaves_a_lane_as_it_is(rule, integrator):
    """Sub-batches of every remainder, another order, one thread or two: the same bits."""
    points = random_points(3 * LANES + 7)
    method = {"integrator": integrator, "impact": rule, "lyapunov": rule == "exact"}
    record = {"transient": 2, "periods": 4, "impacts": 5, "extremes": True}
    arguments = method | record | {"steps_per_period": steps_for(points, rule)}
    whole = integrate(points, **arguments)
    for n in (0, 1, 2, LANES - 1, LANES, LANES + 1, 2 * LANES + 5):
        for lo in (0, 3):
            part = integrate(points[lo : lo + n], **arguments)
            assert_same(part, {name: values[lo : lo + n] for name, values in whole.items()})
    order = np.random.default_rng(0).permutation(points.size)
    shuffled = integrate(points[order], **arguments)
    assert_same(shuffled, {name: values[order] for name, values in whole.items()})
    for threads in (1, 2):
        assert_same(integrate(points, threads=threads, **arguments), whole)


def test_the_last_impacts_are_kept_in_time_order():
    point = one(0.5, 0.5, 1.0)
    tr = simulate(Oscillator(h=0.5, R=0.5, omega=1.0, f=1.0), 5)
    total = len(tr.impact_t)
    assert 10 < total < 64
    for width in (0, 1, 3, 7, 64):
        out = integrate(point, transient=0, periods=5, impacts=width)
        kept = min(width, total)
        assert out["impact_v"].shape == out["impact_phase"].shape == (1, width)
        np.testing.assert_array_equal(out["impact_v"][0, :kept], tr.impact_v[total - kept :])
        phases = tr.impact_t[total - kept :] % PERIOD
        np.testing.assert_allclose(out["impact_phase"][0, :kept], phases, atol=1e-12)
        assert np.isnan(out["impact_v"][0, kept:]).all()
        assert np.isnan(out["impact_phase"][0, kept:]).all()
        assert out["impacts_per_period"] == total / 5


@pytest.mark.parametrize("phase", [0.0, 1.0, 6.28])
def test_a_section_at_any_phase_is_the_closed_form(phase):
    """omega = 20, h = 0: the flight of ten periods is f (sin wt - w sin t) / (w^2 - 1)."""
    w = 20.0
    out = integrate(one(0.0, 0.5, w), steps_per_period=30, transient=2, periods=5, phase=phase)
    t = (phase + PERIOD * np.arange(3, 8)) / w
    assert t[-1] < 3.0
    x = (np.sin(w * t) - w * np.sin(t)) / (w * w - 1)
    v = w * (np.cos(w * t) - np.cos(t)) / (w * w - 1)
    np.testing.assert_allclose(out["poincare_x"][0], x, atol=1e-14)
    np.testing.assert_allclose(out["poincare_v"][0], v, atol=1e-13)


@METHODS
@pytest.mark.parametrize("k", [16, 48])
def test_a_section_on_a_grid_point_is_the_state_there(rule, integrator, k):
    """Phase 2 pi k / 64: the grid states of `simulate`, though the table of sines is another."""
    osc = Oscillator(h=0.1, R=0.7, omega=2.3, f=1.0)
    tr = simulate(osc, 7, integrator, rule, 64)
    out = integrated(osc.at(), integrator, rule, 64, transient=1, periods=4, phase=PERIOD * k / 64)
    t = (PERIOD * k / 64 + PERIOD * np.arange(2, 6)) / osc.omega
    at = [np.flatnonzero(np.abs(tr.t - q) < 1e-9)[-1] for q in t]
    np.testing.assert_allclose(out["poincare_x"][0], tr.x[at], atol=1e-11)
    np.testing.assert_allclose(out["poincare_v"][0], tr.v[at], atol=1e-11)


def test_the_impact_phase_does_not_depend_on_the_phase_of_the_section():
    """It is omega t mod 2 pi in [0, 2 pi), wherever the section lies."""
    for phase in (0.0, 2.0, 5.5):
        out = integrate(one(0.5, 1.0, 1.0), phase=phase)
        found = np.sort(out["impact_phase"][0, -2:])
        np.testing.assert_allclose(found, [4.566798931063947, 5.969452473193079], atol=1e-13)
        kept = out["impact_phase"][np.isfinite(out["impact_phase"])]
        assert ((kept >= 0.0) & (kept < PERIOD)).all()


def test_the_phase_of_an_impact_at_a_section_is_below_2_pi():
    """With the section just before 2 pi, the phase at the end of a period is 4 pi to rounding."""
    points, phase = wide_points(500, 3), math.nextafter(PERIOD, 0.0)
    out = integrated(points, "newmark", "plain", 40, periods=30, phase=phase)
    found = out["impact_phase"][np.isfinite(out["impact_phase"])]
    assert (found == 0.0).any()
    assert ((found >= 0.0) & (found < PERIOD)).all()


@METHODS
@pytest.mark.parametrize("phase", [0.0, 1.3, 4.0])
def test_a_run_that_starts_at_the_section_of_another_continues_it(rule, integrator, phase):
    """Bit for bit, also in chatter and rest, and for the log of one point."""
    points = random_points(3 * LANES)
    points[0] = one(h=0.0, R=0.3, omega=0.3)[0]  # at rest at some sections
    n_steps = default_steps(points, rule, integrator)
    common = {"integrator": integrator, "impact": rule, "phase": phase, "impacts": 0}
    common["steps_per_period"] = n_steps
    whole = integrate(points, transient=2, periods=12, **common)
    first = integrate(points, transient=2, periods=5, **common)
    points["x0"], points["v0"] = first["poincare_x"][:, -1], first["poincare_v"][:, -1]
    second = integrate(points, transient=3, periods=4, at_section=True, **common)
    for name in ("poincare_x", "poincare_v"):
        np.testing.assert_array_equal(second[name], whole[name][:, 8:])
    points["phase"] = phase
    scheme = scheme_of(points, integrator, rule, n_steps, phase)
    begin = trajectories(points, scheme, periods=1)
    assert [t[0] for t in begin["trajectory_t"]] == (phase / points["omega"]).tolist()
    assert [x[0] for x in begin["trajectory_x"]] == points["x0"].tolist()
    assert [x[-1] for x in begin["trajectory_x"]] == whole["poincare_x"][:, 5].tolist()


def test_the_workspace_begins_with_zeros():
    """The kernel computes with its initial contents, ten times as slowly if subnormal."""
    for _ in range(8):
        np.full(5007, 5e-324)  # its memory is freed, and likely to be reused next
        assert not aligned(5000).any()


def test_a_lane_that_moves_leaves_zeros():
    """Numbers of a lane without a point would become subnormal, and slow all lanes down."""
    workspace = new_workspace(0)
    workspace.lanes[:] = workspace.added[:] = 1.0
    move_lane.py_func(workspace, 5, 2, True)
    rows = workspace.lanes[:COEFFICIENTS].reshape(-1, ROW)
    assert not rows[:, 5].any() and not workspace.added[:, :, 5].any()
    assert np.delete(rows, 5, 1).all() and np.delete(workspace.added, 5, 2).all()


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
        ("x0", 0.1, "at most the clearance = 0$"),
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
