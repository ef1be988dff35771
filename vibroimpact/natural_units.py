"""`NaturalUnits`: powers of two near the length and time of a motion.

Eq. (1) contains one length and one time. A number divided by a power of two keeps its mantissa, so
the conversion into natural units and back is exact. What is computed between does not depend on the
units in which the numbers were given, to the last bit, and tolerances there are pure numbers.
Convert where a public function begins and where it ends, with one unit for all points that are
compared with each other::

    units = NaturalUnits.of(points)
    x, v = units.into("length", x), units.into("length/time", v)
    found = ...  # from units.oscillator_into(osc), x and v
    return units.out_of("length", found)
"""

from __future__ import annotations

import math
import re
from dataclasses import fields
from functools import cache
from typing import Any, NamedTuple, Self

import numpy as np

from vibroimpact.oscillator import PARAMETERS, Oscillator


class NaturalUnits(NamedTuple):
    """The binary exponents of a unit of length and of a unit of time."""

    length: int
    time: int

    @classmethod
    def of(cls, points: np.ndarray) -> Self:
        """Return the units for the motions at parameter points of dtype ``POINT``, shape (n,).

        In these units the greater of omega and p is 1 to 2, and the extent of a motion,
        (f + a omega^2 + p^2 |clearance|) / (omega^2 + 2 h omega + p^2), is 1/2 to 1; of several
        points these are the greatest values. Without force and clearance the extent is that of the
        starts.
        """
        f, a, clearance = (points[name] for name in ("f", "a", "clearance"))
        time = 1 - max(_exponent(points["omega"]), _exponent(points["p"]))
        # The numerator is first divided by the greatest of these, so that it does not overflow.
        greatest = _greatest((f, 2 * time), (a, 0), (clearance, 0))
        if greatest is None:
            return cls(_greatest((points["x0"], 0), (points["v0"], time)) or 0, time)
        with np.errstate(all="ignore"):
            h, omega, p = (np.ldexp(points[name], time) for name in ("h", "omega", "p"))
            push = np.ldexp(f, 2 * time - greatest) + np.ldexp(a, -greatest) * omega * omega
            push += np.ldexp(np.abs(clearance), -greatest) * p * p
            extent = push / (omega * omega + 2.0 * h * omega + p * p)
        return cls(greatest + _exponent(extent), time)

    def into(self, unit: str | tuple[str, ...], values: Any) -> Any:
        """Return numbers with a unit in terms of ``length`` and ``time`` in natural units.

        Several units are those of the columns of an array.

        >>> NaturalUnits(length=-10, time=3).into("length/time^2", 1.0)
        65536.0
        """
        return np.ldexp(values, -self._exponent_of(unit))

    def out_of(self, unit: str | tuple[str, ...], values: Any) -> Any:
        """Return numbers in natural units in the units of the user, as `into`."""
        return np.ldexp(values, self._exponent_of(unit))

    def oscillator_into(self, osc: Oscillator) -> Oscillator:
        """Return an oscillator in natural units."""
        return Oscillator(*self.into(_UNITS, [getattr(osc, name) for name in _NAMES]))

    def _exponent_of(self, unit: str | tuple[str, ...]) -> Any:
        """Return the binary exponent of a unit, or those of several units."""
        length, time = _powers_in(unit)
        return length * self.length + time * self.time


_NAMES = [field.name for field in fields(Oscillator)]
_UNITS = tuple(PARAMETERS[name].unit for name in _NAMES)


@cache
def _powers_in(unit: str | tuple[str, ...]) -> tuple[Any, Any]:
    """Return the powers of length and of time in a unit such as ``length/time^2``."""
    if not isinstance(unit, str):
        lengths, times = zip(*map(_powers_in, unit), strict=True)
        return np.array(lengths), np.array(times)
    powers, sides = {"length": 0, "time": 0}, unit.split("/")
    for side, sign in zip(sides, (1, -1), strict=False):
        for base, power in re.findall(r"(length|time)(?:\^(\d+))?", side):
            powers[base] += sign * int(power or 1)
    return powers["length"], powers["time"]


def _exponent(values: np.ndarray) -> int:
    """Return e where the greatest absolute value is 1/2 to 1 times 2^e; 0 if it is 0."""
    return math.frexp(max(values.max(initial=0.0), -values.min(initial=0.0)))[1]


def _greatest(*terms: tuple[np.ndarray, int]) -> int | None:
    """Return the exponent of the greatest of some terms, each with a shift; None if all are 0."""
    return max((_exponent(term) + shift for term, shift in terms if term.any()), default=None)
