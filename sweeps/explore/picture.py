"""From the numbers of a sweep to the pixels that the page shows."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sweeps.explore.view import Window
from sweeps.plotting.palette import DENSITY, LEAST_SHARE, STATUS_COLOURS
from sweeps.plotting.pixels import count_pixels
from vibroimpact.status import Status

#: The number of colours; 0 is no colour.
_SHADES = 255


def ramp() -> list[str]:
    """Return the colours of the shares, from the least to 1; the same as in the files' pictures."""
    ends = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in DENSITY])
    at = np.linspace(0.0, len(ends) - 1.0, _SHADES)
    channels = [np.interp(at, np.arange(len(ends)), ends[:, i]) for i in range(3)]
    rounded = np.rint(channels).astype(np.uint8)
    return [f"#{bytes(colour).hex()}" for colour in rounded.T]


def ordinates(results: Mapping[str, np.ndarray], ordinate: str) -> np.ndarray:
    """Return what a diagram shows of each point, shape (n, width); NaN where nothing."""
    failed = np.isin(results["status"], [status for status in Status if status.failed])
    return np.where(failed[:, None], np.nan, results[ordinate])


def fitted(values: np.ndarray) -> Window:
    """Return a window that holds all values, with a margin of a twentieth."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    size = max(abs(low), abs(high), 1e-300)
    if high - low < 1e-6 * size:  # rounding errors about a constant are not to fill the panel
        low, high = 0.5 * (low + high) - 0.5 * size, 0.5 * (low + high) + 0.5 * size
    margin = 0.05 * (high - low)
    return low - margin, high + margin


def density(values: np.ndarray, window: Window, rows: int) -> np.ndarray:
    """Return the share of each column's points in each pixel, as the number of its colour.

    Parameters
    ----------
    values : ndarray, shape (columns, width)
    window : (float, float)
        Of the ordinate.
    rows : int

    Returns
    -------
    ndarray of uint8, shape (rows, columns)
        From 1 for ``LEAST_SHARE`` on a logarithmic scale to 255 for all; 0 where there is none.
        A value is drawn two pixels wide and high: the line of a periodic motion is to be seen.
    """
    columns = len(values)
    counts = count_pixels(np.arange(columns), values, (columns, rows), *window)
    column, row = np.nonzero(counts)
    share = counts[column, row] / counts.sum(axis=1)[column]
    shade = np.clip(1.0 - np.log(share) / np.log(LEAST_SHARE), 0.0, 1.0)
    pixels = np.zeros((rows, columns), np.uint8)
    pixels[row, column] = 1.0 + np.rint(shade * (_SHADES - 1))
    pixels[1:] = np.maximum(pixels[1:], pixels[:-1])
    pixels[:, 1:] = np.maximum(pixels[:, 1:], pixels[:, :-1])
    return pixels


def outcomes(results: Mapping[str, np.ndarray], values: np.ndarray) -> dict[Status, np.ndarray]:
    """Return the values of the axis where a point failed, by outcome."""
    return {
        outcome: values[results["status"] == outcome]
        for outcome in STATUS_COLOURS
        if (results["status"] == outcome).any()
    }
