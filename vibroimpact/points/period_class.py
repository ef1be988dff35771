"""Period class: how many forcing periods, and impacts, until a motion repeats."""

from __future__ import annotations

import numpy as np

#: A motion repeats where its sections do to within this share of their spread about the origin.
TOLERANCE = 1e-6
#: m is the least period where m periods are off by less than this share of any divisor's deviation.
_LESS_THAN_DIVISORS = 0.01
#: Longest repetition that is looked for [forcing periods].
LONGEST_PERIOD = 64


def period_class(
    poincare_x: np.ndarray,
    poincare_v: np.ndarray,
    impacts_per_period: np.ndarray,
    tolerance: float = TOLERANCE,
) -> tuple[np.ndarray, np.ndarray]:
    """Find the least number of forcing periods after which the sections repeat.

    A motion has period m if the record repeats its first m sections to its end, in x and in v, to
    within `tolerance` times the greatest |x| and |v| of the record. (That each section equals the
    one m periods before it is not enough: beside a flip a motion of period m settles alternately,
    so slowly that it seems to have period 2 m.) m is at most ``LONGEST_PERIOD`` and half the
    record.

    A motion that still goes to an orbit of period d in turns of m periods, as beside a flip, is not
    of period m either, though its deviations may be within the tolerance by then: they must be less
    than a hundredth of those from a repetition after any divisor of m.

    The sections have the shape (n, periods), the impacts per period are over the same record.
    Returns forcing periods per repetition, 0 where none was found, and impacts per repetition, of
    which a complete chatter has as many as were followed: int64, shape (n,).
    """
    n, periods = poincare_x.shape
    sections = np.stack([poincare_x, poincare_v])
    size = np.abs(sections).max(axis=2, keepdims=True, initial=0.0)
    sections /= np.where(size == 0.0, 1.0, size)
    period = np.zeros(n, dtype=np.int64)
    for m in range(1, min(LONGEST_PERIOD, periods // 2) + 1):
        once = (np.abs(sections[:, :, m] - sections[:, :, 0]) <= tolerance).all(axis=0)
        rows = np.flatnonzero((period == 0) & once)
        off = _off_by(sections[:, rows], m)
        repeats = off <= tolerance
        for divisor in (d for d in range(1, m) if m % d == 0):
            repeats &= off <= _LESS_THAN_DIVISORS * _off_by(sections[:, rows], divisor)
        period[rows[repeats]] = m
    counted = np.nan_to_num(impacts_per_period) * period
    return period, np.rint(counted).astype(np.int64)


def _off_by(sections: np.ndarray, m: int) -> np.ndarray:
    """Return how far records are from repeating their first m sections, at the most, (n,)."""
    repeated = sections[:, :, np.arange(sections.shape[2]) % m]
    return np.abs(sections - repeated).max(axis=(0, 2), initial=0.0)
