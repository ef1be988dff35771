"""A periodic orbit given by its impacts, with its Floquet multipliers and its states at a section.

The sum of the multipliers is -c1 / c2, with det J(mu) = c0 + c1 mu + c2 mu^2
(``linear.py``). Their product is known: R^(2q) exp(-4 pi h m / omega). So the smaller multiplier
loses no digits.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vibroimpact.destination.free_motion import steady_response
from vibroimpact.orbits import calls
from vibroimpact.orbits.corrector import NONE, System
from vibroimpact.orbits.flights import values_of
from vibroimpact.orbits.unknowns import unknowns
from vibroimpact.oscillator import Oscillator
from vibroimpact.step.integrators import Parameters

_NONE_FREE, _NO_PARAMETERS = np.empty(0, np.int64), np.empty(0)


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
        """Both Floquet multipliers, complex, the larger first; infinite at a graze or overflow."""
        o = self.oscillator
        if self.q == 0:
            rate = np.sqrt(complex(o.h * o.h - o.p * o.p))
            times = 2.0 * math.pi * self.m / o.omega
            return np.exp((-o.h + np.array([rate, -rate])) * times)
        if not self.speeds.all():
            return np.array([math.inf, 0.0], complex)
        _, c1, c2 = self.characteristic
        trace = -c1 / c2 if c2 else math.inf
        return multipliers_of(trace, determinant(o.h, o.R, o.omega, self.m, self.q))

    @cached_property
    def characteristic(self) -> tuple[float, float, float]:
        """c0, c1, c2 of c0 + c1 mu + c2 mu^2, whose roots are the multipliers, also at a graze."""
        return calls.characteristic(*self.equations)

    @cached_property
    def equations(self) -> tuple[System, np.ndarray]:
        """Its equations and its vector of unknowns."""
        X, speed = scaled(self)
        return system_of(self.oscillator, self.m, self.q, speed), X

    @property
    def stable(self) -> bool:
        """Whether the orbit exists and both multipliers are inside the unit circle."""
        return bool(np.all(np.abs(self.multipliers) < 1.0)) and self.exists

    def sections(self, phase: float = 0.0) -> np.ndarray:
        """Return x and v at omega t = `phase` mod 2 pi, in time order, shape (m, 2).

        For an impact at `phase` itself this is the state after it.

        >>> from vibroimpact import Oscillator, one_impact_orbit
        >>> one_impact_orbit(Oscillator(h=0.1, R=0.8, omega=2.3, f=1.0)).sections().round(6)
        array([[-0.553435,  1.296107]])
        """
        at = phase % (2.0 * math.pi) + 2.0 * math.pi * np.arange(self.m)
        o = self.oscillator
        if self.q == 0:
            responses = [free_amplitude(o) * np.exp(1j * theta) for theta in at.tolist()]
            return np.array([(response.imag, o.omega * response.real) for response in responses])
        phases, turn, after = self.phases.tolist(), 2.0 * math.pi * self.m, []
        for theta in at.tolist():  # in lists, which take less time than such short arrays
            theta = phases[0] + (theta - phases[0]) % turn
            i = bisect_right(phases, theta) - 1
            after.append((i, (theta - phases[i]) / o.omega))
        system, X = system_of(o, self.m, self.q, 1.0), _vector(self.phases, self.speeds)
        states = calls.states_after(system, X, np.array(after)).tolist()
        return np.array([(min(y + o.clearance, o.clearance), u) for y, u, _ in states])


def determinant(h: float, R: float, omega: float, m: int, q: int) -> float:
    """Return the determinant of the monodromy matrix of an orbit m/q."""
    return R ** (2 * q) * math.exp(-4.0 * math.pi * h * m / omega)


def multipliers_of(trace: float, determinant: float) -> np.ndarray:
    """Return the eigenvalues of a 2 x 2 matrix, complex, the larger first."""
    discriminant = trace * trace - 4.0 * determinant
    root = math.copysign(math.sqrt(abs(discriminant)), trace)
    if discriminant < 0.0:
        return 0.5 * np.array([complex(trace, root), complex(trace, -root)])
    larger = 0.5 * (trace + root)
    return np.array([larger, determinant / larger if larger else 0.0], complex)


def orbit_of(osc: Oscillator, m: int, phases: np.ndarray, speeds: np.ndarray) -> PeriodicOrbit:
    """Return the orbit with these impacts, shifted so that the first is in [0, 2 pi)."""
    turns = np.floor(phases / (2.0 * math.pi))
    within = phases - 2.0 * math.pi * m * np.floor(turns / m)
    order = np.argsort(within, kind="stable")
    within, speeds = within[order], speeds[order]
    within = within - 2.0 * math.pi * math.floor(within[0] / (2.0 * math.pi))
    return PeriodicOrbit(osc, m, within, speeds)


def taken_twice(orbit: PeriodicOrbit) -> PeriodicOrbit:
    """Return an orbit as one of twice the period."""
    phases = np.concatenate([orbit.phases, orbit.phases + 2.0 * math.pi * orbit.m])
    return PeriodicOrbit(orbit.oscillator, 2 * orbit.m, phases, np.tile(orbit.speeds, 2))


def scaled(orbit: PeriodicOrbit) -> tuple[np.ndarray, float]:
    """Return the unknowns of an orbit, shape (2 q,), and the unit of speed."""
    speed = unit_of_speed(orbit.oscillator, orbit.speeds)
    return _vector(orbit.phases, orbit.speeds / speed), speed


def _vector(phases: np.ndarray, speeds: np.ndarray) -> np.ndarray:
    """Return the vector of unknowns without free parameters."""
    return unknowns(np.array([phases, speeds]).T, _NO_PARAMETERS)


def system_of(osc: Oscillator, m: int, q: int, speed: float) -> System:
    """Return the equations of orbits without free parameters."""
    return System(
        values_of(osc), _NONE_FREE, _NO_PARAMETERS, m, q, speed, NONE, 0, False, np.zeros(1)
    )


def unit_of_speed(osc: Oscillator, speeds: np.ndarray) -> float:
    """Return a typical speed of an orbit: its greatest, or the system's if that is greater."""
    largest = float(np.abs(speeds).max(initial=0.0))
    push = osc.force + osc.p * osc.p * abs(osc.clearance)
    return max(largest, push / (osc.p + osc.omega)) or 1.0


def linearised(orbit: PeriodicOrbit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return F, A and B of the flights (``flights.residuals``)."""
    return calls.linearised(*orbit.equations)


def free_orbit(osc: Oscillator) -> PeriodicOrbit:
    """Return the steady motion without impacts."""
    return PeriodicOrbit(osc, 1, np.empty(0), np.empty(0))


def free_amplitude(osc: Oscillator) -> complex:
    """Return A of the steady motion without impacts, x = Im A exp(i omega t); inf at resonance."""
    response = steady_response.py_func  # not worth compiling
    pt = Parameters(osc.h, osc.R, osc.omega, osc.force, osc.p, osc.clearance)
    return complex(response(pt, 1.0, 0.0)[0], response(pt, 0.0, 1.0)[0])
