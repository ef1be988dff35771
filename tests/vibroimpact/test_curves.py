"""Curves of bifurcations in two parameters, against closed forms and published values."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BarycentricInterpolator

from tests.helpers.oscillators import characteristic, settled_orbit
from vibroimpact.orbits.branches import branch, doubled_branch, grazing_branch
from vibroimpact.orbits.calls import _do
from vibroimpact.orbits.curves import bifurcation_curve
from vibroimpact.orbits.family import OrbitFamily
from vibroimpact.orbits.one_impact import one_impact_orbit, one_impact_orbits
from vibroimpact.orbits.orbit import PeriodicOrbit
from vibroimpact.orbits.periodic import OrbitError, periodic_orbit, why_inadmissible
from vibroimpact.oscillator import Oscillator

#: Ghosh & Simpson (arXiv 2510.16218): b = 2 h = .04, r = R = .9, the stop at 1; n = 2.
SCENE = Oscillator(h=0.02, R=0.9, omega=0.81, f=0.35, clearance=1.0)
#: Its orbit of 1/1 is stable.
STEADY = Oscillator(h=0.0, R=0.8, omega=2.0, f=1.0)


def test_the_flips_without_damping_are_on_the_closed_form():
    start = one_impact_orbit(Oscillator(h=0.0, R=0.8, omega=2.6, f=1.0))
    found = bifurcation_curve(start, "flip", ("omega", 2.0, 3.5), ("R", 0.2, 0.98))
    omega, R = found.values.T
    curve = np.cos(math.pi / omega) ** 2 * (omega**2 - ((1.0 - R) / (1.0 + R)) ** 2)
    assert np.abs(curve - 1.0).max() < 1e-13
    assert sorted(point.value[1] for point in found.special) == [0.2, 0.98]
    assert {point.kind for point in found.special} == {"edge"}


def test_a_curve_of_flips_has_no_degenerate_one_at_its_end_where_all_are():
    """Where no energy is lost, h = 0 and R = 1, the cubic coefficient is rounding."""
    osc = Oscillator(h=0.4641199095574239, R=1.0, omega=4.455459614639571, f=1.0)
    flip = PeriodicOrbit(osc, 2, np.array([0.9198743974]), np.array([0.1933444302]))
    found = bifurcation_curve(flip, "flip", ("omega", 2.1560822502, 4.7912938894), ("h", 0.0, 0.48))
    assert [point.kind for point in found.special] == ["edge", "edge"]
    assert found.special[-1].value[1] == 0.0


#: At omega = 2 n Omega / k, k = 5, flips and folds meet the graze of the free oscillation.
MEETING = 4.0 * math.sqrt(1.0 - 0.02**2) / 5.0


def free_graze(omega):
    """Return the force at which the free oscillation reaches the stop."""
    return math.hypot(1.0 - omega**2, 0.04 * omega)


@pytest.mark.parametrize(
    ("kind", "omega", "f", "beside", "slower"),
    [("flip", 0.81, 0.35, 0.008, False), ("fold", 0.796, 0.369, -0.0032, True)],
)
def test_flips_and_folds_are_tangent_to_the_graze(kind, omega, f, beside, slower):
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


def test_the_flips_of_long_orbits_end_where_those_of_two_periods_do():
    """All speeds vanish there, and the multipliers change faster and faster towards it."""
    start = settled_orbit(replace(SCENE, omega=0.8199159663865546, f=0.3372268907563025), 4)
    flips = [p for p in branch(start, "f", 0.31, 0.4).special if p.kind == "flip"]
    flip = min((p for p in flips if p.orbit.q == 2), key=lambda p: abs(p.value - 0.337))
    assert flip.orbit.m == 4
    found = bifurcation_curve(flip.orbit, "flip", ("f", 0.31, 0.4), ("omega", 0.78, 0.83))
    (end,) = [p for p in found.special if p.kind == "graze" and p.value[0] > 0.35]
    assert end.value == pytest.approx([free_graze(MEETING), MEETING], abs=2e-8)
    assert {p.kind for p in found.special} <= {"graze", "edge"}
    assert len(found.values) < 60
    for (f, omega), phases, speeds in zip(found.values, found.phases, found.speeds, strict=True):
        if speeds.min() > 0.02:  # below, the rounding of the phases alone may be seen
            orbit = PeriodicOrbit(replace(SCENE, f=f, omega=omega), 4, phases, speeds)
            assert np.abs(orbit.multipliers + 1.0).min() < 1e-10


@pytest.mark.parametrize(("fails_below", "kind"), [(1e-7, "graze"), (1e-4, "lost")])
def test_a_curve_that_ends_short_of_the_graze_is_lost(monkeypatch, fails_below, kind):
    """Newton's method fails where an impact is slower than a share of the natural unit."""
    corrected = OrbitFamily.corrected

    def fails(self, *arguments, **options):
        X = corrected(self, *arguments, **options)
        return None if X is not None and 0.0 < X[1 : 2 * self.q : 2].min() < fails_below else X

    monkeypatch.setattr(OrbitFamily, "corrected", fails)
    start = one_impact_orbit(replace(SCENE, omega=0.81, f=0.35), 2)
    found = bifurcation_curve(start, "flip", ("f", 0.2, 0.6), ("omega", 0.7, 0.9))
    assert {point.kind for point in found.special} == {"edge", kind}
    (end,) = [point for point in found.special if point.kind == kind]
    unit = 2.0  # f + 1 over omega^2 + 2 h omega + 1 is 1.07 at most, and p = 1
    assert end.orbit.speeds.min() == pytest.approx(unit * fails_below, rel=0.1)


def test_the_graze_of_a_doubled_orbit_ends_where_the_orbit_flips_and_grazes():
    """There both halves of the orbit of 6/6 become that of 3/3, and both touch the stop."""
    osc = Oscillator(h=0.02, R=0.48618090452261303, omega=5.121404682274248, f=1.0)
    start = settled_orbit(osc, 6)
    ends = []
    for point in branch(start, "omega", 4.9, 5.4).special:
        found = bifurcation_curve(point.orbit, point.kind, ("omega", 0.3, 5.6), ("R", 0.3, 0.95))
        assert (found.kind, found.m, found.q) in (("graze", 6, 7), ("flip", 3, 3))
        (end,) = [p for p in found.special if p.kind == "graze" and p.value[1] < 0.5]
        ends.append(end.value)
    assert len(ends) == 2 and ends[0] == pytest.approx(ends[1], abs=1e-6)


@pytest.mark.parametrize("last", [7.3, 18.0])
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


def test_no_flips_and_folds_meet_the_grazes_of_a_long_period_without_damping():
    """A touch halves a flight that is symmetric in time: c1 is rounding, which grows with it."""
    scene = Oscillator(h=0.0, R=0.9, omega=12 * 1.95, f=1.0)
    start = branch(one_impact_orbit(scene, 12), "omega", 0.6 * scene.omega, 1.3 * scene.omega)
    (graze,) = [point for point in start.special if point.kind == "graze"]
    ranges = ("omega", 0.5 * scene.omega, 1.5 * scene.omega), ("R", 0.2, 0.97)
    found = bifurcation_curve(graze.orbit, "graze", *ranges)
    assert len(found.values) > 10
    assert not {"flip", "fold"} & {point.kind for point in found.special}


@pytest.mark.parametrize("width", [1e-7, 1e-10])
def test_a_curve_over_narrow_ranges_goes_from_edge_to_edge(width):
    scene = Oscillator(h=0.05, R=0.8, omega=2.65888454668484, f=1.0)
    ranges = [(x, getattr(scene, x) - width, getattr(scene, x) + width) for x in ("omega", "R")]
    found = bifurcation_curve(one_impact_orbit(scene), "flip", *ranges)
    assert [point.kind for point in found.special] == ["edge", "edge"]
    assert sorted(point.value[1] for point in found.special) == [0.8 - width, 0.8 + width]


def test_flips_end_where_the_half_flips_and_grazes():
    """Two impacts graze at once there, from wherever the curve is followed."""
    osc = Oscillator(
        h=0.03248394936950036, R=0.7220791517847076, omega=0.5405952185512377, f=1.0,
        clearance=0.9953778065642878,
    )  # fmt: skip
    phases = np.array([3.905924331717607, 5.828285362545925, 9.84281469136646, 11.694508288193362])
    speeds = np.array([0.6420265968978819, 0.1938865751191821, 0.6493200840191526, 0.664996139402])
    start = PeriodicOrbit(osc, 2, phases, speeds)
    first, second = ("clearance", -0.326, 1.674), ("omega", 0.282, 0.846)
    whole = bifurcation_curve(start, "flip", first, second)
    ends = []
    for found in (whole, bifurcation_curve(whole.orbit(1), "flip", first, second)):
        (end,) = [p for p in found.special if np.sort(p.orbit.speeds)[1] < 1e-4]
        assert end.kind == "graze" and len(found.values) < 80
        ends.append(end.value)
        orbit = end.orbit
        half = PeriodicOrbit(orbit.oscillator, 1, orbit.phases[:2], orbit.speeds[:2])
        assert characteristic(half) == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
    assert np.ptp(ends, axis=0).max() < 1e-6


def test_bad_requests_are_refused():
    start, f, omega = one_impact_orbit(SCENE, 2), ("f", 0.2, 0.6), ("omega", 0.7, 0.9)
    with pytest.raises(ValueError, match=r"kind = .* expected: one of flip, fold, graze"):
        bifurcation_curve(start, "torus", f, omega)
    with pytest.raises(ValueError, match="not f twice"):
        bifurcation_curve(start, "flip", f, f)
    for low, high in ((0.82, 0.9), (0.7, 0.8)):
        said = f"the flip is at omega = 0.81, outside {low} to {high}"
        with pytest.raises(OrbitError, match=said):
            bifurcation_curve(start, "flip", f, ("omega", low, high))
    steady = one_impact_orbit(STEADY)
    for kind, second in (("flip", ("R", 0.6, 0.9)), ("fold", ("R", 0.1, 0.2))):
        for ranges in (("omega", 4.0, 5.0), second), (second, ("omega", 4.0, 5.0)):
            with pytest.raises(OrbitError, match=r"the orbit is at (omega|R) = .*, outside"):
                bifurcation_curve(steady, kind, *ranges)


@pytest.mark.parametrize(
    ("kind", "osc", "first"),
    [
        ("fold", STEADY, ("omega", 1.8, 2.2)),
        ("fold", STEADY, ("f", 0.0, 1.4)),  # without force the equations are those of a fold
        # The flip that is near has a flight across the stop.
        ("flip", Oscillator(0.0, 0.42, 1.17, 1.0, clearance=0.29), ("clearance", -1.0, 2.0)),
    ],
)
def test_no_other_bifurcation_is_taken_for_one_of_the_orbit(kind, osc, first):
    with pytest.raises(OrbitError, match=f"no {kind} is found"):
        bifurcation_curve(one_impact_orbit(osc), kind, first, ("h", 0.0, 1.0))


@pytest.mark.parametrize(
    ("kind", "omega", "clearance", "n"),
    [("flip", 2.6, 0.1, 1), ("graze", 1.2, 0.05, 1)],
)
def test_a_curve_over_the_amplitude_of_a_base_is_that_of_the_force_there(kind, omega, clearance, n):
    """At every point of the curve the orbit of f = a omega^2 has the same bifurcation."""
    osc = Oscillator(h=0.02, R=0.8, omega=omega, clearance=clearance, a=1.0 / omega**2)
    start = one_impact_orbit(osc, n)
    axis = "omega", 0.7 * omega, 1.4 * omega
    ends = [p for p in branch(start, *axis).special if p.kind == kind]
    found = bifurcation_curve(ends[0].orbit, kind, axis, ("a", 0.05, 1.2))
    assert len(found.values) > 8 and np.ptp(found.values[:, 1]) > 0.02
    for i, (at, a) in enumerate(found.values[1:-1].tolist(), 1):
        force = replace(osc, omega=at, f=a * at * at, a=0.0)
        here = PeriodicOrbit(force, found.m, found.phases[i], found.speeds[i])
        assert not why_inadmissible(here)
        if kind == "graze":
            assert found.speeds[i].min() == 0.0
        else:
            c0, c1, c2 = characteristic(here)
            zero = c0 + c2 + (c1 if kind == "fold" else -c1)
            assert abs(zero) < 1e-9 * (abs(c0) + abs(c1) + abs(c2))


RANGE = "omega", 1.56, 4.16


def test_all_that_python_asks_of_orbits_is_compiled_once():
    osc = Oscillator(h=0.02, R=0.6, omega=2.6, f=1.0, clearance=0.3)
    orbit = next(orbit for orbit in one_impact_orbits(osc, 2) if orbit.exists)
    assert periodic_orbit(osc, *orbit.sections()[0], m=2).q == 1
    special = branch(orbit, *RANGE).special
    assert [point.kind for point in special] == ["graze", "fold", "flip", "graze"]
    for point in special:
        assert bifurcation_curve(point.orbit, point.kind, RANGE, ("R", 0.5, 0.9)).special
        follow = {"flip": doubled_branch, "graze": grazing_branch}.get(point.kind)
        if follow:
            assert follow(point.orbit, *RANGE).special
    assert len(_do.overloads) == 1
