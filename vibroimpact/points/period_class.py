"""Period class: the forcing periods and impacts after which a motion repeats."""

from __future__ import annotations

import numpy as np

#: A motion repeats if its sections agree to within this share of the greatest |x| and |v|.
TOLERANCE = 1e-6
#: A motion has period m only if its deviation from period m is less than this share of its
#: deviation from every divisor of m.
_LESS_THAN_DIVISORS = 0.01
#: Sections below this share of the clearance are measured by the clearance: they may be rounding.
_LEAST_SIZE = 1e-7
#: Longest period that is looked for [forcing periods].
LONGEST_PERIOD = 64


def period_class(
    points: np.ndarray,
    poincare_x: np.ndarray,
    poincare_v: np.ndarray,
    impacts_per_period: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Find the least number of forcing periods after which the sections repeat.

    A motion has period m if the whole record repeats its first m sections, in x and in v, to within
    ``TOLERANCE`` times the greatest |x| and |v| of the record. m is at most ``LONGEST_PERIOD`` and
    half the record. (It is not enough that each section equals the one m periods before. Near a
    flip a motion of period m settles from alternating sides, so slowly that it would seem to have
    period 2 m.)

    Near a flip a motion may also approach an orbit of period d from side to side, in turns of m
    periods. Then it does not have period m, even if its deviations are already within the
    tolerance. So the deviations from period m must be less than a hundredth of those from every
    divisor of m.

    Without a force a motion ends at its rest position, and its sections are rounding. So the
    greatest |x| and |v| count as at least 1e-7 of clearance and p clearance.

    The points have the dtype POINT and the shape (n,), the sections the shape (n, periods); the
    impacts per period are over the same record. Returns the forcing periods and the impacts per
    repetition: int64, shape (n,), 0 where no period was found. Of a complete chatter, only the
    impacts that were followed count.
    """
    n, periods = poincare_x.shape
    sections = np.stack([poincare_x, poincare_v])
    size = np.abs(sections).max(axis=2, keepdims=True, initial=0.0)
    least = _LEAST_SIZE * np.abs(points["clearance"])
    size = np.maximum(size, np.stack([least, points["p"] * least])[:, :, None])
    sections /= np.where(size == 0.0, 1.0, size)
    period = np.zeros(n, dtype=np.int64)
    for m in range(1, min(LONGEST_PERIOD, periods // 2) + 1):
        once = (np.abs(sections[:, :, m] - sections[:, :, 0]) <= TOLERANCE).all(axis=0)
        rows = np.flatnonzero((period == 0) & once)
        off = _deviation(sections[:, rows], m)
        repeats = off <= TOLERANCE
        for divisor in (d for d in range(1, m) if m % d == 0):
            repeats &= off <= _LESS_THAN_DIVISORS * _deviation(sections[:, rows], divisor)
        period[rows[repeats]] = m
    counted = np.nan_to_num(impacts_per_period) * period
    return period, np.rint(counted).astype(np.int64)


def _deviation(sections: np.ndarray, m: int) -> np.ndarray:
    """Return how far records deviate from repeating their first m sections, at most: (n,)."""
    repeated = sections[:, :, np.arange(sections.shape[2]) % m]
    return np.abs(sections - repeated).max(axis=(0, 2), initial=0.0)
