"""Windows, the pixels that values fall into, and the edges of cells."""

from __future__ import annotations

import numpy as np


def count_pixels(
    columns: np.ndarray, values: np.ndarray, shape: tuple[int, int], low: float, high: float
) -> np.ndarray:
    """Count the values in each pixel of a panel, an array of `shape`: its columns and rows.

    Parameters
    ----------
    columns : ndarray of int, shape (k,)
        The column of each point, all of them in the panel.
    values : ndarray, shape (k, width)
        Values of the ordinate; NaN for a missing value.
    shape : (int, int)
    low, high : float
        Range of the ordinate.
    """
    rows = shape[1]
    scaled = np.floor((values - low) * (rows / (high - low)))
    seen = (scaled >= 0.0) & (scaled < rows)  # NaN is not
    at = np.repeat(columns, seen.sum(axis=1)) * rows + scaled[seen].astype(np.int64)
    return np.bincount(at, minlength=shape[0] * rows).reshape(shape)


def widened(low: float, high: float) -> tuple[float, float]:
    """Return a range of values, widened to their size if they differ only by rounding."""
    size = max(abs(low), abs(high))
    if not high - low < 1e-6 * size:  # nor are NaN and infinity widened
        return low, high
    middle = 0.5 * (low + high)
    return middle - 0.5 * size, middle + 0.5 * size


def cell_edges(values: np.ndarray, log: bool) -> np.ndarray:
    """Return the edges of the cells around increasing values: halfway between neighbours.

    Parameters
    ----------
    values : ndarray, shape (n,)
        n >= 2.
    log : bool
        Whether halfway is meant on a logarithmic scale.

    Returns
    -------
    ndarray, shape (n + 1,)
    """
    values = np.log(values) if log else values
    inner = 0.5 * (values[1:] + values[:-1])
    edges = np.array([2.0 * values[0] - inner[0], *inner, 2.0 * values[-1] - inner[-1]])
    return np.exp(edges) if log else edges
