"""Curves that end where their equations are singular: impacts meet, or the force vanishes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from tests.helpers.naive import ClosedForm
from tests.helpers.oscillators import TAU, settled_orbit
from vibroimpact.orbits import singular_ends
from vibroimpact.orbits.branches import branch
from vibroimpact.orbits.curves import bifurcation_curve
from vibroimpact.orbits.orbit import PeriodicOrbit
from vibroimpact.oscillator import Oscillator


def test_grazes_end_without_restitution_where_their_impacts_meet():
    """The mass leaves there without speed and acceleration, and returns after one period."""
    osc = Oscillator(h=0.65, R=0.24, omega=1.19, f=1.0, clearance=0.22)

    def misses(clearance):
        there, phase = replace(osc, R=0.0, clearance=clearance), TAU - math.asin(clearance)
        flight = ClosedForm(there, phase / there.omega, clearance, 0.0)
        return flight((phase + TAU) / there.omega)[0] - clearance

    ranges = ("clearance", -0.28, 0.72), ("R", 0.0, 1.0)
    special = branch(settled_orbit(osc, 1), *ranges[0]).special
    curve = bifurcation_curve(special[0].orbit, "graze", *ranges)
    for i in (1, len(curve.values) // 2):
        end = bifurcation_curve(curve.orbit(i), "graze", *ranges).special[-1]
        assert (end.kind, end.value[1]) == ("edge", 0.0)
        assert end.value[0] == pytest.approx(brentq(misses, 0.3, 0.6), abs=3e-6)


#: Undamped curves whose impacts meet without restitution at the phase of the release: clearance,
#: kind, omega and R of an orbit of two periods, phases, speeds.
MEETING_IMPACTS = [
    (
        0.0, "graze", 3.5897, 0.06496, (0.011941804, 11.899248836, 12.433201914, 12.542486954),
        (0.0, 0.534734431, 0.022627675, 0.000917274),
    ),
    (
        -0.08645927, "flip", 3.93846, 0.47672, (0.152928336, 11.115926873),
        (0.088957952, 0.35750728),
    ),
]  # fmt: skip


@pytest.mark.parametrize(
    ("clearance", "kind", "omega", "R", "phases", "speeds"), MEETING_IMPACTS, ids=range(2)
)
def test_curves_end_where_impacts_meet_from_wherever_they_are_followed(
    clearance, kind, omega, R, phases, speeds
):
    """There the flight from the release, without speed, returns after two periods."""
    osc = Oscillator(h=0.0, R=R, omega=omega, f=1.0, clearance=clearance)

    def misses(omega):
        phase = math.asin(-clearance)
        flight = ClosedForm(replace(osc, R=0.0, omega=omega), phase / omega, clearance, 0.0)
        return flight((phase + 2.0 * TAU) / omega)[0] - clearance

    expected = [4.0, 0.0] if clearance == 0.0 else [brentq(misses, 5.5, 5.7), 0.0]
    start = PeriodicOrbit(osc, 2, np.array(phases), np.array(speeds))
    ranges = ("omega", 2.0, 6.5), ("R", 0.0, 1.0)
    whole = bifurcation_curve(start, kind, *ranges)
    last = len(whole.values) - 1
    for i in (1, last - 1):
        found = bifurcation_curve(whole.orbit(i), kind, *ranges)
        (end,) = [point for point in found.special if point.value[1] == 0.0]
        assert end.kind == "edge" and end.value == pytest.approx(expected, abs=1e-7)
        assert len(found.values) < 70


def test_a_curve_of_grazes_begins_again_at_both_its_ends():
    """Two impacts graze in one, and both belong to curves; in the other they meet, at R = 0."""
    osc = Oscillator(
        h=0.0, R=0.6599255018918619, omega=0.4943340875504545, f=1.0, clearance=0.9301577671118946
    )
    phases = np.array([4.16444967570301, 4.761508247609207, 5.234483142160295])
    speeds = np.array([0.003599339511846704, 0.032520642969117594, 0.0])
    ranges = ("omega", 0.32, 1.024), ("R", 0.0, 1.0)
    whole = bifurcation_curve(PeriodicOrbit(osc, 1, phases, speeds), "graze", *ranges)
    ends = sorted(point.value.tolist() for point in whole.special)
    assert [value for _, value in ends] == [0.0, 1.0]
    for orbit in (whole.orbit(0), whole.orbit(-1)):
        special = bifurcation_curve(orbit, "graze", *ranges).special
        again = np.array(sorted(point.value.tolist() for point in special))
        assert again == pytest.approx(np.array(ends), abs=1e-7)


#: Undamped folds of one period: R, omega, f, clearance, phases, speeds.
TO_NO_FORCE = [
    (
        (0.9965803421259316, 0.7607653362049325, 0.06042281052483288, 0.6270812181281815),
        (0.7633413817917072, 3.947024142884595), (1.111814781285423, 1.221210963442465),
    ),
    (
        (0.7779929238959551, 0.5555776014353873, 0.07958976916286647, 0.0393938356800381),
        (0.4233866464748246, 3.322479843029022, 4.8927023264286795),
        (0.04069101575910028, 0.1516707734463005, 0.1547331276211238),
    ),
]  # fmt: skip


@pytest.mark.parametrize(
    ("case", "second", "last"),
    [
        (0, ("R", 0.0, 1.0), 1.0),
        (1, ("R", 0.0, 1.0), 1.0),
        (0, ("omega", 0.38, 1.52), 0.5),
    ],
)
def test_undamped_folds_go_to_where_the_force_vanishes(case, second, last):
    """A free vibration that loses nothing, at R = 1, or that touches, of half the period.

    Their equations are singular there: from wherever they are followed, they ended beside it.
    """
    (R, omega, f, clearance), phases, speeds = TO_NO_FORCE[case]
    osc = Oscillator(h=0.0, R=R, omega=omega, f=f, clearance=clearance)
    start, ranges = PeriodicOrbit(osc, 1, np.array(phases), np.array(speeds)), ("f", 0.0, 3.0)
    whole = bifurcation_curve(start, "fold", ranges, second)
    for i in (3, len(whole.values) // 2):
        found = bifurcation_curve(whole.orbit(i), "fold", ranges, second)
        end = min((found.special[0], found.special[-1]), key=lambda point: point.value[0])
        assert end.kind == "edge" and end.value == pytest.approx([0.0, last], abs=1e-8)
        assert end.value[0] == 0.0 and 30 < len(found.values) < 100


def test_of_a_long_path_only_the_end_is_asked_where_it_leads():
    """All of its points at each of its steps took 8 s, at R = 1 and h = 1e-6 in resonance."""
    asked = []
    path = [np.array([0.1 + 0.99**n, 0.99**n]) for n in range(2000)]

    def place(X):
        asked.append(X)
        return X[1]

    limit, error = singular_ends._limit(path, place, 0.1)
    assert limit == pytest.approx([0.1, 0.0], abs=1e-9) and error < 1e-9
    assert len(asked) < 200


def test_undamped_folds_reach_the_edge_without_restitution():
    """Their last orbit grazes there, so that by rounding it is none: they ended at R = 1e-8."""
    osc = Oscillator(
        h=0.0, R=0.33630060467398976, omega=0.6672629512951769, f=1.0, clearance=1.1183322337971733
    )
    phases, speeds = [0.09907549419791817, 3.754611337525312], [0.185264376789, 2.704817318761]
    start = PeriodicOrbit(osc, 1, np.array(phases), np.array(speeds))
    found = bifurcation_curve(start, "fold", ("R", 0.0, 1.0), ("f", 0.5, 1.5))
    assert [point.kind for point in found.special] == ["edge", "edge"]
    assert found.special[0].value[0] == 0.0
