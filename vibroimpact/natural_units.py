"""Natural units: a length and a time that are powers of two, near those of a motion.

Eq. (1) contains one length and one time. A number divided by a power of two keeps its mantissa, so
the conversion into natural units and back is exact. What is computed between does not depend on the
units in which the numbers were given, to the last bit, and tolerances there are pure numbers.
Convert where a public function begins and where it ends, with one unit for all points that are
compared with each other::

    units = NaturalUnits.of(points)
    x, v = units.into("length", x), units.into("length/time", v)
    found = ...  # from units.points_into(points), x and v
    return units.out_of("length", found)
"""

from __future__ import annotations

import re
from dataclasses import fields
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

        The greatest omega is 1 to 2, and so is the greatest extent of a motion,
        max((f + a omega^2) / (omega^2 + 2 h omega + p^2), |clearance|). Without force and clearance
        it is that of the starts.
        """
        f, a, clearance = (points[name] for name in ("f", "a", "clearance"))
        time = 1 - _exponent(points["omega"])
        # The terms of the extent are first scaled by the greatest of them: so they never overflow.
        terms = (f, 2 * time), (a, 0), (clearance, 0)
        if not any(term.any() for term, _ in terms):
            terms = (points["x0"], 0), (points["v0"], time), (np.zeros(1), 0)
            return cls(_greatest(terms) - 1, time)
        scale = _greatest(terms)
        with np.errstate(over="ignore"):
            h, omega, p = (np.ldexp(points[name], time) for name in ("h", "omega", "p"))
            f, a, clearance = (np.ldexp(term, shift - scale) for term, shift in terms)
            extent = (f + a * omega * omega) / (omega * omega + 2.0 * h * omega + p * p)
        extent = np.maximum(extent, np.abs(clearance))
        return cls(scale + (_exponent(extent) if extent.any() else 0) - 1, time)

    def into(self, unit: str, values: Any) -> Any:
        """Return numbers with a unit in terms of ``length`` and ``time`` in natural units.

        >>> NaturalUnits(length=-10, time=3).into("length/time^2", 1.0)
        65536.0
        """
        return np.ldexp(values, -self._exponent_of(unit))

    def out_of(self, unit: str, values: Any) -> Any:
        """Return numbers in natural units in the units of the user, as `into`."""
        return np.ldexp(values, self._exponent_of(unit))

    def points_into(self, points: np.ndarray) -> np.ndarray:
        """Return parameter points of dtype ``POINT`` in natural units."""
        points = points.copy()
        for name, parameter in PARAMETERS.items():
            points[name] = self.into(parameter.unit, points[name])
        return points

    def oscillator_into(self, osc: Oscillator) -> Oscillator:
        """Return an oscillator in natural units."""
        return Oscillator(*(self.into(PARAMETERS[n].unit, getattr(osc, n)) for n in _NAMES))

    def oscillator_out_of(self, osc: Oscillator) -> Oscillator:
        """Return an oscillator in natural units in the units of the user."""
        return Oscillator(*(self.out_of(PARAMETERS[n].unit, getattr(osc, n)) for n in _NAMES))

    def _exponent_of(self, unit: str) -> int:
        """Return the binary exponent of a unit such as ``length/time^2``."""
        above, _, below = unit.partition("/")
        return self._power(above) - self._power(below)

    def _power(self, product: str) -> int:
        exponents = {"length": self.length, "time": self.time}
        powers = re.findall(r"(length|time)(?:\^(\d+))?", product)
        return sum(exponents[base] * int(power or 1) for base, power in powers)


_NAMES = [field.name for field in fields(Oscillator)]


def _exponent(values: np.ndarray) -> int:
    """Return e where the greatest absolute value is 1/2 to 1 times 2^e."""
    return int(np.frexp(np.abs(values).max())[1])


def _greatest(terms: tuple[tuple[np.ndarray, int], ...]) -> int:
    """Return the exponent of the greatest of some terms, each with a shift of its exponent."""
    return max((_exponent(term) + shift for term, shift in terms if term.any()), default=1)
