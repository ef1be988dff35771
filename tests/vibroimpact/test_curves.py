"""Curves of bifurcations in two parameters, against closed forms and published values."""

import math
from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest
from scipy.interpolate import BarycentricInterpolator
from scipy.optimize import brentq

from tests.helpers.oscillators import SectionMap, bifurcation, peak
from vibroimpact.orbits.branches import branch
from vibroimpact.orbits.curves import bifurcation_curve
from vibroimpact.orbits.family import OrbitFamily
from vibroimpact.orbits.halves import _Beside
from vibroimpact.orbits.one_impact import one_impact_orbit, one_impact_orbits
from vibroimpact.orbits.orbit import PeriodicOrbit
from vibroimpact.orbits.periodic import OrbitError, periodic_orbit, solved, why_inadmissible
from vibroimpact.oscillator import Oscillator
from vibroimpact.trajectory import simulate

#: Ghosh & Simpson (arXiv 2510.16218): b = 2 h = .04, r = R = .9, the stop at 1; n = 2.
SCENE = Oscillator(h=0.02, R=0.9, omega=0.81, f=0.35, clearance=1.0)


def test_the_flips_without_damping_are_on_the_closed_form():
    start = one_impact_orbit(Oscillator(h=0.0, R=0.8, omega=2.6, f=1.0))
    found = bifurcation_curve(start, "flip", ("omega", 2.0, 3.5), ("R", 0.2, 0.98))
    omega, R = found.values.T
    curve = np.cos(math.pi / omega) ** 2 * (omega**2 - ((1.0 - R) / (1.0 + R)) ** 2)
    assert np.abs(curve - 1.0).max() < 1e-13
    assert sorted(point.value[1] for point in found.special) == [0.2, 0.98]
    assert {point.kind for point in found.special} == {"edge"}


#: At omega = 2 n Omega / k, k = 5, flips and folds meet the graze of the free oscillation.
MEETING = 4.0 * math.sqrt(1.0 - 0.02**2) / 5.0


def free_graze(omega):
    """Return the force at which the free oscillation reaches the stop."""
    return math.hypot(1.0 - omega**2, 0.04 * omega)


@pytest.mark.parametrize(
    ("kind", "omega", "f", "beside", "slower"),
    [("flip", 0.81, 0.35, 0.008, False), ("fold", 0.796, 0.369, -0.0032, True)],
)
def test_flips_and_folds_are_tangent_to_the_graze_where_section_5_says(
    kind, omega, f, beside, slower
):
    """The slope at which a curve leaves the curve of grazes, extrapolated to their meeting.

    The curve is analytic there, so that a polynomial through its seven slopes to the meeting, each
    half as far from it as the one before, leaves rounding over the least distance: 4e-12.
    """
    start = one_impact_orbits(replace(SCENE, omega=omega, f=f), 2)[0 if slower else -1]
    found = bifurcation_curve(start, kind, ("f", 0.2, 0.6), ("omega", 0.7, 0.9))
    (end,) = [p for p in found.special if p.kind == "graze" and p.orbit.speeds[0] == 0.0]
    assert end.value == pytest.approx([free_graze(MEETING), MEETING], abs=3e-15)
    places, slopes = [], []
    for halvings in range(7):
        edge = MEETING + beside / 2**halvings
        limits = (edge, 0.9) if beside > 0.0 else (0.7, edge)
        found = bifurcation_curve(start, kind, ("f", 0.2, 0.6), ("omega", *limits))
        (at_edge,) = [p for p in found.special if p.kind == "edge" and p.value[1] == edge]
        places.append(edge - MEETING)
        slopes.append((at_edge.value[0] - free_graze(edge)) / places[-1])
    assert BarycentricInterpolator(places, slopes)(0.0) == pytest.approx(0.0, abs=2e-11)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("m", "q", "omega", "f", "away"),
    [
        (4, 2, 0.8056302521008403, 0.353109243697479, 2e-8),
        (4, 2, 0.8199159663865546, 0.3372268907563025, 2e-8),
        (20, 12, 0.826218487394958, 0.3349579831932773, 1e-6),
    ],
)
def test_the_flips_of_long_orbits_end_where_those_of_two_periods_do(m, q, omega, f, away):
    """All speeds vanish there, and the multipliers change faster and faster towards it."""
    osc = replace(SCENE, omega=omega, f=f)
    run = simulate(osc, 600)
    start = periodic_orbit(osc, run.section_x[-1], run.section_v[-1], m)
    flips = [p for p in branch(start, "f", 0.31, 0.4).special if p.kind == "flip"]
    flip = min((p for p in flips if p.orbit.q == q), key=lambda p: abs(p.value - f))
    assert (flip.orbit.m, flip.orbit.q) == (m, q)
    found = bifurcation_curve(flip.orbit, "flip", ("f", 0.31, 0.4), ("omega", 0.78, 0.83))
    (end,) = [p for p in found.special if p.kind == "graze" and p.value[0] > 0.35]
    assert end.value == pytest.approx([free_graze(MEETING), MEETING], abs=away)
    assert {p.kind for p in found.special} <= {"graze", "edge"}
    assert len(found.values) < 60
    for (f, omega), phases, speeds in zip(found.values, found.phases, found.speeds, strict=True):
        if speeds.min() > 0.02:  # below, the rounding of the phases alone may be seen
            orbit = PeriodicOrbit(replace(SCENE, f=f, omega=omega), m, phases, speeds)
            assert np.abs(orbit.multipliers + 1.0).min() < 1e-10


@pytest.mark.parametrize(("fails_below", "kind"), [(1e-7, "graze"), (1e-4, "lost")])
def test_a_curve_that_ends_short_of_the_graze_is_lost(monkeypatch, fails_below, kind):
    """Newton's method fails where an impact is slower than a share of the unit of speed."""
    corrected = OrbitFamily.corrected

    def fails(self, *arguments, **options):
        X = corrected(self, *arguments, **options)
        return None if X is not None and 0.0 < X[1 : 2 * self.q : 2].min() < fails_below else X

    monkeypatch.setattr(OrbitFamily, "corrected", fails)
    start = one_impact_orbit(replace(SCENE, omega=0.81, f=0.35), 2)
    found = bifurcation_curve(start, "flip", ("f", 0.2, 0.6), ("omega", 0.7, 0.9))
    assert {point.kind for point in found.special} == {"edge", kind}
    (end,) = [point for point in found.special if point.kind == kind]
    unit = 1.35 / 1.81  # (f + p^2 clearance) / (p + omega)
    assert end.orbit.speeds.min() == pytest.approx(unit * fails_below, rel=0.1)


def test_the_graze_of_a_doubled_orbit_ends_where_the_orbit_flips_and_grazes():
    """There both halves of the orbit of 6/6 become that of 3/3, and both touch the stop."""
    osc = Oscillator(h=0.02, R=0.48618090452261303, omega=5.121404682274248, f=1.0)
    run = simulate(osc, 500)
    start = periodic_orbit(osc, run.section_x[-1], run.section_v[-1], 6)
    ends = []
    for point in branch(start, "omega", 4.9, 5.4).special:
        found = bifurcation_curve(point.orbit, point.kind, ("omega", 0.3, 5.6), ("R", 0.3, 0.95))
        assert (found.kind, found.m, found.q) in (("graze", 6, 7), ("flip", 3, 3))
        (end,) = [p for p in found.special if p.kind == "graze" and p.value[1] < 0.5]
        ends.append(end.value)
    assert len(ends) == 2 and ends[0] == pytest.approx(ends[1], abs=1e-9)


def test_the_graze_of_a_doubled_orbit_is_not_lost_where_newtons_method_fails(monkeypatch):
    """Beside the end, where 8/5 without its grazing impact becomes twice 4/2 at a flip."""
    corrected = OrbitFamily.corrected

    def fails(self, *arguments, **options):
        X = corrected(self, *arguments, **options)
        if X is None or self.q != 5:
            return X
        first, second = np.delete(X[1:10:2], self.system.graze).reshape(2, 2)
        return None if np.abs(first - second).max() < 2e-6 else X

    monkeypatch.setattr(OrbitFamily, "corrected", fails)
    osc = Oscillator(
        h=0.004247847778552961, R=0.44136611149792243, omega=4.543361480819898, f=1.0,
        clearance=0.024006723057881485,
    )  # fmt: skip
    phases = np.array([1.823602, 7.937557, 12.938735, 26.92361, 38.577648])
    speeds = np.array([0.181186, 0.0, 0.247833, 0.268621, 0.217353])
    start = PeriodicOrbit(osc, 8, phases, speeds)
    found = bifurcation_curve(start, "graze", ("omega", 4.0, 5.2), ("R", 0.2, 1.0))
    assert [point.kind for point in found.special] == ["graze", "fold", "flip", "edge"]
    end = found.special[0].orbit
    half = np.flatnonzero(end.speeds)[:2]
    orbit = PeriodicOrbit(end.oscillator, 4, end.phases[half], end.speeds[half])
    assert orbit.multipliers.real.min() == pytest.approx(-1.0, abs=1e-4)


def test_the_graze_of_the_free_oscillation_is_its_closed_form_with_the_meeting_marked():
    found = bifurcation_curve(
        one_impact_orbit(SCENE, 2), "graze", ("f", 0.2, 0.6), ("omega", 0.7, 0.9)
    )
    f, omega = found.values.T
    assert np.abs(f - np.hypot(1.0 - omega**2, 0.04 * omega)).max() < 1e-13
    assert (found.speeds == 0.0).all()
    for kind in ("flip", "fold"):
        (point,) = [p for p in found.special if p.kind == kind]
        assert point.value[1] == pytest.approx(MEETING, abs=1e-13)


@pytest.mark.parametrize(
    ("h", "low", "high", "count", "near"),
    [
        (0.02, 0.3, 2.5, 6, 1e-12),
        (0.1, 0.15, 0.9, 11, 1e-12),
        (0.05, 0.1, 0.3, 13, 1e-12),
        (0.3, 0.06, 0.1, 12, 1e-12),
        (0.5, 0.06, 0.08, 7, 1e-9),  # c1 itself is of the order of exp(-h T)
        (0.5, 0.08, 0.1, 4, 1e-9),
    ],
)
def test_no_meeting_on_the_graze_of_the_free_oscillation_is_missed(h, low, high, count, near):
    """Section 5: they are at omega = 2 Omega / k. Two may lie in one step."""
    omega = 0.505 * (low + high)
    osc = Oscillator(h=h, R=0.8, omega=omega, f=0.99, clearance=1.0)
    still = replace(osc, f=0.99 * math.hypot(1.0 - omega**2, 2.0 * h * omega))
    start = solved(still, 1, np.empty(0), np.empty(0))
    found = bifurcation_curve(start, "graze", ("f", 0.0, 3.0), ("omega", low, high))
    free = math.sqrt(1.0 - h * h)
    expected = sorted(2.0 * free / k for k in range(1, 400) if low < 2.0 * free / k < high)
    assert len(expected) == count
    for kind in ("flip", "fold"):
        places = sorted(point.value[1] for point in found.special if point.kind == kind)
        assert places == pytest.approx(expected, abs=near)


def test_the_graze_of_the_free_oscillation_goes_on_as_an_orbit_of_three_periods():
    """It touches the stop twice between its impacts, to rounding, which is no end."""
    osc = Oscillator(h=0.02, R=0.8, omega=2.25, f=1.0)
    stiffness = complex(1.0 - osc.omega**2, 2.0 * osc.h * osc.omega)
    osc = replace(osc, clearance=1.0 / abs(stiffness))
    touch = PeriodicOrbit(osc, 3, 0.5 * math.pi + np.angle([-stiffness]), np.zeros(1))
    found = bifurcation_curve(touch, "graze", ("clearance", 0.01, 40.0), ("omega", 0.4, 4.7))
    assert [p.kind for p in found.special if p.kind not in ("flip", "fold")] == ["edge", "edge"]
    clearance, omega = found.values.T
    product = clearance * np.hypot(1.0 - omega**2, 2.0 * osc.h * omega)
    np.testing.assert_allclose(product, 1.0, rtol=0, atol=1e-11)


@pytest.mark.parametrize("last", [7.3, 10.0, 18.0])
def test_a_step_does_not_jump_to_another_curve_beside_its_own(last):
    """There the grazes of 8/6 have two sheets 3e-4 apart; on the other one they end soon."""
    osc = Oscillator(0.02643609416138875, 0.9589092959750787, 7.177241693439115, 1.0)
    phases = 2.670723415723657, 4.091065096835738, 4.744542987136107
    phases += 5.377654108970107, 6.426841740389539, 29.850514313802176
    speeds = 0.0, 0.04320763170647334, 0.0442118932120406
    speeds += 0.039182319007724654, 0.014412629918075437, 0.1415491267952341
    start = PeriodicOrbit(osc, 8, np.array(phases), np.array(speeds))
    found = bifurcation_curve(start, "graze", ("omega", 6.95, last), ("clearance", -0.9, 0.2))
    (end,) = [point for point in found.special if point.value[0] == 6.95]
    assert (end.kind, end.value[1]) == ("edge", pytest.approx(0.006531964962489, abs=1e-12))


def test_a_graze_of_all_impacts_is_that_of_the_free_oscillation():
    """Where 9/2 ends, both its impacts are touches of one oscillation, of amplitude f / |D|."""
    osc = Oscillator(0.1602367594878764, 0.16773159910106636, 7.351284129173936, 1.1977359445134217)
    stiffness = complex(1.0 - osc.omega**2, 2.0 * osc.h * osc.omega)
    phase = 0.5 * math.pi + np.angle(-stiffness)
    orbit = PeriodicOrbit(
        replace(osc, clearance=osc.f / abs(stiffness)),
        9,
        phase + 2.0 * math.pi * np.array([0.0, 5.0]),
        np.zeros(2),
    )
    found = bifurcation_curve(orbit, "graze", ("clearance", -0.6, 0.6), ("f", 0.33, 1.76))
    assert [point.kind for point in found.special] == ["edge", "edge"]
    clearance, f = found.values.T
    np.testing.assert_allclose(clearance * abs(stiffness), f, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("last", "f"),
    [(0.59, 0.960733250477590), (0.60, 0.888910272130863), (0.62, 0.776919993099989)],
)
def test_a_graze_does_not_end_where_its_own_landing_is_left_by_rounding(last, f):
    """A curve of the orbit 10/5 that goes on to the edge, where its f is known."""
    osc = Oscillator(0.0, 0.5783595687515108, 9.17981952886363, 1.0, 1.0, -0.000518638491283792)
    phases = 4.5730449440613725, 5.7046365498477165, 35.84387378278173
    phases += 36.814744354931115, 37.81854699963247
    speeds = 0.10015655931650334, 0.04861191588559104, 0.0891284455745802
    speeds += 0.04821092115635537, 0.011331330515415152
    start = PeriodicOrbit(osc, 10, np.array(phases), np.array(speeds))
    found = bifurcation_curve(start, "graze", ("R", 0.57, last), ("f", 0.5, 1.5))
    assert [point.kind for point in found.special] == ["edge", "edge"]
    ends = [point.value for point in found.special]
    assert max(ends, key=lambda end: end[0]) == pytest.approx([last, f], abs=1e-12)


def test_no_flips_and_folds_meet_a_graze_where_their_condition_vanishes_all_along():
    """Without damping a touch halves a flight that is symmetric in time: c1 is rounding there."""
    start = branch(one_impact_orbit(Oscillator(h=0.0, R=0.9, omega=1.2, f=1.0)), "omega", 0.9, 1.3)
    (graze,) = [point for point in start.special if point.kind == "graze"]
    found = bifurcation_curve(graze.orbit, "graze", ("omega", 0.9, 1.3), ("R", 0.7, 0.97))
    assert len(found.values) > 10
    assert [point.kind for point in found.special] == ["edge", "edge"]


@pytest.mark.parametrize("m", [1, 2])
@pytest.mark.parametrize("h", [0.0, 0.05])
@pytest.mark.parametrize(
    ("first", "second"),
    [
        (("f", 0.0, 3.0), ("omega", 0.3, 3.0)),
        (("clearance", 0.0, 2.0), ("f", 0.0, 3.0)),
        (("omega", 0.3, 3.0), ("clearance", 0.0, 2.0)),
        (("f", 0.0, 3.0), ("p", 0.2, 3.0)),
    ],
)
def test_the_grazes_of_the_free_oscillation_go_from_edge_to_edge(h, m, first, second):
    """Also where the force or both parameters vanish; in few steps, since nothing happens."""

    def amplitude(osc):
        return osc.f / math.hypot(osc.p**2 - osc.omega**2, 2.0 * osc.h * osc.omega)

    scene = Oscillator(h=h, R=0.8, omega=0.8, f=1.0, clearance=0.5)
    scene = replace(scene, f=0.5 / amplitude(scene))
    phase = 0.5 * math.pi + math.atan2(-2.0 * h * 0.8, -(1.0 - 0.8**2)) % (2.0 * math.pi)
    touch = PeriodicOrbit(scene, m, np.array([phase % (2.0 * math.pi)]), np.zeros(1))
    found = bifurcation_curve(touch, "graze", first, second)
    ends = [point for point in found.special if point.kind not in ("flip", "fold")]
    assert [point.kind for point in ends] == ["edge", "edge"]
    for point in ends:
        pairs = zip(point.value.tolist(), (first[1:], second[1:]), strict=True)
        assert any(value in edges for value, edges in pairs)
    for values in found.values:
        osc = replace(scene, **dict(zip(found.parameters, values.tolist(), strict=True)))
        if osc.f > 0.0:
            assert amplitude(osc) == pytest.approx(osc.clearance, rel=1e-7)
    assert len(found.values) < 130


def test_a_curve_of_folds_that_ends_where_no_energy_is_lost_has_no_cusp_there():
    """It touches R = 1 at f = 0, where the parameters change by less than rounding."""
    osc = Oscillator(
        h=0.0, R=0.762018830994887, omega=9.061092841253766, f=0.255390283887717,
        p=1.4670466634746546, clearance=-0.26200537754160713,
    )  # fmt: skip
    start = PeriodicOrbit(osc, 1, np.array([6.270993163818162]), np.array([0.2432289187730071]))
    found = bifurcation_curve(start, "fold", ("f", 0.0, 3.0), ("R", 0.05, 1.0))
    assert [point.kind for point in found.special] == ["edge", "edge"]
    assert found.special[0].value.tolist() == [0.0, 1.0]


def test_a_graze_that_newtons_method_finds_elsewhere_is_not_the_end_of_a_branch(monkeypatch):
    start, ranges = one_impact_orbit(Oscillator(h=0.0, R=0.9, omega=1.2, f=1.0)), (0.9, 1.3)
    (expected,) = [p for p in branch(start, "omega", *ranges).special if p.kind == "graze"]
    bifurcation_of = OrbitFamily.bifurcation

    def elsewhere(self, X, kind, graze=0):
        Z = bifurcation_of(self, X, kind, graze)
        return Z + 0.01 if kind == "graze" and Z is not None else Z

    monkeypatch.setattr(OrbitFamily, "bifurcation", elsewhere)
    (graze,) = [p for p in branch(start, "omega", *ranges).special if p.kind == "graze"]
    assert graze.value == pytest.approx(expected.value, abs=1e-7)


def test_no_flips_and_folds_meet_the_grazes_of_a_long_period_without_damping():
    """The rounding of c1 grows with the period."""
    scene = Oscillator(h=0.0, R=0.9, omega=12 * 1.95, f=1.0)
    start = branch(one_impact_orbit(scene, 12), "omega", 0.6 * scene.omega, 1.3 * scene.omega)
    (graze,) = [point for point in start.special if point.kind == "graze"]
    ranges = ("omega", 0.5 * scene.omega, 1.5 * scene.omega), ("R", 0.2, 0.97)
    found = bifurcation_curve(graze.orbit, "graze", *ranges)
    assert len(found.values) > 10
    assert not {"flip", "fold"} & {point.kind for point in found.special}


@pytest.mark.parametrize("width", [1e-7, 1e-8, 1e-9, 1e-10])
def test_a_curve_over_narrow_ranges_goes_from_edge_to_edge(width):
    scene = Oscillator(h=0.05, R=0.8, omega=2.65888454668484, f=1.0)
    ranges = [(x, getattr(scene, x) - width, getattr(scene, x) + width) for x in ("omega", "R")]
    found = bifurcation_curve(one_impact_orbit(scene), "flip", *ranges)
    assert [point.kind for point in found.special] == ["edge", "edge"]
    assert sorted(point.value[1] for point in found.special) == [0.8 - width, 0.8 + width]


def test_two_folds_meet_in_a_cusp():
    """Beside it a branch has two folds on one side of its clearance, and none on the other."""
    osc = Oscillator(h=0.1, R=0.6, omega=0.65, f=1.0)
    run = simulate(osc, periods=300)
    four = periodic_orbit(osc, run.x[-1], run.v[-1])
    (fold,) = [p for p in branch(four, "omega", 0.3, 4.0).special if p.kind == "fold"]
    found = bifurcation_curve(fold.orbit, "fold", ("omega", 0.5, 1.5), ("clearance", -0.5, 0.5))
    (cusp,) = [p for p in found.special if p.kind == "cusp"]
    omega, clearance = cusp.value
    (without,) = branch(cusp.orbit, "clearance", -0.5, 0.5).at(clearance - 1e-3)
    at = int(np.argmin(np.abs(found.values - cusp.value).max(axis=1)))
    for near, count in ((without, 0), (found.orbit(at - 1), 2), (found.orbit(at + 1), 2)):
        special = branch(near, "omega", omega - 0.01, omega + 0.01).special
        assert [p.kind for p in special].count("fold") == count


def test_a_smooth_turn_of_the_folds_is_no_cusp():
    """R has a smooth minimum at (6.0328, .6251), where the parameters turn within one step."""
    osc = Oscillator(
        h=0.002270562487592108, R=0.7921663522150849, omega=5.9214451962385555, f=1.0,
        p=0.8940667529083062,
    )  # fmt: skip
    phases = np.array([2.36987228167583, 6.529280048086484, 26.65563221760582])
    speeds = np.array([0.13852896315191357, 0.18970795215695938, 0.3226216879520207])
    start = PeriodicOrbit(osc, 7, phases, speeds)
    found = bifurcation_curve(start, "fold", ("omega", 3.5, 8.62), ("R", 0.6067418, 1.0))
    assert [point.kind for point in found.special] == ["edge", "graze"]
    assert found.values[:, 1].min() == pytest.approx(0.6251, abs=1e-3)


#: Folds of even orbits: h, R, omega, clearance, m, phases, speeds, and two parameters.
EVEN_FOLDS = [
    (
        (0.014345535313060494, 0.822844248768931, 3.1076863628103895, -0.043165483779260154), 4,
        (3.369118, 5.63253, 14.746635, 19.133391), (0.354232, 0.340147, 0.320452, 0.468441),
        "R", "clearance", ["flip", "graze"],
    ),
    (
        (0.021473102103706, 0.9353643039006074, 2.9663304973371893, -0.0635302791139786), 6,
        (3.024822, 5.734295, 14.217375, 22.612327, 24.050315, 32.387493),
        (0.337564, 0.423413, 0.620606, 0.240073, 0.248158, 0.567443),
        "omega", "R", ["flip", "flip"],
    ),
    (
        (0.0, 0.9025906780569497, 6.99709425588623, -6.465816007914199e-05), 8,
        (3.763774, 5.415243, 27.379638, 32.064715), (0.111962, 0.108496, 0.100899, 0.126564),
        "clearance", "omega", ["flip", "graze"],
    ),
    (
        (0.004682655998969588, 0.8831028166777297, 1.0001129968124862, 0.2161704764396184), 6,
        (4.5829, 6.297099, 10.761693, 14.040891, 17.457497, 23.203242, 24.908681, 29.53019,
         32.586373, 36.175636),
        (0.772571, 0.360329, 2.435801, 0.440887, 2.225761, 0.870708, 0.539945, 2.316563, 0.633524,
         2.559831),
        "clearance", "omega", ["flip", "graze"],
    ),
    (
        (0.0, 0.7956213327887222, 3.1201084164210617, -0.05003928043741748), 4,
        (3.169325, 5.733403, 14.892395, 18.969393), (0.377231, 0.377638, 0.345366, 0.475584),
        "clearance", "omega", ["edge", "flip"],
    ),
]  # fmt: skip
RANGES = {"R": (0.3, 1.0), "omega": (0.5, 8.0), "clearance": (-0.3, 0.3)}


def orbits_twice(found):
    """Return the points of a curve whose orbit, whichever impact is first, it meets elsewhere.

    Its orbit lies beside a chord between other points, nearer than 5 % of the length of the chord.
    """
    values = (found.values - found.values.min(axis=0)) / np.ptp(found.values, axis=0)
    orbits = np.column_stack([values, np.sort(found.speeds) / found.speeds.max()])
    starts, chords = orbits[:-1], np.diff(orbits, axis=0)
    lengths, again = np.linalg.norm(chords, axis=1), []
    for i, orbit in enumerate(orbits):
        shares = np.sum((orbit - starts) * chords, axis=1) / lengths**2
        away = np.linalg.norm(orbit - starts - shares[:, None] * chords, axis=1) / lengths
        away[max(i - 1, 0) : i + 1] = np.inf
        if np.any((shares > 0.0) & (shares < 1.0) & (away < 0.05)):
            again.append(i)
    return again


@pytest.mark.slow
@pytest.mark.parametrize(
    ("values", "m", "phases", "speeds", "first", "second", "kinds"),
    [
        pytest.param(*case, id=f"{case[1]}/{len(case[2])} over {case[4]}, {case[5]}")
        for case in EVEN_FOLDS
    ],
)
def test_the_folds_of_an_even_orbit_end_at_the_degenerate_flip_of_its_half(
    values, m, phases, speeds, first, second, kinds
):
    """The cubic coefficient of the flip is zero there; beyond it the halves would change places."""
    h, R, omega, clearance = values
    osc = Oscillator(h=h, R=R, omega=omega, f=1.0, clearance=clearance)
    start = PeriodicOrbit(osc, m, np.array(phases), np.array(speeds))
    ranges = [(name, *RANGES[name]) for name in (first, second)]
    found = bifurcation_curve(start, "fold", *ranges)
    assert sorted(point.kind for point in found.special) == kinds
    for point in (0, -1):
        assert found.special[point].value.tolist() == found.values[point].tolist()
    assert not orbits_twice(found)
    for i in range(1, len(found.values) - 1, 6):
        again = bifurcation_curve(found.orbit(i), "fold", *ranges)
        specials = sorted(again.special, key=lambda p: np.abs(p.value - found.values[0]).max())
        for point, expected in zip(specials, found.special, strict=True):
            assert point.kind == expected.kind
            assert point.value == pytest.approx(expected.value, abs=2e-8)
        assert not orbits_twice(again)
    for end in (point for point in found.special if point.kind == "flip"):
        assert (end.orbit.m, end.orbit.q) == (m // 2, len(phases) // 2)
        with mp.workdps(60):
            coefficients, beside = [], mp.mpf(10) ** -5
            for change in (0, beside):
                half = SectionMap(end.orbit)
                half.parameters[second] += change
                value = half.bifurcation("flip", first)
                coefficients.append(half.cubic_coefficient())
                if not change:
                    assert float(value) == pytest.approx(end.value[0], rel=1e-12, abs=1e-14)
            away = beside * coefficients[0] / (coefficients[1] - coefficients[0])
            assert float(away) == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize("case", [0, 3])
def test_a_curve_of_folds_ends_at_an_edge_that_comes_before_its_degenerate_flip(case):
    """The halves differ by less than a twentieth there, and the flip is beyond the range."""
    (h, R, omega, clearance), m, phases, speeds, first, second, _ = EVEN_FOLDS[case]
    osc = Oscillator(h=h, R=R, omega=omega, f=1.0, clearance=clearance)
    start = PeriodicOrbit(osc, m, np.array(phases), np.array(speeds))
    ranges = {name: RANGES[name] for name in (first, second)}
    found = bifurcation_curve(start, "fold", *((name, *ends) for name, ends in ranges.items()))
    at = [point.kind for point in found.special].index("flip")
    flip, beside = found.special[at].value[1], found.values[(1, -2)[at], 1]
    edge = flip + 0.01 * (beside - flip)
    ranges[second] = (edge, ranges[second][1]) if flip < edge else (ranges[second][0], edge)
    middle = found.orbit(len(found.values) // 2)
    short = bifurcation_curve(middle, "fold", *((name, *ends) for name, ends in ranges.items()))
    assert sorted(point.kind for point in short.special) == ["edge", "graze"]
    (end,) = [point for point in short.special if point.kind == "edge"]
    assert end.value[1] == pytest.approx(edge, rel=1e-9)


def orbit_of_6_4():
    """Return an orbit whose folds end where its two halves become equal."""
    osc = Oscillator(
        h=0.007362632864275454, R=0.8628857905514986, omega=5.2602055795026255, f=1.0,
        clearance=-0.027911269810741077,
    )  # fmt: skip
    return periodic_orbit(osc, -0.2504382214728245, 0.5088206343102007, 6)


@pytest.mark.slow
def test_a_curve_of_folds_ends_where_a_flip_of_half_the_period_changes_its_kind():
    """A 6/4 orbit, from which both ends were once the same graze, with the halves swapped."""
    start = orbit_of_6_4()
    ranges = ("clearance", -0.14086, 0.08504), ("R", 0.42661, 1.0)
    found = bifurcation_curve(start, "fold", *ranges)
    assert [point.kind for point in found.special] == ["flip", "graze"]
    assert found.special[0].value == pytest.approx([-0.03049523, 0.90218745], abs=1e-8)
    assert not orbits_twice(found)
    for i in range(1, len(found.values) - 1):
        again = bifurcation_curve(found.orbit(i), "fold", *ranges)
        assert sorted(point.kind for point in again.special) == ["flip", "graze"]
        assert not orbits_twice(again)


#: Folds of orbits of two periods near a resonance, where the equations of the flights are almost
#: singular: oscillator, phases, speeds, two ranges, and the kinds of both ends.
RESONANT_FOLDS = [
    (
        (0.0, 0.22962440475055887, 0.49684387536385977, 2.8364653295094806, 1.0, 3.099250817317816),
        (4.738467196435406, 10.975655183818759), (0.01183862788017028, 0.07485107591497236),
        ("clearance", 0.8314, 5.332), ("f", 1.0102, 4.6627), ["edge", "edge"],
    ),
    (
        (0.009648847885009706, 0.7833535831970844, 1.3573919789029458, 2.9641915887581125,
         1.3677821652269693, 3.731868390412312),
        (4.823666020966798, 10.982749280277007), (2.3184803230137843, 5.116010847311451),
        ("p", 0.40623, 1.59377), ("R", 0.51627, 1.0), ["flip", "edge"],
    ),
    (
        (0.0005665172892851622, 0.5942893006996819, 0.4286026678593357, 1.531011005217444,
         1.1314116535635579, 1.1552798542610252),
        (4.076597043608686, 5.266260401540656, 10.327846298259349, 11.522536935873312),
        (0.4533649300320061, 0.3094417684784397, 0.48787918202701913, 0.359695148117221),
        ("p", 0.37038, 1.62962), ("R", 0.40346, 0.78511), ["flip", "flip"],
    ),
    (
        (0.0028280073070909226, 0.9270389501064908, 0.7505942405230596, 3.437808668542584,
         0.7518735452621153, 10.539791788425157),
        (4.760499839324295, 10.985201203714293), (5.39811938233415, 9.457266523539156),
        ("omega", 0.67905, 1.22553), ("clearance", 7.71157, 13.368), ["flip", "edge"],
    ),
    (
        (0.001323363952787437, 0.24314165313611752, 2.4888813031584, 1.0, 2.506656358598918,
         3.174244174808011),
        (4.728975956433519, 11.001734877020061), (0.6266560763480521, 0.835524330764009),
        ("p", 1.83874, 2.99112), ("clearance", 1.87532, 4.47317), ["flip", "edge"],
    ),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("values", "phases", "speeds", "first", "second", "kinds"), RESONANT_FOLDS, ids=range(5)
)
def test_the_folds_near_a_resonance_are_followed_to_their_ends(
    values, phases, speeds, first, second, kinds
):
    start = PeriodicOrbit(Oscillator(*values), 2, np.array(phases), np.array(speeds))
    found = bifurcation_curve(start, "fold", first, second)
    assert [point.kind for point in found.special] == kinds
    assert len(found.values) < 60 and not orbits_twice(found)
    for end in (point for point in found.special if point.kind == "flip"):
        with mp.workdps(60):
            coefficients = []
            for change in (0, mp.mpf(10) ** -5):
                half = SectionMap(end.orbit)
                half.parameters[second[0]] += change
                value = half.bifurcation("flip", first[0])
                coefficients.append(half.cubic_coefficient())
                if not change:
                    assert float(value) == pytest.approx(end.value[0], rel=1e-12)
            away = float(1e-5 * coefficients[0] / (coefficients[1] - coefficients[0]))
            assert away == pytest.approx(0.0, abs=2e-5)


def test_a_flip_beside_the_extrapolated_end_of_a_curve_of_folds_is_not_its_end(monkeypatch):
    """Newton's method finds the flips of the half from anywhere near them."""
    start = orbit_of_6_4()
    ranges = ("clearance", -0.14086, 0.08504), ("R", 0.42661, 1.0)
    extrapolated = _Beside.at
    aside = np.zeros(10)
    aside[-2] = 0.01
    monkeypatch.setattr(
        _Beside, "at", lambda self, square: extrapolated(self, square) + aside * (square == 0.0)
    )
    found = bifurcation_curve(start, "fold", *ranges)
    assert "flip" not in [point.kind for point in found.special]


@pytest.mark.parametrize(("axis", "inside"), [(0, 1.0), (1, -1.0)])
def test_a_curve_of_folds_ends_at_an_edge_just_before_its_degenerate_flip(axis, inside):
    """Its equations are singular there; the halves differ by the square root of the distance."""
    start = orbit_of_6_4()
    ranges = [("clearance", -0.14086, 0.08504), ("R", 0.42661, 1.0)]
    flip = bifurcation_curve(start, "fold", *ranges).special[0].value
    slopes, sizes = [], []
    for away in (1e-4, 1e-6, 1e-7, 1e-8):
        edge, (name, low, high) = flip[axis] + inside * away, ranges[axis]
        cut = ranges.copy()
        cut[axis] = (name, edge, high) if inside > 0.0 else (name, low, edge)
        found = bifurcation_curve(start, "fold", *cut)
        assert [point.kind for point in found.special] == ["edge", "graze"]
        end = found.special[0]
        assert end.value[axis] == edge
        assert end.value.tolist() == found.values[0].tolist()
        assert (end.orbit.m, end.orbit.q) == (6, 4)
        assert why_inadmissible(end.orbit) == ""
        slopes.append((end.value[1 - axis] - flip[1 - axis]) / away)
        sizes.append(np.abs(end.orbit.speeds[:2] - end.orbit.speeds[2:]).max() / math.sqrt(away))
        assert len(found.values) < 40
    assert slopes == pytest.approx([slopes[0]] * 4, rel=0.2)
    assert sizes == pytest.approx([sizes[0]] * 4, rel=0.2)


@pytest.mark.parametrize(
    ("values", "m", "phases", "speeds", "first", "second"),
    [
        (
            (0.03248394936950036, 0.7220791517847076, 0.5405952185512377, 1.0, 1.0,
             0.9953778065642878),
            2, (3.905924331717607, 5.828285362545925, 9.84281469136646, 11.694508288193362),
            (0.6420265968978819, 0.1938865751191821, 0.6493200840191526, 0.6649961394020498),
            ("clearance", -0.326, 1.674), ("omega", 0.282, 0.846),
        ),
        (
            (0.0, 0.5629170465908284, 2.16838149516391, 2.260658321641452, 0.8149646208246941,
             0.15779095620722705),
            6, (1.5979721532847426, 8.487046288130317, 11.795699558937656, 20.35324661928221,
                27.26431641280222, 30.90104226734182),
            (1.8125503156005154, 0.29408914785632895, 1.2752558332234938, 1.6991614431239022,
             0.41141963653625824, 1.3929870410909297),
            ("p", 0.5, 1.5), ("omega", 1.324, 3.972),
        ),
    ],
)  # fmt: skip
def test_the_flips_of_an_even_orbit_end_where_its_half_flips_and_grazes(
    values, m, phases, speeds, first, second
):
    """Two impacts graze at once there, from wherever the curve is followed."""
    start, ends = PeriodicOrbit(Oscillator(*values), m, np.array(phases), np.array(speeds)), []
    whole = bifurcation_curve(start, "flip", first, second)
    for i in len(whole.values) * np.array([1, 2, 3]) // 4:
        found = bifurcation_curve(whole.orbit(i), "flip", first, second)
        (end,) = [p for p in found.special if np.count_nonzero(p.orbit.speeds == 0.0) == 2]
        assert end.kind == "graze" and len(found.values) < 60
        ends.append(end.value)
        q = start.q // 2
        half = PeriodicOrbit(
            end.orbit.oscillator, m // 2, end.orbit.phases[:q], end.orbit.speeds[:q]
        )
        assert half.exists and half.characteristic == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert np.ptp(ends, axis=0).max() < 1e-9


@pytest.mark.parametrize(
    ("values", "phases", "speeds", "ranges"),
    [
        (
            {"h": 0.09397136038870241, "R": 0.897225519910674, "omega": 1.0679112274635831,
             "f": 1.0, "clearance": -0.046805682666813675},
            (1.2411141224550395, 4.7112263048390695, 10.979057750127623),
            (0.0, 1.4689443321344122, 1.4359842278728046),
            (("omega", 0.61, 1.77), ("R", 0.69, 1.0)),
        ),
        (
            {"h": 0.07336322554555809, "R": 0.8760726697180561, "omega": 0.7374774926087023,
             "f": 1.0, "p": 1.1425151123961863, "clearance": 0.7630138730968545},
            (3.824677972367527, 6.280338273292941, 10.079123596335206, 12.209133830654347),
            (0.7990778812042152, 0.0, 1.6287415230203897, 0.9667611108875604),
            (("p", 0.515, 1.485), ("f", 0.69, 1.31)),
        ),
    ],
)  # fmt: skip
def test_the_grazes_of_two_periods_end_where_both_halves_graze(values, phases, speeds, ranges):
    """From wherever the curve is followed, also if only one half has the touch as an impact.

    Without its touch the orbit of 2/3 is 1/1 there, and has its flip in closed form and its graze.
    """
    start, ends = PeriodicOrbit(Oscillator(**values), 2, np.array(phases), np.array(speeds)), []
    whole = bifurcation_curve(start, "graze", *ranges)
    for i in len(whole.values) * np.array([1, 2, 3]) // 4:
        (end,) = [
            p for p in bifurcation_curve(whole.orbit(i), "graze", *ranges).special
            if p.kind == "graze"
        ]  # fmt: skip
        ends.append(end.value)
        if start.q == 3:
            single = one_impact_orbit(end.orbit.oscillator)
            assert single.multipliers[0] == pytest.approx(-1.0, abs=1e-8)
            assert peak(single) == pytest.approx(0.0, abs=1e-9)
        else:
            half = PeriodicOrbit(
                end.orbit.oscillator, 1, end.orbit.phases[:2], end.orbit.speeds[:2]
            )
            assert half.exists and half.characteristic == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert np.ptp(ends, axis=0).max() < 1e-9


@pytest.mark.slow
def test_folds_on_which_all_impacts_lose_their_speed_end_in_the_same_graze():
    """At h = 0 and omega = p / 2, where every motion without impacts has the period of the force.

    Without units the end depends on R alone, so two pairs of parameters lead to the same end.
    """
    osc = Oscillator(
        h=0.0, R=0.22962440475055887, omega=0.49684387536385977, f=2.8364653295094806,
        p=1.0026497831094847, clearance=3.0817931897581423,
    )  # fmt: skip
    phases, speeds = (4.749380558199104, 10.967371106745038), (0.0165892567959, 0.1053157937763)
    start, ends = PeriodicOrbit(osc, 2, np.array(phases), np.array(speeds)), []
    for second in (("omega", 0.27, 0.73), ("f", 0.84, 4.84)):
        whole = bifurcation_curve(start, "fold", ("p", 0.3, 1.7), second)
        for i in len(whole.values) * np.array([1, 2, 3]) // 4:
            special = bifurcation_curve(whole.orbit(i), "fold", ("p", 0.3, 1.7), second).special
            assert sorted(point.kind for point in special) == ["edge", "graze"]
            (end,) = [point.orbit for point in special if point.kind == "graze"]
            assert not end.speeds.any()
            assert np.sin(end.phases) == pytest.approx([-1.0, -1.0], abs=1e-12)
            o = end.oscillator
            ends.append((o.omega / o.p, o.p**2 * o.clearance / o.f))
    assert np.ptp(ends, axis=0).max() < 1e-8
    assert ends[0][0] == pytest.approx(0.5, abs=1e-8)


def test_the_graze_of_an_orbit_that_is_symmetric_in_time_is_followed_through_both_its_touches():
    """Without damping and loss, each touch has its mirror image about the impact at 3 pi / 2.

    At clearance 0 nothing but omega / p matters without units, so the curve is a straight line.
    """
    osc = Oscillator(h=0.0, R=1.0, omega=3.4357072811811675, f=1.0, p=1.1029479945702383)
    touch = 7.06666735
    start = PeriodicOrbit(osc, 2, np.array([1.5 * math.pi, touch]), np.array([0.21772937, 0.0]))
    found = bifurcation_curve(start, "graze", ("p", 0.83, 1.17), ("omega", 2.8, 4.1))
    assert [point.kind for point in found.special] == ["edge", "edge"]
    assert len(found.values) < 60
    p, omega = found.values.T
    assert np.ptp(p) > 0.25 and np.ptp(omega / p) < 1e-9
    x, v = found.orbit(0).sections(3.0 * math.pi - touch)[0]  # at the mirror image
    assert (x, v) == pytest.approx((0.0, 0.0), abs=1e-7)


def test_a_graze_of_any_natural_vibration_has_no_curve():
    """At h = 0 and omega = 4 p the orbits of 4/1 vanish, and vibrations of any phase touch."""
    osc = Oscillator(h=0.0, R=0.8, omega=4.2, f=1.0, clearance=1.0)
    (end,) = [p for p in branch(one_impact_orbit(osc, 4), "omega", 3.0, 4.3).special
              if p.kind == "graze"]  # fmt: skip
    for second in (("p", 0.8, 1.2), ("R", 0.5, 1.0), ("clearance", 0.5, 1.5)):
        with pytest.raises(OrbitError, match=r"not isolated.* 4 forcing periods at omega = 4"):
            bifurcation_curve(end.orbit, "graze", ("omega", 3.0, 4.3), second)


def test_the_folds_are_those_of_the_closed_form():
    osc = Oscillator(h=0.1, R=0.8, omega=1.5, f=1.0, clearance=1.0)
    found = bifurcation_curve(one_impact_orbit(osc), "fold", ("omega", 1.4, 2.0), ("R", 0.6, 0.9))
    assert len(found.values) > 5
    for omega, R in found.values[::3]:
        expected = bifurcation(replace(osc, R=R), "fold", "omega", 1.45, 2.0)
        assert omega == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize(("R", "omega", "slowest"), [(0.575, 0.54, 0), (0.725, 0.4, 12)])
def test_the_folds_of_a_long_chatter_are_followed_from_wherever_the_slowest_impact_is(
    R, omega, slowest
):
    """The curve of 1/13 from two of its points, over the range of configs/period-map.yaml.

    A solution of the linearised flights that is not the shortest one moves the slowest impacts
    most, by more than their speed. Where the slowest is the last, the fold was lost half way.
    """
    osc = Oscillator(h=0.02, R=R, omega=omega, f=1.0)
    run = simulate(osc, 120)
    start = periodic_orbit(osc, run.section_x[-1], run.section_v[-1])
    (fold,) = [p for p in branch(start, "omega", 0.3, 1.2).special if p.kind == "fold"]
    assert (fold.orbit.q, np.argmin(fold.orbit.speeds)) == (13, slowest)
    found = bifurcation_curve(fold.orbit, "fold", ("omega", 0.3, 5.6), ("R", 0.3, 0.95))
    ends = sorted(point.value.tolist() for point in found.special)
    assert [point.kind for point in found.special] == ["edge", "edge"]
    assert ends == [
        pytest.approx([0.34079, 0.95], abs=1e-5),
        pytest.approx([0.92469, 0.3], abs=1e-5),
    ]


def test_folds_that_grow_without_bound_leave_the_other_direction_its_work(monkeypatch):
    """Dux: at h = 0 the folds of n/1 have V = 2 |sigma| k / (rho (1 + k^2)), rho = (1 - R) / omega.

    There k^2 = (sigma / gamma)^2 - 1, gamma = 1 / (1 - omega^2): they never reach R = 1.
    """
    monkeypatch.setattr("vibroimpact.orbits.family.MOST_WORK", 80_000)
    start = one_impact_orbits(Oscillator(0.0, 0.75, 4.15, 1.0, clearance=-0.1), 2)[0]
    ranges = ("omega", 1.0, 8.0), ("R", 0.1, 1.0)
    edge, lost = bifurcation_curve(start, "fold", *ranges).special
    if edge.kind == "lost":
        edge, lost = lost, edge
    assert (edge.kind, lost.kind, edge.value[1]) == ("edge", "lost", 0.1)
    omega, R = lost.value
    k = math.sqrt((0.1 * (omega**2 - 1.0)) ** 2 - 1.0)
    grown = 0.2 * k * omega / ((1.0 - R) * (1.0 + k * k))
    assert lost.orbit.speeds[0] == pytest.approx(grown, rel=1e-6) and grown > 1000.0


def test_bad_requests_are_refused():
    start, f, omega = one_impact_orbit(SCENE, 2), ("f", 0.2, 0.6), ("omega", 0.7, 0.9)
    with pytest.raises(ValueError, match="kind must be one of flip, fold, graze"):
        bifurcation_curve(start, "torus", f, omega)
    with pytest.raises(ValueError, match="not f twice"):
        bifurcation_curve(start, "flip", f, f)
    for low, high in ((0.82, 0.9), (0.7, 0.8)):
        with pytest.raises(
            OrbitError, match=f"the flip is at omega = 0.81, outside {low} to {high}"
        ):
            bifurcation_curve(start, "flip", f, ("omega", low, high))
    steady = one_impact_orbit(Oscillator(h=0.0, R=0.8, omega=2.0, f=1.0))
    with pytest.raises(OrbitError, match="no fold"):
        bifurcation_curve(steady, "fold", ("omega", 1.8, 2.2), ("R", 0.7, 0.9))


def test_a_curve_of_grazes_ends_at_the_edge_where_two_impacts_meet():
    """At R = 0 the impact comes when the force begins to pull, and the graze comes with it.

    So the flight from there, with no speed, is back at the stop after one period.
    """
    h, clearance = 0.1, 0.2
    release = -math.asin(clearance)

    def misses(omega):
        response = -1.0 / (1.0 - omega**2 + 2j * h * omega) * np.exp(1j * release)
        x, v = clearance - response.imag, -(1j * omega * response).imag
        T, Omega = 2.0 * math.pi / omega, math.sqrt(1.0 - h**2)
        free = x * math.cos(Omega * T) + (v + h * x) / Omega * math.sin(Omega * T)
        return math.exp(-h * T) * free + response.imag - clearance

    start = periodic_orbit(Oscillator(h=h, R=0.5, omega=1.3, f=1.0, clearance=clearance), -0.3, 0.0)
    found = bifurcation_curve(start, "graze", ("R", 0.0, 1.0), ("omega", 0.65, 2.21))
    assert [point.kind for point in found.special] == ["edge", "edge"]
    end = found.special[0]
    assert end.value[0] == 0.0
    assert end.value[1] == pytest.approx(brentq(misses, 1.6, 1.8, xtol=1e-15), abs=1e-8)


@pytest.mark.parametrize(
    ("kind", "omega", "clearance", "n"),
    [("flip", 2.6, 0.1, 1), ("fold", 3.6, 0.25, 2), ("graze", 1.2, 0.05, 1)],
)
def test_a_curve_over_the_amplitude_of_a_base_is_that_of_the_force_there(kind, omega, clearance, n):
    """At every point of the curve the orbit of f = a omega^2 has the same bifurcation."""
    osc = Oscillator(h=0.02, R=0.8, omega=omega, clearance=clearance, a=1.0 / omega**2)
    start = one_impact_orbit(osc, n)
    ends = [p for p in branch(start, "omega", 0.7 * omega, 1.4 * omega).special if p.kind == kind]
    found = bifurcation_curve(
        ends[0].orbit, kind, ("omega", 0.7 * omega, 1.4 * omega), ("a", 0.05, 1.2)
    )
    assert len(found.values) > 8 and np.ptp(found.values[:, 1]) > 0.02
    for i, (at, a) in enumerate(found.values[1:-1].tolist(), 1):
        force = replace(osc, omega=at, f=a * at * at, a=0.0)
        here = PeriodicOrbit(force, found.m, found.phases[i], found.speeds[i])
        assert not why_inadmissible(here)
        if kind == "graze":
            assert found.speeds[i].min() == 0.0
        else:
            c0, c1, c2 = here.characteristic
            zero = c0 + c2 + (c1 if kind == "fold" else -c1)
            assert abs(zero) < 1e-9 * (abs(c0) + abs(c1) + abs(c2))
