"""The marks of a picture: points, their density, the stop, and what was not computed."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes

from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status

#: Of a PNG, and of what is drawn as pixels in an SVG or a PDF.
DPI = 300

# Okabe and Ito's colours, told apart with every kind of colour vision.
BLUE, VERMILION, ORANGE = "#0072B2", "#D55E00", "#E69F00"
STATUS_COLOURS = {
    Status.PENDING: "#CCCCCC",
    Status.UNRESOLVED: "#777777",
    Status.NON_FINITE: "#333333",
}


def draw_points(
    panel: Axes, x: np.ndarray, y: np.ndarray, colour: str = BLUE, scale: float = 1.0
) -> None:
    """Draw markers, the smaller the more of the panel they would cover."""
    counts, *_ = np.histogram2d(x, y, bins=(600, 300))
    size = scale * float(np.clip(70.0 / math.sqrt(np.count_nonzero(counts)), 0.5, 3.5))
    (points,) = panel.plot(x, y, "o", color=colour, rasterized=True)
    points.set(markersize=size, markeredgewidth=0, alpha=float(np.clip(1e5 / len(y), 0.15, 1.0)))


def draw_stop(draw: Callable[..., object], clearance: float, label: bool = True) -> None:
    symbol = PARAMETERS["clearance"].symbol
    text = rf"stop, $x = {symbol} = {mathtext(clearance)}$" if label else None
    draw(clearance, color="black", linewidth=0.8, linestyle="--", label=text)


def guard(limit: Callable[..., object], low: float, high: float) -> None:
    """Keep rounding errors about a constant from being blown up to the panel's size."""
    size = max(abs(low), abs(high))
    if high - low < 1e-6 * size:
        middle = 0.5 * (low + high)
        limit(middle - 0.5 * size, middle + 0.5 * size)


def mark_status(panel: Axes, values: np.ndarray, status: np.ndarray) -> None:
    """Mark what failed or was not computed yet in a strip below the data, with labels.

    Parameters
    ----------
    values : ndarray, shape (n,)
    status : ndarray, shape (n,) or (directions, n)
    """
    found = [s for s in STATUS_COLOURS if (status == s).any()]
    if not found:
        return
    low, high = panel.get_ylim()
    panel.set_ylim(low - 0.04 * (high - low), high)
    strip = panel.get_xaxis_transform()
    for one in found:
        at = np.broadcast_to(values, status.shape)[status == one]
        (marks,) = panel.plot(at, np.full(at.shape, 0.015), "|", transform=strip, rasterized=True)
        marks.set(markersize=6, color=STATUS_COLOURS[one])
        text = f"{one.meaning} ({len(at)} of {status.size})"
        panel.plot([], [], linewidth=5, color=STATUS_COLOURS[one], label=text)


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


def mathtext(value: float) -> str:
    """Write a number in mathtext, where 1e+300 would be a product."""
    mantissa, e, exponent = f"{value:.6g}".partition("e")
    return rf"{mantissa} \times 10^{{{int(exponent)}}}" if e else mantissa
