"""The impact rule ``exact``: every impact on the closed-form flow, to rounding, and none missed.

The guard. Over a step from (x, v) the acceleration is bounded by

    A = ((2h + p^2 T) |v| + p^2 |x| + f) / (1 - 2h T - p^2 T^2),

since |v| <= |v_0| + T A and |x| <= |x_0| + T |v| on it. A curve rises above its chord by at most
T^2 / 8 of its greatest |x''|, so a lane with max(x_0, x_T) + A T^2 / 8 < clearance did not touch
the stop between the grid points. Every other lane is examined: the first root of its flight is
found or excluded by ``flight.first_crossing``.

The rest of a step after an impact at time tau is the undisturbed end of the step plus the response
to the impulse, -(1 + R) v phi(T - tau), unless the mass can be back within the step: it cannot
before 2 R v / A.

Chatter. Let a be the acceleration that presses the mass at rest, epsilon = v / a after a rebound
at speed v, and beta = a' / a = -f omega cos(omega t) / a. Expanding one flight and one impact in
epsilon: the flight takes 2 epsilon (1 - 2/3 (beta + h) epsilon), and the next epsilon is
R epsilon (1 - 4/3 (beta + h) epsilon). Summed to the end, with eta = epsilon / (1 - R):

    time to rest = 2 eta - 4/3 (beta + h) eta^2 + O(eta^3).

The sum replaces the flights once eta is so small that the term left out is below rounding. With
R near 1 that takes more bounces than can be followed, and at R = 1 there is no end to them.

Underflow. Without a force a mass whose stop is at the equilibrium bounces for ever, each time lower
by the same factor. Where a flight from the stop is below the smallest normal number, displacement
and change of displacement over the step alike, the mass is put on the stop at rest, x = clearance
and v = 0: in free rest, since no force presses it. That is certified, within that number.

Overflow. Where a flight has a coefficient that is not finite, the step ends in NaN.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import jit
from vibroimpact.status import Status
from vibroimpact.step.flight import (
    LONGEST_STEP,
    SMALLEST_NORMAL,
    TERMS,
    expand,
    expansion,
    first_crossing,
    rising_root,
    value_and_slope,
)
from vibroimpact.step.stop import (
    IMPACT,
    MAX_FLIGHTS,
    RELEASE,
    RELEASE_MARGIN,
    REST,
    log_event,
    pressing,
    time_to_release,
)
from vibroimpact.step.trigonometry import sin_cos

#: The tail of a chatter is summed where eta times the rates of the system is below this: the
#: third-order term left out, relative to the first, is its square.
SHORTEST_TAIL = 1e-5
#: Above this R a chatter takes too many bounces to follow, or does not end at all. Bounces whose
#: epsilon times the rates of the system is below ``SHORTEST_BOUNCE`` are then taken for rest, and
#: the point is not certified: Status.SETTLED.
ENDLESS = 0.999
SHORTEST_BOUNCE = 1e-3
#: A turning point closer to the stop than this share of what the flight covers is a near graze.
NEAR_GRAZE = 1e-9

_CERTIFIED, _SETTLED = int(Status.CERTIFIED), int(Status.SETTLED)


def steps_needed(h: np.ndarray, p: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Return the least steps per forcing period for which the Taylor rows are exact."""
    return np.ceil(2.0 * np.pi * ((2.0 * h + p) / omega + 1.0) / LONGEST_STEP)


class Lane(NamedTuple):
    """What this rule needs of one parameter point and step length.

    Attributes
    ----------
    rows : ndarray, shape (4, TERMS)
        Taylor rows of the step.
    along_x, along_v, along_f : float
        Factors of |x|, |v| and 1 in the height A T^2 / 8 of the guard band.
    """

    rows: np.ndarray
    along_x: float
    along_v: float
    along_f: float


@jit
def guard(T, pt):
    """Return ``along_x``, ``along_v``, ``along_f`` for steps of length `T`."""
    pp = pt.p * pt.p
    height = T * T / 8.0 / (1.0 - 2.0 * pt.h * T - pp * T * T)
    # The bound is rounded up.
    height *= 1.0 + 1e-12
    return height * pp, height * (2.0 * pt.h + pp * T), height * pt.f


@jit(inline=True)
def reach(x, v, x_T, along_x, along_v, along_f):
    """Return a bound of x over a step, given the factors of its ``guard``."""
    return max(x, x_T) + (along_x * abs(x) + (along_v * abs(v) + along_f))


@jit
def time_to_rest(v, theta, s, c, left, pt):
    """Return the time until the chatter after a rebound at speed `v` is complete, and the status.

    It begins at phase `theta`, with sine `s` and cosine `c`. The time is inf where the chatter is
    not complete within the time `left`, or its sum is not yet exact. Where R is so near to 1 that
    it would take very many bounces, it is 0 once they are short, and the status says so.
    """
    a = pressing(s, pt)
    if not a > 0.0:
        return math.inf, _CERTIFIED
    if v == 0.0:
        return 0.0, _CERTIFIED
    beta = -pt.f * pt.omega * c / a
    # The rates of the system, a'' / a = f omega^2 sin(omega t) / a among them.
    rates = abs(beta) + pt.h + pt.p + pt.omega * (1.0 + math.sqrt(pt.f / a))
    shortness = rates * v / a
    if pt.R > ENDLESS and shortness < SHORTEST_BOUNCE:
        return 0.0, _SETTLED
    if not shortness < SHORTEST_TAIL * (1.0 - pt.R):
        return math.inf, _CERTIFIED
    eta = v / a / (1.0 - pt.R)
    tail = 2.0 * eta - 4.0 / 3.0 * (beta + pt.h) * eta * eta
    complete = tail <= min(left, time_to_release(theta, pt))
    return tail if complete else math.inf, _CERTIFIED


@jit(inline=True)
def rises(x, v, T, lane):
    """Whether a flight from (x, v) rises over a whole step, its speed v being more than A T."""
    height = lane.along_x * abs(x) + (lane.along_v * abs(v) + lane.along_f)
    return v * T > 8.0 * height + SMALLEST_NORMAL  # or the inverse of its slope would overflow


@jit(inline=True)
def next_impact(flight, end, rising, value, slope):
    """Find where a flight meets the stop.

    Parameters
    ----------
    end : float
        Where the search ends.
    rising : bool
        Whether the flight rises from u = 0 to u = 1 = `end`, where it has that value and slope.

    Returns
    -------
    m : int
        Number of leading coefficients that are zero: 0 where the flight starts off the stop, 4
        where it has neither force nor speed, to underflow, and stays there.
    u : float
        Where it meets the stop, -1 if it does not before `end`; NaN after an overflow.
    slope : float
        Its slope there, if it is `rising`.
    turn : float
        As from ``first_crossing``.
    pressed : bool
        Whether it cannot start at all: the mass is on the stop without speed, and is pressed.
    """
    if rising:
        u, slope = rising_root(flight, value, slope)
        return 0, u, slope, -math.inf, False
    m = 0
    while m < 3 and flight[m] == 0.0:  # ends: m rises
        m += 1
    # The first four are x - stop, v, a and a' there: they determine the others.
    if abs(flight[m]) < SMALLEST_NORMAL:
        if abs(flight[1]) + abs(flight[2]) + abs(flight[3]) < SMALLEST_NORMAL:
            return 4, -1.0, 0.0, -math.inf, False
    if flight[m] > 0.0:
        return m, 0.0, 0.0, -math.inf, m > 1
    u, turn = first_crossing(flight, m, end)
    return m, u, 0.0, turn, False


@jit(inline=True)
def impact_speed(flight, m, du, v, T):
    """The speed of a flight where it meets the stop; `v` where it starts there."""
    return max(du**m * value_and_slope(flight, m, du)[1] / T, 0.0) if du > 0.0 else v


@jit(inline=True)
def is_near_graze(flight, turn):
    """Whether a turning point that is `turn` beyond the stop is near it, on the flight's scale."""
    if turn == -math.inf:
        return False
    scale = 0.0
    for k in range(TERMS):
        scale += abs(flight[k])
    return abs(turn) <= NEAR_GRAZE * scale


@jit(inline=True)
def end_of_step(x_T, v_T, m, du, stop):
    """The state at the end of a step with `m` and `du` from ``next_impact``, `du` not >= 0."""
    if m == 4:
        return stop, 0.0
    if math.isnan(du):
        return math.nan, math.nan
    # The end of the step may lie beyond the stop by the rounding of its own map.
    return min(x_T, stop), v_T


@jit(inline=True)
def rebound(x_T, v_T, v, left, T, pt, lane):
    """The end of a step after one impact at speed `v`, `left` before it, and whether it is final.

    It is not where the mass may be back on the stop before.
    """
    response, rate, _ = expansion(lane.rows[1], left / T)
    impulse = -(1.0 + pt.R) * v
    height = lane.along_x * abs(pt.clearance) + lane.along_v * pt.R * v + lane.along_f
    final = 4.0 * left * height < pt.R * v * T * T  # left < 2 R v / A
    # Right after the impact the sum may round to beyond the stop.
    return min(x_T + impulse * response, pt.clearance), v_T + impulse * rate / T, final


@jit(leaf=True, internal=True)
def exact_step(x, v, x_T, v_T, resting, theta, s, c, step, pt, lane, scratch):
    """One step from phase `theta`, with every impact in it; called through ``impacts.mend``."""
    events, flight = scratch
    stop, T = pt.clearance, step / pt.omega
    u, n, grazes, rested = 0.0, 0, 0, 0.0
    undisturbed = True  # no impact yet, so that (x_T, v_T) is the end of the step
    status = _CERTIFIED
    for _ in range(MAX_FLIGHTS):  # whatever the times are: u need not rise
        released = resting
        if resting:
            wait = time_to_release(theta + step * u, pt) / T
            if step * (1.0 - u - wait) <= RELEASE_MARGIN:
                return stop, 0.0, True, n, rested + (1.0 - u) * T, status, grazes
            u += wait
            s, c = sin_cos(theta + step * u)
            rested += wait * T
            n = log_event(events, n, RELEASE, u * T, 0.0, stop)
            x, v, resting, undisturbed = stop, 0.0, False, False
        expand(lane.rows, x, v, s, c, stop, flight)
        if released:
            flight[0] = flight[1] = flight[2] = 0.0  # x, v, a vanish at a release, to rounding
        rising = undisturbed and x < stop and rises(x, v, T, lane)
        m, du, slope, turn, pressed = next_impact(flight, 1.0 - u, rising, x_T - stop, v_T * T)
        grazes += is_near_graze(flight, turn)
        if pressed:
            resting = True
            n = log_event(events, n, REST, u * T, 0.0, stop)
            continue
        if not du >= 0.0:
            if not undisturbed:
                x_T, v_T = value_and_slope(flight, 0, 1.0 - u)
                x_T, v_T = x_T + stop, v_T / T
            x, v = end_of_step(x_T, v_T, m, du, stop)
            return x, v, False, n, rested, status, grazes
        v = slope / T if rising else impact_speed(flight, m, du, v, T)
        u += du
        left = (1.0 - u) * T
        n = log_event(events, n, IMPACT, u * T, v, stop)
        if undisturbed:
            x_T, v_T, final = rebound(x_T, v_T, v, left, T, pt, lane)
            if final:
                return x_T, v_T, False, n, rested, status, grazes
        x, v, undisturbed = stop, -pt.R * v, False
        s, c = sin_cos(theta + step * u)
        wait, outcome = time_to_rest(-v, theta + step * u, s, c, left, pt)
        status = max(status, outcome)
        if wait < math.inf:
            u += wait / T
            resting = True
            n = log_event(events, n, REST, u * T, 0.0, stop)
    n = log_event(events, n, REST, u * T, 0.0, stop) - resting  # once only
    return stop, 0.0, True, n, rested + (1.0 - u) * T, _SETTLED, grazes
