"""Checks of the arguments of public functions: whether each is what it may be."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TypeGuard

from sweeps.errors import Refused
from vibroimpact.inputs import Allowed, input_text


def require(name: str, value: object, allowed: Allowed) -> None:
    """Raise Refused, with the value and what is allowed, if an argument does not fit."""
    if not allowed.fits(value):
        raise Refused(allowed.refusal(f"{name} = {input_text(value)}"))


def require_all(arguments: Mapping[str, object], allowed: Mapping[str, Allowed]) -> None:
    """Check those arguments of which `allowed` has the name."""
    for name, value in arguments.items():
        if name in allowed:
            require(name, value, allowed[name])


def is_path(value: object) -> TypeGuard[str | Path]:
    """Whether a value is the name of a file."""
    return isinstance(value, str | Path)


PATH = Allowed(is_path, "the path of a file")
