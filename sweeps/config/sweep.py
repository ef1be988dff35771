"""`SweepConfig`: the groups, the sweep that they describe, and their JSON schema.

The schema accepts all that the loader accepts. What several keys decide together, only the loader
refuses. The schema also refuses a number in quotes, which the loader does not see.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from pydantic import BeforeValidator, Field, model_validator

from sweeps.config.groups import (
    LONGEST_TRANSIENT,
    FollowConfig,
    MethodConfig,
    OscillatorConfig,
    ParameterConfig,
    RecordConfig,
    StartConfig,
    UnitsConfig,
    choice,
    key_list,
    number_schema,
)
from sweeps.config.points_table import COLUMN_NAME, in_model, with_columns
from sweeps.config.rig import RIG_PARAMETERS, Nomenclature, RigConfig, with_rig
from sweeps.config.values import Axis, Group, Table, known_word, null
from sweeps.grid import TABLE, Grid, Sweep
from sweeps.text import printable
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.points.stages import RunSpec

#: Compressions of a complete file.
COMPRESSIONS = ("none", "gzip")

# The characters that a name may not have, as a part of a regular expression.
_NOT_IN_A_NAME = r"/\\\x00-\x1f\x7f-\x9f"


def _checked_name(name: object) -> object:
    """Refuse a name with a character that is not allowed; say which."""
    if isinstance(name, str) and (wrong := re.search(rf"[{_NOT_IN_A_NAME}\ud800-\udfff]", name)):
        raise ValueError(f"has the character {wrong[0]!a}, which is not allowed")
    return name


def _group(meaning: str, group: type[Group]) -> Any:
    """Return the field of a group whose keys all have a default."""
    text = f"{meaning}: {key_list(group)}"
    return Field(default_factory=group, description=text)


class SweepConfig(Group):
    """A sweep of the forced oscillator with impacts, over a grid or a table of its parameters.

    Examples
    --------
    >>> config = sweeps.load_config(scene)  # of the example of `run_sweep`
    >>> config.oscillator.R, config.method.impact, config.size
    (0.8, 'exact', 20)
    """

    name: Annotated[str, BeforeValidator(_checked_name)] = Field(
        "sweep",
        min_length=1,
        json_schema_extra={"not": {"type": "string", "pattern": f"[{_NOT_IN_A_NAME}]"}},
        description="name of the sweep: a text without slashes and control characters "
        "(default: the name of the configuration file)",
    )
    points: Table = Field(
        None,
        description="table of the points, in place of lists and ranges: a CSV file with a header, "
        "relative to this one, or a mapping of columns, each a list; columns are named like "
        "parameters, with a rig also like its keys, and further ones are kept",
    )
    rig: Annotated[RigConfig | None, BeforeValidator(null)] = Field(
        None, description=f"a rig in SI units, in place of the oscillator: {key_list(RigConfig)}"
    )
    oscillator: OscillatorConfig = Field(
        description=f"parameters of eq. (1): {key_list(OscillatorConfig)}"
    )
    start: StartConfig = _group("how every motion starts", StartConfig)
    method: MethodConfig = _group("how to compute", MethodConfig)
    record: RecordConfig = _group("what to keep", RecordConfig)
    follow: Annotated[FollowConfig | None, BeforeValidator(null)] = Field(
        None,
        description="start each point along an axis from its neighbour's final state: "
        f"{key_list(FollowConfig)}, or null",
    )
    units: UnitsConfig = _group(
        "names of the units, for axes and attributes; no number is converted; with a rig always "
        "m, s and kg",
        UnitsConfig,
    )
    output: Path = Field(
        Path("sweep.h5"), description="HDF5 file to write: a path (default: <name>.h5)"
    )
    compression: Annotated[str, known_word(COMPRESSIONS)] = choice(
        "compression of the complete file", COMPRESSIONS, "none"
    )

    @model_validator(mode="before")
    @classmethod
    def _prepared(cls, data: Any) -> Any:
        """Name the output after the sweep, and mark what comes from a rig or a table."""
        if not isinstance(data, dict):
            return data
        if isinstance(data.get("name"), str) and null(data.get("output")) is None:
            data = {**data, "output": f"{data['name']}.h5"}
        data = data if null(data.get("rig")) is None else with_rig(data)
        return with_columns(data) if isinstance(data.get("points"), np.ndarray) else data

    def parameters(self) -> dict[str, Axis]:
        """Return the values of each parameter of the model, columns apart, in the file's order."""
        groups = [group for _, group in self.items() if isinstance(group, ParameterConfig)]
        return {name: axis for group in groups for name, axis in group.axes().items()}

    @property
    def nomenclature(self) -> Nomenclature:
        """The names, units and numbers of the parameters that a reader sees."""
        without = {"mass"} if self.rig is None else None  # only a rig needs its unit
        return Nomenclature(self.rig, self.units.model_dump(exclude=without))

    @cached_property
    def table(self) -> np.ndarray | None:
        """The columns of `points`, and those of the model made from columns of a rig."""
        return None if self.points is None else in_model(self.points, self.rig)

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the columns of `points`; none without a table."""
        return () if self.points is None else self.points.dtype.names or ()

    @property
    def column_units(self) -> dict[str, str]:
        """The units of the columns that a rig names."""
        quantities = {} if self.rig is None else RIG_PARAMETERS
        return {name: quantities[name].unit for name in self.columns if name in quantities}

    @cached_property
    def sweep(self) -> Sweep:
        """The points to compute, and what is computed of each."""
        axes = self.parameters()
        swept = {name: axis.values() for name, axis in axes.items() if axis.swept}
        fixed = {name: axis.first for name, axis in axes.items() if not axis.swept}
        grid = Grid(swept if self.table is None else {TABLE: self.table}, fixed)
        record, follow = self.record, self.follow
        longest = record.longest or LONGEST_TRANSIENT
        spec = RunSpec(
            **self.method.model_dump(exclude={"allow_unstable"}),
            transient=0 if record.transient == "auto" else record.transient,
            longest=longest if record.transient == "auto" else None,
            periods=record.periods,
            phase=record.phase,
            impacts=record.impacts,
            lyapunov="lyapunov" in record.diagnostics,
            period="period" in record.diagnostics,
            every=record.trajectory.every if record.trajectory else None,
            scaled=follow is None and grid.scales_with_f,
            followed=follow.axis if follow else None,
            directions=follow.directions if follow else (),
            extremes="extremes" in record.diagnostics,
        )
        return Sweep(grid, spec)

    @property
    def size(self) -> int:
        """Number of points to compute, counting each direction of a followed axis."""
        return self.sweep.size

    def to_yaml(self, *, table: bool = True, ascii: bool = False) -> str:
        """Return the configuration as YAML with all defaults, without the output.

        Loading it gives the same sweep: the same values and steps, and the axes in the same order.
        With ``table=False`` the table of points is left out. With ``ascii=True`` all other
        characters are escaped.

        Examples
        --------
        >>> config = sweeps.load_config(scene)  # of the example of `run_sweep`
        >>> print(config.to_yaml().splitlines()[0])
        oscillator:
        """
        plain = _for_yaml(self)
        del plain["output"]
        if not table:
            plain.pop("points", None)
        if self.rig is None:
            del plain["units"]["mass"]
        else:
            del plain["oscillator"]
        if self.units == UnitsConfig():
            del plain["units"]
        if self.follow is not None:
            plain["follow"]["axis"] = self.nomenclature.name(self.follow.axis)
        options: dict[str, Any] = {"sort_keys": False, "default_flow_style": None}
        text: str = yaml.safe_dump(plain, **options, allow_unicode=not ascii)
        # Escape control characters, which a terminal would obey; YAML reads both forms alike.
        return text if printable(text) == text else yaml.safe_dump(plain, **options)


def _for_yaml(value: Any) -> Any:
    """Convert a value to YAML's types: groups become mappings in the order of their keys."""
    if isinstance(value, Group):
        return {name: _for_yaml(item) for name, item in value.items()}
    if isinstance(value, np.ndarray):
        return {name: value[name].tolist() for name in value.dtype.names or ()}
    return list(value) if isinstance(value, tuple) else value


JsonSchema = dict[str, Any]

#: Identifier of the JSON schema, which is not an address: nothing is downloaded.
_SCHEMA_ID = "urn:vibroimpact:sweep-schema"
#: The types of what the loader reads as a text.
_SCALAR = ["string", "number", "boolean", "null"]
#: The further columns of a table hold any scalars, as texts too.
_COLUMNS: JsonSchema = {
    "type": "object",
    "propertyNames": {"pattern": COLUMN_NAME},
    "additionalProperties": {"type": "array", "minItems": 1, "items": {"type": _SCALAR}},
    "properties": {
        name: {"type": "array", "minItems": 1, "items": number_schema(parameter)}
        for name, parameter in PARAMETERS.items()
    },
}


def json_schema() -> JsonSchema:
    """Return the JSON schema of a configuration file, including the bounds of every number."""
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": _SCHEMA_ID}
    schema = SweepConfig.model_json_schema()
    of_range = schema["$defs"]["Range"]
    of_range["required"].remove("num")
    keys = of_range["properties"]
    described = {key: keys["step"][key] for key in ("title", "description")}
    keys["step"] = {**keys["start"], **described, "not": {"const": 0}}
    of_range["oneOf"] = [{"required": ["num"]}, {"required": ["step"]}]
    keys = schema["properties"]
    keys["points"]["anyOf"] = [{"type": "string", "minLength": 1}, _COLUMNS, {"type": "null"}]
    for name in ("name", "output"):
        keys[name]["type"] = _SCALAR
    axis = schema["$defs"]["FollowConfig"]["properties"]["axis"]
    axis["enum"] += [name for name in RigConfig.model_fields if name not in (*axis["enum"], "mass")]
    # A rig takes the place of the oscillator, a base that of a force, columns that of other keys.
    del schema["required"]
    groups: dict[str, type[ParameterConfig]] = {"oscillator": OscillatorConfig, "rig": RigConfig}
    required: JsonSchema = {}
    for name, group in groups.items():
        keys = schema["$defs"][group.__name__].pop("required")
        required[name] = {"required": [key for key in keys if key not in (group.FORCES or ())]}
    table = {"required": ["points"], "properties": {"points": {"not": {"type": "null"}}}}
    whole = {"properties": required, "anyOf": [{"required": [name]} for name in groups]}
    return {**head, **schema, "if": table, "else": whole}


def dotted_keys(deepest: int) -> list[str]:
    """Return the keys of a configuration as ``--set`` takes them, of at most so many names each."""
    schema = json_schema()

    def below(inner: JsonSchema, start: str) -> Iterator[str]:
        inner = schema["$defs"][inner["$ref"].rpartition("/")[2]] if "$ref" in inner else inner
        for name, value in inner.get("properties", {}).items():
            yield f"{start}{name}"
            yield from below(value, f"{start}{name}.")
        for form in (*inner.get("anyOf", ()), *inner.get("oneOf", ())):
            yield from below(form, start)

    return [key for key in below(schema, "") if key.count(".") < deepest]
