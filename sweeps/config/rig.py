"""`RigConfig` in SI units; `Nomenclature`: the names and units of parameters that a reader sees.

``QUANTITIES`` is the only place that converts; it agrees bit for bit with `Oscillator.from_rig`. A
file holds the names and numbers of the model; the configuration stored in it holds the rig. All
code computes with the parameters of the model. Where a user reads or types them, it asks the
`Nomenclature` of the sweep.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import Field, ValidationInfo, WrapValidator, field_validator

from sweeps.config.groups import (
    OscillatorConfig,
    ParameterConfig,
    number_schema,
    parameter_field,
    refuse_out_of_bounds,
)
from sweeps.config.values import Axis, ConflictError, Elsewhere, Number, Range, Values, ordered
from sweeps.errors import Refused
from sweeps.text import fewest_digits, in_units, listed
from vibroimpact.oscillator import PARAMETERS, Parameter


class Quantity(NamedTuple):
    """A quantity of the rig: its name, description and conversions, which also take the mass."""

    name: str
    description: Parameter
    in_si: Callable[[Any, Any], Any]
    in_model: Callable[[Any, Any], Any] = lambda mass, value: value


def _described(
    name: str, symbol: str, meaning: str, unit: str, default: float | None = None
) -> Parameter:
    """Describe a quantity of the rig, with the bounds of the parameter `name` of the model."""
    return replace(PARAMETERS[name], symbol=symbol, meaning=meaning, unit=unit, default=default)


#: The units of a rig.
SI_UNITS = {"length": "m", "time": "s", "mass": "kg"}
#: The mass, which no parameter of the model is made from alone.
MASS = _described("p", "m", "mass", "kg")
_TURN = 2.0 * math.pi
#: The parameters of the model that are made from the mass, too.
_PER_MASS = ("h", "p", "f")

#: The quantities of the rig, by the names of the model.
QUANTITIES: Mapping[str, Quantity] = {
    "h": Quantity(
        "damping", _described("h", "c", "viscous damping", "N s/m"),
        lambda mass, h: 2.0 * mass * h, lambda mass, c: c / (2.0 * mass),
    ),
    "omega": Quantity(
        "frequency", _described("omega", r"\nu", "forcing frequency", "Hz"),
        lambda mass, omega: omega / _TURN, lambda mass, nu: _TURN * nu,
    ),
    "f": Quantity(
        "force", _described("f", "F", "amplitude of the force", "N"),
        lambda mass, f: mass * f, lambda mass, force: force / mass,
    ),
    "p": Quantity(
        "stiffness", _described("p", "k", "stiffness of the spring", "N/m"),
        lambda mass, p: mass * p**2, lambda mass, k: np.sqrt(k / mass),
    ),
    "clearance": Quantity(
        "gap", _described("clearance", r"\sigma", "gap", "m"), lambda mass, gap: gap
    ),
    "a": Quantity(
        "base", _described("a", "a", "amplitude of the base", "m", 0.0), lambda mass, a: a
    ),
    "impulse": Quantity(
        "impulse", Parameter("J", "impulse on the stop per forcing period", "N s"),
        lambda mass, impulse: mass * impulse,
    ),
    "energy_lost": Quantity(
        "energy_lost", Parameter(r"E_\mathrm{i}", "energy lost at impacts per forcing period", "J"),
        lambda mass, energy: mass * energy,
    ),
}  # fmt: skip

#: The quantities of the rig that its configuration gives, by their own names.
RIG_PARAMETERS: Mapping[str, Parameter] = {
    "mass": MASS,
    **{each.name: each.description for key, each in QUANTITIES.items() if key in PARAMETERS},
}


def _number_or_column(value: object, checked: Callable[[object], float]) -> object:
    """Check a number; leave the mark of a column of a table as it is."""
    return value if isinstance(value, Elsewhere) else checked(value)


class RigConfig(ParameterConfig):
    """A rig in SI units, with the arguments of `Oscillator.from_rig`."""

    FORCES = ("force", "base")

    # The first field, because the checks of the others need it.
    mass: Annotated[Number, WrapValidator(_number_or_column)] = Field(
        description=f"mass [kg]: {MASS.allowed}, the same all over the sweep, or a column of "
        "points",
        json_schema_extra=number_schema(MASS),
    )
    stiffness: Values = parameter_field(QUANTITIES["p"].description)
    damping: Values = parameter_field(QUANTITIES["h"].description)
    force: Values = parameter_field(
        QUANTITIES["f"].description, ", required unless base is given and not 0"
    )
    frequency: Values = parameter_field(QUANTITIES["omega"].description)
    gap: Values = parameter_field(QUANTITIES["clearance"].description)
    R: Values = parameter_field(PARAMETERS["R"])
    base: Values = parameter_field(QUANTITIES["a"].description)

    @field_validator("*")
    @classmethod
    def _in_range(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse values outside the bounds of the parameter they are converted to."""
        title, mass = str(info.field_name), info.data.get("mass")
        if isinstance(value, Elsewhere):
            return value
        if title == "mass":
            refuse_out_of_bounds(Axis.of(value), MASS)
            return value
        name, axis = model_name(title), Axis.of(value)
        refuse_out_of_bounds(axis, PARAMETERS[name])
        if mass is None or isinstance(mass, Elsewhere):  # refused already, or a column
            return value
        model = _in_model(name, axis, mass)
        if isinstance(value, Range) and not (model.low < model.high < math.inf or model.size == 1):
            problem = f"is not a range in the units of the model: {model.low!r} to {model.high!r}"
            raise ConflictError(("rig", title), problem, "other values")
        if not math.isfinite(model.high):
            contains = f"contains {fewest_digits(axis.high)}, which " if axis.swept else ""
            raise ValueError(f"{contains}is not a finite number in the units of the model")
        refuse_out_of_bounds(model, PARAMETERS[name])
        if isinstance(value, tuple):
            ordered(tuple(model.values().tolist()))
        return value

    def axes(self) -> dict[str, Axis]:
        """Return the values that are given here by the names and in the units of the model."""
        axes = {model_name(name): Axis.of(value) for name, value in self.items() if name != "mass"}
        if self.mass_varies:  # these vary with it, and are columns of the table
            axes = {name: axis for name, axis in axes.items() if name not in _PER_MASS}
        return {name: _in_model(name, axis, self.mass) for name, axis in axes.items()}

    @property
    def mass_varies(self) -> bool:
        """Whether the mass is a column of the table."""
        return isinstance(self.mass, Elsewhere)

    def columns_in_model(self, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return the columns of the model made from those of the rig, by the names of the rig."""
        mass = columns["mass"] if self.mass_varies else self.mass
        result = {}
        for name, quantity in QUANTITIES.items():
            values = columns.get(quantity.name) if name in PARAMETERS else None
            if values is None and self.mass_varies and name in _PER_MASS and name not in columns:
                values = np.full(len(columns["mass"]), getattr(self, quantity.name))
            if values is not None:
                with np.errstate(over="ignore"):  # the caller refuses it
                    result[quantity.name] = np.asarray(quantity.in_model(mass, values), float)
        return result

    def in_si(self, name: str, value: Any, mass: Any = None) -> Any:
        """Convert a quantity of the model; what was made from a value of the rig gives that back.

        The formula alone gives it back up to rounding: 14.999999999999998 Hz for 15 Hz. A `mass`
        that is a column is given with the values.
        """
        quantity = QUANTITIES[name]
        if mass is not None and name in _PER_MASS:
            typed = getattr(self, quantity.name)
            is_number = not isinstance(typed, Elsewhere)
            return np.full_like(value, typed) if is_number else quantity.in_si(mass, value)
        converted = quantity.in_si(self.mass, value)
        typed = getattr(self, quantity.name, None)
        if typed is None or isinstance(typed, Elsewhere):  # a result, or a column of the model
            return converted
        values = Axis.of(typed).values()
        in_model = np.asarray(quantity.in_model(self.mass, values))
        order = np.argsort(in_model)
        after = np.searchsorted(in_model[order], value).clip(min=1)
        below, above = order[after - 1], order[after.clip(max=len(in_model) - 1)]
        nearest = np.where(in_model[above] - value < value - in_model[below], above, below)
        # Ranges of earlier versions were rounded several times.
        same = np.abs(in_model[nearest] - value) <= 4.0 * np.spacing(np.abs(value))
        return np.where(same, values[nearest], converted)[()]


def _in_model(name: str, axis: Axis, mass: float) -> Axis:
    """Convert values of a rig to the parameter `name` of the model."""
    if name not in QUANTITIES:
        return axis
    return axis.converted(partial(QUANTITIES[name].in_model, mass))


def derived_columns(columns: Collection[str], rig: Mapping[str, object]) -> set[str]:
    """Return the columns of the model that `columns_in_model` added to those of a table."""
    names = {key: each.name for key, each in QUANTITIES.items()}
    typed = {key for key, name in names.items() if name != key and name in columns}
    per_mass = {name for name in _PER_MASS if QUANTITIES[name].name in rig}
    return typed | (per_mass if "mass" in columns else set())


def model_name(name: str) -> str:
    """Return the model's name for a quantity of the rig; other names are returned unchanged."""
    return next((key for key, quantity in QUANTITIES.items() if quantity.name == name), name)


def with_rig(data: dict[str, Any]) -> dict[str, Any]:
    """Prepare the data of a configuration with a rig: its oscillator, and the followed axis."""
    if "oscillator" in data:
        first, second = (key for key in data if key in ("oscillator", "rig"))
        raise ConflictError((second,), f"conflicts with {first}", f"one of them, as {first}.R")
    data = {**data, "oscillator": dict.fromkeys(OscillatorConfig.model_fields, Elsewhere.RIG)}
    follow = data.get("follow")
    if isinstance(follow, dict) and isinstance(follow.get("axis"), str):
        data["follow"] = {**follow, "axis": model_name(follow["axis"])}
    return data


@dataclass(frozen=True)
class Nomenclature:
    """The names, units and numbers of the parameters: those of the model, or of a rig."""

    rig: RigConfig | None = None
    units: Mapping[str, str] = field(default_factory=dict)  # names of the units of length and time

    @property
    def group(self) -> str:
        """The group of a configuration that has the parameters."""
        return "oscillator" if self.rig is None else "rig"

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """All that a reader sees, by the reader's names."""
        if self.rig is None:
            return PARAMETERS
        return {"mass": MASS, **{self.name(name): self.about(name) for name in PARAMETERS}}

    def name(self, name: str) -> str:
        """Return the reader's name for a parameter of the model; others are left unchanged."""
        return name if self.rig is None or name not in QUANTITIES else QUANTITIES[name].name

    def parameter(self, name: str) -> str:
        """Return the parameter of the model that a reader calls so; others are left unchanged."""
        return name if self.rig is None else model_name(name)

    def about(self, name: str) -> Parameter:
        """Return the symbol, the meaning, the unit and the bounds of a parameter of the model."""
        is_own = self.rig is None or name not in QUANTITIES
        return PARAMETERS[name] if is_own else QUANTITIES[name].description

    def unit(self, unit: str) -> str:
        """Return a unit made of length and time with the names of both."""
        return in_units(unit, self.units)

    def value(self, name: str, values: Any) -> Any:
        """Convert values of a parameter of the model to the reader's unit."""
        if self.rig is None or name not in QUANTITIES:
            return values
        return self.rig.in_si(name, values)

    def in_model(self, name: str, values: Any) -> Any:
        """Convert values in the reader's unit to those of a parameter of the model."""
        if self.rig is None or name not in QUANTITIES:
            return values
        return QUANTITIES[name].in_model(self.rig.mass, values)

    def selection(self, at: Mapping[str, Any]) -> dict[str, Any]:
        """Convert values of parameters of the model by name, without texts, and their names."""
        selected = {
            self.name(name): value if isinstance(value, str) else self.value(name, value)
            for name, value in at.items()
        }
        if len(selected) < len(at):
            raise Refused(f"{listed(at)}: two of these are one axis; leave one of them out")
        return selected
