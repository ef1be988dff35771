"""What may be given: the same answer and the same words at every door of both packages."""

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
import xarray as xr

import sweeps
from sweeps.cli import common
from sweeps.errors import Refused
from sweeps.plotting import Page
from sweeps.text import shown_bytes, shown_duration, shown_range
from tests.helpers.configurations import refusal
from vibroimpact import (
    Oscillator,
    bifurcation_curve,
    branch,
    inputs,
    integrate,
    one_impact_orbit,
    paper_procedure,
    periodic_orbit,
    simulate,
)

OSC = Oscillator(h=0.1, R=0.8, omega=2.3, f=1.0)
ORBIT = one_impact_orbit(OSC)
HUGE = 10**400
UNPRINTABLE = 10**5000


def test_words_that_are_equally_near_are_all_named_unless_they_are_many():
    names = ["orbit_x", "orbit_v", "orbit_distance", "impact_v", "impulse", "period"]
    for typed, meant in (
        ("imp", ["impact_v", "impulse"]),
        ("orbit", ["orbit_x", "orbit_v"]),
        ("Orbit_V", ["orbit_v"]),
        ("perod", ["period"]),
        ("fly", []),
    ):
        assert inputs.near_misses(typed, names) == meant
    assert inputs.near_misses("run-9", [f"run-{i}" for i in range(9)]) == []
    assert inputs.near_misses("run", []) == []
    assert inputs.near_misses("gapp", ["Gap", "gap", "h"]) == ["Gap", "gap"]
    assert inputs.suggestion(["a", "b"]) == " (did you mean a or b?)"


@pytest.mark.parametrize(
    ("shown", "value", "text"),
    [
        (shown_bytes, 12, "12 B"), (shown_bytes, 999_499, "999 kB"), (shown_bytes, 999_500, "1 MB"),
        (shown_bytes, 5e15, "5,000 TB"), (shown_duration, 86400.0 * 999.7, "1,000 days"),
        (shown_duration, 86400.0 * 12345.6, "12,346 days"), (shown_duration, 172_800, "2 days"),
        (shown_range, (1.000012345, 1.000022345), "1.0000123 .. 1.0000223"),
    ],
)  # fmt: skip
def test_sizes_and_times_have_no_powers_of_ten_and_ranges_the_digits_that_tell_them(
    shown, value, text
):
    assert shown(value) == text


@pytest.mark.parametrize(
    ("value", "number"),
    [
        (1, 1.0), (0.5, 0.5), (Fraction(1, 2), 0.5), (np.float32(0.5), 0.5), (np.int8(-3), -3.0),
        (np.array(0.5), 0.5), (xr.DataArray(0.5), 0.5), (HUGE, math.inf), (-HUGE, -math.inf),
        (True, None), (np.True_, None), ("1", None), (1j, None), (None, None), ([1.0], None),
        (np.array([0.5]), None), (np.timedelta64(5, "ns"), None), (np.array(5, "m8[ns]"), None),
        (np.ma.masked, None),
    ],
)  # fmt: skip
def test_what_is_a_number(value, number):
    assert inputs.real(value) == number
    assert inputs.is_number(value) == (number is not None and math.isfinite(number))


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("7", 7), ("-7", -7), ("1e3", 1000), (" 0.5 ", 0.5), ("1_0", None), ("١", None),
        ("0x10", None), ("", None), ("1,5", None), ("1e999", math.inf),
    ],
)  # fmt: skip
def test_what_a_text_means(text, number):
    assert inputs.number_meant(text) == number
    assert isinstance(inputs.number_meant(text), type(number))
    assert math.copysign(1.0, inputs.number_meant("-0.0")) == -1.0


DOORS = {
    "periods of simulate": lambda value: simulate(OSC, periods=value),
    "periods of integrate": lambda value: integrate(OSC.at(), periods=value),
    "m of an orbit": lambda value: periodic_orbit(OSC, 0.0, 1.0, m=value),
    "threads of a run": lambda value: sweeps.run_sweep("sweep.yaml", threads=value),
    "dpi": lambda value: Page(dpi=value),
    "periods of the paper's procedure": lambda value: paper_procedure(OSC, periods=value),
}


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize(
    ("value", "shown"),
    [(np.int64(-1), "-1"), (np.array(-1), "-1"), (-HUGE, "-1000"), (1.5, "1.5"), (True, "True"),
     (np.float64(0.5), "0.5"), ("7", "'7'"), (UNPRINTABLE, "an integer of 16,610 bits"),
     ([np.int64(1)], "[1]"), ([np.True_, np.str_("a"), np.float64(0.5)], "[True, 'a', 0.5]")],
    ids=lambda value: type(value).__name__,
)  # fmt: skip
def test_every_door_refuses_the_same_integers_in_the_same_words(door, value, shown):
    if value is UNPRINTABLE and door == "dpi":
        value = -UNPRINTABLE  # there is no greatest one
    with pytest.raises((ValueError, Refused)) as refused:
        DOORS[door](value)
    message = str(refused.value)
    assert f" = {shown}" in message and " is not allowed; expected: an integer " in message
    assert len(message) < 200


def test_the_words_of_a_configuration_and_of_an_option_are_the_same():
    allowed = "an integer from 1 to 1,000,000"
    text = "oscillator: {h: 0.1, R: 0.8, omega: 2, f: 1}\nrecord: {periods: 0}\n"
    assert refusal(text).endswith(allowed)
    with pytest.raises(Refused, match=f"^--most 0 is not allowed; expected: {allowed}$"):
        common.number_option("--most", inputs.integer(1, 1_000_000))("0")
    with pytest.raises(ValueError, match=f"^periods = 0 is not allowed; expected: {allowed}$"):
        simulate(OSC, periods=0)
    assert common.number_option("--most", inputs.integer(1))("1e3") == 1000


@pytest.mark.parametrize("text", ["omega=1_0", "omega=nan", "omega=1e999", "omega=١", "omega="])
def test_a_value_of_an_option_is_a_finite_number(text):
    with pytest.raises(Refused, match="is not allowed; expected: NAME=VALUE"):
        common.selection_of([text])
    with pytest.raises(Refused, match="is not allowed; expected: NAME=VALUE"):
        common.several_of([f"{text},2"])


@pytest.mark.parametrize("flag", ["at_section", "lyapunov"])
@pytest.mark.parametrize("value", ["False", "no", 1, None])
def test_a_truth_value_is_true_or_false(flag, value):
    with pytest.raises(ValueError, match=rf"^{flag} = .* expected: True or False$"):
        integrate(OSC.at(), **{flag: value})
    short = {"transient": 0, "periods": 1}
    assert ("lyapunov" in integrate(OSC.at(), **short, lyapunov=np.True_)) is True


def test_numbers_without_dimensions_are_numbers():
    of_arrays = Oscillator(h=np.array(0.1), R=xr.DataArray(0.8), omega=np.float64(2.3), f=1)
    assert of_arrays == OSC and type(of_arrays.h) is float
    assert simulate(OSC, periods=np.array(2)).t[-1] == simulate(OSC, periods=2).t[-1]
    with pytest.raises(TypeError, match=r"h .* = array\(\[0.1\]\) is not allowed"):
        Oscillator(h=np.array([0.1]), R=0.8, omega=2.3, f=1.0)


def test_a_branch_is_shown_on_one_line():
    found = branch(ORBIT, "omega", 2.2, 3.2)
    (flip,) = (point.value for point in found.special if point.kind == "flip")
    assert repr(found) == (
        f"<Branch 1/1: {len(found.values)} points, omega 2.2 to 3.2, edge at 2.2, flip at "
        f"{round(flip, 6)}, edge at 3.2>"
    )
    osc = Oscillator(h=0.02, R=0.6, omega=1.23, f=1.0)  # folds beyond both ends
    both = branch(periodic_orbit(osc, -0.7, -0.05, m=2), "omega", 1.0, 2.0)
    assert "omega 1.05877 to 1.26803, graze at 1.063299, fold" in repr(both)


SCENE = {"oscillator": {"h": 0.1, "R": 0.8, "omega": [2.5, 2.6], "f": 1.0}}
RIG = {"mass": 1, "stiffness": 1, "damping": 0.1, "frequency": 0.4, "gap": 0, "R": 0.5, "force": 1}
#: Public functions with right arguments, and the names of those that are replaced by wrong ones.
FUNCTIONS = [
    (Oscillator, {"h": 0.1, "R": 0.8, "omega": 2.3, "f": 1.0}, "h R omega f p clearance a"),
    (Oscillator.from_rig, RIG, " ".join([*RIG, "base"])),
    (OSC.to_rig, {}, "mass"),
    (OSC.at, {}, "x0 v0 phase"),
    (simulate, {"oscillator": OSC, "periods": 1},
     "oscillator periods integrator impact steps_per_period x0 v0 phase transient"),
    (integrate, {"points": OSC.at(), "periods": 1, "transient": 0},
     "points integrator impact steps_per_period transient periods phase at_section impacts "
     "lyapunov threads"),
    (one_impact_orbit, {"osc": OSC}, "osc n"),
    (periodic_orbit, {"osc": OSC, "x": 0.0, "v": 1.0}, "osc x v m phase"),
    (branch, {"orbit": ORBIT, "parameter": "omega", "low": 2.2, "high": 2.4},
     "orbit parameter low high"),
    (bifurcation_curve,
     {"orbit": ORBIT, "kind": "flip", "first": ("omega", 2, 3), "second": ("R", 0.5, 0.6)},
     "orbit kind first second"),
    (paper_procedure, {"oscillator": OSC, "periods": 1},
     "oscillator periods steps_per_period procedure"),
    (sweeps.run_sweep, {"config": "sweep.yaml"}, "threads overwrite resume progress client"),
    (Page, {}, "width height dpi title xlim ylim legend marks grey"),
    *((lambda group=group, **given: sweeps.load_config({**SCENE, group: given}), {}, names)
      for group, names in (
          ("record", "transient longest periods phase impacts trajectory diagnostics"),
          ("method", "integrator impact steps_per_period allow_unstable"),
          ("start", "x0 v0 phase"), ("units", "time length"), ("follow", "axis direction"))),
]  # fmt: skip
WRONG = [
    np.int64(-1), np.float64(np.nan), np.float64(-np.inf), -HUGE, HUGE, UNPRINTABLE, np.bool_(True),
    np.str_("x"), [np.int64(-1)], (np.float64(1.5),), {"a": np.int64(1)}, np.array([1, 2]), 1j,
    np.ma.masked, b"x", {1}, "x",
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("function", "given", "names"), FUNCTIONS, ids=lambda one: "")
def test_no_door_crashes_or_shows_a_type_of_numpy(function, given, names):
    """Every wrong value is refused by an error of the package, or of the argument."""
    refusals = 0
    for name, wrong in itertools.product(names.split(), WRONG):
        try:
            function(**{**given, name: wrong})
        except (ValueError, TypeError, Refused) as error:
            refusals += 1
            message = str(error)
            assert "np." not in message and "Exceeds the limit" not in message
            assert len(message) < 900
    assert refusals >= 0.6 * len(names.split()) * len(WRONG)
