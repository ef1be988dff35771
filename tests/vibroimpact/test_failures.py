"""The size of failures of time stepping and of the paper's literal procedure.

False rests are in test_trajectory_rest.py, lost energy and lost impacts in test_trajectory.py,
growth in test_stability.py; orders and stalls of the procedure in the tests of its bench.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from tests.helpers import naive
from tests.helpers.kernel_cases import integrated
from vibroimpact import Oscillator, paper_procedure, simulate
from vibroimpact.status import Status
from vibroimpact.step.integrators import is_stable
from vibroimpact.step.scheme import least_stable_steps

PAPER = {"paper_A": (0.5, 1.0), "paper_B": (0.0, 0.5), "paper_C": (0.5, 0.5)}


def paper_case(name):
    """Return the oscillator of one of the paper's three cases."""
    h, R = PAPER[name]
    return Oscillator(h=h, R=R, omega=1.0, f=1.0)


@pytest.mark.parametrize("name", PAPER)
@pytest.mark.parametrize("integrator", ["verlet", "newmark", "rk4", "exact"])
def test_the_plain_rule_penetrates_by_the_speed_times_the_rest_of_the_step(truth, name, integrator):
    """v tau + a tau^2 / 2 from the certified first impact, tau to the end of its step.

    The integrator moves that impact by its own error, of the order of T^2 at the most.
    """
    osc, orbit = paper_case(name), truth[name]
    t, v = orbit.impact_t[0], orbit.impact_v[0]
    a = -math.sin(t) - 2.0 * osc.h * v
    shares = []
    for n in (100, 137, 173, 240, 311):
        T = osc.forcing_period / n
        tau = math.ceil(t / T) * T - t
        tr = simulate(osc, 1, integrator, "plain", n)
        first = np.flatnonzero(tr.t == tr.impact_t[0])[0]
        assert tr.impact_t[0] == pytest.approx(t + tau, rel=1e-12)
        allowed = tau**3 if integrator == "exact" else v * T**2
        assert tr.x[first] == pytest.approx(v * tau + a * tau**2 / 2.0, abs=allowed)
        shares.append(tr.x[first] / (v * T))
    assert max(shares) > 0.5 > min(shares)  # anything up to a whole step


@pytest.mark.parametrize(("n", "impacts"), [(100, 39), (1000, 401)])
def test_the_plain_rule_hammers_on_a_mass_that_rests(truth, n, impacts):
    """One impact in every second or third step of the rest; more for finer steps."""
    orbit = truth["stick_R03_w03"]
    (begin, end) = orbit.rests[0]
    tr = simulate(orbit.oscillator, 1, "newmark", "plain", n)
    found = np.count_nonzero((tr.impact_t > begin) & (tr.impact_t < end))
    assert found == pytest.approx(impacts, rel=0.02)
    assert len(tr.rests) == 0


@pytest.mark.parametrize("name", PAPER)
def test_the_index_of_a_step_is_no_clock_in_the_literal_procedure(name):
    """Every impact restarts the grid: after 20 periods of 100 steps 20 to 41 more were taken."""
    run = paper_procedure(paper_case(name), 20, 100)
    steps = len(run.t) - 1 - len(run.impact_t)
    assert 20 <= steps - 2000 <= 41


def test_a_coarse_rule_ends_on_another_attractor():
    """Two attractors: one impact at 1.4118, or three at .6408, 1.1693, 2.2087 in two periods.

    From the same start `plain` ends on the other one here and there, though it knows both, and
    splits the second into several. With the reduced step each start ends as in truth.
    """
    osc = Oscillator(h=0.02, R=0.8, omega=1.3, f=1.0)
    starts = [(x, v) for x in np.linspace(-3.0, 0.0, 8) for v in np.linspace(-2.0, 2.0, 8)]
    points = np.concatenate([osc.at(*start) for start in starts])

    def ends(integrator, rule, n):
        """Impacts in two periods, 2 or 3, and the speeds of the last three."""
        out = integrated(points, integrator, rule, n, transient=1500, periods=4, impacts=3)
        return 2.0 * out["impacts_per_period"], np.sort(out["impact_v"], axis=1)

    true, speeds = ends("exact", "exact", None)
    first, second = true == 2.0, true == 3.0
    assert (first ^ second).all()
    np.testing.assert_allclose(speeds[first], 1.4118, atol=6e-5)
    np.testing.assert_allclose(speeds[second], [[0.6408, 1.1693, 2.2087]] * second.sum(), atol=6e-5)
    for integrator in ("newmark", "rk4", "exact"):
        coarse, copies = ends(integrator, "plain", 100)
        assert np.isin(coarse, (2.0, 3.0)).all()
        assert (coarse[first] == 3.0).any() and (coarse[second] == 2.0).any()
        assert len(np.unique(np.round(copies[coarse == 3.0], 3), axis=0)) > 2
        reduced, near = ends(integrator, "reduced-step", 100)
        np.testing.assert_array_equal(reduced, true)
        np.testing.assert_allclose(near, speeds, rtol=0.02)


def test_an_unstable_step_may_pass_for_computed_where_impacts_shorten_it():
    """Runge-Kutta at p T = pi: `plain` overflows; the halved steps of `reduced-step` hold it.

    The status says what the numbers are, not that they are right: the speeds are several times
    too great, and only the check of the step says why.
    """
    osc = Oscillator(h=0.0, R=0.8, omega=0.5, f=1.0)
    assert 4 < least_stable_steps("rk4", 0.0, 1.0, 0.5) == 5
    assert not is_stable("rk4", math.pi, 0.0)
    assert simulate(osc, 400, "rk4", "plain", 4).status is Status.NON_FINITE
    held = simulate(osc, 400, "rk4", "reduced-step", 4)
    true = simulate(osc, 400)
    assert held.status is Status.COMPUTED
    assert 2.0 < np.abs(held.v).max() / np.abs(true.v).max() < 10.0


@pytest.mark.parametrize(
    ("h", "omega", "x0"),
    [(0.1, 0.5, -1.5), (0.05, 0.8, -2.5), (0.3, 0.9, -0.7), (0.02, 0.55, -3.0)],
)
def test_runge_kutta_with_the_reduced_step_misses_what_lies_between_grid_points(h, omega, x0):
    """At 100 steps a touch is seen from the depth a d^2 / 2 on, d from the top to the next point.

    That is |a| T^2 / 8 in the worst case: from there on all are seen. The first two motions are
    near it, and miss all that is below 0.79 of it.
    """
    free = Oscillator(h=h, R=0.8, omega=omega, f=1.0)
    flight, T = naive.ClosedForm(free, 0.0, x0, 0.0), free.forcing_period / 100
    grid = np.linspace(0.05, 0.95 * free.forcing_period, 400)
    v = flight(grid)[1]
    first = np.flatnonzero((v[:-1] > 0.0) & (v[1:] <= 0.0))[0]
    top = brentq(lambda t: flight(t)[1], grid[first], grid[first + 1], xtol=1e-15)
    height = float(flight(top)[0])
    a = -naive.acceleration(free, top, height, 0.0)
    d = abs(top / T - round(top / T)) * T
    from_depth, worst = a * d * d / 2, a * T * T / 8
    assert 1e-6 < from_depth <= worst
    assert from_depth > 0.79 * worst or h > 0.1 or omega == 0.55

    def sees(depth, method):
        osc = replace(free, clearance=height - depth)
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


# --- the literal procedure ---


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


@pytest.mark.parametrize("name", PAPER)
def test_without_the_procedure_it_is_the_plain_rule(name):
    """The same orbit as `simulate` and as the slow implementation, step by step."""
    run = paper_procedure(paper_case(name), 5, 100, procedure=False)
    tr = simulate(paper_case(name), 5, "newmark", "plain", 100)
    _, impacts = naive.plain(naive.oscillator(*PAPER[name], 1.0), naive.newmark_step, 5, 100)
    for ours in (tr, run):
        np.testing.assert_allclose(ours.impact_t, impacts[:, 0], rtol=1e-12)
        np.testing.assert_allclose(ours.impact_v, impacts[:, 1], atol=1e-11)
    assert run.max_penetration == pytest.approx(tr.max_penetration, rel=1e-9)


@pytest.mark.parametrize("procedure", [True, False])
def test_both_sides_of_an_impact_are_recorded(procedure):
    """Two rows with the same time; the second on the stop with the velocity turned."""
    run = paper_procedure(paper_case("paper_B"), 5, 100, procedure=procedure)
    assert (np.diff(run.t) >= 0.0).all()
    before = np.flatnonzero(np.diff(run.t) == 0.0)
    np.testing.assert_array_equal(run.t[before], run.impact_t)
    np.testing.assert_array_equal(run.v[before], run.impact_v)
    np.testing.assert_array_equal(run.v[before + 1], -0.5 * run.impact_v)
    np.testing.assert_array_equal(run.x[before + 1], 0.0)
    assert run.t[-1] >= 5 * 2 * math.pi - 1e-9


def test_the_procedure_never_passes_the_accumulation(truth):
    """It does so at no step count; the kernel always does for the same oscillator."""
    orbit = truth["stick_R03_w03"]
    for n in (10, 20, 37, 50, 100, 200, 400, 1000, 3000):
        stalled = paper_procedure(orbit.oscillator, 2, n).stalled_at
        assert stalled is not None
        assert stalled < orbit.rests[0, 0]
        assert simulate(orbit.oscillator, 2, "newmark", "reduced-step", n).section_x.shape == (2,)


def test_a_stop_elsewhere_is_refused():
    """The paper has its stop at 0."""
    with pytest.raises(ValueError, match=r"not at 0\.5"):
        paper_procedure(Oscillator(h=0.1, R=0.5, omega=1.0, f=1.0, clearance=0.5))
