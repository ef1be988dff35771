"""Declares each `Variable` that a file can hold: dimensions, units, types, bytes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sweeps.grid import TABLE
from sweeps.text import UNNAMED, in_units
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.points.stages import RunSpec
from vibroimpact.status import Evidence, Status


@dataclass(frozen=True)
class Variable:
    """A variable of the file; unit, meaning and symbol are as for ``PARAMETERS``."""

    dimension: str | None  # the record dimension after the swept axes; None for a single value
    unit: str
    meaning: str
    symbol: str
    diagnostic: str | None = None  # the field of `RunSpec` it belongs to; None: always recorded
    dtype: str = "float64"

    @property
    def fill_value(self) -> np.generic:
        """The value of points that are not computed yet: NaN, or ``Status.PENDING`` (-1)."""
        floating = self.dtype.startswith("float")
        return np.dtype(self.dtype).type(np.nan if floating else Status.PENDING)


#: All variables that a file can hold, in their order in the file.
VARIABLES: Mapping[str, Variable] = {
    "poincare_x": Variable("section", "length", "displacement at the section", "x"),
    "poincare_v": Variable("section", "length/time", "velocity at the section", r"\dot{x}"),
    "impact_phase": Variable(
        "impact", "rad", "forcing phase at the impact", r"\omega t\ \mathrm{mod}\ 2\pi"),
    "impact_v": Variable("impact", "length/time", "speed before the impact", r"\dot{x}^{-}"),
    "trajectory_t": Variable("sample", "time", "time", "t"),
    "trajectory_x": Variable("sample", "length", "displacement", "x"),
    "trajectory_v": Variable("sample", "length/time", "velocity", r"\dot{x}"),
    "impacts_per_period": Variable(None, "1", "impacts per forcing period", r"n_\mathrm{i}"),
    "slowest_impact": Variable(
        None, "length/time", "speed before the slowest impact", r"\dot{x}^{-}_\mathrm{min}"),
    "fastest_impact": Variable(
        None, "length/time", "speed before the fastest impact", r"\dot{x}^{-}_\mathrm{max}"),
    "impulse": Variable(
        None, "length/time", "impulse on the stop per forcing period and mass", r"J"),
    "energy_lost": Variable(
        None, "length^2/time^2", "energy lost at impacts per forcing period and mass",
        r"E_\mathrm{i}"),
    "max_penetration": Variable(None, "length", "deepest penetration", r"\delta_\mathrm{max}"),
    "rest_fraction": Variable(None, "1", "fraction of time at rest", r"\tau_\mathrm{rest}"),
    "chatters": Variable(None, "1", "complete chatters", r"n_\mathrm{c}", None, "int64"),
    "near_grazes": Variable(None, "1", "near grazes", r"n_\mathrm{g}", None, "int64"),
    "period": Variable(
        None, "1", "forcing periods per repetition, 0: no class", "m", "period", "int64"),
    "period_impacts": Variable(None, "1", "impacts per repetition", "q", "period", "int64"),
    "transient": Variable(
        None, "1", "forcing periods before the record", r"n_\mathrm{t}", "longest", "int64"),
    "orbit_x": Variable(
        None, "length", "displacement of the orbit at the last section", r"x_\mathrm{o}", "period"),
    "orbit_v": Variable(
        None, "length/time", "velocity of the orbit at the last section", r"\dot{x}_\mathrm{o}",
        "period"),
    "orbit_distance": Variable(
        None, "1", "distance from the orbit at the last section, as a share of the record's size",
        "d", "period"),
    "class_evidence": Variable(None, "1", "evidence for the class", "", "period", "int8"),
    "lyapunov": Variable("exponent", "1/time", "Lyapunov exponent", r"\lambda", "lyapunov"),
    "x_min": Variable(None, "length", "least displacement", r"x_\mathrm{min}", "extremes"),
    "x_max": Variable(None, "length", "greatest displacement", r"x_\mathrm{max}", "extremes"),
    "status": Variable(None, "1", "what became of the point", "", None, "int8"),
}  # fmt: skip

#: The columns of the trajectories, whose lengths differ.
TRAJECTORIES = tuple(name for name, each in VARIABLES.items() if each.dimension == "sample")

#: The variables whose numbers stand for words, and these words.
FLAGS: Mapping[str, type[Evidence] | type[Status]] = {"class_evidence": Evidence, "status": Status}

#: The first dimension of a sweep followed up and down.
DIRECTION = "direction"

#: Attribute of a sweep over a table: the names of its columns.
COLUMN_NAMES = "columns"

#: The record dimensions and the meaning of their coordinates.
RECORDS: Mapping[str, str] = {
    "section": "number of the forcing period that ends at the section (auto: in the record)",
    "impact": "number of the impact among those kept",
    "sample": "number of the sample",
    "exponent": "number of the exponent, the larger first",
}
#: What a dimension means that is no parameter.
_MEANINGS = {**RECORDS, TABLE: "row of the table", DIRECTION: "way in which the axis was followed"}


def unit_in(attributes: Mapping[str, Any], unit: str) -> str:
    """Return a unit with the names that the attributes of a file give to length and time."""
    units = {key: str(attributes.get(f"{key}_unit", key)) for key in ("length", "time")}
    return in_units(unit, units)


def description_in(attributes: Mapping[str, Any], meaning: str, unit: str) -> dict[str, str]:
    """Return the attributes of numbers in a file, or of what is computed from it.

    A unit with a length or a time without a name is left out, as other programs would refuse it.
    """
    unit_text = unit_in(attributes, unit)
    return {"long_name": meaning} | ({} if UNNAMED.search(unit_text) else {"units": unit_text})


def attributes_of(
    name: str, attributes: Mapping[str, Any], column_units: Mapping[str, str] = {}
) -> dict[str, Any]:
    """Return what a file says of an axis, a parameter, a column, a record or a variable."""
    if entry := PARAMETERS.get(name) or VARIABLES.get(name):
        meaning, unit, symbol = entry.meaning, entry.unit, entry.symbol
    else:
        meaning, unit, symbol = _MEANINGS.get(name, name), column_units.get(name, "1"), ""
    attrs: dict[str, Any] = description_in(attributes, meaning, unit) | {"symbol": symbol}
    if name in FLAGS:
        attrs["flag_values"] = np.array(list(FLAGS[name]), VARIABLES[name].dtype)
        attrs["flag_meanings"] = " ".join(word.name.lower() for word in FLAGS[name])
    return attrs


def record_widths(spec: RunSpec, at_impacts: float = 0) -> dict[str, int]:
    """Return how many values of a point each variable of a file for `spec` holds.

    Trajectories have `at_impacts` samples at impacts in every period.
    """
    samples = 0
    if spec.every is not None:
        samples = spec.periods * spec.steps_per_period // spec.every + 1
        samples += math.ceil(at_impacts * spec.periods)
    widths = {
        None: 1,
        "section": spec.periods,
        "impact": spec.impacts,
        "sample": samples,
        "exponent": 2 * spec.lyapunov,
    }
    return {
        name: widths[variable.dimension]
        for name, variable in VARIABLES.items()
        if widths[variable.dimension]
        and (variable.diagnostic is None or getattr(spec, variable.diagnostic))
    }


def bytes_per_point(spec: RunSpec, at_impacts: float = 0) -> int:
    """Return the size in bytes of the results of one point, with the widths of `record_widths`."""
    widths = record_widths(spec, at_impacts)
    return sum(np.dtype(VARIABLES[name].dtype).itemsize * width for name, width in widths.items())
