"""The values of a configuration: numbers as typed, lists, ranges, and groups of keys."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Collection, Iterator
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

from sweeps.text import nearest, shortest, suggestion

#: The path to a value in the configuration, for example ("oscillator", "h", 2).
Key = tuple[str | int, ...]

#: A longer axis is a slip of the keyboard.
_MOST_VALUES = 10_000_000


class MisplacedError(ValueError):
    """A value that is wrong only beside another one; `key` is where to report it."""

    def __init__(self, key: Key, problem: str) -> None:
        super().__init__(problem)
        self.key = key


def plain_number(value: object) -> object:
    """Refuse what Python takes for a number beside numbers: 1_0 for 10, ١ for 1, and True for 1."""
    text = value if isinstance(value, str) else ""
    if isinstance(value, bool) or "_" in text or not text.isascii():
        raise ValueError("is not a number")
    if re.fullmatch(r"[+-]?\d*,\d+", text):
        raise ValueError("is not a number, which has a decimal point, no comma")
    return value


def plain_integer(value: object) -> object:
    """Refuse the same, and let pydantic read 1e3 as an integer, too."""
    value = plain_number(value)
    with contextlib.suppress(ValueError):
        return float(value) if isinstance(value, str) else value
    return value


def _distinct(values: tuple[float, ...]) -> tuple[float, ...]:
    """Refuse an empty list, and one that has a value twice."""
    if not values:
        raise ValueError("is empty")
    if len(set(values)) < len(values):
        twice = next(value for value in values if values.count(value) > 1)
        raise ValueError(f"has the value {shortest(twice)} twice")
    return values


def null(value: object) -> object:
    """Read null as YAML does: the loader leaves every scalar a text."""
    return None if isinstance(value, str) and value.lower() in ("null", "~") else value


def form(value: object) -> str:
    """Tell the forms of a value apart, so that an error speaks of the form that was meant."""
    if isinstance(value, (dict, BaseModel)):
        return "<mapping>"
    if isinstance(value, np.ndarray):
        return "<column>"
    return "<list>" if isinstance(value, (list, tuple)) else "<scalar>"


def one_of(table: Collection[str]) -> AfterValidator:
    """Refuse a name that is not in a table, and suggest one that is."""

    def _check(name: str) -> str:
        if name not in table:
            raise ValueError("is unknown" + suggestion(nearest(name, table)))
        return name

    return AfterValidator(_check)


def integer(meaning: str, low: int, high: int, default: Any = ...) -> Any:
    """Return a field for an integer from `low` to `high`; it must be given without a default."""
    text = f"{meaning}: an integer from {low} to {high}"
    return Field(default, ge=low, le=high, description=text)


class Group(BaseModel):
    """A mapping of the configuration, which remembers the order of its keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    _order: tuple[str, ...] = ()

    @model_validator(mode="wrap")
    @classmethod
    def _keep_order(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Remember the order in which the keys were given."""
        group = handler(data)
        if isinstance(data, dict):
            group._order = tuple(dict.fromkeys([*data, *cls.model_fields]))
        return group

    def items(self) -> Iterator[tuple[str, Any]]:
        """Yield names and values, the given ones first and in their order."""
        for name in self._order:
            yield name, getattr(self, name)


Number = Annotated[float, Field(allow_inf_nan=False), BeforeValidator(plain_number)]
Whole = Annotated[int, BeforeValidator(plain_integer)]


class Range(Group):
    """The values of an axis, from its first to its last."""

    start: Number = Field(description="first value: a finite number")
    stop: Number = Field(description="last value, included: a finite number")
    num: Whole = integer("number of values", 1, _MOST_VALUES)
    spacing: Literal["linear", "log"] = Field("linear", description="spacing: linear or log")

    @model_validator(mode="after")
    def _has_values(self) -> Self:
        """Refuse a range without values, and one that is too wide."""
        if self.spacing == "log" and min(self.start, self.stop) <= 0.0:
            raise ValueError("has log spacing, which needs start > 0 and stop > 0")
        if (self.num == 1) != (self.start == self.stop):
            needs = "be equal" if self.num == 1 else "differ"
            raise ValueError(f"has num: {self.num}, which needs start and stop to {needs}")
        if not math.isfinite(self.stop - self.start):
            raise ValueError("is too wide for a floating-point number")
        return self

    def values(self) -> np.ndarray:
        """Return the values, shape (num,), `start` and `stop` exactly among them."""
        space = np.geomspace if self.spacing == "log" else np.linspace
        low, high = sorted((self.start, self.stop))
        # Rounding may put a value next to an end on the wrong side of it.
        return np.clip(space(self.start, self.stop, self.num), low, high)


Values = Annotated[
    Annotated[Number, Tag("<scalar>")]
    | Annotated[
        tuple[Number, ...],
        # Not min_length, which counts the valid items only.
        AfterValidator(_distinct),
        Field(json_schema_extra={"minItems": 1}),
        Tag("<list>"),
    ]
    | Annotated[Range, Tag("<mapping>")]
    # Not typed here: a column of the table of ``points``.
    | Annotated[SkipJsonSchema[InstanceOf[np.ndarray]], Tag("<column>")],
    Discriminator(form),
]


#: The forms of a table, of which `sweeps.config.points.read_points` makes a structured array.
_COLUMNS = {"type": "object", "additionalProperties": {"type": "array", "minItems": 1}}
_FORMS = {"anyOf": [{"type": "string"}, _COLUMNS, {"type": "null"}]}
Table = Annotated[InstanceOf[np.ndarray] | None, BeforeValidator(null), WithJsonSchema(_FORMS)]


def extremes(value: float | tuple[float, ...] | Range | np.ndarray) -> tuple[float, ...]:
    """Return values among which are the least and the greatest."""
    if isinstance(value, Range):
        return value.start, value.stop
    if isinstance(value, np.ndarray):
        return float(value.min()), float(value.max())
    return value if isinstance(value, tuple) else (value,)


def as_array(value: float | tuple[float, ...] | Range | np.ndarray) -> np.ndarray:
    """Return every value in order, shape (n,)."""
    return value.values() if isinstance(value, Range) else np.atleast_1d(value)


def length(value: float | tuple[float, ...] | Range | np.ndarray) -> int:
    """Return the number of values along an axis, 1 for a column, without making them."""
    if isinstance(value, Range):
        return value.num
    return len(value) if isinstance(value, tuple) else 1
