"""Curves of folds in two parameters, and their ends."""

import math
from dataclasses import replace
from functools import cache

import mpmath as mp
import numpy as np
import pytest

from tests.helpers.oscillators import SectionMap, bifurcation, settled_orbit
from vibroimpact.orbits.branches import branch
from vibroimpact.orbits.calls import linearised
from vibroimpact.orbits.curves import bifurcation_curve
from vibroimpact.orbits.one_impact import one_impact_orbit, one_impact_orbits
from vibroimpact.orbits.orbit import PeriodicOrbit
from vibroimpact.orbits.periodic import OrbitError, periodic_orbit
from vibroimpact.oscillator import Oscillator


def test_two_folds_meet_in_a_cusp():
    """Beside it a branch has two folds on one side of its clearance, and none on the other."""
    osc = Oscillator(h=0.1, R=0.6, omega=0.65, f=1.0)
    (fold,) = [p for p in branch(settled_orbit(osc), "omega", 0.3, 4.0).special if p.kind == "fold"]
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
        (0.021473102103706, 0.9353643039006074, 2.9663304973371893, -0.0635302791139786), 6,
        (3.024822, 5.734295, 14.217375, 22.612327, 24.050315, 32.387493),
        (0.337564, 0.423413, 0.620606, 0.240073, 0.248158, 0.567443),
        "omega", "R", ["flip", "flip"],
    ),
    (
        (0.0, 0.7956213327887222, 3.1201084164210617, -0.05003928043741748), 4,
        (3.169325, 5.733403, 14.892395, 18.969393), (0.377231, 0.377638, 0.345366, 0.475584),
        "clearance", "omega", ["edge", "flip"],
    ),
]  # fmt: skip


RANGES = {"R": (0.3, 1.0), "omega": (0.5, 8.0), "clearance": (-0.3, 0.3)}


@cache
def even_folds(case):
    """Return the curve of a row of `EVEN_FOLDS`, and the ranges of its two parameters."""
    (h, R, omega, clearance), m, phases, speeds, *names, _ = EVEN_FOLDS[case]
    osc = Oscillator(h=h, R=R, omega=omega, f=1.0, clearance=clearance)
    start = PeriodicOrbit(osc, m, np.array(phases), np.array(speeds))
    ranges = [(name, *RANGES[name]) for name in names]
    return bifurcation_curve(start, "fold", *ranges), ranges


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


def at_degenerate_flip(end, ranges, folds, off):
    """Check that the flips through an end of folds are degenerate there, and lead back to them.

    There the cubic coefficient of the flip is zero: in 60 digits, within `off` of its second value.
    """
    (first, *_), (second, *_) = ranges
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
        assert float(away) == pytest.approx(0.0, abs=off)
    spans = np.array([high - low for _, low, high in ranges])
    flips = bifurcation_curve(end.orbit, "flip", *ranges)
    turns = [point for point in flips.special if point.kind == "degenerate"]
    away = [np.abs((turn.value - end.value) / spans).max() for turn in turns]
    assert min(away) < 1e-7
    turn = turns[int(np.argmin(away))]
    near = int(np.argmin(np.abs((flips.values - turn.value) / spans).max(axis=1)))
    beside = [flips.orbit(i).criticality for i in (near - 1, near, near + 1)]
    assert {*beside} == {"supercritical", "subcritical"}
    again = bifurcation_curve(turn.orbit, "fold", *ranges)
    assert (again.m, again.q) == (folds.m, folds.q)
    kinds = (sorted(point.kind for point in curve.special) for curve in (again, folds))
    assert next(kinds) == next(kinds)
    assert min(np.abs((p.value - end.value) / spans).max() for p in again.special) < 1e-7


@pytest.mark.slow
@pytest.mark.parametrize("case", range(len(EVEN_FOLDS)))
def test_the_folds_of_an_even_orbit_end_at_the_degenerate_flip_of_its_half(case):
    """Beyond it the halves would change places."""
    found, ranges = even_folds(case)
    assert sorted(point.kind for point in found.special) == EVEN_FOLDS[case][-1]
    for point in (0, -1):
        assert found.special[point].value.tolist() == found.values[point].tolist()
    assert not orbits_twice(found)
    for i in len(found.values) * np.array([1, 3]) // 4:
        again = bifurcation_curve(found.orbit(i), "fold", *ranges)
        specials = sorted(again.special, key=lambda p: np.abs(p.value - found.values[0]).max())
        for point, expected in zip(specials, found.special, strict=True):
            assert point.kind == expected.kind
            assert point.value == pytest.approx(expected.value, abs=2e-8)
        assert not orbits_twice(again)
    for end in (point for point in found.special if point.kind == "flip"):
        assert (end.orbit.m, end.orbit.q) == (found.m // 2, found.q // 2)
        at_degenerate_flip(end, ranges, found, off=1e-9)


#: Folds of orbits of two periods near a resonance, where the equations of the flights are almost
#: singular: oscillator, phases, speeds, two ranges, and the kinds of both ends.
RESONANT_FOLDS = [
    (
        (0.0, 0.22962440475055887, 0.49684387536385977, 2.8364653295094806, 1.0, 3.099250817317816),
        (4.738467196435406, 10.975655183818759), (0.01183862788017028, 0.07485107591497236),
        ("clearance", 0.8314, 5.332), ("f", 1.0102, 4.6627), ["edge", "edge"],
    ),
    (
        (0.0005665172892851622, 0.5942893006996819, 0.4286026678593357, 1.531011005217444,
         1.1314116535635579, 1.1552798542610252),
        (4.076597043608686, 5.266260401540656, 10.327846298259349, 11.522536935873312),
        (0.4533649300320061, 0.3094417684784397, 0.48787918202701913, 0.359695148117221),
        ("p", 0.37038, 1.62962), ("R", 0.40346, 0.78511), ["flip", "flip"],
    ),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("values", "phases", "speeds", "first", "second", "kinds"), RESONANT_FOLDS, ids=range(2)
)
def test_folds_near_a_resonance_are_whole(values, phases, speeds, first, second, kinds):
    start = PeriodicOrbit(Oscillator(*values), 2, np.array(phases), np.array(speeds))
    found = bifurcation_curve(start, "fold", first, second)
    assert [point.kind for point in found.special] == kinds
    assert len(found.values) < 120 and not orbits_twice(found)
    for end in (point for point in found.special if point.kind == "flip"):
        at_degenerate_flip(end, [first, second], found, off=2e-7 * (second[2] - second[1]))


@pytest.mark.parametrize("name", ["omega", "R"])
def test_where_no_folds_are_found_beside_a_degenerate_flip_none_of_others_are_taken(name):
    """Over a range of 2e-5 they leave it at once; the orbit of the flip itself has a fold."""
    osc = Oscillator(
        h=0.0037008059434792476, R=0.897151416773871, omega=0.5833274795159484, f=1.0,
        clearance=0.9127765034430636,
    )  # fmt: skip
    phases, speeds = (3.77683754, 5.5934594), (0.77813954, 0.7176944)
    flip = PeriodicOrbit(osc, 1, np.array(phases), np.array(speeds))
    wide = {"omega": (0.35, 0.875), "R": (0.3, 1.0)}
    flips = bifurcation_curve(flip, "flip", *((key, *ends) for key, ends in wide.items()))
    turns = [point for point in flips.special if point.kind == "degenerate"]
    assert len(turns) == 2
    for turn in turns:
        value = turn.value[[*wide].index(name)]
        ranges = wide | {name: (value * (1.0 - 1e-5), value * (1.0 + 1e-5))}
        with pytest.raises(OrbitError, match=r"no fold of the orbits of 2/4 .* degenerate flip"):
            bifurcation_curve(turn.orbit, "fold", *((key, *ends) for key, ends in ranges.items()))


@pytest.mark.parametrize("case", range(len(EVEN_FOLDS)))
def test_the_folds_from_a_degenerate_flip_are_found_over_a_thousandth_of_the_ranges(case):
    """In units of these the parameters move far, although the orbit is near that of the flip."""
    found, wide = even_folds(case)
    (end, *_) = (point for point in found.special if point.kind == "flip")
    flips = bifurcation_curve(end.orbit, "flip", *wide)
    turns = [point for point in flips.special if point.kind == "degenerate"]
    turn = min(turns, key=lambda point: np.abs(point.value - end.value).max())
    spans = 1e-3 * np.array([high - low for _, low, high in wide])
    ends = turn.value - spans, turn.value + spans
    narrow = [*zip((name for name, *_ in wide), *ends, strict=True)]
    folds = bifurcation_curve(turn.orbit, "fold", *narrow)
    assert (folds.m, folds.q) == (found.m, found.q)
    assert min(np.abs((p.value - end.value) / spans).max() for p in folds.special) < 1e-4


@pytest.mark.slow
def test_no_flip_is_degenerate_where_an_impact_loses_its_speed():
    """Undamped, near R = 1 and omega = 3, where the multiplier has lost its digits."""
    osc = Oscillator(h=0.0, R=0.999996834563512, omega=2.999999073414122, f=1.0)
    phases, speeds = (1.74559681, 8.55197921, 11.17037833), (0.29347925, 3.717e-07, 0.293478892)
    start = PeriodicOrbit(osc, 3, np.array(phases), np.array(speeds), "flip")
    ranges = ("omega", 1.8, 4.5), ("R", 0.3, 1.0)
    flips = bifurcation_curve(start, "flip", *ranges)
    again = bifurcation_curve(flips.orbit(len(flips.values) // 2), "flip", *ranges)
    for curve in (flips, again):
        assert len(curve.values) > 20
        assert "degenerate" not in [point.kind for point in curve.special]


def test_two_degenerate_flips_close_together_are_the_ends_of_one_curve_of_folds():
    """Two others on the same curve of flips are as near, each with folds of its own."""
    osc = Oscillator(0.0, 0.82635698, 2.80343783, 1.0, clearance=-0.02086808793689181)
    phases = (1.3135643, 8.589661, 12.2104049, 20.5494354, 28.8208763, 30.1466399, 31.8186251)
    speeds = (0.4968367, 0.2494783, 0.5258202, 0.7486364, 0.2379813, 0.2321381, 0.0504151)
    flip = PeriodicOrbit(osc, 6, np.array(phases), np.array(speeds))
    ranges = ("omega", 1.66, 4.14), ("R", 0.3, 1.0)
    turns = [p for p in bifurcation_curve(flip, "flip", *ranges).special if p.kind == "degenerate"]
    assert len(turns) == 4
    for turn, there in zip(turns, (turns[:1], turns[1:3], turns[1:3], turns[3:]), strict=True):
        folds = bifurcation_curve(turn.orbit, "fold", *ranges)
        ends = sorted(point.value.tolist() for point in folds.special if point.kind == "flip")
        assert np.array(ends) == pytest.approx(np.array([p.value for p in there]), abs=1e-9)


@pytest.mark.parametrize(("axis", "inside"), [(0, 1.0), (1, -1.0)])
def test_a_curve_of_folds_ends_at_an_edge_just_before_its_degenerate_flip(axis, inside):
    """Its equations are singular there; the halves differ by the square root of the distance."""
    osc = Oscillator(
        h=0.007362632864275454, R=0.8628857905514986, omega=5.2602055795026255, f=1.0,
        clearance=-0.027911269810741077,
    )  # fmt: skip
    start = periodic_orbit(osc, -0.2504382214728245, 0.5088206343102007, 6)
    ranges = [("clearance", -0.14086, 0.08504), ("R", 0.42661, 1.0)]
    flip = bifurcation_curve(start, "fold", *ranges).special[0].value
    slopes, sizes = [], []
    for away in (1e-4, 1e-5, 1e-6):
        edge, (name, low, high) = flip[axis] + inside * away, ranges[axis]
        cut = ranges.copy()
        cut[axis] = (name, edge, high) if inside > 0.0 else (name, low, edge)
        found = bifurcation_curve(start, "fold", *cut)
        assert [point.kind for point in found.special] == ["edge", "graze"]
        end = found.special[0]
        assert end.value[axis] == edge
        assert end.value.tolist() == found.values[0].tolist()
        assert (end.orbit.m, end.orbit.q) == (6, 4)
        assert np.abs(linearised(*end.orbit.equations)[0]).max() < 1e-9
        slopes.append((end.value[1 - axis] - flip[1 - axis]) / away)
        sizes.append(np.abs(end.orbit.speeds[:2] - end.orbit.speeds[2:]).max() / math.sqrt(away))
        assert len(found.values) < 250
    assert slopes == pytest.approx([slopes[0]] * 3, rel=0.2)
    assert sizes == pytest.approx([sizes[0]] * 3, rel=0.2)


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
        for i in len(whole.values) * np.array([1, 3]) // 4:
            special = bifurcation_curve(whole.orbit(i), "fold", ("p", 0.3, 1.7), second).special
            assert sorted(point.kind for point in special) == ["edge", "graze"]
            (end,) = [point.orbit for point in special if point.kind == "graze"]
            assert not end.speeds.any()
            assert np.sin(end.phases) == pytest.approx([-1.0, -1.0], abs=1e-10)
            o = end.oscillator
            ends.append((o.omega / o.p, o.p**2 * o.clearance / o.f))
    assert np.ptp(ends, axis=0).max() < 1e-6
    assert ends[0][0] == pytest.approx(0.5, abs=1e-6)


def test_the_folds_are_those_of_the_closed_form():
    osc = Oscillator(h=0.1, R=0.8, omega=1.5, f=1.0, clearance=1.0)
    found = bifurcation_curve(one_impact_orbit(osc), "fold", ("omega", 1.4, 2.0), ("R", 0.6, 0.9))
    assert len(found.values) > 5
    for omega, R in found.values[::3]:
        expected = bifurcation(replace(osc, R=R), "fold", "omega", 1.45, 2.0)
        assert omega == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize(("R", "omega", "slowest"), [(0.575, 0.54, 0), (0.725, 0.4, 12)])
def test_the_folds_of_a_long_chatter_are_followed_from_any_slowest_impact(R, omega, slowest):
    """The curve of 1/13 from two of its points, over the range of configs/period-map.yaml.

    A solution of the linearised flights that is not the shortest one moves the slowest impacts
    most, by more than their speed. Where the slowest is the last, the fold was lost half way.
    """
    osc = Oscillator(h=0.02, R=R, omega=omega, f=1.0)
    start = settled_orbit(osc)
    (fold,) = [p for p in branch(start, "omega", 0.3, 1.2).special if p.kind == "fold"]
    assert (fold.orbit.q, np.argmin(fold.orbit.speeds)) == (13, slowest)
    found = bifurcation_curve(fold.orbit, "fold", ("omega", 0.3, 5.6), ("R", 0.3, 0.95))
    ends = sorted(point.value.tolist() for point in found.special)
    assert [point.kind for point in found.special] == ["edge", "edge"]
    assert np.array(ends) == pytest.approx(np.array([[0.34079, 0.95], [0.92469, 0.3]]), abs=1e-5)


def test_folds_that_grow_without_bound_leave_the_other_direction_its_work(monkeypatch):
    """Dux: at h = 0 the folds of n/1 have V = 2 |sigma| k / (rho (1 + k^2)), rho = (1 - R) / omega.

    There k^2 = (sigma / gamma)^2 - 1, gamma = 1 / (1 - omega^2). As R goes to 1 omega goes to 4, so
    there is their end, from wherever they are followed.
    """
    start = one_impact_orbits(Oscillator(0.0, 0.75, 4.15, 1.0, clearance=-0.1), 2)[0]
    ranges = ("omega", 1.0, 8.0), ("R", 0.1, 1.0)
    whole = bifurcation_curve(start, "fold", *ranges)
    for orbit in [start, *map(whole.orbit, (1, len(whole.values) // 2, -2))]:
        ends = bifurcation_curve(orbit, "fold", *ranges).special
        last = min(ends, key=lambda end: -end.value[1])
        assert [end.kind for end in ends] == ["edge", "edge"]
        assert last.value == pytest.approx([4.0, 1.0], abs=1e-9)

    def speed(omega, R):
        k = math.sqrt((0.1 * (omega**2 - 1.0)) ** 2 - 1.0)
        return 0.2 * k * omega / ((1.0 - R) * (1.0 + k * k))

    ends = bifurcation_curve(start, "fold", ranges[0], ("R", 0.1, 0.9999)).special
    (last,) = [end for end in ends if end.value[1] == 0.9999]  # before they become infinite
    assert last.orbit.speeds[0] == pytest.approx(speed(*last.value), rel=1e-6)
    speeds = []
    for work in (10_000, 20_000, 30_000):
        monkeypatch.setattr("vibroimpact.orbits.family.MOST_WORK", work)
        ends = bifurcation_curve(start, "fold", *ranges).special
        edge, lost = sorted(ends, key=lambda end: end.kind)
        assert (edge.kind, lost.kind, edge.value[1]) == ("edge", "lost", 0.1)
        speeds.append(speed(*lost.value))
        assert lost.orbit.speeds[0] == pytest.approx(speeds[-1], rel=1e-6)
    # Equal work leads on by equal factors.
    assert speeds[2] > 4.0 * speeds[1] > 16.0 * speeds[0] and speeds[2] > 200.0
