"""The cells of a map, one per point: their colours by kind, and the legend of these."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.collections import QuadMesh
from matplotlib.colors import Colormap, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from sweeps.analysis.motion import Motion
from sweeps.plotting.labels import log_spaced
from sweeps.plotting.marks import STATUS_COLOURS, cell_edges
from vibroimpact.status import Status

#: Colours of the most frequent period classes: Okabe and Ito's, without vermilion and black.
PERIODIC = ("#0072B2", "#56B4E9", "#009E73", "#F0E442", "#E69F00", "#CC79A7")
OTHER_PERIODIC = "#D3E4B4"
REST = "#D55E00"
MOTIONS = {
    Motion.REST: ("with rest on the stop", REST),
    Motion.CHAOTIC: (r"chaotic, $\lambda_1 > 0$", "#000000"),
    Motion.NEUTRAL: (r"quasi-periodic or unsettled, $\lambda_1 \approx 0$", "#6A3D9A"),
    Motion.UNBOUNDED: ("unbounded", "#7A4A12"),
    Motion.UNDECIDED: ("undecided", "#CCCCCC"),
}
#: What a legend says of its periodic classes.
CLASSES = "periodic m/q: m forcing periods, q impacts per repetition"
#: Of cells that are left open, as not computed.
_OPEN: dict[str, Any] = {
    "facecolor": "white", "edgecolor": "#888888", "hatch": "//////", "linewidth": 0.0
}  # fmt: skip


@dataclass(frozen=True)
class Cells:
    """The points of a map that have one colour: its label and which they are."""

    text: str
    colour: str
    where: np.ndarray


def missing(status: np.ndarray) -> list[Cells]:
    """Return the kinds of the points that have no result."""
    return [
        Cells(one.name.lower().replace("_", "-"), colour, status == one)
        for one, colour in STATUS_COLOURS.items()
        if one is not Status.PENDING
    ]


def draw_cells(
    figure: Figure,
    cut: xr.Dataset,
    values: np.ma.MaskedArray,
    norm: Normalize,
    colours: str | Colormap,
) -> QuadMesh:
    """Draw one cell per point, up to halfway to its neighbours; masked ones are left open."""
    up, across = (cut[str(name)].values for name in cut["status"].dims)
    edges = [cell_edges(along, log_spaced(along)) for along in (across, up)]
    panel = figure.axes[0]
    mesh = panel.pcolormesh(*edges, values, norm=norm, cmap=colours, rasterized=True)
    panel.set(xlim=edges[0][[0, -1]], ylim=edges[1][[0, -1]])
    return mesh


def draw_kinds(figure: Figure, cut: xr.Dataset, kinds: Sequence[Cells], more: str = "") -> None:
    """Draw the points of each kind, and the legend of those that there are, titled with `more`."""
    kinds = [kind for kind in kinds if kind.where.any()]
    index = np.full(cut["status"].shape, -1)
    for number, kind in enumerate(kinds):
        index[kind.where] = number
    if kinds:
        colours = ListedColormap([kind.colour for kind in kinds])
        norm = Normalize(-0.5, len(kinds) - 0.5)
        draw_cells(figure, cut, np.ma.masked_equal(index, -1), norm, colours)
    handles = [
        Patch(facecolor=kind.colour, edgecolor="black", linewidth=0.4, label=kind.text)
        for kind in kinds
    ]
    pending = cut["status"].values == Status.PENDING
    if pending.any():
        figure.axes[0].patch.set(**_OPEN)
        handles.append(Patch(label=_share(pending)))
        handles[-1].set(**_OPEN)
    if handles:
        legend = figure.legend(
            handles=handles, loc="outside lower center", ncols=_columns(handles), frameon=False,
            handlelength=1.2, columnspacing=1.2, title=_title(kinds, more), title_fontsize=8.0,
        )  # fmt: skip
        legend.get_title().set_multialignment("center")


def _share(pending: np.ndarray) -> str:
    return f"not computed yet ({np.count_nonzero(pending):,} of {pending.size:,})"


def _columns(handles: Sequence[Patch]) -> int:
    """Return how many columns of labels, filled one after the other, fit beside each other."""
    lengths = [len(re.sub(r"[\\$_]|mbda|prox", "", str(patch.get_label()))) for patch in handles]
    for columns in (4, 3, 2):
        rows = math.ceil(len(lengths) / columns)
        widths = [max(lengths[i : i + rows]) + 4 for i in range(0, len(lengths), rows)]
        if sum(widths) <= 76:
            return columns
    return 1


def _title(kinds: Sequence[Cells], more: str) -> str | None:
    named = any("/" in kind.text for kind in kinds)
    return f"{CLASSES}{more}" if named else None
