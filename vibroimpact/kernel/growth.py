"""Motions that grow without bound: resonance without dissipation.

Let R = 1 and h = 0. A flight at a great speed v lasts pi / p, so the force is in resonance if
omega = 2 k p for an integer k. To the first order in f / (p v), an impact at the phase phi and the
next one differ by

    dv = C cos(phi),    dphi = omega (2 clearance - B sin(phi)) / v,

with C = 4 k f / (p (4 k^2 - 1)) and B = C / (2 k p). If 2 |clearance| < B, the phase goes to where
dphi = 0 and cos(phi) > 0, and the speed grows by C cos(phi) at every impact, for ever. Otherwise,
and off the resonance, the phase passes through all values, and the speed stays bounded.
"""

from __future__ import annotations

import numpy as np

#: Rounding of omega / (2 p), for parameters that come from a computation.
_ROUNDING_OF_RATIO = 1e-12
#: A motion grows if its speed does so at least at this share of the rate of the resonance. One that
#: is not in step with the force has less, or falls again.
_SHARE = 0.5
#: Fewest sections in a third of a record that is judged.
_FEWEST = 10


def grows(points: np.ndarray, impacts: np.ndarray, sections: np.ndarray) -> np.ndarray:
    """Whether each motion grew through its record as an unbounded motion does.

    `impacts` is their number, and `sections` has the shape (n, periods, 2). In each third of the
    record the smallest section and the largest one must exceed those of the third before by
    ``_SHARE`` of the growth of the resonance.
    """
    p, f, stop = points["p"], points["f"], points["clearance"]
    with np.errstate(all="ignore"):  # extreme values, whose rate is then NaN or 0
        ratio = points["omega"] / (2.0 * p)
        k = np.rint(ratio)
        resonant = (k >= 1.0) & (np.abs(ratio - k) <= _ROUNDING_OF_RATIO * k)
        sine = p * p * stop * (4.0 * k * k - 1.0) / f
        # The growth of the speed in a forcing period; from impact to impact there are k.
        rate = 4.0 * f / (p * (4.0 * k * k - 1.0)) * np.sqrt(1.0 - sine * sine)
    lossless = (points["R"] == 1.0) & (points["h"] == 0.0)
    rows = np.flatnonzero(lossless & resonant & (rate > 0.0) & (impacts > 0))
    third = sections.shape[1] // 3
    found = np.zeros(points.size, dtype=bool)
    if third >= _FEWEST and rows.size > 0:
        x, v = sections[rows, -3 * third :, 0], sections[rows, -3 * third :, 1]
        thirds = np.hypot(p[rows, None] * x, v).reshape(rows.size, 3, third)
        extremes = np.stack([thirds.min(axis=2), thirds.max(axis=2)])
        least = _SHARE * third * rate[rows, None]
        found[rows] = (np.diff(extremes, axis=2) > least).all(axis=(0, 2))
    return found
