"""The values of ranges and lists, each the floating-point number nearest to the true one."""

import math
from decimal import Decimal, localcontext
from fractions import Fraction

import pytest

from sweeps.config.values import Range
from tests.helpers.configurations import load, oscillator_yaml, refusal


def test_decades_of_a_log_axis_are_as_typed():
    decades = [float(f"1e{power}") for power in range(-300, 301)]
    for one in (decades, decades[::-1]):
        axis = Range(start=one[0], stop=one[-1], num=len(one), spacing="log")
        assert axis.values().tolist() == one


@pytest.mark.parametrize(
    ("start", "stop", "num"), [(0.3, 7.1, 40), (7.1, 0.3, 200), (5e-324, 1e308, 99), (1e3, 1e-3, 7)]
)
def test_a_log_axis_is_rounded_correctly(start, stop, num):
    """So its bits are the same everywhere: no other number is nearer to the geometric series."""
    values = Range(start=start, stop=stop, num=num, spacing="log").values().tolist()
    start, stop, last = Fraction(repr(start)), Fraction(repr(stop)), len(values) - 1
    for i, value in enumerate(values):
        beside = [Fraction(math.nextafter(value, end)) for end in (0.0, math.inf)]
        low, high = ((Fraction(value) + other) / 2 for other in beside)
        assert low**last <= start ** (last - i) * stop**i <= high**last


ENDS = [(-0.3, 0.7), (1 / 3, math.pi), (0.0, 5e-324), (-1e-300, 1.0), (5.5e17, 2.5)]
ENDS += [(1e308, -1e308)]


@pytest.mark.parametrize("num", [2, 10, 999, 40_000])
@pytest.mark.parametrize(("start", "stop"), ENDS)
def test_a_linear_axis_is_rounded_correctly(start, stop, num):
    """Few values, and more than are computed one by one; by rational numbers."""
    values = Range.model_construct(start=start, stop=stop, num=num, spacing="linear").values()
    assert (values[0], values[-1]) == (start, stop)
    first, rise = Fraction(repr(start)), Fraction(repr(stop)) - Fraction(repr(start))
    for i in range(0, num, max(1, num // 97)):
        assert values[i] == float(first + rise * i / (num - 1))


@pytest.mark.parametrize("ends", [(0.3, 7.1), (1e300, 1e-300), (5e-324, 1.0), (1.0, 2.0)])
def test_many_values_of_a_log_axis_are_rounded_correctly(ends):
    """More values than are computed one by one, by 60 digits."""
    num, (start, stop) = 40_001, ends
    values = Range(start=start, stop=stop, num=num, spacing="log").values()
    assert (values[0], values[-1]) == (start, stop)
    with localcontext(prec=60):
        first = Decimal(repr(start))
        growth = (Decimal(repr(stop)) / first).ln() / (num - 1)
        for i in range(0, num, 401):
            assert values[i] == float(first * (i * growth).exp())


@pytest.mark.parametrize("spacing", ["linear", "log"])
def test_no_value_of_a_range_is_rounded_out_of_it(spacing):
    low = math.nextafter(1.0, 0.0)
    values = Range(start=low, stop=1.0, num=50, spacing=spacing).values()
    assert values.max() == 1.0 and values.min() == low


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
