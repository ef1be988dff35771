"""The words of the page: labels of axes in plain Unicode, and numbers for the eye."""

from __future__ import annotations

from sweeps.store import VARIABLES
from vibroimpact.oscillator import PARAMETERS

#: The page has no formulas: they would need a typesetter of a megabyte.
_LETTERS = {
    r"\omega": "ω", r"\sigma": "σ", r"\lambda": "λ", r"\pi": "π", r"\dot{x}^{-}": "ẋ⁻",
    r"\dot{x}": "ẋ", r"\mathrm{mod}": "mod", r"\ ": " ", "_0": "₀",
}  # fmt: skip


def plain(text: str) -> str:
    """Return a text without the marks of its formulas."""
    for formula, letters in _LETTERS.items():
        text = text.replace(formula, letters)
    return text.replace("$", "").replace("_1", "₁").replace(r"\approx", "≈")


def symbol(name: str) -> str:
    """Return the symbol of a parameter or of a variable of the file."""
    return plain((PARAMETERS[name] if name in PARAMETERS else VARIABLES[name]).symbol)


def axis_label(name: str) -> str:
    """Return the meaning, the symbol and the unit of a parameter or of a variable of the file."""
    if name in PARAMETERS:
        meaning, unit = PARAMETERS[name].meaning, PARAMETERS[name].unit
    else:
        meaning, unit = VARIABLES[name].long_name, VARIABLES[name].unit
    shown = "" if unit == "1" else f" [{unit.replace('^2', '²')}]"
    return f"{meaning} {symbol(name)}{shown}"
