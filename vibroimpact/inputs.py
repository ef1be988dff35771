"""Checks what a caller gives (numbers, flags, choices); words its refusal with near names.

Every door of both packages asks here whether a value is a number, an integer, a truth value or one
of several names, and says with the same words what is allowed.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Collection, Iterable, Sequence
from numbers import Integral, Real
from pathlib import Path
from typing import Any, NamedTuple

#: How NumPy writes what is in a list: np.int64(-1), np.str_('a'), np.True_.
_OF_NUMPY = re.compile(
    r"\bnp\.(?:(?!datetime|timedelta)[a-z]+[0-9_]*\((?P<value>[^()]*)\)|(?P<truth>True|False)_)"
)


#: Most words that are suggested; more that are equally similar are no hint.
_MOST_MEANT = 5


class Allowed(NamedTuple):
    """What a value may be."""

    fits: Callable[[object], bool]
    expected: str
    names: Collection[str] = ()

    def checked(self, name: str, value: object, error: type[Exception] = ValueError) -> Any:
        """Return a value, a number of NumPy as Python has it; raise `error` if it does not fit."""
        if not self.fits(value):
            meant = near_misses(value, self.names) if isinstance(value, str) else []
            given = f"{name} = {input_text(value)}"
            raise error(refusal(given, self.expected) + suggestion(meant))
        return of_python(value)


def refusal(given: str, expected: str) -> str:
    """Say that what was given is not allowed, and what is."""
    return f"{shortened(given, 200)} is not allowed; expected: {expected}"


def near_misses(name: str, valid: Iterable[str], least: float = 0.65) -> list[str]:
    """Return the valid words most similar to `name`, in order, whatever the case; none if many are.

    `least` is the smallest similarity accepted, as defined by `difflib`; by default, three letters
    or more that begin a word suffice, too.
    """
    typed, folded = name.casefold(), {word: word.casefold() for word in valid}
    alike = difflib.get_close_matches(typed, folded.values(), len(folded) or 1, least)
    ratios = {text: difflib.SequenceMatcher(None, text, typed).ratio() for text in alike}
    greatest, is_begun = max(ratios.values(), default=0.0), len(typed) > 2 and least < 0.7
    begun = [word for word, text in folded.items() if is_begun and text.startswith(typed)]
    meant = [word for word, text in folded.items() if ratios.get(text) == greatest] or begun
    return meant if len(meant) <= _MOST_MEANT else []


def suggestion(words: Sequence[str]) -> str:
    """Return " (did you mean A or B?)" to append to a refusal; "" without a word."""
    return f" (did you mean {' or '.join(words)}?)" if words else ""


def shortened(text: str, most: int = 80) -> str:
    """Put a text on one line, cut to at most `most` characters."""
    line = " ".join(text.split())
    return line if len(line) <= most else line[: most - 3] + "..."


def shown_count(number: float, noun: str, form: str = ",") -> str:
    """Write a number of things, for example 1 point, 1,200 points or 1 branch."""
    text = f"{number:{form}}"
    return f"{text} {noun}" if text == "1" else f"{text} {noun}{'es' * noun.endswith('ch') or 's'}"


def of_python(value: object) -> object:
    """Return a number of NumPy, or an array without dimensions, as Python has it."""
    if getattr(value, "ndim", None) == 0 and hasattr(value, "item"):
        hidden = _is_date(value) or bool(getattr(value, "mask", False))
        return value if hidden else value.item()
    return value


def _is_date(value: object) -> bool:
    """Whether a value is a date of NumPy or a difference of dates, which it has as integers."""
    return getattr(getattr(value, "dtype", None), "kind", "") in ("m", "M")


def real(value: object) -> float | None:
    """Return a real number as a float, infinite if it is too large for one; None if it is none."""
    value = of_python(value)
    if isinstance(value, bool) or _is_date(value) or not isinstance(value, Real):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf  # type: ignore[operator]


def is_number(value: object) -> bool:
    """Whether a value is a finite real number."""
    number = real(value)
    return number is not None and math.isfinite(number)


def number_meant(value: object) -> int | float | None:
    """Return the number that a value is or a text means, or None, as for 1_0 and other digits."""
    if not isinstance(value, str):
        return real(value)
    if "_" in value or not value.isascii():
        return None
    try:
        number = float(value)
    except ValueError:
        return None
    whole = number.is_integer() and abs(number) < 2**53 and str(number) != "-0.0"
    return int(number) if whole else number


def number(fits: Callable[[float], Any], expected: str) -> Allowed:
    """Allow finite numbers for which `fits` holds."""

    def fits_number(value: object) -> bool:
        given = real(value)
        return given is not None and math.isfinite(given) and bool(fits(given))

    return Allowed(fits_number, expected)


def integer(least: int, most: float = math.inf) -> Allowed:
    """Allow integers from `least` to `most`."""

    def fits(value: object) -> bool:
        whole = of_python(value)
        if isinstance(whole, bool) or not isinstance(whole, Integral):
            return False
        return least <= int(whole) <= most

    named = f">= {least:,}" if most == math.inf else f"from {least:,} to {most:,}"
    return Allowed(fits, f"an integer {named}")


def one_of(names: Collection[str]) -> Allowed:
    """Allow one of several words."""
    expected = f"one of {', '.join(names)}"
    return Allowed(lambda value: isinstance(value, str) and value in names, expected, names)


def refuse_other(name: str, value: object, kind: type) -> None:
    """Raise a TypeError if an argument is not of type `kind`."""
    if not isinstance(value, kind):
        raise TypeError(refusal(f"{name} = {input_text(value)}", f"the type {kind.__name__}"))


#: omega t, at a section or a start.
PHASE = number(lambda phase: 0.0 <= phase < 2.0 * math.pi, "a number >= 0 and < 2 pi")
FLAG = Allowed(lambda value: isinstance(of_python(value), bool), "True or False")
TEXT = Allowed(lambda value: isinstance(value, str), "a text")
PATH = Allowed(lambda value: isinstance(value, str | Path), "the path of a file")


def input_text(value: object) -> str:
    """Return the repr of a value on one line, shortened: -1, not np.int64(-1)."""
    try:
        text = _OF_NUMPY.sub(
            lambda found: found["value"] or found["truth"] or "", repr(of_python(value))
        )
    except ValueError:  # Python writes no integer of more than 4,300 digits
        text = f"an integer of {value.bit_length():,} bits" if isinstance(value, int) else "a value"
    except RecursionError:
        text = f"a {type(value).__name__} of too many levels"
    return shortened(text)
