"""The JSON schema of a configuration, for editors.

It accepts all that the loader accepts. What several keys decide together, only the loader refuses.
The schema also refuses a number in quotes, which the loader does not see.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from sweeps.config.groups import OscillatorConfig, ParameterConfig, number_schema
from sweeps.config.points import COLUMN_NAME
from sweeps.config.rig import RigConfig
from sweeps.config.sweep import SweepConfig
from vibroimpact.oscillator import PARAMETERS

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
        name: {"type": "array", "minItems": 1, "items": number_schema(one)}
        for name, one in PARAMETERS.items()
    },
}


def json_schema() -> JsonSchema:
    """Return the JSON schema of a configuration file, including the bounds of every number."""
    about = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": _SCHEMA_ID}
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
        asked = schema["$defs"][group.__name__].pop("required")
        required[name] = {"required": [key for key in asked if key not in (group.FORCES or ())]}
    table = {"required": ["points"], "properties": {"points": {"not": {"type": "null"}}}}
    whole = {"properties": required, "anyOf": [{"required": [name]} for name in groups]}
    return {**about, **schema, "if": table, "else": whole}


def dotted_keys() -> Iterator[str]:
    """Yield the keys of a configuration as ``--set`` takes them, with those of each range."""
    schema = json_schema()

    def below(part: JsonSchema, start: str) -> Iterator[str]:
        part = schema["$defs"][part["$ref"].rpartition("/")[2]] if "$ref" in part else part
        for name, inner in part.get("properties", {}).items():
            yield f"{start}{name}"
            yield from below(inner, f"{start}{name}.")
        for form in (*part.get("anyOf", ()), *part.get("oneOf", ())):
            yield from below(form, start)

    return below(schema, "")
