"""The exact curves of flips, folds and grazes over a map."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from sweeps.analysis.exact_curves import CurveSearch

#: How the curves of each kind are drawn; and the points where they meet or turn.
_LOOK: dict[str, dict[str, Any]] = {
    "flip": {"color": "black", "linestyle": "-"},
    "fold": {"color": "black", "linestyle": (0, (4, 2))},
    "graze": {"color": "black", "linestyle": (0, (1, 1.5))},
}


def draw_curves(panel: Axes, search: CurveSearch) -> None:
    """Draw the curves of a search over a map of its axes, with their cusps and meetings."""
    limits = panel.get_xlim(), panel.get_ylim()
    edge = [withStroke(linewidth=1.5, foreground="white")]  # seen on black, too
    kinds = {curve.kind for curve in search.curves}
    for curve in search.curves:
        panel.plot(*curve.values.T, linewidth=0.7, zorder=4, path_effects=edge, **_LOOK[curve.kind])
        for point in curve.special:
            if point.kind in ("cusp", "flip"):
                (mark,) = panel.plot(*point.values, "D", color="black", zorder=5)
                mark.set(markersize=2.5, markerfacecolor="white", markeredgewidth=0.6)
    for kind in _LOOK:
        if kind in kinds:
            panel.plot([], [], linewidth=0.7, label=kind, **_LOOK[kind])
    panel.set_xlim(*limits[0])
    panel.set_ylim(*limits[1])
    if kinds:
        panel.legend(loc="lower right", fontsize=6.0, framealpha=0.8, borderpad=0.3)
