"""`periodic_orbit`: from a motion or a guess to an orbit, or an `OrbitError`.

The unknowns are the phases and speeds of the impacts; the equations are those of ``flights.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from vibroimpact.inputs import integer, refuse_other, shown_count
from vibroimpact.orbits.calls import correct, linearised
from vibroimpact.orbits.family import OrbitFamily
from vibroimpact.orbits.flights import MOST_ORBIT_STEPS, time_steps
from vibroimpact.orbits.orbit import PeriodicOrbit, free_amplitude, free_orbit
from vibroimpact.orbits.unknowns import impact_rows
from vibroimpact.oscillator import Oscillator, checked
from vibroimpact.status import Status
from vibroimpact.step.contact import IMPACT, REST
from vibroimpact.step.recorder import trace
from vibroimpact.step.scheme import scheme_of

#: Most impacts per repetition of an orbit that is solved for.
MOST_IMPACTS = 4096
#: Most time steps, and most impacts and sections, over which a motion is followed.
_MOST_EVENTS = 16 * MOST_ORBIT_STEPS
#: Newton's method starts from the given state, then from later states of the motion, after these
#: numbers of repetitions.
_LATER = (0, 1, 4, 16, 64, 256)
#: Most iterations. Near a flip each of the first ones removes only a third of the error.
_MOST_TO_ORBIT = 80
#: The impacts of an orbit miss the stop by less than this share of its size.
_RESIDUAL = 1e-11
#: An orbit repeats a part of itself if its impacts do so to within the first. If they do so only to
#: within the second, it may still be that part, inaccurate because the part is near its flip.
_RETURN_TOLERANCE, _NEARLY = 1e-7, 1e-4
#: Why a root of the equations of the flights is not an orbit, by its kind of `Inadmissible`.
_REASONS = {
    "speed": "an impact would leave the stop instead of meeting it: its speed is negative",
    "rest": "the mass cannot leave the stop: it rests",
    "penetration": "it passes the stop between its impacts, at omega t = {:.6g}",
}


class OrbitError(ValueError):
    """There is no periodic orbit where one was sought; the text gives the reason.

    Examples
    --------
    >>> from vibroimpact import Oscillator
    >>> try:
    ...     periodic_orbit(Oscillator(h=0.1, R=0.3, omega=0.5, f=1.0), x=0.0, v=0.0)
    ... except OrbitError as error:
    ...     print(error)
    the motion rests on the stop, where deviations end: it has no multipliers
    """


def periodic_orbit(
    osc: Oscillator, x: float, v: float, m: int = 1, phase: float = 0.0
) -> PeriodicOrbit:
    """Find the periodic orbit of `m` forcing periods to which a section state leads.

    The motion is followed over `m` forcing periods; Newton's method starts from its impacts. If
    this does not lead to an orbit, the motion is followed longer, several times over, up to
    524,288 time steps.

    Parameters
    ----------
    osc : Oscillator
    x, v : float
        State at the section from which to begin [length, length/time].
    m : int
        Forcing periods after which the orbit repeats; it may also repeat after a divisor of them.
        They must take at most 32,768 time steps: m (1 + (2 h + p) / omega) < 6831.
    phase : float
        omega t mod 2 pi of the section, in [0, 2 pi) [rad].

    Returns
    -------
    PeriodicOrbit
        Stable or not. It is proved to stay below the stop between its impacts.

    Raises
    ------
    OrbitError
        If there is no such orbit: the motion rests on the stop, or Newton's method does not end at
        an orbit. If the orbit is not sought, because `m` periods take too many time steps or have
        more than 4,096 impacts, or because the motion has too many impacts.
    TypeError, ValueError
        If `osc` is not an Oscillator, the state is not numeric or is beyond the stop, or `m` or
        `phase` is out of range.

    Examples
    --------
    >>> from vibroimpact import Oscillator
    >>> orbit = periodic_orbit(Oscillator(h=0.1, R=0.8, omega=2.3, f=1.0), x=-0.55, v=1.3)
    >>> orbit.m, orbit.q, orbit.speeds.round(6), orbit.stable
    (1, 1, array([1.09758]), True)
    """
    refuse_other("osc", osc, Oscillator)
    m = integer(1, MOST_ORBIT_STEPS).checked("m", m)
    refuse_long(osc, m, 0)
    state = checked("x0", x), checked("v0", v)
    if state[0] > osc.clearance:
        raise ValueError(f"x = {x:g} lies beyond the stop at {osc.clearance:g}")
    reason = ""
    for guess in _impacts_from(osc, state, m, phase):
        if isinstance(guess, str):
            reason = guess
            continue
        try:
            return solved(osc, m, *guess)
        except OrbitError as error:
            reason = str(error)
    raise OrbitError(reason)


def _impacts_from(
    osc: Oscillator, state: tuple[float, float], m: int, phase: float
) -> Iterator[tuple[np.ndarray, np.ndarray] | str]:
    """Yield phases and speeds of the impacts in `m` periods, ever later in a motion; or why not."""
    before = 0
    for later in _LATER:
        periods = m * (later - before + 1)
        points = osc.at(*state)
        scheme = scheme_of(points, "exact", "exact", None, phase)
        points["phase"] = phase
        if later and m * (later + 1) * scheme.grid.size > _MOST_EVENTS:
            return
        log, status = trace(points, scheme, periods, every=scheme.grid.size, most_rows=_MOST_EVENTS)
        if status is Status.PENDING:
            yield "the motion has more impacts than are followed"
            return
        if status >= Status.UNRESOLVED:
            yield f"the motion cannot be followed: {status.meaning}"
            return
        begin = (phase + 2.0 * math.pi * m * (later - before)) / osc.omega
        last = log[log[:, 1] >= begin]
        if (last[:, 0] == REST).any():
            yield "the motion rests on the stop, where deviations end: it has no multipliers"
        else:
            hits = last[last[:, 0] == IMPACT]
            yield hits[:, 1] * osc.omega, hits[:, 3]
        state, before = (float(log[-1, 2]), float(log[-1, 3])), later + 1


def solved(osc: Oscillator, m: int, phases: np.ndarray, speeds: np.ndarray) -> PeriodicOrbit:
    """Find the orbit near a guess of its impacts by Newton's method, and prove that it is one.

    The phases and speeds, shape (q,), are in time order. The orbit returned has the least m after
    which it repeats. OrbitError if there is none.
    """
    q = len(phases)
    refuse_long(osc, m, q)
    if q == 0:
        if not abs(free_amplitude(osc)) < osc.clearance:
            raise OrbitError("the free oscillation reaches the stop")
        return free_orbit(osc)
    family = OrbitFamily(PeriodicOrbit(osc, m, phases, speeds), ())
    converged = correct(family.system, family.start, np.empty((0, 2 * q)), _MOST_TO_ORBIT)
    orbit = family.orbit(family.start)
    # If the guess is an orbit at its flip taken twice, the iteration ends in rounding.
    if not converged and not np.abs(linearised(*orbit.equations)[0]).max() < _NEARLY**2:
        raise OrbitError("Newton's method does not converge")
    for misses, part in _parts(orbit):
        # Near the flip of an orbit, a root of twice the period may differ from it by up to
        # `_NEARLY` and still be the same orbit. It is the same if that orbit has not flipped.
        shorter = solved(osc, *part)
        if misses <= _RETURN_TOLERANCE or shorter.stable:
            return shorter
    reason = why_inadmissible(orbit)
    if reason:
        raise OrbitError(reason)
    return orbit


def refuse_long(osc: Oscillator, m: int, q: int) -> None:
    """Raise an OrbitError if an orbit has more impacts or time steps than are solved for."""
    if q > MOST_IMPACTS:
        raise OrbitError(f"{q:,} impacts are more than the {MOST_IMPACTS:,} that are solved for")
    steps = time_steps.py_func(osc, m, 0)  # not worth compiling
    if not steps <= MOST_ORBIT_STEPS:
        raise OrbitError(
            f"{shown_count(m, 'forcing period')} here would be {steps:,.0f} time steps, more than "
            f"the {MOST_ORBIT_STEPS:,} that are solved for"
        )


def why_inadmissible(orbit: PeriodicOrbit) -> str:
    """Return why a root of the equations of the flights is not an orbit; empty if it is one."""
    missed = np.abs(linearised(*orbit.equations)[0]).max()
    if not missed < _RESIDUAL:
        return f"its impacts miss the stop by {missed:.1e} of its size"
    family = OrbitFamily(orbit, ())
    reason, _ = family.inadmissible(family.start)
    return _REASONS[reason.kind].format(reason.where) if reason else ""


def refuse_inadmissible(family: OrbitFamily) -> None:
    """Raise an OrbitError if a family begins at a solution that is not an orbit."""
    reason, _ = family.inadmissible(family.start)
    if reason:
        raise OrbitError(f"the orbit does not exist: {_REASONS[reason.kind].format(reason.where)}")


def least(orbit: PeriodicOrbit) -> PeriodicOrbit:
    """Return an orbit with its least period: itself, or the part that it repeats."""
    for misses, (m, phases, speeds) in _parts(orbit):
        if misses <= _RETURN_TOLERANCE:
            return PeriodicOrbit(orbit.oscillator, m, phases, speeds)
    return orbit


def _parts(orbit: PeriodicOrbit) -> Iterator[tuple[float, tuple[int, np.ndarray, np.ndarray]]]:
    """Yield the parts that an orbit nearly repeats, and their deviations; the shortest first."""
    z = impact_rows(orbit.equations[1], orbit.q)
    for k in range(orbit.m, 1, -1):
        if orbit.m % k or orbit.q % k:
            continue
        part, m = orbit.q // k, orbit.m // k
        moved = np.roll(z, -part, axis=0)
        moved[-part:, 0] += 2.0 * math.pi * orbit.m
        moved[:, 0] -= 2.0 * math.pi * m
        misses = float(np.abs(moved - z).max())
        if misses <= _NEARLY:
            yield misses, (m, orbit.phases[:part], orbit.speeds[:part])
