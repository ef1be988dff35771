"""A rig in SI units in place of the model's parameters, and its quantities in pictures and tables.

``QUANTITIES`` is the only place that converts; it agrees bit for bit with `Oscillator.from_rig`. A
file holds the names and numbers of the model; the configuration stored in it holds the rig.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from pydantic import Field, ValidationError, ValidationInfo, field_validator

from sweeps.config.groups import UnitsConfig, parameter_field, refuse_out_of_bounds
from sweeps.config.values import Group, MisplacedError, Number, Range, Values
from vibroimpact.oscillator import PARAMETERS, Parameter


class Quantity(NamedTuple):
    """A quantity of the rig: its name, description and conversions, which also take the mass."""

    name: str
    description: Parameter
    in_si: Callable[[float, Any], Any]
    in_model: Callable[[float, Any], Any] = lambda mass, value: value


def _described(name: str, symbol: str, meaning: str, unit: str) -> Parameter:
    """Describe a quantity of the rig, with the bounds of the parameter `name` of the model."""
    return replace(PARAMETERS[name], symbol=symbol, meaning=meaning, unit=unit, default=None)


#: The mass, which no parameter of the model is made from alone.
MASS = _described("p", "m", "mass", "kg")
_TURN = 2.0 * math.pi

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
    "impulse": Quantity(
        "impulse", Parameter("J", "impulse on the stop per forcing period", "N s"),
        lambda mass, impulse: mass * impulse,
    ),
    "energy_lost": Quantity(
        "energy_lost", Parameter(r"E_\mathrm{i}", "energy lost at impacts per forcing period", "J"),
        lambda mass, energy: mass * energy,
    ),
}  # fmt: skip


class RigConfig(Group):
    """A rig in SI units, with the arguments of `Oscillator.from_rig`.

    Columns of a table hold values of the model, not of the rig.
    """

    mass: Annotated[Number, Field(gt=0.0)] = Field(
        description=f"mass [kg]: {MASS.allowed}, the same all over the sweep"
    )
    stiffness: Values = parameter_field(QUANTITIES["p"].description)
    damping: Values = parameter_field(QUANTITIES["h"].description)
    force: Values = parameter_field(QUANTITIES["f"].description)
    frequency: Values = parameter_field(QUANTITIES["omega"].description)
    gap: Values = parameter_field(QUANTITIES["clearance"].description)
    R: Values = parameter_field(PARAMETERS["R"])

    @field_validator("stiffness", "damping", "force", "frequency", "gap", "R")
    @classmethod
    def _in_range(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse values outside the bounds of the parameter they are converted to."""
        return refuse_out_of_bounds(value, PARAMETERS[model_name(str(info.field_name))])

    def in_si(self, name: str, value: Any) -> Any:
        """Convert a quantity of the model; what was made from a value of the rig gives that back.

        The formula alone gives it back up to rounding: 14.999999999999998 Hz for 15 Hz.
        """
        quantity = QUANTITIES[name]
        converted = quantity.in_si(self.mass, value)
        given = getattr(self, quantity.name, None)
        if given is None or isinstance(given, np.ndarray):  # a result, or a column of the model
            return converted
        given = np.atleast_1d(given.values() if isinstance(given, Range) else given)
        made = np.asarray(quantity.in_model(self.mass, given))
        order = np.argsort(made)
        nearest = order[np.searchsorted(made[order], value).clip(max=len(made) - 1)]
        return np.where(made[nearest] == value, given[nearest], converted)[()]

    def oscillator(self) -> dict[str, Any]:
        """Return the parameters of the model, in the order of the rig's keys."""
        return {
            model_name(name): _converted(self.mass, model_name(name), value)
            for name, value in self.items()
            if name != "mass"
        }


class _Converted(Range):
    """A range in the units of the model: the values of a range of the rig, each converted."""

    _given: tuple[float, str, Range]

    @classmethod
    def of(cls, mass: float, name: str, given: Range) -> Self:
        """Convert a range of the rig to the parameter `name` of the model; refuse an overflow."""
        si = QUANTITIES[name].name
        ends = {end: _converted(mass, name, getattr(given, end)) for end in ("start", "stop")}
        try:
            made = cls(**ends, num=given.num, spacing=given.spacing)
        except ValidationError:
            shown = f"{ends['start']!r} to {ends['stop']!r}"
            problem = f"is not a range in the units of the model: {shown}; expected: other values"
            raise MisplacedError(("rig", si), problem) from None
        made._given = mass, name, given
        return made

    def values(self) -> np.ndarray:
        """Return the values, shape (num,)."""
        mass, name, given = self._given
        converted: np.ndarray = QUANTITIES[name].in_model(mass, given.values())
        return converted


def _converted(mass: float, name: str, value: Any) -> Any:
    """Convert a value of the rig to the model's units; a list stays a list, a range a range."""
    if name not in QUANTITIES or isinstance(value, np.ndarray):  # columns are in model units
        return value
    if isinstance(value, Range):
        return _Converted.of(mass, name, value)
    if isinstance(value, tuple):
        return tuple(_converted(mass, name, item) for item in value)
    return float(QUANTITIES[name].in_model(mass, value))


def model_name(name: str) -> str:
    """Return the model's name for a quantity of the rig; other names are returned unchanged."""
    return next((own for own, quantity in QUANTITIES.items() if quantity.name == name), name)


def si_name(name: str, rig: RigConfig | None) -> str:
    """Return the rig's name for a parameter of the model; without a rig, the model's name."""
    return QUANTITIES[name].name if rig is not None and name in QUANTITIES else name


def parameter_of(name: str, rig: RigConfig | None) -> Parameter:
    """Return the symbol, unit and bounds of a parameter: the rig's, if there is one."""
    in_rig = rig is not None and name in QUANTITIES
    return QUANTITIES[name].description if in_rig else PARAMETERS[name]


def si_values(values: Mapping[str, Any], rig: RigConfig | None) -> dict[str, Any]:
    """Convert values of the model, by name, to names and units of the rig, if there is one."""
    return {
        si_name(name, rig): value
        if rig is None or name not in QUANTITIES or isinstance(value, str)
        else rig.in_si(name, value)
        for name, value in values.items()
    }


def checked_units(units: UnitsConfig, info: ValidationInfo) -> UnitsConfig:
    """Return the names of the units; refuse non-SI names for a rig, and mass without a rig."""
    if "rig" not in info.data:  # refused already
        return units
    rig, si = info.data["rig"], UnitsConfig(length="m", time="s", mass="kg")
    for name, unit in units.items():
        if rig is not None and unit not in (getattr(si, name), name):
            problem = f"{unit} is not the unit of a rig; expected: {getattr(si, name)}"
            raise MisplacedError(("units", name), problem)
    if rig is None and "mass" in units.model_fields_set:
        problem = "without a rig there is no mass; expected: rig in place of oscillator"
        raise MisplacedError(("units", "mass"), problem)
    return units if rig is None else si


def with_rig(data: dict[str, Any]) -> dict[str, Any]:
    """Prepare the data of a configuration with a rig: rename followed axes, and add columns."""
    if "oscillator" in data:
        problem = "conflicts with oscillator; expected: one of them"
        raise MisplacedError(("rig",), problem)
    data = {**data, "oscillator": {}}
    for group in ("follow", "refine"):
        given = data.get(group)
        if isinstance(given, dict) and isinstance(given.get("axis"), str):
            data[group] = {**given, "axis": model_name(given["axis"])}
    table, rig = data.get("points"), data["rig"]
    if isinstance(table, np.ndarray) and isinstance(rig, dict):
        data["rig"] = {**rig, **_columns(table, rig)}
    return data


def _columns(table: np.ndarray, rig: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Return the model's columns of a table by the rig's names; refuse conflicts with the rig."""
    names, columns = (
        {name: model_name(name) for name in RigConfig.model_fields},
        table.dtype.names or (),
    )
    for name, own in names.items():
        if name in columns and name != own:
            problem = f"cannot be a column with a rig; expected: {own}, in the unit of the model"
            raise MisplacedError(("points", name), problem)
        value = rig.get(name)
        if isinstance(value, list | tuple | dict) or (value is not None and own in columns):
            problem = "conflicts with points; expected: one number here, or only a column"
            raise MisplacedError(("rig", name), f"{problem} {own} of points")
    return {name: table[own] for name, own in names.items() if own in columns}
