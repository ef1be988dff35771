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
from sweeps.plotting.labels import log_spaced
from sweeps.plotting.palette import STATUS_COLOURS
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
    """Draw one cell per point, except where `values` are masked.

    Parameters
    ----------
    panel : Axes
    cut : Dataset
        Its ``status`` has the ordinate and the abscissa as dimensions, both increasing.
    values : masked array, shape of ``status``
    norm : Normalize
    colours : str or Colormap
    """
    y, x = (cut[str(name)].values for name in cut["status"].dims)
    edges = [cell_edges(values, log_spaced(values)) for values in (x, y)]
    mesh = panel.pcolormesh(*edges, values, norm=norm, cmap=colours, rasterized=True)
    panel.set(xlim=edges[0][[0, -1]], ylim=edges[1][[0, -1]])
    return mesh


def draw_kinds(panel: Axes, cut: xr.Dataset, kinds: Sequence[Cells], title_end: str = "") -> None:
    """Draw the cells of each kind, and a legend of the kinds that are in view.

    Parameters
    ----------
    panel : Axes
    cut : Dataset
        As for `draw_cells`.
    kinds : sequence of Cells
    title_end : str
        Added to the title of the legend, where there are periodic classes.
    """
    kinds = [kind for kind in kinds if kind.where.any()]
    index = np.full(cut["status"].shape, -1)
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
    pending = cut["status"].values == Status.PENDING
    if pending.any():
        panel.patch.set(**_PENDING)
        handles.append(Patch(label=_pending_label(pending)))
        handles[-1].set(**_PENDING)
    title = _title(kinds, title_end)
    add_legend(panel, handles, title, handlelength=1.2)


def _pending_label(pending: np.ndarray) -> str:
    return f"not computed yet ({np.count_nonzero(pending):,} of {pending.size:,})"


def _title(kinds: Sequence[Cells], title_end: str) -> str | None:
    periodic = any("/" in kind.label for kind in kinds)
    return f"{CLASSES_TITLE}{title_end}" if periodic else None
