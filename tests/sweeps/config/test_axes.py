"""Axes: what gives one, and their values, each the number nearest to the true one."""

import math
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from sweeps import load_config
from sweeps.config.values import Range
from sweeps.errors import ConfigError
from tests.helpers.configurations import load, oscillator_yaml, refusal

AXES = [
    pd.Series([2.5, 2.6]), pd.Index([2.5, 2.6]), xr.DataArray([2.5, 2.6], dims="omega"),
    np.array([2.5, 2.6]), (2.5, 2.6), np.array([2.5, 2.6], object),
]  # fmt: skip


@pytest.mark.parametrize("axis", AXES, ids=lambda axis: type(axis).__name__)
def test_an_axis_is_any_list_of_numbers(axis):
    config = load_config({"oscillator": {"h": 0.1, "R": 0.8, "omega": axis, "f": np.array(1.0)}})
    assert config.oscillator.omega == (2.5, 2.6) and config.oscillator.f == 1.0
    assert load_config({"oscillator": {"h": 0, "R": 1, "omega": range(1, 4), "f": 1}}).size == 3


@pytest.mark.parametrize(
    ("axis", "part"),
    [
        (range(10**9), "too many values; expected: at most 10,000,000"),
        (pd.Series([2.5, None]), "omega[1] = nan is not a finite number"),
        (np.array([1, 2], "m8[ns]"), "omega[0] = 1 nanoseconds is not a number"),
        (pd.Series(pd.to_datetime(["2020-01-01"])), "is not a number"),
        (np.ma.array([1.0, 2.0], mask=[0, 1]), "omega[1] = None is not a number"),
        (np.array([[1.0, 2.0]]), "omega[0] = [1.0, 2.0] is not a number"),
        ([10**5000], "omega[0] = an integer of 16,610 bits is not a finite number"),
        ([np.int64(-1), 2], "contains -1, which is not allowed"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_what_is_no_axis_is_refused(axis, part):
    with pytest.raises(ConfigError) as refusal:
        load_config({"oscillator": {"h": 0.1, "R": 0.8, "omega": axis, "f": 1.0}})
    assert part in str(refusal.value) and len(str(refusal.value)) < 600


@pytest.mark.parametrize("unit", ["seconds", "days", "microseconds"])
def test_a_unit_that_makes_dates_is_refused(unit):
    """Other programs convert numbers of such a unit to differences of dates."""
    text = oscillator_yaml() + f"units: {{time: {unit}}}\n"
    message = refusal(text)
    assert f"line 2: units.time = {unit} is a unit with which xarray reads numbers as" in message
    short = {"seconds": "s", "days": "d", "microseconds": "us"}[unit]
    assert f"(did you mean {short}?)" in message
    dates = xr.decode_cf(xr.Dataset({"t": ("t", [1.0], {"units": unit})}), decode_timedelta=True)
    assert dates["t"].dtype.kind == "m"
    assert load(text.replace(unit, "second")).units.time == "second"


def stepped(start, stop, step):
    omega = {"start": start, "stop": stop, "step": step}
    scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": omega, "f": 1.0}}
    config = load_config(scene)
    return config, config.sweep.grid.axes["omega"]


@pytest.mark.parametrize("step", ["0.1", "0.2", "0.01", "0.3", "0.7", "0.001", "0.05"])
def test_a_step_includes_the_stop_whatever_its_rounding(step):
    """np.arange has a value more or less than meant for many of these; Decimal has not."""
    for count in range(1, 60):
        last = Decimal(1) + count * Decimal(step)
        _, values = stepped(1.0, float(last), float(step))
        assert values.tolist() == [float(1 + i * Decimal(step)) for i in range(count + 1)]
        _, down = stepped(float(last), 1.0, -float(step))
        assert down.tolist() == values[::-1].tolist()
        added = 1.0
        for _ in range(count):
            added += float(step)  # as a program would, with its rounding
        _, values = stepped(1.0, added, float(step))
        assert len(values) == count + 1 and values[-1] == added


@pytest.mark.parametrize(
    ("stop", "last", "num"),
    [(2.0, 2.0, 11), (2.05, 2.0, 11), (2.0999, 2.0999, 12), (2.09989, 2.0, 11),
     (2.0001, 2.0001, 11), (2.00011, 2.0, 11), (2.1001, 2.1001, 12)],
)  # fmt: skip
def test_a_stop_within_a_thousandth_of_a_step_is_the_last_value(stop, last, num):
    _, values = stepped(1.0, stop, 0.1)
    assert (values[0], values[-1], len(values)) == (1.0, last, num)


def test_a_range_with_a_step_is_kept_as_its_number_of_values():
    config, values = stepped(2.4, 3.5, 0.01)
    again = load(config.to_yaml())
    assert "step:" not in config.to_yaml() and again.oscillator.omega.num == 111
    assert np.array_equal(again.sweep.grid.axes["omega"], values)
    text = oscillator_yaml(omega="{start: 2.4, stop: 3.5, step: 1e-2}")
    assert np.array_equal(load(text).sweep.grid.axes["omega"], values)
    assert load(text, "oscillator.omega.step=0.1").size == 12
    rig = {"mass": 2, "stiffness": 800, "damping": 1, "force": 1, "gap": 0, "R": 0.8}
    frequency = {"start": 2.0, "stop": 4.0, "step": 0.5}
    follow = {"axis": "frequency", "direction": "up"}
    assert load_config({"rig": {**rig, "frequency": frequency}, "follow": follow}).size == 5


@pytest.mark.parametrize(
    ("given", "part"),
    [
        ("{start: 1, stop: 2, step: 0.1, num: 3}", "has num and step, of which only one is"),
        ("{start: 1, stop: 2, step: 0}", "has step: 0, which leads nowhere"),
        ("{start: 2, stop: 1, step: 0.25}", "leads away from stop; did you mean step: -0.25?"),
        ("{start: 1, stop: 2, step: 1.1}", "has a step longer than the way from start to stop"),
        ("{start: 1, stop: 2, step: 1e-9}", "has 1,000,000,001 values, and at most 10,000,000"),
        ("{start: 0, stop: 1e300, step: 5e-324}", "has 2.00e+623 values, and at most 10,000,000"),
        ("{start: 1, stop: 2, step: 1, spacing: log}", "has a step and log spacing"),
        ("{start: 1, stop: 2, step: x}", "omega.step = x is not a number; expected: instead of"),
        ("{start: 1, step: 0.1}", "omega.stop is missing"),
        ("{start: 1, stop: 2}", "omega.num is missing; expected: number of values, unless step"),
        ("{start: -1, stop: 2, step: 1}", "contains -1, which is not allowed"),
    ],
)
def test_a_wrong_step_is_refused(given, part):
    message = refusal(oscillator_yaml(omega=given))
    assert part in message and "oscillator.omega" in message and "expected: " in message


def test_decades_of_a_log_axis_are_as_typed():
    decades = [float(f"1e{power}") for power in range(-300, 301)]
    for one in (decades, decades[::-1]):
        axis = Range(start=one[0], stop=one[-1], num=len(one), spacing="log")
        assert axis.values().tolist() == one


@pytest.mark.parametrize(
    ("start", "stop", "num"),
    [(0.3, 7.1, 40), (7.1, 0.3, 200), (5e-324, 1e308, 99), (5e-324, 1e-300, 9), (1 - 2**-53, 1, 5),
     (0.3, 7.1, 10_001)],
)  # fmt: skip
def test_a_log_axis_is_rounded_correctly(start, stop, num):
    """So its bits are the same everywhere: no other number is nearer to the geometric series."""
    values = Range(start=start, stop=stop, num=num, spacing="log").values().tolist()
    start, stop, last = Fraction(repr(start)), Fraction(repr(stop)), len(values) - 1
    for i in range(0, num, 1 + num // 500 * 100):  # all of few, some of many
        value = values[i]
        beside = [Fraction(math.nextafter(value, end)) for end in (0.0, math.inf)]
        low, high = ((Fraction(value) + other) / 2 for other in beside)
        assert low**last <= start ** (last - i) * stop**i <= high**last


ENDS = [(-0.3, 0.7), (1 / 3, math.pi), (0.0, 5e-324), (-1e-300, 1.0), (5.5e17, 2.5)]
ENDS += [(1e308, -1e308), (1 - 2**-53, 1.0)]


@pytest.mark.parametrize("num", [2, 10, 999, 40_000])
@pytest.mark.parametrize(("start", "stop"), ENDS)
def test_a_linear_axis_is_rounded_correctly(start, stop, num):
    """Few values, and more than are computed one by one; by rational numbers."""
    values = Range.model_construct(start=start, stop=stop, num=num, spacing="linear").values()
    assert (values[0], values[-1]) == (start, stop)
    first, rise = Fraction(repr(start)), Fraction(repr(stop)) - Fraction(repr(start))
    for i in range(0, num, max(1, num // 97)):
        assert values[i] == float(first + rise * i / (num - 1))


@pytest.mark.parametrize(
    ("text", "ends", "swept", "values"),
    [
        ("0.3", (0.3, 0.3, 0.3), False, [0.3]),
        ("[0.3]", (0.3, 0.3, 0.3), True, [0.3]),
        ("[0.5, 0.7, 0.25]", (0.25, 0.25, 0.7), True, [0.25, 0.5, 0.7]),
        ("[0.7, 0.5, 0.25]", (0.7, 0.25, 0.7), True, [0.7, 0.5, 0.25]),
        ("{start: 1, stop: 0, num: 3}", (1.0, 0.0, 1.0), True, [1.0, 0.5, 0.0]),
        ("{start: 1, stop: 1, num: 1}", (1.0, 1.0, 1.0), True, [1.0]),
    ],
)
def test_an_axis_has_the_values_of_every_form(text, ends, swept, values):
    axis = load(oscillator_yaml(R=text)).parameters()["R"]
    assert (axis.first, axis.low, axis.high) == ends
    assert (axis.size, axis.swept, axis.values().tolist()) == (len(values), swept, values)


def test_the_values_of_a_long_range_are_not_created_before_they_are_needed(monkeypatch):
    created = []
    values = Range.values
    monkeypatch.setattr(Range, "values", lambda self: created.append(self.num) or values(self))
    long = "{start: 1, stop: 2, num: 1e7}"
    for name in ("omega", "f", "p", "clearance"):
        assert load(oscillator_yaml(**{name: long})).parameters()[name].size == 10**7
    assert "beyond the stop" in refusal(oscillator_yaml() + f"start: {{x0: {long}}}\n")
    text = oscillator_yaml(f=long, R="{start: 0, stop: 1, num: 2e3}")
    assert "20,000,000,000 points" in refusal(text)
    assert not created
    config = load(oscillator_yaml(f="{start: 1, stop: 2, num: 7}"))
    assert config.size == 7 and created == [7]


RIG = "rig: {mass: 2, stiffness: 800, damping: 1, force: 10, frequency: 4, gap: 0, R: 1}\n"


@pytest.mark.parametrize(
    ("base", "key", "values"),
    [
        (oscillator_yaml(), "oscillator.omega", "{start: 2, stop: 2.000000000000001, num: 5}"),
        (oscillator_yaml(), "oscillator.h", "{start: 0, stop: 1e-323, num: 9}"),
        (oscillator_yaml(), "oscillator.f", "{start: 5e-324, stop: 1, num: 90000, spacing: log}"),
        (RIG, "rig.stiffness", "{start: 800, stop: 800.0000000000002, num: 3}"),
    ],
)
def test_values_that_are_one_floating_point_number_are_refused(base, key, values):
    """The file of the run could not be opened."""
    message = refusal(base, [f"{key}={values}"])
    assert key in message and "are the same floating-point number" in message
    assert "fewer values, or a wider range" in message


def test_neighbouring_floating_point_numbers_are_an_axis():
    config = load(oscillator_yaml(), "oscillator.omega={start: 2, stop: 2.000000000000001, num: 3}")
    assert len({*config.sweep.grid.axes["omega"]}) == 3
