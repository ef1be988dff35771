"""From the numbers of a sweep to the pixels that the page shows."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from bokeh.palettes import interp_palette

from sweeps.analysis.regimes import has_result
from sweeps.analysis.selection import dataset_of, recorded_coordinate
from sweeps.config.sweep import SweepConfig
from sweeps.explorer.view import Window
from sweeps.plotting.lines import count_pixels, widened
from sweeps.plotting.style import DENSITY, LEAST_SHARE

#: The number of colours; 0 is no colour.
_SHADES = 255


def ramp() -> list[str]:
    """Return the colours of the shares, from the least to 1; the same as in the files' pictures."""
    return list(interp_palette(DENSITY, _SHADES))


def ordinates(config: SweepConfig, results: Mapping[str, np.ndarray], ordinate: str) -> np.ndarray:
    """Return what a diagram shows of each point, shape (n, width); NaN where nothing."""
    values = recorded_coordinate(dataset_of(config, config.grid.axes, results), ordinate).values
    return np.where(has_result(results["status"])[:, None], values, np.nan)


def fitted(values: np.ndarray) -> Window:
    """Return a window that holds all values, with a margin of a twentieth."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0
    low, high = widened(float(finite.min()), float(finite.max()))
    if low == high:  # 0
        return -1.0, 1.0
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
