"""The maps of the page: classes over two parameters, and basins over the starts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from time import perf_counter

import numpy as np
import xarray as xr
from bokeh.layouts import column
from bokeh.models import ColumnDataSource, Div, LinearColorMapper, Range1d
from bokeh.plotting import figure

from sweeps.analysis.results import as_dataset
from sweeps.config.sweep import SweepConfig
from sweeps.explore.diagram import numbers, set_range
from sweeps.explore.view import View, Window, bounds
from sweeps.explore.words import axis_label, plain
from sweeps.explore.worker import Step

#: Columns and rows of the pictures, from coarse to fine.
_SIZES = ((16, 10), (32, 20), (64, 40), (128, 80), (192, 120))
_CLEAR = "#00000000"


@dataclass(frozen=True)
class Tiles:
    """A map to draw.

    Attributes
    ----------
    config : SweepConfig
    kinds : list of (str, str, float)
        What there is: its label, its colour and its share of the points.
    x, y : ndarray
        Values of the abscissa and the ordinate.
    pixels : ndarray of uint8, shape (rows, columns)
        1 + the number of the kind; 0 for none.
    seconds : float
        That the numbers took.
    """

    config: SweepConfig
    x: np.ndarray
    y: np.ndarray
    kinds: list[tuple[str, str, float]]
    pixels: np.ndarray
    seconds: float


def _tiles(config: SweepConfig, x: str, y: str, by_start: bool) -> Tiles:
    """Compute a map, and put its points into kinds as the files' pictures do."""
    from sweeps.plotting.attractor_pictures import basin_cells
    from sweeps.plotting.cells import failed_cells
    from sweeps.plotting.maps import period_cells

    begin = perf_counter()
    results = numbers(config)
    seconds = perf_counter() - begin
    dataset: xr.Dataset = as_dataset(config, config.grid.axes, results)
    cut = dataset.transpose(y, x, ...)
    cells = basin_cells(cut, extensions=0) if by_start else period_cells(cut)
    pixels = np.zeros(cut["status"].shape, np.uint8)
    kinds = []
    for cell in (*cells, *failed_cells(cut["status"].values)):
        if cell.where.any():
            kinds.append((plain(cell.label), cell.colour, float(cell.where.mean())))
            pixels[cell.where] = len(kinds)
    return Tiles(config, cut[x].values, cut[y].values, kinds, pixels, seconds)


class Map:
    """A figure over two parameters.

    Parameters
    ----------
    name : str
        Of the figure.
    sweep : callable
        Returns the configuration of a view with so many columns and rows.
    axes : callable
        Returns the names of abscissa and ordinate.
    windows : callable
        Returns their windows.
    post, report : callable
        As for `sweeps.explore.diagram.Diagram`; `report` is given the
        configuration, the seconds that its numbers took, and those in all.
    """

    def __init__(
        self,
        name: str,
        sweep: Callable[[View, int, int], SweepConfig],
        axes: Callable[[View], tuple[str, str]],
        windows: Callable[[View], tuple[Window, Window]],
        post: Callable[[Callable[[], None]], None],
        report: Callable[[SweepConfig, float, float], None],
        x_range: Range1d | None = None,
    ) -> None:
        self._name, self._sweep, self._axes, self._windows = name, sweep, axes, windows
        self._post, self._report = post, report
        self.figure = figure(
            tools="pan,wheel_zoom,box_zoom,undo,redo,reset,save", active_scroll="wheel_zoom",
            x_range=Range1d(0.0, 1.0) if x_range is None else x_range, y_range=Range1d(0.0, 1.0),
            sizing_mode="stretch_both", min_height=150, name=name,
        )  # fmt: skip
        self.figure.toolbar.logo = None
        self.source = ColumnDataSource(
            {"image": [], "x": [], "y": [], "dw": [], "dh": []}, name=f"{name} pixels"
        )
        self._colours = LinearColorMapper(palette=[_CLEAR], low=-0.5, high=0.5)
        self.figure.image("image", color_mapper=self._colours, source=self.source)
        self.legend = Div(name=f"{name} legend", text="", sizing_mode="stretch_width")
        self.legend.margin = (0, 8, 4, 60)
        self.layout = column(self.figure, self.legend, sizing_mode="stretch_both")

    @property
    def windows(self) -> tuple[Window, Window]:
        """Those of the figure."""
        x, y = self.figure.x_range, self.figure.y_range
        return (x.start, x.end), (y.start, y.end)

    def show(self, view: View) -> None:
        """Set the windows and the labels."""
        (x, y), windows = self._axes(view), self._windows(view)
        self.figure.xaxis.axis_label, self.figure.yaxis.axis_label = axis_label(x), axis_label(y)
        for model, name, window in (
            (self.figure.x_range, x, windows[0]),
            (self.figure.y_range, y, windows[1]),
        ):
            set_range(model, window, bounds(name, view.values))

    def steps(self, view: View) -> list[Step]:
        """Return the steps that draw a view from coarse to fine."""
        steps = []
        for columns, rows in _SIZES:
            config = self._sweep(view, columns, rows)
            compute = partial(_tiles, config, *self._axes(view), "x0" in config.grid.axes)
            steps.append(Step(self._name, config, compute, self._paint_later))
        return steps

    def finest(self, view: View) -> SweepConfig:
        """Return the configuration of the finest picture."""
        return self._sweep(view, *_SIZES[-1])

    def _paint_later(self, tiles: Tiles, seconds: float) -> None:
        self._post(partial(self._paint, tiles, seconds))

    def _paint(self, tiles: Tiles, seconds: float) -> None:
        x, y = tiles.x, tiles.y
        cell_x, cell_y = ((ends[-1] - ends[0]) / (len(ends) - 1) for ends in (x, y))
        count = len(tiles.kinds)
        palette = [_CLEAR, *(colour for _, colour, _ in tiles.kinds)]
        self._colours.update(palette=palette, low=-0.5, high=count + 0.5)
        self.source.data = {
            "image": [tiles.pixels],
            "x": [x[0] - 0.5 * cell_x],
            "y": [y[0] - 0.5 * cell_y],
            "dw": [cell_x * len(x)],
            "dh": [cell_y * len(y)],
        }
        self.legend.text = _in_words(tiles.kinds)
        self._report(tiles.config, tiles.seconds, seconds)


def _in_words(kinds: Sequence[tuple[str, str, float]]) -> str:
    """Return a legend: what there is, in its colour."""
    texts = [
        f"<span style='white-space:nowrap'><span style='color:{colour}'>■</span> "
        f"{escape(label)}{'' if '%' in label else f' ({100.0 * share:.3g} %)'}</span>"
        for label, colour, share in kinds
    ]
    return " &nbsp; ".join(texts)
