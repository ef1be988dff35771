"""The only YAML parser: words its errors, refuses what makes a short text large.

Files of sweeps come from anywhere, so their YAML is read as strictly as a configuration.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import yaml

from sweeps.errors import ConfigError
from sweeps.text import shortened

#: Most levels of nesting accepted; a valid configuration has four.
DEEPEST = 16

#: What PyYAML says of frequent faults, and what is said in its place.
_IN_WORDS = {
    "'\\t'": "there is a tab; indent with spaces",
    "mapping values": "a key cannot stand here; before it, a colon or the space after one is "
    "missing, or a text with a colon needs quotes",
    "<block mapping start>": "this key does not go on with what is before it; keys of the same "
    "mapping need the same indentation",
    "escape": "in double quotes a backslash begins an escape; use single quotes",
}


class _Loader(yaml.SafeLoader):
    """A loader that refuses aliases, tags and too deep nesting."""

    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Compose a node as PyYAML does, unless it is refused."""
        event = self.peek_event()
        problem = ""
        if isinstance(event, yaml.AliasEvent) or getattr(event, "tag", None):
            problem = "aliases and tags are not allowed"
        elif self._depth == DEEPEST:
            problem = f"more than {DEEPEST} levels are not allowed"
        if problem:
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=event.start_mark)
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node


def yaml_node(text: str, origin: str) -> yaml.Node | None:
    """Return the node of a YAML text, whose scalars keep what was typed; None if it is empty."""
    return _read(yaml.compose, text, origin)


def yaml_mapping(text: object, origin: str) -> dict[str, Any]:
    """Return the mapping that the YAML in a file of a sweep holds; raise ConfigError otherwise."""
    data = _read(yaml.load, str(text), origin)
    if not isinstance(data, dict):
        raise ConfigError(f"{origin}: not a mapping of keys")
    return {str(key): value for key, value in data.items()}


def _read(function: Callable[..., Any], text: str, origin: str) -> Any:
    """Read a text with a function of PyYAML; raise ConfigError for what it refuses."""
    try:
        return function(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        problem = str(error.problem)
        problem = next((words for sign, words in _IN_WORDS.items() if sign in problem), problem)
        problem = f"{error.context}, {problem}" if problem.startswith("but ") else problem
        raise ConfigError(f"{origin}{place}: not valid YAML: {problem}") from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        problem = f"it has the character {chr(error.character)!a}, which is not allowed"
        raise ConfigError(f"{origin}, line {line}: not valid YAML: {problem}") from None
    except (ValueError, OverflowError) as error:  # of the escapes "\\U00110000", "\\UFFFFFFFF"
        raise ConfigError(f"{origin}: not valid YAML: {shortened(str(error), 300)}") from None
