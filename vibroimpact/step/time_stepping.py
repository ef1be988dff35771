"""The impact rules ``plain``, ``reduced-step`` and ``cubic``: one impact by each.

``plain`` is the rule (2)-(5) at the end of the step. ``reduced-step`` is the paper's procedure,
eqs (6)-(9): linear interpolation finds the impact, the step is shortened to it, and the rule is
applied there. The remainder of the step follows, so that the state is back on the common grid.
(``paper.py`` keeps the literal form, which restarts the grid at the impact.) ``cubic`` finds the
impact on the cubic Hermite interpolant of the step instead, and takes a step of that length to it,
since the derivative of the interpolant loses an order.

The literal procedure leaves some cases open. Here they are closed as follows:

- A rebound starts on the stop, x_0 = clearance, where eq. (7) gives T_r = 0 for ever. The root at
  the launch is divided out: eq. (7) is applied to (x - clearance) / t, which is -R v at the launch.
  This is exact for a constant acceleration, as in a step of an integrator of second order. It is
  not applied to a step much longer than the flight, over which the acceleration varies: the step
  is cut to twice the flight, repeatedly if needed.
- If the straight line gives a speed v_Tr <= 0 by eq. (9), it hides a turning point: the step is
  halved. A speed that is zero to rounding counts as zero, because semi-implicit Euler brings every
  rebound within a step back at that speed.
- Several impacts in one step follow one another until the remainder is used up.
- A chatter is complete, and the mass rests, if the geometric sum of its flights,
  2 v / (a (1 - R)), ends within the step while the force presses. The mass also rests when a
  rebound is shorter than ``SHORTEST_FLIGHT`` steps, far below what the rule resolves. At R = 1 this
  loses a speed of at most a T ``SHORTEST_FLIGHT`` / 2, once.
- The force at a release is zero to rounding. If the step moves x by that force alone, the mass
  stays on the stop until the next step, with the speed that the step gives it.
"""

from __future__ import annotations

import math

from vibroimpact.jit import jit, specialised
from vibroimpact.status import Status
from vibroimpact.step.contact import (
    IMPACT,
    MAX_FLIGHTS,
    RELEASE_MARGIN,
    REST,
    log_event,
    log_release,
    pressing,
    speeds_until_rest,
    time_to_release,
)
from vibroimpact.step.elementary import sin_cos
from vibroimpact.step.integrators import integrator_step
from vibroimpact.step.polynomial import first_crossing
from vibroimpact.step.scheme import CUBIC

#: A rebound shorter than this many steps counts as rest.
SHORTEST_FLIGHT = 1e-3
# If only rounding decides the state at the stop, the step would be cut for ever. So a mass that is
# at the stop after this many halvings is in contact, and a flight from the stop that is shorter
# than this share of the span does not count.
_MAX_HALVINGS = 24
_SHORTEST_CUT = 2.0**-20
_MAX_CUTS = 100
# Most cuts of one step: a motion that needs more is not resolved anyway.
_MAX_CUTS_OF_STEP = 4 * MAX_FLIGHTS
# A speed v_Tr below this share of the speed at the start is zero to rounding.
_SLOWEST = 1e-6

# Rounding of a phase: this long after a release the force certainly no longer presses.
_AFTER_RELEASE = 2e-14

_COMPUTED, _UNRESOLVED = int(Status.COMPUTED), int(Status.UNRESOLVED)


@specialised
def plain(x_T, v_T, T, pt, scratch):
    """Rule (2)-(5) at the end (x_T, v_T) of a step that may have met the stop."""
    if not ((x_T >= pt.clearance) & (v_T > 0.0)):  # (2)
        return x_T, v_T, 0
    # (3), (4), (5)
    return pt.clearance, -pt.R * v_T, log_event(scratch.events, 0, IMPACT, T, v_T, x_T)


@specialised
def crossed(x, v, clearance):
    """Whether a step that ended at (x, v) must be shortened."""
    return (x > clearance) | ((x == clearance) & (v > 0.0))


@specialised
def linear_impact(x, v, x_T, v_T, T, clearance):
    """Return time and speed of the impact by linear interpolation, eqs (6), (7) and (9)."""
    share = (clearance - x) / (x_T - x)  # (6)
    return T * share, v + (v_T - v) * share  # (7), (9)


@specialised
def linear_impact_after_launch(v, x_T, v_T, T, clearance):
    """As ``linear_impact`` for a step from the stop, where (x - clearance) / t is interpolated."""
    share = (0.0 - v) / ((x_T - clearance) / T - v)
    return T * share, v + (v_T - v) * share


@specialised
def cubic_impact(integrator, launch, end, T, pt, coefficients):
    """Return time and speed of the impact on the cubic Hermite interpolant of a step.

    The speed is that after an integrator step of this length, or 0 if the interpolant does not
    cross the stop.
    """
    (x, v, s, c), (x_T, v_T) = launch, end
    rise = x_T - x
    coefficients[0] = x - pt.clearance
    coefficients[1] = T * v
    coefficients[2] = 3.0 * rise - T * (2.0 * v + v_T)
    coefficients[3] = T * (v + v_T) - 2.0 * rise
    u, _ = first_crossing(coefficients[:4], 1 if x == pt.clearance else 0, 1.0)
    _, v_Tr = integrator_step(integrator, x, v, s, c, u * T, pt)
    return u * T, v_Tr if u > 0.0 else 0.0


@specialised
def shortened_flight(method, launch, end, span, pt, coefficients):
    """Follow a flight until its first impact, or for at most the time `span`.

    `launch` is x, v, and sine and cosine of the phase there; `end` is x, v after `span`. Returns
    the time used; x and v there, which are those before the impact if there is one, and NaN on
    overflow; whether there is an impact; and how often the span was cut.
    """
    (rule, integrator), (x, v, s, c), (x_T, v_T) = method, launch, end
    launched = x == pt.clearance
    T = span
    halvings = 0
    for cuts in range(_MAX_CUTS):
        if T < span:
            x_T, v_T = integrator_step(integrator, x, v, s, c, T, pt)
        if not crossed(x_T, v_T, pt.clearance):
            if halvings < _MAX_HALVINGS:
                return T, x_T, v_T, False, cuts
            return T, pt.clearance, max(v_T, 0.0), True, cuts
        # Near overflow the times and speeds have no meaning, and cutting might not end.
        if not (abs(x_T - x) + T * (abs(v) + abs(v_T))) * (4.0 + T) < math.inf:
            return T, math.nan, math.nan, False, cuts
        if rule == CUBIC:
            T_r, v_Tr = cubic_impact(integrator, launch, (x_T, v_T), T, pt, coefficients)
        elif launched:
            T_r, v_Tr = linear_impact_after_launch(v, x_T, v_T, T, pt.clearance)
        else:
            T_r, v_Tr = linear_impact(x, v, x_T, v_T, T, pt.clearance)
        short = launched and T_r < 0.25 * T
        if not v_Tr > _SLOWEST * abs(v) or (short and T_r <= _SHORTEST_CUT * span):
            T *= 0.5
            halvings += 1
        elif short:
            T = 2.0 * T_r
        else:
            return T_r, pt.clearance, v_Tr, True, cuts  # (8)
    return 0.0, pt.clearance, 0.0, True, _MAX_CUTS  # no speed takes it off the stop: contact


@specialised
def single_linear_impact(x, v, x_T, v_T, theta, T, pt):
    """Return T_r, v_Tr, sine and cosine there, and `sure`, of a step from below the stop, (6)-(9).

    `sure` is set if the step crosses the stop, has an impact there and continues with a rebound,
    not with a chatter that is complete before its end. There is no branch, so that
    ``kernel/reduced_step_impacts.py`` can vectorise it. All other steps go through
    ``reduced_step``, which has the same arithmetic.
    """
    T_r, v_Tr = linear_impact(x, v, x_T, v_T, T, pt.clearance)
    s, c = sin_cos(theta + pt.omega * T_r)
    sure = (abs(x_T - x) + T * (abs(v) + abs(v_T))) * (4.0 + T) < math.inf
    # False for a launch from the stop, where v_Tr = v <= 0, and for an end on it with v_T <= 0.
    sure &= v_Tr > _SLOWEST * abs(v)
    a = pressing(s, pt)
    twice = 2.0 * (pt.R * v_Tr)
    in_time = twice <= 1.000001 * (T - T_r) * a * (1.0 - pt.R)  # not sure where rounding decides
    sure &= (a <= 0.0) | ((twice > SHORTEST_FLIGHT * T * a) & (not in_time))
    return T_r, v_Tr, s, c, sure


@jit
def geometric_time_to_rest(v, theta, s, left, T, pt):
    """Return the time until the chatter that follows a rebound at speed `v` is complete.

    The chatter begins at phase `theta`, with sine `s`. The time is inf if the chatter is not
    complete within the time `left` of a step of length `T`.
    """
    a = pressing(s, pt)
    if not a > 0.0:
        return math.inf
    if 2.0 * v <= SHORTEST_FLIGHT * T * a:
        return 0.0
    remaining = 2.0 * v / (a * (1.0 - pt.R))  # inf at R = 1
    return remaining if remaining <= min(left, time_to_release(theta, pt)) else math.inf


@jit
def reduced_step(method, start, end, phase, T, pt, scratch):
    """Take one step of length `T`, shortened at every impact in it.

    `method` holds the codes of rule and integrator, `start` is (x, v, resting), `end` is (x, v) at
    the end of the step without impact, and `phase` is the phase at the start, its sine and its
    cosine. Returns x and v, which are NaN if the step could not be resolved; resting; the number of
    events in `scratch`; the time spent at rest; and the status.
    """
    events, coefficients, _ = scratch
    (_, integrator), (x, v, resting), (x_T, v_T), (theta, s, c) = method, start, end, phase
    tau = 0.0
    n = 0
    rested = 0.0
    undisturbed = True
    cuts = 0
    for _ in range(MAX_FLIGHTS):
        if cuts > _MAX_CUTS_OF_STEP:
            break
        if resting:
            wait = time_to_release(theta + pt.omega * tau, pt)
            if pt.omega * (T - tau - wait) <= RELEASE_MARGIN:
                return pt.clearance, 0.0, True, n, rested + (T - tau), _COMPUTED
            tau += wait
            rested += wait if pt.omega * wait > RELEASE_MARGIN else 0.0
            n = log_release(events, n, tau, pt.omega * wait, pt)
            s, c = sin_cos(theta + pt.omega * tau + _AFTER_RELEASE)
            x, v, resting, undisturbed = pt.clearance, 0.0, False, undisturbed and tau == 0.0
        if not undisturbed:
            x_T, v_T = integrator_step(integrator, x, v, s, c, T - tau, pt)
        undisturbed = False
        launch = x, v, s, c
        dt, x, v, hit, more = shortened_flight(
            method, launch, (x_T, v_T), T - tau, pt, coefficients
        )
        cuts += more
        if not hit:
            if dt == T - tau:
                return x, v, False, n, rested, _COMPUTED
            tau += dt
            s, c = sin_cos(theta + pt.omega * tau)
            continue
        tau += dt
        if v > 0.0:
            n = log_event(events, n, IMPACT, tau, v, x)
        v = -pt.R * v
        s, c = sin_cos(theta + pt.omega * tau)
        wait = geometric_time_to_rest(-v, theta + pt.omega * tau, s, T - tau, T, pt)
        if wait < math.inf:
            speeds = speeds_until_rest(-v, wait, s, c, pt)
            tau += wait
            resting = True
            n = log_event(events, n, REST, tau, speeds, pt.clearance)
    return math.nan, math.nan, False, n, rested, _UNRESOLVED
