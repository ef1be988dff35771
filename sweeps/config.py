"""The configuration of a sweep: what may be asked for, checked, as a `SweepConfig`.

The names, ranges and defaults of the parameters are those of ``vibroimpact.oscillator.PARAMETERS``.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import yaml
from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    field_validator,
    model_validator,
)

from sweeps.grid import Grid
from sweeps.steps import refuse_unstable, worst_points
from sweeps.values import (
    Key,
    MisplacedError,
    Number,
    Section,
    Values,
    Whole,
    boolean,
    every,
    extremes,
    form,
    integer,
    known,
    length,
    null,
    number,
    off,
    shortest,
    whole,
)
from vibroimpact.attractors import MOST_STEPS, default_steps
from vibroimpact.impacts import IMPACT_RULES
from vibroimpact.integrators import INTEGRATORS
from vibroimpact.oscillator import PARAMETERS

#: How a complete file can be compressed.
COMPRESSIONS = ("none", "gzip")

#: What can be computed of each point beside what is always recorded.
DIAGNOSTICS = ("period", "lyapunov")

# Limits that turn a slip of the keyboard into a message instead of a lack of memory.
_MOST_POINTS = 1_000_000_000
_MOST_PERIODS = 1_000_000_000
_MOST_RECORDED = 1_000_000
_MOST_SAMPLES = 10_000_000


def _choice(meaning: str, table: Collection[str], default: str) -> Any:
    text = f"{meaning}: {', '.join(table)}"
    return Field(default, description=text, json_schema_extra={"enum": [*table]})


def _parameter(name: str) -> Any:
    parameter = PARAMETERS[name]
    unit = "" if parameter.unit == "1" else f" [{parameter.unit}]"
    text = (
        f"{parameter.meaning}{unit}: {parameter.allowed}; "
        "to sweep it, a list of such numbers or {start, stop, num, spacing: linear or log}"
    )
    return Field(... if parameter.default is None else parameter.default, description=text)


class _ParameterSection(Section):
    @field_validator("*")
    @classmethod
    def _in_range(cls, value: Any, info: ValidationInfo) -> Any:
        for extreme in extremes(value):
            if not PARAMETERS[str(info.field_name)].accepts(extreme):
                contains = (
                    "" if isinstance(value, float) else f"contains {shortest(extreme)}, which "
                )
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

    integrator: Annotated[str, known(INTEGRATORS)] = _choice(
        "integrator between impacts", INTEGRATORS, "exact"
    )
    impact: Annotated[str, known(IMPACT_RULES)] = _choice("rule for impacts", IMPACT_RULES, "exact")
    steps_per_period: Annotated[
        Annotated[int, Field(ge=4, le=MOST_STEPS), BeforeValidator(whole)] | None,
        BeforeValidator(null),
    ] = Field(
        None,
        description=f"time steps per forcing period: an integer from 4 to {MOST_STEPS}, "
        "or null for as many as the method needs",
    )
    accuracy: Annotated[
        Annotated[float, Field(ge=1e-13, lt=1.0), BeforeValidator(number)] | None,
        BeforeValidator(null),
    ] = Field(
        default=None,
        description="instead of the three above, the error of the section state that is allowed, "
        "relative to the motion: a number >= 1e-13 and < 1, or null; the engine then picks the "
        "cheapest method that a pilot run finds to reach it",
    )
    allow_unstable: Annotated[bool, BeforeValidator(boolean)] = Field(
        default=False,
        description="compute although the step is too long for the integrator to be stable: "
        "true or false",
    )

    @model_validator(mode="after")
    def _leaves_the_choice(self) -> Self:
        given = self.model_fields_set - {"accuracy"}
        if self.accuracy is not None and given:
            name = next(name for name in type(self).model_fields if name in given)
            raise MisplacedError(
                ("method", name),
                f"{name} is for the engine to choose where method.accuracy is given; expected: "
                "accuracy alone, or integrator, impact and steps_per_period without it",
            )
        return self

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.impact == "exact" and self.integrator != "exact":
            others = ", ".join(rule for rule in IMPACT_RULES if rule != "exact")
            raise MisplacedError(
                ("method", "integrator"),
                f"impact exact needs the integrator exact, not {self.integrator}; "
                f"expected: integrator exact, or one of the impact rules {others}",
            )
        return self


class Trajectory(Section):
    """Which samples of the motion are kept."""

    every: Whole = integer("time steps from one sample to the next", 1, _MOST_PERIODS)


class RecordSection(Section):
    """What is kept of each point."""

    transient: Whole = integer(
        "forcing periods computed before anything is kept", 0, _MOST_PERIODS, 200
    )
    periods: Whole = integer("forcing periods kept, with one section each", 1, _MOST_RECORDED, 100)
    phase: Number = Field(
        0.0,
        ge=0.0,
        lt=2.0 * math.pi,
        description="forcing phase omega t of the section [rad]: a number >= 0 and < 2 pi",
    )
    impacts: Whole = integer("how many of the last impacts are kept", 0, _MOST_RECORDED, 64)
    trajectory: Annotated[
        Annotated[Literal[False], BeforeValidator(off), Tag("<scalar>")]
        | Annotated[Trajectory, Tag("<mapping>")],
        Discriminator(form),
    ] = Field(
        False,
        description="samples of the motion: false, or {every: k} to keep each k-th time step",
    )
    diagnostics: tuple[
        Annotated[str, known(DIAGNOSTICS), Field(json_schema_extra={"enum": [*DIAGNOSTICS]})], ...
    ] = Field(
        (),
        description="what else to compute of each point: a list of names out of "
        f"{', '.join(DIAGNOSTICS)}",
    )

    @field_validator("diagnostics")
    @classmethod
    def _once(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(names)) < len(names):
            raise ValueError("has a name twice")
        return names


class RefineSection(Section):
    """Where points are added."""

    axis: Annotated[str, known(PARAMETERS)] = Field(
        description="the only swept axis, with its values in increasing order: one of "
        f"{', '.join(PARAMETERS)}"
    )
    around: Literal["changes"] = Field(
        "changes", description="where the class of the motion changes between neighbours: changes"
    )
    levels: Whole = integer("how often the interval of a change is halved", 1, 52)


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
    method: MethodSection = _section(
        "how to compute",
        MethodSection,
        default_factory=MethodSection,
        validate_default=True,
    )
    record: RecordSection = _section("what to keep", RecordSection, default_factory=RecordSection)
    refine: RefineSection | None = Field(
        None, description=f"points to add: {key_list(RefineSection)}"
    )
    output: Path = Field(
        Path("sweep.h5"), description="HDF5 file to write: a path (default: <name>.h5)"
    )
    compression: Annotated[str, known(COMPRESSIONS)] = _choice(
        "how the file is compressed when it is complete", COMPRESSIONS, "none"
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
        x0 = max(extremes(start.x0))
        clearance = min(extremes(info.data["oscillator"].clearance))
        if x0 > clearance:
            given = "x0" in start.model_fields_set
            raise MisplacedError(
                ("start", "x0") if given else ("oscillator", "clearance"),
                f"x0 = {shortest(x0)} lies beyond the stop at clearance = {shortest(clearance)}; "
                "every x0 must be <= every clearance",
            )
        return start

    @field_validator("start")
    @classmethod
    def _not_too_many(cls, start: StartSection, info: ValidationInfo) -> StartSection:
        if "oscillator" in info.data:
            sections = {"oscillator": info.data["oscillator"], "start": start}
            lengths: dict[Key, int] = {
                (title, name): length(value)
                for title, section in sections.items()
                for name, value in section.items()
            }
            points = math.prod(lengths.values())
            if points > _MOST_POINTS:
                raise MisplacedError(
                    max(lengths, key=lambda key: lengths[key]),
                    f"the axes make a grid of {points:,} points; "
                    f"expected: at most {_MOST_POINTS:,}",
                )
        return start

    @field_validator("method")
    @classmethod
    def _enough_steps(cls, method: MethodSection, info: ValidationInfo) -> MethodSection:
        if "oscillator" not in info.data:
            return method
        steps = method.steps_per_period
        try:
            chosen = _default_steps(info.data["oscillator"], method)
        except ValueError as error:
            raise MisplacedError(("oscillator", "omega"), str(error)) from None
        if steps is not None and method.impact == "exact" and steps < chosen:
            raise MisplacedError(
                ("method", "steps_per_period"),
                f"{steps} are not enough for exact impacts here; "
                f"expected: an integer from {chosen} to {MOST_STEPS}, or null",
            )
        if not method.allow_unstable:
            points = _worst_points(info.data["oscillator"], method)
            refuse_unstable(method.integrator, steps or chosen, points)
        return method

    @field_validator("record")
    @classmethod
    def _can_be_recorded(cls, record: RecordSection, info: ValidationInfo) -> RecordSection:
        if "oscillator" not in info.data or "method" not in info.data:
            return record
        method = info.data["method"]
        if "lyapunov" in record.diagnostics and method.impact != "exact":
            raise MisplacedError(
                ("record", "diagnostics"),
                f"lyapunov needs the impact rule exact, not {method.impact}; "
                "expected: method.impact: exact, or diagnostics without lyapunov",
            )
        steps = method.steps_per_period or _default_steps(info.data["oscillator"], method)
        samples = _samples(record, int(steps))
        if samples > _MOST_SAMPLES:
            raise MisplacedError(
                ("record", "trajectory"),
                f"{samples:,} samples per point are too many; expected: at most {_MOST_SAMPLES:,}",
            )
        return record

    @model_validator(mode="after")
    def _can_be_refined(self) -> Self:
        if self.refine is not None:
            refuse_refinement(self)
        return self

    @cached_property
    def steps(self) -> int:
        """Steps per forcing period, the same all over the grid."""
        return self.method.steps_per_period or _default_steps(self.oscillator, self.method)

    @cached_property
    def widths(self) -> dict[str, int]:
        """The width of each record of a point; that of ``sample`` without the impacts."""
        return {
            "section": self.record.periods,
            "impact": self.record.impacts,
            "sample": _samples(self.record, self.steps),
        }

    def with_method(self, method: MethodSection) -> Self:
        """Return this sweep computed in another way.

        Raises
        ------
        ValueError
            If it would be refused had it been typed so.
        """
        return type(self).model_validate({**dict(self.items()), "method": method})

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
                        axes[name] = every(value)
        return Grid(axes, fixed)

    def to_yaml(self) -> str:
        """Return the configuration with every default but without where and how it is stored.

        Loading it gives the same sweep: the same values and steps, and the axes in the same order.
        """
        plain = _plain(self)
        del plain["output"], plain["compression"]
        if self.refine is None:
            del plain["refine"]
        if self.method.accuracy is not None:
            plain["method"] = {"accuracy": self.method.accuracy}
        else:
            del plain["method"]["accuracy"]
            plain["method"]["steps_per_period"] = self.steps
        return yaml.safe_dump(plain, sort_keys=False, default_flow_style=None, allow_unicode=True)


def refuse_refinement(config: SweepConfig) -> None:
    """Refuse to refine where that is not possible.

    Raises
    ------
    MisplacedError
        Says what is missing.
    """
    assert config.refine is not None
    axis, axes, record = config.refine.axis, config.grid.axes, config.record
    if list(axes) != [axis]:
        swept = ", ".join(axes) or "none"
        raise MisplacedError(
            ("refine", "axis"),
            f"{axis} must be the only swept axis; swept here: {swept}; expected: "
            f"one axis, and refine.axis naming it",
        )
    if not (np.diff(axes[axis]) > 0.0).all() or len(axes[axis]) < 2:
        raise MisplacedError(
            ("refine", "axis"), f"{axis} must have two or more values, in increasing order"
        )
    if config.method.impact != "exact" or config.method.accuracy is not None:
        raise MisplacedError(
            ("refine",),
            "orbits are followed with exact impacts only; expected: method.impact: exact, or no "
            "refine",
        )
    if "period" not in record.diagnostics:
        raise MisplacedError(
            ("refine",),
            "the class of the motion is needed; expected: record.diagnostics: [period] or "
            "[period, lyapunov], or no refine",
        )
    if record.trajectory:
        raise MisplacedError(
            ("record", "trajectory"),
            "trajectories are not kept of the points that refine adds; expected: false, or no "
            "refine",
        )


def _worst_points(oscillator: OscillatorSection, method: MethodSection) -> np.ndarray:
    """Return the points of the grid that need the most steps per period."""
    return worst_points(
        method.integrator,
        h=every(oscillator.h),
        p=np.array(extremes(oscillator.p)),
        omega=min(extremes(oscillator.omega)),
    )


def _default_steps(oscillator: OscillatorSection, method: MethodSection) -> int:
    """Return the steps per period that the method needs all over the grid."""
    return default_steps(_worst_points(oscillator, method), method.impact, method.integrator)


def _samples(record: RecordSection, steps: int) -> int:
    return record.periods * steps // record.trajectory.every + 1 if record.trajectory else 0


def _plain(value: Any) -> Any:
    if isinstance(value, Section):
        return {name: _plain(item) for name, item in value.items()}
    return list(value) if isinstance(value, tuple) else value


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of the configuration file."""
    return SweepConfig.model_json_schema()
