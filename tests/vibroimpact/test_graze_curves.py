"""Curves of grazes in two parameters, and their ends."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

from tests.helpers.naive import ClosedForm
from tests.helpers.oscillators import TAU, peak, settled_orbit, special
from vibroimpact.orbits.branches import branch, doubled_branch, grazing_branch
from vibroimpact.orbits.curves import bifurcation_curve
from vibroimpact.orbits.family import OrbitFamily
from vibroimpact.orbits.one_impact import one_impact_orbit, one_impact_orbits
from vibroimpact.orbits.orbit import PeriodicOrbit, free_orbit
from vibroimpact.orbits.periodic import OrbitError, periodic_orbit, solved
from vibroimpact.oscillator import Oscillator


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


def test_a_branch_ends_at_the_touch_and_not_where_its_flight_turns_below_the_stop():
    """A slow rebound turns back at once; it touches at the last of its turns (closed form)."""
    osc = Oscillator(h=1.443065017324836, R=0.5, omega=2.590074916619486, f=1.0)
    graze = branch(one_impact_orbit(osc), "R", 0.0, 1.0).special[0].orbit
    (touch, impact), (_, v), there = graze.phases, graze.speeds, graze.oscillator
    flight = ClosedForm(there, (impact - TAU) / there.omega, 0.0, -there.R * v)
    assert np.abs(flight(touch / there.omega)).max() < 1e-9
    curve = bifurcation_curve(graze, "graze", ("R", 0.0, 1.0), ("h", 0.0, 2.0 * osc.h))
    assert [end.kind for end in curve.special] == ["edge", "edge"]


def test_a_branch_ends_at_the_highest_point_of_a_flight_of_any_height():
    """After a rebound at 4e-8 the mass turns 9e-12 below the stop before it touches."""
    osc = Oscillator(
        h=0.00672728141095631, R=0.004618006546053631, omega=1.8797961905865022, f=1.0
    )  # fmt: skip
    phases = np.array([0.004553880087740914, 6.086120800697817, 6.274077450288427])
    speeds = np.array([0.0, 1.4506499999736764, 0.003583435467324087])
    graze = grazing_branch(PeriodicOrbit(osc, 1, phases, speeds), "R", 0.0, 1.0).special[-1].orbit
    (touch, *_, launch), there = np.sort(graze.phases), graze.oscillator
    assert (graze.q, int(np.argmin(graze.speeds))) == (4, int(np.argmin(graze.phases)))
    flight = ClosedForm(there, (launch - TAU) / there.omega, 0.0, -there.R * graze.speeds[-1])
    for away in (-2e-4, -1e-4, 1e-4, 2e-4):
        assert flight((touch + away) / there.omega)[0] < -1e-13
    assert abs(flight(touch / there.omega)[0]) < 1e-16


def test_a_branch_ends_at_a_touch_within_its_flight():
    """From a slow rebound Newton's method may lead to before its launch."""
    osc = Oscillator(h=0.2265, R=0.58, omega=4.93, f=1.0, clearance=-0.25717)
    start = branch(one_impact_orbit(osc), "R", 0.0, 1.0).special[0]
    orbit = branch(start.orbit, "R", 0.0, start.value).special[0].orbit
    there, times = orbit.oscillator, np.append(orbit.phases, orbit.phases[0] + TAU) / osc.omega
    for i, v in enumerate(orbit.speeds):
        x, arrival = ClosedForm(there, times[i], there.clearance, -there.R * v)(times[i + 1])
        assert x - there.clearance == pytest.approx(0.0, abs=1e-12)
        assert arrival == pytest.approx(orbit.speeds[(i + 1) % 3], abs=1e-12)


@pytest.mark.parametrize(
    ("h", "low", "high", "count", "near"),
    [
        (0.02, 0.3, 2.5, 6, 1e-12),
        (0.05, 0.1, 0.3, 13, 1e-12),
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


@pytest.mark.parametrize(("f", "a"), [(1.0, 0.0), (0.5, 0.7), (0.0, 1.0)])
def test_the_free_oscillation_grazes_beside_its_resonance(f, a):
    """The clearance is 1e-6 less than the greatest amplitude over omega."""

    def amplitude(omega):
        return (f + a * omega**2) / abs(complex(1.0 - omega**2, 0.2 * omega))

    peak = minimize_scalar(lambda omega: -amplitude(omega), bounds=(0.5, 1.5), method="bounded")
    osc = Oscillator(0.1, 0.8, 0.3, f, clearance=(1.0 - 1e-6) * amplitude(peak.x), a=a)
    found = branch(free_orbit(osc), "omega", 0.1, 3.0)
    assert special(found, "graze") == pytest.approx([peak.x], abs=1e-3)


def test_a_graze_between_the_repetitions_of_an_orbit_is_one_of_that_orbit():
    """The branch of 2/3 ends in a touch of 1/1, on whose curve its own equations are singular."""
    osc = Oscillator(1.0, 1.0, 2.1144407049282608, 1.0, 1.0, -0.2500887679118864)
    phases, speeds = np.array([0.61, 5.054, 11.246]), np.array([0.0646, 0.4874, 0.4675])
    end = branch(solved(osc, 2, phases, speeds), "f", 0.8, 1.1).special[-1]
    assert (end.kind, end.orbit.m, end.orbit.q) == ("graze", 2, 3)
    found = bifurcation_curve(end.orbit, "graze", ("f", 0.0, 1.1), ("R", 0.8, 1.0))
    assert (found.m, found.q) == (1, 2) and len(found.values) < 20
    assert [point.kind for point in found.special] == ["edge", "edge"]


def test_a_graze_of_all_impacts_is_that_of_the_free_oscillation():
    """Where 9/2 ends, both its impacts are touches of one oscillation, of amplitude f / |D|."""
    osc = Oscillator(0.1602367594878764, 0.16773159910106636, 7.351284129173936, 1.1977359445134217)
    stiffness = complex(1.0 - osc.omega**2, 2.0 * osc.h * osc.omega)
    phase = 0.5 * math.pi + np.angle(-stiffness)
    at_graze = replace(osc, clearance=osc.f / abs(stiffness))
    phases = phase + 2.0 * math.pi * np.array([0.0, 5.0])
    orbit = PeriodicOrbit(at_graze, 9, phases, np.zeros(2))
    found = bifurcation_curve(orbit, "graze", ("clearance", -0.6, 0.6), ("f", 0.33, 1.76))
    assert [point.kind for point in found.special] == ["edge", "edge"]
    clearance, f = found.values.T
    np.testing.assert_allclose(clearance * abs(stiffness), f, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("last", "f"), [(0.59, 0.960733250477590), (0.62, 0.776919993099989)])
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


@pytest.mark.parametrize(
    ("kind", "values", "phases", "speeds"),
    [
        ("graze", (0.0, 0.1518, 2.945, 1.0, 0.52667), [0.5 * math.pi], [0.0]),
        ("fold", (0.0, 0.12612, 1.282, 1.0, 1.0, 3.47), [0.46423], [4.07623]),
        ("flip", (0.0, 0.13015, 5.633, 0.69745, 1.17767, -0.13273), [0.65646], [0.23582]),
    ],
)  # fmt: skip
def test_curves_over_clearance_and_force_end_where_both_vanish(kind, values, phases, speeds):
    """All motions are in proportion to them: they go straight there, whatever else is singular."""
    osc = Oscillator(*values)
    if kind == "graze":
        osc = replace(osc, clearance=1.0 / (osc.omega**2 - osc.p**2))
    start = PeriodicOrbit(osc, 1, np.array(phases), np.array(speeds))
    ranges = ("clearance", -0.3, 6.0), ("f", 0.0, 3.0)
    for first, second in (ranges, ranges[::-1]):
        found = bifurcation_curve(start, kind, first, second)
        (end,) = [point for point in found.special if max(np.abs(point.value)) < 1e-3]
        assert end.kind == "edge" and not end.value.any() and not end.orbit.speeds.any()


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


def test_the_grazes_of_two_periods_end_where_both_halves_graze():
    """From wherever the curve is followed, also if only one half has the touch as an impact.

    Without its touch the orbit of 2/3 is 1/1 there, and has its flip in closed form and its graze.
    """
    osc = Oscillator(
        h=0.09397136038870241, R=0.897225519910674, omega=1.0679112274635831, f=1.0,
        clearance=-0.046805682666813675,
    )  # fmt: skip
    phases = np.array([1.2411141224550395, 4.7112263048390695, 10.979057750127623])
    speeds = np.array([0.0, 1.4689443321344122, 1.4359842278728046])
    start, ends = PeriodicOrbit(osc, 2, phases, speeds), []
    ranges = ("omega", 0.61, 1.77), ("R", 0.69, 1.0)
    whole = bifurcation_curve(start, "graze", *ranges)
    for i in len(whole.values) * np.array([1, 3]) // 4:
        special = bifurcation_curve(whole.orbit(i), "graze", *ranges).special
        (end,) = [point for point in special if point.kind == "graze"]
        ends.append(end.value)
        single = one_impact_orbit(end.orbit.oscillator)
        assert single.multipliers[0] == pytest.approx(-1.0, abs=1e-6)
        assert peak(single) == pytest.approx(0.0, abs=1e-6)
    assert np.ptp(ends, axis=0).max() < 1e-6


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


def test_of_two_touches_that_are_as_high_a_branch_ends_at_the_first():
    """They are mirror images, so rounding decides which is higher; the flight is from 5.15."""
    osc = Oscillator(h=0.0, R=1.0, omega=3.0243202707740773, f=1.0, p=1.1400689679211657)
    flip = PeriodicOrbit(osc, 1, np.array([0.5 * math.pi]), np.array([0.3569890788]), "flip")
    graze = doubled_branch(flip, "p", 0.3, 2.0).special[-1]
    assert (graze.kind, int(np.argmin(graze.orbit.speeds))) == ("graze", 2)
    assert graze.orbit.phases == pytest.approx([4.2715294, 5.1532486, 6.8479183], abs=1e-6)


@pytest.mark.parametrize(
    ("osc", "ends"),
    [
        (Oscillator(h=0.0, R=0.8, omega=4.2, f=1.0, clearance=1.0), (3.0, 4.3)),
        (Oscillator(h=0.0, R=0.3905421531735368, omega=4.572512421159307, f=705.944676257835,
                    clearance=555.0104551298633), (3.6580099369274457, 5.4870149053911685)),
    ],
)  # fmt: skip
def test_at_a_graze_of_any_natural_vibration_no_branch_and_no_curve_begins(osc, ends):
    """At h = 0 and omega = 4 p the orbits of 4/1 vanish, and vibrations of any phase touch.

    Whether a point of a branch was found beside it was decided by rounding. In the second case the
    tangent has no digits there, and only the chord of the last step leads to the speed zero.
    """
    first = branch(one_impact_orbits(osc, 4)[0], "omega", *ends)
    end, *_ = (point for point in first.special if point.kind == "graze")
    with pytest.raises(OrbitError, match=r"not isolated.* 4 forcing periods at omega = 4"):
        grazing_branch(end.orbit, "omega", 3.0, 4.3)
    for second in (("p", 0.8, 1.2), ("R", 0.5, 1.0), ("clearance", 0.5, 1.5)):
        with pytest.raises(OrbitError, match=r"not isolated.* 4 forcing periods at omega = 4"):
            bifurcation_curve(end.orbit, "graze", ("omega", 3.0, 4.3), second)


def test_a_curve_of_grazes_ends_at_the_edge_where_two_impacts_meet():
    """At R = 0 the impact comes when the force begins to pull, and the graze comes with it.

    So the flight from there, with no speed, is back at the stop after one period. The equations are
    singular there, but the curve also begins there.
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
    ranges = ("R", 0.0, 1.0), ("omega", 0.65, 2.21)
    found, expected = bifurcation_curve(start, "graze", *ranges), brentq(misses, 1.6, 1.8)
    for curve in (found, bifurcation_curve(found.special[0].orbit, "graze", *ranges)):
        assert [point.kind for point in curve.special] == ["edge", "edge"]
        end, other = curve.special
        assert end.value == pytest.approx([0.0, expected], abs=1e-8) and end.value[0] == 0.0
        assert other.value == pytest.approx(found.special[1].value, abs=1e-11)


def test_the_meeting_of_fold_and_flip_is_found_from_all_along_a_curve_that_ends_nearby():
    """The curve of grazes of 4/15 ends soon after it, where its half flips and grazes at once."""
    osc = Oscillator(
        h=0.0018487332365935102, R=0.7598903998549367, omega=0.2657248029126758,
        p=0.8719130566548999, clearance=0.0025174938454066713, a=0.03149423520836844,
    )  # fmt: skip
    ranges = (
        ("clearance", 0.0012189682408229568, 0.0038160194499903856),
        ("p", 0.4015885710094935, 1.3422375423003063),
    )
    start = settled_orbit(osc, 4, periods=200)
    (graze,) = [p.orbit for p in branch(start, *ranges[0]).special if p.kind == "graze"]
    whole = bifurcation_curve(graze, "graze", *ranges)
    assert (whole.m, whole.q) == (4, 15)
    # Over wide ranges the speeds are far below 1 in natural units.
    wide, middle = (
        (("clearance", 1e-6, 4.0), ("p", 0.01, 40.0)),
        whole.orbit(len(whole.values) // 2),
    )
    both, meetings = (whole, bifurcation_curve(middle, "graze", *wide)), []
    for found in both:
        meetings.append(sorted(p.value.tolist() for p in found.special if p.kind == "flip"))
        off = np.abs(np.array(meetings[-1]) - [0.00245593876, 0.87834148624]).max(axis=1)
        assert off.min() < 1e-9
        assert [found.special[i].kind for i in (0, -1)] == ["graze", "graze"]
    assert np.array(meetings[0]) == pytest.approx(np.array(meetings[1]), rel=1e-9)


@pytest.mark.parametrize("axis", [("omega", 0.3, 1.4), ("p", 0.5, 1.8)])
def test_a_curve_of_grazes_ends_in_rest_where_an_impact_without_rebound_is_not_pushed_back(axis):
    """At R = 0 the mass rests after an impact unless f > p^2 clearance: there the curve ends."""
    h, omega, stop = 0.0011414497049191338, 0.7277327531658645, 1.3551098325624247
    osc = Oscillator(h=h, R=0.0, omega=omega, f=1.0, clearance=stop)
    start = settled_orbit(osc)
    grazes = [p.orbit for p in branch(start, *axis).special if p.kind == "graze"]
    (graze,) = [orbit for orbit in grazes if orbit.q == 2]
    found = bifurcation_curve(graze, "graze", ("omega", 0.3, 1.4), ("p", 0.5, 1.8))
    (end,) = [p for p in found.special if p.kind not in ("flip", "fold", "edge")]
    assert end.kind == "rest"
    assert end.value[1] == pytest.approx(osc.clearance**-0.5, abs=1e-6)
    assert np.sin(end.orbit.phases) == pytest.approx([-1.0, -1.0], abs=1e-6)
