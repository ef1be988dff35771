"""The values of a configuration: numbers as typed, lists, ranges, and mappings of them."""

from __future__ import annotations

import difflib
import math
from collections.abc import Collection, Iterable, Iterator
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    ModelWrapValidatorHandler,
    Tag,
    model_validator,
)

#: The path to a value in the configuration, for example ("oscillator", "h", 2).
Key = tuple[str | int, ...]

#: A longer axis is a slip of the keyboard.
_MOST_VALUES = 10_000_000


class MisplacedError(ValueError):
    """A value that is wrong only beside another one; `key` is where to report it."""

    def __init__(self, key: Key, problem: str) -> None:
        super().__init__(problem)
        self.key = key


def number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise ValueError("is not a number")
    if isinstance(value, str) and "_" in value:  # Python reads 1_0 as 10
        raise ValueError("is not a number")
    try:
        result = float(value)
    except OverflowError:
        result = math.inf
    except ValueError:
        raise ValueError("is not a number") from None
    if not math.isfinite(result):
        raise ValueError("is not a finite number")
    return result


def whole(value: object) -> int:
    result = number(value)
    if not result.is_integer():
        raise ValueError("is not an integer")
    return int(result)


def off(value: object) -> object:
    return False if isinstance(value, str) and value.lower() == "false" else value


def boolean(value: object) -> bool:
    text = str(value).lower()
    if text not in ("true", "false"):
        raise ValueError("is neither true nor false")
    return text == "true"


def null(value: object) -> object:
    return None if isinstance(value, str) and value.lower() in ("null", "~") else value


def _not_empty(values: tuple[float, ...]) -> tuple[float, ...]:
    if not values:
        raise ValueError("is empty")
    return values


def form(value: object) -> str:
    """Tell the forms of a value apart, so that an error speaks of the form that was meant."""
    if isinstance(value, (dict, BaseModel)):
        return "<mapping>"
    return "<list>" if isinstance(value, (list, tuple)) else "<scalar>"


def known(table: Collection[str]) -> AfterValidator:
    def check(name: str) -> str:
        if name not in table:
            raise ValueError("is unknown" + suggestion(name, table))
        return name

    return AfterValidator(check)


def nearest(name: str, valid: Iterable[str]) -> str | None:
    """Return the valid word that may have been meant."""
    folded = {word.casefold(): word for word in valid}
    match = difflib.get_close_matches(name.casefold(), folded, n=1, cutoff=0.5)
    return folded[match[0]] if match else None


def suggestion(name: str, valid: Iterable[str]) -> str:
    word = nearest(name, valid)
    return f" (did you mean {word}?)" if word else ""


def shortest(value: float) -> str:
    """Write a number with as many digits as it needs: 7, not 7.0."""
    return repr(value).removesuffix(".0")


def integer(meaning: str, low: int, high: int, default: Any = ...) -> Any:
    text = f"{meaning}: an integer from {low} to {high}"
    return Field(default, ge=low, le=high, description=text)


class Section(BaseModel):
    """A mapping of the configuration, which remembers the order of its keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    _order: tuple[str, ...] = ()

    @model_validator(mode="wrap")
    @classmethod
    def _keep_order(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        section = handler(data)
        if isinstance(data, dict):
            section._order = tuple(dict.fromkeys([*data, *cls.model_fields]))
        return section

    def items(self) -> Iterator[tuple[str, Any]]:
        """Yield names and values, the given ones first and in their order."""
        for name in self._order:
            yield name, getattr(self, name)


Number = Annotated[float, BeforeValidator(number)]
Whole = Annotated[int, BeforeValidator(whole)]


class Range(Section):
    """The values of an axis, from its first to its last."""

    start: Number = Field(description="first value: a finite number")
    stop: Number = Field(description="last value, included: a finite number")
    num: Whole = integer("number of values", 1, _MOST_VALUES)
    spacing: Literal["linear", "log"] = Field("linear", description="spacing: linear or log")

    @model_validator(mode="after")
    def _has_values(self) -> Self:
        if self.spacing == "log" and min(self.start, self.stop) <= 0.0:
            raise ValueError("has log spacing, which needs start > 0 and stop > 0")
        if self.num == 1 and self.start != self.stop:
            raise ValueError("has num: 1, which needs start and stop to be equal")
        if not math.isfinite(self.stop - self.start):
            raise ValueError("is too wide for a floating-point number")
        return self

    def values(self) -> np.ndarray:
        """Return the values, `start` and `stop` exactly among them."""
        space = np.geomspace if self.spacing == "log" else np.linspace
        low, high = sorted((self.start, self.stop))
        # Rounding may put a value next to an end on the wrong side of it.
        return np.clip(space(self.start, self.stop, self.num), low, high)


Values = Annotated[
    Annotated[Number, Tag("<scalar>")]
    | Annotated[
        tuple[Number, ...],
        # Not min_length, which counts the valid items only.
        AfterValidator(_not_empty),
        Field(json_schema_extra={"minItems": 1}),
        Tag("<list>"),
    ]
    | Annotated[Range, Tag("<mapping>")],
    Discriminator(form),
]


def extremes(value: float | tuple[float, ...] | Range) -> tuple[float, ...]:
    """Return values among which are the least and the greatest."""
    if isinstance(value, Range):
        return value.start, value.stop
    return value if isinstance(value, tuple) else (value,)


def every(value: float | tuple[float, ...] | Range) -> np.ndarray:
    """Return every value, in order."""
    return value.values() if isinstance(value, Range) else np.atleast_1d(value)


def length(value: float | tuple[float, ...] | Range) -> int:
    """Return the number of values."""
    if isinstance(value, Range):
        return value.num
    return len(value) if isinstance(value, tuple) else 1
