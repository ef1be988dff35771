"""The maps of the page: classes over two parameters, and basins over the starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from html import escape
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from bokeh.layouts import column
from bokeh.models import ColumnDataSource, Div, Range1d

from sweeps.analysis.selection import dataset_of
from sweeps.config.sweep import SweepConfig
from sweeps.explorer.diagram import numbers
from sweeps.explorer.pixel_figure import PixelFigure, outer_edges
from sweeps.explorer.view import BASINS, View, bounds
from sweeps.explorer.words import axis_label, plain
from sweeps.explorer.worker import Step

if TYPE_CHECKING:
    from sweeps.plotting.maps import Cells

#: Columns and rows of the pictures, from coarse to fine.
_SIZES = ((16, 10), (32, 20), (64, 40), (128, 80), (192, 120))
#: The columns of a disc.
_DISC = ("x", "y", "width", "height")


@dataclass(frozen=True)
class Tiles:
    """A map to draw.

    Attributes
    ----------
    config : SweepConfig
    kinds : list of (str, str, float)
        What there is: its label, its colour and its share of the points.
    pixels : ndarray of uint8, shape (rows, columns)
        1 + the number of the kind; 0 for none.
    discs : list of (float, float, float, float)
        The largest discs in the basins: x and v of their centre, width and height.
    seconds : float
        That the numbers took.
    """

    config: SweepConfig
    kinds: list[tuple[str, str, float]]
    pixels: np.ndarray
    discs: list[tuple[float, float, float, float]]
    seconds: float


def _tiles(config: SweepConfig, x: str, y: str, tab: int) -> Tiles:
    """Compute a map, and put its points into kinds as the files' pictures do."""
    from sweeps.plotting.maps import failed_cells, period_cells

    begin = perf_counter()
    results = numbers(config)
    seconds = perf_counter() - begin
    cut = dataset_of(config, config.grid.axes, results).transpose(y, x, ...)
    discs: list[tuple[float, float, float, float]] = []
    if tab == BASINS:
        cells = _basins(cut, discs)
    else:
        cells = period_cells(cut)
    pixels = np.zeros(cut["status"].shape, np.uint8)
    kinds = []
    for cell in (*cells, *failed_cells(cut["status"].values)):
        if cell.where.any():
            kinds.append((plain(cell.label), cell.colour, float(cell.where.mean())))
            pixels[cell.where] = len(kinds)
    return Tiles(config, kinds, pixels, discs, seconds)


def _basins(starts: xr.Dataset, discs: list[tuple[float, float, float, float]]) -> list[Cells]:
    """Return the basins over v0 and x0, and add the largest disc of each attractor to a list."""
    from sweeps.analysis.attractors import COUNTED_MOTIONS, attractors
    from sweeps.analysis.integrity import measures_of
    from sweeps.plotting.attractors import basin_cells

    found, basins = attractors(starts, extensions=0), []
    x, v, p = starts["x0"].values, starts["v0"].values, float(starts["p"])
    for cell, motion in zip(basin_cells(starts, found), found["motion"].values, strict=False):
        if motion in COUNTED_MOTIONS:
            stop, corner = float(starts["clearance"]), np.array([[x[0], v[0]]])
            radius, *centre, at_edge, _, _ = measures_of(cell.where.T, x, v, 1.0 / p, stop, corner)
            discs.append((centre[0], centre[1], 2.0 * radius, 2.0 * radius * p))
            label = f"{cell.label}; disc {'>= ' if at_edge else ''}{radius:.3g}"
            cell = cell._replace(label=label)
        basins.append(cell)
    return basins


class Map(PixelFigure):
    """The figure of a tab over two parameters.

    Parameters
    ----------
    name : str
        Of the figure.
    tab : int
        ``MAP`` or ``BASINS``.
    report : callable
        Is given the configuration, the seconds that its numbers took, and those in all.
    x_range : Range1d, optional
        As for `PixelFigure`.
    """

    def __init__(
        self,
        name: str,
        tab: int,
        report: Callable[[SweepConfig, float, float], None],
        x_range: Range1d | None = None,
    ) -> None:
        super().__init__(name, x_range)
        self._name, self._tab, self._report = name, tab, report
        self.figure.grid.visible = False
        self.discs = ColumnDataSource({column: [] for column in _DISC}, name=f"{name} discs")
        look = {"fill_alpha": 0.0, "line_color": "black"}
        self.figure.ellipse(*_DISC, source=self.discs, **look)
        self.legend = Div(name=f"{name} legend", text="", sizing_mode="stretch_width")
        self.legend.margin = (0, 8, 4, 60)
        self.layout = column(self.figure, self.legend, sizing_mode="stretch_both")

    def show(self, view: View) -> None:
        """Set the axes."""
        for side, (name, window) in zip("xy", view.plane(self._tab), strict=True):
            text = axis_label(name, view.units)
            self.set_axis(side, text, window, name in view.log, bounds(name, view.values))

    def steps(self, view: View) -> list[Step]:
        """Return the steps that draw a view from coarse to fine."""
        steps = []
        (x, _), (y, _) = view.plane(self._tab)
        for size in _SIZES:
            config = view.tiles(self._tab, *size)
            compute = partial(_tiles, config, x, y, self._tab)
            steps.append(Step(self._name, config, compute, partial(self._paint, view)))
        return steps

    def finest(self, view: View) -> SweepConfig:
        """Return the configuration of the finest picture."""
        return view.tiles(self._tab, *_SIZES[-1])

    def _paint(self, view: View, tiles: Tiles, seconds: float) -> None:
        """Show a map and its legend."""
        axes = tiles.config.grid.axes
        names = [name for name, _ in view.plane(self._tab)]
        x, y = (outer_edges(axes[name], name in view.log) for name in names)
        self.set_colours([colour for _, colour, _ in tiles.kinds])
        self.set_pixels(tiles.pixels, x, y)
        discs = np.reshape(tiles.discs, (-1, len(_DISC))).T.tolist()
        self.discs.data = dict(zip(_DISC, discs, strict=True))
        self.legend.text = " &nbsp; ".join(
            f"<span style='white-space:nowrap'><span style='color:{colour}'>■</span> "
            f"{escape(label)}{'' if '%' in label else f' ({100.0 * share:.3g} %)'}</span>"
            for label, colour, share in tiles.kinds
        )
        self._report(tiles.config, tiles.seconds, seconds)
