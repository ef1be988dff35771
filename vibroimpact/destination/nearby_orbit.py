"""The periodic `Orbit` near a section by Newton's method; evidence that a motion goes there.

A chaotic motion may pass a stable orbit, or stay beside it for a whole record. So a motion near a
stable orbit must show that it approaches it. Its distance from the orbit is measured in a norm in
which the linearised map contracts: with A = J / r and r between the greatest |multiplier| and 1,

    |z|^2 = z . G z,    G = 1 + A' G A,    so that |J z|^2 = r^2 (|z|^2 - z . z) < r^2 |z|^2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from vibroimpact.destination.section_map import follow
from vibroimpact.jit import inlined, jit
from vibroimpact.status import Evidence
from vibroimpact.step.elementary import hypot, log, sin_cos

#: Most iterations.
_MOST_NEWTON_STEPS = 10
#: An iteration has converged when its correction is below this; the correction is still made.
_CONVERGED = 1e-9
#: An orbit farther than this from the last section, in the units of the record, is not near it.
_NEARNESS = 0.2
#: An orbit may repeat a part of itself if its sections do so to within the first. It is that part
#: if Newton's method leads from it to a section within the second.
_NEARLY, _SAME = 1e-3, 1e-7
#: A multiplier below this is inside the unit circle, rounding included.
GREATEST_STABLE = 1.0 - 1e-9
#: A multiplier this far below -1 may have left a stable orbit of twice the period near by, at one
#: of these distances.
_FLIPPED, _DISTANCES = -1.5, (1e-1, 1e-2, 1e-3, 1e-4)


class Orbit(NamedTuple):
    """A periodic orbit at a section; m is 0 if there is none."""

    m: int
    q: int
    y: float
    w: float
    #: The derivative of the map of m periods in the units of the record, row after row.
    J: tuple[float, float, float, float]


_NO_ORBIT = Orbit(0, 0, 0.0, 0.0, (0.0, 0.0, 0.0, 0.0))


@inlined
def distance(y, w, orbit, size):
    """Return the distance of a state from an orbit at its section, in the units of the record."""
    return max(abs(y - orbit.y) / size[0], abs(w - orbit.w) / size[1])


@inlined
def greatest_multiplier(J):
    """Return the greatest |multiplier|, and the real part of this multiplier."""
    half, det = 0.5 * (J[0] + J[3]), J[0] * J[3] - J[1] * J[2]
    root = half * half - det
    if root < 0.0:
        return math.sqrt(det), half
    greatest = half + math.copysign(math.sqrt(root), half)
    return abs(greatest), greatest


@jit
def correction(flow, y, w, m, size):
    """Return Newton's correction of a state after m periods, the derivative J, and q.

    All are in the units of the record; q is -1 if the motion rests or overflows.
    """
    end = follow(flow, y, w, m, True)
    ((yy, wy), (yw, ww)), stretch = end.columns, size[1] / size[0]
    J = yy, yw * stretch, wy / stretch, ww
    missed_y, missed_w = (end.y - y) / size[0], (end.w - w) / size[1]
    det = (1.0 - J[0]) * (1.0 - J[3]) - J[1] * J[2]
    dy = ((1.0 - J[3]) * missed_y + J[1] * missed_w) / det
    dw = ((1.0 - J[0]) * missed_w + J[2] * missed_y) / det
    usable = end.smooth and math.isfinite(dy) and math.isfinite(dw)
    return dy, dw, J, end.impacts if usable else -1


@jit
def orbit_from(flow, y, w, m, size):
    """Return the ``Orbit`` of m periods to which Newton's method leads; it may repeat a part."""
    most, start_y, start_w = _NEARNESS, y, w
    for _ in range(_MOST_NEWTON_STEPS):
        dy, dw, J, q = correction(flow, y, w, m, size)
        length = max(abs(dy), abs(dw))
        if q < 0 or not length <= most:
            break
        y, w = min(y + dy * size[0], 0.0), w + dw * size[1]
        if max(abs(y - start_y) / size[0], abs(w - start_w) / size[1]) > _NEARNESS:
            break
        if length <= _CONVERGED:
            return Orbit(m, q, y, w, J)
        most = max(0.9 * length, _CONVERGED)
    return _NO_ORBIT


@jit
def nearby_orbit(flow, y, w, m, size):
    """Return the orbit of m periods, or of a divisor of m, near a state; it may be none."""
    orbit = orbit_from(flow, y, w, m, size)
    for m in range(1, orbit.m // 2 + 1):
        y, w = flow.passed[m - 1, 0], flow.passed[m - 1, 1]
        if orbit.m % m == 0 and distance(y, w, orbit, size) < _NEARLY:
            part = orbit_from(flow, orbit.y, orbit.w, m, size)
            if part.m > 0 and distance(part.y, part.w, orbit, size) < _SAME:
                return part
            follow(flow, orbit.y, orbit.w, orbit.m, False)  # restores what it passed
    return orbit


@jit
def doubled(flow, orbit, size):
    """Return the orbit of twice the period near an orbit that has flipped, if it is stable."""
    _, mu = greatest_multiplier(orbit.J)
    a, b, c, d = orbit.J
    if not _FLIPPED < mu < -1.0:
        return _NO_ORBIT
    # The eigenvector of mu, from the row of J - mu that is not zero.
    along = (b, mu - a) if abs(b) + abs(mu - a) > abs(c) + abs(mu - d) else (mu - d, c)
    length = max(abs(along[0]), abs(along[1]))
    for far in _DISTANCES:
        y = min(orbit.y + far * along[0] / length * size[0], 0.0)
        w = orbit.w + far * along[1] / length * size[1]
        twice = orbit_from(flow, y, w, 2 * orbit.m, size)
        if twice.m > 0 and distance(twice.y, twice.w, orbit, size) > _SAME:
            if greatest_multiplier(twice.J)[0] < GREATEST_STABLE:
                return twice
    return _NO_ORBIT


_UNREACHED, _CAPTURED = int(Evidence.UNREACHED), int(Evidence.CAPTURED)
_FALLING = int(Evidence.FALLING)

#: Number of points of the ellipse that are followed.
_ELLIPSE = 12
#: The ellipse is at least this large, in the units of the record, so that its map is no rounding.
_LEAST_ELLIPSE = 1e-9
#: After these numbers of repetitions it is tried whether the motion is captured.
_TRIALS = 0, 4, 12
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
    begin = length(y, w, orbit, size, G)
    now, before, done, falls = begin, math.inf, 0, True
    for trial in _TRIALS:
        while done < trial:  # terminates: `done` rises
            end = follow(flow, y, w, orbit.m, False)
            if not (end.smooth and end.impacts == orbit.q):
                return _UNREACHED
            y, w, done = end.y, end.w, done + 1
            before, now, last = now, length(y, w, orbit, size, G), before
            falls = falls and now < last
        if captured(flow, orbit, size, y, w, G, r):
            return _CAPTURED
    rate = -log(now / begin) / max(done, 1)
    agrees = rate > -_SHARE_OF_RATE * log(greatest)
    return _FALLING if falls and done > 1 and agrees else _UNREACHED
