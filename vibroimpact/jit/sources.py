"""The name of code: it changes with what the code does, and not with comments and docstrings."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Mapping

_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def syntax(source: bytes) -> str:
    """Return the syntax tree of a source in words, without docstrings and places.

    Empty fields are left out, since newer versions of Python add some: so the text does not depend
    on the version, as that of ``ast.dump`` does.
    """
    return _shown(ast.parse(source))


def _shown(part: object) -> str:
    """Return a node, a list of nodes or a constant in words."""
    if isinstance(part, list):
        return f"[{', '.join(map(_shown, part))}]"
    if not isinstance(part, ast.AST):
        return repr(part)
    fields = dict(ast.iter_fields(part))
    if isinstance(part, _DOCUMENTED) and ast.get_docstring(part, clean=False) is not None:
        fields["body"] = part.body[1:]
    shown = (f"{name}={_shown(value)}" for name, value in fields.items() if value not in (None, []))
    return f"{type(part).__name__}({', '.join(shown)})"


def name_of(sources: Mapping[str, bytes], *others: str) -> str:
    """Return a digest of the code of `sources`, by their paths, and of the names of `others`."""
    trees = {path: syntax(source) for path, source in sources.items()}
    return hashlib.sha256(repr((others, trees)).encode()).hexdigest()[:16]
