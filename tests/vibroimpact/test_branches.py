"""Branches, against closed forms, simulation, published values and 40 digits."""

import math
from dataclasses import replace
from itertools import islice, pairwise

import mpmath as mp
import numpy as np
import pytest
from scipy.optimize import bisect

from tests.helpers.naive import ClosedForm
from tests.helpers.oscillators import (
    SectionMap,
    bifurcation,
    fold_of_one_impact,
    in_digits,
    one_impact_motions,
    peak,
    random_oscillators,
)
from vibroimpact.orbits.branches import branch, doubled_branch, grazing_branch
from vibroimpact.orbits.one_impact import one_impact_orbit, one_impact_orbits
from vibroimpact.orbits.periodic import OrbitError, periodic_orbit, solved
from vibroimpact.oscillator import Oscillator
from vibroimpact.trajectory import simulate

LIGHT = Oscillator(h=0.05, R=0.8, omega=2.0, f=1.0)
AHEAD = Oscillator(h=0.1, R=0.8, omega=1.0, f=1.0, clearance=1.0)


def special(found, kind):
    return sorted(point.value for point in found.special if point.kind == kind)


@pytest.mark.parametrize(
    ("h", "R", "n", "flips"),
    [
        (0.0, 0.8, 1, (1.260677, 2.653348)),
        (0.0, 0.8, 2, (3.353178, 4.641837)),
        (0.0, 0.8, 3, (5.359488, 6.639142)),
        (0.0, 0.5, 1, (1.195148, 2.658152)),
        (0.05, 0.8, 1, (1.22973534658679, 2.65888454668484)),
        (0.05, 0.8, 2, (3.33809052026845, 4.64512198413259)),
    ],
)
def test_a_branch_is_stable_between_its_known_flips(h, R, n, flips):
    osc = replace(LIGHT, h=h, R=R, omega=0.5 * sum(flips))
    found = branch(one_impact_orbit(osc, n), "omega", 0.8, 7.0)
    located = special(found, "flip")
    assert located[-2:] == pytest.approx(flips, abs=1e-13 if h else 1e-6)
    inside = (located[-2] < found.values) & (found.values < located[-1])
    assert found.stable[inside].all()
    assert not found.stable[~inside & (found.values > 0.99 * located[-2])].any()
    if h == 0.0:  # every flip is on the exact curve, also another one at a lower frequency
        rate, k = np.array(located), math.pi * n / np.array(located)
        curve = np.cos(k) ** 2 * (rate**2 - ((1.0 - R) / (1.0 + R)) ** 2)
        np.testing.assert_allclose(curve, 1.0, rtol=0, atol=1e-13 * 7**3)
    for point in found.special:
        if point.kind == "flip":
            assert np.abs(point.orbit.multipliers + 1.0).min() < 1e-12


@pytest.mark.parametrize(
    ("h", "R", "graze"),
    [(0.05, 0.8, 1.01658832780028), (0.1, 0.5, 1.11292970401963), (0.5, 1.0, 1.11561617993669)],
)
def test_a_branch_ends_in_its_known_graze(h, R, graze):
    found = branch(one_impact_orbit(replace(LIGHT, h=h, R=R)), "omega", 0.9, 2.5)
    (point,) = [point for point in found.special if point.kind == "graze"]
    assert point.value == pytest.approx(graze, abs=1e-14 * 50)
    assert found.values.min() == pytest.approx(point.value, abs=1e-14)
    assert point.orbit.q == 2 and point.orbit.speeds.min() == 0.0
    assert np.isinf(point.orbit.multipliers[0])


def test_a_flight_that_passes_the_stop_only_within_a_step_ends_the_branch():
    """By at most 6e-6, over a window of 1.3e-3 of omega; a step there is far longer unless halved.

    The orbits on both sides of the window exist.
    """
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


def test_the_free_oscillation_is_a_branch_to_its_graze():
    start = periodic_orbit(replace(AHEAD, omega=1.9), 0.0, 0.0)
    found = branch(start, "omega", 1.2, 2.0)
    assert (found.m, found.q) == (1, 0)
    assert special(found, "graze") == pytest.approx([1.4], abs=1e-14)
    assert found.stable[1:].all()


def test_the_free_oscillation_is_not_stable_without_damping():
    """Its multipliers are on the unit circle at h = 0, and inside it beyond."""
    start = periodic_orbit(Oscillator(h=0.3, R=0.8, omega=1.9, f=1.0, clearance=2.0), 0.0, 0.0)
    found = branch(start, "h", 0.0, 0.5)
    assert found.values[0] == 0.0 and found.stable.tolist() == (found.values > 0.0).tolist()


@pytest.mark.parametrize("R", [0.8, 0.5])
def test_without_damping_orbits_vanish_at_a_multiple_of_the_eigenfrequency(R):
    """A natural vibration returns there in four periods, so that the impact has no speed.

    Its speed is proportional to tan(4 pi / omega). Newton's method fails beside it.
    """
    osc = Oscillator(h=0.0, R=R, omega=4.2, f=1.0, clearance=1.0)
    orbits = one_impact_orbits(osc, 4)
    assert orbits
    for orbit in orbits:
        found = branch(orbit, "omega", 3.0, 4.3)
        end, edge = found.special
        assert (end.kind, edge.kind) == ("graze", "edge")
        assert end.value == found.values[0] == pytest.approx(4.0, abs=1e-13)
        assert end.orbit.speeds.tolist() == found.speeds[0].tolist() == [0.0]


def test_a_branch_without_an_end_is_lost():
    """Without damping and loss its speed grows without bound towards omega = 2 p."""
    start = one_impact_orbit(Oscillator(h=0.0, R=1.0, omega=2.3, f=1.0, clearance=-0.4))
    found = branch(start, "omega", 1.5, 2.5)
    assert [point.kind for point in found.special] == ["lost", "edge"]
    assert found.special[0].value == pytest.approx(2.0, abs=1e-3)
    assert found.speeds[0] > 1000.0


def test_two_flips_in_one_step_are_found():
    """Between them a multiplier is -1.0111; both ends of a step of the longest length are stable.

    The values are those of the closed form.
    """
    osc = Oscillator(h=0.005, R=0.48544860644798926, omega=2.0, f=1.0)
    found = special(branch(one_impact_orbit(osc), "omega", 0.25, 4.0), "flip")
    assert found[:2] == pytest.approx([1.113553429805437, 1.164509496718609], abs=1e-13)


def test_a_branch_without_a_stop_in_the_way_ends_where_there_is_no_force():
    osc = Oscillator(h=0.05, R=0.8, omega=2.3, f=1.0)
    found = branch(one_impact_orbit(osc), "f", 0.0, 2.0).special
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
    for high in np.linspace(2.1, 2.6, 41).tolist():
        found = branch(start, "omega", 1.9, high)
        assert found.values[[0, -1]].tolist() == [1.9, high]
        (orbit,) = found.at(high)
        assert orbit.speeds[0] == pytest.approx(one_impact_orbit(orbit.oscillator).v, abs=1e-13)


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


def doubled_branches(seed):
    """Yield branches of orbits of twice the period, and their ranges, from random oscillators."""
    rng = np.random.default_rng(seed)
    for osc, n in random_oscillators(10**6, seed, clearance=0.5):
        osc = replace(osc, h=rng.choice([0.0, 0.1]) * rng.uniform(), R=rng.uniform(0.3, 1.0))
        axis = str(rng.choice(["R", "omega", "p", "clearance"]))
        value = getattr(osc, axis)
        ends = (-0.6, 0.6) if axis == "clearance" else (max(value - 0.3, 0.05), value + 0.3)
        ends = ends[0], min(ends[1], 1.0) if axis == "R" else ends[1]
        queue = [
            branch(orbit, axis, *ends) for orbit in one_impact_orbits(osc, n)[-1:] if orbit.exists
        ]
        while queue:
            single = queue.pop()
            for point in single.special:
                if point.kind == "flip" and point.orbit.m == single.m:
                    found = doubled_branch(point.orbit, axis, *ends)
                    yield found, ends
                    if found.m <= 4 * n:
                        queue.append(found)


@pytest.mark.parametrize(
    ("seed", "count"),
    [
        pytest.param(14, 20, marks=pytest.mark.slow),
        pytest.param(15, 4000, marks=pytest.mark.campaign),
    ],
)
def test_a_branch_has_the_same_special_points_from_wherever_it_is_followed(seed, count):
    """Five starts on each branch of orbits of twice the period."""
    rng = np.random.default_rng(8)
    for found, ends in islice(doubled_branches(seed), count):
        # At a resonance without damping, a branch may be at a single value.
        narrow = np.ptp(found.values) < 1e-6
        if len(found.values) < 4 or narrow or special(found, "lost") or len(found.special) > 20:
            continue
        expected = [(p.kind, p.orbit.m, p.value) for p in found.special]
        expected = sorted([*expected, ("flip", found.m // 2, found.values[0])])
        for i in rng.integers(1, len(found.values) - 1, 5).tolist():
            again = branch(found.orbit(i), *found.parameters, *ends)
            listed = sorted((p.kind, p.orbit.m, p.value) for p in again.special)
            assert [item[:2] for item in listed] == [item[:2] for item in expected]
            values = [item[2] for item in expected]
            assert [item[2] for item in listed] == pytest.approx(values, abs=1e-8)


@pytest.mark.slow
def test_from_any_of_its_points_a_branch_has_its_points_in_order_and_no_orbit_twice():
    """A located flip may be the point from which the branch is followed, to rounding.

    At the flip in which a branch begins, its orbit is that of half the period.
    """
    osc = Oscillator(h=0.042061313697905986, R=0.7280397579828685, omega=6.5, f=1.0)
    found, checked = branch(one_impact_orbit(osc, 3), "omega", 5.5, 7.5), 0
    while found.m < 40:
        flips = [point.orbit for point in found.special if point.kind == "flip"]
        found = doubled_branch(max(flips, key=lambda orbit: orbit.m), "omega", 5.5, 7.5)
        for i in range(len(found.values)):
            again = branch(found.orbit(i), "omega", 5.5, 7.5)
            if again.m < found.m:
                assert i == 0
                continue
            z = np.column_stack([again.phases, again.speeds, again.values])
            chords = np.diff(z, axis=0)
            chords /= np.linalg.norm(chords, axis=1)[:, None]
            assert np.sum(chords[1:] * chords[:-1], axis=1).min() > 0.9
            kinds = sorted(point.kind for point in again.special)
            assert kinds == sorted(["flip"] + [point.kind for point in found.special])
            checked += 1
    assert checked > 50


def feigenbaum(count):
    found = branch(one_impact_orbit(Oscillator(0.0, 0.8, 2.6, 1.0)), "omega", 2.4, 3.0)
    flip = max((p for p in found.special if p.kind == "flip"), key=lambda point: point.value)
    flips = [flip]
    for _ in range(count):
        found = doubled_branch(flip.orbit, "omega", 2.4, 2.9)
        flip = found.special[0]
        assert flip.kind == "flip" and (found.m, found.q) == (2 * flips[-1].orbit.m,) * 2
        flips.append(flip)
    return flips


def test_the_cascade_of_flips():
    values = [flip.value for flip in feigenbaum(4)]
    assert values[1] == pytest.approx(2.715987251, abs=5e-10)
    assert values[2] == pytest.approx(2.7291177, abs=5e-7)


def test_the_orbits_just_beyond_a_flip_are_those_of_twice_the_period():
    """The halves differ by the square root of the distance; nearer, they were taken for one."""
    (flip,) = feigenbaum(0)
    found, sizes = doubled_branch(flip.orbit, "omega", 2.4, 2.9), []
    for away in (1e-6, 1e-7, 1e-8, 1e-9):
        shares = []
        for further in away * np.linspace(0.8, 1.2, 9):  # each with an error of its own
            (orbit,) = found.at(flip.value + further)
            assert (orbit.m, orbit.q) == (2, 2)
            shares.append(abs(np.diff(orbit.speeds)[0]) / math.sqrt(further))
        sizes.append(np.median(shares))
        again = branch(orbit, "omega", 2.4, 2.9)
        assert [point.kind for point in again.special] == ["flip", "flip", "edge"]
    assert sizes == pytest.approx([sizes[0]] * 4, rel=1e-3)
    assert found.at(flip.value) == []


@pytest.mark.parametrize("width", [1e-3, 1e-6, 1e-8])
def test_a_weak_spring_hides_no_flip_in_a_narrow_range(width):
    """A ball on a table, nearly: the speed p |clearance| is 2,000 times that of any impact."""
    osc = Oscillator(h=0.0, R=0.15, omega=1.0, f=2.8, p=1e-4, clearance=-1e8)
    first = branch(one_impact_orbit(osc), "f", 2.5, 4.0)
    (start,) = [point.orbit for point in first.special if point.kind == "flip"]
    whole = doubled_branch(start, "f", 2.5, 4.0)
    (flip,) = special(whole, "flip")
    (beside,) = whole.at(flip - 0.3 * width)
    narrow = branch(beside, "f", flip - width, flip + width)
    assert [point.kind for point in narrow.special] == ["edge", "flip", "edge"]
    (value,) = special(narrow, "flip")
    assert value == pytest.approx(flip, abs=1e-12)
    assert narrow.stable.tolist() == (narrow.values < value).tolist()


@pytest.mark.slow
def test_feigenbaums_ratio_after_seven_further_flips():
    """4.6692; the last orbit has 256 impacts, and returns to itself in simulation."""
    flips = feigenbaum(8)
    distances = np.diff([flip.value for flip in flips])
    assert distances[-2] / distances[-1] == pytest.approx(4.6692, abs=5e-4)
    orbit = flips[-1].orbit
    assert orbit.m == 256
    (x, v), *_ = orbit.sections()
    run = simulate(orbit.oscillator, 256, x0=x, v0=v)
    assert run.section_x[-1] == pytest.approx(x, abs=1e-9)


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


def test_a_solution_that_passes_the_stop_has_no_branch():
    passing = one_impact_orbit(Oscillator(h=0.02, R=0.8, omega=0.3, f=1.0))
    assert not passing.exists
    with pytest.raises(OrbitError, match="the orbit does not exist: it passes the stop"):
        branch(passing, "omega", 0.2, 7.0)


def beside(osc, n, clearances):
    """Return the branch of n/1 over the clearance, from the first value with such an orbit."""
    for clearance in clearances.tolist():
        for start in one_impact_orbits(replace(osc, clearance=clearance), n)[-1:]:
            if start.exists:
                return branch(start, "clearance", clearances.min(), clearances.max())
    raise AssertionError(n)


@pytest.mark.parametrize(("decay", "most"), [(0.2, 7), (0.4, 9)])
def test_period_adding_has_the_ratios_of_the_multiplier(decay, most):
    """At h = 3, R = .8, beside the graze of the free oscillation: successive flips of n/1.

    With the larger multiplier lambda of the free oscillation, distances to the graze have the
    ratio lambda^-2, impact speeds lambda^-1.
    """
    h, rate = 3.0, 3.0 - math.sqrt(8.0)
    omega = 2.0 * math.pi * rate / -math.log(decay)
    osc = Oscillator(h=h, R=0.8, omega=omega, f=1.0)
    graze = 1.0 / math.hypot(1.0 - omega**2, 2.0 * h * omega)
    flips = []
    for n in range(2, most + 1):
        scale = np.concatenate([np.geomspace(100.0, 1e-3, 60), [0.0]])
        found = beside(osc, n, graze * (1.0 - decay ** (2 * n) * scale))
        (flip,) = [point for point in found.special if point.kind == "flip"]
        flips.append((graze - flip.value, flip.orbit.speeds[0]))
    distances, speeds = np.array(flips).T
    assert distances[-2] / distances[-1] == pytest.approx(decay**-2, rel=1e-3)
    assert speeds[-2] / speeds[-1] == pytest.approx(1.0 / decay, rel=1e-3)


# --- random branches of one-impact orbits, in 40 digits and more ---


EPS = 2.0**-52


def condition(parameters, n):
    """Return the shift of the fold, in roundings, if each datum changes by one (h by one of p)."""
    step, (sigma, _) = mp.mpf(10) ** -18, fold_of_one_impact(parameters, n)
    total = mp.mpf(0)
    for name in ("h", "R", "omega", "f", "p"):
        unit = parameters["p" if name == "h" else name]
        moved = parameters | {name: parameters[name] + step * unit}
        total += abs(fold_of_one_impact(moved, n)[0] / sigma - 1) / step
    return float(total)


def random_folds(seed):
    """Yield oscillators just beside a fold of admissible n/1 orbits, and n."""
    rng = np.random.default_rng(seed)
    while True:
        p = rng.uniform(0.5, 2.0)
        h = p * float(rng.choice([0.0, 1.0, rng.uniform(0.0, 0.5), rng.uniform(0.5, 2.0)]))
        osc = Oscillator(h, rng.uniform(), p * rng.uniform(0.5, 6.0), 1.0, p)
        n = int(rng.integers(1, 4))
        osc = replace(osc, clearance=0.9999 * float(fold_of_one_impact(in_digits(osc), n)[0]))
        orbits = one_impact_orbits(osc, n)
        if len(orbits) == 2 and all(orbit.exists for orbit in orbits):
            yield osc, n


@pytest.mark.slow
@pytest.mark.parametrize(
    ("axis", "count"),
    [("clearance", 50), ("h", 15), ("R", 15), ("omega", 15), ("f", 15), ("p", 15)],
)
def test_random_folds_are_at_their_closed_form(axis, count):
    """As many as the closed form has on the branch; undamped, critical and over-damped too.

    Beside a fold the state has half the digits of the distance, but the parameter there has all: it
    is a smooth function of the others, found to a few roundings times its condition number.
    """
    cases = (case for case in random_folds(seed=5) if getattr(case[0], axis))
    with mp.workdps(40):
        for osc, n in islice(cases, count):
            value = getattr(osc, axis)
            ends = sorted((0.998 * value, min(1.002 * value, 1.0 if axis == "R" else math.inf)))
            start = one_impact_orbit(osc, n)
            assert (start.m, start.q) == (n, 1)
            folds = [point for point in branch(start, axis, *ends).special if point.kind == "fold"]
            assert len(folds) == sum(
                at_end.clearance / fold_of_one_impact(in_digits(at_end), n)[0] > 1
                for at_end in (replace(osc, **{axis: end}) for end in ends)
            )
            values = [point.value for point in folds]
            speeds = [float(point.orbit.speeds[0]) for point in folds]
            for value, speed in zip(values, speeds, strict=True):
                at_fold = replace(osc, **{axis: value})
                sigma, v = fold_of_one_impact(in_digits(at_fold), n)
                rounding = EPS * (1.0 + condition(in_digits(at_fold), n))
                assert abs(at_fold.clearance / sigma - 1) < 32.0 * rounding
                assert abs(speed / v - 1) < 100.0 * rounding


def on_a_base(osc, share):
    """Return an oscillator in which a base makes a share of the force."""
    return replace(osc, f=(1.0 - share) * osc.f, a=share * osc.f / osc.omega**2)


@pytest.mark.parametrize(
    "count",
    [pytest.param(12, marks=pytest.mark.slow), pytest.param(500, marks=pytest.mark.campaign)],
)
@pytest.mark.parametrize("shaken", [False, True])
def test_random_flips_and_grazes_are_those_of_the_section_map(count, shaken):
    """To 1e-13, any damping but the critical; and a branch is stable where the closed form is.

    The force is f, or half or all of it comes from a base, along omega or its amplitude.
    """
    compared = {"flip": 0, "graze": 0}
    rng = np.random.default_rng(4)
    for osc, n in random_oscillators(60 * count, seed=31, clearance=0.5):
        if sum(compared.values()) >= count:
            break
        axis = str(rng.choice(["h", "R", "omega", "f", "p", "clearance"]))
        if shaken:
            osc, axis = on_a_base(osc, rng.choice([0.5, 1.0])), str(rng.choice(["omega", "a"]))
        orbits, value = one_impact_orbits(osc, n), getattr(osc, axis)
        if osc.h == osc.p or not orbits or not orbits[-1].exists or not value:
            continue
        ends = sorted((0.85 * value, min(1.15 * value, 1.0 if axis == "R" else math.inf)))
        found = branch(orbits[-1], axis, *ends)
        for point in found.special:
            if point.kind in compared:
                with mp.workdps(50):
                    expected = SectionMap(point.orbit).bifurcation(point.kind, axis)
                    assert abs(point.value / expected - 1) < 1e-13
                compared[point.kind] += 1
        at_special = np.isin(found.values, [point.value for point in found.special])
        for i in np.flatnonzero(~at_special)[::5].tolist():
            orbits = one_impact_orbits(replace(osc, **{axis: float(found.values[i])}), n)
            nearest = min(orbits, key=lambda orbit: abs(orbit.v - found.speeds[i, 0]))
            assert nearest.v == pytest.approx(found.speeds[i, 0], rel=1e-9)
            assert nearest.stable == found.stable[i]
    assert sum(compared.values()) >= count and min(compared.values()) > count // 4


def at_fixed_force(osc, omega, n):
    """Return the n/1 orbits at a value of omega, the slower first, by the force there."""
    force = osc.f + osc.a * omega**2
    return one_impact_orbits(replace(osc, omega=float(omega), f=force, a=0.0), n)


def flipped(orbit):
    return np.real(np.prod(1.0 + orbit.multipliers)) < 0.0


@pytest.mark.parametrize(
    ("seed", "count", "steps"),
    [
        pytest.param(3, 12, 100, marks=pytest.mark.slow),
        pytest.param(2, 200, 400, marks=pytest.mark.campaign),
    ],
)
def test_a_branch_over_the_frequency_of_a_base_misses_nothing_of_a_dense_walk(seed, count, steps):
    """Between its folds a branch is the faster or the slower orbit of the force at every omega.

    Each such part is walked in many steps: all orbits exist, and they flip where the branch says.
    Beyond a graze at an end of the branch the orbit passes the stop or has no impact; undamped, it
    may go on from a speed of zero.
    """
    rng, seen = np.random.default_rng(seed), {"flip": 0, "fold": 0, "graze": 0}
    cases, done = random_oscillators(10**6, seed, clearance=0.7), 0
    while done < count:
        osc, n = next(cases)
        osc = on_a_base(osc, rng.choice([0.5, 1.0]))
        orbits = one_impact_orbits(osc, n)
        if osc.h == osc.p or not orbits or not orbits[-1].exists:
            continue
        found = branch(orbits[-1], "omega", 0.5 * osc.omega, 1.6 * osc.omega)
        if special(found, "lost") or np.ptp(found.values) < 1e-3:
            continue
        done += 1
        for kind in seen:
            seen[kind] += len(special(found, kind))
        values, flips = found.values, special(found, "flip")
        turns = np.flatnonzero(np.isin(values, special(found, "fold"))).tolist()
        for begin, end in pairwise([0, *turns, len(values) - 1]):
            part = slice(begin, end + 1)
            middle = (begin + end) // 2
            there = at_fixed_force(osc, values[middle], n)
            which = int(np.argmin([abs(o.v - found.speeds[middle, 0]) for o in there]))
            which -= len(there)  # -1 is the faster, also where the other has no speed > 0
            for omega, v in zip(values[part][1:-1], found.speeds[part][1:-1, 0], strict=True):
                assert v == pytest.approx(at_fixed_force(osc, omega, n)[which].v, rel=1e-9)
            walk = np.linspace(values[begin], values[end], steps + 2)[1:-1]
            orbits = [at_fixed_force(osc, omega, n)[which] for omega in walk]
            assert all(orbit.exists for orbit in orbits)
            expected = np.abs(np.diff([flipped(orbit) for orbit in orbits]))
            ours = [omega for omega in values[part] if omega in flips]
            assert (
                np.histogram(ours, np.sort(walk))[0].tolist()
                == (expected if walk[0] < walk[-1] else expected[::-1]).astype(int).tolist()
            )
        for at, inwards in ((0, 1), (-1, -2)):
            if values[at] in special(found, "graze") and osc.h > 0.0:
                beyond = values[at] + 1e-6 * (values[at] - values[inwards])
                there = at_fixed_force(osc, beyond, n)
                assert len(there) < 2 or not all(orbit.exists for orbit in there)
    assert min(seen.values()) > count // 20, seen


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
    run = simulate(osc, 600)
    start = periodic_orbit(osc, float(run.section_x[-1]), float(run.section_v[-1]), 2)
    found = branch(start, "omega", 0.95 * osc.omega, 1.05 * osc.omega)
    grazes = [point.orbit for point in found.special if point.kind == "graze"]
    assert sorted(orbit.q for orbit in grazes) == [found.q, found.q + 1]
    for orbit in grazes:
        assert np.count_nonzero(orbit.speeds == 0.0) == 1
        there, k = orbit.oscillator, int(np.argmin(orbit.speeds))
        theta, v = orbit.phases[k - 1], orbit.speeds[k - 1]
        flight = ClosedForm(there, theta / there.omega, there.clearance, -there.R * v)
        x, u = flight(orbit.phases[k] / there.omega)
        assert x == pytest.approx(there.clearance, abs=1e-9) and u == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("osc", "m"),
    [
        (Oscillator(h=0.0582, R=0.4135, omega=2.1931, f=1.0, clearance=-0.4096), 1),
        (Oscillator(h=0.00149, R=0.7685, omega=1.8621, f=1.0, clearance=-0.3599), 3),
    ],
)
def test_a_wide_range_hides_no_flip_or_fold(osc, m):
    """In natural units, which are those of the greatest force, the speeds are tiny there."""
    run = simulate(osc, 600, x0=osc.clearance)
    start = periodic_orbit(osc, float(run.section_x[-1]), float(run.section_v[-1]), m)
    narrow, wide = (
        {(p.kind, float(f"{p.value:.9g}")) for p in branch(start, "f", 0.5, high).special}
        for high in (2.0, 2e7)
    )
    assert {"flip", "fold"} < {kind for kind, _ in narrow} and narrow == wide
