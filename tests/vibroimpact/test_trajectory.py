"""Trajectories against the slow implementation, closed forms, the paper's cases and the energy."""

import math
from functools import partial

import naive
import numpy as np
import pytest

from kernel_cases import ALL, SECOND_ORDER
from oscillators import oscillator
from vibroimpact import Oscillator, Status, simulate
from vibroimpact.oscillator import POINT
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.recorder import trace, trajectories
from vibroimpact.step.scheme import IMPACT_RULES, scheme_of

RULES = pytest.mark.parametrize("rule", IMPACT_RULES)
SHORTENING = pytest.mark.parametrize("rule", ["reduced-step", "cubic"])
PERIOD = 2.0 * math.pi
PAPER = {"paper_A": (0.5, 1.0), "paper_B": (0.0, 0.5), "paper_C": (0.5, 0.5)}
SLOW = {
    "plain": naive.plain,
    "reduced-step": naive.shortened,
    "cubic": partial(naive.shortened, locate=naive.on_the_cubic),
}

# What a run that went well reports.
DONE = dict.fromkeys(IMPACT_RULES, Status.COMPUTED) | {"exact": Status.CERTIFIED}


# --- against the slow implementation; the exact rule is in test_exact.py ---


@ALL
@pytest.mark.parametrize("rule", SLOW)
@pytest.mark.parametrize(
    ("given", "x0", "v0"),
    [
        ({"h": 0.5, "R": 1.0, "omega": 1.0}, 0.0, 0.0),
        ({"h": 0.0, "R": 0.5, "omega": 1.0}, 0.0, 0.0),
        ({"h": 0.5, "R": 0.5, "omega": 1.0}, 0.0, 0.0),
        ({"h": 0.1, "R": 0.7, "omega": 2.3, "f": 1.7, "p": 1.3}, -0.4, 0.8),
        ({"h": 0.05, "R": 0.9, "omega": 1.9, "clearance": 0.3}, 0.1, -0.5),
        ({"h": 0.02, "R": 0.8, "omega": 2.6, "clearance": -0.2}, -1.5, 0.0),
        ({"h": 1.7, "R": 0.6, "omega": 1.4, "f": 3.0}, -0.2, 2.0),
    ],
)
def test_the_motion_is_that_of_the_slow_implementation(given, x0, v0, rule, integrator):
    """Same steps, other code: states at the ends of steps, and every impact.

    The slow implementation refuses a turning point within a step. Semi-implicit Euler puts one
    there on every rebound shorter than two steps, hence its finer ones.
    """
    n = 512 if INTEGRATORS[integrator].order == 1 else 64
    tr = simulate(Oscillator(**{"f": 1.0} | given), 3, integrator, rule, n, x0, v0)
    step = naive.STEPS[integrator]
    states, impacts = SLOW[rule](naive.oscillator(**given), step, 3, n, x0, v0)
    assert len(impacts) >= 2
    np.testing.assert_allclose(tr.section_x, states[n - 1 :: n, 0], atol=1e-11)
    np.testing.assert_allclose(tr.section_v, states[n - 1 :: n, 1], atol=1e-11)
    np.testing.assert_allclose(tr.impact_t, impacts[:, 0], atol=1e-11)
    np.testing.assert_allclose(tr.impact_v, impacts[:, 1], atol=1e-11)
    assert tr.status is DONE[rule]


# --- closed forms ---


@ALL
@pytest.mark.parametrize(
    ("h", "t", "v"),
    [
        (0.0, 4.49340945790906417530788, 2.19305261027023934757415),
        (0.5, 4.60243211528852047840134, 0.907533328977362055315773588),
    ],
)
def test_the_first_flight_from_rest(h, t, v, integrator):
    """tan t = t at resonance, and the certified time at h = 0.5, to the order of the method."""
    tr = simulate(oscillator(h, 0.5), 1, integrator, "reduced-step", 4000)
    T = PERIOD / 4000
    late, fast = (1.1 * T, 3 * T) if INTEGRATORS[integrator].order == 1 else (3e-6, 5e-6)
    assert tr.impact_t[0] == pytest.approx(t, abs=late)
    assert tr.impact_v[0] == pytest.approx(v, abs=fast)


def test_the_flight_at_resonance_is_secular():
    """x = (t cos t - sin t) / 2 at every step before the first impact, exactly."""
    tr = simulate(oscillator(0.0, 0.5), 1, steps_per_period=100)
    flight = tr.t < tr.impact_t[0]
    t = tr.t[flight]
    assert flight.sum() == 72
    np.testing.assert_allclose(tr.x[flight], (t * np.cos(t) - np.sin(t)) / 2, atol=1e-14)
    np.testing.assert_allclose(tr.v[flight], -t * np.sin(t) / 2, atol=1e-14)


def test_a_linear_growth_without_bound():
    """R = 1, h = 0, omega = 2: impacts at k pi with speed 4 k / 3, to rounding on this grid."""
    tr = simulate(oscillator(0.0, 1.0, 2.0), 30, "exact", "reduced-step", 100)
    k = np.arange(1, 31)
    np.testing.assert_allclose(tr.impact_t, k * math.pi, rtol=1e-12)
    np.testing.assert_allclose(tr.impact_v, 4 * k / 3, rtol=1e-11)
    tr = simulate(oscillator(0.0, 1.0, 2.0), 10, "exact", "reduced-step", 1001)
    np.testing.assert_allclose(tr.impact_v[:9], 4 * k[:9] / 3, rtol=1e-4)


@SECOND_ORDER
@pytest.mark.parametrize(
    ("omega", "amplitude", "landing", "release"),
    [(3.0, 0.5, math.pi, 4 * math.pi / 3), (1 / 3, 1.5, 3 * math.pi, 6 * math.pi)],
)
@pytest.mark.parametrize("R", [0.0, 0.5, 0.9])
def test_a_tangential_landing_rests_until_the_force_turns(
    R, omega, amplitude, landing, release, integrator
):
    """h = 0, omega = 3 p or p / 3: x = -c sin^3 to the landing with x = v = a = 0, then rest."""
    osc = oscillator(0.0, R, omega)
    late = []
    for n in (200, 3200):
        tr = simulate(osc, 4, integrator, "reduced-step", n)
        assert tr.status is Status.COMPUTED
        np.testing.assert_allclose(tr.rests[0, 1], release, rtol=1e-12)
        late.append(abs(tr.rests[0, 0] - landing))
        flight = tr.t < landing - 0.3
        cube = -amplitude * np.sin(min(omega, 1.0) * tr.t[flight]) ** 3
        np.testing.assert_allclose(tr.x[flight], cube, atol=30 * (PERIOD / omega / n) ** 2)
    # The contact is cubic, so its time is known to the cube root of an error; or to one step.
    assert late[1] < max(0.7 * late[0], 1.01 * PERIOD / omega / 3200)


# --- the paper's three cases ---


@SECOND_ORDER
def test_the_third_case_has_four_impacts_per_period_and_the_plain_step_finds_three(integrator):
    """h = R = 0.5, 20 periods at the paper's step: 60 without the procedure, 80 with it."""
    plain = simulate(oscillator(0.5, 0.5), 20, integrator, "plain", 100)
    shortened = simulate(oscillator(0.5, 0.5), 20, integrator, "reduced-step", 100)
    assert (len(plain.impact_t), len(shortened.impact_t)) == (60, 80)
    assert len(simulate(oscillator(0.5, 0.5), 20, integrator, "plain", 2000).impact_t) == 80


@SHORTENING
def test_no_rule_mends_a_first_order_integrator(rule):
    """The third case with Euler: three impacts per period at the paper's step, four at a finer."""
    for n, impacts in ((100, 60), (3200, 80)):
        assert len(simulate(oscillator(0.5, 0.5), 20, "euler", rule, n).impact_t) == impacts


@ALL
@pytest.mark.parametrize(
    ("case", "phase", "v"),
    [
        ("paper_A", [4.566798931063947, 5.969452473193079], [0.902040564502884, 0.411362031140622]),
        ("paper_B", [4.317869374348522, 6.017172372416884], [2.037529035119366, 0.811704646702102]),
        (
            "paper_C",
            [4.601556825606546, 5.387341285272362, 5.825655719839734, 6.146519773279830],
            [0.907496491171004, 0.321900878724339, 0.115762561014269, 0.036454221377120],
        ),
    ],
)
def test_the_steady_impacts_of_the_papers_cases(case, phase, v, integrator):
    """Phase and speed of every impact of the last period, to the order of the method.

    The rule itself is off by up to 3.9 T^2, at the last impact of the third case; there a
    second-order integrator adds up to 7 T^2 of its own (Verlet; Newmark's 3.9 has the other sign).
    """
    order = INTEGRATORS[integrator].order
    for n in (1600, 3200, 6400) if order == 1 else (100, 400, 1600):
        T = PERIOD / n
        tolerance = 4 * T**2 + {1: 14 * T, 2: 7 * T**2}.get(order, 0.0)
        tr = simulate(oscillator(*PAPER[case]), 20, integrator, "reduced-step", n)
        last = tr.impact_t > 19 * PERIOD
        np.testing.assert_allclose(tr.impact_t[last] - 19 * PERIOD, phase, atol=tolerance)
        np.testing.assert_allclose(tr.impact_v[last], v, atol=tolerance)


@ALL
@pytest.mark.parametrize("case", PAPER)
def test_the_penetration_is_of_the_order_of_one_step_and_the_reduced_step_has_none(
    case, integrator
):
    """Plain: at the most a step at the speed of impact, and not much less; reduced: none."""
    for n in (100, 400):
        plain = simulate(oscillator(*PAPER[case]), 20, integrator, "plain", n)
        step = PERIOD / n * plain.impact_v.max()
        assert 0.05 * step < plain.max_penetration <= step
        assert plain.x.max() == plain.max_penetration
        shortened = simulate(oscillator(*PAPER[case]), 20, integrator, "reduced-step", n)
        assert shortened.max_penetration <= 1e-15
        assert shortened.x.max() <= 1e-15


# --- what a trajectory holds ---


def test_a_trajectory_holds_every_step_and_both_sides_of_every_impact(rule, integrator):
    """Times never fall; two rows at an impact; sections at the ends of periods."""
    osc = oscillator(0.1, 0.7, 2.3, clearance=0.1)
    tr = simulate(osc, 6, integrator, rule, 50, x0=-0.5, v0=0.4)
    assert len(tr.impact_t) >= 4
    assert (np.diff(tr.t) >= 0.0).all()
    grid = np.arange(6 * 50 + 1) * osc.forcing_period / 50
    nearest = tr.t[np.abs(tr.t[:, None] - grid).argmin(axis=0)]
    np.testing.assert_allclose(nearest, grid, atol=1e-12)
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


@RULES
def test_an_approach_on_the_stop_at_the_start_is_an_impact_at_once(truth, rule):
    """x0 on the stop, v0 = 1, R = 0.8: at t = 0 the speed is 1 before and -0.8 after."""
    orbit = truth["v0_p1"]
    tr = simulate(orbit.oscillator, 3, "exact", rule, 2000, x0=0.0, v0=1.0)
    assert (tr.impact_t[0], tr.impact_v[0]) == (0.0, 1.0)
    np.testing.assert_array_equal(tr.v[:2], [1.0, -0.8])
    np.testing.assert_array_equal(tr.t[:2], [0.0, 0.0])
    known = orbit.impact_t[orbit.impact_t > 0.0]
    np.testing.assert_allclose(tr.impact_t[1:4], known[:3], atol=1e-2)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"periods": 0}, "periods must be an integer from 1 to 1,000,000, not 0"),
        ({"periods": 2.5}, "periods must be an integer from 1 to 1,000,000, not 2.5"),
        ({"periods": True}, "periods must be an integer from 1 to 1,000,000, not True"),
        ({"steps_per_period": 0}, "steps_per_period must be an integer from 1 to 1,000,000, not 0"),
        ({"steps_per_period": "9"}, "steps_per_period must be an integer from 1 to .*, not '9'"),
        ({"integrator": "rk5"}, f"integrator must be one of {', '.join(INTEGRATORS)}, not 'rk5'"),
        ({"impact": "soft"}, "impact must be one of plain, reduced-step, cubic, exact, not 'soft'"),
        ({"integrator": "rk4"}, "impact 'exact' needs the integrator 'exact', not 'rk4'"),
        ({"steps_per_period": 14}, "must be >= 15 for exact impacts here, not 14"),
        ({"x0": 0.1}, "x0 = 0.1 lies beyond the stop"),
        ({"v0": math.nan}, "v0 .* must be a finite number, not nan"),
    ],
)
def test_a_wrong_argument_is_refused_with_its_name(change, words):
    """The message says what was given and what is allowed."""
    with pytest.raises(ValueError, match=words):
        simulate(oscillator(0.5, 0.5), **change)


def test_more_rows_than_fit_are_refused():
    with pytest.raises(ValueError, match="more than 10,000,000 rows"):
        simulate(oscillator(0.5, 0.5), 1_000_000)


def test_an_overflow_before_the_record_is_a_status():
    """Euler's method at p T = 2 pi: no row of the record is a number."""
    tr = simulate(Oscillator(0.0, 0.8, 2.5, 1.0, p=20.0), 20, "euler", "plain", 8, transient=3000)
    assert tr.status is Status.NON_FINITE
    assert len(tr.x) == 161 and np.isnan(tr.x).all() and np.isnan(tr.v).all()
    assert tr.max_penetration == 0.0


def test_an_unstable_step_ends_as_not_a_number():
    """Runge-Kutta beyond its stability limit: NaN from the overflow on, and a status."""
    tr = simulate(oscillator(50.0, 0.8, 2.0), 30, "rk4", "plain", 20)
    assert tr.status is Status.NON_FINITE
    assert np.isnan(tr.x[-1])
    assert np.isnan(tr.section_x[-1])
    first = np.isnan(tr.x).argmax()
    assert first > 0
    assert np.isnan(tr.x[first:]).all()


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
    """Rows of one array, filled up with NaN."""
    points = np.concatenate([oscillator(0.1, 0.7, w).at() for w in (1.3, 2.3, 3.1)])
    scheme = scheme_of(points, "newmark", "plain", 40)
    out = trajectories(points, scheme, periods=3)
    assert points.dtype == POINT
    for i in range(3):
        log, _ = trace(points[i : i + 1], scheme, periods=3)
        for k, name in enumerate(("trajectory_t", "trajectory_x", "trajectory_v"), start=1):
            np.testing.assert_array_equal(out[name][i, : len(log)], log[:, k])
            assert np.isnan(out[name][i, len(log) :]).all()


# --- energy ---


def energy_after_a_hundred(rule, integrator, n):
    """Free motion at R = 1, x0 = -1: v^2 at the 100th impact, T = 2 pi / (1.0137 n)."""
    osc = oscillator(0.0, 1.0, 1.0137, f=0.0)
    return simulate(osc, 52, integrator, rule, n, x0=-1.0).impact_v[99] ** 2


@pytest.mark.parametrize("integrator", ["rk4", "exact"])
def test_the_plain_step_loses_energy_without_any_loss_at_impacts(integrator):
    """0.961 of it is left after 100 impacts at T = 2 pi / 101.37, as a simple program found."""
    assert energy_after_a_hundred("plain", integrator, 100) == pytest.approx(0.961, abs=6e-4)


@SECOND_ORDER
@pytest.mark.parametrize("rule", ["plain", "reduced-step"])
def test_the_loss_of_energy_vanishes_with_the_step(rule, integrator):
    """Nothing is gained, and sixteen times the steps lose less than a hundredth."""
    coarse, fine = (1.0 - energy_after_a_hundred(rule, integrator, n) for n in (100, 1600))
    assert 0.01 < coarse < 0.1
    assert 0.0 < fine < coarse / 100


@SECOND_ORDER
def test_the_cubic_step_changes_the_energy_at_the_fourth_order(integrator):
    """Without a force only the speed at the impact is lost: at 50 steps below 2e-4 of it.

    Verlet's motion has an energy of its own, v^2 / (1 - (p T)^2 / 4) + p^2 x^2.
    """
    errors = []
    for n in (50, 200):
        T = PERIOD / 1.0137 / n
        own = 1.0 - T**2 / 4 if integrator == "verlet" else 1.0
        errors.append(abs(1.0 - energy_after_a_hundred("cubic", integrator, n) / own))
    coarse, fine = errors
    assert coarse < 2e-4
    assert fine < coarse / 200 + 1e-12


@pytest.mark.parametrize("n", [100, 400, 1600])
@pytest.mark.parametrize("rule", ["plain", "reduced-step", "cubic"])
def test_euler_gains_energy_through_impacts_without_loss(rule, n):
    """(1 + (p T)^2) of it in every step, and no rule takes that away: 10^8 times at 100 steps."""
    osc, T = oscillator(0.0, 1.0, 1.0137, f=0.0), PERIOD / 1.0137 / n
    tr = simulate(osc, 52, "euler", rule, n, x0=-1.0)
    steps = tr.impact_t[99] / T
    assert math.log(tr.impact_v[99] ** 2) == pytest.approx(steps * math.log1p(T**2), rel=0.02)


def test_the_exact_rule_keeps_the_energy():
    """After 100 impacts without loss, the speed of the first to rounding."""
    assert energy_after_a_hundred("exact", "exact", None) == pytest.approx(1.0, abs=1e-13)
