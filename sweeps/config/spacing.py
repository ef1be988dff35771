"""The values of a range, each the floating-point number nearest to the true one.

The true values are those of the decimal numbers that were typed. Up to `_FEW` values are computed
exactly. Of more, each is the sum or product of the head of its row and a value of the first row,
with twice the digits of a float (Dekker (1971), Numer. Math. 18, 224-242), and is computed exactly
where these digits do not tell in which direction to round.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from decimal import Context, Decimal, localcontext
from fractions import Fraction
from itertools import accumulate, repeat
from operator import mul
from typing import TypeVar

import numpy as np

Digits = TypeVar("Digits", Fraction, Decimal)

#: Number of values in a row.
_ROW = 4096
#: Most values that are all computed exactly, which takes as long as the first row of more.
_FEW = 32768
#: A stop is a value of a range if it lies within this share of a step.
_NEAR = Fraction(1, 1000)
#: Computes the values of a geometric series; after all its products 30 digits are still right.
_SERIES = Context(prec=40)
#: Makes powers of ten exact: 1e23 lies halfway between two floating-point numbers.
_ROUNDED = Context(prec=30)
#: Bound of the error of a sum or product of scaled pairs, which are below 1.
_ERROR = 2.0**-97
#: Numbers with a smaller exponent have fewer bits.
_LEAST_EXPONENT = -960
#: Splits a float into two halves, whose products are exact.
_HALVES = 2.0**27 + 1.0


def linear(start: float, stop: float, num: int) -> np.ndarray:
    """Return an arithmetic series, shape (num,); its ends are exactly `start` and `stop`."""
    first, last = Fraction(repr(start)), Fraction(repr(stop))
    step = (last - first) / max(num - 1, 1)
    scale = math.lcm(first.denominator, step.denominator)
    begin, rise = int(first * scale), int(step * scale)
    exponent = math.frexp(max(abs(start), abs(stop)))[1]

    def exact(i: int) -> float:
        return (begin + i * rise) / scale  # the quotient of two integers is rounded once

    if num <= _FEW or exponent < _LEAST_EXPONENT:
        return np.fromiter(map(exact, range(num)), float, num)
    unit, values = Fraction(2) ** exponent, np.empty(num)
    fine, fine_rest = _pairs([k * step / unit for k in range(_ROW)])
    heads, rests = _pairs([(first + row * step) / unit for row in range(0, num, _ROW)])
    for n, (head, rest) in enumerate(zip(heads, rests, strict=True)):
        high = head + fine
        part = high - head
        low = (head - (high - part)) + (fine - part) + (rest + fine_rest)
        _fill(values, n, high, low, np.full(_ROW, exponent), exact)
    return values


def steps_to(start: float, stop: float, step: float) -> tuple[float, int]:
    """Return the last value and the number of values from `start` in steps towards `stop`.

    The last value is `stop` if it lies within a thousandth of a step, so that rounding never
    decides whether it is included; otherwise the last one before it. The numbers are taken as the
    decimal ones that were typed. ValueError if no step leads from `start` towards `stop`.
    """
    first, end, rise = (Fraction(repr(value)) for value in (start, stop, step))
    if not rise:
        raise ValueError("has step: 0, which leads nowhere")
    steps = (end - first) / rise
    if steps < 0:
        raise ValueError(f"has a step that leads away from stop; did you mean step: {-step:.12g}?")
    whole = round(steps)
    if abs(steps - whole) <= _NEAR:
        last = stop
    else:
        whole = math.floor(steps)
        last = float(first + whole * rise)
    if not whole and steps:
        raise ValueError("has a step longer than the way from start to stop")
    return last, whole + 1


def geometric(start: float, stop: float, num: int) -> np.ndarray:
    """Return a geometric series, shape (num,); its ends are exactly `start` and `stop`.

    The powers of NumPy have other bits on other machines; decimal numbers have the same.
    """
    with localcontext(_SERIES):
        first, last = Decimal(repr(start)), Decimal(repr(stop))
        ratio = ((last / first).ln() / max(num - 1, 1)).exp()
        powers = list(accumulate(repeat(ratio, min(num, _ROW) - 1), mul, initial=Decimal(1)))
        growth = repeat(powers[-1] * ratio, (num - 1) // _ROW)
        rows = list(accumulate(growth, mul, initial=first))
        values = np.empty(num)

        def exact(i: int) -> float:
            return float(_ROUNDED.plus(rows[i // _ROW] * powers[i % _ROW]))

        if num <= _FEW:
            values[:] = [exact(i) for i in range(num)]
        else:
            (fine, fine_rest), fine_exponents = _scaled(powers)
            halves = _halves(fine)
            (heads, rests), exponents = _scaled(rows)
            for n, (head, rest) in enumerate(zip(heads, rests, strict=True)):
                high = head * fine
                (a, b), (c, d) = _halves(head), halves
                low = ((a * c - high) + a * d + b * c) + b * d + (head * fine_rest + rest * fine)
                _fill(values, n, high, low, exponents[n] + fine_exponents, exact)
    values[-1] = stop
    return values


def _pairs(numbers: Sequence[Digits]) -> tuple[np.ndarray, np.ndarray]:
    """Return each number as the sum of a float and a much smaller one, shape (n,) each."""
    high = [float(number) for number in numbers]
    low = [float(number - type(number)(near)) for number, near in zip(numbers, high, strict=True)]
    return np.array(high), np.array(low)


def _scaled(numbers: Sequence[Decimal]) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Return the pairs of numbers divided by powers of two, to 0.01 to 1; also their exponents."""
    exponents = [int(number.adjusted() * math.log2(10.0)) + 4 for number in numbers]
    scaled = [
        number / Decimal(2) ** power for number, power in zip(numbers, exponents, strict=True)
    ]
    return _pairs(scaled), np.array(exponents)


def _halves(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Split values into two halves of their bits each."""
    scaled = _HALVES * values
    upper = scaled - (scaled - values)
    return upper, values - upper


def _fill(
    values: np.ndarray,
    row: int,
    high: np.ndarray,
    low: np.ndarray,
    exponents: np.ndarray,
    exact: Callable[[int], float],
) -> None:
    """Fill a row with the sums of pairs times powers of two, each rounded once."""
    begin = row * _ROW
    filled = values[begin : begin + _ROW]
    least, most = (high + (low + error) for error in (-_ERROR, _ERROR))
    filled[:] = np.ldexp(least[: filled.size], exponents[: filled.size])
    unsure = (least != most) | (exponents < _LEAST_EXPONENT)
    for k in np.flatnonzero(unsure[: filled.size]).tolist():
        values[begin + k] = exact(begin + k)
