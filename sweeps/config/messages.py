"""Messages for errors: the place, what was typed, what is allowed."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, get_args

from pydantic_core import ErrorDetails

from sweeps.config.groups import RecordConfig, TrajectoryConfig, key_list
from sweeps.config.sweep import SweepConfig
from sweeps.config.values import ConflictError, Group, Key, Range
from sweeps.text import near_miss, shortened, suggestion
from vibroimpact import inputs


def without_misspelt(errors: Sequence[ErrorDetails]) -> list[ErrorDetails]:
    """Remove the errors about a missing key that is only misspelt, which has its own error."""
    unknown = [error["loc"] for error in errors if error["type"] == "extra_forbidden"]
    replaced = {(*loc[:-1], meant(str(loc[-1]), _located(loc)[1].model_fields)) for loc in unknown}
    return [error for error in errors if error["type"] != "missing" or error["loc"] not in replaced]


def _keys_elsewhere() -> Iterator[str]:
    """Yield every key of the configuration as dotted text, except the keys of ranges."""
    # If two keys share a name, `meant` suggests the last one: so the names of units come first.
    for name, field in sorted(
        SweepConfig.model_fields.items(), key=lambda item: item[0] != "units"
    ):
        yield name
        group = _group_of(field.annotation)
        yield from (f"{name}.{key}" for key in (group.model_fields if group else ()))


def explained(error: ErrorDetails, data: object, sources: Mapping[Key, str], path: str) -> str:
    """Write a pydantic error in one line: the place, the given value and the allowed values."""
    reason = error.get("ctx", {}).get("error")
    if isinstance(reason, ConflictError):
        return conflict_at(reason, sources, path)
    key, group, expected = _located(error["loc"])
    where = f"{source_of(key, sources, path)}: "
    if error["type"] == "missing":
        return f"{where}{dotted(key)} is missing; expected: {expected}"
    if error["type"] == "extra_forbidden":
        name = str(key[-1])
        hint = suggestion(meant(name, group.model_fields, _keys_elsewhere()))
        if name.isdecimal():  # {h: 0,1} is read as {h: 0, 1: }
            hint = " (a number has a decimal point, no comma)"
        return f"{where}unknown key {dotted(key)}{hint}; expected: {key_list(group)}"
    typed = f"{dotted(key)} = {as_typed(_value_at(data, key, error['input']))}"
    return f"{where}{typed} {reason or 'is not allowed'}; expected: {expected}"


def conflict_at(conflict: ConflictError, sources: Mapping[Key, str], path: str) -> str:
    """Write the conflict of a value with another one in one line: the place and the problem."""
    return f"{source_of(conflict.key, sources, path)}: {dotted(conflict.key)}: {conflict}"


def _located(loc: Key) -> tuple[Key, type[Group], str]:
    """Return the key at pydantic's `loc`, its group, and the description of its valid values."""
    key: list[str | int] = []
    group: type[Group] = SweepConfig
    nested: type[Group] | None = SweepConfig
    expected = ""
    for part in loc:
        if isinstance(part, int):
            key.append(part)
        elif nested is None:
            # This part is not a key: for a value of several forms, pydantic adds the form (`form`).
            nested = TrajectoryConfig if group is RecordConfig else Range
        else:
            key.append(part)
            group = nested
            field = group.model_fields.get(part)
            expected = field.description or "" if field else ""
            nested = _group_of(field.annotation if field else None)
    return tuple(key), group, expected


def _group_of(kind: Any) -> type[Group] | None:
    """Return the type of group that a field holds, also if it may be null; else None."""
    kinds = (kind, *get_args(kind))
    return next((k for k in kinds if isinstance(k, type) and issubclass(k, Group)), None)


def _value_at(data: Any, key: Key, otherwise: object) -> object:
    """Return the value at `key` as typed, before any conversion; `otherwise` if there is none."""
    for part in key:
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            return otherwise
    return data


def source_of(key: Key, sources: Mapping[Key, str], path: str) -> str:
    """Return the origin of `key`, or of the closest group around it."""
    groups = (key[:length] for length in range(len(key), -1, -1))
    return next((sources[group] for group in groups if group in sources), path)


def dotted(key: Key) -> str:
    """Write a key as in an override, for example oscillator.h[2]; a long one is shortened."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part or '(nothing)'}" for part in key)
    return shortened("".join(parts)[1:])


def as_typed(value: object) -> str:
    """Write a value as it was typed; a long one is shortened."""
    if isinstance(value, dict):
        text = "{" + ", ".join(f"{name}: {as_typed(item)}" for name, item in value.items()) + "}"
    elif isinstance(value, (list, tuple)):
        text = "[" + ", ".join(map(as_typed, value)) + "]"
    else:
        text = value if isinstance(value, str) else inputs.input_text(value)
        text = text or "(nothing)"
    return shortened(text)


#: Synonyms of each key: symbols of the literature and names in other programs.
_OTHER_NAMES = {
    "points": "table rows csv",
    "oscillator": "parameters params system model",
    "start": "initial initial_conditions initial_state ic",
    "method": "numerics integration",
    "record": "save store recording keep",
    "follow": "continuation continue",
    "output": "out file filename path hdf5",
    "rig": "experiment apparatus si",
    "mass": "m",
    "stiffness": "k spring spring_constant",
    "damping": "c damper h viscous damping_coefficient",
    "force": "amplitude f force_amplitude forcing forcing_amplitude",
    "frequency": "freq nu hertz hz omega forcing_frequency excitation_frequency",
    "gap": "clearance sigma delta distance play backlash offset",
    "h": "damping damping_ratio damping_coefficient zeta xi c friction viscous",
    "R": "restitution coefficient_of_restitution restitution_coefficient cor e rebound",
    "omega": "frequency freq forcing_frequency excitation_frequency angular_frequency w",
    "f": "amplitude forcing_amplitude forcing force excitation f0",
    "p": "eigenfrequency natural_frequency omega0 omega_0 omega_n stiffness k",
    "clearance": "gap sigma delta distance play backlash offset wall barrier obstacle",
    "a": "base base_amplitude eccentricity unbalance imbalance",
    "base": "a base_amplitude shaker",
    "x0": "x x_0 position displacement",
    "v0": "v v_0 velocity speed",
    "integrator": "scheme solver",
    "impact": "rule impact_rule collision",
    "steps_per_period": "steps step time_step timestep dt",
    "longest": "max_transient maximum",
    "transient": "transients skip discard warmup burn_in",
    "periods": "cycles n_periods duration",
    "trajectory": "time_series samples",
    "diagnostics": "quantities compute",
    "axis": "parameter along",
    "num": "n count number points steps",
    "step": "size increment by delta",
    "spacing": "scale",
}
#: Synonyms of `start` and `stop` in a range; elsewhere these words have other meanings.
_OTHER_ENDS = {"start": "from min low lower begin first", "stop": "to max high upper end last"}


def meant(name: str, valid: Collection[str], elsewhere: Iterable[str] = ()) -> str | None:
    """Return the key probably meant by a name that is not a key, or None.

    The first match counts: a key of `valid` that equals the name except for case, or has it as a
    synonym; a key of `valid` that differs in a letter or so; a key of `elsewhere` (dotted) that
    matches exactly or by synonym; the most similar key of `valid`.
    """
    folded = name.casefold().replace("-", "_").replace(" ", "_")
    ends = _OTHER_ENDS if {"start", "stop", "num"} <= {*valid} else {}
    last = {key.rpartition(".")[2]: key for key in elsewhere}
    here = {
        word: key
        for key in valid
        for word in (key.casefold(), *ends.get(key, _OTHER_NAMES.get(key, "")).split())
    }
    anywhere = {
        word: last[key]
        for key in last
        for word in (key.casefold(), *_OTHER_NAMES.get(key, "").split())
    }
    return (
        here.get(folded)
        or near_miss(name, valid, least=0.85)
        or anywhere.get(folded)
        or near_miss(name, valid)
    )
