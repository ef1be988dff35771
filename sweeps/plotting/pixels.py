"""Ranges of numbers as cells and pixels."""

from __future__ import annotations

import numpy as np


def pixels_of(
    columns: np.ndarray, values: np.ndarray, rows: int, low: float, high: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the values within a panel of so many `rows`: the place in `columns`, and the pixel.

    `columns`, shape (k,), are the columns of k points, all within the panel; `values`, shape
    (k, width), are their ordinates, with NaN for missing ones. The ordinate ranges from `low` to
    `high`. The pixels are numbered column by column.
    """
    scaled = np.floor((values - low) * (rows / (high - low)))
    seen = (scaled >= 0.0) & (scaled < rows)  # False for NaN
    place = np.repeat(np.arange(len(columns)), seen.sum(axis=1))
    return place, columns[place] * rows + scaled[seen].astype(np.int64)


def count_pixels(
    columns: np.ndarray, values: np.ndarray, shape: tuple[int, int], low: float, high: float
) -> np.ndarray:
    """Count the values in each pixel of a panel of a `shape`; the others are of `pixels_of`."""
    _, pixels = pixels_of(columns, values, shape[1], low, high)
    return np.bincount(pixels, minlength=shape[0] * shape[1]).reshape(shape)


def widened(low: float, high: float) -> tuple[float, float]:
    """Return a range, widened to the size of its values if they differ only by rounding."""
    size = max(abs(low), abs(high))
    if not high - low < 1e-6 * size:  # this also excludes NaN and infinity
        return low, high
    middle = 0.5 * (low + high)
    return middle - 0.5 * size, middle + 0.5 * size


def cell_edges(values: np.ndarray, log: bool) -> np.ndarray:
    """Return the n + 1 edges of the cells around n >= 2 increasing values.

    The edges lie halfway between the values, with `log` on a logarithmic scale.
    """
    values = np.log(values) if log else values
    inner = 0.5 * (values[1:] + values[:-1])
    edges = np.array([2.0 * values[0] - inner[0], *inner, 2.0 * values[-1] - inner[-1]])
    return np.exp(edges) if log else edges
