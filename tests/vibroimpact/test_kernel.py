"""Many points at once: every lane equals the single orbit, and the records."""

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
    points = random_points(60)
    met, rested = assert_as_alone(points, integrator, rule, steps_for(points, rule))
    assert met > 40
    assert (rested > 8) == (rule != "plain")  # Euler, which keeps bouncing, at 19


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


def test_an_approach_on_the_stop_is_an_impact_where_a_run_starts_at_a_section():
    point = one(R=0.5, v0=1.0, phase=2.0)
    scheme = scheme_of(point, "exact", "exact", None, phase=2.0)
    log = trajectories(point, scheme, periods=1)
    assert log["trajectory_v"][0][:2].tolist() == [1.0, -0.5]
    assert (log["trajectory_t"][0][:2] == 2.0 / point["omega"]).all()


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
