"""Evidence that a motion goes to a stable orbit: an ellipse around it, or its fall.

A chaotic motion may pass a stable orbit, or stay beside it for a whole record. So a motion near a
stable orbit must show that it approaches it. Its distance from the orbit is measured in a norm in
which the linearised map contracts: with A = J / r and r between the greatest |multiplier| and 1,

    |z|^2 = z . G z,    G = 1 + A' G A,    so that |J z|^2 = r^2 (|z|^2 - z . z) < r^2 |z|^2.
"""

from __future__ import annotations

import math

from vibroimpact.destination.nearby_orbit import greatest_multiplier
from vibroimpact.destination.section_map import follow
from vibroimpact.jit import inlined, jit
from vibroimpact.status import Evidence
from vibroimpact.step.elementary import hypot, log, sin_cos

_UNREACHED, _CAPTURED = int(Evidence.UNREACHED), int(Evidence.CAPTURED)
_FALLING = int(Evidence.FALLING)

#: Number of points of the ellipse that are followed.
_ELLIPSE = 12
#: The ellipse is at least this large, in the units of the record, so that its map is no rounding.
_LEAST_ELLIPSE = 1e-9
#: After these numbers of repetitions it is tried whether the motion is captured, as far as they
#: take no more than so many periods.
_TRIALS, _MOST_PERIODS = (0, 4, 12), 512
#: A motion falls at least at this share of the rate of the multipliers.
_SHARE_OF_RATE = 0.5


@jit
def norm_of(J, greatest):
    """Return G as (g11, g12, g22), and r."""
    r = math.sqrt(0.5 * (1.0 + greatest * greatest))
    a, b, c, d = J[0] / r, J[1] / r, J[2] / r, J[3] / r
    # g11 = 1 + a a g11 + 2 a c g12 + c c g22, and so on: three linear equations.
    k11, k12, k13 = 1.0 - a * a, -2.0 * a * c, -c * c
    k21, k22, k23 = -a * b, 1.0 - a * d - b * c, -c * d
    k31, k32, k33 = -b * b, -2.0 * b * d, 1.0 - d * d
    m11, m13 = k22 * k33 - k23 * k32, k12 * k23 - k13 * k22  # of the inverse, times det
    m21, m23 = k23 * k31 - k21 * k33, k13 * k21 - k11 * k23
    m31, m33 = k21 * k32 - k22 * k31, k11 * k22 - k12 * k21
    det = k11 * m11 + k12 * m21 + k13 * m31
    return ((m11 + m13) / det, (m21 + m23) / det, (m31 + m33) / det), r


@inlined
def length(y, w, orbit, size, G):
    """Return the distance of a state from an orbit in the norm G."""
    a, b = (y - orbit.y) / size[0], (w - orbit.w) / size[1]
    return math.sqrt(max(a * (G[0] * a + 2.0 * G[1] * b) + b * b * G[2], 0.0))


@jit
def captured(flow, orbit, size, y, w, G, r):
    """Whether the map takes the ellipse through a state, at 12 points from it on, inside, alike."""
    # With G = L L', the ellipse is the image of a circle under the inverse of L'.
    l11 = math.sqrt(G[0])
    l21 = G[1] / l11
    l22 = math.sqrt(G[2] - l21 * l21)
    b = l22 * (w - orbit.w) / size[1]
    a = l11 * (y - orbit.y) / size[0] + l21 * (w - orbit.w) / size[1]
    far = hypot(a, b)
    a_0, b_0 = (a / far, b / far) if far > 0.0 else (1.0, 0.0)
    radius = max(far, _LEAST_ELLIPSE)
    for k in range(_ELLIPSE):
        s, c = sin_cos(2.0 * math.pi * k / _ELLIPSE)
        b = radius * (a_0 * s + b_0 * c) / l22
        a = (radius * (a_0 * c - b_0 * s) - l21 * b) / l11
        start_y, start_w = orbit.y + a * size[0], orbit.w + b * size[1]
        if not start_y <= 0.0:
            return False
        end = follow(flow, start_y, start_w, orbit.m, False)
        inside = length(end.y, end.w, orbit, size, G) < 0.5 * (1.0 + r) * radius
        if not (inside and end.smooth and end.impacts == orbit.q):
            return False
    return True


@jit
def evidence(flow, orbit, y, w, size):
    """Return the evidence that the motion from a state goes to a stable orbit, or ``UNREACHED``."""
    greatest, _ = greatest_multiplier(orbit.J)
    G, r = norm_of(orbit.J, greatest)
    if not G[0] * G[2] - G[1] * G[1] > 0.0:  # rounding of an almost neutral orbit
        return _UNREACHED
    begin = length(y, w, orbit, size, G)
    now, before, done, falls = begin, math.inf, 0, True
    for trial in _TRIALS:
        if trial * orbit.m > _MOST_PERIODS:
            break
        while done < trial:  # terminates: `done` rises
            end = follow(flow, y, w, orbit.m, False)
            if not (end.smooth and end.impacts == orbit.q):
                return _UNREACHED
            y, w, done = end.y, end.w, done + 1
            before, now, last = now, length(y, w, orbit, size, G), before
            falls = falls and now < last
            if not now < 2.0 * begin:
                return _UNREACHED
        if captured(flow, orbit, size, y, w, G, r):
            return _CAPTURED
    rate = -log(now / begin) / max(done, 1)
    agrees = rate > -_SHARE_OF_RATE * log(greatest)
    return _FALLING if falls and done > 1 and agrees else _UNREACHED
