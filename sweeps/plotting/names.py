"""Names beside the lines and dots of a panel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from sweeps.plotting import canvas
from sweeps.plotting.regions import PER_INCH, box_of
from sweeps.plotting.style import ground, ink

#: Greatest distance of a name from its line, in heights of the name.
_NEAR = 1.0


def name_lines(panel: Axes, lines: Sequence[tuple[str, np.ndarray]]) -> None:
    """Write the name of each line beside it, where there is room between all lines.

    `lines` are points, shape (n, 2). Call this last, because the room is that of the finished
    panel.
    """
    from scipy.ndimage import distance_transform_edt, maximum_filter

    canvas.lay_out(panel)
    box, scale = panel.get_window_extent(), PER_INCH / canvas.figure_of(panel).dpi
    shape = [max(2, round(length * scale)) for length in (box.height, box.width)]
    pixels = [(name, _pixels(panel, points, shape)) for name, points in lines]
    taken = np.zeros(shape, bool)
    for line in panel.lines:
        if line.get_transform() == panel.transData:
            joined = line.get_linestyle() not in ("None", "")
            taken |= _pixels(panel, np.asarray(line.get_xydata()), shape, joined)
    for name, own in pixels:
        if not own.any():
            continue
        text = panel.text(
            0.0, 0.0, name, size="x-small", color=ink(), zorder=6,
            ha="center", va="center_baseline",
            path_effects=[withStroke(linewidth=1.8, foreground=ground())],
        )  # fmt: skip
        height, width = box_of(text)
        edge = np.pad(taken, 1, constant_values=True)
        free = ~maximum_filter(edge, (height, width))[1:-1, 1:-1]
        away = np.where(free, distance_transform_edt(~own), np.inf)
        least = away.min()
        if least > (0.5 + _NEAR) * height:
            text.remove()
            continue
        places = np.argwhere(away <= least + 1.0)
        middle = np.argwhere(own).mean(axis=0)
        row, column = places[np.argmin(np.abs(places - middle)[:, 1])].tolist()
        text.set_transform(panel.transAxes)
        text.set_position(((column + 0.5) / shape[1], (row + 0.5) / shape[0]))
        top, left = max(0, row - height // 2 - 1), max(0, column - width // 2 - 1)
        taken[top : row + height // 2 + 2, left : column + width // 2 + 2] = True


def _pixels(
    panel: Axes, points: np.ndarray, shape: Sequence[int], joined: bool = False
) -> np.ndarray:
    """Return the pixels of a panel, from the bottom, in which there are points, or their joints."""
    seen = np.zeros(shape, bool)
    places = panel.transAxes.inverted().transform(panel.transData.transform(points))
    places = places[:, ::-1] * shape
    if joined and len(places) > 1:
        along = np.linspace(0.0, 1.0, max(shape))[:, None, None]
        between = places[:-1] + along * np.diff(places, axis=0)
        places = between.reshape(-1, 2)
    places = np.floor(places[np.isfinite(places).all(axis=1)]).astype(int)
    places = places[((places >= 0) & (places < shape)).all(axis=1)]
    seen[places[:, 0], places[:, 1]] = True
    return seen
