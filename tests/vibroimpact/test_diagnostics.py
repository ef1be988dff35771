"""Diagnostics of a motion: impulse and energy at impacts, Lyapunov exponents."""

import math

import mpmath as mp
import numpy as np
import pytest

from tests.helpers import naive
from tests.helpers.kernel_cases import integrated
from vibroimpact import Oscillator, Status, integrate, one_impact_orbit, simulate
from vibroimpact.oscillator import POINT, oscillator_of

METHODS = [("exact", "exact"), ("rk4", "cubic"), ("newmark", "reduced-step"), ("newmark", "plain")]


@pytest.mark.parametrize(("integrator", "impact"), METHODS)
@pytest.mark.parametrize("R", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("periods", [1, 7])
def test_they_are_summed_over_the_impacts_of_the_record(integrator, impact, R, periods):
    osc = Oscillator(h=0.5, R=R, omega=1.3, f=1.0)
    method = {"integrator": integrator, "impact": impact, "steps_per_period": 100}
    results = integrate(osc.at(-0.5, 0.0), transient=3, periods=periods, impacts=400, **method)
    run = simulate(osc, 3 + periods, x0=-0.5, **method)
    v = run.impact_v[run.impact_t > 3 * 2.0 * math.pi / 1.3]
    assert results["impacts_per_period"][0] * periods == len(v) > 0
    expected = [v.max(), (1.0 + R) * v.sum() / periods, (1.0 - R**2) / 2 * (v @ v) / periods]
    found = [results[name][0] for name in ("fastest_impact", "impulse", "energy_lost")]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-14)


@pytest.mark.parametrize(("integrator", "impact"), METHODS)
def test_without_an_impact_nothing_is_lost(integrator, impact):
    osc = Oscillator(h=0.1, R=0.5, omega=2.0, f=1.0, clearance=10.0)
    results = integrated(osc.at(), integrator, impact, 100, 1000, periods=5)
    assert np.isnan(results["fastest_impact"][0])
    assert (results["impulse"][0], results["energy_lost"][0]) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("h", "R", "omega", "n", "clearance"),
    [
        (0.05, 0.7, 2.3, 1, 0.0),
        (0.05, 0.6, 2.2, 1, 0.0),
        (0.1, 0.5, 2.0, 1, 0.0),
        (0.02, 0.8, 4.1, 2, 0.0),
        (0.5, 1.0, 2.0, 1, 0.0),
        (0.0, 0.5, 2.0, 1, 0.3),  # with clearance 0 the impact lies on the section
        (0.1, 0.8, 2.6, 2, 0.6),
    ],
)
def test_the_energy_balance_of_a_periodic_orbit(h, R, omega, n, clearance):
    """Work of the force = 2 h integral x'^2 + loss at the impact, by Gauss and Legendre's rule."""
    osc = Oscillator(h=h, R=R, omega=omega, f=1.0, clearance=clearance)
    orbit = one_impact_orbit(osc, n)
    assert orbit.stable
    t0, T = orbit.phase / omega, 2.0 * math.pi * n / omega
    nodes, weights = np.polynomial.legendre.leggauss(80)
    t, weights = t0 + 0.5 * T * (nodes + 1.0), 0.5 * T * weights
    _, v = naive.ClosedForm(osc, t0, clearance, -R * orbit.v)(t)
    work = weights @ (-np.sin(omega * t) * v) / n
    damped = 2.0 * h * (weights @ v**2) / n
    x0, v0 = orbit.sections()[0]
    results = integrate(osc.at(min(x0, clearance), v0), transient=0, periods=20 * n)
    assert results["impacts_per_period"][0] == 1.0 / n
    lost = results["energy_lost"][0]
    assert work == pytest.approx(damped + lost, rel=1e-11)
    assert results["impulse"][0] == pytest.approx((1.0 + R) * orbit.v / n, rel=1e-11)
    assert results["fastest_impact"][0] == pytest.approx(orbit.v, rel=1e-11)


# A forcing period from the stop at rest, with all 42, 100 and 173 impacts down to a speed of 1e-22:
# impulse and energy in mpmath, 50 digits.
CHATTERS = [
    ({"h": 0.05, "R": 0.3, "omega": 0.3}, 0.67546050370678545597, 0.060650959394022870362),
    ({"h": 0.05, "R": 0.6, "omega": 0.4}, 3.8317981879796203634, 0.36915578068323891687),
    (
        {"h": 0.0017813268069742114, "R": 0.7663732648179757, "omega": 0.17220592946231833,
         "p": 1.895638316906608}, 0.054300483595095646605, 0.000022293460102068459461,
    ),
]  # fmt: skip


@pytest.mark.parametrize(("given", "impulse", "energy"), CHATTERS)
def test_the_impacts_of_a_chatter_that_are_summed_are_among_them(given, impulse, energy):
    found = integrate(Oscillator(f=1.0, **given).at(), transient=0, periods=1)
    assert found["impulse"][0] == pytest.approx(impulse, rel=1e-12, abs=0.0)
    assert found["energy_lost"][0] == pytest.approx(energy, rel=1e-12, abs=0.0)


@pytest.mark.parametrize(("given", "impulse", "energy"), CHATTERS[:2])
def test_time_stepping_sums_them_too(given, impulse, energy):
    """Without the sum the impulse is off by 1e-3, however short the steps."""
    for steps, near in ((400, 1e-5), (1600, 1e-6)):
        found = integrated(Oscillator(f=1.0, **given).at(), "rk4", "cubic", steps, periods=1)
        assert found["impulse"][0] == pytest.approx(impulse, rel=near)
        assert found["energy_lost"][0] == pytest.approx(energy, rel=near)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("n", "slowest", "transient", "periods"), [(3_000, 0.5, 0, 3), (500, -1.0, 50, 100)]
)
def test_the_exponents_add_up_to_the_loss(n, slowest, transient, periods):
    """lambda_1 + lambda_2 = -2 h + 2 ln R * (impacts per unit time), on points that fly.

    Where the forcing is fast, steps are long, and have several impacts.
    """
    rng = np.random.default_rng(8)
    points = np.zeros(n, dtype=POINT)
    points["h"] = rng.choice([0.5, 2.0], n) * rng.uniform(0.0, 1.0, n)
    points["R"] = rng.uniform(0.01, 1.0, n)
    points["omega"] = 10.0 ** rng.uniform(slowest, 1.0, n)
    points["f"], points["p"] = 1.0, 1.0
    points["clearance"] = rng.choice([0.0, 1.0], n) * rng.uniform(-0.3, 0.5, n)
    points["x0"] = points["clearance"] - rng.uniform(0.0, 1.0, n)
    out = integrate(points, transient=transient, periods=periods, lyapunov=True)
    rate = out["impacts_per_period"] * points["omega"] / (2 * math.pi)
    loss = -2 * points["h"] + 2 * np.log(points["R"]) * rate
    flies = (out["rest_fraction"] == 0.0) & (out["status"] == Status.CERTIFIED)
    assert flies.sum() >= 0.4 * n
    total = out["lyapunov"].sum(axis=1)
    np.testing.assert_allclose(total[flies], loss[flies], atol=1e-9)
    rested = out["rest_fraction"] > 0.0
    assert rested.any()
    assert (out["lyapunov"][rested] == -np.inf).all()


def near_grazes(n, seed):
    """Return points with a stop just within the free oscillation, some with R down to 1e-12."""
    rng = np.random.default_rng(seed)
    points = np.zeros(n, dtype=POINT)
    points["f"], points["p"] = 1.0, rng.uniform(0.7, 1.5, n)
    points["h"], points["omega"] = rng.uniform(0.0, 0.1, n), 10.0 ** rng.uniform(-0.5, 0.8, n)
    stiffness = points["p"] ** 2 - points["omega"] ** 2
    points["R"] = np.where(np.arange(n) % 5, rng.uniform(0.05, 1.0, n), 1e-12 ** rng.random(n))
    amplitude = 1.0 / np.hypot(stiffness, 2.0 * points["h"] * points["omega"])
    points["clearance"] = amplitude * (1.0 - 10.0 ** rng.uniform(-14.0, -2.0, n))
    points["x0"] = points["clearance"] - 0.1 * amplitude
    return points


def products(point, times, speeds, end):
    """Return both exponents from the impacts of a motion, by matrices of 40 digits."""
    with mp.workdps(40):
        names = "h", "R", "omega", "f", "p", "clearance"
        h, R, omega, f, p, stop = (mp.mpf(float(point[name])) for name in names)
        A, tangent = mp.matrix([[0, 1], [-p * p, -2 * h]]), mp.matrix([1, 0])
        det, before = mp.mpf(1), mp.mpf(0)
        for t, v in zip(map(mp.mpf, times), map(mp.mpf, speeds), strict=True):
            turn = (1 + R) * (-f * mp.sin(omega * t) - p * p * stop) / v
            flight, saltation = mp.expm(A * (t - before)), mp.matrix([[-R, 0], [turn, -R]])
            tangent, before = saltation * (flight * tangent), t
            det *= mp.det(flight) * mp.det(saltation)
        last = mp.expm(A * (end - before))
        tangent, det = last * tangent, det * mp.det(last)
        one = mp.log(mp.hypot(tangent[0], tangent[1] / p)) / end
        both = one, mp.log(det) / end - one
        return float(max(both)), float(min(both))


def test_exponents_near_grazes_are_those_of_the_matrices():
    points, periods, met = near_grazes(40, 6), 8, 0
    out = integrate(points, transient=0, periods=periods, lyapunov=True)
    for i in np.flatnonzero((out["chatters"] == 0) & (out["impacts_per_period"] > 0.0)):
        osc = oscillator_of(points[i])
        tr = simulate(osc, periods, x0=points["x0"][i])
        end = mp.mpf(periods) * 2 * mp.pi / osc.omega
        expected = products(points[i], tr.impact_t, tr.impact_v, end)
        np.testing.assert_allclose(out["lyapunov"][i], expected, rtol=1e-9, atol=1e-9)
        met += 1
    assert met >= 10


def test_the_exponents_have_the_same_bits_on_every_processor(monkeypatch):
    """The logarithm of NumPy has not: it depends on the vectors of the processor."""
    points = Oscillator(h=0.1, R=0.8, omega=2.3, f=1.0).at().repeat(100)
    points["R"], points["omega"] = np.linspace(0.3, 1.0, 100), np.linspace(1.3, 4.0, 100)
    expected = integrate(points, transient=20, periods=20, lyapunov=True)["lyapunov"]

    def another(x):
        return np.nextafter(np.log1p(x - 1.0), np.inf)

    monkeypatch.setattr(np, "log", another)
    again = integrate(points, transient=20, periods=20, lyapunov=True)["lyapunov"]
    np.testing.assert_array_equal(again, expected)


@pytest.mark.parametrize(
    ("h", "omega", "R", "n"),
    [
        (0.05, 2.655, 0.8, 1),
        (0.1, 2.68, 0.5, 1),
        (0.5, 2.6, 1.0, 1),
        (0.1, 4.65, 0.5, 2),
        (0.05, 2.3, 0.7, 1),
        (0.02, 4.1, 0.8, 2),
        (0.05, 2.4, 1e-9, 1),
    ],
)
def test_a_stable_orbit_has_the_logarithms_of_its_multipliers(h, omega, R, n):
    """Exponents = ln |multiplier| omega / (2 pi n), by the closed form of the orbit.

    A record minus its first half is free of the vectors' way into their directions: with real
    multipliers to 1e-8. With complex ones they turn for ever, and only the mean is as sharp.
    """
    osc = Oscillator(h=h, R=R, omega=omega, f=1.0)
    orbit = one_impact_orbit(osc, n)
    assert orbit.stable
    turning = orbit.multipliers[0].imag != 0.0
    assert turning == (omega in (2.3, 4.1))
    known = np.log(np.abs(orbit.multipliers)) / (n * osc.forcing_period)
    arguments = {"transient": 4000 * n, "impacts": 0, "lyapunov": True}
    lengths = 4000 * n, 2000 * n
    whole, half = (integrate(osc.at(), periods=p, **arguments)["lyapunov"][0] for p in lengths)
    found = 2.0 * whole - half
    np.testing.assert_allclose(found.mean(), known.mean(), atol=1e-10)
    np.testing.assert_allclose(found, known, atol=2e-3 if turning else 1e-8)


def test_without_restitution_one_impact_leaves_a_line_of_neighbours():
    """R = 0: the second exponent is -inf from the first impact on, the first one is finite.

    A period of the 1/1 orbit maps the phase of its impact only, with det = 0 and the multiplier
    trace = -exp(-h T) f sin(omega t0) S / (Om v), see ``one_impact_orbit``.
    """
    oscillators = [Oscillator(h=0.05, R=0.0, omega=w, f=1.0) for w in np.linspace(2.2, 2.6, 20)]
    orbits = [one_impact_orbit(osc) for osc in oscillators]
    sums = [math.log(abs(sum(orbit.multipliers))) for orbit in orbits]
    known = np.divide(sums, [osc.forcing_period for osc in oscillators])
    points = np.concatenate([osc.at() for osc in oscillators])
    how = {"transient": 300, "lyapunov": True}
    whole, half = (integrate(points, periods=periods, **how) for periods in (800, 400))
    assert (whole["rest_fraction"] == 0.0).all()
    assert (whole["lyapunov"][:, 1] == -np.inf).all()
    # The first vector starts anywhere, which counts once.
    found = 2.0 * whole["lyapunov"][:, 0] - half["lyapunov"][:, 0]
    np.testing.assert_allclose(found, known, atol=1e-9)


def test_the_size_of_the_force_has_no_effect():
    """Scaling f scales the motion, so the exponents are the same."""
    sizes = [1.0, 1e-100, 1e-160, 1e-200]
    points = np.concatenate([Oscillator(0.05, 0.8, 2.7, f).at() for f in sizes])
    found = integrate(points, transient=100, periods=200, lyapunov=True)["lyapunov"]
    np.testing.assert_allclose(found[1:], found[:1].repeat(3, axis=0), rtol=1e-9)
