"""Impact rules: what becomes of a step that ends on or beyond the stop.

``plain`` is the rule (2)-(5) at the end of the step. ``reduced-step`` is the paper's
procedure, eqs (6)-(10): the step is shortened to the impact, found by linear interpolation,
the rule is applied there, and the remainder of the step follows, so that the state is back
on the common grid. (``paper.py`` keeps the literal form, which restarts the grid at the impact.)

What the literal procedure leaves open, and how it is closed here:

- A rebound starts on the stop, x_0 = clearance, where eq. (7) gives T_r = 0 for ever. The root
  at the launch is divided out: eq. (7) is applied to (x - clearance) / t, which is -R v at the
  launch. This is exact for a constant acceleration.
- A chord on which eq. (9) gives a speed v_Tr <= 0 hides a turning point: the step is halved.
- Several impacts in one step follow one another until the remainder is used up.
- A chatter whose geometric sum of flights, 2 v / (a (1 - R)), ends within the step while the
  force presses is complete: the mass rests. So it does when a rebound is shorter than
  ``SHORTEST_FLIGHT`` steps, far below what the rule resolves; R = 1 ends there too.
- A mass at rest on the stop stays while the force presses, a > 0, and is released at the exact
  time at which a = -f sin(omega t) - p^2 clearance turns.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from vibroimpact.integrators import step
from vibroimpact.jit import jit
from vibroimpact.status import Status

PLAIN, REDUCED_STEP = 0, 1

#: A rebound shorter than this many steps counts as rest.
SHORTEST_FLIGHT = 1e-3
#: More flights than this in one step: the point is given up as ``Status.UNRESOLVED``.
MAX_FLIGHTS = 4096
_MAX_HALVINGS = 60
# A release this close in phase to the end of a step is left to the next one: so near to it, the
# sign of the force is rounding. The displacement it would cause is of the order of its cube.
_RELEASE_MARGIN = 1e-12

# The events of one step: their kinds, and the columns of the buffer that holds them (time since
# the start of the step, and the state just before). A flight ends in three events at the most.
IMPACT, REST, RELEASE = 0, 1, 2
KIND, TIME, SPEED, DISPLACEMENT = 0, 1, 2, 3
EVENTS_SHAPE = (3 * MAX_FLIGHTS, 4)

_COMPUTED, _UNRESOLVED = int(Status.COMPUTED), int(Status.UNRESOLVED)


@dataclass(frozen=True)
class ImpactRule:
    """An impact rule: its number in the kernel, its order through impacts, its equations."""

    code: int
    order: int
    source: str


IMPACT_RULES: Mapping[str, ImpactRule] = {
    "plain": ImpactRule(PLAIN, 1, "eqs (2)-(5), at the end of the step"),
    "reduced-step": ImpactRule(REDUCED_STEP, 2, "eqs (6)-(10), then the remainder of the step"),
}


@jit
def pressing(theta, pt):
    """Acceleration that presses a mass at rest against the stop: eq. (1) at x = clearance."""
    return -pt.f * math.sin(theta) - pt.p * pt.p * pt.clearance


@jit
def time_to_release(theta, pt):
    """Return the time from phase `theta` until the force no longer presses; inf for never.

    It turns from pressing to pulling where sin(omega t) = -p^2 clearance / f, cos(omega t) > 0.
    """
    if not pressing(theta, pt) > 0.0:
        return 0.0
    level = pt.p * pt.p * pt.clearance
    if not abs(level) < pt.f:
        return math.inf
    turn = -math.asin(level / pt.f)
    angle = (turn - theta) % (2.0 * math.pi)
    # The force has pressed since pi - turn or later: a longer wait is a release that theta has
    # passed by its rounding.
    return angle / pt.omega if angle < 1.5 * math.pi + turn else 0.0


@jit
def start(pt):
    """Return the state just after t = 0 and whether it is at rest: rule (2)-(5) on the start."""
    x, v = pt.x0, pt.v0
    if x >= pt.clearance and v > 0.0:
        return x, -pt.R * v, False
    return x, v, x == pt.clearance and v == 0.0 and pressing(0.0, pt) > 0.0


@jit(inline=True)
def crossed(x, v, clearance):
    """Whether a step that ended at (x, v) must be shortened."""
    return x > clearance or (x == clearance and v > 0.0)


@jit(inline=True)
def fly(integrator, x, v, theta, span, pt):
    """Advance until the first impact, or for at most `span`.

    Returns
    -------
    dt, x, v : float
        Time used, and the state there: before the impact, if there is one.
    hit : bool
    """
    s, c = math.sin(theta), math.cos(theta)
    launched = x == pt.clearance
    T = span
    for _ in range(_MAX_HALVINGS):
        x_T, v_T = step(integrator, x, v, s, c, T, pt)
        if not crossed(x_T, v_T, pt.clearance):
            return T, x_T, v_T, False
        if launched:
            T_r = T * (0.0 - v) / ((x_T - pt.clearance) / T - v)  # (7) on (x - clearance) / t
        else:
            T_r = T * (pt.clearance - x) / (x_T - x)  # (6), (7)
        v_Tr = v + (v_T - v) * T_r / T  # (9)
        if v_Tr > 0.0:
            return T_r, pt.clearance, v_Tr, True  # (8)
        T *= 0.5
    return 0.0, pt.clearance, 0.0, True


@jit
def time_to_rest(v, theta, left, T, pt):
    """Return the time until the chatter that follows a rebound at speed `v` is complete.

    inf where it is not complete within the time `left` of a step of length `T`.
    """
    a = pressing(theta, pt)
    if not a > 0.0:
        return math.inf
    if 2.0 * v <= SHORTEST_FLIGHT * T * a:
        return 0.0
    remaining = 2.0 * v / (a * (1.0 - pt.R)) if pt.R < 1.0 else math.inf
    return remaining if remaining <= min(left, time_to_release(theta, pt)) else math.inf


@jit(inline=True)
def _log(events, n, kind, tau, v, x):
    events[n, KIND] = kind
    events[n, TIME] = tau
    events[n, SPEED] = v
    events[n, DISPLACEMENT] = x
    return n + 1


@jit(inline=True)
def plain(x_T, v_T, T, pt, events):
    """Rule (2)-(5) at the end of a step that ended at (x_T, v_T) on or beyond the stop."""
    if not v_T > 0.0:
        return x_T, v_T, 0
    return pt.clearance, -pt.R * v_T, _log(events, 0, IMPACT, T, v_T, x_T)


@jit
def reduced_step(integrator, x, v, resting, theta, T, pt, events):
    """One step of length `T` from phase `theta`, shortened at every impact in it.

    Returns
    -------
    x, v : float
        State at the end of the step; NaN where it could not be resolved.
    resting : bool
        Whether the mass is at rest on the stop there.
    n : int
        Number of rows written to `events`.
    rested : float
        Time spent at rest.
    status : int
    """
    tau = 0.0
    n = 0
    rested = 0.0
    for _ in range(MAX_FLIGHTS):
        if resting:
            wait = time_to_release(theta + pt.omega * tau, pt)
            if pt.omega * (T - tau - wait) <= _RELEASE_MARGIN:
                return pt.clearance, 0.0, True, n, rested + (T - tau), _COMPUTED
            tau += wait
            rested += wait
            n = _log(events, n, RELEASE, tau, 0.0, pt.clearance)
            x, v, resting = pt.clearance, 0.0, False
        dt, x, v, hit = fly(integrator, x, v, theta + pt.omega * tau, T - tau, pt)
        if not hit:
            if dt == T - tau:
                return x, v, False, n, rested, _COMPUTED
            tau += dt
            continue
        tau += dt
        if v > 0.0:
            n = _log(events, n, IMPACT, tau, v, x)
        v = -pt.R * v
        wait = time_to_rest(-v, theta + pt.omega * tau, T - tau, T, pt)
        if wait < math.inf:
            tau += wait
            resting = True
            n = _log(events, n, REST, tau, 0.0, pt.clearance)
    return math.nan, math.nan, False, n, rested, _UNRESOLVED


@jit(inline=True)
def mend(rule, integrator, x, v, x_T, v_T, resting, theta, T, pt, events):
    """Apply an impact rule to one step that met the stop; returns as ``reduced_step`` does."""
    if rule == PLAIN:
        x, v, n = plain(x_T, v_T, T, pt, events)
        return x, v, False, n, 0.0, _COMPUTED
    return reduced_step(integrator, x, v, resting, theta, T, pt, events)
