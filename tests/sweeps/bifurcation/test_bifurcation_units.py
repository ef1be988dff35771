"""The table of bifurcations in other units: those of a rig, and units scaled by powers of two."""

import itertools
import math

import numpy as np
import pandas as pd
import pytest

import sweeps
from sweeps.bifurcation.bifurcation_table import find_bifurcations
from sweeps.opened.doors import in_si
from sweeps.opened.opened_sweep import OpenedSweep
from tests.helpers.other_units import in_units
from tests.helpers.sweep_files import swept

pytestmark = pytest.mark.slow

#: Ranges of the parameters in which most motions have impacts.
RANGES = {
    "h": (0.01, 0.1), "R": (0.5, 0.9), "omega": (2.4, 3.3), "f": (0.7, 1.3),
    "clearance": (0.02, 0.3), "p": (0.7, 1.3),
}  # fmt: skip
#: The names of a rig, and what a rig of a mass has for values of the model.
RIG = {
    "omega": ("frequency", lambda mass, omega: omega / math.tau),
    "h": ("damping", lambda mass, h: 2.0 * mass * h),
    "f": ("force", lambda mass, f: mass * f),
    "p": ("stiffness", lambda mass, p: mass * p * p),
    "clearance": ("gap", lambda mass, gap: gap),
    "R": ("R", lambda mass, R: R),
}
PLACES = ["low", "value", "high"]


def run(tmp_path, given, rate=1.0, length=1.0, transient=100):
    """Run a sweep in other units of 1 / time and length; return the path of its file."""
    scaled = {name: np.array(in_units(name, one, rate, length)).tolist()
              for name, one in given.items()}  # fmt: skip
    start = {"start": {"x0": scaled.pop("x0")}} if "x0" in given else {}
    record = {"transient": transient, "periods": 64, "diagnostics": ["period"]}
    scene = {"oscillator": scaled, "record": record, **start}
    return sweeps.run_sweep(scene, tmp_path / "scaled.h5", overwrite=True)


def table(tmp_path, given, rate=1.0, length=1.0, transient=100, most=8):
    """Return the table of a sweep in other units, its places in the units of `given`."""
    (axis,) = (name for name, one in given.items() if isinstance(one, list))
    found = sweeps.bifurcations(run(tmp_path, given, rate, length, transient), axis, most=most)
    found[PLACES] = in_units(axis, found[PLACES], 1.0 / rate, 1.0 / length)
    found["x"] /= length
    found["v"] /= length * rate
    unit = float(length * rate)
    speeds = [[float(speed) / unit for speed in row.split()] for row in found["impact_v"]]
    return found.assign(impact_v=list(map(str, speeds)))


def one_axis(axis, seed):
    """Return random parameters, of which one is swept."""
    random = np.random.default_rng(seed)
    given = {name: random.uniform(*ends) for name, ends in RANGES.items()}
    return {**given, axis: np.linspace(*RANGES[axis], int(random.integers(30, 60))).tolist()}


@pytest.mark.parametrize(
    ("axes", "seeds"),
    [
        (["clearance"], [1]),
        pytest.param(RANGES, range(1, 8), marks=pytest.mark.campaign),
    ],
)
def test_tables_are_the_same_in_all_units(tmp_path, axes, seeds):
    """Bit for bit in units that differ by powers of two; also if all values are below 1e-6."""
    rows = 0
    for axis, seed in itertools.product(axes, seeds):
        given, random = one_axis(axis, seed), np.random.default_rng(seed)
        length, rate = 2.0 ** random.integers(-40, -20), 2.0 ** random.integers(-20, 20)
        scaled = {"length": length, "rate": rate}
        ours, theirs = table(tmp_path, given, most=3), table(tmp_path, given, most=3, **scaled)
        pd.testing.assert_frame_equal(ours, theirs, check_exact=True)
        rows += len(ours)
    assert rows > 10


def test_branches_are_the_same_in_all_units(tmp_path):
    """With all that is drawn of them, bit for bit."""
    rate, length = 2.0**-9, 2.0**-21
    given = {"h": 0.03, "R": 0.7, "omega": 2.6, "f": 1.0, "p": 1.0}
    given["clearance"] = np.linspace(*RANGES["clearance"], 12).tolist()
    ours, scaled = (
        sweeps.branches(run(tmp_path, given, *scales), "clearance", most=4)
        for scales in ((), (rate, length))
    )
    assert ours.sizes["point"] > 100 and ours.attrs["summary"] == scaled.attrs["summary"]
    for name in ours.variables:
        back = in_units(name, scaled[name].values, 1.0 / rate, 1.0 / length)
        np.testing.assert_array_equal(ours[name].values, back)


def test_a_rig_has_the_bifurcations_of_its_model():
    """A row of the rig is that of the model with its three places converted."""
    axis, mass, given = "p", 4.06, one_axis("p", 5)
    rig = {own: np.array(of(mass, np.array(given[name]))).tolist()
           for name, (own, of) in RIG.items()}  # fmt: skip
    record = {"transient": 20, "periods": 64, "diagnostics": ["period"]}
    dataset = swept({"rig": {"mass": mass, **rig}, "record": record})
    model = sweeps.bifurcations(dataset, axis, most=6)
    found = sweeps.bifurcations(in_si(OpenedSweep(dataset)), RIG[axis][0], most=6)
    model[PLACES] = RIG[axis][1](mass, model[PLACES])
    pd.testing.assert_frame_equal(found, model, check_exact=False, rtol=1e-12)
    assert set(found["low"]) | set(found["high"]) <= set(rig[RIG[axis][0]])


def in_place_of_branches(other):
    """Return a `keep` of `find_bifurcations` that takes another function in place of `branches`."""
    return lambda find: other if find is sweeps.branches else find


def test_the_order_of_a_rig_is_that_of_its_model():
    """A change without a value is at the middle of its interval in p, not of that in N/m."""
    given = one_axis("p", 9) | {"p": [0.4, 1.2, 1.6]}
    rig = {own: np.array(of(0.5, np.array(given[name]))).tolist()
           for name, (own, of) in RIG.items()}  # fmt: skip
    record = {"transient": 100, "periods": 64, "diagnostics": ["period"]}
    dataset = swept({"rig": {"mass": 0.5, **rig}, "record": record})

    def kinds(sweep, axis, place):
        """Return the kinds of the rows, with all bifurcations of the branches at a place."""

        def moved(*arguments, **chosen):
            found = sweeps.branches(*arguments, **chosen)
            special = np.isin(found["kind"], ["flip", "fold", "graze"])
            return found.assign_coords({axis: found[axis].where(~special, place)})

        keep = in_place_of_branches(moved)
        return find_bifurcations(sweep, axis, keep=keep, most=2)["kind"].tolist()

    for p, expected in ((0.79, ["fold", "basin"]), (0.85, ["basin", "fold"])):
        assert kinds(OpenedSweep(dataset), "p", p)[:2] == expected  # the middle is 0.8
        assert kinds(in_si(OpenedSweep(dataset)), "stiffness", 0.5 * p * p)[:2] == expected


@pytest.mark.parametrize("end", [0, -1])
def test_a_bifurcation_at_an_end_of_the_axis_lies_on_it(end):
    """Where an exact value is beyond the axis by rounding."""
    omega = np.linspace(2.6, 2.7, 6)
    scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": omega.tolist(), "f": 1.0}}
    beyond = np.nextafter(omega[end], math.inf if end else 0.0)

    def moved(*given, **chosen):
        found = sweeps.branches(*given, **chosen)
        special = np.isin(found["kind"], ["flip", "fold", "graze"])
        return found.assign_coords(omega=found["omega"].where(~special, beyond))

    sweep, keep = OpenedSweep(swept(scene)), in_place_of_branches(moved)
    found = find_bifurcations(sweep, keep=keep, most=2)
    (row,) = found[found["value"] == omega[end]].itertuples()
    ends = omega[[0, 1]] if end == 0 else omega[[4, 5]]
    assert (row.kind, row.low, row.high) == ("flip", *ends)


def test_every_value_lies_between_its_neighbours(tmp_path):
    """Also if all points of unknown class lie before it, as before a fold of 3/2."""
    given = {
        "h": 0.0289383922862505, "R": 0.932745737148704, "clearance": 0.05485080185683319,
        "f": 1.0, "x0": -0.16065200877512686,
        "omega": np.linspace(2.495462248380246, 3.8991597630941346, 54).tolist(),
    }  # fmt: skip
    found = table(tmp_path, given, transient=10, most=1)
    known = found.dropna(subset="value")
    assert (known["low"] <= known["value"]).all() and (known["value"] <= known["high"]).all()
    (fold,) = known[known["kind"].eq("fold") & known["orbit"].eq("3/2")].itertuples()
    assert fold.value == pytest.approx(2.814377, abs=1e-6)
    assert (fold.before, fold.after, fold.between) == ("3/2", "?", 1)
    assert (fold.low, fold.high) == (given["omega"][11], given["omega"][13])
