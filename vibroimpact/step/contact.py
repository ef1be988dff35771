"""The stop: start, rest, release, impulse; events of an orbit in `Scratch`; a far stop.

A mass at rest on the stop stays while a = -f sin(omega t) - p^2 clearance is not negative. It is
released at the exact time at which a becomes negative. With a preload of p^2 |clearance| = f, a
reaches zero but never becomes negative: the mass stays for ever.

**A far stop.** Exact impacts follow x - clearance, in which a small motion in front of a far stop
has few digits. A motion without impacts is the free oscillation, of amplitude A, and a deviation
whose hypot(x, v / p) does not rise. So |x| stays below A + hypot(x0 - x_p, (v0 - v_p) / p), where
|x_p| <= A and |v_p| <= A omega. A stop that is not met does nothing: it may be anywhere beyond.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import inlined, jit
from vibroimpact.oscillator import with_one_force
from vibroimpact.step.elementary import asin, sin_cos
from vibroimpact.step.polynomial import SMALLEST_NORMAL, TERMS

#: Most flights of a step that are followed side by side with those of other lanes; and then alone.
SIDE_BY_SIDE, MAX_FLIGHTS = 6, 16384
#: A release this close in phase to the end of a step is left to the next step, because rounding
#: decides the sign of the force. The displacement is then of the order of the cube of this phase.
RELEASE_MARGIN = 1e-12

#: A stop is far beyond so many times the bound of the motion. It is then put at four to eight times
#: this bound, where the guard of a step proves the motion safe.
_FAR = 8192.0
#: A bound for a mass that stays at its rest position, at which products do not underflow.
_NO_MOTION = 1e-200

# Relative error of p^2 |clearance|, after three roundings. A force that exceeds a preload by less
# lifts the mass by only about 1e-30 f / omega^2.
_ROUNDING_OF_LEVEL = 4.5e-16

# The kinds of events in a step, and the columns of the buffer that holds them. TIME is since
# the start of the step; SPEED and DISPLACEMENT are those just before the event. The SPEED of a REST
# is the sum of the speeds of the impacts that a chatter's sum replaced. A flight has at most three
# events.
IMPACT, REST, RELEASE = 0, 1, 2
KIND, TIME, SPEED, DISPLACEMENT = 0, 1, 2, 3
EVENTS_SHAPE = (SIDE_BY_SIDE + 3 * MAX_FLIGHTS + 3, 4)


class Scratch(NamedTuple):
    """Memory for one step with impacts: its events, and the Taylor coefficients of a flight."""

    events: np.ndarray
    coefficients: np.ndarray
    lead: np.ndarray  #: The phases of a step before the first section, as in a ``PhaseGrid``.


@jit
def new_scratch():
    """Return scratch memory; one per thread."""
    return Scratch(np.empty(EVENTS_SHAPE), np.empty(TERMS), np.empty((3, 2)))


@jit
def pressing(s, pt):
    """Return the acceleration that presses a resting mass on the stop: eq. (1) at x = clearance."""
    return -pt.f * s - pt.p * pt.p * pt.clearance


@jit
def is_held(pt):
    """Whether a preload holds the mass for ever, to the rounding of p^2 clearance."""
    preload = -pt.p * pt.p * pt.clearance
    return preload > 0.0 and preload >= pt.f * (1.0 - _ROUNDING_OF_LEVEL)


@jit
def time_to_release(theta, pt):
    """Return the time from phase `theta` until the force pulls the mass off, inf for never."""
    if is_held(pt):
        return math.inf
    level = pt.p * pt.p * pt.clearance
    s, c = sin_cos(theta)
    a = pressing(s, pt)
    # If the force is about to press, only rounding decides the sign of a; the wait is then until
    # the following release.
    begins = a > -1e-14 * pt.f and c < 0.0
    if not (a > 0.0 or begins):
        return 0.0
    # The force turns to pulling where sin(omega t) = -level / f and cos(omega t) > 0.
    turn = -asin(level / pt.f)
    angle = (turn - theta) % (2.0 * math.pi)
    # The force begins to press at pi - turn, so the wait is at most pi + 2 turn. A longer one means
    # that theta is just past a release, by rounding: release now. So does NaN, where level > f.
    return angle / pt.omega if angle < 1.5 * math.pi + turn else 0.0


@jit
def start(pt, s):
    """Return the state just after the start, by rule (2)-(5), and whether the mass rests."""
    x, v = pt.x0, pt.v0
    if x >= pt.clearance and v > 0.0:
        return x, -pt.R * v, False
    return x, v, x == pt.clearance and v == 0.0 and (pressing(s, pt) > 0.0 or is_held(pt))


@jit
def speeds_until_rest(v, wait, s, c, pt):
    """Return the sum of the speeds before the impacts of a chatter that is replaced by its sum.

    The chatter begins with a rebound at speed `v`, at a phase with sine `s` and cosine `c`, and is
    complete after the time `wait`. The impulse at its impacts, (1 + R) times the sum, is that of
    the pressing force less `v`. Damping and spring contribute only at third order in `wait`.
    """
    push = (pressing(s, pt) - 0.5 * pt.f * pt.omega * c * wait) * wait
    return max(push - v, 0.0) / (1.0 + pt.R)


def impulse_and_loss(
    R: np.ndarray, speeds: np.ndarray, squares: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the impulse of impacts and the energy lost, per mass; they may overflow to inf.

    `speeds` and `squares` are the sums of the speeds before the impacts, and of their squares.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return (1.0 + R) * speeds, 0.5 * (1.0 - R) * (1.0 + R) * np.where(R < 1.0, squares, 0.0)


def with_near_stop(points: np.ndarray, impact: str) -> np.ndarray:
    """Return points with one force; with the rule ``exact``, far stops that are never met are near.

    The new clearance is a power of two. It depends on the start, so it must stay the same for all
    parts of a run.
    """
    points = with_one_force(points)
    if impact == "exact":
        h, omega, f, p, stop = (points[name] for name in ("h", "omega", "f", "p", "clearance"))
        with np.errstate(all="ignore"):  # resonance and extreme values, of which nothing is proved
            ratio = omega / p
            most = np.maximum(1.0, ratio)
            # No square of omega or p, which may underflow. The amplitude times `most` is f / p^2
            # over the hypotenuse of these two, which is at least the greater one.
            detuning = np.abs(p - omega) / p * ((1.0 + ratio) / most)
            damping = 2.0 * (h * (ratio / most) / p)
            resistance = np.maximum(np.maximum(detuning, damping), SMALLEST_NORMAL)
            start = np.abs(points["x0"]) + np.abs(points["v0"]) / p
            bound = np.maximum(start + 2.0 * (f / p / p / resistance), _NO_MOTION)
            nearer = np.ldexp(4.0, np.frexp(bound)[1])
        points["clearance"] = np.where(bound < stop / _FAR, nearer, stop)
    return points


@inlined
def log_event(events, n, kind, tau, v, x):
    """Write row `n` of the events of a step; return the new number of rows."""
    events[n, KIND] = kind
    events[n, TIME] = tau
    events[n, SPEED] = v
    events[n, DISPLACEMENT] = x
    return n + 1


@inlined
def log_release(events, n, tau, wait, pt):
    """Write that a mass is released, after the phase `wait` of rest; return the number of rows."""
    if wait <= RELEASE_MARGIN and n > 0 and events[n - 1, KIND] == REST:
        if events[n - 1, SPEED] == 0.0:
            return n - 1  # a rest of length 0 without an impact is none
    return log_event(events, n, RELEASE, tau, 0.0, pt.clearance)
