"""Periodic orbits of any kind, found by shooting: their sections, impacts and Floquet multipliers.

The stroboscopic map P takes a section to the next one. An orbit of m forcing periods is a fixed
point of its m-th iterate, y = P^m(y), found by Newton's method with the exact derivative: the
tangent vectors of ``step/tangents.py`` carried through flights and impacts. Its eigenvalues at the
orbit are the Floquet multipliers. So an orbit is told stable or not however slowly motions settle
on it, as they do beside a bifurcation, and unstable ones are found as well. ``one_impact.py`` has
the orbits with a single impact in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibroimpact.integrate import resolve
from vibroimpact.jit import jit
from vibroimpact.oscillator import Oscillator, checked
from vibroimpact.status import Status
from vibroimpact.step.one_step import advance, prepare
from vibroimpact.step.phases import SIN, THETA, one_period
from vibroimpact.step.rules import EXACT
from vibroimpact.step.stop import IMPACT, KIND, REST, new_scratch, pressing
from vibroimpact.step.tangents import carry_tangents

#: Sections are the same where they differ by less than this share of the orbit's size.
SAME = 1e-6
#: Newton's method: the most steps, many because beside a flip the first ones gain a third each, and
#: the shares of the orbit's size by which a fixed point may miss itself, and be off.
_MOST_STEPS, _RESIDUAL, _LEFT = 80, 1e-11, 1e-4
#: How far beside a flipped orbit that of twice the period is sought, as shares of its size: from
#: beyond it, Newton's method comes down to it.
_FIRST_DISTANCES = (1e-1, 1e-2, 1e-3)


@dataclass(frozen=True)
class PeriodicOrbit:
    """A periodic orbit.

    Attributes
    ----------
    sections : ndarray, shape (m, 2)
        x and v at the section, one forcing period apart. m is the least number of forcing periods
        after which the orbit repeats.
    impacts : int
        Impacts in m forcing periods.
    rests : int
        Complete chatters in them.
    monodromy : ndarray, shape (2, 2)
        Derivative of the m-th iterate of the stroboscopic map at the first section.
    """

    sections: np.ndarray
    impacts: int
    rests: int
    monodromy: np.ndarray

    @property
    def m(self) -> int:
        """Forcing periods per repetition."""
        return len(self.sections)

    @property
    def multipliers(self) -> np.ndarray:
        """Both Floquet multipliers, complex, the larger first; zero after a rest."""
        values = np.linalg.eigvals(self.monodromy).astype(complex)
        return values[np.argsort(-np.abs(values))]

    @property
    def stable(self) -> bool:
        """Whether both multipliers are inside the unit circle."""
        return bool(np.all(np.abs(self.multipliers) < 1.0))


def periodic_orbit(
    osc: Oscillator, x: float, v: float, m: int = 1, phase: float = 0.0
) -> PeriodicOrbit | None:
    """Find the periodic orbit of `m` forcing periods near a section state.

    Parameters
    ----------
    osc : Oscillator
    x, v : float
        Where to begin: a state at the section [length, length/time].
    m : int
        Forcing periods after which the orbit is to repeat; it may do so after a divisor of them.
    phase : float
        omega t mod 2 pi of the section, in [0, 2 pi) [rad].

    Returns
    -------
    PeriodicOrbit or None
        None where Newton's method ends at none.

    Raises
    ------
    TypeError, ValueError
        If the state is not of numbers, or beyond the stop, or `m` is not an integer >= 1.
    """
    if isinstance(m, bool) or not isinstance(m, (int, np.integer)) or m < 1:
        raise ValueError(f"m must be an integer >= 1, not {m!r}")
    y = np.array([checked("x0", x), checked("v0", v)])
    if y[0] > osc.clearance:
        raise ValueError(f"x = {x:g} lies beyond the stop at {osc.clearance:g}")
    map_ = _Map(osc, phase)
    found = _newton(map_, y, int(m))
    if found is None:
        return None
    y, sections = found
    for k in (k for k in range(1, m) if m % k == 0):
        misses = map_.size(sections[k - 1] - y) / map_.size(sections)
        shorter = _newton(map_, y, k) if misses <= _LEFT else None
        orbit = None if shorter is None else map_.orbit(shorter[0], k)
        # Beside the flip of an orbit one of twice the period is found that is off by up to `_LEFT`,
        # and may be the orbit itself: it is that while it has not flipped.
        if misses <= SAME or (orbit is not None and orbit.stable):
            return orbit
    return map_.orbit(y, m)


def doubled(osc: Oscillator, orbit: PeriodicOrbit, phase: float = 0.0) -> PeriodicOrbit | None:
    """Find the orbit of twice the period that motions go to beyond the flip of an orbit.

    Parameters
    ----------
    osc : Oscillator
    orbit : PeriodicOrbit
        One that is unstable with a multiplier below -1, so that motions leave it alternating.
    phase : float
        As of `periodic_orbit`.

    Returns
    -------
    PeriodicOrbit or None
        None where no stable one is found.
    """
    values, vectors = np.linalg.eig(orbit.monodromy)
    least = int(np.argmin(values.real))
    if np.iscomplex(values).any() or values[least].real >= -1.0:
        return None
    along = vectors[:, least].real
    along *= np.abs(orbit.sections).max() / np.abs(along).max()
    if along[0] > 0.0:
        along = -along  # away from the stop
    for distance in _FIRST_DISTANCES:
        x, v = (orbit.sections[0] + distance * along).tolist()
        found = periodic_orbit(osc, min(x, osc.clearance), v, 2 * orbit.m, phase)
        if found is not None and found.m == 2 * orbit.m and found.stable:
            return found
    return None


class _Map:
    """The stroboscopic map of one oscillator, and its derivative."""

    def __init__(self, osc: Oscillator, phase: float) -> None:
        self._point = osc.at(osc.clearance)
        rule, self._integrator, steps = resolve(self._point, "exact", "exact", None)
        assert rule == EXACT
        self._grid = one_period(phase, steps)
        self._rate = max(osc.omega, osc.p)
        self.stop = osc.clearance

    def __call__(self, y: np.ndarray, m: int) -> tuple[np.ndarray, np.ndarray, tuple[int, ...]]:
        """Return the `m` sections after `y`, the derivative of the last one, and the counts."""
        sections, tangents = np.empty((m, 2)), np.array([1.0, 0.0, 0.0, 1.0])
        counts = _iterate(self._point[0], self._integrator, self._grid, y, sections, tangents)
        return sections, tangents.reshape(2, 2).T, counts

    def size(self, states: np.ndarray) -> float:
        """Return the largest displacement of states, or velocity as a displacement."""
        return float(np.abs(states / (1.0, self._rate)).max())

    def orbit(self, y: np.ndarray, m: int) -> PeriodicOrbit | None:
        """Return the orbit through a fixed point."""
        sections, monodromy, (impacts, rests, status) = self(y, m)
        if status > Status.CERTIFIED:
            return None
        return PeriodicOrbit(np.roll(sections, 1, axis=0), impacts, rests, monodromy)


def _newton(map_: _Map, y: np.ndarray, m: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Return a fixed point of the `m`-th iterate, and the sections after it."""
    best, smallest, left = None, np.inf, np.inf
    for _ in range(_MOST_STEPS):
        sections, derivative, (_, _, status) = map_(y, m)
        if status >= Status.UNRESOLVED or not np.isfinite(derivative).all():
            break
        residual = sections[-1] - y
        missed = map_.size(residual)
        if missed >= smallest <= _RESIDUAL * map_.size(sections):
            break  # at rounding
        try:
            step = np.linalg.solve(derivative - np.eye(2), residual)
        except np.linalg.LinAlgError:
            break
        if missed < smallest:
            best, smallest, left = (y, sections), missed, map_.size(step)
        if missed == 0.0:
            break
        y = y - step
        y[0] = min(y[0], map_.stop)
    if best is None or smallest > _RESIDUAL * map_.size(best[1]):
        return None
    # Where the motion grows without bound, the residual is small beside it, but not what is left.
    return best if left <= _LEFT * map_.size(best[1]) else None


@jit
def _iterate(pt, integrator, grid, y, sections, tangents):
    """Run a state from the section through periods of steps, with its two tangent vectors.

    Returns
    -------
    impacts, rests, status : int
    """
    scratch = new_scratch()
    prepared = prepare(integrator, grid, pt)
    to_x, to_v, lane = prepared
    T = grid.step / pt.omega
    x, v = y[0], y[1]
    resting = x == pt.clearance and v == 0.0 and pressing(grid.table[SIN, 0], pt) > 0.0
    impacts, rests, status = 0, 0, 0
    for k in range(sections.shape[0]):
        for n in range(grid.table.shape[1]):
            if resting:
                tangents[:] = 0.0
            x, v, resting, n_events, _, outcome, _ = advance(
                EXACT, integrator, prepared, x, v, resting, grid, n, pt, scratch
            )
            theta = grid.table[THETA, n]
            carry_tangents(tangents, to_x, to_v, scratch.events, n_events, theta, T, lane.rows, pt)
            status = max(status, outcome)
            for j in range(n_events):
                if scratch.events[j, KIND] == IMPACT:
                    impacts += 1
                elif scratch.events[j, KIND] == REST:
                    rests += 1
        sections[k, 0], sections[k, 1] = x, v
    return impacts, rests, status
