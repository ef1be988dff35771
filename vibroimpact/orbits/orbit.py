"""`PeriodicOrbit`, given by its impacts: multipliers, states at a section; the free orbit.

The sum of the multipliers is -c1 / c2, with det J(mu) = c0 + c1 mu + c2 mu^2
(``unknowns.py``). Their product is known: R^(2q) exp(-4 pi h m / omega). So the smaller multiplier
loses no digits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from vibroimpact.natural_units import NaturalUnits
from vibroimpact.orbits import calls
from vibroimpact.orbits.corrector import CONDITIONS, System
from vibroimpact.orbits.normal_form import cubic_coefficient
from vibroimpact.orbits.unknowns import unknowns
from vibroimpact.oscillator import PARAMETERS, Oscillator, point_of
from vibroimpact.step.integrators import Parameters
from vibroimpact.step.propagator import steady_response

#: The parameters of an oscillator; the numbers of a ``POINT`` begin with them.
NAMES = [field.name for field in fields(Oscillator)]
#: The units of the numbers of a ``POINT``.
_UNITS = tuple(parameter.unit for parameter in PARAMETERS.values())
#: A natural vibration repeats if its turns are a whole number, to this share.
_REPEATS = 1e-9
#: Indices of all numbers of a ``POINT``, which are free parameters here, and their spans.
_ALL_FREE, _ONES = np.arange(len(_UNITS)), np.ones(len(_UNITS))


@dataclass(frozen=True, eq=False)
class PeriodicOrbit:
    """A periodic orbit, given by its impacts.

    Attributes
    ----------
    oscillator : Oscillator
    m : int
        Forcing periods per repetition.
    phases : ndarray, shape (q,)
        omega t of the impacts, increasing, over less than 2 pi m; the first is in [0, 2 pi).
    speeds : ndarray, shape (q,)
        Speeds before the impacts [length/time], >= 0; zero where an impact grazes.
    kind : str
        The bifurcation at which it is known to be; empty if none.

    Examples
    --------
    >>> from vibroimpact import Oscillator, one_impact_orbit
    >>> orbit = one_impact_orbit(Oscillator(h=0.1, R=0.8, omega=2.7, f=1.0))
    >>> orbit.m, orbit.q, orbit.speeds.round(6), orbit.stable
    (1, 1, array([0.399905]), False)
    """

    oscillator: Oscillator
    m: int
    phases: np.ndarray
    speeds: np.ndarray
    kind: str = ""

    @property
    def q(self) -> int:
        """Impacts per repetition; 0 for the free oscillation."""
        return len(self.phases)

    @property
    def v(self) -> float:
        """Speed before the first impact [length/time]; NaN for the free oscillation."""
        return float(self.speeds[0]) if self.q else math.nan

    @property
    def phase(self) -> float:
        """omega t of the first impact; NaN for the free oscillation."""
        return float(self.phases[0]) if self.q else math.nan

    @cached_property
    def exists(self) -> bool:
        """Whether it is proved to stay below the stop between its impacts.

        False for a solution of the impact conditions that passes the stop; only
        `one_impact_orbits` returns such orbits.
        """
        o = self.oscillator
        if self.q == 0:
            return abs(free_amplitude(o)) < o.clearance
        meets = calls.first_penetration(*self.equations)[0] >= 0
        return not meets and float(self.speeds.min()) >= 0.0

    @cached_property
    def multipliers(self) -> np.ndarray:
        """Both Floquet multipliers, complex, the larger first; infinite at a graze or overflow.

        Of an orbit known to be at a flip or fold, the larger is exactly -1 or 1.
        """
        return self.alone.multipliers[0]

    @cached_property
    def criticality(self) -> str:
        """``supercritical`` or ``subcritical`` of an orbit known to be at a flip; empty otherwise.

        Orbits of twice the period are stable at a supercritical flip, and unstable at a subcritical
        one, at which a motion jumps to another attractor. Empty also if no energy is lost, and so
        near a graze that the multiplier has no digits.

        Examples
        --------
        >>> from vibroimpact import Oscillator, branch, one_impact_orbit
        >>> orbit = one_impact_orbit(Oscillator(h=0.1, R=0.8, omega=2.4, f=1.0))
        >>> branch(orbit, "omega", 2.3, 3.2).special[1].orbit.criticality
        'supercritical'
        """
        sign = cubic_coefficient(*self.equations) if self.kind == "flip" else math.nan
        return "supercritical" if sign > 0.0 else "subcritical" if sign < 0.0 else ""

    @property
    def alone(self) -> Orbits:
        """The orbit as arrays."""
        point = point_of(self.oscillator)
        return Orbits(point, self.m, self.phases[None], self.speeds[None], self.kind)

    @cached_property
    def equations(self) -> tuple[System, np.ndarray]:
        """Its equations and its vector of unknowns, in which all parameters are free."""
        system, (X,) = self.alone.equations
        return system, X

    @property
    def stable(self) -> bool:
        """Whether the orbit exists and both multipliers are inside the unit circle."""
        return bool(np.all(np.abs(self.multipliers) < 1.0)) and self.exists

    @property
    def x_min(self) -> float:
        """Least displacement [length], to rounding."""
        if not self.q:
            return -abs(free_amplitude(self.oscillator))
        return float(self._turns.min(initial=self.oscillator.clearance))

    @property
    def x_max(self) -> float:
        """Greatest displacement [length], to rounding: the clearance, if there are impacts."""
        if not self.q:
            return abs(free_amplitude(self.oscillator))
        clearance = self.oscillator.clearance
        return clearance if self.exists else float(self._turns.max(initial=clearance))

    @cached_property
    def _turns(self) -> np.ndarray:
        """The displacements at which the mass turns within its flights."""
        heights = [calls.turning_points(*self.equations, i)[:, 1] for i in range(self.q)]
        units = NaturalUnits.of(point_of(self.oscillator))
        heights = units.out_of("length", np.concatenate(heights))
        return np.asarray(heights) + self.oscillator.clearance

    def sections(self, phase: float = 0.0) -> np.ndarray:
        """Return x and v at omega t = `phase` mod 2 pi, in time order, shape (m, 2).

        For an impact at `phase` itself this is the state after it.

        Examples
        --------
        >>> from vibroimpact import Oscillator, one_impact_orbit
        >>> one_impact_orbit(Oscillator(h=0.1, R=0.8, omega=2.3, f=1.0)).sections().round(6)
        array([[-0.553435,  1.296107]])
        """
        return self.alone.sections(phase)[0]


class Orbits(NamedTuple):
    """Orbits of one class as arrays."""

    points: np.ndarray  # their oscillators, of dtype ``POINT``, (n,)
    m: int
    phases: np.ndarray  # of the impacts, increasing, (n, q)
    speeds: np.ndarray  # (n, q)
    kind: str = ""  # the bifurcation at which all of them are known to be

    @classmethod
    def along(
        cls, osc: Oscillator, names: Sequence[str], at: np.ndarray, m: int, *others: Any
    ) -> Self:
        """Return orbits of oscillators that differ in some parameters; `at` are these, (n, k)."""
        points = point_of(osc).repeat(len(at))
        for name, values in zip(names, at.T, strict=True):
            points[name] = values
        return cls(points, m, *others)

    def sections(self, phase: float) -> np.ndarray:
        """Return x and v as ``PeriodicOrbit.sections``, shape (n, m, 2)."""
        at = phase % (2.0 * math.pi) + 2.0 * math.pi * np.arange(self.m)
        if not self.phases.shape[1]:
            oscillators = (Oscillator(*row[: len(NAMES)]) for row in self.points.tolist())
            amplitudes = np.array([*map(free_amplitude, oscillators)])
            responses = amplitudes[:, None] * np.exp(1j * at)
            v = self.points["omega"][:, None] * responses.real
            return np.stack([responses.imag, v], axis=2)
        x, v = np.moveaxis(calls.sections(*self.equations, phase), 2, 0)
        units = NaturalUnits.of(self.points)
        return np.stack([units.out_of("length", x), units.out_of("length/time", v)], axis=2)

    @property
    def equations(self) -> tuple[System, np.ndarray]:
        """Their equations and their vectors of unknowns, in which all parameters are free."""
        q, condition = self.phases.shape[1], CONDITIONS[self.kind]
        system = System(_ONES, _ALL_FREE, _ONES, self.m, q, condition, 0, False, np.zeros(1))
        units = NaturalUnits.of(self.points)
        z = np.stack([self.phases, units.into("length/time", self.speeds)], axis=-1)
        return system, unknowns(z, numbers_in(units, self.points))

    @property
    def multipliers(self) -> np.ndarray:
        """Their Floquet multipliers as ``PeriodicOrbit.multipliers``, shape (n, 2)."""
        if not self.phases.shape[1]:
            h, omega, p = (self.points[name] for name in ("h", "omega", "p"))
            rate = np.sqrt(h * h - p * p + 0.0j)
            times = 2.0 * math.pi * self.m / omega
            return np.exp((np.stack([rate, -rate]) - h) * times).T
        pairs = calls.multipliers(*self.equations)
        if self.kind not in ("flip", "fold"):
            pairs[~self.speeds.all(axis=1)] = math.inf, 0.0
        return pairs


def orbit_of(
    osc: Oscillator, m: int, phases: np.ndarray, speeds: np.ndarray, kind: str = ""
) -> PeriodicOrbit:
    """Return the orbit with these impacts, shifted so that the first is in [0, 2 pi)."""
    turns = np.floor(phases / (2.0 * math.pi))
    within = phases - 2.0 * math.pi * m * np.floor(turns / m)
    order = np.argsort(within, kind="stable")
    within, speeds = within[order], speeds[order]
    within = within - 2.0 * math.pi * math.floor(within[0] / (2.0 * math.pi))
    return PeriodicOrbit(osc, m, within, speeds, kind)


def doubled_orbit(orbit: PeriodicOrbit) -> PeriodicOrbit:
    """Return an orbit as one of twice the period."""
    phases = np.concatenate([orbit.phases, orbit.phases + 2.0 * math.pi * orbit.m])
    return PeriodicOrbit(orbit.oscillator, 2 * orbit.m, phases, np.tile(orbit.speeds, 2))


def numbers_in(units: NaturalUnits, points: np.ndarray) -> np.ndarray:
    """Return the numbers of points of dtype ``POINT`` in natural units, a row for each."""
    rows: np.ndarray = units.into(_UNITS, points.view(float).reshape(len(points), len(_UNITS)))
    return rows


def free_orbit(osc: Oscillator) -> PeriodicOrbit:
    """Return the steady motion without impacts."""
    return PeriodicOrbit(osc, 1, np.empty(0), np.empty(0))


def free_amplitude(osc: Oscillator) -> complex:
    """Return A of the steady motion without impacts, x = Im A exp(i omega t); inf at resonance."""
    response = steady_response.py_func  # not worth compiling
    pt = replace(osc, f=osc.force, a=0.0)
    return complex(response(pt, 1.0, 0.0)[0], response(pt, 0.0, 1.0)[0])


def repeats_freely(osc: Oscillator | Parameters, m: int) -> bool:
    """Whether every natural vibration repeats after m forcing periods; it does so undamped only."""
    turns = m * osc.p / osc.omega
    return osc.h == 0.0 and abs(turns - round(turns)) < _REPEATS * turns
