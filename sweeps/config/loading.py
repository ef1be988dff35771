"""Reading a configuration file, with the line of every key.

Each error names the file, the line, the key, the given value and the allowed values.
"""

from __future__ import annotations

import codecs
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydantic import ValidationError

from sweeps.config.checks import conflicts, with_defaults
from sweeps.config.groups import key_list
from sweeps.config.messages import (
    as_typed,
    conflict_at,
    dotted,
    explained,
    source_of,
    without_misspelt,
)
from sweeps.config.points import read_points
from sweeps.config.rig import made_of_rig
from sweeps.config.sweep import SweepConfig
from sweeps.config.values import MOST_VALUES, ConflictError, Key, null
from sweeps.errors import ConfigError
from sweeps.text import missing_text, shortened, shown_count
from sweeps.yaml_text import DEEPEST, yaml_node
from vibroimpact import inputs

#: Longest file accepted, in bytes: long axes should be ranges.
_MOST_BYTES = 250_000
#: Most errors reported; of the others only the number is given.
_MOST_ERRORS = 8


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
    >>> import sweeps
    >>> omega = {"start": 2.6, "stop": 2.7, "num": 20}
    >>> scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": omega, "f": 1.0}}
    >>> config = sweeps.load_config(scene, ["oscillator.h=0.05"])
    >>> config.size, config.record.transient
    (20, 1000)
    """
    if isinstance(source, Mapping):
        data = {
            str(key): value if key == "points" else _without_numpy(value)
            for key, value in source.items()
        }
        return _configuration(data, "the configuration", {}, overrides)
    try:
        path = Path(source)
    except TypeError:
        typed, expected = inputs.input_text(source), f"a YAML file, or {key_list(SweepConfig)}"
        raise ConfigError(f"the configuration is {typed}; expected: {expected}") from None
    return parse_config(_text(path), str(path), path.stem, overrides)


def parse_config(text: str, origin: str, name: str, overrides: Sequence[str] = ()) -> SweepConfig:
    """Read the configuration of a sweep from YAML text, as `load_config` does from a file.

    `origin` tells errors where the text comes from. `name` is the name of the sweep if the text
    gives none.
    """
    data, sources = _parse(text, origin)
    return _configuration({"name": name, **data}, origin, sources, overrides)


def stored_config(
    text: str,
    origin: str,
    name: str,
    points: Mapping[str, np.ndarray] | None = None,
    overrides: Sequence[str] = (),
) -> SweepConfig:
    """Read the configuration in a sweep file, which stores its table of `points` apart from it.

    Columns of the model that were made from those of a rig are left out.
    """
    data, sources = _parse(text, origin)
    if points is not None:
        made = made_of_rig(points, data["rig"]) if "rig" in data else set()
        points = {key: values for key, values in points.items() if key not in made}
    return _configuration({"name": name, "points": points, **data}, origin, sources, overrides)


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
        source = source_of(("points",), sources, origin)
        try:  # the path of a table given by an override is relative to the working folder
            folder = Path() if ("points",) in overridden else Path(origin).parent
            of_rig = null(data.get("rig")) is not None
            data["points"] = read_points(data["points"], folder, of_rig=of_rig)
        except ValueError as error:
            raise ConfigError(f"{source}: points: {error}") from None
    try:
        config = SweepConfig.model_validate(data)
        if problems := [conflict_at(conflict, sources, origin) for conflict in conflicts(config)]:
            raise ConfigError("\n".join(problems))
        return with_defaults(config)
    except ConflictError as conflict:
        raise ConfigError(conflict_at(conflict, sources, origin)) from None
    except ValidationError as refusal:
        errors = without_misspelt(refusal.errors())
        texts = [explained(error, data, sources, origin) for error in errors[:_MOST_ERRORS]]
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
    raise ConfigError(f"{path}: cannot be read ({reason}); expected: a YAML file in UTF-8")


def _parse(text: str, origin: str, key: Key = ()) -> tuple[Any, dict[Key, str]]:
    """Parse the YAML text of `key`, or of a whole configuration; return the line of each key, too.

    Every scalar is still a text.
    """
    sources: dict[Key, str] = {}
    node = yaml_node(text, origin)

    def line_of(at: yaml.Node) -> str:
        return origin if key else f"{origin}, line {at.start_mark.line + 1}"

    data = "" if node is None else _tree(node, line_of, key, sources)
    if not key and not isinstance(data, dict):
        content = as_typed(data) if data else "empty"
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
                f"{here}: {dotted(child)} is given twice, first in {sources[child]}; "
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
                f"{origin}: {dotted(key[:depth])} = {as_typed(target)} has no keys; "
                f"set {dotted(key[:depth])} as a whole"
            )
    for replaced in [old for old in sources if old[: len(key)] == key]:
        del sources[replaced]
    sources[key] = origin
    target[key[-1]], _ = _parse(value, origin, key)
    return key
