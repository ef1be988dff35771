"""Where motions go: the class of a record, and the evidence for the orbit that is approached."""

from dataclasses import replace

import numpy as np
import pytest

from tests.helpers import naive
from tests.helpers.kernel_cases import integrated
from tests.helpers.oscillators import bifurcation
from vibroimpact import Oscillator, integrate, one_impact_orbit
from vibroimpact.destination.repetition import LONGEST_PERIOD, TOLERANCE
from vibroimpact.points.computation import classified_later
from vibroimpact.points.stages import RunSpec
from vibroimpact.status import Evidence
from vibroimpact.step.scheme import default_steps

#: A point whose stop is at the rest position: only the sections decide.
FREE = Oscillator(h=0.1, R=0.5, omega=1.0, f=1.0).at()


def spec_of(
    points, impact="exact", transient=200, periods=100, phase=0.0, integrator="exact",
    longest=None, impacts=0, steps=None,
):  # fmt: skip
    """Return what is computed of each point, by default with the least steps of the points."""
    return RunSpec(
        integrator, impact, steps or default_steps(points, impact), transient, longest, periods,
        phase, impacts, False, True, None, False, None, (),
    )  # fmt: skip


def run(points, impact="exact", threads=None, **options):
    """Compute points from their starts; return the specification and the results with classes."""
    spec = spec_of(points, impact, **options)
    method = spec.integrator, spec.impact, spec.steps_per_period, spec.transient
    record = {"periods": spec.periods, "phase": spec.phase, "impacts": 0}
    results = integrated(points, *method, **record, threads=threads)
    return spec, classified_later(spec, points, results, threads)


def record_class(points, x, v, impacts_per_period):
    """Return m of made-up records, for an impact rule that has nothing but the record."""
    n = len(points)
    results = {
        "poincare_x": x, "poincare_v": v, "impacts_per_period": impacts_per_period,
        "rest_fraction": np.zeros(n), "chatters": np.zeros(n, int), "status": np.zeros(n, int),
    }  # fmt: skip
    out = classified_later(spec_of(points, "plain"), points, results)
    return out["period"]


def cycle(m, periods, seed=0):
    values = np.random.default_rng(seed).normal(size=(2, m))
    return np.array([[np.resize(q, periods)] for q in values])


@pytest.mark.parametrize("m", [1, 2, 3, 8, 63, 64])
def test_made_up_cycles(m):
    """The least period, in records of whole repetitions and of others."""
    for periods in (3 * m, 2 * m + 3):
        assert record_class(FREE, *cycle(m, periods), np.array([3.0 / m])) == m


def test_what_is_no_cycle():
    """Noise, NaN, a period longer than half the record or than the bound."""
    noise = np.random.default_rng(0).normal(size=(2, 1, 200))
    assert record_class(FREE, *noise, np.array([1.0])) == 0
    lost = np.full((2, 1, 50), np.nan)
    assert record_class(FREE, *lost, np.array([np.nan])) == 0
    x, v = cycle(10, 19)
    x += 1e-12 * np.arange(19)
    assert record_class(FREE, x, v, np.array([1.0])) == 0
    x, v = cycle(LONGEST_PERIOD + 1, 4 * LONGEST_PERIOD)
    assert record_class(FREE, x, v, np.array([1.0])) == 0


@pytest.mark.parametrize("m", [2, 10, 39, 64])
def test_a_cycle_that_came_back_is_found_wherever_it_fits(m):
    """Whatever was before it, and for every length of the record that is longer."""
    x, v = cycle(m, m + 1)
    assert record_class(FREE, x, v, np.array([1.0])) == m
    before = np.random.default_rng(m).normal(size=(2, 1, 7))
    x, v = np.concatenate([before, [x, v]], axis=2)
    assert record_class(FREE, x, v, np.array([1.0])) == m


def test_the_tolerance_is_a_share_of_the_greatest():
    """Half of it passes, twice it does not; x and v have each their own; rest is period 1."""
    for scale in (1e-9, 1.0, 1e9):
        for factor, m in ((0.5, 1), (2.0, 2)):
            x = scale * np.array([[1.0, 1.0 + factor * TOLERANCE] * 10])
            other = np.full((1, 20), 100.0 * scale)
            assert record_class(FREE, x, other, np.array([1.0])) == m
            assert record_class(FREE, other, x, np.array([1.0])) == m
    zero = np.zeros((1, 20))
    assert record_class(FREE, zero, zero, np.array([0.0])) == 1


@pytest.mark.parametrize("x0", [0.3, 0.0, -0.4])
@pytest.mark.parametrize(("h", "omega", "p"), [(0.05, 0.7, 1.0), (0.3, 2.0, 0.2), (4.0, 1.1, 2.0)])
def test_without_a_force_the_mass_ends_at_its_rest_position(h, omega, p, x0):
    """Its sections then show only rounding of the clearance."""
    points = Oscillator(h=h, R=0.5, omega=omega, f=0.0, p=p, clearance=0.3).at(x0, 0.0)
    _, out = run(points, transient=400, periods=32)
    assert np.abs([out["poincare_x"], out["poincare_v"]]).max() < 1e-14
    assert (out["period"], out["period_impacts"]) == (1, 0)
    assert (out["class_evidence"], out["orbit_x"], out["orbit_v"]) == (Evidence.FREE, 0.0, 0.0)


def test_a_small_motion_under_a_large_clearance_is_no_rounding():
    """A forced motion of 1e-8 of the clearance still has its period, and noise of 1e-9 has none."""
    points = Oscillator(h=0.1, R=0.5, omega=1.0, f=1.0, clearance=2.0).at()
    x, v = cycle(3, 30)
    ones = np.ones(1)
    assert record_class(points, 2e-8 * x, 2e-8 * v, ones) == 3
    noise = 2e-9 * np.random.default_rng(0).normal(size=(2, 1, 100))
    assert record_class(points, *noise, ones) == 0


@pytest.mark.parametrize("multiplier", [-0.9999, 0.9999, -1.0001])
def test_a_motion_that_still_settles_repeats_nothing(multiplier):
    """Each section equals the one two periods before it to 2e-7; over the record it does not."""
    n = np.arange(100)
    x = (1.0 + 1e-3 * multiplier**n)[None]
    assert np.abs(x[:, 2:] - x[:, :-2]).max() < TOLERANCE
    assert record_class(FREE, x, np.ones((1, 100)), np.array([1.0])) == 0


@pytest.mark.parametrize("turns", [2, 3])
def test_a_spiral_that_shrinks_is_not_a_cycle_of_its_turns(turns):
    """Where it is of the size of the tolerance, it is off by more than it, and then by less."""
    n = np.arange(100)
    x = 1.0 + 0.75 * TOLERANCE * 0.97**n * np.cos(2.0 * np.pi * n / turns)
    assert np.abs(x - np.resize(x[:turns], 100)).max() < TOLERANCE < np.ptp(x)
    assert record_class(FREE, x[None], np.ones((1, 100)), np.array([1.0])) == 0


def computed(osc, transient=2000, periods=128, x0=0.0, v0=0.0):
    """Return the class and the last four impact speeds."""
    points = osc.at(x0, v0)
    _, out = run(points, transient=transient, periods=periods)
    speeds = integrate(points, transient=transient, periods=periods, impacts=4)["impact_v"]
    return int(out["period"][0]), int(out["period_impacts"][0]), np.sort(speeds[0])


def on_the_orbit(osc, n, aside=0.0):
    """Return the state at phase 0 of the closed-form orbit with one impact in n periods."""
    orbit = one_impact_orbit(osc, n)
    x, v = naive.after_impact(osc, n, orbit.v, orbit.phase, 0.0)[0]
    return x, v + aside


@pytest.mark.parametrize(
    ("omega", "m", "q", "v"),
    [
        (2.64, 1, 1, [0.46237772] * 4),
        (2.66, 2, 2, [0.448921, 0.448921, 0.451823, 0.451823]),
        (2.70, 2, 2, None),
        (2.80, 0, 0, None),
    ],
)
def test_after_the_upper_edge(omega, m, q, v):
    """h = 0, R = 0.8: period 1, twice 2, then none; speeds as printed.

    From beside the orbit: from zero the mass comes to rest at 2.66, in a cycle of 6 periods.
    """
    osc = Oscillator(h=0.0, R=0.8, omega=omega, f=1.0)
    x0, v0 = on_the_orbit(osc, 1, 1e-4)
    found = computed(osc, 8000, 128, x0, v0)
    assert found[:2] == (m, q)
    if v:
        np.testing.assert_allclose(found[2], v, atol=1e-8 if m == 1 else 6e-7)


def test_known_cycles():
    """The paper's cases, n = 2, the attractor with three impacts in one period, and a rest."""
    for h, R, q in ((0.5, 1.0, 2), (0.0, 0.5, 2), (0.5, 0.5, 4)):
        assert computed(Oscillator(h=h, R=R, omega=1.0, f=1.0))[:2] == (1, q)
    assert computed(Oscillator(h=0.02, R=0.8, omega=4.1, f=1.0))[:2] == (2, 1)
    assert computed(Oscillator(h=0.0, R=0.3, omega=0.3, f=1.0))[0] == 1
    assert computed(Oscillator(h=0.1, R=0.3, omega=3.1, f=1.0))[0] == 2


@pytest.mark.parametrize(
    ("h", "R", "n", "low", "high"),
    [(0.05, 0.8, 1, 2.64, 2.68), (0.1, 0.5, 1, 2.68, 2.70), (0.1, 0.5, 2, 4.65, 4.68)],
)
def test_the_class_changes_at_the_flip(h, R, n, low, high):
    """Beside the closed-form orbit, 32 periods show on which side of its flip a motion is."""
    osc = Oscillator(h=h, R=R, omega=low, f=1.0)
    flip = bifurcation(osc, "flip", "omega", low, high, n)
    apart = np.array([-1e-2, -1e-3, -1e-4, -1e-5, -1e-6, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2])
    oscillators = [replace(osc, omega=omega) for omega in (flip + apart * (high - low)).tolist()]
    points = np.concatenate([one.at(*on_the_orbit(one, n, 5e-8)) for one in oscillators])
    _, out = run(points, transient=0, periods=32 * n)
    below = apart < 0.0
    assert (out["period"][below] == n).all()
    assert not np.isin(out["period"][~below], [n]).any()
    assert (out["class_evidence"][~below] != Evidence.NONE).all()


@pytest.mark.parametrize("after", [-1e-8, -1e-9, -1e-10, -1e-12, 1e-12, 1e-10, 1e-9, 1e-8])
def test_a_section_beside_an_impact(after):
    """Its phase is so near that of the impact that the distance from the stop is rounding."""
    osc = Oscillator(h=0.02, R=0.8, omega=1.3, f=1.0)
    orbit = one_impact_orbit(osc)
    (phase,), (speed,) = orbit.phases, orbit.speeds
    v = -osc.R * speed if after > 0.0 else speed
    point, phase = osc.at(-abs(v * after) / osc.omega, v), phase + after
    spec = spec_of(point, phase=phase, transient=1000)
    results = integrate(point, transient=1000, phase=phase, at_section=True)
    out = classified_later(spec, point, results)
    assert (out["period"], out["period_impacts"]) == (1, 1)


@pytest.mark.parametrize(("x", "v"), [(-1e-10, 1.0), (-1.0, 1e-17), (0.0, -0.8), (-1.0, 0.0)])
def test_rounding_in_x_or_v_alone_is_no_cycle(x, v):
    """Sections on the stop, or at a turning point; rounding that repeats after 3 periods."""
    noise = np.resize([0.0, 2e-16, -1e-16], 99)
    m = record_class(FREE, np.minimum([x + noise], 0.0), v + noise[None, ::-1], np.ones(1))
    assert m == 1
