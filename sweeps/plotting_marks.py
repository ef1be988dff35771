"""The marks of a picture: points, their density, the stop, and what was not computed."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure

from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status

# Okabe and Ito's colours, told apart with every kind of colour vision.
BLUE, VERMILION, ORANGE = "#0072B2", "#D55E00", "#E69F00"
STATUS_COLOURS = {
    Status.PENDING: "#CCCCCC",
    Status.UNRESOLVED: "#777777",
    Status.NON_FINITE: "#333333",
}
# Starts well away from white, so that a pixel met once is still seen.
DENSITY_COLOURS = LinearSegmentedColormap.from_list("density", ["#A6CBE3", BLUE, "#00263D"])


def draw_points(panel: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """Draw markers, the smaller the more of the panel they would cover."""
    counts, *_ = np.histogram2d(x, y, bins=(600, 300))
    size = float(np.clip(70.0 / math.sqrt(np.count_nonzero(counts)), 0.5, 3.5))
    (points,) = panel.plot(x, y, "o", color=BLUE, rasterized=True)
    points.set(markersize=size, markeredgewidth=0, alpha=float(np.clip(1e5 / len(y), 0.15, 1.0)))


def draw_density(figure: Figure, panel: Axes, x: np.ndarray, y: np.ndarray, columns: int) -> None:
    """Draw the share of each column's points that fall into each of its pixels."""
    space = np.geomspace if panel.get_xscale() == "log" else np.linspace
    edges = space(x.min(), x.max(), min(columns, 700) + 1), np.linspace(y.min(), y.max(), 351)
    counts, *_ = np.histogram2d(x, y, bins=edges)
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    share = np.ma.masked_equal(share, 0.0)
    mesh = panel.pcolormesh(
        *edges, share.T, norm=LogNorm(1e-3, 1.0, clip=True), cmap=DENSITY_COLOURS, rasterized=True
    )
    panel.use_sticky_edges = False  # leave the usual margin around the outermost values
    bar = figure.colorbar(mesh, ax=panel, pad=0.01, aspect=40)
    bar.set_label("share of the points of a column")


def draw_stop(draw: Callable[..., object], clearance: float, label: bool = True) -> None:
    symbol = PARAMETERS["clearance"].symbol
    text = rf"stop, $x = {symbol} = {mathtext(clearance)}$" if label else None
    draw(clearance, color="black", linewidth=0.8, linestyle="--", label=text)


def guard(limit: Callable[..., object], values: np.ndarray) -> None:
    """Keep rounding errors about a constant from being blown up to the panel's size."""
    size = float(np.abs(values).max())
    if np.ptp(values) < 1e-6 * size:
        limit(values.mean() - 0.5 * size, values.mean() + 0.5 * size)


def mark_status(figure: Figure, panel: Axes, values: np.ndarray, status: np.ndarray) -> None:
    """Mark what failed or was not computed yet in a strip below the data."""
    found = [s for s in STATUS_COLOURS if (status == s).any()]
    if not found:
        return
    low, high = panel.get_ylim()
    panel.set_ylim(low - 0.04 * (high - low), high)
    strip = panel.get_xaxis_transform()
    for one in found:
        at = values[status == one]
        (marks,) = panel.plot(at, np.full(at.shape, 0.015), "|", transform=strip, rasterized=True)
        marks.set(markersize=6, color=STATUS_COLOURS[one])
        text = f"{one.meaning} ({len(at)} of {len(values)})"
        panel.plot([], [], linewidth=5, color=STATUS_COLOURS[one], label=text)
    figure.legend(loc="outside lower center", ncols=1, frameon=False)


def mathtext(value: float) -> str:
    """Write a number in mathtext, where 1e+300 would be a product."""
    mantissa, e, exponent = f"{value:.6g}".partition("e")
    return rf"{mantissa} \times 10^{{{int(exponent)}}}" if e else mantissa
