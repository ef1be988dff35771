"""One step that meets the stop, and a mass that rests on the stop."""

import math

import mpmath as mp
import numpy as np
import pytest

from tests.helpers.kernel_cases import ALL, SECOND_ORDER
from tests.helpers.oscillators import Flight, in_digits
from vibroimpact import Oscillator
from vibroimpact.status import Status
from vibroimpact.step.chatter import time_to_rest
from vibroimpact.step.contact import (
    IMPACT,
    KIND,
    RELEASE,
    SPEED,
    TIME,
    new_scratch,
    pressing,
    time_to_release,
)
from vibroimpact.step.elementary import sin_cos
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.scheme import CUBIC, REDUCED_STEP
from vibroimpact.step.time_stepping import (
    SHORTEST_FLIGHT,
    geometric_time_to_rest,
    reduced_step,
    shortened_flight,
    single_linear_impact,
)

# The rules that shorten a step.
SHORTENING = pytest.mark.parametrize("rule", [REDUCED_STEP, CUBIC], ids=["reduced-step", "cubic"])
# Nearly constant acceleration: the force is at its maximum, and nothing else acts.
PUSH = {"h": 0.0, "omega": 1e-9, "f": 1.0, "p": 1e-9}
CREST = 1.5 * math.pi


def point(x0=0.0, v0=0.0, **parameters):
    return Oscillator(**{"h": 0.1, "R": 0.5, "omega": 1.0, "f": 1.0} | parameters).at(x0, v0)[0]


def run(pt, rule, integrator, x, v, theta, T, resting=False):
    """One step with impacts: state, rest, the rows of its events, time rested and status."""
    scratch, chosen = new_scratch.py_func(), INTEGRATORS[integrator]
    s, c = math.sin(theta), math.cos(theta)
    method, end = (rule, chosen.code), chosen.step(x, v, s, c, T, pt)
    step = reduced_step(method, (x, v, resting), end, (theta, s, c), T, pt, scratch)
    x, v, resting, n, rested, status = step
    return x, v, resting, scratch.events[:n], rested, status


def flight(rule, integrator, x, v, theta, span, pt):
    """One flight of at most `span`: time, state, and whether it ended on the stop."""
    chosen, s, c = INTEGRATORS[integrator], math.sin(theta), math.cos(theta)
    method, end = (rule, chosen.code), chosen.step(x, v, s, c, span, pt)
    room = new_scratch.py_func().coefficients
    return shortened_flight(method, (x, v, s, c), end, span, pt, room)[:4]


def to_rest(v, theta, left, T, pt):
    return geometric_time_to_rest(v, theta, math.sin(theta), left, T, pt)


@SHORTENING
@pytest.mark.parametrize(("integrator", "drop"), [("euler", 0.0), ("semi-implicit-euler", 1.0)])
def test_a_first_order_step_brings_no_rebound_back(rule, integrator, drop):
    """Under a constant push its x is -u t + drop a t^2, on which no impact within the step lies.

    Euler goes straight on. Semi-implicit Euler comes back at half the time, u / a, at no speed:
    that is no impact, whatever is left of it by rounding, and the step is halved.
    """
    pt = point(R=0.5, x0=0.3, clearance=0.3, **PUSH)
    for T, u in np.random.default_rng(1).uniform([0.01, 0.02], [0.1, 0.99], (200, 2)):
        dt, x, v, hit = flight(rule, integrator, 0.3, -u * T, CREST, T, pt)
        assert not hit
        assert dt == T if drop == 0.0 else 0.5 * u * T <= dt < u * T
        assert x - 0.3 == pytest.approx(-u * T * dt + drop * dt**2, abs=1e-15)
        assert v == pytest.approx(-u * T + dt, abs=1e-15)


@SECOND_ORDER
def test_a_rebound_within_the_step_divides_the_launch_out(integrator):
    """From the stop, eq. (7) on (x - clearance) / t, whose value at the launch is the velocity."""
    pt = point(x0=-0.2, h=0.4, clearance=-0.2, f=2.0, omega=1.5)
    row = INTEGRATORS[integrator]
    v, theta, T = -0.3, 4.0, 0.5
    x_T, v_T = row.step(-0.2, v, math.sin(theta), math.cos(theta), T, pt)
    mean = (x_T + 0.2) / T
    share = -v / (mean - v)
    assert 0.1 < share < 0.9
    # Not a parabola, on which the chord of v has the same root; Newmark's step always is one.
    assert abs(share + 2 * v / (v_T - v)) > 1e-3 or integrator == "newmark"
    dt, at, speed, hit = flight(REDUCED_STEP, integrator, -0.2, v, theta, T, pt)
    assert (hit, at) == (True, -0.2)
    assert dt == pytest.approx(share * T, rel=1e-14)
    assert speed == pytest.approx(v + share * (v_T - v), rel=1e-14)


@SECOND_ORDER
@SHORTENING
def test_a_step_much_longer_than_the_flight_is_cut_to_it(rule, integrator):
    """Without force the flight ends where tan(p t / 2) = v / (p |clearance|), at the same speed.

    Its acceleration falls to nothing over this step of a quarter of the eigenperiod.
    """
    pt, T = point(-0.5, h=0.0, f=0.0, clearance=-0.5), 0.5 * math.pi
    for v in (0.02, 0.002, 0.0002):
        t, x, arrival, hit = flight(rule, integrator, -0.5, -v, 0.0, T, pt)
        assert hit and x == -0.5
        assert t == pytest.approx(2.0 * math.atan(v / 0.5), rel=2.0 * v)
        assert arrival == pytest.approx(v, rel=2.0 * v)


@SHORTENING
@SECOND_ORDER
def test_several_impacts_in_one_step_follow_one_another(rule, integrator):
    """Under a constant push every flight is R times as long and as fast as the one before."""
    pt = point(R=0.8, **PUSH)
    x, v, resting, events, rested, status = run(pt, rule, integrator, 0.0, -0.2, CREST, 1.2)
    speeds = 0.2 * 0.8 ** np.arange(len(events))
    assert (events[:, KIND] == IMPACT).all()
    np.testing.assert_allclose(events[:, SPEED], speeds, rtol=1e-7)
    np.testing.assert_allclose(events[:, TIME], np.cumsum(2 * speeds), rtol=1e-7)
    assert len(events) == 4  # 0.4 (1 + .8 + .64 + .512) = 1.1808 < 1.2
    left = 1.2 - 1.1808
    u = 0.2 * 0.8**4
    assert (resting, rested, status) == (False, 0.0, Status.COMPUTED)
    np.testing.assert_allclose([x, v], [-u * left + left**2 / 2, -u + left], rtol=1e-6)


@SHORTENING
def test_a_step_that_ends_on_the_stop_has_its_impact_there_or_in_the_next(rule):
    """No interpolant crosses the stop within it."""
    pt = point(R=0.5, h=0.0, f=0.0, p=1e-9)
    x, v, resting, events, _, status = run(pt, rule, "newmark", -1.0, 1.0, 0.0, 1.0)
    assert (resting, status) == (False, Status.COMPUTED)
    assert x == pytest.approx(0.0, abs=1e-15)
    assert v == pytest.approx(-0.5 if len(events) else 1.0, rel=1e-15)
    assert events[:, [KIND, TIME, SPEED]].tolist() == [[IMPACT, 1.0, 1.0]] * len(events)


def test_a_chatter_needs_a_push_and_time():
    """No rest where the force pulls, where the sum outlasts the step, and none ever at R = 1."""
    pt = point(R=0.8, **PUSH)
    assert to_rest(0.02, CREST, 1.0, 1.0, pt) == pytest.approx(0.2, rel=1e-12)
    assert to_rest(0.02, CREST, 0.1999, 1.0, pt) == math.inf
    assert to_rest(0.02, CREST - math.pi, 1.0, 1.0, pt) == math.inf
    assert to_rest(0.02, CREST, 1.0, 1.0, point(R=1.0, **PUSH)) == math.inf
    # The push ends after 0.1: the sum 0.2 is not reached before it.
    pt = point(R=0.8, h=0.0, omega=1.0, f=1.0)
    a = math.sin(0.1)
    assert to_rest(0.1 * a, 2 * math.pi - 0.1, 5.0, 5.0, pt) == math.inf


@pytest.mark.parametrize(
    ("R", "theta", "other"),
    [(0.3, 4.0, {}), (0.8, 5.5, {"h": 0.7}), (0.6, 3.6, {"h": 0.0, "omega": 3.0}),
     (0.5, 1.0, {"clearance": -1.5, "p": 1.2})],
)  # fmt: skip
def test_the_time_until_a_chatter_is_complete_is_the_sum_of_its_flights(R, theta, other):
    """In 80 digits; what is neglected is less than 1e-10 of the sum."""
    osc = Oscillator(**{"h": 0.1, "R": R, "omega": 1.0, "f": 1.0} | other)
    pt = osc.at(osc.clearance)[0]
    press = pressing(math.sin(theta), pt)
    v = 3e-7 * (1.0 - R) * press
    wait, status = time_to_rest(v, theta, math.sin(theta), math.cos(theta), math.inf, pt)
    with mp.workdps(80):
        start = t = mp.mpf(theta) / osc.omega
        speed = mp.mpf(v)
        while speed > 1e-14 * v:
            flight = Flight(in_digits(osc), t, mp.mpf(osc.clearance), -speed)
            t += mp.findroot(
                lambda length, t=t, x=flight: (x(t + length)[0] - osc.clearance) / length,
                (speed / press, 3 * speed / press),
                solver="anderson",
            )
            speed = mp.mpf(R) * flight(t)[1]
        total = float(t - start)
    assert status == Status.CERTIFIED and wait == pytest.approx(total, rel=1e-10, abs=0)


@ALL
@SHORTENING
@pytest.mark.parametrize("preloads", [0.9, 0.0])
def test_no_rounding_of_the_force_holds_a_released_mass(preloads, rule, integrator):
    """The force at a release is zero to rounding, with either sign; the mass leaves anyway.

    A first-order step sees no other force, and leaves it on the stop, at no speed, until the next
    step; so does the central difference method, but with its speed.
    """
    pressed, T = 0, 0.05
    rng = np.random.default_rng(2)
    ends = [-preloads, 0.1, 0.5, 0.1], [preloads, 3, 2, 0.9]
    for level, f, p, share in rng.uniform(*ends, (150, 4)):
        stop = -level * f / p**2  # pressed by `level` of the force
        pt = Oscillator(h=0.1, R=0.5, omega=1.0, f=f, p=p, clearance=stop).at(stop)[0]
        theta = (math.asin(level) - share * T) % (2 * math.pi)
        step = run(pt, rule, integrator, stop, 0.0, theta, T, resting=True)
        x, v, resting, events, _, status = step
        np.testing.assert_array_equal(events[:, KIND], [RELEASE])
        assert (resting, status) == (False, Status.COMPUTED)
        pressed += pressing(sin_cos(theta + events[0, TIME])[0], pt) > 0.0
        left = T - events[0, TIME]
        speed = f * math.cos(math.asin(level)) * left**2 / 2
        if INTEGRATORS[integrator].order == 1:
            assert -1e-14 * f < v <= 0.0
        else:
            assert v == pytest.approx(-speed, rel=0.1)
        assert 0.0 <= stop - x < 2 * speed * left
    assert pressed > 10


def test_many_preloads_released_on_a_grid_point():
    """At a grid point equal to the release to rounding, the wait is zero or rounding."""
    rng = np.random.default_rng(3)
    for _ in range(1000):
        n = int(rng.integers(8, 400))
        k = int(rng.integers(1, max(2, n // 5)))
        f, p = rng.uniform(0.1, 3.0), rng.uniform(0.3, 4.0)
        theta = 2 * math.pi * k / n
        osc = Oscillator(0.1, 0.5, 1.0, f, p, -f * math.sin(theta) / p**2)
        assert time_to_release(theta, osc.at(osc.clearance)[0]) <= 1e-9


@pytest.mark.slow
def test_a_step_that_surely_has_one_impact_has_it_by_the_rule():
    """Columns take such steps without branches; ``reduced_step`` takes all others.

    Under a constant push: where rounding decides whether a chatter ends with the step or whether a
    rebound is too short, at R = 1, at a turning point, and near overflow.
    """
    rng, surely, scratch = np.random.default_rng(7), 0, new_scratch.py_func()
    method = REDUCED_STEP, INTEGRATORS["newmark"].code
    for _ in range(2_500):
        R, v = rng.choice([0.3, 0.9, 1.0 - 1e-9, 1.0]), 10.0 ** rng.uniform(-3.0, 0.5)
        T, share = rng.uniform(0.01, 0.5), rng.uniform(0.01, 0.99)
        in_time = 2.0 * R * v / max((1.0 - R) * T * (1.0 - share), 1e-9)
        too_short = 2.0 * R * v / (SHORTEST_FLIGHT * T)
        push = rng.choice([in_time, too_short * 1.001, too_short * 0.999, v * rng.random()])
        size = rng.choice([1.0, 1.0, 1e150, 4e307])
        pt = point(R=R, **(PUSH | {"f": min(push, 1e300 / size) * size}))
        turning = v * (1.0 - 1.0 / share) * (1.0 + rng.normal() * 1e-6)  # for which v_Tr is tiny
        start = -size * v * T * share, size * v
        end = size * v * T * (1.0 - share), size * max(rng.choice([v, v, turning]), -4.0)
        phase = CREST, *sin_cos(CREST)
        T_r, v_Tr, _, _, sure = single_linear_impact(*start, *end, CREST, T, pt)
        if sure:
            surely += 1
            n = reduced_step(method, (*start, False), end, phase, T, pt, scratch)[3]
            events = scratch.events[:n]
            assert events[0].tolist() == [IMPACT, T_r, v_Tr, 0.0]
            assert n == 1 or events[1, KIND] == IMPACT
    assert 375 < surely < 2_125
