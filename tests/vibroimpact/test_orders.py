"""Orders of accuracy through impacts, against certified orbits.

The phase of an impact within its step jumps with N, and so does the error: every error here is
the RMS over a spread of N.
"""

import numpy as np
import pytest

from vibroimpact import Oscillator, integrate, simulate
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.scheme import IMPACT_RULES

ALL = pytest.mark.parametrize("integrator", INTEGRATORS)
PERIODS = 20
# The steps at which a method is in its asymptotic range.
LADDER = {1: (400, 800, 1600, 3200), 2: (100, 200, 400, 800), 4: (100, 200, 400, 800)}
# At fewer steps a first-order integrator finds another number of impacts in the third case.
LADDER_OF_THE_FIRST_ORDER = (1600, 3200, 6400, 12800)
# What a fitted order may be, and what is left of the error on the last rung of the ladder.
FITTED = {1: (0.8, 1.3), 2: (1.7, 2.4), 4: (3.6, 4.6)}
LEFT = {1: 2e-3, 2: 3e-5, 4: 3e-9}


def orders(integrator, rule):
    """The orders of the two parts of a method, those that are exact to rounding left out."""
    parts = INTEGRATORS[integrator].order, IMPACT_RULES[rule].order
    return [order for order in parts if order is not None]


def spread(n, count=8):
    """Step counts from n to 1.6 n."""
    return np.round(n * np.linspace(1.0, 1.6, count)).astype(int)


def rms(errors):
    """Root of the mean square."""
    return np.sqrt(np.mean(np.square(errors)))


def slope(steps, errors):
    """The fitted order."""
    return -np.polyfit(np.log(steps), np.log(errors), 1)[0]


def error_of_the_state(orbit, integrator, rule, steps):
    """RMS over the given step counts, after ``PERIODS`` periods."""
    errors = []
    for m in steps:
        out = integrate(
            orbit.oscillator.at(),
            integrator=integrator,
            impact=rule,
            steps_per_period=int(m),
            transient=PERIODS - 1,
            periods=1,
            impacts=0,
        )
        state = out["poincare_x"][0, 0], out["poincare_v"][0, 0]
        errors.append(state - orbit.sections[PERIODS - 1])
    return rms(errors)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["paper_A", "paper_B", "paper_C"])
def test_the_order_through_impacts_is_the_lower_of_the_two(truth, case, rule, integrator):
    """State after 20 periods of the paper's cases, against 30 certified digits.

    The order is that of the integrator or that of the rule, whichever is lower, and where both
    have it, both leave their error.
    """
    parts = orders(integrator, rule)
    if not parts:
        assert error_of_the_state(truth[case], integrator, rule, spread(100)) < 1e-14
        return
    order = min(parts)
    first = INTEGRATORS[integrator].order == 1
    ladder = LADDER_OF_THE_FIRST_ORDER if first else LADDER[order]
    errors = [
        error_of_the_state(truth[case], integrator, rule, spread(n, 4 if first else 8))
        for n in ladder
    ]
    low, high = FITTED[order]
    assert low < slope(ladder, errors) < high
    assert errors[-1] < parts.count(order) * LEFT[order]


@ALL
@pytest.mark.parametrize("rule", ["reduced-step", "cubic"])
@pytest.mark.parametrize("case", ["paper_A", "paper_B", "paper_C"])
def test_the_order_of_the_first_impact_is_the_lower_of_the_two(truth, case, rule, integrator):
    """Time and speed of the first impact from rest, before any error is carried on."""
    orbit, order = truth[case], min(orders(integrator, rule))
    errors = []
    for n in LADDER[order]:
        runs = [simulate(orbit.oscillator, 1, integrator, rule, m) for m in spread(n)]
        errors.append(
            rms(
                [
                    [r.impact_t[0] - orbit.impact_t[0], r.impact_v[0] - orbit.impact_v[0]]
                    for r in runs
                ]
            )
        )
    low, high = FITTED[order]
    assert low < slope(LADDER[order], errors) < high


def test_the_reduced_step_is_a_hundred_times_better_at_the_papers_step(truth):
    """Same integrator, about 100 steps: the error of the state where the motion is settled."""
    for case in ("paper_A", "paper_B"):
        orbit = truth[case]
        error = {}
        for rule in ("plain", "reduced-step", "cubic"):
            error[rule] = rms(
                [
                    np.array([r.section_x[-1], r.section_v[-1]]) - orbit.sections[PERIODS - 1]
                    for r in (
                        simulate(orbit.oscillator, PERIODS, "rk4", rule, m) for m in spread(100)
                    )
                ]
            )
        assert error["plain"] > 50 * error["reduced-step"]
        assert error["reduced-step"] > 50 * error["cubic"]


@pytest.mark.parametrize(
    "integrator", [name for name in INTEGRATORS if min(orders(name, "reduced-step")) == 2]
)
@pytest.mark.parametrize(
    ("case", "periods"),
    [
        ("crit_h1_w1", 20),
        ("w10", 60),
        ("x0_m1", 20),
        ("v0_p1", 20),
        ("unscaled", 20),
        ("cons_R1_w1", 4),
    ],
)
def test_other_certified_orbits_are_met_at_second_order(truth, case, periods, integrator):
    """Critical damping, far from resonance, other starts, no loss: 16 times finer, 100 times."""
    orbit = truth[case]
    errors = []
    for n in (100, 1600):
        runs = [
            simulate(orbit.oscillator, periods, integrator, "reduced-step", m, orbit.x0, orbit.v0)
            for m in spread(n, 8)
        ]
        true = orbit.sections[periods - 1]
        errors.append(rms([[r.section_x[-1], r.section_v[-1]] - true for r in runs]))
    assert 100 * errors[1] < errors[0]
    assert errors[1] < 1e-3 * max(1.0, np.abs(true).max())


@ALL
@pytest.mark.parametrize(
    ("h", "omega", "R", "n", "v", "phase"),
    [
        (0.05, 2.3, 0.7, 1, 1.1757597511, 1.05851979),
        (0.05, 2.2, 0.6, 1, 1.5933223776, 0.73373263),
        (0.1, 2.0, 0.5, 1, 1.8032426117, 2 * np.pi - 0.10094085),
        (0.02, 4.1, 0.8, 2, 1.3590632910, 0.83266893),
    ],
)
def test_the_one_impact_orbits(h, omega, R, n, v, phase, integrator):
    """Closed form: speed and phase of the only impact in n periods."""
    out = integrate(
        Oscillator(h=h, R=R, omega=omega, f=1.0).at(),
        integrator=integrator,
        impact="reduced-step",
        steps_per_period=400,
        transient=400,
        periods=4,
        impacts=2,
    )
    assert out["impacts_per_period"] == 1 / n
    tolerance = {1: 0.03, 2: 4e-4}.get(INTEGRATORS[integrator].order, 1e-4)
    np.testing.assert_allclose(out["impact_v"][0], v, atol=tolerance)
    np.testing.assert_allclose(out["impact_phase"][0], phase, atol=tolerance)


@ALL
def test_the_one_impact_orbits_are_met_at_the_lower_of_the_two_orders(integrator):
    """The orbit of h = 0.05, omega = 2.3, R = 0.7, from 100 to 800 steps."""
    point = Oscillator(h=0.05, R=0.7, omega=2.3, f=1.0).at()
    order = min(orders(integrator, "reduced-step"))
    ladder = (100, 200, 400, 800)
    errors = [
        rms(
            [
                integrate(
                    point,
                    integrator=integrator,
                    impact="reduced-step",
                    steps_per_period=int(m),
                    transient=60,
                    periods=1,
                    impacts=1,
                )["impact_v"][0, 0]
                - 1.1757597511
                for m in spread(n)
            ]
        )
        for n in ladder
    ]
    low, high = FITTED[order]
    assert low < slope(ladder, errors) < high
