"""Branches, against closed forms, simulation, published values and 40 digits."""

import math
from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest
from scipy.optimize import bisect

from tests.helpers.kernel_cases import few_or_many
from tests.helpers.naive import ClosedForm
from tests.helpers.oscillators import (
    SectionMap,
    bifurcation,
    in_digits,
    one_impact_motions,
    peak,
    random_oscillators,
    settled_orbit,
    special,
)
from vibroimpact.orbits.branches import branch, grazing_branch
from vibroimpact.orbits.one_impact import one_impact_orbit, one_impact_orbits
from vibroimpact.orbits.orbit import free_orbit
from vibroimpact.orbits.periodic import OrbitError, periodic_orbit, solved
from vibroimpact.oscillator import Oscillator

LIGHT = Oscillator(h=0.05, R=0.8, omega=2.0, f=1.0)
AHEAD = Oscillator(h=0.1, R=0.8, omega=1.0, f=1.0, clearance=1.0)


@pytest.mark.parametrize(
    ("h", "R", "n", "flips"),
    [
        (0.0, 0.8, 1, (1.260677, 2.653348)),
        (0.0, 0.8, 3, (5.359488, 6.639142)),
        (0.05, 0.8, 1, (1.22973534658679, 2.65888454668484)),
        (0.05, 0.8, 2, (3.33809052026845, 4.64512198413259)),
        (0.1, 0.5, 2, (3.27476229637949, 4.66788325419651)),
    ],
)
def test_a_branch_is_stable_between_its_known_flips(h, R, n, flips):
    osc = replace(LIGHT, h=h, R=R, omega=0.5 * sum(flips))
    found = branch(one_impact_orbit(osc, n), "omega", 0.8, 7.0)
    located = special(found, "flip")
    assert located[-2:] == pytest.approx(flips, abs=1e-13 if h else 1e-6)
    inside = (located[-2] < found.values) & (found.values < located[-1])
    assert inside.sum() > 2 and found.stable[inside].all()
    assert not found.stable[~inside & (found.values > 0.99 * located[-2])].any()
    if h == 0.0:  # every flip is on the exact curve, also another one at a lower frequency
        rate, k = np.array(located), math.pi * n / np.array(located)
        curve = np.cos(k) ** 2 * (rate**2 - ((1.0 - R) / (1.0 + R)) ** 2)
        np.testing.assert_allclose(curve, 1.0, rtol=0, atol=1e-13 * 7**3)
    for point in found.special:
        if point.kind == "flip":
            bare = replace(point.orbit, kind="")  # not known to be at a flip
            assert point.orbit.multipliers[0] == -1.0 and not point.orbit.stable
            assert bare.multipliers == pytest.approx(point.orbit.multipliers, abs=1e-12)


def test_a_flight_that_passes_the_stop_only_within_a_step_ends_the_branch():
    """By at most 6e-6, over a window of 1.3e-3 of omega; a step there is longer unless halved."""
    osc = Oscillator(h=0.1, R=0.7777, omega=2.1, f=1.0, clearance=0.4)
    peaks = [peak(one_impact_orbit(replace(osc, omega=w), 2)) for w in (2.144, 2.1453, 2.147)]
    assert peaks[0] < 0.0 < peaks[1] < 6e-6 and peaks[2] < 0.0
    found = branch(one_impact_orbit(osc, 2), "omega", 1.8, 2.6)
    expected = bifurcation(osc, "graze", "omega", 2.144, 2.1453, n=2)
    assert special(found, "graze") == pytest.approx([expected], abs=1e-12)


def test_a_branch_with_a_clearance_has_a_fold_and_ends_without_impact():
    """v = 0 where f / sqrt(D) = clearance: (1 - omega^2)^2 + 0.04 omega^2 = 1 at omega^2 = 1.96."""
    found = branch(one_impact_orbit(replace(AHEAD, omega=1.3)), "omega", 1.2, 2.0)
    (fold,) = special(found, "fold")
    (graze,) = special(found, "graze")
    assert graze == pytest.approx(1.4, abs=1e-14)
    assert special(found, "edge") == [1.2]
    assert fold == found.values.max()
    assert fold == pytest.approx(bifurcation(AHEAD, "fold", "omega", 1.3, 2.0), abs=1e-12)
    turn = int(np.argmax(found.values))
    assert found.stable[:turn].any() != found.stable[turn + 1 :].any()
    assert len(found.at(1.5)) == 2 and found.at(1.9) == []


@pytest.mark.parametrize("p", [1.35, 1.45])
def test_no_flip_or_fold_is_where_a_branch_begins_at_a_graze(p):
    """Without damping both vanish there, but for rounding: the multipliers stay within .8."""
    osc = Oscillator(h=0.0, R=0.34036723894650905, omega=1.420415544628506, f=1.0, p=p)
    ends = branch(one_impact_orbit(replace(osc, p=1.0)), "p", 0.7, 2.4).special
    (graze,) = [point for point in ends if point.kind == "graze"]
    found = grazing_branch(graze.orbit, "p", 0.7, p)
    assert [point.kind for point in found.special] == ["edge"]
    assert np.abs(found.orbit(2).multipliers).max() < 0.8


def test_without_restitution_a_branch_ends_where_the_mass_cannot_leave_the_stop():
    """There the acceleration after the impact, f sin(phase) + p^2 clearance, changes its sign."""
    osc = Oscillator(h=0.1, R=0.0, omega=4.7, f=1.1, p=1.7)

    def pull(clearance):
        parameters = in_digits(replace(osc, clearance=clearance))
        _, phase = one_impact_motions(parameters, 1)[-1]
        return float(osc.f * mp.sin(phase) + osc.p**2 * clearance)

    with mp.workdps(30):
        expected = bisect(pull, -0.06, 0.0, xtol=1e-16)
    found = branch(one_impact_orbit(osc), "clearance", -0.5, 0.0)
    assert special(found, "rest") == pytest.approx([expected], abs=1e-14)
    assert found.values.min() == special(found, "rest")[0]


def test_the_free_oscillation_is_not_stable_without_damping():
    """Its multipliers are on the unit circle at h = 0, and inside it beyond."""
    start = periodic_orbit(Oscillator(h=0.3, R=0.8, omega=1.9, f=1.0, clearance=2.0), 0.0, 0.0)
    found = branch(start, "h", 0.0, 0.5)
    assert found.values[0] == 0.0 and found.stable.tolist() == (found.values > 0.0).tolist()
    undamped = free_orbit(Oscillator(h=0.0, R=0.8, omega=0.3, f=1.0, clearance=3.0))
    found = branch(undamped, "omega", 0.1, 2.0)  # over the resonance, of infinite amplitude
    assert special(found, "graze") == pytest.approx([math.sqrt(2.0 / 3.0)], abs=1e-14)


@pytest.mark.parametrize(
    ("osc", "n"),
    [
        (Oscillator(h=0.0, R=0.8, omega=4.2, f=1.0, clearance=1.0), 4),
        (Oscillator(h=0.0, R=0.7028936034449044, omega=3.7405928078447332, f=0.0,
                    p=1.714012647311538, clearance=0.4269918579611559, a=0.09637868825649189), 2),
    ],
)  # fmt: skip
def test_without_damping_orbits_vanish_at_a_multiple_of_the_eigenfrequency(osc, n):
    """A natural vibration returns there in n periods, so that the impact has no speed.

    Its speed is proportional to tan(pi n p / omega). Newton's method fails beside it.
    """
    orbits = one_impact_orbits(osc, n)
    assert orbits
    for orbit in orbits:
        found = branch(orbit, "omega", 0.85 * osc.omega, 1.02 * osc.omega)
        end, edge = found.special
        assert (end.kind, edge.kind) == ("graze", "edge")
        assert end.value == found.values[0] == pytest.approx(n * osc.p, rel=2e-14)
        assert end.orbit.speeds.tolist() == found.speeds[0].tolist() == [0.0]


def test_a_branch_without_an_end_is_lost():
    """Without damping and loss its speed grows without bound towards omega = 2 p, or 2 p / 3.

    The least loss bounds it, and the branch goes on.
    The fold vanishes there with all digits of its slope, which hide no roots.
    """
    start = one_impact_orbit(Oscillator(h=0.0, R=1.0, omega=2.3, f=1.0, clearance=-0.4))
    osc = Oscillator(h=0.0, R=1.0, omega=0.5, f=1.0, clearance=0.3)
    three = solved(osc, 1, np.array([3.6, 4.7, 5.8]), np.array([1.0, 1.2, 1.0]))
    downward, upward = branch(start, "omega", 1.5, 2.5), branch(three, "omega", 0.5, 1.0)
    for end, edge, limit in ((0, -1, 2.0), (-1, 0, 2.0 / 3.0)):
        found = downward if end == 0 else upward
        assert (found.special[end].kind, found.special[edge].kind) == ("lost", "edge")
        assert found.special[end].value == pytest.approx(limit, abs=1e-9)
        assert found.speeds[end].min() > 500.0 and len(found.values) < 200
    lossy = one_impact_orbit(Oscillator(h=0.0, R=0.9999, omega=2.05, f=1.0, clearance=-0.13))
    bounded = branch(lossy, "omega", 1.5, 2.1)
    assert [point.kind for point in bounded.special] == ["edge", "edge"]


def test_the_slope_of_a_fold_that_is_rounding_shortens_no_step():
    """At resonance the loss of the impacts alone bounds the speeds: a multiplier is 1 - 4e-7."""
    osc = Oscillator(h=0.0, R=0.9999, omega=1.0, f=1.0)
    start = solved(osc, 1, np.array([0.515, 3.673]), np.array([82.1, 82.9]))
    found = branch(start, "clearance", -1.0, 1.0)
    assert [point.kind for point in found.special] == ["graze", "flip", "fold", "graze"]
    (fold,) = special(found, "fold")
    assert found.values.max() == fold and len(found.values) < 300
    assert [len(found.at(fold + away)) for away in (-1e-9, 1e-9)] == [2, 0]


@pytest.mark.parametrize(("h", "R"), [(0.0, 1.0), (1e-9, 1.0), (0.0, 1.0 - 1e-9)])
def test_speeds_without_bound_are_no_folds(h, R):
    """The orbits of 1/2 that begin at a graze end at omega = p, where both multipliers are 1."""
    start = one_impact_orbit(Oscillator(h=h, R=R, omega=1.4142257405942802, f=1.0))
    graze = branch(start, "omega", 0.5, 1.9).special[0]
    found = grazing_branch(graze.orbit, "omega", 0.5, 1.9)
    assert (found.m, found.q) == (1, 2)
    (end,) = found.special
    assert (end.kind, end.value) == ("lost", pytest.approx(1.0, abs=1e-9))


def test_a_branch_that_closes_has_no_end():
    """Between its two folds there are two orbits at every omega."""
    osc = Oscillator(h=0.0, R=0.7535526427554777, omega=1.0716640181997115, f=1.0)
    phases = 4.477878866046633, 7.268149957874303, 10.980842686046275
    phases += 17.177215957284613, 18.836564298029877
    speeds = 2.190592119244807, 0.6116403898842333, 2.335019063111631
    speeds += 1.0542007104607902, 0.5170690104877236
    found = branch(solved(osc, 3, np.array(phases), np.array(speeds)), "omega", 0.87, 1.27)
    assert sorted(point.kind for point in found.special) == ["flip", "flip", "fold", "fold"]
    assert found.values[0] == found.values[-1]
    low, high = special(found, "fold")
    assert (found.values.min(), found.values.max()) == (low, high)
    assert all(len(found.at(omega)) == 2 for omega in np.linspace(low, high, 9)[1:-1].tolist())
    assert found.at(low - 1e-3) == found.at(high + 1e-3) == []


def test_two_flips_in_one_step_are_found():
    """Of the closed form; between them a multiplier is -1.0111; both ends of a step are stable."""
    osc = Oscillator(h=0.005, R=0.48544860644798926, omega=2.0, f=1.0)
    found = special(branch(one_impact_orbit(osc), "omega", 0.25, 4.0), "flip")
    assert found[:2] == pytest.approx([1.113553429805437, 1.164509496718609], abs=1e-13)


@pytest.mark.parametrize(
    ("osc", "n"),
    [
        (Oscillator(h=0.05, R=0.8, omega=2.3, f=1.0), 1),
        (Oscillator(h=0.0, R=0.64, omega=2.0, f=0.36), 1),
        (Oscillator(h=1e-4, R=0.4, omega=5.6, f=1.0), 3),
    ],
)
def test_a_branch_without_a_stop_in_the_way_ends_where_there_is_no_force(osc, n):
    """In no flip, fold or graze, although the tests of these vanish there to rounding."""
    found = branch(one_impact_orbit(osc, n), "f", 0.0, 2.0).special
    assert [(point.kind, point.value) for point in found] == [("edge", 0.0), ("edge", 2.0)]


def test_a_branch_of_too_much_work_is_lost(monkeypatch):
    """All its points are orbits; the limit of work decides their number."""
    whole = branch(one_impact_orbit(LIGHT), "omega", 1.9, 2.6)
    monkeypatch.setattr("vibroimpact.orbits.family.MOST_WORK", 1000)
    found = branch(one_impact_orbit(LIGHT), "omega", 1.9, 2.6)
    assert len(special(found, "lost")) == 2 and len(special(whole, "edge")) == 2
    assert 1 < len(found.values) < len(whole.values)
    for value, speed in zip(found.values, found.speeds, strict=True):
        closed = one_impact_orbit(replace(LIGHT, omega=float(value)))
        assert speed[0] == pytest.approx(closed.v, abs=1e-13)


def test_a_branch_ends_at_the_edge_itself_and_has_an_orbit_there():
    """The last value is the edge itself; beside it, `at` would find no orbit."""
    start = one_impact_orbit(LIGHT)
    for high in np.linspace(2.1, 2.6, 9).tolist():
        found = branch(start, "omega", 1.9, high)
        assert found.values[[0, -1]].tolist() == [1.9, high]
        (orbit,) = found.at(high)
        assert orbit.speeds[0] == pytest.approx(one_impact_orbit(orbit.oscillator).v, abs=1e-13)


@pytest.mark.parametrize(("axis", "low"), [("R", 0.5), ("h", 0.0)])
def test_the_flip_at_an_edge_from_which_a_branch_begins_is_not_beyond_the_edge(axis, low):
    """Rounding decides at the edge itself; beyond R = 1 there is no oscillator."""
    for clearance in np.linspace(-0.12, 0.08, 6).tolist():
        osc = Oscillator(h=0.002, R=1.0, omega=2.6, f=1.0, clearance=clearance)
        for point in branch(one_impact_orbit(osc), "omega", 2.0, 3.4).special:
            if point.kind == "flip":
                edge = getattr(point.orbit.oscillator, axis)
                found = branch(point.orbit, axis, low, edge)
                values = [*found.values, *(point.value for point in found.special)]
                assert low <= min(values) and max(values) == edge


def test_a_fold_just_beyond_the_edge_at_which_a_branch_begins_is_not_of_it():
    """The orbits with one more impact begin at the graze on its other side, and soon fold."""
    osc = Oscillator(h=0.0143, R=0.5, omega=1.824, f=1.0, clearance=0.01377)
    graze = branch(one_impact_orbit(osc), "R", 0.0, 1.0).special[0]
    fold = branch(graze.orbit, "R", 0.0, 1.0).special[1]
    found = branch(graze.orbit, "R", 0.0, graze.value)
    assert 0.0 < fold.value - graze.value < 2e-7 and found.values.max() == graze.value
    assert [point.kind for point in found.special] == ["graze", "graze"]


def test_a_graze_at_an_edge_is_still_a_graze():
    osc = Oscillator(h=0.0, R=0.488, omega=1.355, f=1.0)
    graze = branch(one_impact_orbit(osc), "omega", 0.8, 2.0).special[0]
    found = branch(graze.orbit, "omega", 0.8, graze.value)
    assert [point.kind for point in found.special] == ["edge", "graze"]


def test_a_flip_in_the_last_step_before_the_flip_of_half_the_orbit_is_found():
    """Beyond it the orbits 12/6 are stable up to the end, in a window of 5e-5."""
    osc = Oscillator(0.0, 0.8002196823396778, 5.60921, 1.0, clearance=-0.016302439511443775)
    phases = 4.57770158, 6.99982853, 23.81375992, 42.28989116, 44.68433758, 61.52109688
    speeds = 0.18796283, 0.01789645, 0.20288559, 0.185834, 0.01881639, 0.2066988
    start = solved(osc, 12, np.array(phases), np.array(speeds))
    assert start.stable
    (start,) = branch(start, "omega", 5.5, 5.7).at(5.608741554973944)
    found = branch(start, "omega", 5.5, 5.7)
    flips = special(found, "flip")
    assert flips[-2:] == pytest.approx([5.609185354589922, 5.609233434857062], abs=1e-12)
    window = (flips[-2] < found.values) & (found.values < flips[-1])
    assert window.any() and found.stable[window].all()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("x0", 0.0, 1.0), "parameter = 'x0' is not allowed; expected: one of h, R"),
        (("R", 0.5, 1.5), "R .coefficient of restitution. = 1.5 is not"),
        (("omega", 3.0, 2.0), "must increase"),
        (("omega", 2.5, 3.0), "outside 2.5 to 3.0"),
    ],
)
def test_bad_ranges_are_refused(arguments, said):
    with pytest.raises(ValueError, match=said):
        branch(one_impact_orbit(LIGHT), *arguments)


@pytest.mark.filterwarnings("error")
def test_over_a_range_beyond_all_digits_a_branch_is_lost():
    found = branch(one_impact_orbit(LIGHT), "p", 0.5, 1e200)
    assert [point.kind for point in found.special] == ["lost", "lost"]


def test_a_solution_that_passes_the_stop_has_no_branch():
    passing = one_impact_orbit(Oscillator(h=0.02, R=0.8, omega=0.3, f=1.0))
    assert not passing.exists
    with pytest.raises(OrbitError, match="the orbit does not exist: it passes the stop"):
        branch(passing, "omega", 0.2, 7.0)


def exact(point, axis):
    """Return where a bifurcation of a branch is, by its section map.

    That is singular at a graze where every natural vibration repeats: undamped at omega = n p.
    """
    osc, m = point.orbit.oscillator, point.orbit.m
    if point.kind == "graze" and osc.h == 0.0 and abs(osc.omega / (m * osc.p) - 1.0) < 1e-6:
        return {"omega": m * osc.p, "p": osc.omega / m}[axis]
    return SectionMap(point.orbit).bifurcation(point.kind, axis)


@few_or_many("count", 8, 500)
@pytest.mark.parametrize("shaken", [False, True])
def test_random_bifurcations_are_those_of_the_section_map(count, shaken):
    """To 1e-13, any damping but the critical; and a branch is stable where the closed form is.

    The force is f, or half or all of it comes from a base, along omega or its amplitude.
    """
    compared = {"flip": 0, "fold": 0, "graze": 0}
    rng = np.random.default_rng(4)
    for osc, n in random_oscillators(60 * count, seed=31, clearance=0.5):
        if sum(compared.values()) >= count:
            break
        axis = str(rng.choice(["h", "R", "omega", "f", "p", "clearance"]))
        if shaken:
            share, axis = rng.choice([0.5, 1.0]), str(rng.choice(["omega", "a"]))
            osc = replace(osc, f=(1.0 - share) * osc.f, a=share * osc.f / osc.omega**2)
        orbits, value = one_impact_orbits(osc, n), getattr(osc, axis)
        if osc.h == osc.p or not orbits or not orbits[-1].exists or not value:
            continue
        ends = sorted((0.85 * value, min(1.15 * value, 1.0 if axis == "R" else math.inf)))
        found = branch(orbits[-1], axis, *ends)
        for point in found.special:
            if point.kind in compared:
                with mp.workdps(50):
                    assert abs(point.value / exact(point, axis) - 1) < 1e-13
                compared[point.kind] += 1
        at_special = np.isin(found.values, [point.value for point in found.special])
        for i in np.flatnonzero(~at_special)[::5].tolist():
            orbits = one_impact_orbits(replace(osc, **{axis: float(found.values[i])}), n)
            nearest = min(orbits, key=lambda orbit: abs(orbit.v - found.speeds[i, 0]))
            assert nearest.v == pytest.approx(found.speeds[i, 0], rel=1e-9)
            assert nearest.stable == found.stable[i]
    assert sum(compared.values()) >= count and min(compared.values()) > count // 6


@pytest.mark.parametrize(
    "osc",
    [
        Oscillator(
            h=0.05, R=0.3753126481060007, omega=2.6903152778618624, f=1.0,
            clearance=0.08911435294394687,
        ),
        Oscillator(h=0.01, R=0.6175240725045801, omega=3.0457449019, a=0.3),
    ],
)  # fmt: skip
def test_the_graze_of_a_branch_has_its_impact_of_speed_zero_though_others_are_as_slow(osc):
    """Newton's method misses some of them; each flight is a closed form, and it touches there."""
    start = settled_orbit(osc, 2)
    found = branch(start, "omega", 0.95 * osc.omega, 1.05 * osc.omega)
    grazes = [point.orbit for point in found.special if point.kind == "graze"]
    assert sorted(orbit.q for orbit in grazes) == [found.q, found.q + 1]
    for orbit in grazes:
        assert np.count_nonzero(orbit.speeds == 0.0) == 1 and np.isinf(orbit.multipliers[0])
        there, k = orbit.oscillator, int(np.argmin(orbit.speeds))
        theta, v = orbit.phases[k - 1], orbit.speeds[k - 1]
        flight = ClosedForm(there, theta / there.omega, there.clearance, -there.R * v)
        x, u = flight(orbit.phases[k] / there.omega)
        assert x == pytest.approx(there.clearance, abs=1e-9) and u == pytest.approx(0.0, abs=1e-9)
