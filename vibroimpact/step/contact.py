"""The stop: contact, rest and release, and the events of one step.

A mass at rest on the stop stays while a = -f sin(omega t) - p^2 clearance is not negative, and is
released at the exact time at which a becomes negative. Where p^2 |clearance| = f with a preload, a
becomes zero and not negative: the mass stays for ever.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import jit
from vibroimpact.step.series import TERMS
from vibroimpact.step.trigonometry import sin_cos

#: More flights than this in one step are not followed.
MAX_FLIGHTS = 16384
#: A release this near in phase to the end of a step is left to the next step, because rounding
#: decides the sign of the force. The displacement would be of the order of the cube of this phase.
RELEASE_MARGIN = 1e-12

# p^2 |clearance| is known to three roundings: this share of it.
_ROUNDING_OF_LEVEL = 4.5e-16

# The events of one step: their kinds, and the columns of the buffer that holds them (time since
# the start of the step, and the state just before). A rest has, for its speed, the sum of those of
# the impacts that were summed up to it. A flight ends in three events at the most.
IMPACT, REST, RELEASE = 0, 1, 2
KIND, TIME, SPEED, DISPLACEMENT = 0, 1, 2, 3
EVENTS_SHAPE = (3 * MAX_FLIGHTS + 3, 4)


class Scratch(NamedTuple):
    """Memory for one step with impacts: its events, and the coefficients of a flight."""

    events: np.ndarray
    coefficients: np.ndarray


@jit
def new_scratch():
    """Return scratch memory; one per thread."""
    return Scratch(np.empty(EVENTS_SHAPE), np.empty(TERMS))


@jit
def pressing(s, pt):
    """Acceleration that presses a mass at rest against the stop: eq. (1) at x = clearance.

    `s` is the sine of the phase.
    """
    return -pt.f * s - pt.p * pt.p * pt.clearance


@jit
def is_held(pt):
    """Whether there is a preload that the force never overcomes, to the rounding of p^2 clearance.

    A force that overcomes it by less lifts the mass by the order of 1e-30 f / omega^2.
    """
    preload = -pt.p * pt.p * pt.clearance
    return preload > 0.0 and preload >= pt.f * (1.0 - _ROUNDING_OF_LEVEL)


@jit
def time_to_release(theta, pt):
    """Return the time from phase `theta` until the force pulls; inf for never.

    It turns from pressing to pulling where sin(omega t) = -p^2 clearance / f, cos(omega t) > 0.
    """
    if is_held(pt):
        return math.inf
    level = pt.p * pt.p * pt.clearance
    s, c = sin_cos(theta)
    a = pressing(s, pt)
    # If the force is about to press, only rounding decides the sign of a; the release meant is the
    # following one.
    begins = a > -1e-14 * pt.f and c < 0.0
    if not ((a > 0.0 or begins) and level < pt.f):
        return 0.0
    turn = -math.asin(level / pt.f)
    angle = (turn - theta) % (2.0 * math.pi)
    # The force begins to press at pi - turn, so the wait is at most pi + 2 turn. A longer one means
    # that theta is just past a release, by rounding: release now.
    return angle / pt.omega if angle < 1.5 * math.pi + turn else 0.0


@jit
def start(pt, s):
    """Return the state just after the start and whether it is at rest: rule (2)-(5) on it.

    `s` is the sine of the phase at the start, 0 at t = 0.
    """
    x, v = pt.x0, pt.v0
    if x >= pt.clearance and v > 0.0:
        return x, -pt.R * v, False
    return x, v, x == pt.clearance and v == 0.0 and (pressing(s, pt) > 0.0 or is_held(pt))


@jit
def speeds_until_rest(v, wait, s, c, pt):
    """Return the sum of the speeds before the impacts of a chatter that was summed up.

    It begins with a rebound at speed `v`, at a phase with sine `s` and cosine `c`, and rests after
    the time `wait`. The impulse (1 + R) times the sum is that of the pressing force, less `v`: what
    damping and spring add is of third order in `wait`.
    """
    push = (pressing(s, pt) - 0.5 * pt.f * pt.omega * c * wait) * wait
    return max(push - v, 0.0) / (1.0 + pt.R)


@jit(inline=True)
def log_event(events, n, kind, tau, v, x):
    """Write row `n` of the events of a step; return the number of rows with it."""
    events[n, KIND] = kind
    events[n, TIME] = tau
    events[n, SPEED] = v
    events[n, DISPLACEMENT] = x
    return n + 1
