"""Errors of a configuration in words: where, what was typed and what is allowed."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, get_args

from pydantic_core import ErrorDetails

from sweeps.config.groups import RecordConfig, TrajectoryConfig, key_list
from sweeps.config.rig import QUANTITIES
from sweeps.config.sweep import SweepConfig
from sweeps.config.values import Group, Key, MisplacedError, Range, null
from sweeps.text import nearest, shortened, suggestion

#: What pydantic calls an error of a number or a truth value, in the words of the messages.
_PROBLEMS = {
    "float_parsing": "is not a number",
    "float_type": "is not a number",
    "finite_number": "is not a finite number",
    "int_type": "is not an integer",
    "int_parsing": "is not an integer",
    "int_from_float": "is not an integer",
    "bool_type": "is neither true nor false",
    "bool_parsing": "is neither true nor false",
}


def without_echoes(errors: Sequence[ErrorDetails]) -> list[ErrorDetails]:
    """Leave out that a key is missing where it is only misspelt."""
    unknown = [error["loc"] for error in errors if error["type"] == "extra_forbidden"]
    replaced = {(*loc[:-1], meant(str(loc[-1]), _located(loc)[1].model_fields)) for loc in unknown}
    return [error for error in errors if error["type"] != "missing" or error["loc"] not in replaced]


def _keys_elsewhere() -> Iterator[str]:
    """Yield every key of the configuration, dotted, but those of ranges."""
    # The last of two equal names is meant; that is not the mere name of a unit.
    for name, field in sorted(
        SweepConfig.model_fields.items(), key=lambda item: item[0] != "units"
    ):
        yield name
        group = _group_of(field.annotation)
        yield from (f"{name}.{key}" for key in (group.model_fields if group else ()))


def explained(error: ErrorDetails, data: object, sources: Mapping[Key, str], path: str) -> str:
    """Say in one line where an error of pydantic is, what was given and what is allowed."""
    reason = error.get("ctx", {}).get("error")
    if isinstance(reason, MisplacedError):
        key = _as_given(reason.key, data)
        return f"{source_of(key, sources, path)}: {dotted(key)}: {reason}"
    key, group, expected = _located(_as_given(error["loc"], data))
    where = f"{source_of(key, sources, path)}: "
    if error["type"] == "missing":
        return f"{where}{dotted(key)} is missing; expected: {expected}"
    if error["type"] == "extra_forbidden":
        name = str(key[-1])
        hint = suggestion(meant(name, group.model_fields, _keys_elsewhere()))
        if name.isdecimal():  # {h: 0,1} is read as {h: 0, 1: }
            hint = " (a number has a decimal point, no comma)"
        return f"{where}unknown key {dotted(key)}{hint}; expected: {key_list(group)}"
    typed = f"{dotted(key)} = {shown(_typed(data, key, error['input']))}"
    problem = reason or _PROBLEMS.get(error["type"], "is not allowed")
    return f"{where}{typed} {problem}; expected: {expected}"


def _as_given(loc: Key, data: Any) -> Key:
    """Return the place of the rig that a place of the oscillator is made of, if there is a rig."""
    if null(data.get("rig")) is None or loc[:1] != ("oscillator",):
        return loc
    return "rig", *(QUANTITIES[str(k)].name if k in QUANTITIES else k for k in loc[1:2]), *loc[2:]


def _located(loc: Key) -> tuple[Key, type[Group], str]:
    """Return the key at pydantic's `loc`, the group it is in, and what is expected there."""
    key: list[str | int] = []
    group: type[Group] = SweepConfig
    inner: type[Group] | None = SweepConfig
    expected = ""
    for part in loc:
        if isinstance(part, int):
            key.append(part)
        elif inner is None:
            # Not a key: below a value of several forms, pydantic names the form (see `form`).
            inner = TrajectoryConfig if group is RecordConfig else Range
        else:
            key.append(part)
            group = inner
            field = group.model_fields.get(part)
            expected = field.description or "" if field else ""
            inner = _group_of(field.annotation if field else None)
    return tuple(key), group, expected


def _group_of(kind: Any) -> type[Group] | None:
    """Return the group that a field holds, or may hold beside null."""
    kinds = (kind, *get_args(kind))
    return next((k for k in kinds if isinstance(k, type) and issubclass(k, Group)), None)


def _typed(data: Any, key: Key, otherwise: object) -> object:
    """Return what was typed at `key`, which pydantic may have converted already."""
    for part in key:
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            return otherwise
    return data


def source_of(key: Key, sources: Mapping[Key, str], path: str) -> str:
    """Where `key` or the closest group around it comes from."""
    groups = (key[:length] for length in range(len(key), -1, -1))
    return next((sources[group] for group in groups if group in sources), path)


def dotted(key: Key) -> str:
    """Write a key as in an override, cut where it is long: oscillator.h[2]."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part or '(nothing)'}" for part in key)
    return shortened("".join(parts)[1:])


def shown(value: object) -> str:
    """Show a value as it was typed, cut where it is long."""
    if isinstance(value, dict):
        text = "{" + ", ".join(f"{name}: {shown(item)}" for name, item in value.items()) + "}"
    elif isinstance(value, (list, tuple)):
        text = "[" + ", ".join(map(shown, value)) + "]"
    else:
        text = str(value) or "(nothing)"
    return shortened(text)


#: Other names of each key: symbols of the literature, words of other programs.
_OTHER_NAMES = {
    "points": "table rows csv",
    "oscillator": "parameters params system model",
    "start": "initial initial_conditions initial_state ic",
    "method": "numerics integration",
    "record": "save store recording keep",
    "follow": "continuation continue",
    "refine": "refinement adaptive",
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
    "x0": "x x_0 position displacement",
    "v0": "v v_0 velocity speed",
    "integrator": "scheme solver",
    "impact": "rule impact_rule collision",
    "steps_per_period": "steps step time_step timestep dt",
    "transient": "transients skip discard warmup burn_in",
    "periods": "cycles n_periods duration",
    "trajectory": "time_series samples",
    "diagnostics": "quantities compute",
    "axis": "parameter along",
    "levels": "depth",
    "num": "n count number points steps step size increment by delta",
    "spacing": "scale",
}
#: Other names of `start` and `stop` in a range; elsewhere these words mean other things.
_OTHER_ENDS = {"start": "from min low lower begin first", "stop": "to max high upper end last"}


def meant(name: str, valid: Collection[str], elsewhere: Iterable[str] = ()) -> str | None:
    """Return the key meant by a name that is not a key, or None.

    It is the key of `valid` that has this name in another case, as another name or but for a
    letter; else such a key of `elsewhere`, which are dotted; else the key of `valid` that is spelt
    most alike.
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
        or nearest(name, valid, least=0.85)
        or anywhere.get(folded)
        or nearest(name, valid)
    )
