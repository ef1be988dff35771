"""The evidence that a motion goes to an orbit, against its continuation and closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from tests.helpers.kernel_cases import integrated
from tests.vibroimpact.test_destination import on_the_orbit, run, spec_of
from vibroimpact import Oscillator, integrate, one_impact_orbits
from vibroimpact.oscillator import POINT
from vibroimpact.points.computation import classified_later, compute_points
from vibroimpact.points.regimes import Regime, regimes_of
from vibroimpact.status import Evidence
from vibroimpact.step.scheme import default_steps


def test_a_motion_without_impacts_for_ever_is_proved_free():
    """h = .03, clearance .3: the amplitude is below it, and what is left of the start, too."""
    osc = Oscillator(h=0.03, R=0.75, omega=2.4, f=1.0, clearance=0.3)
    points = osc.at().repeat(40)
    points["omega"] = np.linspace(2.4, 2.43, 40)
    _, out = run(points)
    free = out["impacts_per_period"] == 0.0
    assert free.sum() > 30  # how many, the rounding of chaotic transients decides
    assert (out["class_evidence"][free] == Evidence.FREE).all()
    assert (out["period"][free] == 1).all() and (out["period_impacts"][free] == 0).all()
    D = (1.0 - points["omega"] ** 2) ** 2 + (2.0 * 0.03 * points["omega"]) ** 2
    v = points["omega"] * (points["omega"] ** 2 - 1.0) / D  # of x = -f / D ((p^2 - omega^2) sin ..
    np.testing.assert_allclose(out["orbit_v"][free], v[free], rtol=1e-12)
    off = np.abs(out["poincare_v"][:, -1] - v) / np.abs(out["poincare_v"]).max(axis=1)
    assert (out["orbit_distance"][free] >= off[free] * (1.0 - 1e-9)).all()


def test_a_free_motion_is_followed_until_its_end_is_known():
    """Amplitude and transient together pass the clearance, yet no motion meets the stop."""
    osc = Oscillator(h=0.05, R=0.7, omega=2.0, f=1.0, clearance=0.5)
    D = 9.0 + 0.04
    points, angle = osc.at().repeat(400), np.linspace(0.0, 2.0 * np.pi, 400)
    points["x0"] = 0.2 / D + 0.25 * np.cos(angle)  # the free oscillation, and a transient of .25
    points["v0"] = 6.0 / D + 0.25 * np.sin(angle)
    _, out = run(points, transient=0, periods=1)
    _, long = run(points, transient=0, periods=200)
    free = out["class_evidence"] == Evidence.FREE
    left = np.hypot(out["poincare_x"][:, -1] - 0.2 / D, out["poincare_v"][:, -1] - 6.0 / D)
    # Of some, the last section alone proves nothing.
    assert (free & (left + 1.0 / np.sqrt(D) > 0.5)).any() and not free.all()
    impacts = 200 * long["impacts_per_period"] - out["impacts_per_period"]  # after one period
    assert (impacts[free] == 0.0).all()


def test_impacts_are_counted_on_the_orbit():
    """24/32: a record of 100 periods has 4 1/6 repetitions, and its mean gives 31."""
    points = Oscillator(h=0.05, R=0.8, omega=2.0, f=1.0).at().repeat(4)
    omega = np.linspace(2.4, 3.5, 4096)
    nearest = np.abs(omega[:, None] - [2.74464, 2.75270, 2.77741, 2.77768]).argmin(axis=0)
    points["omega"] = omega[nearest]
    _, out = run(points, transient=300)
    assert (out["period"] == 24).all() and (out["period_impacts"] == 32).all()
    assert (np.rint(24 * out["impacts_per_period"]) == 31).any()


def test_impacts_are_counted_through_rests():
    """Repetitions of 4 to 50 periods with rests, most of which do not divide the record."""
    points = Oscillator(h=0.05, R=0.8, omega=2.0, f=1.0).at().repeat(300)
    points["omega"] = np.linspace(2.7, 2.9, 300)
    _, out = run(points, transient=300, periods=101)
    rests = (out["period"] > 0) & (out["rest_fraction"] > 0.0)
    assert rests.sum() > 50 and (101 % out["period"][rests] != 0).all()
    for m in np.unique(out["period"][rests]).tolist():
        rows = rests & (out["period"] == m)
        once = integrate(points[rows], transient=401, periods=m, impacts=0)
        counted = np.rint(m * once["impacts_per_period"])
        np.testing.assert_array_equal(out["period_impacts"][rows], counted)


@pytest.mark.parametrize(
    ("h", "R", "omega", "m", "distance"),
    [(0.01, 0.9, 2.0, 1, 1e-2), (0.05, 0.8, 2.663, 2, 1e-3), (0.05, 0.8, 2.663, 2, -1e-3)],
)
def test_a_motion_far_from_its_orbit_has_its_class(h, R, omega, m, distance):
    """After no transient the class, the orbit and the distance are those of the settled motion.

    Beside an orbit that has flipped, the side tells which section of the orbit of m = 2 is near.
    """
    osc = Oscillator(h=h, R=R, omega=omega, f=1.0)
    points = osc.at(*on_the_orbit(osc, 1, distance))
    _, out = run(points, transient=0, periods=8)
    _, settled = run(points, transient=4000, periods=8)
    assert (out["period"], out["period_impacts"]) == (m, m)
    assert out["class_evidence"] in (Evidence.CAPTURED, Evidence.FALLING)
    assert (settled["class_evidence"], settled["period"]) == (Evidence.REPEATS, m)
    off = []
    for name in "xv":
        sections, true = out[f"poincare_{name}"][0], settled[f"poincare_{name}"][0, -1]
        assert out[f"orbit_{name}"][0] == pytest.approx(true, rel=1e-9)
        off.append(abs(sections[-1] - true) / np.abs(sections).max())
    assert out["orbit_distance"][0] == pytest.approx(max(off), rel=1e-6)
    assert out["orbit_distance"] > 1e-4 and settled["orbit_distance"] < 1e-12


def test_a_motion_that_has_just_reached_its_orbit_has_its_class():
    """The record does not repeat yet, and nothing can be seen of the last section's approach."""
    osc = Oscillator(h=0.1, R=0.3, omega=2.3, f=1.0)
    _, out = run(osc.at(*on_the_orbit(osc, 1, 0.1)), transient=0, periods=24)
    assert (out["period"], out["class_evidence"]) == (1, Evidence.CAPTURED)
    assert out["orbit_distance"] < 1e-13


@pytest.mark.parametrize("distance", [0.0, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3])
def test_beside_an_unstable_orbit_no_motion_has_its_class(distance):
    """Beyond the flip at 2.65335 (h = 0, R = .8), though the records repeat after one period."""
    osc = Oscillator(h=0.0, R=0.8, omega=2.66, f=1.0)
    points = osc.at().repeat(20)
    points["omega"] = np.linspace(2.6534, 2.7, 20)
    for point in points:
        one = replace(osc, omega=float(point["omega"]))
        point["x0"], point["v0"] = on_the_orbit(one, 1, distance)
    _, out = run(points, transient=0, periods=32)
    assert not (out["period"] == 1).any()
    if distance < 1e-10:  # rounding has not carried it away yet
        assert np.isin(out["class_evidence"], [Evidence.UNSTABLE, Evidence.UNREACHED]).all()


def test_a_start_on_an_unstable_orbit_that_comes_back_to_the_same_bits_has_no_class():
    rng, starts = np.random.default_rng(1), []
    while len(starts) < 200:
        h, clearance = rng.choice([0.0, 0.02, 0.1]), rng.choice([0.0, 0.3, -0.3])
        osc = Oscillator(h, rng.uniform(0.3, 0.95), rng.uniform(0.5, 5.0), 1.0, 1.0, clearance)
        unstable = [orbit for orbit in one_impact_orbits(osc) if orbit.exists and not orbit.stable]
        starts += [osc.at(*orbit.sections(0.0)[0]) for orbit in unstable]
    points = np.concatenate(starts)
    out = compute_points(spec_of(points, transient=0, periods=2), points, None)
    assert (out["poincare_x"][:, 0] == points["x0"]).sum() > 3
    assert not (out["period"] == 1).any()


def test_without_dissipation_only_the_record_shows_a_class():
    """R = 1 and h = 0: motions beside a periodic one stay there, and approach nothing."""
    osc = Oscillator(h=0.0, R=1.0, omega=1.0, f=0.0, clearance=10.0)
    _, out = run(osc.at(3.0, 1.0), transient=0, periods=32)
    assert (out["period"], out["class_evidence"]) == (1, Evidence.REPEATS)
    _, out = run(replace(osc, omega=np.sqrt(2.0).item()).at(3.0, 1.0), transient=0, periods=32)
    assert (out["period"], out["class_evidence"]) == (0, Evidence.NONE)
    assert np.isnan(out["orbit_distance"][0]) and np.isnan(out["orbit_x"][0])


def random_points(seed, n):
    """Return points over all parameters, with preload, R = 0 and 1, and h = 0 among them."""
    g = np.random.default_rng(seed)
    points = np.zeros(n, POINT)
    points["f"], points["p"] = 1.0, np.where(g.random(n) < 0.7, 1.0, 10.0 ** g.uniform(-1, 1, n))
    points["h"] = np.where(g.random(n) < 0.15, 0.0, 10.0 ** g.uniform(-3, -0.3, n)) * points["p"]
    R = g.uniform(0.05, 0.99, n)
    points["R"] = np.select([g.random(n) < 0.05, g.random(n) < 0.05], [0.0, 1.0], R)
    points["omega"] = g.uniform(0.3, 5.0, n) * points["p"]
    points["clearance"] = np.where(g.random(n) < 0.4, 0.0, g.uniform(-1.2, 1.2, n))
    points["clearance"] /= points["p"] ** 2
    points["x0"] = np.minimum(points["clearance"], 2.0 * g.normal(size=n) / points["p"] ** 2)
    points["v0"] = 2.0 * g.normal(size=n) / points["p"]
    return points


def wrong_classes(points, further, **options):
    """Return how many motions have a class, and which are not on their orbit `further` on.

    A motion that still settles then must have come nearer.
    """
    spec, out = run(points, **options)
    found = np.flatnonzero((out["period"] > 0) & (out["class_evidence"] != Evidence.REPEATS))
    repeats = np.flatnonzero((out["class_evidence"] == Evidence.REPEATS) & (out["chatters"] == 0))
    found = np.union1d(found, repeats)
    starts, wrong = points[found], []
    for name in "xv":
        starts[f"{name}0"] = out[f"poincare_{name}"][found, -1]
    for m in np.unique(out["period"][found]).tolist():
        rows = np.flatnonzero(out["period"][found] == m)
        at = found[rows]
        later = integrate(
            starts[rows], steps_per_period=spec.steps_per_period, phase=spec.phase, impacts=0,
            at_section=True, transient=-(-further // m) * m - m, periods=m,
        )  # fmt: skip
        away = [np.abs(later[f"poincare_{n}"][:, -1] - out[f"orbit_{n}"][at]) for n in "xv"]
        sizes = [np.abs(out[f"poincare_{n}"][at]).max(axis=1) for n in "xv"]
        off = [d / np.maximum(size, 1e-12) for d, size in zip(away, sizes, strict=True)]
        lost = ~(np.max(off, axis=0) <= np.maximum(1e-5, 1.01 * out["orbit_distance"][at]))
        lost |= np.rint(later["impacts_per_period"] * m) != out["period_impacts"][at]
        wrong += at[lost].tolist()
    return len(found), wrong


@pytest.mark.parametrize(
    ("seed", "n", "further"),
    [*(pytest.param(seed, 600, 5000, marks=pytest.mark.slow) for seed in (1, 3, 4)),
     *(pytest.param(seed, 10_000, 20_000, marks=pytest.mark.campaign) for seed in range(100, 120))],
)  # fmt: skip
def test_motions_go_where_their_class_says(seed, n, further):
    options = [(20, 16, 0.0), (50, 32, 1.3), (200, 32, 4.0), (200, 100, 4.0)][seed % 4]
    record = dict(zip(("transient", "periods", "phase"), options, strict=True))
    classes, wrong = wrong_classes(random_points(seed, n), further, **record)
    assert classes > 0.5 * n and wrong == []


def test_a_motion_that_comes_nearer_an_orbit_only_now_and_then_has_not_its_class():
    """An orbit of 56/70 is near, on which the motion is not 20,000 periods later."""
    osc = Oscillator(h=0.0, R=0.9982370539752287, omega=1.574326696126187, f=1.0)
    point, record = osc.at(0.0, -0.28903136831649445), {"transient": 198, "periods": 32}
    assert wrong_classes(point, 20_000, phase=4.0, **record) == (0, [])


def test_threads_and_neighbours_change_nothing():
    points = random_points(7, 300)
    spec, out = run(points, threads=2, transient=30, periods=32)
    again = run(points[::-1].copy(), threads=1, transient=30, periods=32)[1]
    for name in ("period", "period_impacts", "orbit_x", "orbit_v", "orbit_distance"):
        np.testing.assert_array_equal(out[name], again[name][::-1])
    steps = spec.steps_per_period
    single = integrated(points[5:6], "exact", "exact", steps, 30, periods=32, impacts=0)
    alone = classified_later(spec, points[5:6], single)
    assert alone["class_evidence"][0] == out["class_evidence"][5]


def test_a_rest_at_the_start_of_a_record_decides_nothing():
    """The start from rest is held for a moment; with one period of transient it is left out."""
    phase = 4.0
    points = Oscillator(h=0.02, R=0.7, omega=1.8, f=1.0).at(phase=phase)
    how = {"periods": 100, "phase": phase, "impacts": 0}
    how["steps_per_period"] = default_steps(points, "exact")
    for transient in (0, 1):
        results = integrate(points, transient=transient, **how)
        assert (results["rest_fraction"] > 0.0) == (transient == 0)
        spec = spec_of(points, transient=transient, phase=phase)
        out = classified_later(spec, points, results)
        assert (out["period"], out["period_impacts"]) == (1, 1)
        assert regimes_of(out, points["omega"], 100) == Regime.PERIODIC


@pytest.mark.parametrize("impact", ["exact", "reduced-step"])
def test_cycles_of_many_periods_are_found_without_a_transient(impact):
    """A hundred periods hold the transient and a cycle of 21 to 64 periods, once."""
    points = Oscillator(h=0.05, R=0.8, omega=2.0, f=1.0).at().repeat(400)
    points["omega"] = np.linspace(2.7, 3.0, 400)
    _, settled = run(points, impact, transient=4000, periods=200)
    _, out = run(points, impact, transient=0, periods=100)
    x, v = out["poincare_x"], out["poincare_v"]
    returns = (x[:, -65:-1] == x[:, -1:]) & (v[:, -65:-1] == v[:, -1:])
    long = returns.any(axis=1) & (1 + returns[:, ::-1].argmax(axis=1) > 20)
    assert long.sum() > 5
    for name in ("period", "period_impacts"):
        np.testing.assert_array_equal(out[name][long], settled[name][long])
    assert (out["period"][long] > 20).any()


@pytest.mark.parametrize("impact", ["exact", "reduced-step"])
def test_a_cycle_as_long_as_the_record_is_found(impact):
    """After a transient, and from a section on; its impacts are those of the record."""
    points = Oscillator(h=0.05, R=0.8, omega=2.0, f=1.0).at().repeat(300)
    points["omega"] = np.linspace(2.7, 3.0, 300)
    spec, settled = run(points, impact, transient=4000, periods=200)
    x, v, m = settled["poincare_x"], settled["poincare_v"], settled["period"]
    rows = np.arange(300)  # those that come back to the same bits after m periods from the start on
    same = (x[:, 0] == x[rows, m]) & (v[:, 0] == v[rows, m])
    long = np.flatnonzero(same & (m > 20))
    assert long.size > 5
    for i in long:
        m, point = int(settled["period"][i]), points[i : i + 1].copy()
        for transient in (4001, 0):  # the phase of a cycle does not matter
            one = replace(spec, transient=transient, periods=m)
            out = compute_points(one, point, None)
            assert (out["period"], out["period_impacts"]) == (m, settled["period_impacts"][i])
            point["x0"], point["v0"] = out["poincare_x"][:, -1], out["poincare_v"][:, -1]
