"""The JSON schema of a configuration, for editors.

It refuses what the loader refuses, except what needs a comparison of two numbers, a computation or
a file. It also refuses a number in quotes, which the loader does not see.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from sweeps.config.groups import OscillatorConfig, ParameterConfig, StartConfig, number_schema
from sweeps.config.points import COLUMN_NAME
from sweeps.config.rig import QUANTITIES, RIG_PARAMETERS, SI_UNITS, RigConfig
from sweeps.config.sweep import SweepConfig
from vibroimpact.oscillator import PARAMETERS, Parameter

JsonSchema = dict[str, Any]

#: Identifier of the JSON schema, which is not an address: nothing is downloaded.
_SCHEMA_ID = "urn:vibroimpact:sweep-schema"


def json_schema() -> JsonSchema:
    """Return the JSON schema of a configuration file, including the bounds of every number."""
    about = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": _SCHEMA_ID}
    schema = SweepConfig.model_json_schema()
    # A rig replaces the oscillator, and columns of a table replace required parameters.
    del schema["required"]
    required = {group: schema["$defs"][group.__name__].pop("required") for group in _GROUPS}
    positive = {end: {"exclusiveMinimum": 0} for end in ("start", "stop")}
    of_range = schema["$defs"]["Range"]
    of_range["required"].remove("num")
    own = of_range["properties"]
    about_step = {key: own["step"][key] for key in ("title", "description")}
    own["step"] = {**own["start"], **about_step, **_not({"const": 0})}
    of_range["oneOf"] = [{"required": ["num"]}, {"required": ["step"]}]
    without_step = {"properties": {**positive, "step": False}}
    of_range |= _if(_with(spacing={"const": "log"}), without_step)
    keys = schema["properties"]
    keys["points"]["anyOf"] = [{"type": "string", "minLength": 1}, _COLUMNS, {"type": "null"}]
    for name in ("name", "output"):
        keys[name]["type"] = _SCALAR
    axis = schema["$defs"]["FollowConfig"]["properties"]["axis"]
    axis["enum"] += [name for name in RigConfig.model_fields if name not in (*axis["enum"], "mass")]
    of_rig, of_model = ([*_required(*item)] for item in required.items())
    rules = [
        _if(_RIG, _all(*of_rig, *_rules_of_a_rig()), _all(*of_model, *_rules_of_the_model())),
        _if(_TABLE, _all(*_rules_of_a_table())),
        *_rules_of_follow(),
        *_rules_of_a_record(),
    ]
    return {**about, **schema, "allOf": rules}


# The parts of a schema


def _all(*schemas: JsonSchema) -> JsonSchema:
    return {"allOf": [*schemas]}


def _either(*schemas: JsonSchema) -> JsonSchema:
    return {"anyOf": [*schemas]}


def _not(schema: JsonSchema) -> JsonSchema:
    return {"not": schema}


def _if(condition: JsonSchema, then: JsonSchema, otherwise: JsonSchema | None = None) -> JsonSchema:
    return {"if": condition, "then": then, **({} if otherwise is None else {"else": otherwise})}


def _with(**properties: JsonSchema) -> JsonSchema:
    """Describe a mapping that has these keys, with such values."""
    return {"type": "object", "required": [*properties], "properties": properties}


def _where_given(**properties: Any) -> JsonSchema:
    """Describe a mapping that may have these keys, with such values."""
    return {"properties": properties}


_GROUPS: tuple[type[ParameterConfig], ...] = (RigConfig, OscillatorConfig)
#: The types of what the loader reads as a text.
_SCALAR = ["string", "number", "boolean", "null"]
_GIVEN = _not({"type": "null"})
_RIG, _TABLE, _CSV = _with(rig=_GIVEN), _with(points=_GIVEN), _with(points={"type": "string"})
_SEVERAL = _either({"type": "array", "minItems": 2}, _with(num={"minimum": 2}), _with(step={}))
_AUTO = _with(record=_with(transient={"const": "auto"}))


def _columns_of(parameters: Mapping[str, Parameter]) -> JsonSchema:
    """Describe columns of numbers of which one at least is that of a parameter."""
    numbers = {name: {"items": number_schema(one)} for name, one in parameters.items()}
    return _where_given(**numbers) | _either(*({"required": [name]} for name in parameters))


#: The further columns of a table hold any scalars, as texts too.
_COLUMNS = {
    "type": "object",
    "propertyNames": {"pattern": COLUMN_NAME},
    "additionalProperties": {
        "type": "array",
        "minItems": 1,
        "items": {"type": _SCALAR, **_not({"type": "string", "pattern": "\0"})},
    },
    "properties": {
        name: {"type": "array", "minItems": 1, "items": number_schema(one)}
        for name, one in PARAMETERS.items()
    },
}


# The rules between keys


def _names_of(key: str) -> list[str]:
    """Return the names that a column for a key of a rig or an oscillator may have."""
    own = [name for name, one in QUANTITIES.items() if one.name == key and name != key]
    return [key, *own]


def _required(group: type[ParameterConfig], keys: list[str]) -> Iterator[JsonSchema]:
    """Require each key of a group, or a column in its place; of two forces, one that acts."""
    title = "rig" if group is RigConfig else "oscillator"
    columns = {key: [_with(points=_with(**{name: {}})) for name in _names_of(key)] for key in keys}
    force, base = group.FORCES or ("", "")
    for key in keys:
        if key != force:
            yield _either(_with(**{title: _with(**{key: {}})}), _CSV, *columns[key])
    still = _either({"enum": [0, [0]]}, _with(start={"const": 0}, stop={"const": 0}))
    moving = {"contains": _not({"const": 0})}
    yield _either(
        _with(**{title: _either(_with(**{force: {}}), _with(**{base: _not(still)}))}),
        _CSV,
        *columns[force],
        *(_with(points=_with(**{name: moving})) for name in _names_of(base)),
    )


def _rules_of_a_rig() -> Iterator[JsonSchema]:
    yield _where_given(oscillator=False)
    yield _where_given(
        units=_where_given(**{name: {"enum": [unit, name]} for name, unit in SI_UNITS.items()})
    )
    yield _if(
        _with(points={"type": "object"}),
        _where_given(points=_columns_of({**PARAMETERS, **RIG_PARAMETERS})),
    )
    for key in RigConfig.model_fields:
        if len(names := _names_of(key)) > 1:
            yield _not(_with(points=_with(**{name: {} for name in names})))


def _rules_of_the_model() -> Iterator[JsonSchema]:
    yield _where_given(units=_where_given(mass=False))
    yield _where_given(follow=_where_given(axis={"enum": [*OscillatorConfig.model_fields]}))
    yield _if(_with(points={"type": "object"}), _where_given(points=_columns_of(PARAMETERS)))


def _rules_of_a_table() -> Iterator[JsonSchema]:
    one_number = {"additionalProperties": _not({"type": ["array", "object"]})}
    yield _where_given(
        oscillator=one_number, rig=one_number, start=one_number, follow={"type": "null"}
    )
    for title, group in (
        ("rig", RigConfig),
        ("oscillator", OscillatorConfig),
        ("start", StartConfig),
    ):
        for key in group.model_fields:
            columns = [_with(points=_with(**{name: {}})) for name in _names_of(key)]
            yield _not(_all(_with(**{title: _with(**{key: {}})}), _either(*columns)))


def _rules_of_follow() -> Iterator[JsonSchema]:
    """Require several values along the axis, and transients of a given length."""
    yield _if(_with(follow=_GIVEN), _not(_AUTO))
    for group, title in ((OscillatorConfig, "oscillator"), (RigConfig, "rig")):
        for key in group.model_fields:
            followed = _with(
                follow=_with(axis={"enum": _names_of(key)}), **{title: {"type": "object"}}
            )
            yield _if(followed, _with(**{title: _with(**{key: _SEVERAL})}))


def _rules_of_a_record() -> Iterator[JsonSchema]:
    """Require of the record and the method that they go together."""
    with_period, with_lyapunov = ({"contains": {"const": name}} for name in ("period", "lyapunov"))
    yield _if(
        _AUTO,
        _where_given(record=_where_given(diagnostics=with_period, trajectory={"const": False})),
        _where_given(record=_where_given(longest={"type": "null"})),
    )
    other_rule = _with(method=_with(impact=_not({"const": "exact"})))
    yield _if(
        other_rule,
        _where_given(record=_where_given(diagnostics=_not(with_lyapunov))),
        _where_given(method=_where_given(integrator={"const": "exact"})),
    )
