"""Trajectories, and the paper's procedure, against the slow implementation and closed forms."""

import math
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.helpers import naive
from tests.helpers.kernel_cases import ALL, DONE
from tests.helpers.oscillators import oscillator
from vibroimpact import Oscillator, Status, one_impact_orbit, paper_procedure, simulate
from vibroimpact.oscillator import POINT
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.recorder import trace, trajectories
from vibroimpact.step.scheme import IMPACT_RULES, scheme_of
from vibroimpact.trajectory import exact_samples

RULES = pytest.mark.parametrize("rule", IMPACT_RULES)
SLOW = {"plain": naive.plain, "reduced-step": naive.shortened}
SLOW["cubic"] = partial(naive.shortened, locate=naive.on_the_cubic)

# --- against the slow implementation; the exact rule is in test_exact.py ---


@ALL
@pytest.mark.parametrize("rule", SLOW)
@pytest.mark.parametrize(
    ("osc", "x0", "v0"),
    [
        (oscillator(0.0, 0.5), 0.0, 0.0),
        (oscillator(0.1, 0.7, 2.3, f=1.7, p=1.3), -0.4, 0.8),
        (oscillator(0.05, 0.9, 1.9, 0.3), 0.1, -0.5),
        (oscillator(0.02, 0.8, 2.6, -0.2), -1.5, 0.0),
        (oscillator(1.7, 0.6, 1.4, f=3.0), -0.2, 2.0),
    ],
)
def test_the_motion_is_that_of_the_slow_implementation(osc, x0, v0, rule, integrator):
    """Same steps, other code: states at the ends of periods, and every impact.

    The slow implementation refuses a turning point within a step. Semi-implicit Euler puts one
    there on every rebound shorter than two steps, hence its finer ones.
    """
    n = 512 if INTEGRATORS[integrator].order == 1 else 64
    tr = simulate(osc, 3, integrator, rule, n, x0, v0)
    states, impacts = SLOW[rule](osc, naive.STEPS[integrator], 3, n, x0, v0)
    assert len(impacts) >= 2
    assert_allclose(tr.section_x, states[n - 1 :: n, 0], atol=1e-11)
    assert_allclose(tr.section_v, states[n - 1 :: n, 1], atol=1e-11)
    assert_allclose(tr.impact_t, impacts[:, 0], atol=1e-11)
    assert_allclose(tr.impact_v, impacts[:, 1], atol=1e-11)
    assert tr.status is DONE[rule]


def test_a_trajectory_holds_every_step_and_both_sides_of_every_impact(rule, integrator):
    """Times never fall; two rows at an impact; sections at the ends of periods."""
    osc = oscillator(0.1, 0.7, 2.3, clearance=0.1)
    tr = simulate(osc, 6, integrator, rule, 50, x0=-0.5, v0=0.4)
    assert len(tr.impact_t) >= 4
    assert (np.diff(tr.t) >= 0.0).all()
    grid = np.arange(6 * 50 + 1) * osc.forcing_period / 50
    nearest = tr.t[np.abs(tr.t[:, None] - grid).argmin(axis=0)]
    assert_allclose(nearest, grid, atol=1e-12)
    before = np.searchsorted(tr.t, tr.impact_t)
    np.testing.assert_array_equal(tr.t[before], tr.t[before + 1])
    np.testing.assert_array_equal(tr.v[before], tr.impact_v)
    np.testing.assert_array_equal(tr.v[before + 1], -0.7 * tr.impact_v)
    np.testing.assert_array_equal(tr.x[before + 1], 0.1)
    if rule != "plain":
        np.testing.assert_array_equal(tr.x[before], 0.1)
    else:
        assert (tr.x[before] > 0.1).any()
    at = [np.flatnonzero(np.isclose(tr.t, k * osc.forcing_period, atol=1e-12))[-1] for k in
          range(1, 7)]  # fmt: skip
    np.testing.assert_array_equal(tr.section_x, tr.x[at])
    np.testing.assert_array_equal(tr.section_v, tr.v[at])
    assert (tr.x[0], tr.v[0], tr.t[0]) == (-0.5, 0.4, 0.0)


def test_a_rest_does_not_begin_before_the_impact_that_ends_in_it():
    """Their times are rounded in different ways."""
    osc = oscillator(0.01, 0.0, 0.20626966398533597)
    tr = simulate(osc, 2, steps_per_period=1027, x0=-0.1, v0=1.0, phase=1.0)
    assert (np.diff(tr.t) >= 0.0).all()


@RULES
def test_an_approach_on_the_stop_at_the_start_is_an_impact_at_once(truth, rule):
    orbit = truth["v0_p1"]
    tr = simulate(orbit.oscillator, 3, "exact", rule, 2000, x0=0.0, v0=1.0)
    assert (tr.impact_t[0], tr.impact_v[0]) == (0.0, 1.0)
    np.testing.assert_array_equal(tr.v[:2], [1.0, -0.8])
    np.testing.assert_array_equal(tr.t[:2], [0.0, 0.0])
    known = orbit.impact_t[orbit.impact_t > 0.0]
    assert_allclose(tr.impact_t[1:4], known[:3], atol=1e-2)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"periods": True}, "periods = True is not .* expected: an integer from 1 to 1,000,000"),
        ({"steps_per_period": "9"}, "steps_per_period = '9' is not allowed; expected: an integer"),
        ({"integrator": "newmrk"}, r"'newmrk' is not allowed; .* \(did you mean newmark\?\)$"),
        ({"impact": "reduced_step"}, r"allowed; .* \(did you mean reduced-step\?\)$"),
        ({"integrator": "backward"}, "'backward' is not allowed; .* exact$"),
        ({"integrator": "rk4"}, "impact 'exact' needs the integrator 'exact', not 'rk4'"),
        ({"steps_per_period": 14}, "= 14 is not .* an integer from 15 to 1,000,000 for exact"),
        ({"phase": 7.0}, "phase = 7.0 is not allowed; expected: a number >= 0 and < 2 pi"),
        ({"transient": 1.5}, "transient = 1.5 is not allowed; expected: an integer from 0 to .*"),
        ({"x0": 0.1}, "x0 = 0.1 lies beyond the stop"),
        ({"v0": math.nan}, "v0 .* = nan is not allowed; expected: a finite number"),
    ],
)
def test_a_wrong_argument_is_refused_with_its_name(change, words):
    with pytest.raises(ValueError, match=words):
        simulate(oscillator(0.5, 0.5), **change)


@pytest.mark.parametrize("n", [None, 1_000_000])
def test_more_rows_than_fit_are_refused(n):
    """Also rows that no memory would hold, and impacts that make too many of just enough steps."""
    with pytest.raises(ValueError, match="more than 10,000,000 rows"):
        simulate(oscillator(0.5, 0.5), 1_000_000, steps_per_period=n)
    point = oscillator(0.5, 0.5).at()
    log, status = trace(point, scheme_of(point, "rk4", "plain", 60), 5, most_rows=300)
    assert len(log) == 0 and status is Status.PENDING


def test_an_overflow_before_the_record_is_a_status():
    """Euler's method at p T = 2 pi: no row of the record is a number."""
    tr = simulate(Oscillator(0.0, 0.8, 2.5, 1.0, p=20.0), 20, "euler", "plain", 8, transient=3000)
    assert tr.status is Status.NON_FINITE
    assert len(tr.x) == 161 and np.isnan(tr.x).all() and np.isnan(tr.v).all()
    assert tr.max_penetration == 0.0


def test_every_nth_state_of_a_trace_is_one_of_the_whole():
    """A thinned log keeps both sides of every impact, and the state after each period."""
    point = oscillator(0.1, 0.7, 2.3).at()
    scheme = scheme_of(point, "newmark", "reduced-step", 60)
    whole, _ = trace(point, scheme, periods=5)
    thin, status = trace(point, scheme, periods=5, every=20)
    assert status is Status.COMPUTED
    assert len(thin) < len(whole) / 4
    rows = {tuple(row[1:]) for row in whole}
    assert all(tuple(row[1:]) in rows for row in thin)
    kinds = [k for k in np.unique(whole[:, 0]) if k != np.median(whole[:, 0])]
    for kind in kinds:
        np.testing.assert_array_equal(thin[thin[:, 0] == kind], whole[whole[:, 0] == kind])


def test_trajectories_of_many_are_those_of_each():
    """Each has its own length, also where it has more events than were expected."""
    points = np.concatenate([oscillator(0.1, 0.7, w).at() for w in (1.3, 2.3, 3.1)])
    scheme = scheme_of(points, "newmark", "plain", 40)
    assert points.dtype == POINT
    for events in (None, np.array([0.0, 100.0, 1.5])):
        out = trajectories(points, scheme, periods=3, events=events)
        for i in range(3):
            log, _ = trace(points[i : i + 1], scheme, periods=3)
            for k, name in enumerate(("trajectory_t", "trajectory_x", "trajectory_v"), start=1):
                np.testing.assert_array_equal(out[name][i], log[:, k])
    assert len({len(samples) for samples in out["trajectory_t"]}) > 1


def test_a_motion_that_overflows_ends_in_rows_with_a_time_only():
    """Euler at p T = 2 pi from 1e300, beside a motion that does not get as far."""
    osc = Oscillator(0.0, 0.8, 2.5, 1.0, p=20.0)
    points = np.concatenate([osc.at(-1e300), osc.at(-1.0)])
    t, x, v = trajectories(points, scheme_of(points, "euler", "plain", 8), periods=2).values()
    failed = np.isnan(x[0])
    assert np.isfinite([*x[1], *v[1]]).all()
    assert not failed[:8].any() and failed[-7:].all()
    np.testing.assert_array_equal(np.isnan(v[0]), failed)
    assert t[0][failed][0] < t[0][-1] == t[1][-1]


OSC = Oscillator(h=0.05, R=0.7, omega=2.3, f=1.0)


def test_a_transient_leaves_out_the_first_periods():
    whole, late = simulate(OSC, periods=12), simulate(OSC, periods=5, transient=7)
    assert_allclose(late.section_x, whole.section_x[7:], rtol=0, atol=0)
    assert_allclose(late.impact_v, whole.impact_v[whole.impact_t > late.t[0]], rtol=0, atol=0)
    assert late.t[0] == pytest.approx(7 * 2.0 * np.pi / OSC.omega)


def test_a_phase_starts_the_motion_there():
    """On the closed-form orbit: launched at its impact, it comes back after a period."""
    orbit = one_impact_orbit(OSC)
    launched = simulate(OSC, periods=3, x0=0.0, v0=-OSC.R * orbit.v, phase=orbit.phase)
    assert launched.t[0] == pytest.approx(orbit.phase / OSC.omega)
    assert_allclose(launched.impact_v, orbit.v, rtol=1e-12)
    assert_allclose(OSC.omega * launched.impact_t[:2] % (2 * np.pi), orbit.phase, rtol=1e-12)


@pytest.mark.parametrize(
    "osc",
    [
        OSC,
        Oscillator(0.0, 0.8, 1.0, 1.0),
        Oscillator(1.0, 0.8, 0.7, 1.0, clearance=0.4),
        Oscillator(0.05, 0.7, 2.3, 1.0, clearance=-0.2),
    ],
)
def test_states_between_the_steps_are_on_the_flow(osc):
    """Also at resonance and critical damping."""
    run = simulate(osc, periods=3, x0=-0.5, v0=0.2)
    t, x, v = exact_samples(osc, run.t, run.x, run.v, 150)
    assert np.diff(t).max() <= 2.0 * np.pi / osc.omega / 150 * (1.0 + 1e-9)
    stored = np.isin(t, run.t)
    assert set(run.x) <= set(x[stored])
    between = np.searchsorted(t, run.t[0]), np.searchsorted(t, run.impact_t[0])
    flight = slice(between[0], between[1] + 1)

    expected = [naive.exact_step(osc, run.t[0], -0.5, 0.2, time) for time in t[flight]]
    assert_allclose(np.transpose([x[flight], v[flight]]), expected, atol=1e-13)


def test_states_between_the_steps_at_the_greatest_frequency():
    osc = Oscillator(h=0.05, R=0.8, omega=1.7e308, f=1.0)
    run = simulate(osc, periods=2)
    assert 400 <= len(exact_samples(osc, run.t, run.x, run.v, 200)[0]) < 500


def test_a_rest_stays_on_the_stop():
    osc = Oscillator(h=0.0, R=0.5, omega=0.5, f=1.0)
    run = simulate(osc, periods=2, transient=2)
    t, x, _ = exact_samples(osc, run.t, run.x, run.v, 200)
    begin, end = run.rests[1]
    assert len(x[(t > begin) & (t < end)]) > 20
    assert (x[(t > begin) & (t < end)] == 0.0).all()
    assert x.max() < 1e-12


def test_a_trajectory_is_shown_on_one_line():
    motion = simulate(Oscillator(h=0.1, R=0.8, omega=2.3, f=1.0), periods=50, transient=1)
    rows = f"{len(motion.t):,}"
    shown = f"Trajectory(50 periods, {rows} rows, 50 impacts, 0 rests, CERTIFIED)"
    assert repr(motion) == str(motion) == shown


@pytest.mark.parametrize(
    ("h", "R", "omega", "n", "stalls"),
    [
        (0.5, 1.0, 1.0, 100, False),
        (0.0, 0.5, 1.0, 100, False),
        (0.1, 0.6, 2.2, 100, False),
        (2.0, 0.7, 1.3, 100, False),
        (0.5, 0.95, 0.4, 10, True),  # on a coarse step, though no mass ever rests
    ],
)
def test_the_procedure_is_equations_6_to_10(h, R, omega, n, stalls):
    """Every impact equals the slow implementation, which solves Newmark as linear equations."""
    run = paper_procedure(Oscillator(h=h, R=R, omega=omega, f=1.0), 4, n)
    impacts, stalled = naive.literal(naive.oscillator(h, R, omega), 4, n)
    assert (run.stalled_at is not None) == (stalled is not None) == stalls
    assert not stalls or run.stalled_at == pytest.approx(stalled, rel=1e-9)
    assert len(impacts) >= (2 if stalls else 3)
    np.testing.assert_allclose(run.impact_t, impacts[:, 0], rtol=1e-10)
    np.testing.assert_allclose(run.impact_v, impacts[:, 1], rtol=1e-9)


@pytest.mark.parametrize(("h", "R"), [(0.5, 1.0), (0.0, 0.5), (0.5, 0.5)])
def test_without_the_procedure_it_is_the_plain_rule(h, R):
    osc = Oscillator(h=h, R=R, omega=1.0, f=1.0)
    run = paper_procedure(osc, 5, 100, procedure=False)
    tr = simulate(osc, 5, "newmark", "plain", 100)
    np.testing.assert_allclose(run.impact_t, tr.impact_t, rtol=1e-12)
    np.testing.assert_allclose(run.impact_v, tr.impact_v, atol=1e-11)
    assert run.max_penetration == pytest.approx(tr.max_penetration, rel=1e-9)


@pytest.mark.parametrize("procedure", [True, False])
def test_both_sides_of_an_impact_are_recorded(procedure):
    """Two rows with the same time; the second on the stop with the velocity turned."""
    osc = Oscillator(h=0.0, R=0.5, omega=1.0, f=1.0)
    run = paper_procedure(osc, 5, 100, procedure=procedure)
    assert (np.diff(run.t) >= 0.0).all()
    before = np.flatnonzero(np.diff(run.t) == 0.0)
    np.testing.assert_array_equal(run.t[before], run.impact_t)
    np.testing.assert_array_equal(run.v[before], run.impact_v)
    np.testing.assert_array_equal(run.v[before + 1], -0.5 * run.impact_v)
    np.testing.assert_array_equal(run.x[before + 1], 0.0)
    assert run.t[-1] >= 5 * 2 * math.pi - 1e-9


def test_a_stop_elsewhere_is_refused():
    """The paper has its stop at 0."""
    with pytest.raises(ValueError, match=r"not at 0\.5"):
        paper_procedure(Oscillator(h=0.1, R=0.5, omega=1.0, f=1.0, clearance=0.5))


@pytest.mark.parametrize("change", [{"p": 1e200}, {"h": 1e308}, {"f": 1e308}, {"omega": 1e-200}])
def test_what_overflows_by_the_procedure_is_no_number(change):
    """No error, and no depth of 0 either."""
    osc = Oscillator(**{"h": 0.1, "R": 0.8, "omega": 2.3, "f": 1.0, **change})
    run = paper_procedure(osc, periods=200)
    assert np.isfinite(run.x).all() == math.isfinite(run.max_penetration)
