"""Checks of the arguments of public functions, in the words of the command line."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from numbers import Integral, Real
from pathlib import Path
from typing import NamedTuple

from sweeps.errors import Refused
from sweeps.text import shortened


class Allowed(NamedTuple):
    """What an argument may be."""

    fits: Callable[[object], bool]
    expected: str


def require(name: str, value: object, allowed: Allowed) -> None:
    """Raise Refused, with the value and what is allowed, if an argument does not fit."""
    if not allowed.fits(value):
        raise Refused(
            f"{name} = {shortened(repr(value))} is not allowed; expected: {allowed.expected}"
        )


def require_all(arguments: Mapping[str, object], allowed: Mapping[str, Allowed]) -> None:
    """Check those arguments of which `allowed` has the name."""
    for name, value in arguments.items():
        if name in allowed:
            require(name, value, allowed[name])


def integer(least: int, most: float = math.inf) -> Allowed:
    """Allow integers from `least` to `most`."""

    def fits(value: object) -> bool:
        whole = isinstance(value, Integral) and not isinstance(value, bool)
        return whole and least <= value <= most  # type: ignore[operator]

    named = f">= {least:,}" if most == math.inf else f"from {least:,} to {most:,}"
    return Allowed(fits, f"an integer {named}")


def is_number(value: object) -> bool:
    """Whether a value is a finite real number, of Python or of NumPy."""
    return not isinstance(value, bool) and isinstance(value, Real) and math.isfinite(value)


def is_path(value: object) -> bool:
    """Whether a value is the name of a file."""
    return isinstance(value, str | Path)


FLAG = Allowed(lambda value: isinstance(value, bool), "True or False")
TEXT = Allowed(lambda value: isinstance(value, str), "a text")
PATH = Allowed(is_path, "the path of a file")
