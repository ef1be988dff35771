"""The exact rule against certified orbits, closed forms and tables."""

import itertools
import math

import numpy as np
import pytest

from vibroimpact import Oscillator, Status, integrate, simulate
from vibroimpact.step.scheme import default_steps

PERIOD = 2.0 * math.pi
GRAZES = ["graze_first_exact30", "graze_first_minus", "graze_first_minus6", "graze_first_plus6"]
PLAIN_CASES = [
    "paper_A", "paper_B", "paper_C", "stick_R03_w03", "stick_hiw_S2", "stick_S26", "res_R1_w2",
    "cons_R1_w1", "over_h2_stick", "crit_h1_w1", "w10", "x0_m1", "v0_p1", "unscaled",
    "graze_po_below", "graze_po_below5", "graze_po_above",
]  # fmt: skip


def run(orbit, periods=20, n=None):
    periods = min(periods, len(orbit.sections))
    return simulate(orbit.oscillator, periods, steps_per_period=n, x0=orbit.x0, v0=orbit.v0)


def errors(tr, orbit):
    """Return errors of sections, impacts (by nearest time) and rests over max(1, |value|)."""

    def relative(ours, true):
        return np.abs(ours - true) / np.maximum(1.0, np.abs(true))

    true = orbit.sections[: len(tr.section_x)]
    sections = relative(np.column_stack([tr.section_x, tr.section_v]), true).max(axis=1)
    end = len(true) * orbit.oscillator.forcing_period
    # The record ends with its last step: an impact within rounding of it may be on either side.
    known = orbit.impact_t < end * (1 - 1e-12)
    all_listed = orbit.impact_t[-1] + orbit.oscillator.forcing_period * 2 > end
    rests = orbit.rests[orbit.rests[:, 0] < end]
    t, v = orbit.impact_t[known], orbit.impact_v[known]
    if len(rests):
        # Impacts below the cut-off of the tail are not followed.
        t, v = t[v > 1e-4], v[v > 1e-4]
    if not len(t):
        return sections, np.zeros(0), np.zeros(0)
    nearest = np.abs(tr.impact_t[:, None] - t).argmin(axis=0)
    assert (np.diff(nearest) > 0).all(), "one impact for two"
    impacts = np.maximum(relative(tr.impact_t[nearest], t), relative(tr.impact_v[nearest], v))
    if not len(rests) and all_listed:
        assert len(tr.impact_t[tr.impact_t < end * (1 - 1e-12)]) == len(t), "another number"
    assert len(tr.rests) == len(rests)
    ours = np.minimum(tr.rests, end)
    return sections, impacts, relative(ours, np.minimum(rests, end)).ravel()


@pytest.mark.parametrize("case", PLAIN_CASES)
@pytest.mark.parametrize("more", [0, 7, 250])
def test_certified_orbits_to_rounding(truth, case, more):
    """20 periods: sections, impacts, accumulations and releases to 1e-12, at any step."""
    orbit = truth[case]
    n = default_steps(orbit.oscillator.at(orbit.x0), "exact") + more
    tr = run(orbit, n=n)
    found = max(float(e.max(initial=0.0)) for e in errors(tr, orbit))
    # stick_S26 multiplies a rounding by thousands on the way: nine times the steps, more of them.
    assert found <= (3e-12 if (case, more) == ("stick_S26", 250) else 1e-12)
    assert tr.status is Status.CERTIFIED
    assert tr.max_penetration == 0.0


@pytest.mark.parametrize("n", [None, 64, 301])
@pytest.mark.parametrize("case", GRAZES)
def test_at_a_graze_the_error_is_the_root_of_a_rounding(truth, case, n):
    """1e-12 up to the touch; then the effect of a rounding of the height on the speed there.

    The speed of a touch of depth d is sqrt(2 a d): an error e of the height is one of a e / v, or
    of sqrt(2 a e) where v itself is smaller. The impact passes on 1 + R of it, and the motion
    multiplies it, like every rounding, by exp(0.45) in a period. More steps round more often.
    """
    orbit, rounding = truth[case], 1e-15 * max(1.0, (n or 0) / 32)
    tr = run(orbit, n=n)
    osc = orbit.oscillator
    touched = tr.impact_t[0] < 3.0
    assert touched == (case.endswith("minus") or case.endswith("minus6")) or "exact" in case
    found = np.abs(np.column_stack([tr.section_x, tr.section_v]) - orbit.sections).max(axis=1)
    assert found[0] <= 4 * rounding
    left = rounding
    if touched:
        a, v = abs(math.sin(osc.omega * 2.836)), tr.impact_v[0]
        known = orbit.impact_v[0] if "exact" not in case else 0.0
        jump = min(a * rounding / v, math.sqrt(2 * a * rounding))
        assert abs(v - known) <= jump
        assert abs(tr.impact_t[0] - orbit.impact_t[0]) <= jump / a or "exact" in case
        left += (1 + osc.R) * jump
    k = np.arange(len(found))
    assert (found <= 8 * left * np.exp(0.45 * k)).all()
    assert tr.status is Status.CERTIFIED


@pytest.mark.parametrize("n", [None, 50, 128])
def test_in_chaos_the_error_grows_with_the_lyapunov_exponent(truth, n):
    """exp(0.40) in a period from one rounding: 50 periods within a factor of ten of that."""
    orbit = truth["chaos_1"]
    tr = run(orbit, 50, n)
    found = np.abs(np.column_stack([tr.section_x, tr.section_v]) - orbit.sections[:50]).max(axis=1)
    rounding = 1e-15 * max(1.0, (n or 0) / 32)
    assert (found <= 10 * rounding * np.exp(0.40 * np.arange(1, 51))).all()
    assert found[-10:].max() > 1e-10


#: R above which the chatter of omega = 1 is not complete, by h.
THRESHOLDS = {0.5: 0.4693426554, 0.1: 0.2977071082, 0.0: 0.2495468963}


@pytest.mark.parametrize(("h", "threshold"), THRESHOLDS.items())
@pytest.mark.parametrize("n", [None, 64])
def test_the_chatter_is_complete_below_the_threshold_and_not_above(h, threshold, n):
    for R, rests in ((threshold - 1e-9, True), (threshold + 1e-9, False)):
        osc = Oscillator(h=h, R=R, omega=1.0, f=1.0)
        out = integrate(osc.at(), transient=200, periods=20, steps_per_period=n)
        assert (out["rest_fraction"] > 0.0) == rests
        assert out["chatters"] == (20 if rests else 0)
        assert out["status"] == Status.CERTIFIED


@pytest.mark.parametrize(
    ("omega", "amplitude", "landing", "release", "period"),
    [(3.0, 0.5, math.pi, 4 * math.pi / 3, 2), (1 / 3, 1.5, 3 * math.pi, 6 * math.pi, 1)],
)
@pytest.mark.parametrize("R", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("n", [None, 99, 1000])
def test_a_tangential_landing(R, omega, amplitude, landing, release, period, n):
    """x = -c sin^3 to a landing with x = v = a = 0, known to the cube root of a rounding.

    What rounding leaves of speed there is given up in a chatter, the longer the nearer R is to 1.
    """
    osc = Oscillator(h=0.0, R=R, omega=omega, f=1.0)
    tr = simulate(osc, 4, steps_per_period=n)
    k = np.arange(4 // period) * osc.forcing_period * period
    assert tr.rests.shape == (4 // period, 2)
    np.testing.assert_allclose(tr.rests[:, 0] - k, landing, atol=5e-5 / (1 - R))
    np.testing.assert_allclose(tr.rests[:, 1] - k, release, atol=1e-12)
    assert tr.impact_v.max(initial=0.0) < 1e-9
    flight = tr.t < landing - 1e-3
    cube = -amplitude * np.sin(min(omega, 1.0) * tr.t[flight]) ** 3
    np.testing.assert_allclose(tr.x[flight], cube, atol=1e-14 * (1 + (n or 0) / 32))


@pytest.mark.parametrize(
    ("h", "R", "omega", "clearance"),
    [(0.0, 0.3, 0.3, 0.0), (2.0, 0.7, 0.5, 0.0), (0.1, 0.5, 1.0, -0.6), (0.1, 0.3, 3.1, 0.0)],
)
@pytest.mark.parametrize("phase", [0.0, 1.0, 3.5])
def test_a_sleeping_lane_wakes_in_time(h, R, omega, clearance, phase):
    """The fraction at rest is the sum of the rests of `simulate`, whatever the section's phase."""
    osc = Oscillator(h=h, R=R, omega=omega, f=1.0, clearance=clearance)
    tr = simulate(osc, 12, x0=min(clearance, 0.0))
    out = integrate(osc.at(min(clearance, 0.0)), transient=2, periods=6, phase=phase)
    begin = (phase + 2 * PERIOD) / omega
    end = begin + 6 * osc.forcing_period
    slept = np.minimum(tr.rests[:, 1], end) - np.maximum(tr.rests[:, 0], begin)
    fraction = np.maximum(slept, 0.0).sum() / (end - begin)
    assert fraction > 0.01
    assert out["rest_fraction"][0] == pytest.approx(fraction, abs=1e-12)


def test_without_restitution_and_near_it():
    """R = 0 lands once per rest; R one rounding below 1 still ends, decided."""
    values = itertools.product((0.0, 1e-300, 1 - 1e-16, 1.0), (0.3, 2.9))
    points = np.concatenate([Oscillator(0.1, R, omega, 1.0).at() for R, omega in values])
    out = integrate(points, transient=0, periods=30)
    assert np.isfinite(out["poincare_x"]).all()
    assert np.isin(out["status"], (Status.CERTIFIED, Status.CUT_SHORT)).all()
    assert (out["status"][:4] == Status.CERTIFIED).all()


def test_an_impact_on_a_grid_point_is_found_once():
    """Free flights built to end on grid points: speeds fall by R, every half period."""
    rng = np.random.default_rng(4)
    n = 20
    for _ in range(400):
        R, v, k = rng.uniform(0.2, 0.9), rng.uniform(0.5, 2.0), rng.integers(2, 9)
        t = k * 2 * math.pi / n  # x = -v sin(t1 - t), so that the mass meets the stop at t1 = t
        osc = Oscillator(h=0.0, R=R, omega=1.0, f=0.0)
        tr = simulate(osc, 2, steps_per_period=n, x0=-v * math.sin(t), v0=v * math.cos(t))
        np.testing.assert_allclose(tr.impact_v, v * R ** np.arange(len(tr.impact_v)), rtol=1e-12)
        np.testing.assert_allclose(np.diff(tr.impact_t), math.pi, rtol=1e-12)


def test_a_landing_where_the_force_begins_to_press_rests_at_once():
    """R = 0 and a = 0 at the impact, rising: the sign of a is rounding, the rest is not."""
    osc = Oscillator(h=0.0, R=0.0, omega=0.8185075226222658, f=1.0, clearance=-0.42643709466936797)
    x0, v0 = -1.0717232609276621, -1.2581404087885597
    tr = simulate(osc, 3, x0=x0, v0=v0)
    assert tr.status is Status.CERTIFIED
    out = integrate(osc.at(x0, v0), transient=0, periods=3)
    assert out["status"][0] == Status.CERTIFIED
    assert out["chatters"][0] == len(tr.rests) <= 4


@pytest.mark.parametrize("transient", [0, 200, 3000])
def test_a_resonance_without_loss_is_called_unbounded(transient):
    """omega = 2 k p with p^2 |clearance| (4 k^2 - 1) < f: the speed rises for ever."""
    limits, points = np.array([0.0, 0.9, -0.9, 1.1, -1.1]), []
    for k, p, share in itertools.product((1, 2, 3), (1.0, 1000.0, 1.3), limits.tolist()):
        stop = share / (p * p * (4 * k * k - 1))
        points.append(Oscillator(0.0, 1.0, 2 * k * p, 1.0, p, stop).at(min(stop, 0.0)))
    points = np.concatenate(points)
    out = integrate(points, transient=transient, periods=100)
    grows = np.tile(np.abs(limits) < 1.0, 9)
    np.testing.assert_array_equal(out["status"] == Status.UNBOUNDED, grows)


def test_bounded_motion_without_loss_is_not_called_unbounded():
    """R = 1 and h = 0: off the resonance, beats, a short record, a motion without impacts."""
    values = itertools.product((1.7, 2.001, 2.01, 2.9, 3.3), (0.0, 1.0))
    points = np.concatenate([Oscillator(0.0, 1.0, omega, f).at(-0.5) for omega, f in values])
    for record in ({"transient": 0, "periods": 100}, {"transient": 300, "periods": 300}):
        assert (integrate(points, **record)["status"] != Status.UNBOUNDED).all()
    beat = Oscillator(0.0, 1.0, 2.3, 1.0).at()
    assert integrate(beat, transient=0, periods=9)["status"][0] == Status.CERTIFIED
    far = Oscillator(0.0, 1.0, 1.001, 1.0, clearance=1e4).at()
    assert integrate(far, transient=0, periods=100)["status"][0] == Status.CERTIFIED


def test_a_forcing_too_slow_for_exact_impacts_is_refused():
    """The number of steps per period would be unlimited."""
    for omega in (1e-12, 1e-310):
        with pytest.raises(ValueError, match="omega is too small"):
            simulate(Oscillator(0.1, 0.8, omega, 1.0))
