"""Branches of one-impact orbits along one parameter, and where they flip, fold and graze.

The orbits at given values of the parameter are joined into pieces of one stability. Where the orbit
changes its stability, begins or ends between two of them, the bifurcation itself is found, and the
pieces are extended to it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise

import numpy as np

from vibroimpact.orbits.one_impact import (
    BIFURCATIONS,
    OneImpactOrbit,
    bifurcation,
    one_impact_orbits,
)
from vibroimpact.oscillator import Oscillator
from vibroimpact.step.integrators import exact


@dataclass(frozen=True)
class Piece:
    """A piece of a branch on which the orbit exists and keeps its stability.

    Attributes
    ----------
    stable : bool
    values : tuple of float
        Of the parameter, in order.
    orbits : tuple of OneImpactOrbit
        One for each value.
    """

    stable: bool
    values: tuple[float, ...]
    orbits: tuple[OneImpactOrbit, ...]


@dataclass(frozen=True)
class Mark:
    """A bifurcation on a branch: its kind, ``flip``, ``fold`` or ``graze``, value and orbit."""

    kind: str
    value: float
    orbit: OneImpactOrbit


@dataclass(frozen=True)
class Branches:
    """All one-impact orbits of `n` forcing periods along a parameter."""

    n: int
    pieces: tuple[Piece, ...]
    marks: tuple[Mark, ...]


def one_impact_branches(
    osc: Oscillator, parameter: str, values: Sequence[float], n: int = 1
) -> Branches:
    """Follow the one-impact orbits along a parameter.

    A bifurcation is found where the orbit's existence or stability differs between neighbouring
    values; two in one interval that undo each other are not seen. Of two orbits the slower, a
    saddle, is followed to its fold or to where its impact vanishes; its interior graze is not
    located.

    Parameters
    ----------
    osc : Oscillator
        All other parameters.
    parameter : str
        Name of a parameter of `osc`.
    values : sequence of float
        In increasing order.
    n : int
        Forcing periods per impact, >= 1.

    Returns
    -------
    Branches

    Raises
    ------
    ValueError
        If a value is not valid, or `n` is not an integer >= 1.
    """
    at = [one_impact_orbits(replace(osc, **{parameter: value}), n) for value in values]
    pieces: list[Piece] = []
    marks: dict[tuple[str, float], Mark] = {}
    for slower in (False, True):
        family = [_member(orbits, slower) for orbits in at]
        between = [
            list(_marks(osc, parameter, low, high, n, slower)) if _state(a) != _state(b) else []
            for (low, high), (a, b) in zip(pairwise(values), pairwise(family), strict=True)
        ]
        pieces += _pieces(values, family, between)
        marks |= {(mark.kind, mark.value): mark for found in between for mark in found}
    return Branches(n, tuple(pieces), tuple(sorted(marks.values(), key=lambda mark: mark.value)))


def sections(osc: Oscillator, orbit: OneImpactOrbit, phase: float) -> np.ndarray:
    """Return the states of an orbit at ωt = `phase` mod 2π, in the order after the impact.

    Returns
    -------
    ndarray, shape (n, 2)
        x and v. An impact at `phase` itself gives the state after it.
    """
    s, c, point = math.sin(orbit.phase), math.cos(orbit.phase), osc.at(osc.clearance)[0]
    first = (phase - orbit.phase) % (2.0 * math.pi) / osc.omega
    times = first + osc.forcing_period * np.arange(orbit.n)
    return np.array([exact(osc.clearance, -osc.R * orbit.v, s, c, float(t), point) for t in times])


def _member(orbits: Sequence[OneImpactOrbit], slower: bool) -> OneImpactOrbit | None:
    """Return the faster orbit, or the slower of two."""
    if slower:
        return orbits[0] if len(orbits) == 2 else None
    return orbits[-1] if orbits else None


def _state(orbit: OneImpactOrbit | None) -> str:
    if orbit is None or not orbit.exists:
        return ""
    return "stable" if orbit.stable else "unstable"


def _pieces(
    values: Sequence[float],
    family: Sequence[OneImpactOrbit | None],
    between: Sequence[Sequence[Mark]],
) -> Iterator[Piece]:
    """Join neighbours of the same state, and the bifurcations at the two ends."""
    for state, group in groupby(range(len(values)), key=lambda i: _state(family[i])):
        inside = list(group)
        if not state:
            continue
        before = between[inside[0] - 1][-1:] if inside[0] > 0 else []
        after = between[inside[-1]][:1] if inside[-1] < len(between) else []
        yield Piece(
            state == "stable",
            (
                *(mark.value for mark in before),
                *(values[i] for i in inside),
                *(mark.value for mark in after),
            ),
            (
                *(mark.orbit for mark in before),
                *(orbit for i in inside if (orbit := family[i]) is not None),
                *(mark.orbit for mark in after),
            ),
        )


def _marks(
    osc: Oscillator, parameter: str, low: float, high: float, n: int, slower: bool
) -> list[Mark]:
    """Find the bifurcations of the orbit between two values, in order."""

    def at(value: float) -> Oscillator:
        return replace(osc, **{parameter: value})

    def found(kind: str) -> float | None:
        ends = [BIFURCATIONS[kind](at(value), n) for value in (low, high)]
        if not ends[0] * ends[1] < 0.0:  # also NaN, where there is no orbit
            return None
        try:
            return bifurcation(osc, kind, parameter, low, high, n)
        except ValueError:  # a jump, or v < 0
            return None

    candidates = [(kind, found(kind)) for kind in (("fold",) if slower else BIFURCATIONS)]
    candidates.append(("graze", _touch(at, low, high)))
    marks = [
        _mark(kind, value, at, (low, high), n, slower)
        for kind, value in candidates
        if value is not None
    ]
    return sorted((mark for mark in marks if mark is not None), key=lambda mark: mark.value)


def _mark(
    kind: str,
    value: float,
    at: Callable[[float], Oscillator],
    ends: tuple[float, float],
    n: int,
    slower: bool,
) -> Mark | None:
    """Return a bifurcation with its orbit, which may be lost by rounding at the value itself."""
    for inside in (value, *(value + 1e-9 * (end - value) for end in ends)):
        orbit = _member(one_impact_orbits(at(inside), n), slower)
        # At a graze the peak is zero to rounding, on either side.
        if orbit is not None and orbit.peak <= 1e-6 * orbit.v / at(inside).omega:
            return Mark(kind, value, orbit)
    return None


def _touch(at: Callable[[float], Oscillator], low: float, high: float) -> float | None:
    """Return where the free oscillation touches the stop: an orbit's impact vanishes, v = 0.

    Its amplitude f / sqrt((p^2 - omega^2)^2 + 4 h^2 omega^2) is the clearance there.
    """

    def measure(value: float) -> float:
        o = at(value)
        rate = math.hypot(o.p * o.p - o.omega * o.omega, 2.0 * o.h * o.omega)
        return o.f - o.clearance * rate

    if not measure(low) * measure(high) < 0.0:
        return None
    from scipy.optimize import brentq

    return float(brentq(measure, low, high, xtol=1e-15 * max(abs(low), abs(high))))
