"""The JSON schema of a configuration, for editors."""

from __future__ import annotations

from typing import Any

from sweeps.config.groups import OscillatorConfig
from sweeps.config.rig import RigConfig
from sweeps.config.sweep import SweepConfig

#: Identifier of the JSON schema, which is not an address: nothing is downloaded.
_SCHEMA_ID = "urn:vibroimpact:sweep-schema"


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of a configuration file, including the bounds of every number."""
    about = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": _SCHEMA_ID}
    schema = SweepConfig.model_json_schema()
    del schema["required"]
    # Required parameters may also be columns of a table, so they are required only without one.
    needed = {
        "oscillator": schema["$defs"]["OscillatorConfig"].pop("required"),
        "rig": schema["$defs"]["RigConfig"].pop("required"),
    }
    forces = {"oscillator": OscillatorConfig.FORCES, "rig": RigConfig.FORCES}
    grids = [
        {
            "required": [name],
            "properties": {
                name: {
                    "required": [key for key in keys if key not in forces[name]],
                    "anyOf": [
                        {"required": [forces[name][0]]},
                        {
                            "required": [forces[name][1]],
                            "properties": {forces[name][1]: {"not": {"const": 0}}},
                        },
                    ],
                }
            },
        }
        for name, keys in needed.items()
    ]
    follow = schema["$defs"]["FollowConfig"]["properties"]["axis"]
    follow["enum"] += [name for name in RigConfig.model_fields if name not in ("mass", "R")]
    one = {"not": {"required": ["oscillator", "rig"]}}
    return {**about, **schema, **one, "anyOf": [*grids, {"required": ["points"]}]}
