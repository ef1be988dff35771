"""What becomes of one step that meets the stop, and of a mass that rests on it."""

import math

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from vibroimpact import Oscillator, simulate
from vibroimpact.status import Status
from vibroimpact.step.contact import (
    IMPACT,
    KIND,
    RELEASE,
    REST,
    SPEED,
    TIME,
    new_scratch,
    pressing,
    start,
    time_to_release,
)
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.scheme import CUBIC, IMPACT_RULES, REDUCED_STEP
from vibroimpact.step.time_stepping import (
    crossed,
    fly,
    plain,
    reduced_step,
    time_to_rest,
)
from vibroimpact.step.trigonometry import sin_cos

ALL = pytest.mark.parametrize("integrator", INTEGRATORS)
# Those that are exact under a constant push, which a rebound within one step needs.
PARABOLIC = [name for name, row in INTEGRATORS.items() if row.order != 1]
SECOND_ORDER = pytest.mark.parametrize("integrator", PARABOLIC)
# The rules that shorten a step.
SHORTENING = pytest.mark.parametrize("rule", [REDUCED_STEP, CUBIC], ids=["reduced-step", "cubic"])
# Nearly constant acceleration: the force stands at its crest, and nothing else acts.
PUSH = {"h": 0.0, "omega": 1e-9, "f": 1.0, "p": 1e-9}
CREST = 1.5 * math.pi


def point(x0=0.0, v0=0.0, **parameters):
    """A parameter point."""
    return Oscillator(**{"h": 0.1, "R": 0.5, "omega": 1.0, "f": 1.0} | parameters).at(x0, v0)[0]


def preload(level, f=1.0, p=1.0, omega=1.0):
    """A mass pressed against the stop by `level` of the force, p^2 clearance = -level f."""
    clearance = -level * f / p**2
    return Oscillator(h=0.1, R=0.5, omega=omega, f=f, p=p, clearance=clearance)


def run(pt, rule, integrator, x, v, theta, T, resting=False):
    """One step with impacts: state, rest, the rows of its events, time rested and status."""
    scratch, chosen = new_scratch(), INTEGRATORS[integrator]
    s, c = math.sin(theta), math.cos(theta)
    end = chosen.step(x, v, s, c, T, pt)
    x, v, resting, n, rested, status = reduced_step(
        (rule, chosen.code), (x, v, resting), end, (theta, s, c), T, pt, scratch
    )
    return x, v, resting, scratch.events[:n], rested, status


def flight(rule, integrator, x, v, theta, span, pt):
    """One flight of at most `span`: time, state, and whether it ended on the stop."""
    chosen, s, c = INTEGRATORS[integrator], math.sin(theta), math.cos(theta)
    end = chosen.step(x, v, s, c, span, pt)
    return fly((rule, chosen.code), (x, v, s, c), end, span, pt, new_scratch().coefficients)[:4]


def to_rest(v, theta, left, T, pt):
    """Time until the chatter is complete."""
    return time_to_rest(v, theta, math.sin(theta), left, T, pt)


@SECOND_ORDER
@SHORTENING
def test_the_flight_under_a_constant_push_is_a_parabola(rule, integrator):
    """It returns after 2 u / a at the speed u it left with, whatever the length of the step."""
    pt = point(R=0.5, **PUSH)
    for u, span in ((0.3, 1.0), (0.01, 1.0), (1e-6, 1.0), (0.4999, 1.0), (3.0, 7.5)):
        dt, x, v, hit = flight(rule, integrator, 0.0, -u, CREST, span, pt)
        assert (hit, x) == (True, 0.0)
        assert (dt, v) == (pytest.approx(2 * u, rel=1e-8), pytest.approx(u, rel=1e-8))


@SECOND_ORDER
@SHORTENING
def test_a_flight_longer_than_the_step_ends_with_it(rule, integrator):
    """No impact is invented: 2 u / a is just beyond the span."""
    dt, x, _, hit = flight(rule, integrator, 0.0, -0.51, CREST, 1.0, point(**PUSH))
    assert (hit, dt) == (False, 1.0)
    assert x == pytest.approx(-0.01, rel=1e-6)


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


@ALL
def test_equations_6_to_9(integrator):
    """Away from the stop the impact lies on the chord of x, its speed on the chord of v."""
    pt = point(h=0.2, clearance=0.3)
    row = INTEGRATORS[integrator]
    x, v, theta, T = 0.2, 0.9, 0.7, 0.25
    x_T, v_T = row.step(x, v, math.sin(theta), math.cos(theta), T, pt)
    T_r = T * (0.3 - x) / (x_T - x)
    dt, at, speed, hit = flight(REDUCED_STEP, integrator, x, v, theta, T, pt)
    assert (hit, at) == (True, 0.3)
    assert dt == pytest.approx(T_r, rel=1e-14)
    assert speed == pytest.approx(v + (v_T - v) * T_r / T, rel=1e-14)


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


@pytest.mark.parametrize(
    ("start_x", "integrator"),
    [(0.2, name) for name in INTEGRATORS] + [(0.3, name) for name in PARABOLIC],
)
def test_the_cubic_rule_is_the_root_of_the_hermite_interpolant(start_x, integrator):
    """Time: scipy's interpolant of the step; speed: that of a step of that length, no chord."""
    pt = point(h=0.2, clearance=0.3, f=3.0)
    row = INTEGRATORS[integrator]
    x, v, theta, T = start_x, 0.9 if start_x < 0.3 else -0.2, 4.0, 0.25
    x_T, v_T = row.step(x, v, math.sin(theta), math.cos(theta), T, pt)
    assert x_T > 0.3
    roots = CubicHermiteSpline([0.0, T], [x, x_T], [v, v_T]).solve(0.3, extrapolate=False)
    T_r = roots[roots > 1e-9][0]
    dt, at, speed, hit = flight(CUBIC, integrator, x, v, theta, T, pt)
    assert (hit, at) == (True, 0.3)
    assert dt == pytest.approx(T_r, rel=1e-13)
    short = row.step(x, v, math.sin(theta), math.cos(theta), T_r, pt)
    assert speed == pytest.approx(short[1], rel=1e-13)


@SECOND_ORDER
@SHORTENING
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


@SECOND_ORDER
@SHORTENING
@pytest.mark.parametrize("R", [0.0, 0.3, 0.8])
def test_a_chatter_that_ends_within_the_step_ends_at_its_geometric_sum(rule, integrator, R):
    """2 v / (a (1 - R)) after the first rebound, then rest to the end of the step."""
    pt = point(R=R, **PUSH)
    u = 0.02
    x, v, resting, events, rested, status = run(pt, rule, integrator, 0.0, -u, CREST, 1.0)
    assert (x, v, resting, status) == (0.0, 0.0, True, Status.COMPUTED)
    (rest,) = events[events[:, KIND] == REST]
    assert rest[TIME] == pytest.approx(2 * u / (1 - R), rel=1e-7)
    assert rested == pytest.approx(1.0 - 2 * u / (1 - R), rel=1e-9)


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


def test_the_plain_rule():
    """Position to the stop, velocity turned; a mass that already leaves is left alone."""
    pt = point(R=0.6, clearance=0.25)
    scratch = new_scratch()
    assert plain(0.31, 1.5, 0.1, pt, scratch) == (0.25, -0.6 * 1.5, 1)
    np.testing.assert_array_equal(scratch.events[0], [IMPACT, 0.1, 1.5, 0.31])
    assert plain(0.31, -1.5, 0.1, pt, scratch) == (0.31, -1.5, 0)
    assert plain(0.31, 0.0, 0.1, pt, scratch) == (0.31, 0.0, 0)


def test_what_counts_as_crossing():
    """On the stop only a mass that still approaches; beyond it any."""
    assert crossed(0.1, -1.0, 0.0)
    assert crossed(0.0, 1e-300, 0.0)
    assert not crossed(0.0, 0.0, 0.0)
    assert not crossed(0.0, -1.0, 0.0)
    assert not crossed(-1e-300, 1.0, 0.0)


def test_the_rule_on_the_start():
    """An approach on the stop is an impact at once; pressed and at rest is rest."""
    assert start(point(v0=1.0, R=0.8), 0.0) == (0.0, -0.8, False)
    assert start(point(v0=-1.0, R=0.8), 0.0) == (0.0, -1.0, False)
    assert start(point(x0=-0.1, v0=1.0), 0.0) == (-0.1, 1.0, False)
    assert start(point(), 0.0) == (0.0, 0.0, False)
    assert start(point(x0=-0.5, clearance=-0.5), 0.0) == (-0.5, 0.0, True)
    assert start(point(x0=0.5, clearance=0.5), 0.0) == (0.5, 0.0, False)
    assert start(point(), 1.0) == (0.0, 0.0, False)  # later in the period the force pulls
    assert start(point(), -1.0) == (0.0, 0.0, True)  # or presses


@pytest.mark.parametrize("level", [-0.9, -0.3, 0.0, 0.3, 0.9, 0.999999])
def test_the_push_ends_where_the_force_balances_the_spring(level):
    """sin(omega t) = level, rising, is the release; the way there is exact from any phase."""
    f, p, omega = 0.7, 1.3, 2.1
    osc = preload(level, f, p, omega)
    pt = osc.at(osc.clearance)[0]
    turn = math.asin(level)
    # Near the crest the arcsine of a rounded level is known to the root of a rounding only.
    sharp = 1e-15 / math.sqrt(1.0 - level**2)
    for share in (0.01, 0.3, 0.5, 0.8, 0.99):
        theta = turn - share * (math.pi + 2 * turn)  # the push began pi + 2 turn earlier
        assert pressing(math.sin(theta), pt) > 0.0
        wait = time_to_release(theta, pt)
        assert wait * omega == pytest.approx(turn - theta, abs=8 * sharp)
        turns = 14 * math.pi
        assert time_to_release(theta + turns, pt) == pytest.approx(wait, abs=50 * sharp)
    for share in (0.01, 0.5, 0.99):
        assert time_to_release(turn + share * (math.pi - 2 * turn), pt) == 0.0


def test_a_preload_beyond_the_force_never_releases():
    """|p^2 clearance| >= f, at the phase where they balance, too."""
    for p, f in ((1.0, 1.0), (0.7, 1.3), (1.9, 0.1), (1.3, 2.2)):
        osc = Oscillator(h=0.1, R=0.5, omega=1.0, f=f, p=p, clearance=-f / (p * p))
        for theta in (0.0, 0.5 * math.pi - 1e-9, 0.5 * math.pi, 1.6, 4.7):
            assert time_to_release(theta, osc.at(osc.clearance)[0]) == math.inf
    for p, f in ((1.0, 1.0), (0.7, 1.3)):  # a force that only just does not press
        osc = Oscillator(h=0.1, R=0.5, omega=1.0, f=f, p=p, clearance=f / (p * p))
        assert time_to_release(1.5 * math.pi, osc.at(osc.clearance)[0]) == 0.0
    osc = preload(1.000001)
    assert time_to_release(0.3, osc.at(osc.clearance)[0]) == math.inf
    osc = Oscillator(h=0.1, R=0.5, omega=1.0, f=0.0, clearance=-1.0)
    assert time_to_release(0.3, osc.at(-1.0)[0]) == math.inf


@ALL
@SHORTENING
def test_a_resting_mass_is_released_at_the_phase_not_at_the_step(rule, integrator):
    """The flight after it starts at the release, and is the free flow from there."""
    osc = preload(0.4)
    pt = osc.at(osc.clearance)[0]
    turn, T = math.asin(0.4), 0.05
    x, v, resting, events, rested, _ = run(
        pt, rule, integrator, osc.clearance, 0.0, turn - 0.02, T, resting=True
    )
    np.testing.assert_allclose(events[:, [KIND, TIME]], [[RELEASE, 0.02]], rtol=1e-12)
    assert not resting
    assert rested == pytest.approx(0.02, rel=1e-12)
    s, c = math.sin(turn), math.cos(turn)
    true = INTEGRATORS[integrator].step(osc.clearance, 0.0, s, c, T - 0.02, pt)
    np.testing.assert_allclose([x, v], true, atol=1e-14)


@ALL
@SHORTENING
@pytest.mark.parametrize("preloads", [0.9, 0.0])
def test_no_rounding_of_the_force_holds_a_released_mass(preloads, rule, integrator):
    """The force at a release is zero to rounding, of either sign: the mass leaves all the same.

    A first-order step sees no other force, and leaves it on the stop, at no speed, until the next
    step; so does the central difference method, but with its speed.
    """
    pressed, T = 0, 0.05
    rng = np.random.default_rng(2)
    for level, f, p, share in rng.uniform(
        [-preloads, 0.1, 0.5, 0.1], [preloads, 3, 2, 0.9], (300, 4)
    ):
        osc = preload(level, f, p)
        pt = osc.at(osc.clearance)[0]
        theta = (math.asin(level) - share * T) % (2 * math.pi)
        x, v, resting, events, _, status = run(
            pt, rule, integrator, osc.clearance, 0.0, theta, T, resting=True
        )
        np.testing.assert_array_equal(events[:, KIND], [RELEASE])
        assert (resting, status) == (False, Status.COMPUTED)
        pressed += pressing(sin_cos(theta + events[0, TIME])[0], pt) > 0.0
        left = T - events[0, TIME]
        speed = f * math.cos(math.asin(level)) * left**2 / 2
        if INTEGRATORS[integrator].order == 1:
            assert -1e-14 * f < v <= 0.0
        else:
            assert v == pytest.approx(-speed, rel=0.1)
        assert 0.0 <= osc.clearance - x < 2 * speed * left
    assert pressed > 20


@pytest.mark.parametrize(
    ("n", "k", "f", "p", "clearance"),
    [
        (8, 1, 2.5382285995736282, 3.4178651660301327, -0.1536405607558272),
        (18, 2, 2.9079824415767264, 2.9383714824597886, -0.21649400556164156),
        (150, 23, 1.0776065690382595, 0.6208756240970634, -2.295477763116044),
    ],
)
def test_a_release_on_a_grid_point_is_not_a_step_late(n, k, f, p, clearance):
    """Release at phase 2 pi k / n to rounding: neither a period nor a step may be added."""
    osc = Oscillator(h=0.1, R=0.5, omega=1.0, f=f, p=p, clearance=clearance)
    tr = simulate(osc, 1, "exact", "reduced-step", n, x0=clearance)
    assert tr.rests[0, 1] == pytest.approx(2 * math.pi * k / n, rel=1e-12)


def test_many_preloads_released_on_a_grid_point():
    """At a grid point that is the release to rounding the wait is none, or rounding."""
    rng = np.random.default_rng(3)
    late = 0
    for _ in range(20000):
        n = int(rng.integers(8, 400))
        k = int(rng.integers(1, max(2, n // 5)))
        f, p = rng.uniform(0.1, 3.0), rng.uniform(0.3, 4.0)
        theta = 2 * math.pi * k / n
        osc = Oscillator(0.1, 0.5, 1.0, f, p, -f * math.sin(theta) / p**2)
        late += time_to_release(theta, osc.at(osc.clearance)[0]) > 1e-9
    assert late == 0


def test_the_table_of_rules():
    """Every rule has its own code and its order."""
    codes = [rule.code for rule in IMPACT_RULES.values()]
    assert sorted(codes) == list(range(len(codes)))
    assert IMPACT_RULES["plain"].order == 1
    assert IMPACT_RULES["reduced-step"].order == 2
    assert IMPACT_RULES["cubic"].order == 4
    assert IMPACT_RULES["exact"].order is None
