"""Period class: how many forcing periods, and impacts, until a motion repeats."""

from __future__ import annotations

import numpy as np

#: A motion repeats where its sections do to within this share of their spread about the origin.
TOLERANCE = 1e-6
#: Longest repetition that is looked for [forcing periods].
LONGEST_PERIOD = 64


def period_class(
    poincare_x: np.ndarray,
    poincare_v: np.ndarray,
    impacts_per_period: np.ndarray,
    tolerance: float = TOLERANCE,
) -> tuple[np.ndarray, np.ndarray]:
    """Find the least number of forcing periods after which the sections repeat.

    A motion has period m if every section of the record equals the one m periods before it, in x
    and in v, to within `tolerance` times the greatest |x| and |v| of the record. m is at most
    ``LONGEST_PERIOD`` and half the record.

    Parameters
    ----------
    poincare_x, poincare_v : ndarray, shape (n, periods)
        The stroboscopic section.
    impacts_per_period : ndarray, shape (n,)
        Impacts per forcing period, over the same record.

    Returns
    -------
    period : ndarray of int, shape (n,)
        Forcing periods per repetition; 0 where none was found, and for NaN.
    period_impacts : ndarray of int, shape (n,)
        Impacts per repetition. In a complete chatter it counts the impacts that were followed.
    """
    n, periods = poincare_x.shape
    scales = [np.abs(q).max(axis=1, initial=0.0)[:, None] for q in (poincare_x, poincare_v)]
    found = np.zeros(n, dtype=np.int64)
    for m in range(1, min(LONGEST_PERIOD, periods // 2) + 1):
        repeats = np.ones(n, dtype=bool)
        for q, scale in zip((poincare_x, poincare_v), scales, strict=True):
            repeats &= (np.abs(q[:, m:] - q[:, :-m]) <= tolerance * scale).all(axis=1)
        found[(found == 0) & repeats] = m
    counted = np.nan_to_num(impacts_per_period) * found
    return found, np.rint(counted).astype(np.int64)
