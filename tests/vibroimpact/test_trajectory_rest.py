"""Rest on the stop, its release, and motions in which other procedures come to a halt."""

import math

import numpy as np
import pytest

from tests.helpers.kernel_cases import ALL, PERIOD, SECOND_ORDER, integrated
from tests.helpers.oscillators import oscillator
from vibroimpact import Status, simulate

SHORTENING = pytest.mark.parametrize("rule", ["reduced-step", "cubic"])


@SECOND_ORDER
@pytest.mark.parametrize(
    ("case", "rests", "steps", "most", "better"),
    [
        ("stick_R03_w03", 4, (100, 400, 1600, 6400), 2, 16),
        ("stick_hiw_S2", 2, (200, 800, 3200), 3, 4),  # once in two periods
        ("over_h2_stick", 4, (200, 800, 3200), 5, 4),
    ],
)
def test_a_chatter_ends_in_rest(truth, case, rests, steps, most, better, integrator):
    """The release is exact; the error of the begin is `most` steps, and `better` times less last.

    At the end of a long chatter the flights are of the length of a step, and the chord is coarse:
    with the exact integrator, too, the over-damped rest begins up to 3.9 T off (at 25600 steps).
    """
    orbit = truth[case]
    errors = []
    for n in steps:
        tr = simulate(orbit.oscillator, 4, integrator, "reduced-step", n)
        assert min(len(tr.rests), len(orbit.rests)) == rests
        np.testing.assert_allclose(tr.rests[:rests, 1], orbit.rests[:rests, 1], rtol=1e-12)
        errors.append(np.abs(tr.rests[:rests, 0] - orbit.rests[:rests, 0]).max())
        assert errors[-1] < most * orbit.oscillator.forcing_period / n
    assert errors[-1] < errors[0] / better


THREE = [("rk4", "reduced-step"), ("rk4", "cubic"), ("exact", "exact")]


@pytest.mark.parametrize(("integrator", "rule"), THREE)
def test_a_force_that_only_just_does_not_lift_the_mass(integrator, rule):
    """p^2 |clearance| = f: from the stop, and after a fall onto it, also as lanes do it."""
    rng = np.random.default_rng(4)
    for _ in range(12):
        f, p, omega = rng.uniform(0.1, 3.0), rng.uniform(0.5, 2.0), rng.uniform(0.2, 3.0)
        osc = oscillator(0.3, 0.3, omega, -f / (p * p), f, p)
        for phase in (0.0, 0.5 * math.pi):
            tr = simulate(osc, 10, integrator, rule, 100, x0=osc.clearance, phase=phase)
            assert len(tr.impact_t) == 0
            np.testing.assert_array_equal(tr.rests, [[phase / omega, math.inf]])
        tr = simulate(osc, 10, integrator, rule, 100, x0=osc.clearance - 0.2)
        assert tr.rests.shape == (1, 2)
        assert tr.rests[0, 1] == math.inf
        assert len(tr.impact_t) == (tr.impact_t <= tr.rests[0, 0]).sum()
        lane = integrated(osc.at(osc.clearance - 0.2), integrator, rule, 100, periods=10)
        assert round(10 * lane["impacts_per_period"][0]) == len(tr.impact_t)


@SECOND_ORDER
@SHORTENING
def test_a_preload_just_below_the_force_is_released_at_its_phase(rule, integrator):
    """sin(omega t) = 0.99, and 0.999999, every period, to the last digits."""
    for level in (0.5, 0.99, 0.999999):
        osc = oscillator(0.1, 0.5, clearance=-level)
        tr = simulate(osc, 5, integrator, rule, 100, x0=-level)
        assert tr.rests[0, 0] == 0.0
        ends = tr.rests[:5, 1]
        sharp = 1e-14 / math.sqrt(1 - level**2)
        np.testing.assert_allclose(ends, math.asin(level) + PERIOD * np.arange(5), atol=sharp)


def test_without_restitution_a_mass_thrown_at_its_stop_is_released_without_an_impact():
    """From the stop with v > 0: one impact, at the start, and rest until sin(omega t) = level."""
    level, v0 = 0.3581467921965723, 0.3
    osc = oscillator(0.05, 0.0, 3.0, clearance=-level)
    tr = simulate(osc, 1, x0=-level, v0=v0)
    assert tr.impact_v[0] == v0
    assert tr.impact_v[1:].min() > 0.1
    assert tr.rests[0, 1] == pytest.approx(math.asin(level) / 3.0, rel=1e-14)


def test_without_restitution_every_impact_is_rest_while_the_force_presses():
    """R = 0: one impact per rest, released at 2 pi k / omega."""
    osc = oscillator(0.1, 0.0, 0.7)
    tr = simulate(osc, 6, "exact", "reduced-step", 400)
    assert len(tr.impact_t) == len(tr.rests) >= 3
    np.testing.assert_array_equal(tr.rests[:, 0], tr.impact_t)
    turns = tr.rests[:, 1] / osc.forcing_period
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-12)
    assert (np.diff(tr.rests.ravel()) > 0.0).all()


@pytest.mark.parametrize("integrator", ["newmark", "rk4"])
@SHORTENING
@pytest.mark.parametrize(
    ("h", "R", "omega", "steps"),
    [
        (0.0, 0.3, 0.3, (100, 1000, 10_000)),
        (0.5, 0.8, 0.6, (50, 100, 200, 400)),
        (0.5, 0.95, 0.4, (50, 100, 200, 400, 800)),
        (0.5, 0.5, 1.0, tuple(range(8, 39))),
        (0.1, 0.8, 3.03523, (23,)),
        (0.1, 0.8, 3.0383, (50, 200)),
    ],
)
def test_where_the_literal_procedure_hangs_time_goes_on(h, R, omega, steps, rule, integrator):
    """Every row of the table of failures: the run reaches its end, with every speed positive."""
    for n in steps:
        tr = simulate(oscillator(h, R, omega), 20, integrator, rule, n)
        assert tr.status is Status.COMPUTED
        assert tr.t[-1] == pytest.approx(20 * PERIOD / omega, rel=1e-12)
        assert tr.max_penetration == 0.0
        assert (tr.impact_v > 0.0).all()
        assert np.isfinite(tr.x).all()


@SECOND_ORDER
@pytest.mark.parametrize(("R", "omega", "impacts"), [(0.8, 0.6, 18), (0.95, 0.4, 34)])
def test_a_long_chatter_that_is_never_complete_holds_no_rest(R, omega, impacts, integrator):
    """h = 0.5: no rest, and as many impacts per period as a fine step finds."""
    tr = simulate(oscillator(0.5, R, omega), 4, integrator, "reduced-step", 6400)
    assert len(tr.rests) == 0
    assert len(tr.impact_t) == 4 * impacts


@ALL
def test_a_release_at_the_end_of_a_tiny_step_ends(integrator):
    """20 000 and 51 200 steps per period: the phase of the release is known to a rounding only."""
    for n in (20_000, 51_200):
        tr = simulate(oscillator(0.0, 0.3, 0.5), 2, integrator, "reduced-step", n)
        assert tr.status is Status.COMPUTED
        assert len(tr.rests) == 2
