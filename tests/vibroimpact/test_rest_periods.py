"""After how many periods a motion rests again: a class where rounding does not decide it."""

import numpy as np
import pytest

from tests.helpers.kernel_cases import METHODS
from vibroimpact import Oscillator, Status
from vibroimpact.kernel.integrate import Length, run_points
from vibroimpact.oscillator import POINT
from vibroimpact.status import Evidence
from vibroimpact.step.scheme import scheme_of


def recorded(points, rule="exact", integrator="exact", periods=128):
    """Return the results of a run with classes, after 200 periods."""
    scheme, none = scheme_of(points, integrator, rule, None), np.zeros(1, np.int64)
    return run_points(points, scheme, Length(200, periods, 0), False, None, none, classes=True)


def beside(points, towards):
    """Return points whose f differs by its last bit."""
    points = points.copy()
    points["f"] = np.nextafter(points["f"], towards)
    return points


def test_a_period_that_rounding_decides_is_none():
    """45 periods here are 57 in quad precision, 87 and 54 with f (1 +- 1e-16) (edges.json)."""
    osc = Oscillator(
        h=0.08328565553282564, R=0.6436136721293394, omega=3.6610129340951003,
        f=0.44084362093423085, clearance=-0.058499458274787315,
    )  # fmt: skip
    points = osc.at(osc.clearance)
    for changed in (points, beside(points, 0.0), beside(points, np.inf)):
        out = recorded(changed)
        found = out["destination"]
        assert out["rest_fraction"] > 0.0 and out["status"] == Status.CERTIFIED
        assert found["m"] == found["q"] == 0 and found["evidence"] <= Evidence.UNSTABLE
        assert np.isnan(found["x"]) and np.isnan(found["distance"])


def test_a_period_after_which_the_rest_is_of_another_length_with_the_next_p_is_none():
    """Those beside rest again after as many periods, but 1.8 to 2.9 times as long as each other."""
    points = np.zeros(4, POINT)
    points["h"] = 0.0, 0.0, 0.2353045469784501, 0.28320941202709105
    points["R"] = 0.6872324114653325, 0.6678754883311268, 0.8184640275352644, 0.8033357787188148
    points["omega"] = 4.277851897420898, 5.665895499597712, 3.788556977970012, 4.670661617973004
    points["f"] = 0.9187603381355391, 1.2143501474302425, 0.29000568255163756, 1.9533898664999707
    points["p"] = 1.0, 1.7, 1.7, 1.7
    points["x0"] = points["clearance"] = (
        -0.15270577229646973, -0.2846835902120583, -0.06845804024997779, -0.49343105632008644,
    )  # fmt: skip
    out = recorded(points)
    x, v = out["poincare_x"], out["poincare_v"]
    for i, m in enumerate([26, 25, 20, 17]):
        assert (x[i, m:] == x[i, :-m]).all() and (v[i, m:] == v[i, :-m]).all()
    assert (out["destination"]["m"] == 0).all()


@pytest.mark.parametrize("phase", [0.0, 0.1])
def test_a_period_that_ends_with_the_next_greater_p_is_none_at_any_section(phase):
    """With p smaller by 4e-15 of it, the rest is 0.7 % shorter; with p greater, 26 % or more."""
    osc = Oscillator(
        h=0.007942204086095528, R=0.02510991126878176, omega=8.050883564373642, f=1.0,
        p=1.2767860897684729, clearance=-0.040431850150681126,
    )  # fmt: skip
    points, none = osc.at(osc.clearance), np.zeros(1, np.int64)
    scheme = scheme_of(points, "exact", "exact", 600, phase=phase)
    out = run_points(points, scheme, Length(200, 128, 0), False, None, none, classes=True)
    assert (out["poincare_x"][0, 54:] == out["poincare_x"][0, :-54]).all()
    assert out["destination"]["m"] == 0 and out["destination"]["evidence"] == Evidence.UNSTABLE


def points_with_rest(n, seed, **method):
    """Return points whose motions rest, at random."""
    rng, points = np.random.default_rng(seed), np.zeros(5 * n, POINT)
    size = points.size
    points["h"], points["R"] = rng.uniform(0.0, 0.3, size), rng.uniform(0.02, 0.95, size)
    points["omega"], points["f"] = rng.uniform(0.3, 6.0, size), rng.uniform(0.2, 2.0, size)
    points["h"][:n], points["p"] = 0.0, rng.choice([1.0, 1.7], size)
    points["clearance"] = rng.uniform(-0.4, 0.3, size) * points["f"] * (rng.random(size) < 0.8)
    points["x0"] = np.minimum(points["clearance"], 0.0)
    return points[recorded(points, **method)["rest_fraction"] > 0.0][:n]


def assert_no_two_names(n, seed, **method):
    """Change f by its last bit; short cycles with exact impacts keep their class.

    The others start where the record ends, as a start far away may lead to another attractor.
    """
    points = points_with_rest(n, seed, **method)
    assert points.size > 0.6 * n
    out = recorded(points, **method)
    m, x, v = out["destination"]["m"], out["poincare_x"], out["poincare_v"]
    points["x0"], points["v0"] = x[:, -1], v[:, -1]
    assert (m > 20).sum() > 0.01 * n
    for towards in (0.0, np.inf):
        other = recorded(beside(points, towards), **method)["destination"]["m"]
        assert ((m == other) | (m == 0) | (other == 0)).all()
        assert ((m > 0) == (other > 0)).mean() > 0.98
    for k in range(1, 13 if not method else 1):
        repeats = (x[:, k:] == x[:, :-k]).all(axis=1) & (v[:, k:] == v[:, :-k]).all(axis=1)
        assert (m[repeats] > 0).all()


@METHODS
def test_a_class_outlives_a_change_of_the_last_bit(rule, integrator):
    if rule != "plain":  # it has no rests
        method = {} if rule == "exact" else {"rule": rule, "integrator": integrator}
        assert_no_two_names(500, 1, **method)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", [3, 4])
def test_many_classes_outlive_a_change_of_the_last_bit(seed):
    assert_no_two_names(4000, seed)


def test_short_presses_and_long_rests_have_their_period():
    """Without restitution the mass stays where it lands, if the force presses, however shortly."""
    points = Oscillator(h=0.05, R=0.0, omega=0.7, f=1.0, clearance=0.0).at().repeat(300)
    points["clearance"] = np.linspace(-1.2, 0.9999, 300)
    points["x0"] = np.minimum(points["clearance"], 0.0)
    out = recorded(points)
    rests = out["rest_fraction"] > 0.0
    assert rests.sum() > 100 and out["rest_fraction"][rests].min() < 0.01
    assert (out["rest_fraction"] > 0.999).any()
    x, m = out["poincare_x"], out["destination"]["m"]
    for i in np.flatnonzero(rests):
        assert (x[i, m[i] :] == x[i, : -m[i]]).all() and m[i] > 0
