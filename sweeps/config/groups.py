"""Declares the groups of a configuration as dataclasses: keys, defaults, allowed values.

The names, bounds and defaults of parameters come from ``vibroimpact.oscillator.PARAMETERS``.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Collection
from functools import partial
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    field_validator,
    model_validator,
)

from sweeps.config.values import (
    Axis,
    Elsewhere,
    Group,
    Integer,
    Number,
    Values,
    as_integer,
    form,
    integer_field,
    known_word,
    null,
)
from sweeps.text import fewest_digits, in_brackets, near_misses, suggestion
from vibroimpact.inputs import PHASE, integer, number_meant
from vibroimpact.oscillator import PARAMETERS, Parameter
from vibroimpact.step.scheme import (
    IMPACT_RULES,
    INTEGRATORS,
    MOST_PERIODS,
    MOST_RECORDED,
    MOST_STEPS,
)

#: Optional quantities of each point, in addition to those that are always recorded.
DIAGNOSTICS = ("period", "lyapunov", "extremes")

#: Longest transient that is found, if no other is given.
LONGEST_TRANSIENT = 10_000

#: The parameters of the start, which can be axes.
STARTS = ("x0", "v0", "phase")

#: Directions in which an axis can be followed.
DIRECTIONS = ("up", "down", "both")


def choice(meaning: str, table: Collection[str], default: str) -> Any:
    """Return the field of a key whose value is one of the names in a table."""
    text = f"{meaning}: {', '.join(table)}"
    return Field(default, description=text, json_schema_extra={"enum": [*table]})


def parameter_field(parameter: Parameter, note: str = "") -> Any:
    """Return the field of a parameter, described with a note, and with its bounds for editors."""
    text = (
        f"{parameter.meaning}{in_brackets(parameter.unit)}: {parameter.allowed}{note}; "
        "to sweep it, a list of such numbers, {start, stop, num or step, spacing: linear or log}, "
        "or a column of points"
    )
    return Field(
        ... if parameter.default is None else parameter.default,
        description=text,
        json_schema_extra=partial(_with_bounds, parameter),
    )


def number_schema(parameter: Parameter) -> dict[str, Any]:
    """Return the JSON schema of a number within the bounds of a parameter."""
    most = sys.float_info.max  # JSON has integers of any length
    least = "exclusiveMinimum" if parameter.low_open else "minimum"
    low, high = max(parameter.low, -most), min(parameter.high, most)
    return {"type": "number", least: low, "maximum": high}


def _with_bounds(parameter: Parameter, schema: dict[str, Any]) -> None:
    """Add the bounds of a parameter to the JSON schema of each form of its values."""
    bounds = number_schema(parameter)
    limits = {"properties": {"start": bounds, "stop": bounds}}
    number, values, extent = schema["oneOf"]
    schema["oneOf"] = [
        {**number, **bounds},
        {**values, "items": bounds, "uniqueItems": True},
        {**extent, **limits},
    ]


def refuse_out_of_bounds(axis: Axis, parameter: Parameter) -> None:
    """Refuse values outside the bounds of a parameter."""
    for value in sorted({axis.low, axis.high}):
        if not parameter.accepts(value):
            contains = f"contains {fewest_digits(value)}, which " if axis.swept else ""
            raise ValueError(f"{contains}is not allowed")


def _is_zero(value: object) -> bool:
    """Whether a number, a list or a range is 0 everywhere; the loader keeps numbers as text."""
    if isinstance(value, dict):
        return _is_zero(value.get("start")) and _is_zero(value.get("stop"))
    if isinstance(value, list | tuple):
        return len(value) > 0 and all(map(_is_zero, value))
    return number_meant(value) == 0.0


class ParameterConfig(Group):
    """Parameters out of ``PARAMETERS``: each a number, a list or a range, within its bounds."""

    #: The key of the force, and the key that makes it optional where it is not 0.
    FORCES: ClassVar[tuple[str, str] | None] = None

    @model_validator(mode="before")
    @classmethod
    def _without_force(cls, data: object) -> object:
        """Set the force to 0 where only the base or unbalance is given, and is not 0."""
        if cls.FORCES is None or not isinstance(data, dict) or cls.FORCES[0] in data:
            return data
        force, base = cls.FORCES
        return data if _is_zero(data.get(base, 0.0)) else {force: 0.0, **data}

    @field_validator("*")
    @classmethod
    def _in_range(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse values outside the bounds of their parameter."""
        if not isinstance(value, Elsewhere):
            refuse_out_of_bounds(Axis.of(value), PARAMETERS[str(info.field_name)])
        return value

    def axes(self) -> dict[str, Axis]:
        """Return the values that are given here by the names and in the units of the model."""
        return {name: Axis.of(value) for name, value in self.items()}


class OscillatorConfig(ParameterConfig):
    """The parameters of the oscillator."""

    FORCES = ("f", "a")

    h: Values = parameter_field(PARAMETERS["h"])
    R: Values = parameter_field(PARAMETERS["R"])
    omega: Values = parameter_field(PARAMETERS["omega"])
    f: Values = parameter_field(PARAMETERS["f"], ", required unless a is given and not 0")
    p: Values = parameter_field(PARAMETERS["p"])
    clearance: Values = parameter_field(PARAMETERS["clearance"])
    a: Values = parameter_field(PARAMETERS["a"])


class StartConfig(ParameterConfig):
    """The state at the start, and the phase of the force there."""

    x0: Values = parameter_field(PARAMETERS["x0"])
    v0: Values = parameter_field(PARAMETERS["v0"])
    phase: Values = parameter_field(PARAMETERS["phase"])


def _truth(value: object) -> bool:
    """Return a truth value, or what a text means, since the loader keeps every scalar as text."""
    words = {"true": True, "false": False}
    truth = words.get(value.lower()) if isinstance(value, str) else value
    if not isinstance(truth, bool):
        raise ValueError("is neither true nor false")
    return truth


def _nothing(value: object) -> object:
    """Return False for the text "false", and all else as it is."""
    return False if isinstance(value, str) and value.lower() == "false" else value


class MethodConfig(Group):
    """How the motion is computed."""

    integrator: Annotated[str, known_word(INTEGRATORS)] = choice(
        "integrator between impacts", INTEGRATORS, "exact"
    )
    impact: Annotated[str, known_word(IMPACT_RULES)] = choice(
        "rule for impacts", IMPACT_RULES, "exact"
    )
    steps_per_period: Annotated[
        Annotated[int, Field(ge=4, le=MOST_STEPS), BeforeValidator(as_integer)] | None,
        BeforeValidator(null),
    ] = Field(
        None,
        description=f"time steps per forcing period: {integer(4, MOST_STEPS).expected}, "
        "or null for as many as the method needs",
    )
    allow_unstable: Annotated[bool, BeforeValidator(_truth)] = Field(
        default=False,
        description="compute even if the step is too long for the integrator to be stable: "
        "true or false",
    )


class TrajectoryConfig(Group):
    """Which samples of the trajectory are recorded."""

    every: Integer = integer_field("time steps from one sample to the next", 1, MOST_PERIODS)


def _transient(value: object) -> int | str:
    """Return a number of periods, or the word auto."""
    if isinstance(value, str) and value == "auto":
        return value
    number = as_integer(value)
    if not 0 <= number <= MOST_PERIODS:
        raise ValueError("is not allowed")
    return number


class RecordConfig(Group):
    """Which results of each point are recorded."""

    transient: Annotated[int | Literal["auto"], BeforeValidator(_transient)] = Field(
        1000,
        json_schema_extra={
            "anyOf": [{"type": "integer", "minimum": 0, "maximum": MOST_PERIODS}, {"const": "auto"}]
        },
        description="forcing periods computed before anything is kept: "
        f"{integer(0, MOST_PERIODS).expected}, or auto for as many as each point needs to "
        "reach its orbit",
    )
    longest: Annotated[
        Annotated[int, Field(ge=1, le=MOST_PERIODS), BeforeValidator(as_integer)] | None,
        BeforeValidator(null),
    ] = Field(
        None,
        description="with transient: auto, the longest transient: "
        f"{integer(1, MOST_PERIODS).expected}; null for {LONGEST_TRANSIENT:,}",
    )
    periods: Integer = integer_field(
        "forcing periods kept, with one section each", 1, MOST_RECORDED, 100
    )
    phase: Number = Field(
        0.0,
        ge=0.0,
        lt=2.0 * math.pi,
        description=f"forcing phase omega t of the section [rad]: {PHASE.expected}",
    )
    impacts: Integer = integer_field("how many of the last impacts are kept", 0, MOST_RECORDED, 64)
    trajectory: Annotated[
        Annotated[Literal[False], BeforeValidator(_nothing), Tag("<scalar>")]
        | Annotated[TrajectoryConfig, Tag("<mapping>")],
        Discriminator(form),
    ] = Field(
        False, description="samples of the motion: false, or {every: k} to keep each k-th time step"
    )
    diagnostics: tuple[
        Annotated[str, known_word(DIAGNOSTICS), Field(json_schema_extra={"enum": [*DIAGNOSTICS]})],
        ...,
    ] = Field(
        ("period",),
        json_schema_extra={"uniqueItems": True},
        description="what else to compute of each point: a list of names out of "
        f"{', '.join(DIAGNOSTICS)}",
    )

    @field_validator("diagnostics")
    @classmethod
    def _each_once(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(names)) < len(names):
            raise ValueError("has a name twice")
        return names


def _followable(name: str) -> str:
    """Refuse a name that is not an axis that can be followed."""
    if name in STARTS:
        raise ValueError("is a start, but only the first point starts there")
    if name not in OscillatorConfig.model_fields:
        meant = suggestion(near_misses(name, OscillatorConfig.model_fields))
        raise ValueError(f"is unknown{meant}")
    return name


class FollowConfig(Group):
    """An axis along which each point starts from its neighbour's final state."""

    axis: Annotated[str, AfterValidator(_followable)] = Field(
        description="axis along which each point starts from its neighbour's final state: a swept "
        f"parameter out of {', '.join(OscillatorConfig.model_fields)}, or what the rig calls it",
        json_schema_extra={"enum": [*OscillatorConfig.model_fields]},
    )
    direction: Annotated[str, known_word(DIRECTIONS)] = choice(
        "values of the axis increasing (up), decreasing (down), or once each way", DIRECTIONS, "up"
    )

    @property
    def directions(self) -> tuple[str, ...]:
        """The directions of the sweeps along the axis, one after the other."""
        return ("up", "down") if self.direction == "both" else (self.direction,)


#: Units with which xarray converts numbers to differences of dates, and what to write instead.
_DATE_UNITS = {
    "nanoseconds": "ns", "microseconds": "us", "milliseconds": "ms", "seconds": "s",
    "minutes": "min", "hours": "h", "days": "d",
}  # fmt: skip


def _no_date(unit: str) -> str:
    """Refuse a unit with which other programs take numbers for differences of dates."""
    if unit in _DATE_UNITS:
        hint = suggestion([_DATE_UNITS[unit]])
        raise ValueError(f"is a unit with which xarray reads numbers as dates{hint}")
    return unit


def _unit(quantity: str) -> Any:
    """Return the field of a unit's name."""
    return Field(
        quantity,
        pattern=r"^[^\W\d_]{1,12}$",
        description=f"name of the unit of {quantity}: a word of at most 12 letters",
        json_schema_extra={
            "type": ["string", "boolean", "null"],  # the words true and null
            "not": {"enum": [*_DATE_UNITS]},
        },
    )


class UnitsConfig(Group):
    """Names of the units; no number is converted."""

    length: Annotated[str, AfterValidator(_no_date)] = _unit("length")
    time: Annotated[str, AfterValidator(_no_date)] = _unit("time")
    mass: Annotated[str, AfterValidator(_no_date)] = _unit("mass")


def key_list(group: type[Group]) -> str:
    """List the keys of a group, for a message."""
    return f"a mapping with keys among {', '.join(group.model_fields)}"
