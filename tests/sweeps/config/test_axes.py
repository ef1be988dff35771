"""The axes that Python gives: any list of numbers, sorted, with the numbers that were typed."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from sweeps import load_config, open_sweep, run_sweep
from sweeps.config.loading import stored_config
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
        (10**400, "is not a finite number"),
        ([10**5000], "omega[0] = an integer of 16,610 bits is not a finite number"),
        ([np.int64(-1), 2], "contains -1, which is not allowed"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_what_is_no_axis_is_refused(axis, part):
    with pytest.raises(ConfigError) as refusal:
        load_config({"oscillator": {"h": 0.1, "R": 0.8, "omega": axis, "f": 1.0}})
    assert part in str(refusal.value) and len(str(refusal.value)) < 600


def test_values_of_a_range_are_found_by_the_numbers_typed():
    """And the nearest one of a list in any order."""
    R = {"start": 0.1, "stop": 1, "num": 10}
    oscillator = {"h": 0.1, "R": R, "omega": [2.6, 2.4, 2.9, 2.5], "f": 1.0}
    record = {"transient": 5, "periods": 2}
    with open_sweep(run_sweep({"oscillator": oscillator, "record": record}, "out.h5")) as ds:
        for value in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0):
            assert ds.sel(R=value)["R"] == value
        assert ds.sel(omega=2.88, method="nearest")["omega"] == 2.9
        assert ds["omega"].values.tolist() == [2.4, 2.5, 2.6, 2.9]


@pytest.mark.parametrize("unit", ["seconds", "days", "microseconds"])
def test_a_unit_that_makes_dates_is_refused(unit):
    """Other programs convert numbers of such a unit to differences of dates."""
    text = oscillator_yaml() + f"units: {{time: {unit}}}\n"
    message = refusal(text)
    assert (
        f"line 2: units.time = {unit} is a unit with which xarray reads numbers as dates" in message
    )
    short = {"seconds": "s", "days": "d", "microseconds": "us"}[unit]
    assert f"(did you mean {short}?)" in message
    dates = xr.decode_cf(xr.Dataset({"t": ("t", [1.0], {"units": unit})}), decode_timedelta=True)
    assert dates["t"].dtype.kind == "m"
    assert stored_config(text, "its configuration", "sweep").units.time == short
    assert load(text.replace(unit, "second")).units.time == "second"


def test_an_integer_that_cannot_be_written_is_refused_in_every_place():
    scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": 2.0, "f": 1.0}}
    for given in ({"name": 10**5000}, {"record": {"periods": -(10**5000)}}, {"units": 10**5000}):
        with pytest.raises(ConfigError, match=r"= an integer of 16,610 bits is not .*; expected: "):
            load_config(scene | given)
