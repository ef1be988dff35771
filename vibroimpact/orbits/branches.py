"""`branch` from an orbit both ways along one parameter, also beyond a flip or graze; `Branch`.

A branch is continued from an orbit in both directions (``continuation.py``). Its flips and folds
are located on the way (``special_points.py``). It ends at a flip of an orbit of half the period, or
at a graze, at the edge of the range, or where the mass would rest. Other branches begin at its
flips and at its grazes.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibroimpact.inputs import refuse_other, shown_count
from vibroimpact.orbits.family import (
    NEARBY_DISTANCE,
    ArclengthStep,
    ContinuationParameter,
    OrbitFamily,
    units_along,
)
from vibroimpact.orbits.orbit import (
    Orbits,
    PeriodicOrbit,
    doubled_orbit,
    free_amplitude,
    free_orbit,
    orbit_of,
    repeats_freely,
)
from vibroimpact.orbits.periodic import OrbitError, least, refuse_inadmissible, refuse_long
from vibroimpact.orbits.singular_ends import doubling
from vibroimpact.orbits.special_points import Path, SpecialPoint, both_ways, one_way
from vibroimpact.oscillator import PARAMETERS, Oscillator

#: Number of values of the parameter at which the free oscillation is checked.
_FREE_VALUES = 201
#: If no impact is faster than this, in natural units, the orbit is the free oscillation.
STILL = 1e-6


@dataclass(frozen=True, eq=False)
class Branch:
    """A branch of periodic orbits, or a curve of bifurcations, in the order of its points.

    Attributes
    ----------
    kind : str
        ``flip``, ``fold`` or ``graze`` for a curve; empty for a branch.
    parameters : tuple of str
        The parameter of a branch, or the two of a curve.
    m, q : int
        Class of the orbits; on a curve of grazes q counts the impact of speed zero.
    values : ndarray, shape (n,) or (n, 2)
        Values of the parameters.
    stable : ndarray of bool, shape (n,)
        Whether both multipliers are inside the unit circle; False everywhere on a curve.
    phases, speeds : ndarray, shape (n, q)
        Phases and speeds of the impacts; phases are continuous along the branch.
    special : list of SpecialPoint
        In the order of the branch.
    oscillator : Oscillator
        The oscillator that gives the other parameters.

    Examples
    --------
    >>> from vibroimpact import Oscillator, one_impact_orbit
    >>> orbit = one_impact_orbit(Oscillator(h=0.1, R=0.8, omega=2.4, f=1.0))
    >>> found = branch(orbit, "omega", 2.3, 3.2)
    >>> found.m, found.q, found.stable[[0, -1]]
    (1, 1, array([ True, False]))
    """

    kind: str
    parameters: tuple[str, ...]
    m: int
    q: int
    values: np.ndarray
    stable: np.ndarray
    phases: np.ndarray
    speeds: np.ndarray
    special: list[SpecialPoint]
    oscillator: Oscillator

    def __repr__(self) -> str:
        values = self.values.reshape(len(self.values), -1).T
        along = [
            f"{name} {low:.6g} to {high:.6g}"
            for name, low, high in zip(self.parameters, values.min(1), values.max(1), strict=True)
        ]
        what = f"{self.kind} of {self.m}/{self.q}" if self.kind else f"{self.m}/{self.q}"
        special = [f"{one.kind} at {np.round(one.value, 6).tolist()}" for one in self.special[:6]]
        more = [f"{len(self.special) - 6} more"] * (len(self.special) > 6)
        parts = [shown_count(len(self.values), "point"), *along, *special, *more]
        return f"<Branch {what}: {', '.join(parts)}>"

    def oscillator_at(self, value: Any) -> Oscillator:
        """Return the oscillator at a value of the parameter, or at two values of a curve.

        Examples
        --------
        >>> from vibroimpact import Oscillator, one_impact_orbit
        >>> orbit = one_impact_orbit(Oscillator(h=0.1, R=0.8, omega=2.4, f=1.0))
        >>> branch(orbit, "omega", 2.3, 3.2).oscillator_at(2.5).omega
        2.5
        """
        values = np.atleast_1d(value).tolist()
        return replace(self.oscillator, **dict(zip(self.parameters, values, strict=True)))

    @property
    def orbits(self) -> Orbits:
        """Its orbits as arrays."""
        at = self.values.reshape(len(self.values), -1)
        return Orbits.along(
            self.oscillator, self.parameters, at, self.m, self.phases, self.speeds, self.kind
        )

    def orbit(self, i: int) -> PeriodicOrbit:
        """Return the orbit at a point of the branch.

        Examples
        --------
        >>> from vibroimpact import Oscillator, one_impact_orbit
        >>> orbit = one_impact_orbit(Oscillator(h=0.1, R=0.8, omega=2.4, f=1.0))
        >>> branch(orbit, "omega", 2.3, 3.2).orbit(-1).oscillator.omega
        3.2
        """
        osc = self.oscillator_at(self.values[i])
        if self.q == 0:
            return free_orbit(osc)
        return orbit_of(osc, self.m, self.phases[i], self.speeds[i], self.kind)

    def at(self, value: float) -> list[PeriodicOrbit]:
        """Return the orbits of a branch at a value of its parameter, in the order of the branch.

        Examples
        --------
        >>> from vibroimpact import Oscillator, one_impact_orbit
        >>> orbit = one_impact_orbit(Oscillator(h=0.1, R=0.8, omega=2.4, f=1.0))
        >>> [there.speeds.round(6) for there in branch(orbit, "omega", 2.3, 3.2).at(2.6)]
        [array([0.492335])]
        """
        osc, away = self.oscillator_at(value), self.values - value
        if self.q == 0:
            return [free_orbit(osc)] if away.min() <= 0.0 <= away.max() else []
        exact, crossed = away == 0.0, np.append(away[:-1] * away[1:] < 0.0, False)
        impacts_at = [
            (self.phases[i], self.speeds[i]) if exact[i] else self._between(i, value)
            for i in np.flatnonzero(exact | crossed).tolist()
        ]
        orbits = [orbit_of(osc, self.m, *impacts) for impacts in impacts_at if impacts]
        # At the flip where a branch ends, its orbit is that of half the period, taken twice.
        return [orbit for orbit in orbits if least(orbit) is orbit]

    def _between(self, i: int, value: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the impacts at a value between points i and i + 1; None if none are found."""
        (name,) = self.parameters
        axis = ContinuationParameter(name, float(self.values.min()), float(self.values.max()))
        start = PeriodicOrbit(self.oscillator, self.m, self.phases[i], self.speeds[i])
        family, two = OrbitFamily(start, (axis,)), slice(i, i + 2)
        X = family.unknowns(self.phases[two], self.speeds[two], self.values[two, None])
        away = (self.values[two] - value).tolist()
        step = ArclengthStep.chord(family, *X)
        root = step.root(lambda Y: float(family.values(Y)[0]) - value, *away)
        if root is None or family.inadmissible(root)[0] is not None:
            return None
        return family.impacts(root)


def branch(orbit: PeriodicOrbit, parameter: str, low: float, high: float) -> Branch:
    """Follow a periodic orbit along a parameter, through its folds, in both directions.

    A direction ends ``lost`` after 2,000 points, or after 16,777,216 time steps of all its orbits
    together.

    Parameters
    ----------
    orbit : PeriodicOrbit
        Its value of the parameter must be in the range.
    parameter : str
        Name of a parameter of the oscillator.
    low, high : float
        The range, low < high.

    Returns
    -------
    Branch

    Raises
    ------
    OrbitError
        If the orbit does not exist, or a repetition of it is too long to be solved for, as in
        `periodic_orbit`.
    TypeError, ValueError
        If an argument has the wrong type, the range is not valid, or the orbit is outside it.

    Examples
    --------
    >>> from vibroimpact import Oscillator, one_impact_orbit
    >>> orbit = one_impact_orbit(Oscillator(h=0.1, R=0.8, omega=2.4, f=1.0))
    >>> [(point.kind, round(point.value, 6)) for point in branch(orbit, "omega", 2.3, 3.2).special]
    [('edge', 2.3), ('flip', 2.663945), ('edge', 3.2)]
    """
    refuse_other("orbit", orbit, PeriodicOrbit)
    refuse_long(orbit.oscillator, orbit.m, orbit.q)
    orbit = least(orbit)  # one taken twice has the branch of twice the period on both sides
    axis = ContinuationParameter.of(orbit.oscillator, parameter, low, high)
    value = getattr(orbit.oscillator, parameter)
    if not low <= value <= high:
        raise ValueError(axis.outside(value))
    if orbit.q == 0:
        return _free_branch(orbit, axis)
    family = OrbitFamily(orbit, (axis,))
    if orbit.speeds.all():  # a graze lies at the border of the orbits that exist
        refuse_inadmissible(family)
    tangent = family.tangent(family.start)
    return as_branch(both_ways(family, -tangent if tangent[-1] < 0.0 else tangent))


def doubled_branch(orbit: PeriodicOrbit, parameter: str, low: float, high: float) -> Branch:
    """Follow the orbits of twice the period that begin at the flip of an orbit; as `branch`."""
    axis = ContinuationParameter.of(orbit.oscillator, parameter, low, high)
    single = OrbitFamily(orbit, (axis,))
    family = OrbitFamily(doubled_orbit(orbit), (axis,))
    return as_branch(one_way(family, *doubling(single, single.start)))


def grazing_branch(orbit: PeriodicOrbit, parameter: str, low: float, high: float) -> Branch:
    """Follow the orbits that begin at a graze, with or without the impact of speed zero.

    OrbitError if none begin there, or if natural vibrations of any phase graze.
    """
    axis = ContinuationParameter.of(orbit.oscillator, parameter, low, high)
    if orbit.q == 0:
        return _free_branch(orbit, axis)
    refuse_natural(orbit)
    family = OrbitFamily(orbit, (axis,))
    tangent = family.tangent(family.start)
    for along in (tangent, -tangent):
        X = family.corrected(family.start + NEARBY_DISTANCE * along, along[None, :])
        if X is not None and family.inadmissible(X)[0] is None:
            return as_branch(one_way(family, family.start, along))
    raise OrbitError(f"no orbits of {orbit.m}/{orbit.q} begin at the graze")


def refuse_natural(graze: PeriodicOrbit) -> None:
    """Raise an OrbitError at the graze of a natural vibration, of which there is one at any phase.

    That is without damping, where m p is a multiple of omega. It is not the free oscillation.
    """
    osc = graze.oscillator
    is_free = abs(osc.clearance - abs(free_amplitude(osc))) <= STILL * abs(osc.clearance)
    if repeats_freely(osc, graze.m) and not (graze.speeds.any() or is_free):
        raise OrbitError(
            "the graze is not isolated: without damping, every natural vibration repeats after "
            f"{shown_count(graze.m, 'forcing period')} at omega = {osc.omega:g}"
        )


def without_touch(orbit: PeriodicOrbit) -> PeriodicOrbit:
    """Return a grazing orbit without its impact of speed zero."""
    keep = np.arange(orbit.q) != np.argmin(orbit.speeds)
    if orbit.q == 1:
        return free_orbit(orbit.oscillator)
    return least(PeriodicOrbit(orbit.oscillator, orbit.m, orbit.phases[keep], orbit.speeds[keep]))


def as_branch(path: Path) -> Branch:
    """Return a path as a branch or a curve."""
    family = path.family
    X, stable = (np.array(column) for column in zip(*path.points, strict=True))
    values = family.within(X) if family.kind else family.within(X)[:, 0]
    return Branch(
        family.kind, family.names, family.m, family.q, values, stable, *family.impacts(X),
        path.special, family.osc,
    )  # fmt: skip


def _free_branch(orbit: PeriodicOrbit, axis: ContinuationParameter) -> Branch:
    """Follow the free oscillation from an orbit to where its amplitude equals the clearance."""
    from scipy.optimize import brentq

    units = units_along(orbit.oscillator, [axis])
    osc, unit = units.oscillator_into(orbit.oscillator), PARAMETERS[axis.name].unit
    start = float(getattr(osc, axis.name))
    first, last = units.into(unit, (axis.low, axis.high)).tolist()

    def room(value: float) -> float:
        oscillator = replace(osc, **{axis.name: value})
        return oscillator.clearance - abs(free_amplitude(oscillator))

    def end(side: np.ndarray) -> tuple[str, float]:
        """Return how the branch ends towards one side, and the last value."""
        before = start
        for value in side.tolist():
            if not room(value) > 0.0:
                if room(before) > 0.0:  # otherwise it grazes at the start, to rounding
                    between = sorted((before, value))
                    before = float(brentq(room, *between, xtol=1e-15, rtol=1e-15))
                return "graze", before
            before = value
        return "edge", before

    def special_point(kind: str, value: float) -> SpecialPoint:
        oscillator = replace(orbit.oscillator, **{axis.name: float(units.out_of(unit, value))})
        result = _free_graze(oscillator) if kind == "graze" else free_orbit(oscillator)
        return SpecialPoint(kind, getattr(oscillator, axis.name), result)

    # The amplitude has a single extremum, at resonance, so it is monotone on both sides.
    resonance = {"omega": _resonance(osc), "p": osc.omega}
    values = np.linspace(first, last, _FREE_VALUES)
    values = np.union1d(values, np.clip(resonance.get(axis.name, start), first, last))
    ends = [end(values[values < start][::-1]), end(values[values > start])]
    (_, low), (_, high) = ends
    values = np.unique(np.concatenate([[low], values[(values > low) & (values < high)], [high]]))
    stable = (values if axis.name == "h" else np.full(values.size, osc.h)) > 0.0
    none, special = np.empty((values.size, 0)), [special_point(*ending) for ending in ends]
    values = units.out_of(unit, values)
    return Branch("", (axis.name,), 1, 0, values, stable, none, none, special, orbit.oscillator)


def _resonance(osc: Oscillator) -> float:
    """Return the omega > 0 of the only extremum of the free amplitude; 0 if there is none."""
    square = osc.p**2 - 2.0 * osc.h**2
    # From d/d(omega^2) of (f + a omega^2)^2 / ((p^2 - omega^2)^2 + 4 h^2 omega^2).
    bent = osc.f + osc.a * square
    square += 4.0 * osc.a * osc.h**2 * (osc.p**2 - osc.h**2) / bent if bent else 0.0
    return math.sqrt(max(square, 0.0))


def _free_graze(osc: Oscillator) -> PeriodicOrbit:
    """Return the free oscillation that touches the stop, as an orbit with an impact of speed 0."""
    phase = 0.5 * math.pi - cmath.phase(free_amplitude(osc))  # maximises Im A exp(i phase)
    return PeriodicOrbit(osc, 1, np.array([phase % (2.0 * math.pi)]), np.zeros(1))
