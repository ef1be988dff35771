"""Motions that have come back to the same bits: computed once, with the results of a full run.

A run in pieces of one forcing period, each of which starts at the last section of the piece before
it, cannot skip anything.
"""

import numpy as np
import pytest

from tests.helpers.kernel_cases import METHODS, one, random_points
from vibroimpact import Oscillator, Status, integrate, simulate
from vibroimpact.kernel.integrate import Length, _record, run_points
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
    points = mixed_points(40, transient)
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


def test_a_record_holds_nothing_of_the_point_before():
    points, none = mixed_points(300, 9), np.zeros(1, np.int64)
    how = scheme_of(points, "exact", "exact", None), Length(30, 20, 4), False, 1, none, False
    both = [points], np.split(points, 6)
    sums = [np.concatenate([_record(part, *how).sums for part in parts]) for parts in both]
    assert (sums[0]["rested"] > 0.0).any() and (sums[0]["cycle"] == 0).any()
    for name in sums[0].dtype.names:
        np.testing.assert_array_equal(sums[1][name], sums[0][name], err_msg=name)


def test_chaos_does_not_come_back():
    """Of motions with a positive exponent none repeats within the record."""
    points = one(h=0.1, R=0.8, omega=2.95).repeat(64)
    points["omega"] += np.linspace(-1e-3, 1e-3, 64)
    out = integrate(points, transient=500, periods=1500, lyapunov=True)
    chaotic = out["lyapunov"][:, 0] > 0.05
    assert chaotic.mean() > 0.5
    found = classes_of(points[chaotic], 500, 1500)
    assert (found["m"] == 0).all()
