"""What a reader sees of the parameters of a sweep: their names, units and numbers.

They are those of the model or, in SI units, those of a rig. All code computes with the parameters
of the model. Where a user reads or types them, it asks the `Nomenclature` of the sweep.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from sweeps.config.rig import MASS, QUANTITIES, RigConfig, model_name
from sweeps.text import in_units
from vibroimpact.oscillator import PARAMETERS, Parameter


@dataclass(frozen=True)
class Nomenclature:
    """The names, units and numbers of the parameters: those of the model, or of a rig."""

    rig: RigConfig | None = None
    units: Mapping[str, str] = field(default_factory=dict)  # names of the units of length and time

    @property
    def in_si(self) -> bool:
        """Whether numbers are in SI units, as those of a rig."""
        return self.rig is not None

    @property
    def group(self) -> str:
        """The group of a configuration that has the parameters."""
        return "oscillator" if self.rig is None else "rig"

    @property
    def constants(self) -> dict[str, Any]:
        """What this group has besides the parameters."""
        return {} if self.rig is None else {"mass": self.rig.mass}

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """All that a reader sees, by the reader's names."""
        if self.rig is None:
            return PARAMETERS
        return {"mass": MASS, **{self.name(own): self.about(own) for own in PARAMETERS}}

    def name(self, own: str) -> str:
        """Return the reader's name for a parameter of the model; others are left unchanged."""
        return own if self.rig is None or own not in QUANTITIES else QUANTITIES[own].name

    def parameter(self, name: str) -> str:
        """Return the parameter of the model that a reader calls so; others are left unchanged."""
        return name if self.rig is None else model_name(name)

    def about(self, own: str) -> Parameter:
        """Return the symbol, the meaning, the unit and the bounds of a parameter of the model."""
        is_own = self.rig is None or own not in QUANTITIES
        return PARAMETERS[own] if is_own else QUANTITIES[own].description

    def unit(self, unit: str) -> str:
        """Return a unit made of length and time with the names of both."""
        return in_units(unit, self.units)

    def value(self, own: str, values: Any) -> Any:
        """Convert values of a parameter of the model to the reader's unit."""
        if self.rig is None or own not in QUANTITIES:
            return values
        return self.rig.in_si(own, values)

    def in_model(self, own: str, values: Any) -> Any:
        """Convert values in the reader's unit to those of a parameter of the model."""
        if self.rig is None or own not in QUANTITIES:
            return values
        return QUANTITIES[own].in_model(self.rig.mass, values)

    def selection(self, at: Mapping[str, Any]) -> dict[str, Any]:
        """Convert values of parameters of the model by name, without texts, and their names."""
        return {
            self.name(own): one if isinstance(one, str) else self.value(own, one)
            for own, one in at.items()
        }
