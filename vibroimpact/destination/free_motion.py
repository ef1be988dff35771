"""The proof that a motion goes to the free (steady) oscillation without impacts."""

from __future__ import annotations

import math

import numpy as np

from vibroimpact.destination.section_map import follow
from vibroimpact.jit import inlined, jit
from vibroimpact.step.elementary import asin, hypot, log, sin_cos

#: Most periods for which a motion without impacts is followed, besides those that are skipped.
_MOST_FOLLOWED = 1000
#: Share of the clearance by which a proof must hold, for rounding.
_MARGIN = 1e-12
#: Rounding error of the phase, in turns, per forcing period.
_ROUNDING_OF_PHASE = 1e-14
#: After so many periods it is tried to skip others, with a bound found in so many cells; after the
#: second number in so many, if the first bound is too wide. Most motions have met the stop before.
_TRIED, _CELLS = (2, 10), (16, 512)
#: Most steps of Euclid's algorithm; each halves the modulus at least.
_MOST_EUCLID_STEPS = 64


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
    """Whether a motion from a section has no impact any more; one that rests is not free yet."""
    pt = flow.pt
    if not steady[2] < pt.clearance * (1.0 - _MARGIN):
        return False
    for k in range(_MOST_FOLLOWED):
        if excess(pt, x, v, steady) < 0.0:
            return True
        off, rate = x - steady[0], v - steady[1]
        end = follow(flow, x - pt.clearance, v / pt.omega, 1, False)
        if end.impacts > 0 or not end.smooth:
            return False
        if pt.h >= pt.p and never_higher(pt, off, rate):
            return True
        x, v = end.y + pt.clearance, end.w * pt.omega
        if pt.h < pt.p and k >= _TRIED[0]:
            cells = _CELLS[0] if k < _TRIED[1] else _CELLS[1]
            skipped = quiet_periods(pt, x, v, steady, cells, flow.scratch.events)
            if skipped == math.inf:
                return True
            if skipped > 0.0:
                x, v = free_state(pt, x, v, steady, skipped)
    return False


@inlined
def never_higher(pt, off, rate):
    """Whether no period after the next can be higher, if the motion does not oscillate.

    The deviation `off` from the free oscillation has one extremum at most. It falls until it is
    negative for ever, or it is negative and never changes its sign.
    """
    fast = pt.h + math.sqrt((pt.h - pt.p) * (pt.h + pt.p))
    return rate <= 0.0 or rate + fast * off <= 0.0


@inlined
def deviation_of(pt, x, v, steady):
    """Return the deviation from the free oscillation: its frequency, amplitude and phase.

    At the time t it is amplitude exp(-h t) cos(frequency t - phase), for h < p.
    """
    frequency = math.sqrt((pt.p - pt.h) * (pt.p + pt.h))
    off = x - steady[0]
    side = (v - steady[1] + pt.h * off) / frequency
    return frequency, hypot(off, side), math.atan2(side, off)


@jit
def free_state(pt, x, v, steady, periods):
    """Return the state at a later section of a motion without impacts."""
    frequency, amplitude, phase = deviation_of(pt, x, v, steady)
    turns = frequency / pt.omega * periods
    s, c = sin_cos(2.0 * math.pi * (turns - math.floor(turns)) - phase)
    amplitude *= math.exp(-pt.h * periods * 2.0 * math.pi / pt.omega)
    return steady[0] + amplitude * c, steady[1] - amplitude * (pt.h * c + frequency * s)


@jit
def quiet_periods(pt, x, v, steady, cells, stack):
    """Return for how many periods a motion from a section provably has no impact; inf for ever.

    It had none in the period before, and h < p. About its maximum number k, the free oscillation is
    A cos(omega s), and the deviation is at most r_k exp(h |s|) cos(frequency s + angle_k). The
    angles of the maxima are in arithmetic progression. Those that lead to the stop are an interval
    about 0, which shrinks with r_k. So the first angle in the first interval is a bound.
    """
    frequency, amplitude, phase = deviation_of(pt, x, v, steady)
    per_period = 2.0 * math.pi / pt.omega
    lead = math.atan2(steady[1] / pt.omega, steady[0])  # to maximum number 0
    amplitude *= math.exp(-pt.h * lead / pt.omega)
    level = pt.clearance * (1.0 - _MARGIN)
    most = log(amplitude / (level - steady[2])) / (pt.h * per_period) + 2.0
    ratio = frequency / pt.omega
    slack = _ROUNDING_OF_PHASE * (1.0 + ratio) * (100.0 + max(most, 0.0))
    first = (ratio * lead - phase) / (2.0 * math.pi)
    widest = widest_angle(pt, amplitude, frequency, level, steady[2], cells)
    if widest < 0.0:
        return math.inf
    hit = first_within(first, ratio, widest / (2.0 * math.pi) + slack, stack)
    return math.inf if hit > most else max(hit - 1.0, 0.0)


@jit
def widest_angle(pt, amplitude, frequency, level, steady, cells):
    """Return a bound of the angles with which a maximum leads to a level; negative if none does."""
    widest, width = -1.0, math.pi / (pt.omega * cells)
    growth = math.exp(pt.h * width)
    for j in range(cells):
        amplitude *= growth
        _, c = sin_cos(math.pi * j / cells)
        share = (level - steady * c) / amplitude
        if share < 1.0:
            angle = 0.5 * math.pi - asin(share)
            widest = max(widest, frequency * width * (j + 1.0) + angle)
    return widest


@jit
def first_within(start, step, half, stack):
    """Return the least k >= 0 with start + k step within `half` of an integer; inf for none."""
    low = -half - start
    low -= math.floor(low)
    high = low + 2.0 * half
    return 0.0 if high >= 1.0 else first_multiple(step - math.floor(step), low, high, stack)


@jit
def first_multiple(step, low, high, stack):
    """Return the least k >= 0 with low <= k step <= high modulo 1, or inf.

    By Euclid's algorithm: k exceeds the modulus j times, where j is the answer for the multiples of
    the modulus, modulo the step.
    """
    modulus, depth, k = 1.0, 0, 0.0
    while low > 0.0 and depth < _MOST_EUCLID_STEPS:
        if 2.0 * step > modulus:  # count backwards
            step, low, high = modulus - step, modulus - high, modulus - low
        if not step > 0.0:
            k = math.inf
            break
        k = np.ceil(low / step)
        if k * step <= high:
            break
        stack[depth, 0], stack[depth, 1], stack[depth, 2] = step, modulus, low
        depth += 1
        k, modulus, step, low, high = 0.0, step, modulus % step, -high % step, -low % step
    while depth > 0:
        depth -= 1
        k = np.ceil((stack[depth, 2] + k * stack[depth, 1]) / stack[depth, 0])
    return k
