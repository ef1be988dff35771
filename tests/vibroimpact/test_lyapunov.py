"""Lyapunov exponents: their sum, known orbits, rest, and two nearby orbits."""

import math

import mpmath as mp
import numpy as np
import pytest

from vibroimpact import Oscillator, Status, integrate, simulate
from vibroimpact.orbits.one_impact import one_impact_orbit
from vibroimpact.oscillator import POINT


@pytest.mark.slow
@pytest.mark.parametrize(
    ("n", "slowest", "transient", "periods"), [(10_000, 0.5, 0, 3), (1500, -1.0, 50, 100)]
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
    points["f"], points["p"] = 1.0, 1.0
    points["h"], points["omega"] = rng.uniform(0.0, 0.1, n), 10.0 ** rng.uniform(-0.5, 0.8, n)
    points["R"] = np.where(np.arange(n) % 5, rng.uniform(0.05, 1.0, n), 1e-12 ** rng.random(n))
    amplitude = 1.0 / np.hypot(1.0 - points["omega"] ** 2, 2.0 * points["h"] * points["omega"])
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
        h, R, omega, stop = (float(points[name][i]) for name in ("h", "R", "omega", "clearance"))
        osc = Oscillator(h=h, R=R, omega=omega, f=1.0, clearance=stop)
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


def test_a_chaotic_point():
    """About (.134, -.345), over 50,000 periods (.142, -.352); at h = .1, 0.40 per period."""
    how = {"transient": 500, "impacts": 0, "lyapunov": True}
    osc = Oscillator(h=0.0, R=0.8, omega=2.8, f=1.0)
    (found,) = integrate(osc.at(), periods=50_000, **how)["lyapunov"]
    np.testing.assert_allclose(found, [0.134, -0.345], atol=0.012)
    osc = Oscillator(h=0.1, R=0.8, omega=2.95, f=1.0)
    (found,) = integrate(osc.at(), periods=20_000, **how)["lyapunov"]
    assert found[0] * osc.forcing_period == pytest.approx(0.40, abs=0.03)


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


def test_a_preload_that_holds_the_mass_leaves_no_neighbours():
    """It rests before the record begins, and is never released: all of each record is rest."""
    omega = np.linspace(0.3, 4.0, 200)
    points = Oscillator(h=0.1, R=0.8, omega=1.0, f=0.5, clearance=-1.0).at(-1.3, 0.0).repeat(200)
    points["omega"] = omega
    out = integrate(points, transient=40, periods=7, lyapunov=True)
    assert (out["impacts_per_period"] == 0.0).all()
    assert (out["rest_fraction"] <= 1.0).all()
    np.testing.assert_allclose(out["rest_fraction"], 1.0, rtol=1e-14)
    assert (out["lyapunov"] == -np.inf).all()


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


@pytest.mark.parametrize(
    ("given", "x0", "v0"),
    [
        ({"h": 0.1, "R": 0.8, "omega": 2.95}, -0.3, 0.2),
        ({"h": 0.02, "R": 0.9, "omega": 1.7, "clearance": 0.2}, -0.3, 0.2),
        ({"h": 0.3, "R": 0.6, "omega": 2.2, "clearance": -0.1, "p": 1.4}, -0.6, -0.4),
    ],
)
def test_two_nearby_orbits_part_as_the_tangent_vectors_do(given, x0, v0):
    """Six periods: the area and the first direction, by central differences of the section."""
    osc, periods, step = Oscillator(**{"f": 1.0} | given), 6, 1e-6
    starts = [osc.at(x0 + dx, v0 + dv) for dx, dv in ((step, 0), (-step, 0), (0, step), (0, -step))]
    out = integrate(np.concatenate(starts), transient=0, periods=periods)
    ends = np.stack([out["poincare_x"][:, -1], out["poincare_v"][:, -1]], axis=1)
    matrix = np.stack([ends[0] - ends[1], ends[2] - ends[3]], axis=1) / (2 * step)
    matrix *= [[1.0, osc.p], [1.0 / osc.p, 1.0]]  # a velocity counts as v / p
    found = integrate(osc.at(x0, v0), transient=0, periods=periods, lyapunov=True)["lyapunov"][0]
    growth = found * periods * osc.forcing_period
    # The first vector starts along x.
    assert growth[0] == pytest.approx(math.log(np.linalg.norm(matrix[:, 0])), abs=1e-6)
    assert growth.sum() == pytest.approx(math.log(abs(np.linalg.det(matrix))), abs=1e-4)


def test_the_size_of_the_force_has_no_effect():
    """Scaling f scales the motion, so the exponents are the same."""
    sizes = [1.0, 1e-100, 1e-160, 1e-200]
    points = np.concatenate([Oscillator(0.05, 0.8, 2.7, f).at() for f in sizes])
    found = integrate(points, transient=100, periods=200, lyapunov=True)["lyapunov"]
    np.testing.assert_allclose(found[1:], found[:1].repeat(3, axis=0), rtol=1e-9)
