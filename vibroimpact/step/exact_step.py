"""Takes one orbit to the end of a step, flight by flight, where `meet_stop` proves nothing.

A step of ``propagator.py`` whose guard proves it safe needs no correction. Of the others, nearly
all are settled by ``impact.py``. The remaining ones come here: the start and the end of a rest, the
sum of a chatter, long rows of bounces, and near grazes. They are followed flight by flight, from
the flight on that is not settled:

- A flight that is proved to stay below the stop, in two or four pieces, has no impact.
- ``chatter.py`` finds the end of a short rebound, and the sum of a chatter.
- For any other flight, the first root of its polynomial is searched for, see ``polynomial.py``.

**Underflow.** Without a force, a mass whose stop is at the equilibrium bounces for ever, lower each
time by the same factor. When the displacement of a flight from the stop and its changes over a step
are below the smallest normal number, the mass is put at rest on the stop, y = 0 and w = 0. This
rest is free, since no force presses the mass. The point stays certified, because the error is
below that number.

**Overflow.** If a coefficient of a flight is not finite, the step ends in NaN.
"""

from __future__ import annotations

import math

from vibroimpact.jit import inlined, jit
from vibroimpact.status import Status
from vibroimpact.step.chatter import bounce, is_first, phase_to_rest, short_bounce, wave_after
from vibroimpact.step.contact import (
    IMPACT,
    MAX_FLIGHTS,
    RELEASE_MARGIN,
    REST,
    log_event,
    log_release,
    speeds_until_rest,
    time_to_release,
)
from vibroimpact.step.elementary import sin_cos
from vibroimpact.step.impact import Flight
from vibroimpact.step.polynomial import (
    SMALLEST_NORMAL,
    TERMS,
    expand,
    first_crossing,
    value_and_slope,
)
from vibroimpact.step.propagator import extent

#: A turning point below the stop, and closer to it than this share of the ``extent`` of the motion,
#: is a near graze. It is missed if it comes after an impact in its step and within about this share
#: of the step before its end.
NEAR_GRAZE = 1e-9

_CERTIFIED, _CUT_SHORT = int(Status.CERTIFIED), int(Status.CUT_SHORT)


@jit
def stays_below(flight, end, bound, pieces, scale):
    """Whether a flight that starts on or below the stop is proved to stay below, in equal pieces.

    See ``propagator.py`` for the proof. `scale` is the ``extent`` of the motion. A slack excludes
    near grazes, also at the ends of the pieces: the undamped free oscillation turns there.
    """
    width = end / pieces
    for k in range(TERMS):
        scale += abs(flight[k])
    slack = 10.0 * NEAR_GRAZE * scale
    bound = bound * width**4 + slack
    if -slack < flight[0] < 0.0:
        return False
    y_0, w_0 = flight[0], flight[1] * width
    for j in range(pieces):
        y_1, w_1 = value_and_slope(flight, 0, end if j + 1 == pieces else width * (j + 1))
        w_1 *= width
        middle = y_0 + y_1 + (w_0 - w_1) * (1.0 / 3.0) + bound
        if not max(max(4.0 * y_0 + w_0, 4.0 * y_1 - w_1), max(middle, y_1 + slack)) < 0.0:
            return False
        y_0, w_0 = y_1, w_1
    return True


@inlined
def next_impact(flight, end):
    """Find where a flight meets the stop before u = `end`; return m, u and turn.

    m is the number of leading coefficients that are zero: 0 where the flight starts off the stop,
    and 4 where it has neither force nor speed, to underflow, and stays there. u is -1 if the flight
    does not meet the stop, NaN after an overflow. turn is the greatest y of the turning points
    before u, -inf if there is none.
    """
    m = 0
    while m < 3 and flight[m] == 0.0:  # terminates: m rises
        m += 1
    # The first four coefficients are y, w, a and a' at the start; they determine all others.
    if abs(flight[m]) < SMALLEST_NORMAL:
        if abs(flight[1]) + abs(flight[2]) + abs(flight[3]) < SMALLEST_NORMAL:
            return 4, -1.0, -math.inf
    if flight[m] > 0.0:
        return m, 0.0, -math.inf
    u, turn = first_crossing(flight, m, end)
    return m, u, turn


@inlined
def end_of_step(flight, m, dtheta, left, phase_step):
    """Return the state after the time `left` of a flight that does not meet the stop.

    The flight itself decides whether the mass turns before the end of the step: the next step
    begins with the same speed, so the turning point is counted once.
    """
    if m == 4:
        return 0.0, 0.0
    if math.isnan(dtheta):
        return math.nan, math.nan
    y, slope = value_and_slope(flight, 0, left / phase_step)
    return min(y, 0.0), slope / phase_step  # by rounding, the end may lie beyond the stop


@jit
def exact_flight(eq, launch, released, bound, left, phase_step, flight):
    """Follow a flight to the stop, for at most `left`; return its length, w_i, m and turn.

    The length is -1 if the flight does not meet the stop, NaN after an overflow; m and turn are as
    from ``next_impact``.
    """
    launched = launch.y == 0.0 and launch.w < 0.0
    if launched:
        dtheta, w_i = short_bounce(eq, launch)
        if not dtheta >= 0.0:
            dtheta, w_i = bounce(eq, launch, phase_step)
        if 0.0 < dtheta < left and is_first(launch.w, w_i, dtheta, bound, phase_step):
            return dtheta, w_i, 1, -math.inf
    expand(eq, launch.y, launch.w, launch.s, launch.c, phase_step, flight)
    if released:  # its speed and acceleration are zero, but for rounding
        flight[0] = flight[1] = flight[2] = 0.0
    end = left / phase_step
    for pieces in (2, 4):
        if stays_below(flight, end, bound, pieces, extent(eq)):
            return -1.0, 0.0, 0, -math.inf
    m, u, turn = next_impact(flight, end)
    w_i = launch.w
    if u > 0.0:
        w_i = max(u**m * value_and_slope(flight, m, u)[1] / phase_step, 0.0)
    return u * phase_step if u > 0.0 else u, w_i, m, turn


@jit
def exact_step(eq, pt, flight, resting, bound, phase, phase_step, scratch, n):
    """Take one step, or what is left of it from a flight on, with every impact in it.

    `flight` is a ``Flight`` that begins with the step, or else with a rebound; `resting` says
    whether the step begins at rest; `bound` is the remainder bound of the step, `phase` the phase
    at its start, and `n` the number of events so far in `scratch` (in the units of (x, v)). Returns
    y, w, resting, the number of events, the phase spent at rest, the status, and the number of near
    grazes.
    """
    events, coefficients, _ = scratch
    y, w, s, c, passed = flight
    stop, per_time, rebounds = pt.clearance, 1.0 / pt.omega, passed > 0.0
    grazes, rested, status = 0, 0.0, _CERTIFIED
    for _ in range(MAX_FLIGHTS):  # limits the loop even where `passed` does not rise
        left = phase_step - passed
        if rebounds:
            wait, outcome = phase_to_rest(eq, Flight(y, w, s, c, passed), phase + passed, left, pt)
            status = max(status, outcome)
            if wait < math.inf:
                speeds = speeds_until_rest(-w * pt.omega, wait * per_time, s, c, pt)
                passed += wait
                resting = True
                n = log_event(events, n, REST, passed * per_time, speeds, stop)
        released, rebounds = resting, False
        if resting:
            wait = pt.omega * time_to_release(phase + passed, pt)
            if phase_step - passed - wait <= RELEASE_MARGIN:
                return 0.0, 0.0, True, n, rested + (phase_step - passed), status, grazes
            passed += wait
            rested += wait if wait > RELEASE_MARGIN else 0.0
            s, c = sin_cos(phase + passed)
            n = log_release(events, n, passed * per_time, wait, pt)
            y, w, resting = 0.0, 0.0, False
        left = phase_step - passed
        dtheta, w_i, m, turn = exact_flight(
            eq, Flight(y, w, s, c, passed), released, bound, left, phase_step, coefficients
        )
        grazes += -NEAR_GRAZE * extent(eq) <= turn <= 0.0  # above 0 there is an impact instead
        if dtheta == 0.0 and m > 1:  # the flight starts on the stop and is pressed against it
            resting = True
            n = log_event(events, n, REST, passed * per_time, 0.0, stop)
            continue
        if not dtheta >= 0.0:
            y, w = end_of_step(coefficients, m, dtheta, left, phase_step)
            return y, w, False, n, rested, status, grazes
        passed += dtheta
        n = log_event(events, n, IMPACT, passed * per_time, w_i * pt.omega, stop)
        y, w, rebounds = 0.0, -pt.R * w_i, True
        s, c = wave_after(s, c, dtheta, phase + passed)
    n = log_event(events, n, REST, passed * per_time, 0.0, stop) - resting  # no second REST
    return 0.0, 0.0, True, n, rested + (phase_step - passed), _CUT_SHORT, grazes
