"""Motions without impacts: the free oscillation, and the proof that a motion goes there."""

from __future__ import annotations

import math

from vibroimpact.destination.section_map import follow
from vibroimpact.jit import inlined, jit
from vibroimpact.step.elementary import hypot, log

#: Most periods for which a motion without impacts is followed until its end is proved.
_MOST_PERIODS = 1000
#: Share of the clearance by which a proof must hold, for rounding.
_MARGIN = 1e-12


@jit
def steady_response(pt, sine, cosine):
    """Return the state (x, v) of the free oscillation at a phase, and its amplitude.

    x = Im X exp(i omega t) with X = -f / (p^2 - omega^2 + 2 i h omega).
    """
    real, imaginary = (pt.p - pt.omega) * (pt.p + pt.omega), 2.0 * pt.h * pt.omega
    square = real * real + imaginary * imaginary
    if pt.f == 0.0:
        return 0.0, 0.0, 0.0
    if not square > 0.0:
        return math.inf, math.inf, math.inf
    x = -pt.f / square * (real * sine - imaginary * cosine)
    v = -pt.f * pt.omega / square * (real * cosine + imaginary * sine)
    return x, v, pt.f / math.sqrt(square)


@inlined
def free_multiplier(pt):
    """Return the greatest |multiplier| of the free oscillation."""
    slow = pt.h - math.sqrt(max((pt.h - pt.p) * (pt.h + pt.p), 0.0))
    return math.exp(-slow * 2.0 * math.pi / pt.omega)


@inlined
def excess(pt, x, v, steady):
    """Return a bound of the greatest later x of a motion without impacts, less the clearance.

    The deviation from the free oscillation is a damped oscillation, whose hypot(x, v / p) does not
    rise.
    """
    deviation = hypot(x - steady[0], (v - steady[1]) / pt.p)
    return steady[2] + deviation - pt.clearance * (1.0 - _MARGIN)


@jit
def stays_free(flow, x, v, steady):
    """Whether a motion from a section has no impact any more; it is followed until this is known.

    It is not known, and the answer is no, if the motion is damped too little to be followed.
    """
    pt, left = flow.pt, steady[2] - flow.pt.clearance
    if not left < 0.0:
        return False
    rate = pt.h * 2.0 * math.pi / pt.omega
    for _ in range(_MOST_PERIODS):
        over = excess(pt, x, v, steady)
        if over < 0.0:
            return True
        # The deviation, over - left, must fall below -left.
        if not log((over - left) / -left) < rate * _MOST_PERIODS:
            return False
        end = follow(flow, x - pt.clearance, v / pt.omega, 1, False)
        if end.impacts > 0 or not end.smooth:
            return False
        x, v = end.y + pt.clearance, end.w * pt.omega
    return False
