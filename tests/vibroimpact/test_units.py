"""A change of units by powers of two changes no bit of what has no unit."""

import numpy as np
import pytest

from tests.helpers.kernel_cases import random_points
from tests.helpers.oscillators import random_oscillators, settled_orbit
from tests.helpers.other_units import in_units
from tests.vibroimpact.test_far_stop import balls
from tests.vibroimpact.test_free_motions import weakly_damped
from vibroimpact import Oscillator, bifurcation_curve, branch, one_impact_orbits
from vibroimpact.kernel.integrate import Length, run_points
from vibroimpact.natural_units import NaturalUnits
from vibroimpact.orbits.orbit import PeriodicOrbit, free_amplitude
from vibroimpact.orbits.periodic import OrbitError
from vibroimpact.oscillator import PARAMETERS, POINT
from vibroimpact.step.scheme import scheme_of


def run(points, integrator, rule):
    """Return all results, with those of the destination beside them."""
    scheme = scheme_of(points, integrator, rule, None, phase=0.3)
    how = Length(20, 64, 8), rule == "exact", None, np.zeros(1, np.int64)
    results = run_points(points, scheme, *how, classes=True, extremes=True)
    del results["begun"]
    found = results.pop("destination")
    return results | {name: found[name] for name in found.dtype.names}


@pytest.mark.parametrize(
    ("integrator", "rule"),
    [("exact", "exact"), ("newmark", "reduced-step"), ("rk4", "plain"), ("newmark", "cubic")],
)
def test_units_change_no_bit(integrator, rule):
    """Of all results of random motions, of weakly damped ones, and of some near a far stop."""
    far, weak = balls(1e-7, 0.6, np.linspace(2.0, 20.0, 20)), weakly_damped(40, -5.0, -2.0, 1)
    points = np.concatenate([random_points(150), weak, far])
    results = run(points, integrator, rule)
    for rate, length in ((2.0**10, 2.0**5), (2.0**-20, 2.0**40)):
        scaled = points.copy()
        for name in POINT.names:
            scaled[name] = in_units(name, points[name], rate, length)
        for name, values in run(scaled, integrator, rule).items():
            expected = in_units(name, results[name], rate, length)
            np.testing.assert_array_equal(values, expected, err_msg=name)


def test_natural_units_are_near_those_of_the_motion():
    """The extent 10 / 16 is .625 L; p T is 8^(1/2) / 2, and omega T is 1."""
    osc = Oscillator(h=1.0, R=0.5, omega=2.0, f=6.0, p=8.0**0.5, clearance=-0.5)
    points = np.concatenate([osc.at(-0.5), osc.at(-1.0, 3.0)])
    points["omega"][0], points["f"][0] = 1.5, 1.0
    units = NaturalUnits.of(points)
    assert units == (0, -1)
    inside = units.oscillator_into(osc)
    assert [inside.omega, inside.f] == [1.0, 1.5]
    assert units.into(("length", "length/time"), [-1.0, 3.0]).tolist() == [-1.0, 1.5]
    points["clearance"] = -1.5
    assert NaturalUnits.of(points).length == 1


@pytest.mark.parametrize("exponents", [(-900, 0), (40, 20), (-40, -20), (0, 500), (-300, -300)])
def test_natural_oscillators_do_not_depend_on_the_units(exponents):
    other = NaturalUnits(*exponents)
    for osc, _ in random_oscillators(40, 3):
        scaled = other.oscillator_into(osc)
        natural, same = (NaturalUnits.of(o.at(o.clearance)) for o in (osc, scaled))
        assert natural.oscillator_into(osc) == same.oscillator_into(scaled)
        assert oscillator_out_of(other, scaled) == osc
        inside = natural.oscillator_into(osc)
        assert 1.0 <= max(inside.omega, inside.p) < 2.0


@pytest.mark.parametrize(
    "values",
    [
        {"f": 1e308, "h": 1e300, "omega": 1e-300},
        {"f": 0.0, "a": 1e-310, "omega": 1e300, "p": 1e-300},
        {"f": 0.0, "a": 0.0},
        {"f": 0.0, "a": 0.0, "clearance": -1e308},
        {"f": 1e-320, "p": 1e300},
    ],
)
def test_natural_units_of_extreme_numbers_are_numbers(values):
    points = Oscillator(h=0.1, R=0.5, omega=1.0, f=1.0).at()
    for name, value in values.items():
        points[name] = value
    assert abs(NaturalUnits.of(points).length) < 10_000


@pytest.mark.parametrize(("length", "time"), [(-720, -166), (720, 166), (900, 0), (0, -250)])
def test_the_free_amplitude_has_the_same_bits_in_every_unit(length, time):
    """With omega near 1e50 and forces near 1e-100, too, of which products leave the range."""
    units = NaturalUnits(length, time)
    for osc, _ in random_oscillators(40, 5):
        expected, a = free_amplitude(osc), free_amplitude(oscillator_out_of(units, osc))
        assert complex(*units.into("length", [a.real, a.imag])) == expected


# --- orbits, branches and curves, in units that other exponents of length and time make ---

EXPONENTS = [(-40, 20), (40, -20), (-30, 0), (7, -13), (0, 20)]


def oscillator_out_of(units, osc):
    """Return an oscillator in the units of the user."""
    return NaturalUnits(-units.length, -units.time).oscillator_into(osc)


def orbit_out_of(units, orbit):
    """Return an orbit in the units of the user."""
    osc, speeds = oscillator_out_of(units, orbit.oscillator), orbit.speeds
    speeds = units.out_of("length/time", speeds)
    return PeriodicOrbit(osc, orbit.m, orbit.phases, speeds, orbit.kind)


def range_out_of(units, axis):
    """Return the name and the range of a parameter in the units of the user."""
    name, *ends = axis
    return name, *units.out_of(PARAMETERS[name].unit, ends).tolist()


def orbit_numbers(units, orbit):
    """Return all that is said of an orbit, its quantities in the given units."""
    sections = orbit.sections(0.3)
    return [
        units.oscillator_into(orbit.oscillator), orbit.m, orbit.phases,
        units.into("length/time", orbit.speeds), orbit.multipliers, orbit.exists,
        units.into("length", sections[:, 0]), units.into("length/time", sections[:, 1]),
        units.into("length", [orbit.x_min, orbit.x_max]),
    ]  # fmt: skip


def branch_numbers(units, found):
    """Return all that is said of a branch or a curve, its quantities in the given units."""
    columns = found.values.reshape(len(found.values), -1).T
    both = zip(found.parameters, columns, strict=True)
    numbers = [units.into(PARAMETERS[name].unit, column) for name, column in both]
    numbers += [found.stable, found.phases, units.into("length/time", found.speeds)]
    for point in found.special:
        numbers += [point.kind, *orbit_numbers(units, point.orbit)]
    if not found.kind:
        middle = units.into(PARAMETERS[found.parameters[0]].unit, found.values).mean()
        value = float(units.out_of(PARAMETERS[found.parameters[0]].unit, middle))
        for orbit in found.at(value):
            numbers += orbit_numbers(units, orbit)
    return numbers


def assert_same(first, second, message):
    """Assert that lists of arrays and other objects agree to the last bit."""
    assert len(first) == len(second), message
    for one, other in zip(first, second, strict=True):
        if isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, other, err_msg=message)
        else:
            assert one == other, message


def random_range(rng, osc, name):
    """Return a range about a parameter of an oscillator."""
    value = getattr(osc, name)
    low, high = value - rng.uniform(0.05, 0.5) * abs(value), value + 0.4 * abs(value)
    if value == 0.0:
        low, high = (0.0, 0.2) if name in ("h", "R") else (-0.2, 0.2)
    return name, low, min(high, 1.0) if name == "R" else high


CURVES = ("flip", "fold", "graze")


def random_curves(count, seed):
    """Yield random orbits, two ranges, the branch over the first, and the bifurcations on it."""
    rng = np.random.default_rng(seed)
    names = ["h", "R", "omega", "f", "p", "clearance"]
    for osc, n in random_oscillators(count, seed):
        first, second = (random_range(rng, osc, name) for name in rng.permutation(names)[:2])
        for orbit in one_impact_orbits(osc, n):
            if not orbit.exists:
                continue
            found = branch(orbit, *first)
            kinds = [(p.kind, p.orbit) for p in found.special if p.kind in CURVES]
            yield orbit, first, second, found, kinds


@pytest.mark.parametrize(
    ("count", "seed"), [(100, 5), pytest.param(6000, 6, marks=pytest.mark.campaign)]
)
def test_units_change_no_bit_of_branches_and_curves(count, seed):
    own, seen = NaturalUnits(0, 0), {"": 0, "flip": 0, "fold": 0, "graze": 0}
    for i, (orbit, first, second, found, kinds) in enumerate(random_curves(count, seed)):
        units = NaturalUnits(*EXPONENTS[i % len(EXPONENTS)])
        scaled = branch(orbit_out_of(units, orbit), *range_out_of(units, first))
        assert_same(branch_numbers(own, found), branch_numbers(units, scaled), f"{orbit} {first}")
        seen[""] += 1
        axes = [range_out_of(units, axis) for axis in (first, second)]
        for kind, start in kinds:
            try:
                curve = bifurcation_curve(start, kind, first, second)
            except OrbitError as error:
                with pytest.raises(OrbitError, match=str(error)[:20]):
                    bifurcation_curve(orbit_out_of(units, start), kind, *axes)
                continue
            scaled = bifurcation_curve(orbit_out_of(units, start), kind, *axes)
            message = f"{start} {kind} {first} {second}"
            assert_same(branch_numbers(own, curve), branch_numbers(units, scaled), message)
            seen[kind] += 1
    assert min(seen.values()) > 0 and sum(seen.values()) > count // 4, seen


@pytest.mark.parametrize(
    ("osc", "m"),
    [
        (Oscillator(h=0.0582, R=0.4135, omega=2.1931, f=1.0, clearance=-0.4096), 1),
        (Oscillator(h=0.00149, R=0.7685, omega=1.8621, f=1.0, clearance=-0.3599), 3),
    ],
)
def test_a_wide_range_hides_no_flip_or_fold(osc, m):
    """In natural units, which are those of the greatest force, the speeds are tiny there."""
    start = settled_orbit(osc, m, x0=osc.clearance)
    narrow, wide = (
        {(p.kind, float(f"{p.value:.9g}")) for p in branch(start, "f", 0.5, high).special}
        for high in (2.0, 2e7)
    )
    assert {"flip", "fold"} < {kind for kind, _ in narrow} and narrow == wide
