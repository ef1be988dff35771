"""How many values of a diagram fall into each of its pixels."""

from __future__ import annotations

import numpy as np


def count_pixels(
    columns: np.ndarray, values: np.ndarray, shape: tuple[int, int], low: float, high: float
) -> np.ndarray:
    """Count the values in each pixel of a panel.

    Parameters
    ----------
    columns : ndarray of int, shape (k,)
        The column of each point, all of them in the panel.
    values : ndarray, shape (k, width)
        Of the ordinate; NaN where there is none.
    shape : (int, int)
        Columns and rows of the panel.
    low, high : float
        Range of its ordinate.

    Returns
    -------
    ndarray of int, shape `shape`
    """
    rows = shape[1]
    scaled = np.floor((values - low) * (rows / (high - low)))
    seen = (scaled >= 0.0) & (scaled < rows)  # NaN is not
    at = np.repeat(columns, seen.sum(axis=1)) * rows + scaled[seen].astype(np.int64)
    return np.bincount(at, minlength=shape[0] * rows).reshape(shape)
