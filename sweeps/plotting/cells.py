"""The cells of a map, one per point, and their legend."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import Colormap, ListedColormap, Normalize
from matplotlib.patches import Patch

from sweeps.plotting.canvas import add_legend
from sweeps.plotting.labels import label_ordinate, log_spaced, set_scale
from sweeps.plotting.palette import STATUS_COLOURS
from sweeps.plotting.pixels import cell_edges
from sweeps.plotting.quantity_words import label
from vibroimpact.status import Status

#: Title of a legend of periodic classes.
CLASSES_TITLE = "periodic m/q: m forcing periods, q impacts per repetition"
#: The look of cells that were not computed yet.
_PENDING: dict[str, Any] = {
    "facecolor": "white", "edgecolor": "#888888", "hatch": "//////", "linewidth": 0.0
}  # fmt: skip


@dataclass(frozen=True)
class Cells:
    """The points of a map that have one colour.

    Attributes
    ----------
    label : str
        In the legend.
    colour : str
    where : ndarray of bool, shape of ``status``
        Which points they are.
    """

    label: str
    colour: str
    where: np.ndarray


def failed_cells(status: np.ndarray) -> list[Cells]:
    """Return the points that failed, by outcome."""
    return [
        Cells(outcome.name.lower().replace("_", "-"), colour, status == outcome)
        for outcome, colour in STATUS_COLOURS.items()
        if outcome is not Status.PENDING
    ]


def draw_cells(
    panel: Axes,
    cut: xr.Dataset,
    values: np.ma.MaskedArray,
    norm: Normalize,
    colours: str | Colormap,
) -> QuadMesh:
    """Draw one cell per point of a cut as for `draw_map`, except where `values` are masked."""
    y, x = (cut[str(name)].values for name in cut["status"].dims)
    edges = [cell_edges(values, log_spaced(values)) for values in (x, y)]
    mesh = panel.pcolormesh(*edges, values, norm=norm, cmap=colours, rasterized=True)
    panel.set(xlim=edges[0][[0, -1]], ylim=edges[1][[0, -1]])
    return mesh


def draw_map(panel: Axes, cut: xr.Dataset, kinds: Sequence[Cells], title_end: str = "") -> None:
    """Draw the cells of each kind and of the points that failed, their legend, and the axes.

    Parameters
    ----------
    panel : Axes
    cut : Dataset
        Its ``status`` has the ordinate and the abscissa as dimensions, both increasing.
    kinds : sequence of Cells
    title_end : str
        Added to the title of the legend if there are periodic classes.
    """
    y, x = (cut[name] for name in cut["status"].dims)
    set_scale(panel.xaxis, x.values)
    set_scale(panel.yaxis, y.values)
    panel.set_xlabel(label(x))
    label_ordinate(panel, y)
    status = cut["status"].values
    kinds = [kind for kind in (*kinds, *failed_cells(status)) if kind.where.any()]
    index = np.full(status.shape, -1)
    for number, kind in enumerate(kinds):
        index[kind.where] = number
    if kinds:
        colours = ListedColormap([kind.colour for kind in kinds])
        norm = Normalize(-0.5, len(kinds) - 0.5)
        draw_cells(panel, cut, np.ma.masked_equal(index, -1), norm, colours)
    handles = [
        Patch(facecolor=kind.colour, edgecolor="black", linewidth=0.4, label=kind.label)
        for kind in kinds
    ]
    pending = np.count_nonzero(status == Status.PENDING)
    if pending:
        panel.patch.set(**_PENDING)
        handles.append(Patch(label=f"not computed yet ({pending:,} of {status.size:,})"))
        handles[-1].set(**_PENDING)
    periodic = any("/" in kind.label for kind in kinds)
    title = f"{CLASSES_TITLE}{title_end}" if periodic else None
    add_legend(panel, handles, title, handlelength=1.2)
