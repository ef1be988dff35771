"""What several pictures draw into a panel: points, the stop, and what was not computed."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes

from sweeps.plotting.labels import mathtext
from sweeps.plotting.palette import BLUE, STATUS_COLOURS
from sweeps.plotting.pixels import widened
from vibroimpact.oscillator import PARAMETERS


def draw_points(
    panel: Axes, x: np.ndarray, y: np.ndarray, colour: str = BLUE, scale: float = 1.0
) -> None:
    """Draw markers, the smaller the more of the panel they would cover."""
    counts, *_ = np.histogram2d(x, y, bins=(600, 300))
    size = scale * float(np.clip(70.0 / math.sqrt(np.count_nonzero(counts)), 0.5, 3.5))
    (points,) = panel.plot(x, y, "o", color=colour, rasterized=True)
    points.set(markersize=size, markeredgewidth=0, alpha=float(np.clip(1e5 / len(y), 0.15, 1.0)))


def draw_stop(draw_line: Callable[..., object], clearance: float, label: bool = True) -> None:
    """Draw the mechanical stop with a panel's `axhline` or `axvline`."""
    symbol = PARAMETERS["clearance"].symbol
    text = rf"stop, $x = {symbol} = {mathtext(clearance)}$" if label else None
    draw_line(clearance, color="black", linewidth=0.8, linestyle="--", label=text)


def widen_if_constant(set_limits: Callable[..., object], low: float, high: float) -> None:
    """Keep rounding errors about a constant from filling the panel whose limits can be set so."""
    ends = widened(low, high)
    if ends != (low, high):
        set_limits(*ends)


def mark_status(panel: Axes, values: np.ndarray, status: np.ndarray) -> None:
    """Mark what failed or was not computed yet in a strip below the data, with labels.

    The status has the shape of the `values` of the abscissa, (n,), or (directions, n).
    """
    present = [outcome for outcome in STATUS_COLOURS if (status == outcome).any()]
    if not present:
        return
    low, high = panel.get_ylim()
    panel.set_ylim(low - 0.04 * (high - low), high)
    strip = panel.get_xaxis_transform()
    for outcome in present:
        x = np.broadcast_to(values, status.shape)[status == outcome]
        (marks,) = panel.plot(x, np.full(x.shape, 0.015), "|", transform=strip, rasterized=True)
        marks.set(markersize=6, color=STATUS_COLOURS[outcome])
        text = f"{outcome.meaning} ({len(x)} of {status.size})"
        panel.plot([], [], linewidth=5, color=STATUS_COLOURS[outcome], label=text)
