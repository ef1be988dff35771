"""The configuration of a sweep: what may be asked for, checked, as a `SweepConfig`.

The names, ranges and defaults of the parameters are those of ``vibroimpact.oscillator.PARAMETERS``.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import yaml
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    ModelWrapValidatorHandler,
    Tag,
    ValidationInfo,
    field_validator,
    model_validator,
)

from sweeps.grid import Grid
from vibroimpact.impacts import IMPACT_RULES
from vibroimpact.integrators import INTEGRATORS
from vibroimpact.oscillator import PARAMETERS

#: The path to a value in the configuration, for example ("oscillator", "h", 2).
Key = tuple[str | int, ...]

# Limits that turn a slip of the keyboard into a message instead of a lack of memory.
_MOST_VALUES = 10_000_000
_MOST_PERIODS = 1_000_000_000


class MisplacedError(ValueError):
    """A value that is wrong only beside another one; `key` is where to report it."""

    def __init__(self, key: Key, problem: str) -> None:
        super().__init__(problem)
        self.key = key


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise ValueError("is not a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    except ValueError:
        raise ValueError("is not a number") from None
    if not math.isfinite(number):
        raise ValueError("is not a finite number")
    return number


def _whole(value: object) -> int:
    number = _number(value)
    if not number.is_integer():
        raise ValueError("is not an integer")
    return int(number)


def _off(value: object) -> object:
    return False if isinstance(value, str) and value.lower() == "false" else value


def _form(value: object) -> str:
    """Tell the forms of a value apart, so that an error speaks of the form that was meant."""
    if isinstance(value, (dict, BaseModel)):
        return "<mapping>"
    return "<list>" if isinstance(value, (list, tuple)) else "<scalar>"


def _known(table: Mapping[str, object]) -> AfterValidator:
    def check(name: str) -> str:
        if name not in table:
            raise ValueError("is unknown" + nearest(name, table))
        return name

    return AfterValidator(check)


def nearest(name: str, valid: Iterable[str]) -> str:
    folded = {word.casefold(): word for word in valid}
    match = difflib.get_close_matches(name.casefold(), folded, n=1, cutoff=0.5)
    return f" (did you mean {folded[match[0]]}?)" if match else ""


def _integer(meaning: str, low: int, high: int, default: Any = ...) -> Any:
    text = f"{meaning}: an integer from {low} to {high}"
    return Field(default, ge=low, le=high, description=text)


def _choice(meaning: str, table: Mapping[str, object], default: str) -> Any:
    text = f"{meaning}: {', '.join(table)}"
    return Field(default, description=text, json_schema_extra={"enum": [*table]})


def _parameter(name: str) -> Any:
    parameter = PARAMETERS[name]
    text = (
        f"{parameter.meaning} [{parameter.unit}]: {parameter.allowed}; "
        "to sweep it, a list of such numbers or {start, stop, num, spacing: linear or log}"
    )
    return Field(... if parameter.default is None else parameter.default, description=text)


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


Number = Annotated[float, BeforeValidator(_number)]
Whole = Annotated[int, BeforeValidator(_whole)]


class Range(Section):
    """The values of an axis, from its first to its last."""

    start: Number = Field(description="first value: a finite number")
    stop: Number = Field(description="last value, included: a finite number")
    num: Whole = _integer("number of values", 1, _MOST_VALUES)
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
    | Annotated[tuple[Number, ...], Field(min_length=1), Tag("<list>")]
    | Annotated[Range, Tag("<mapping>")],
    Discriminator(_form),
]


def _extremes(value: float | tuple[float, ...] | Range) -> tuple[float, ...]:
    """Return values among which are the least and the greatest."""
    if isinstance(value, Range):
        return value.start, value.stop
    return value if isinstance(value, tuple) else (value,)


class _ParameterSection(Section):
    @field_validator("*")
    @classmethod
    def _in_range(cls, value: Any, info: ValidationInfo) -> Any:
        for number in _extremes(value):
            if not PARAMETERS[str(info.field_name)].accepts(number):
                contains = "" if isinstance(value, float) else f"contains {number:g}, which "
                raise ValueError(f"{contains}is not allowed")
        return value


class OscillatorSection(_ParameterSection):
    """The parameters of the oscillator."""

    h: Values = _parameter("h")
    R: Values = _parameter("R")
    omega: Values = _parameter("omega")
    f: Values = _parameter("f")
    p: Values = _parameter("p")
    clearance: Values = _parameter("clearance")


class StartSection(_ParameterSection):
    """The state at time 0."""

    x0: Values = _parameter("x0")
    v0: Values = _parameter("v0")


class MethodSection(Section):
    """How the motion is computed."""

    integrator: Annotated[str, _known(INTEGRATORS)] = _choice(
        "integrator between impacts", INTEGRATORS, "newmark"
    )
    impact: Annotated[str, _known(IMPACT_RULES)] = _choice(
        "rule for impacts", IMPACT_RULES, "reduced-step"
    )
    steps_per_period: Whole = _integer("time steps per forcing period", 4, 1_000_000, 100)


class Trajectory(Section):
    """Which samples of the motion are kept."""

    every: Whole = _integer("time steps from one sample to the next", 1, _MOST_PERIODS)


class RecordSection(Section):
    """What is kept of each point."""

    transient: Whole = _integer(
        "forcing periods computed before anything is kept", 0, _MOST_PERIODS, 200
    )
    periods: Whole = _integer("forcing periods kept, with one section each", 1, _MOST_PERIODS, 100)
    phase: Number = Field(
        0.0,
        ge=0.0,
        lt=2.0 * math.pi,
        description="forcing phase omega t of the section [rad]: a number >= 0 and < 2 pi",
    )
    impacts: Whole = _integer("how many of the last impacts are kept", 0, _MOST_PERIODS, 64)
    trajectory: Annotated[
        Annotated[Literal[False], BeforeValidator(_off), Tag("<scalar>")]
        | Annotated[Trajectory, Tag("<mapping>")],
        Discriminator(_form),
    ] = Field(
        False,
        description="samples of the motion: false, or {every: k} to keep each k-th time step",
    )


def key_list(section: type[Section]) -> str:
    """Say which keys a section has."""
    return f"a mapping with keys among {', '.join(section.model_fields)}"


def _section(meaning: str, section: type[Section], **default: Any) -> Any:
    return Field(description=f"{meaning}: {key_list(section)}", **default)


class SweepConfig(Section):
    """A sweep of the forced oscillator with impacts over a grid of its parameters."""

    name: str = Field(
        "sweep",
        pattern=r"^[^/\\\x00-\x1f]+$",
        description="name of the sweep: a text without slashes "
        "(default: the name of the configuration file)",
    )
    oscillator: OscillatorSection = _section("parameters of eq. (1)", OscillatorSection)
    start: StartSection = _section(
        "state at time 0",
        StartSection,
        default_factory=StartSection,
        validate_default=True,
    )
    method: MethodSection = _section("how to compute", MethodSection, default_factory=MethodSection)
    record: RecordSection = _section("what to keep", RecordSection, default_factory=RecordSection)
    output: Path = Field(
        Path("sweep.h5"), description="HDF5 file to write: a path (default: <name>.h5)"
    )

    @model_validator(mode="before")
    @classmethod
    def _output_from_name(cls, data: Any) -> Any:
        if isinstance(data, dict) and "name" in data and "output" not in data:
            return {**data, "output": f"{data['name']}.h5"}
        return data

    @field_validator("start")
    @classmethod
    def _before_stop(cls, start: StartSection, info: ValidationInfo) -> StartSection:
        if "oscillator" not in info.data:
            return start  # refused already
        x0 = max(_extremes(start.x0))
        clearance = min(_extremes(info.data["oscillator"].clearance))
        if x0 > clearance:
            given = "x0" in start.model_fields_set
            raise MisplacedError(
                ("start", "x0") if given else ("oscillator", "clearance"),
                f"x0 = {x0:g} lies beyond the stop at clearance = {clearance:g}; "
                "every x0 must be <= every clearance",
            )
        return start

    @cached_property
    def grid(self) -> Grid:
        """The swept axes, in the order of the file, and the fixed values."""
        axes: dict[str, np.ndarray] = {}
        fixed: dict[str, float] = {}
        for _, section in self.items():
            if isinstance(section, _ParameterSection):
                for name, value in section.items():
                    if isinstance(value, float):
                        fixed[name] = value
                    else:
                        axes[name] = value.values() if isinstance(value, Range) else np.array(value)
        return Grid(axes, fixed)

    def to_yaml(self) -> str:
        """Return the configuration with every default but without `output`, as YAML.

        Loading it gives the same sweep: the same values, and the axes in the same order.
        """
        plain = _plain(self)
        del plain["output"]
        return yaml.safe_dump(plain, sort_keys=False, default_flow_style=None, allow_unicode=True)


def _plain(value: Any) -> Any:
    if isinstance(value, Section):
        return {name: _plain(item) for name, item in value.items()}
    return list(value) if isinstance(value, tuple) else value


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of the configuration file."""
    return SweepConfig.model_json_schema()
