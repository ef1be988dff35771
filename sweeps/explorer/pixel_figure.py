"""A figure of the page that holds one picture of pixels, with linear or logarithmic axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from bokeh.models import (
    BasicTicker,
    BasicTickFormatter,
    ColumnDataSource,
    LinearColorMapper,
    LinearScale,
    LogScale,
    LogTicker,
    PrintfTickFormatter,
    Range1d,
)
from bokeh.plotting import figure

from sweeps.explorer.view import Window
from sweeps.plotting.lines import cell_edges

_CLEAR = "#00000000"


class PixelFigure:
    """A figure with the tools that all pictures have.

    Parameters
    ----------
    name : str
    x_range : Range1d, optional
        That of another figure, with which this one shares its abscissa.
    """

    def __init__(self, name: str, x_range: Range1d | None = None) -> None:
        self.figure = figure(
            tools="pan,wheel_zoom,box_zoom,undo,redo,reset,save", active_scroll="wheel_zoom",
            x_range=x_range or Range1d(0.0, 1.0), y_range=Range1d(0.0, 1.0), name=name,
            sizing_mode="stretch_both", min_height=150, lod_threshold=None,
        )  # fmt: skip
        self.figure.toolbar.logo = None
        columns: dict[str, list[Any]] = {key: [] for key in ("image", "x", "y", "dw", "dh")}
        self.source = ColumnDataSource(columns, name=f"{name} pixels")
        self._colours = LinearColorMapper(palette=[_CLEAR], low=-0.5, high=0.5)
        self.figure.image("image", color_mapper=self._colours, source=self.source, level="image")

    @property
    def windows(self) -> tuple[Window, Window]:
        """Those of the figure."""
        x, y = self.figure.x_range, self.figure.y_range
        return (x.start, x.end), (y.start, y.end)

    def set_axis(self, side: str, label: str, window: Window, log: bool, allowed: Any) -> None:
        """Set the label, the window, the scale, and what the window may hold, of axis x or y."""
        axis = getattr(self.figure, f"{side}axis")
        axis.axis_label = label
        scale = LogScale if log else LinearScale
        if not isinstance(getattr(self.figure, f"{side}_scale"), scale):
            setattr(self.figure, f"{side}_scale", scale())
            axis.ticker = LogTicker() if log else BasicTicker()
            axis.formatter = PrintfTickFormatter(format="%g") if log else BasicTickFormatter()
        set_range(getattr(self.figure, f"{side}_range"), window, allowed)

    def set_colours(self, colours: Sequence[str]) -> None:
        """Set the colours of the pixels from 1 on; 0 has none."""
        self._colours.update(palette=[_CLEAR, *colours], low=-0.5, high=len(colours) + 0.5)

    def set_pixels(self, pixels: np.ndarray, x: Window, y: Window, **columns: list[Any]) -> None:
        """Show pixels, shape (rows, columns), between these edges."""
        edges = {"x": [x[0]], "y": [y[0]], "dw": [x[1] - x[0]], "dh": [y[1] - y[0]]}
        self.source.data = {"image": [pixels], **edges, **columns}


def outer_edges(values: np.ndarray, log: bool) -> Window:
    """Return the ends of the cells around increasing values."""
    low, *_, high = cell_edges(values, log).tolist()
    return low, high


def set_range(model: Range1d, window: Window, allowed: Any = None) -> None:
    """Set a range and what it may hold.

    The browser would cut the window of a new axis to what the old one may hold.
    """
    if model.bounds != allowed:
        model.bounds = None
    if (model.start, model.end) != window:
        model.update(start=window[0], end=window[1])
    model.bounds = allowed
