"""The periodic orbit near a section, by Newton's method, and its flip."""

from __future__ import annotations

import math
from typing import NamedTuple

from vibroimpact.destination.section_map import follow
from vibroimpact.jit import inlined, jit

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


@inlined
def no_orbit():
    """Return the ``Orbit`` that there is none."""
    return Orbit(0, 0, 0.0, 0.0, (0.0, 0.0, 0.0, 0.0))


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
        if length <= _CONVERGED:
            return Orbit(m, q, y, w, J)
        most = max(0.9 * length, _CONVERGED)
        if max(abs(y - start_y) / size[0], abs(w - start_w) / size[1]) > _NEARNESS:
            break
    return no_orbit()


@jit
def least_repetition(flow, orbit, size):
    """Return an orbit just found with the least number of periods after which it repeats."""
    for m in range(1, orbit.m // 2 + 1):
        y, w = flow.passed[m - 1, 0], flow.passed[m - 1, 1]
        if orbit.m % m == 0 and distance(y, w, orbit, size) < _NEARLY:
            part = orbit_from(flow, orbit.y, orbit.w, m, size)
            if part.m > 0 and distance(part.y, part.w, orbit, size) < _SAME:
                return part
            follow(flow, orbit.y, orbit.w, orbit.m, False)  # restores what it passed
    return orbit


@jit
def nearby_orbit(flow, y, w, m, size):
    """Return the orbit of m periods, or of a divisor of m, near a state; none if it is far."""
    orbit = least_repetition(flow, orbit_from(flow, y, w, m, size), size)
    return orbit if orbit.m > 0 and distance(y, w, orbit, size) <= _NEARNESS else no_orbit()


@jit
def doubled(flow, orbit, size):
    """Return the orbit of twice the period near an orbit that has flipped, if it is stable."""
    _, mu = greatest_multiplier(orbit.J)
    a, b, c, d = orbit.J
    if not _FLIPPED < mu < -1.0:
        return no_orbit()
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
    return no_orbit()
