"""The words of the page: labels of axes in plain Unicode."""

from __future__ import annotations

import math
from collections.abc import Mapping

from sweeps.plotting.labels import as_variable, label

#: The page has no formulas: they would need a typesetter of a megabyte.
_LETTERS = {
    r"\omega": "ω", r"\sigma": "σ", r"\lambda": "λ", r"\pi": "π", r"\dot{x}^{-}": "ẋ⁻",
    r"\dot{x}": "ẋ", r"\mathrm{mod}": "mod", r"\approx": "≈", "~": " ", "\t": "", "_0": "₀",
    "_1": "₁", "^2": "²", "$": "",
}  # fmt: skip


def plain(text: str) -> str:
    """Return a text without the marks of its formulas."""
    for formula, letters in _LETTERS.items():
        text = text.replace(formula, letters)
    return text


def symbol(name: str) -> str:
    """Return the symbol of a parameter or of a variable of the file."""
    return plain(as_variable(name).attrs["symbol"])


def axis_label(name: str, units: Mapping[str, str], pixels: float = math.inf) -> str:
    """Return the meaning, the symbol and the unit of a parameter or of a variable of the file.

    Where they need more pixels than there are, the meaning is left out.
    """
    variable = as_variable(name, units)
    text = plain(label(variable))
    return text if 7.0 * len(text) < pixels else text.removeprefix(variable.long_name).strip()
