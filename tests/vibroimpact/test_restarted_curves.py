"""A curve has the same ends and special points from each of its orbits, and its multipliers."""

import math
from functools import cache

import numpy as np
import pytest

from tests.helpers.kernel_cases import few_or_many
from vibroimpact.orbits.branches import branch
from vibroimpact.orbits.curves import CURVE_KINDS, bifurcation_curve
from vibroimpact.orbits.orbit import PeriodicOrbit
from vibroimpact.orbits.periodic import OrbitError, periodic_orbit
from vibroimpact.oscillator import Oscillator
from vibroimpact.trajectory import simulate

#: Curves with what was wrong from some of their orbits: an oscillator, m, phases, speeds, the kind,
#: two ranges, and the special points as they are in quad precision.
CUSP = (
    Oscillator(0.008188662089148483, 0.6753756819258433, 5.151941492141442, 1.0, 1.0,
               0.011286873178449537),
    24,
    (4.930434695929946, 23.490124393677284, 25.150417739349063, 42.60220948114409,
     61.0428251649646, 62.372809780209344, 80.23875714662444, 98.97583160801877,
     100.95098104987377, 118.22115011521748, 136.2058610732988, 137.47767274538322),
    (0.25529752614055806, 0.1952502364883377, 0.0743716164306106, 0.278509804149993,
     0.17632831563813223, 0.09525828697335807, 0.26069438519949656, 0.19912037920740655,
     0.03764867766642314, 0.279111279324615, 0.1735343314738448, 0.10791767741691788),
    "fold", ("R", 0.4849000139191449, 1.0), ("omega", 0.07423002576000019, 357.5709541616697),
    {"cusp": (0.67425203042, 5.15317079165)},
)  # fmt: skip
SINGULAR_END = (
    Oscillator(0.011642948232023047, 0.2674026958566805, 5.337345698403018, 1.0,
               0.5886088495274829, 0.026389188219725128),
    10, (5.648641739819293, 36.604774630652244), (0.31107344565118816, 0.3064261220972446),
    "graze", ("clearance", -0.20258664612750543, 0.2553650225669557),
    ("p", 0.44704439869226137, 0.7301733003627044),
    {"graze": (0.00070906430, 0.57152628732), "edge": (0.15656333519, 0.7301733003627),
     "flip": (0.040717331049748, 0.600279862793)},
)  # fmt: skip
#: Where Newton's method fails, 1 - omega / p is 1e-4: the end is a degenerate flip (model.md, 5).
NEAR_RESONANCE = (
    Oscillator(0.001589843647971795, 0.9478511307019399, 1.0804674567054975, 1.0,
               1.0811109412827986, 1.566385912292227),
    2, (4.74602023970686, 10.986473102518408), (0.9543481819117794, 2.0256200504350677),
    "fold", ("p", 0.14955086693616904, 1.3048996635493246), ("R", 0.5184744805967156, 1.0),
    {"flip": (1.08057242, 0.98413619)},
)  # fmt: skip
#: Without damping and loss two curves cross at omega = 4 p; here each turns off just before.
NEARLY_CROSSING = (
    Oscillator(0.0, 0.99999, 3.7763, 0.043685, 1.0, -0.013),
    2, (2.7326, 6.69215), (0.01969, 0.01969), "flip", ("f", 0.0, 1.0), ("omega", 3.0, 8.0),
    {"edge": (0.018658925, 8.0)},
)  # fmt: skip


def assert_same_from_its_orbits(kind, whole, ranges, numbers):
    """The curve that begins at each of these orbits has the ends and special points of the whole.

    They agree to 1e-6 of the ranges, in the same or in reverse order.
    """
    spans = np.array([high - low for _, low, high in ranges])
    for i in numbers:
        again = bifurcation_curve(whole.orbit(i), kind, *ranges)
        for points, others in ((whole.special, again.special), (again.special, whole.special)):
            for k, point in enumerate(points):
                away = [
                    np.abs((point.value - other.value) / spans).max()
                    for other in (others if 0 < k < len(points) - 1 else (others[0], others[-1]))
                    if other.kind == point.kind
                ]
                assert min(away, default=math.inf) < 1e-6, (i, point.kind, point.value, away)


def assert_multipliers(found):
    """Beside a graze their sum loses all digits, but one is known, and so is their product."""
    known = {"flip": -1.0, "fold": 1.0}[found.kind]
    orbits = [found.orbit(i) for i in range(len(found.values))]
    h, R, omega = np.transpose(
        [[getattr(o.oscillator, n) for n in ("h", "R", "omega")] for o in orbits]
    )
    products = R ** (2 * orbits[0].q) * np.exp(-4.0 * math.pi * h * found.m / omega)
    for multipliers in (np.array([o.multipliers for o in orbits]), found.orbits.multipliers):
        assert np.all(multipliers[:, 0] == known)
        np.testing.assert_allclose(multipliers[:, 1], known * products, rtol=1e-12)


@pytest.mark.parametrize("case", [CUSP, SINGULAR_END, NEAR_RESONANCE, NEARLY_CROSSING])
def test_a_curve_is_the_same_from_each_of_its_orbits(case):
    osc, m, phases, speeds, kind, first, second, expected = case
    start = PeriodicOrbit(osc, m, np.array(phases), np.array(speeds))
    whole = bifurcation_curve(start, kind, first, second)
    spans = np.array([first[2] - first[1], second[2] - second[1]])
    for name, value in expected.items():
        found = [p.value for p in whole.special if p.kind == name]
        away = np.array([np.abs((other - value) / spans).max() for other in found])
        assert away.min() < 1e-6
    last = len(whole.values) - 2
    assert_same_from_its_orbits(kind, whole, (first, second), (1, last))
    swapped = bifurcation_curve(start, kind, second, first)
    assert sorted(p.kind for p in swapped.special) == sorted(p.kind for p in whole.special)
    if case is CUSP:
        assert_multipliers(whole)


@cache
def random_curve(seed):
    """Return a random curve and its ranges; None if there is none on the branches of an orbit."""
    rng = np.random.default_rng(seed)
    osc = Oscillator(
        h=rng.choice([0.0, 10.0 ** rng.uniform(-3.0, -0.7)]), R=rng.uniform(0.2, 0.98),
        omega=rng.uniform(0.5, 6.0), f=1.0, p=rng.choice([1.0, rng.uniform(0.5, 1.4)]),
        clearance=rng.choice([0.0, rng.normal(0.0, 0.1), rng.uniform(0.1, 1.5)], p=[0.1, 0.6, 0.3]),
    )  # fmt: skip
    ranges = []
    for name in rng.choice(["omega", "R", "clearance", "p", "f"], 2, replace=False).tolist():
        value, width = getattr(osc, name), rng.choice([0.2, 0.4, 0.7, 0.95])
        size = abs(value) + (0.1 if name == "clearance" else 0.0)
        high = 1.0 if name == "R" else value + width * size / (1.0 - width)
        ranges.append((name, value - width * size, high))
    run = simulate(osc, 300, x0=min(0.0, osc.clearance))
    for m in range(1, 9):
        try:
            orbit = periodic_orbit(osc, float(run.section_x[-1]), float(run.section_v[-1]), m)
            kind = CURVE_KINDS[seed % 3]
            (start, *_) = [p for p in branch(orbit, *ranges[0]).special if p.kind == kind]
            return bifurcation_curve(start.orbit, kind, *ranges), ranges
        except (OrbitError, ValueError):
            continue
    return None


@pytest.mark.parametrize("seed", [1077, 1406, 20184, 30420, 31003])
def test_a_curve_is_the_same_on_both_sides_of_where_another_passes_or_crosses_it(seed):
    """Curves of flips that turn within a step, and another goes on, in the third beyond an edge.

    Also grazes at h = 0, flips that are degenerate twice within a step, and folds that are singular
    at the edge R = 1.
    """
    whole, ranges = random_curve(seed)
    numbers = np.linspace(1, len(whole.values) - 2, 3).astype(int).tolist()
    assert_same_from_its_orbits(whole.kind, whole, ranges, numbers)


@pytest.mark.parametrize(
    ("seed", "ratio", "cuts"),
    [(3629, 3.0, {1e-5: "edge"}), (20692, 2.0, {1e-5: "edge", 1e-6: "rest"})],
)
def test_undamped_curves_end_where_a_vibration_touches_the_stop_without_acceleration(
    seed, ratio, cuts
):
    """It repeats there for omega = ratio p; without acceleration p^2 clearance is the force."""
    whole, ranges = random_curve(seed)
    for i in (1, len(whole.values) // 2):
        special = bifurcation_curve(whole.orbit(i), whole.kind, *ranges).special
        (end,) = [point.orbit for point in special if point.kind == "rest"]
        osc = end.oscillator
        assert osc.omega == pytest.approx(ratio * osc.p, rel=1e-7)
        assert osc.p**2 * osc.clearance == pytest.approx(osc.f, rel=1e-7)
        assert end.phases == pytest.approx(1.5 * math.pi, abs=1e-4) and not end.speeds.any()
        for away, kind in cuts.items():  # before it, to 1e-6 of the ranges
            cut = (ranges[1][0], ranges[1][1], osc.clearance - away)
            special = bifurcation_curve(whole.orbit(i), whole.kind, ranges[0], cut).special
            last = max((special[0], special[-1]), key=lambda point: point.value[1])
            assert last.kind == kind


@pytest.mark.parametrize("widest", [20.0, 1000.0])
def test_speeds_without_bound_end_a_curve_at_the_resonance_over_ranges_of_any_width(widest):
    """At h = 0, R = 1 and omega = 5 p every natural vibration repeats after 5 periods."""
    whole, _ = random_curve(50488)
    ranges = ("R", 0.05, 1.0), ("omega", 0.2, widest)
    for share in (0.1, 0.6, 0.95):
        orbit = whole.orbit(int(share * len(whole.values)))
        ends = bifurcation_curve(orbit, "fold", *ranges).special
        assert (whole.m, [end.kind for end in ends]) == (5, ["edge", "edge"])
        assert ends[-1].value == pytest.approx([1.0, 5.0], abs=1e-8)


def test_undamped_grazes_meet_no_flips_and_folds_where_every_vibration_repeats():
    """Those of one impact meet them where sin(2 pi p / omega) = 0 and p / omega is not whole."""
    whole, ranges = random_curve(1406)
    ratios = {
        float(f"{2.0 * p.value[0] / whole.oscillator.omega:.9g}")
        for i in (0, 21, 33, len(whole.values) - 2)
        for p in bifurcation_curve(whole.orbit(i), "graze", *ranges).special
        if p.kind == "flip"
    }
    assert ranges[0][0] == "p" and ratios == {3.0, 5.0, 7.0, 9.0}


@few_or_many(("first", "count"), (0, 4), (1000, 300))
def test_random_curves_are_the_same_from_five_of_their_orbits(first, count):
    seen, seed = 0, first
    while seen < count:
        found, seed = random_curve(seed), seed + 1
        if found is None or len(found[0].values) < 12:
            continue
        whole, ranges = found
        if "lost" in {point.kind for point in whole.special}:  # after 2,000 points
            continue
        seen += 1
        numbers = np.linspace(1, len(whole.values) - 2, 5).astype(int).tolist()
        assert_same_from_its_orbits(whole.kind, whole, ranges, numbers)
        if whole.kind != "graze":
            known = {"flip": -1.0, "fold": 1.0}[whole.kind]
            assert np.all(whole.orbits.multipliers[:, 0] == known)
