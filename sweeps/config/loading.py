"""Loads a configuration file: the line of every key, the messages of wrong keys and values.

Each error names the file, the line, the key, the given value and the allowed values.
"""

from __future__ import annotations

import codecs
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np
import yaml
from pydantic import ValidationError
from pydantic_core import ErrorDetails

from sweeps.config.checks import conflicts, with_defaults
from sweeps.config.groups import RecordConfig, TrajectoryConfig, key_list
from sweeps.config.points_table import read_points
from sweeps.config.rig import derived_columns
from sweeps.config.sweep import SweepConfig, dotted_keys
from sweeps.config.values import MOST_VALUES, ConflictError, Group, Key, Range, null
from sweeps.errors import ConfigError
from sweeps.text import missing_text, near_misses, shortened, shown_count, suggestion
from sweeps.yaml_text import DEEPEST, yaml_node
from vibroimpact import inputs

#: Longest file accepted, in bytes: long axes should be ranges.
_MOST_BYTES = 250_000
#: Most errors reported; of the others only the number is given.
_MOST_ERRORS = 8
#: What to do with a sweep file that is given in place of its configuration.
_OF_A_FILE = "; vibroimpact info --config shows that of a sweep file"


def load_config(
    source: str | Path | Mapping[str, Any], overrides: Sequence[str] = ()
) -> SweepConfig:
    """Read the configuration of a sweep.

    Parameters
    ----------
    source : str, Path or mapping
        A YAML file, or a mapping with the keys of such a file. In a mapping, a list may also be a
        range, a Series, an Index, a DataArray or an array of NumPy, a number an array without
        dimensions, and ``points`` a DataFrame or a structured array.
    overrides : sequence of str
        Each is ``dotted.key=value``, with the value in YAML, and replaces or adds one key. The key
        may lie inside a range: ``oscillator.omega.start=2.71``.

    Returns
    -------
    SweepConfig

    Raises
    ------
    ConfigError
        If a file cannot be read, is not valid YAML, or has a key or value that is not allowed.

    Examples
    --------
    >>> config = sweeps.load_config(scene, ["oscillator.h=0.05"])  # of the example of `run_sweep`
    >>> config.size, config.record.transient
    (20, 1000)
    """
    if isinstance(source, Mapping) and not hasattr(source, "data_vars"):  # no Dataset
        data = {
            str(key): value if key == "points" else _without_numpy(value)
            for key, value in source.items()
        }
        origin = "the configuration"
        return _configuration(data, origin, {(): origin}, overrides)
    try:
        path = Path(source)  # type: ignore[arg-type]
    except TypeError:
        typed, expected = inputs.input_text(source), f"a YAML file, or {key_list(SweepConfig)}"
        problem = f"the configuration is {typed}; expected: {expected}{_OF_A_FILE}"
        raise ConfigError(problem) from None
    return parse_config(_text(path), str(path), path.stem, overrides)


def parse_config(
    text: str,
    origin: str,
    name: str,
    overrides: Sequence[str] = (),
    table: Mapping[str, np.ndarray] | None = None,
) -> SweepConfig:
    """Read the configuration of a sweep from YAML text, as `load_config` does from a file.

    `origin` tells errors where the text comes from. `name` is the name of the sweep if the text
    gives none. A sweep file stores its `table` of points apart from the text, with columns of the
    model that were made from those of a rig; these are left out.
    """
    data, sources = _parse(text, origin)
    if table:
        derived = derived_columns(table, data["rig"]) if "rig" in data else set()
        data = {"points": {key: table[key] for key in table if key not in derived}, **data}
    return _configuration({"name": name, **data}, origin, sources, overrides)


def _configuration(
    data: dict[str, Any], origin: str, sources: dict[Key, str], overrides: Sequence[str]
) -> SweepConfig:
    """Return the configuration of `data` with `overrides`; raise ConfigError if it is not valid."""
    if isinstance(overrides, str) or not isinstance(overrides, Iterable):
        raise ConfigError(
            f"overrides = {inputs.input_text(overrides)}; expected: a list of texts key=value"
        )
    overridden = [_override(data, override, sources) for override in overrides]
    if null(data.get("points")) is not None:
        source = _source_of(("points",), sources)
        try:  # the path of a table given by an override is relative to the working folder
            folder = Path() if ("points",) in overridden else Path(origin).parent
            of_rig = null(data.get("rig")) is not None
            data["points"] = read_points(data["points"], folder, of_rig=of_rig)
        except ValueError as error:
            raise ConfigError(f"{source}: points: {error}") from None
    try:
        config = SweepConfig.model_validate(data)
        if problems := [_conflict_at(conflict, sources) for conflict in conflicts(config)]:
            raise ConfigError("\n".join(problems))
        return with_defaults(config)
    except ConflictError as conflict:
        raise ConfigError(_conflict_at(conflict, sources)) from None
    except ValidationError as refusal:
        errors = _without_misspelt(refusal.errors())
        texts = [_explained(error, data, sources) for error in errors[:_MOST_ERRORS]]
        if (more := len(errors) - _MOST_ERRORS) > 0:
            texts.append(f"{origin}: and {shown_count(more, 'error')} more")
        raise ConfigError("\n".join(texts)) from None


def _without_numpy(value: Any, level: int = 2) -> Any:
    """Convert a Python value to plain mappings, lists and numbers, without NumPy types."""
    if level > DEEPEST:  # a mapping may contain itself
        raise ConfigError(f"the configuration: more than {DEEPEST} levels are not allowed")
    if isinstance(value, Mapping):
        return {str(name): _without_numpy(item, level + 1) for name, item in value.items()}
    if isinstance(value, range) and len(value) > MOST_VALUES:
        raise ConfigError(f"{value} has too many values; expected: at most {MOST_VALUES:,}")
    if isinstance(value, (list, tuple, range)):
        return [_without_numpy(item, level + 1) for item in value]
    if hasattr(value, "dtype") and hasattr(value, "__array__"):  # also of pandas and xarray
        array = value if isinstance(value, np.ndarray) else np.asarray(value)
        dates = array.dtype.kind in "mM"  # whose items may be integers
        return array.astype(str).tolist() if dates else array.tolist()
    return value


def _text(path: Path) -> str:
    """Read a file of at most ``_MOST_BYTES`` bytes, in UTF-8 or, as its first bytes say, UTF-16."""
    data = b""
    try:
        with path.open("rb") as file:
            data = file.read(_MOST_BYTES + 1)
        if len(data) <= _MOST_BYTES:
            utf_16 = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
            return data.decode("utf-16" if utf_16 else "utf-8-sig")
        reason = f"longer than {_MOST_BYTES:,} bytes"
    except FileNotFoundError:
        raise ConfigError(missing_text(path)) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
    hint = _OF_A_FILE if data.startswith(b"\x89HDF") else ""
    raise ConfigError(f"{path}: cannot be read ({reason}); expected: a YAML file in UTF-8{hint}")


def _parse(text: str, origin: str, key: Key = ()) -> tuple[Any, dict[Key, str]]:
    """Parse the YAML of `key`, or of a whole configuration, to texts, with the line of each."""
    sources: dict[Key, str] = {}
    node = yaml_node(text, origin)

    def line_of(at: yaml.Node) -> str:
        return origin if key else f"{origin}, line {at.start_mark.line + 1}"

    data = "" if node is None else _tree(node, line_of, key, sources)
    if not key and not isinstance(data, dict):
        content = _as_typed(data) if data else "empty"
        raise ConfigError(f"{origin}: the file is {content}; expected: {key_list(SweepConfig)}")
    return data, sources


def _tree(
    node: yaml.Node, line_of: Callable[[yaml.Node], str], key: Key, sources: dict[Key, str]
) -> object:
    """Convert the node at `key` to a text, a list or a mapping; note its line in `sources`."""
    here = line_of(node)
    sources.setdefault(key, here)
    if isinstance(node, yaml.SequenceNode):
        return [_tree(item, line_of, (*key, i), sources) for i, item in enumerate(node.value)]
    if isinstance(node, yaml.ScalarNode):
        try:  # join two 16-bit escapes that form one character
            return str(node.value).encode("utf-16", "surrogatepass").decode("utf-16")
        except UnicodeDecodeError:
            reason = "half of a surrogate pair is no character; expected: Unicode"
            raise ConfigError(f"{here}: {reason}") from None
    mapping: dict[str, object] = {}
    for key_node, value_node in node.value:
        here = line_of(key_node)
        if not isinstance(key_node, yaml.ScalarNode):
            raise ConfigError(f"{here}: a list or mapping is not allowed as a key")
        name = str(_tree(key_node, line_of, key, sources))
        child = (*key, name)
        if name in mapping:
            raise ConfigError(
                f"{here}: {_dotted(child)} is given twice, first in {sources[child]}; "
                "each key is allowed once"
            )
        sources[child] = here
        mapping[name] = _tree(value_node, line_of, child, sources)
    return mapping


def _override(data: dict[str, Any], override: object, sources: dict[Key, str]) -> Key:
    """Apply one override to `data`; return its key."""
    origin = f"override {shortened(str(override))}"
    name, equals, value = str(override).partition("=")
    key = tuple(name.strip().split("."))
    if not equals or not all(key):
        raise ConfigError(f"{origin}: expected key=value, for example oscillator.h=0.2")
    target = data
    for depth, part in enumerate(key[:-1], 1):
        sources.setdefault(key[:depth], origin)
        target = target.setdefault(part, {})
        if not isinstance(target, dict):
            raise ConfigError(
                f"{origin}: {_dotted(key[:depth])} = {_as_typed(target)} has no keys; "
                f"set {_dotted(key[:depth])} as a whole"
            )
    for replaced in [old for old in sources if old[: len(key)] == key]:
        del sources[replaced]
    sources[key] = origin
    target[key[-1]], _ = _parse(value, origin, key)
    return key


# The messages of errors: the place, what was typed, what is allowed


def _without_misspelt(errors: Sequence[ErrorDetails]) -> list[ErrorDetails]:
    """Remove the errors about a missing key that is only misspelt, which has its own error."""
    unknown = [error["loc"] for error in errors if error["type"] == "extra_forbidden"]
    meant = ((loc[:-1], _meant(str(loc[-1]), _located(loc)[1].model_fields)) for loc in unknown)
    replaced = {(*group, *keys) for group, keys in meant}
    return [error for error in errors if error["type"] != "missing" or error["loc"] not in replaced]


def _explained(error: ErrorDetails, data: Mapping[str, Any], sources: Mapping[Key, str]) -> str:
    """Write a pydantic error in one line: the place, the given value and the allowed values."""
    reason = error.get("ctx", {}).get("error")
    if isinstance(reason, ConflictError):
        return _conflict_at(reason, sources)
    key, group, expected = _located(error["loc"])
    where = f"{_source_of(key, sources)}: "
    if error["type"] == "missing":
        return f"{where}{_dotted(key)} is missing; expected: {expected}"
    if error["type"] == "extra_forbidden":
        name = str(key[-1])
        instead = {"oscillator": "rig.", "rig": "oscillator."}
        unused = "points.", "units.mass", *(instead[group] for group in instead if group in data)
        others = [other for other in dotted_keys(2) if not other.startswith(unused)]
        hint = suggestion(_meant(name, group.model_fields, others))
        if name.isdecimal():  # {h: 0,1} is read as {h: 0, 1: }
            hint = " (a number has a decimal point, no comma)"
        return f"{where}unknown key {_dotted(key)}{hint}; expected: {key_list(group)}"
    typed = f"{_dotted(key)} = {_as_typed(_value_at(data, key, error['input']))}"
    return f"{where}{typed} {reason or 'is not allowed'}; expected: {expected}"


def _conflict_at(conflict: ConflictError, sources: Mapping[Key, str]) -> str:
    """Write the conflict of a value with another one in one line: the place and the problem."""
    return f"{_source_of(conflict.key, sources)}: {_dotted(conflict.key)}: {conflict}"


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


def _source_of(key: Key, sources: Mapping[Key, str]) -> str:
    """Return the origin of `key`, or of the closest group around it; () is the configuration."""
    groups = (key[:length] for length in range(len(key), -1, -1))
    return next(sources[group] for group in groups if group in sources)


def _dotted(key: Key) -> str:
    """Write a key as in an override, for example oscillator.h[2]; a long one is shortened."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part or '(nothing)'}" for part in key)
    return shortened("".join(parts)[1:])


def _as_typed(value: object) -> str:
    """Write a value as it was typed; a long one is shortened."""
    if isinstance(value, dict):
        text = "{" + ", ".join(f"{name}: {_as_typed(item)}" for name, item in value.items()) + "}"
    elif isinstance(value, (list, tuple)):
        text = "[" + ", ".join(map(_as_typed, value)) + "]"
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
    "omega": "ω frequency freq forcing_frequency excitation_frequency angular_frequency w",
    "f": "amplitude forcing_amplitude forcing force excitation f0",
    "p": "eigenfrequency natural_frequency omega0 omega_0 omega_n stiffness k",
    "clearance": "σ gap sigma delta distance play backlash offset wall barrier obstacle",
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


def _meant(name: str, valid: Collection[str], elsewhere: Iterable[str] = ()) -> list[str]:
    """Return the keys probably meant by a name that is not a key; `elsewhere` are dotted."""
    ends = _OTHER_ENDS if {"start", "stop", "num"} <= {*valid} else {}
    return (
        _called(name, valid, _OTHER_NAMES | ends)
        or near_misses(name, valid, least=0.85)
        or _called(name, elsewhere, _OTHER_NAMES)
        or near_misses(name, valid)
    )


def _called(name: str, keys: Iterable[str], other_names: Mapping[str, str]) -> list[str]:
    """Return the keys, dotted or not, of which a name is the last part or else a synonym."""
    folded = name.casefold().replace("-", "_").replace(" ", "_")
    last = {key: key.rpartition(".")[2] for key in keys}
    named = [key for key, word in last.items() if word.casefold() == folded]
    return named or [key for key in last if folded in other_names.get(last[key], "").split()]
