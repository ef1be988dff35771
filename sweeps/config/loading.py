"""Reading a configuration file: YAML whose every key remembers its line, and errors in words.

Every error names the file, the line, the key, what was given and what is allowed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydantic import ValidationError

from sweeps.config.groups import key_list
from sweeps.config.messages import dotted, explained, shown, source_of, without_echoes
from sweeps.config.points import read_points
from sweeps.config.sweep import SweepConfig
from sweeps.config.values import Key, null
from sweeps.errors import ConfigError
from sweeps.text import shortened, shown_count

#: A longer file is none that was typed; a long axis is better given as a range.
_MOST_BYTES = 250_000
#: The schema has four levels.
_DEEPEST = 16
#: Of more errors the first are said, and the number of the others.
_MOST_ERRORS = 8


def load_config(
    source: str | Path | Mapping[str, Any], overrides: Sequence[str] = ()
) -> SweepConfig:
    """Read the configuration of a sweep.

    Parameters
    ----------
    source : str, Path or mapping
        A YAML file, or what loading one would give: a mapping of its keys, in which arrays of
        NumPy may stand for lists, and a DataFrame or a structured array for ``points``.
    overrides : sequence of str
        ``dotted.key=value`` with the value in YAML, each replacing or adding one key. The last
        name may be one of a range: ``oscillator.omega.start=2.71``.

    Returns
    -------
    SweepConfig

    Raises
    ------
    ConfigError
        If a file cannot be read, is not YAML, or asks for what is not allowed.
    """
    if isinstance(source, Mapping):
        given = {key: value if key == "points" else _plain(value) for key, value in source.items()}
        return _checked(given, "the configuration", {}, overrides)
    path = Path(source)
    return parse_config(_text(path), str(path), path.stem, overrides)


def parse_config(
    text: str, origin: str, name: str, overrides: Sequence[str] = (), **table: Any
) -> SweepConfig:
    """Read the configuration of a sweep from a text of YAML, as `load_config` does from a file.

    The `origin` is where the text is from, for the errors; the sweep has this name if the text
    gives none. Of the file of a sweep, the ``points`` of its `table` are not in the text.
    """
    sources: dict[Key, str] = {}
    data = _parse(text, origin, (), sources)
    if not isinstance(data, dict):
        content = shown(data) if data else "empty"
        raise ConfigError(f"{origin}: the file is {content}; expected: {key_list(SweepConfig)}")
    return _checked({"name": name, **table, **data}, origin, sources, overrides)


def _checked(
    data: dict[str, Any], origin: str, sources: dict[Key, str], overrides: Sequence[str]
) -> SweepConfig:
    """Return the configuration that `data` with `overrides` describe, or refuse them in words."""
    for override in overrides:
        _override(data, override, sources)
    if null(data.get("points")) is not None:
        source = source_of(("points",), sources, origin)
        try:  # a file that an override names is in the working folder
            folder = Path() if source.startswith("override") else Path(origin).parent
            data["points"] = read_points(data["points"], folder)
        except ValueError as error:
            raise ConfigError(f"{source}: points: {error}") from None
    try:
        return SweepConfig.model_validate(data)
    except ValidationError as refusal:
        errors = without_echoes(refusal.errors())
        texts = [explained(error, data, sources, origin) for error in errors[:_MOST_ERRORS]]
        if (more := len(errors) - _MOST_ERRORS) > 0:
            texts.append(f"{origin}: and {shown_count(more, 'error')} more")
        raise ConfigError("\n".join(texts)) from None


def _plain(value: Any) -> Any:
    """Return a value of Python as YAML has it: mappings, lists and numbers, none of NumPy's."""
    if isinstance(value, Mapping):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    return [_plain(item) for item in value] if isinstance(value, (list, tuple)) else value


def _text(path: Path) -> str:
    """Read a file, which is to be short and in UTF-8."""
    try:
        with path.open("rb") as file:
            data = file.read(_MOST_BYTES + 1)
        if len(data) <= _MOST_BYTES:
            return data.decode("utf-8-sig")
        reason = f"longer than {_MOST_BYTES:,} bytes"
    except OSError as error:
        reason = error.strerror or type(error).__name__
    except ValueError as error:
        reason = str(error)
    raise ConfigError(f"{path}: cannot be read ({reason}); expected: a YAML file in UTF-8")


class _Loader(yaml.BaseLoader):
    """Scalars stay the text that was typed, which the schema reads and the messages repeat.

    So ``1e-3`` is the number that YAML 1.1 takes for a text, and ``010`` or ``1:30`` are not the
    8 and the 90 that it makes of them.
    """

    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Compose a node as PyYAML does; refuse aliases, tags and too many levels."""
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent) or getattr(event, "tag", None):
            problem = "aliases and tags are not allowed"
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=event.start_mark)
        if self._depth == _DEEPEST:
            problem = f"more than {_DEEPEST} levels are not allowed"
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=event.start_mark)
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node


def _parse(text: str, origin: str, key: Key, sources: dict[Key, str]) -> object:
    """Read YAML that stands at `key`, noting in `sources` where every key comes from."""
    try:
        node = yaml.compose(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise ConfigError(f"{origin}{place}: not valid YAML: {error.problem}") from None
    except (yaml.YAMLError, RecursionError, ValueError, OverflowError) as error:
        # The last two are of an escaped character that there is not, as "\\U00110000".
        raise ConfigError(f"{origin}: not valid YAML: {shortened(str(error), 300)}") from None

    def line_of(at: yaml.Node) -> str:
        return origin if key else f"{origin}, line {at.start_mark.line + 1}"

    return "" if node is None else _tree(node, line_of, key, sources)


def _tree(
    node: yaml.Node, line_of: Callable[[yaml.Node], str], key: Key, sources: dict[Key, str]
) -> object:
    """Return the text, list or mapping of a node that stands at `key`."""
    sources.setdefault(key, line_of(node))
    if isinstance(node, yaml.SequenceNode):
        return [_tree(item, line_of, (*key, i), sources) for i, item in enumerate(node.value)]
    if isinstance(node, yaml.ScalarNode):
        return _text_of(node, line_of(node))
    mapping: dict[str, object] = {}
    for key_node, value_node in node.value:
        here, name = line_of(key_node), key_node.value
        if not isinstance(name, str):
            raise ConfigError(f"{here}: a list or mapping is not allowed as a key")
        name = _text_of(key_node, here)
        child = (*key, name)
        if name in mapping:
            raise ConfigError(
                f"{here}: {dotted(child)} is given twice, first in {sources[child]}; "
                "each key is allowed once"
            )
        sources[child] = here
        mapping[name] = _tree(value_node, line_of, child, sources)
    return mapping


def _text_of(node: yaml.Node, source: str) -> str:
    """Return the text of a scalar, in which two escapes of 16 bits may make one character."""
    try:
        return str(node.value).encode("utf-16", "surrogatepass").decode("utf-16")
    except UnicodeDecodeError:
        reason = "half of a surrogate pair is no character; expected: Unicode"
        raise ConfigError(f"{source}: {reason}") from None


def _override(data: dict[str, Any], override: str, sources: dict[Key, str]) -> None:
    """Set one key in `data`, as an override asks."""
    origin = f"override {shortened(override)}"
    name, equals, value = override.partition("=")
    key = tuple(name.strip().split("."))
    if not equals or not all(key):
        raise ConfigError(f"{origin}: expected key=value, for example oscillator.h=0.2")
    target = data
    for depth, part in enumerate(key[:-1], 1):
        sources.setdefault(key[:depth], origin)
        target = target.setdefault(part, {})
        if not isinstance(target, dict):
            raise ConfigError(
                f"{origin}: {dotted(key[:depth])} = {shown(target)} has no keys; "
                f"set {dotted(key[:depth])} as a whole"
            )
    for replaced in [old for old in sources if old[: len(key)] == key]:
        del sources[replaced]
    sources[key] = origin
    target[key[-1]] = _parse(value, origin, key, sources)
