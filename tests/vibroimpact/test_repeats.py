"""Motions that have come back to the same bits, and after how many periods a mass rests again.

The former are computed once, with the results of a full run, and rounding decides no class.
A run in pieces of one forcing period, each of which starts at the last section of the piece before
it, cannot skip anything.
"""

import numpy as np
import pytest

from tests.helpers.kernel_cases import METHODS, one, random_points
from vibroimpact import Oscillator, Status, integrate, simulate
from vibroimpact.kernel.integrate import Length, run_points
from vibroimpact.oscillator import POINT
from vibroimpact.status import Evidence
from vibroimpact.step.scheme import default_steps, scheme_of

#: Sums and means over the record, which skipping may round differently.
SUMS = ("impulse", "energy_lost", "rest_fraction")
COUNTS = ("impacts_per_period", "chatters", "near_grazes")
EXTREMES = {"slowest_impact": np.fmin, "fastest_impact": np.fmax, "max_penetration": np.fmax}
EXTREMES |= {"x_min": np.minimum, "x_max": np.maximum}


def in_pieces(points, transient, periods, impacts, **method):
    """Return the results of a run period by period, none of which can repeat."""
    points, pieces = points.copy(), []
    method |= {"transient": 0, "periods": 1, "impacts": 64}
    for k in range(-transient, periods):
        piece = integrate(points, at_section=k > -transient, **method)
        points["x0"], points["v0"] = piece["poincare_x"][:, 0], piece["poincare_v"][:, 0]
        pieces.append(piece)
    recorded = pieces[transient:]
    states = "poincare_x", "poincare_v"
    out = {name: np.concatenate([one[name] for one in recorded], axis=1) for name in states}
    for name in SUMS + COUNTS:
        out[name] = np.sum([piece[name] for piece in recorded], axis=0)
    for name in SUMS + COUNTS[:1]:
        out[name] = out[name] / periods
    for name in EXTREMES.keys() & recorded[0].keys():
        out[name] = EXTREMES[name].reduce([piece[name] for piece in recorded])
    out["status"] = np.max([piece["status"] for piece in pieces], axis=0)
    for name in ("impact_phase", "impact_v"):
        out[name] = np.full((points.size, impacts), np.nan)
        for i in range(points.size):
            rows = np.concatenate([piece[name][i] for piece in recorded])
            last = rows[np.isfinite(rows)][-impacts:] if impacts else rows[:0]
            out[name][i, : len(last)] = last
    return out


def mixed_points(n, seed):
    """Return motions that settle soon or late, rest, are free, or are chaotic."""
    points, rng = random_points(n, seed), np.random.default_rng(seed)
    points["omega"] = rng.uniform(0.6, 4.0, n)
    points["h"][: n // 2] = rng.uniform(0.0, 0.3, n // 2)
    points["R"][: n // 2] = rng.uniform(0.3, 0.9, n // 2)
    return points


@METHODS
@pytest.mark.parametrize(
    ("transient", "periods", "impacts"), [(0, 90, 64), (70, 40, 3), (90, 7, 5), (33, 60, 0)]
)
def test_a_run_equals_one_in_pieces_that_cannot_skip(rule, integrator, transient, periods, impacts):
    points = mixed_points(24, transient)
    method = {"integrator": integrator, "impact": rule, "steps_per_period": 40}
    method["extremes"] = transient > 0
    if rule == "exact":
        method["steps_per_period"] = default_steps(points, rule)
    whole = integrate(points, transient=transient, periods=periods, impacts=impacts, **method)
    pieces = in_pieces(points, transient, periods, impacts, **method)
    ok = whole["status"] < Status.UNBOUNDED
    assert ok.mean() > 0.9
    for name, values in pieces.items():
        if name in SUMS:
            np.testing.assert_allclose(whole[name][ok], values[ok], rtol=1e-11, err_msg=name)
        else:
            np.testing.assert_array_equal(whole[name][ok], values[ok], err_msg=name)


def test_a_periodic_motion_has_no_long_transient():
    """A thousand million periods of it are computed at once; of a chaotic one they are not."""
    osc = Oscillator(h=0.05, R=0.7, omega=2.3, f=1.0)
    far = integrate(osc.at(), transient=10**9, periods=10**6, impacts=7)
    near = integrate(osc.at(), transient=2000, periods=10)
    np.testing.assert_allclose(far["poincare_x"], near["poincare_x"][0, -1], rtol=1e-14)
    assert far["impact_v"].shape == (1, 7) and np.ptp(far["impact_v"]) < 1e-14
    assert far["impacts_per_period"] == 1.0
    assert far["impulse"] == pytest.approx(near["impulse"], rel=1e-12)
    alone = simulate(osc, 3, transient=10**9)
    np.testing.assert_array_equal(alone.section_x, far["poincare_x"][0, :3])


@pytest.mark.parametrize("phase", [0.0, 1.3])
def test_exponents_are_those_of_every_recorded_period(phase):
    """With exponents only the transient is skipped: a run from its end gives the same bits."""
    points = mixed_points(100, 5)
    method = {"phase": phase, "steps_per_period": default_steps(points, "exact")}
    whole = integrate(points, transient=300, periods=50, lyapunov=True, **method)
    without = integrate(points, transient=300, periods=50, **method)
    np.testing.assert_array_equal(whole["poincare_x"], without["poincare_x"])
    starts = integrate(points, transient=299, periods=1, **method)
    points["x0"], points["v0"] = starts["poincare_x"][:, 0], starts["poincare_v"][:, 0]
    again = integrate(points, transient=0, periods=50, lyapunov=True, at_section=True, **method)
    moving = (points["x0"] != points["clearance"]) & np.isfinite(whole["lyapunov"][:, 1])
    assert moving.mean() > 0.5
    np.testing.assert_array_equal(whole["lyapunov"][moving], again["lyapunov"][moving])


@pytest.mark.parametrize("transient", [0, 3])
def test_a_sum_that_overflowed_has_failed_when_cycles_are_added(transient):
    """The sum of v^2 is inf already at the mark, so that a cycle adds inf - inf."""
    out = integrate(one(h=0.05, f=1e155), transient=transient, periods=300)
    assert np.isfinite(out["poincare_x"]).all()
    assert out["status"] == Status.NON_FINITE and np.isnan(out["impulse"]).all()


def classes_of(points, transient, periods, rule="exact", integrator="exact", lyapunov=False):
    scheme = scheme_of(points, integrator, rule, 100)
    length, none = Length(transient, periods, 0), np.zeros(1, np.int64)
    return run_points(points, scheme, length, lyapunov, None, none, classes=True)["destination"]


def test_a_class_does_not_depend_on_the_exponents():
    """With exponents a record is computed in full, and returns to its mark again and again."""
    points = mixed_points(200, 8)
    without, found = (classes_of(points, 1000, 100, lyapunov=x) for x in (False, True))
    assert (without["evidence"] == Evidence.REPEATS).mean() > 0.5
    for name in found.dtype.names:
        np.testing.assert_array_equal(found[name], without[name], err_msg=name)


def least_period(x):
    """Return after how many sections a settled record repeats, to 1e-9, in the obvious way."""
    return next(k for k in range(1, len(x)) if np.abs(x[k:] - x[:-k]).max() < 1e-9)


@METHODS
def test_the_class_of_a_motion_that_came_back_is_read_off_its_cycle(rule, integrator):
    """Also where the cycle is a multiple of m, because rounding errors need not die out."""
    points = one(h=0.02, R=0.8, omega=2.0).repeat(200)
    points["omega"] = np.linspace(1.5, 2.7, 200)
    counts = {"transient": 3000, "periods": 128}
    out = integrate(points, integrator=integrator, impact=rule, steps_per_period=100, **counts)
    x = out["poincare_x"]
    found = classes_of(points, 3000, 128, rule, integrator)
    known = found["m"] > 0
    assert known.mean() > 0.9 and (found["evidence"][known] == Evidence.REPEATS).mean() > 0.9
    m = np.array([least_period(row) for row in x[known]])
    if rule != "plain":  # else jumps between neighbouring steps make many classes
        assert len(set(m)) > 1
        wanders = [(row[k:] != row[:-k]).any() for row, k in zip(x[known], m, strict=True)]
        assert np.sum(wanders) > 10  # else the test shows less than it says
    np.testing.assert_array_equal(found["m"][known], m)
    q = out["impacts_per_period"][known] * m
    whole = 128 % m == 0
    np.testing.assert_allclose(found["q"][known][whole], q[whole], rtol=1e-12)


def test_a_record_of_one_period_that_ends_where_it_began_has_a_class():
    """It has no second period to compare with."""
    points = one(h=0.02, R=0.8, omega=2.0).repeat(200)
    points["omega"] = np.linspace(1.5, 2.8, 200)
    settled = integrate(points, transient=3000, periods=128, steps_per_period=100)
    repeats = classes_of(points, 3000, 128)["m"] == 1
    x, v = (settled[name][repeats, -1] for name in ("poincare_x", "poincare_v"))
    points = points[repeats]
    points["x0"], points["v0"] = x, v
    again = integrate(points, transient=0, periods=1, steps_per_period=100)
    returned = (again["poincare_x"][:, -1] == x) & (again["poincare_v"][:, -1] == v)
    assert returned.sum() > 10
    np.testing.assert_array_equal(classes_of(points[returned], 0, 1)["m"], 1)


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
