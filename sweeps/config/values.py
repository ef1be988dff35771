"""Converts what was typed: numbers, lists, words, exact ranges (`Axis`); `Group` of keys.

The values of a range are the numbers nearest to those of the decimal numbers that were typed.

An `Axis` holds the values of a parameter that was given in any of the first three forms.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from decimal import Context, Decimal, localcontext
from enum import Enum
from fractions import Fraction
from itertools import accumulate, pairwise, repeat
from operator import mul
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    InstanceOf,
    ModelWrapValidatorHandler,
    Tag,
    WithJsonSchema,
    model_validator,
)
from pydantic.json_schema import SkipJsonSchema

from sweeps.text import fewest_digits, near_misses, suggestion
from vibroimpact.inputs import integer, number_meant

#: A stop is a value of a range if it lies within this share of a step.
_NEAR = Fraction(1, 1000)
#: Computes the values of a geometric series; after all its products 30 digits are still right.
_SERIES = Context(prec=40)
#: Makes powers of ten exact: 1e23 lies halfway between two floating-point numbers.
_ROUNDED = Context(prec=30)


def linear(start: float, stop: float, num: int) -> np.ndarray:
    """Return an arithmetic series, shape (num,); its ends are exactly `start` and `stop`."""
    first, last = Fraction(repr(start)), Fraction(repr(stop))
    step = (last - first) / max(num - 1, 1)
    scale = math.lcm(first.denominator, step.denominator)
    begin, rise = int(first * scale), int(step * scale)
    # The quotient of two integers is rounded once.
    return np.fromiter(((begin + i * rise) / scale for i in range(num)), float, num)


def steps_to(start: float, stop: float, step: float) -> tuple[float, int]:
    """Return the last value and the number of values from `start` in steps towards `stop`.

    The last value is `stop` if it lies within a thousandth of a step, so that rounding never
    decides whether it is included; otherwise the last one before it. The numbers are taken as the
    decimal ones that were typed. ValueError if no step leads from `start` towards `stop`.
    """
    first, end, rise = (Fraction(repr(value)) for value in (start, stop, step))
    if not rise:
        raise ValueError("has step: 0, which leads nowhere")
    steps = (end - first) / rise
    if steps < 0:
        raise ValueError(f"has a step that leads away from stop; did you mean step: {-step:.12g}?")
    last, whole = stop, round(steps)
    if abs(steps - whole) > _NEAR:
        whole = math.floor(steps)
        last = float(first + whole * rise)
    if not whole and steps:
        raise ValueError("has a step longer than the way from start to stop")
    return last, whole + 1


def geometric(start: float, stop: float, num: int) -> np.ndarray:
    """Return a geometric series, shape (num,); its ends are exactly `start` and `stop`."""
    with localcontext(_SERIES):  # the same bits on every machine
        first, last = Decimal(repr(start)), Decimal(repr(stop))
        ratio = ((last / first).ln() / max(num - 1, 1)).exp()
        series = accumulate(repeat(ratio, num - 1), mul, initial=first)
        return np.fromiter(map(float, map(_ROUNDED.plus, series)), float, num)


#: The path to a value in the configuration, for example ("oscillator", "h", 2).
Key = tuple[str | int, ...]

#: Most values along an axis; a longer one is surely a typing error.
MOST_VALUES = 10_000_000


class Elsewhere(Enum):
    """The value of a parameter whose numbers are given in another place than its own key."""

    COLUMN = "a column of points"
    RIG = "computed from the rig"


class ConflictError(ValueError):
    """A value that conflicts with another one: the `key` to report, and what is `expected`."""

    def __init__(self, key: Key, problem: str, expected: str = "") -> None:
        super().__init__(f"{problem}; expected: {expected}" if expected else problem)
        self.key = key


def as_number(value: object, *, kind: str = "a number") -> float:
    """Return a value, or what a text means, as a float; ValueError if it is no finite number."""
    if isinstance(value, str) and re.fullmatch(r"[+-]?\d*,\d+", value):
        raise ValueError("has a decimal comma; a number has a decimal point, no comma")
    number = number_meant(value)
    if number is None:
        raise ValueError(f"is not {kind}")
    if not math.isfinite(number):
        raise ValueError("is not a finite number")
    return float(number)


def as_integer(value: object) -> int:
    """Return a value, or what a text means, as an integer; 1e3 is one, too."""
    number = as_number(value, kind="an integer")
    if not number.is_integer():
        raise ValueError("is not an integer")
    return int(number)


def ordered(values: tuple[float, ...]) -> tuple[float, ...]:
    """Return the values of an axis, sorted unless they decrease; refuse none, and repeated ones.

    Pictures, and xarray's choice of the nearest value, need an axis in order.
    """
    if not values:
        raise ValueError("is empty")
    rising = sorted(values)
    for low, high in pairwise(rising):
        if low == high:
            raise ValueError(f"has the value {fewest_digits(low)} twice")
    return values if list(values) == rising[::-1] else tuple(rising)


def null(value: object) -> object:
    """Convert the texts "null" and "~" to None, since the loader keeps every scalar as text."""
    return None if isinstance(value, str) and value.lower() in ("null", "~") else value


def form(value: object) -> str:
    """Return a tag for the form of a value, so that errors refer to the form that was typed."""
    if isinstance(value, (dict, BaseModel)):
        return "<mapping>"
    if isinstance(value, Elsewhere):
        return "<elsewhere>"
    return "<list>" if isinstance(value, (list, tuple)) else "<scalar>"


def known_word(table: Collection[str]) -> AfterValidator:
    """Return a validator that refuses names outside a table and suggests a similar one."""

    def _check(name: str) -> str:
        if name not in table:
            raise ValueError("is unknown" + suggestion(near_misses(name, table)))
        return name

    return AfterValidator(_check)


def integer_field(meaning: str, low: int, high: int, default: Any = ...) -> Any:
    """Return a field for an integer from `low` to `high`; without a default it is required."""
    text = f"{meaning}: {integer(low, high).expected}"
    return Field(default, ge=low, le=high, description=text)


class Group(BaseModel):
    """A mapping of the configuration, which keeps the order of its keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    _order: tuple[str, ...] = ()

    @model_validator(mode="wrap")
    @classmethod
    def _keep_order(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Keep the order in which the keys were given."""
        group = handler(data)
        if isinstance(data, dict):
            group._order = tuple(dict.fromkeys([*data, *cls.model_fields]))
        return group

    def items(self) -> Iterator[tuple[str, Any]]:
        """Yield the keys that have a value here: first the given ones in their order."""
        for name in self._order:
            value = getattr(self, name)
            if value is not None and not isinstance(value, Elsewhere):
                yield name, value


Number = Annotated[float, BeforeValidator(as_number)]
Integer = Annotated[int, BeforeValidator(as_integer)]


class Range(Group):
    """The values of an axis, from the first to the last."""

    start: Number = Field(description="first value: a finite number")
    stop: Number = Field(description="last value, or with step a bound: a finite number")
    num: Integer = integer_field("number of values, unless step is given", 1, MOST_VALUES)
    spacing: Literal["linear", "log"] = Field("linear", description="spacing: linear or log")

    step: Number | None = Field(
        None, description="instead of num: a finite number other than 0, from value to value"
    )

    @model_validator(mode="before")
    @classmethod
    def _counted(cls, data: Any) -> Any:
        """Replace a step by the number of values, and the stop by the last of them."""
        if not isinstance(data, dict) or "step" not in data:
            return data
        if "num" in data:
            raise ValueError("has num and step, of which only one is allowed")
        if str(data.get("spacing", "linear")) == "log":
            raise ValueError("has a step and log spacing, which needs num instead")
        try:
            start, stop, step = (as_number(data[name]) for name in ("start", "stop", "step"))
        except (KeyError, ValueError):
            return {**data, "num": 1}  # what is missing or no number has an error of its own
        last, num = steps_to(start, stop, step)
        if num > MOST_VALUES:
            many = f"{num:,}" if num < 10**15 else f"{Decimal(num):.3g}"
            raise ValueError(f"has {many} values, and at most {MOST_VALUES:,} are allowed")
        return {**{key: data[key] for key in data if key != "step"}, "stop": last, "num": num}

    @model_validator(mode="after")
    def _has_values(self) -> Self:
        """Refuse a range that has no values or is too wide."""
        if self.spacing == "log" and min(self.start, self.stop) <= 0.0:
            raise ValueError("has log spacing, which needs start > 0 and stop > 0")
        if (self.num == 1) != (self.start == self.stop):
            needs = "be equal" if self.num == 1 else "differ"
            raise ValueError(f"has num: {self.num}, which needs start and stop to {needs}")
        if not math.isfinite(self.stop - self.start):
            raise ValueError("is too wide for a floating-point number")
        return self

    def values(self) -> np.ndarray:
        """Return the values, shape (num,); the first is exactly `start`, the last `stop`."""
        series = geometric if self.spacing == "log" else linear
        return series(self.start, self.stop, self.num)


Values = Annotated[
    Annotated[Number, Tag("<scalar>")]
    | Annotated[
        tuple[Number, ...],
        # min_length would count only the valid items.
        AfterValidator(ordered),
        Field(json_schema_extra={"minItems": 1}),
        Tag("<list>"),
    ]
    | Annotated[Range, Tag("<mapping>")]
    # Never typed by a user.
    | Annotated[SkipJsonSchema[InstanceOf[Elsewhere]], Tag("<elsewhere>")],
    Discriminator(form),
]


@dataclass(frozen=True, eq=False)
class Axis:
    """The values of a parameter, which are created only when asked for: there may be millions."""

    first: float
    low: float  # least value
    high: float  # greatest value
    size: int  # number of values
    swept: bool  # False for a single number; True also for a list or a range of one value
    spacing: str  # linear or log, as of a range
    values: Callable[[], np.ndarray]  # returns the values in order, shape (size,)

    @classmethod
    def of(cls, value: float | tuple[float, ...] | Range) -> Axis:
        """Return the values of a number, a list or a range."""
        if isinstance(value, Range):
            low, high = sorted((value.start, value.stop))
            return cls(value.start, low, high, value.num, True, value.spacing, value.values)
        numbers = value if isinstance(value, tuple) else (value,)
        extremes = numbers[0], min(numbers), max(numbers)
        return cls(*extremes, len(numbers), numbers is value, "linear", lambda: np.array(numbers))

    def converted(self, convert: Callable[[Any], Any]) -> Axis:
        """Return the axis of the converted values; `convert` must increase with the value."""
        first, low, high = (float(convert(end)) for end in (self.first, self.low, self.high))
        return replace(self, first=first, low=low, high=high, values=lambda: convert(self.values()))


#: A table, of which `read_points` makes an array; `json_schema` says what it may be in a file.
Table = Annotated[InstanceOf[np.ndarray] | None, BeforeValidator(null), WithJsonSchema({})]
