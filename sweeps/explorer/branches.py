"""The exact branches over the diagram: the lines and marks of the files' pictures."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from bokeh.models import ColumnDataSource, HoverTool, LegendItem

from sweeps.analysis.exact_branches import branches
from sweeps.analysis.selection import dataset_of
from sweeps.config.sweep import SweepConfig
from sweeps.explorer.diagram import Diagram, numbers
from sweeps.explorer.view import DIAGRAM, View
from sweeps.explorer.worker import Step
from sweeps.interrupts import check
from sweeps.plotting.style import VERMILION

#: What there is to see, by the name in the legend: the dashes of a line, or a marker.
_LINES = {"exact orbits, stable": "solid", "exact orbits, unstable": "dashed"}
_MARKERS = {"flip": "circle", "fold": "square", "graze": "triangle"}

#: Abscissas, ordinates and the name of the orbit of every piece.
Parts = Mapping[str, tuple[list[np.ndarray], list[np.ndarray], list[str]]]


class Branches:
    """The lines and marks over the figure of the diagram."""

    def __init__(self, diagram: Diagram) -> None:
        self._diagram = diagram
        self._drawn: Any = None
        #: The branches that were found last, and the configuration of their points.
        self._found: tuple[SweepConfig, xr.Dataset] | None = None
        figure = diagram.figure
        self.sources = {
            name: ColumnDataSource({"x": [], "y": [], "orbit": []}, name=name)
            for name in (*_LINES, *_MARKERS)
        }
        self._items = []
        for name, source in self.sources.items():
            look: Any = {"source": source, "line_color": VERMILION}
            if name in _LINES:
                marks = figure.multi_line("x", "y", line_dash=_LINES[name], **look)
            else:
                look |= {"marker": _MARKERS[name], "size": 6, "fill_color": "white"}
                marks = figure.scatter("x", "y", **look)
            said = f"{name}: class @orbit" if name in _LINES else f"{name} at @x{{0.0[000000]}}"
            figure.add_tools(HoverTool(renderers=[marks], tooltips=said, visible=False))
            self._items.append(LegendItem(label=name, renderers=[marks], visible=False))
        diagram.legend.items += self._items

    def show(self, view: View) -> None:
        """Remove the branches of other oscillators."""
        if self._drawn is not None and self._drawn != _depends_on(view):
            self._paint(None, {name: ([], [], []) for name in self.sources}, 0.0)

    def steps(self, view: View, columns: int) -> list[Step]:
        """Return the step that finds the branches, if they are wanted."""
        if not view.exact or view.tab != DIAGRAM:
            return []
        config = view.diagram(columns)
        find, show = partial(self._find, view, config), partial(self._paint, _depends_on(view))
        return [Step("exact branches", (config, view.ordinate), find, show)]

    def _find(self, view: View, config: SweepConfig) -> Parts:
        """Follow the orbits of the diagram's points; return the coordinates of each part.

        Raises
        ------
        Refused
            If the orbits do not depend on the axis.
        """
        from sweeps.plotting.exact import parts_of  # whose import takes a second

        if self._found is None or self._found[0] != config:
            dataset = dataset_of(config, config.grid.axes, numbers(config))
            self._found = config, branches(dataset, view.axis, check=check)
        parts: Parts = {name: ([], [], []) for name in self.sources}
        for name, x, y, _, orbit in parts_of(self._found[1], view.ordinate):
            for column in y.T:
                parts[name][0].append(x)
                parts[name][1].append(column)
                parts[name][2].append(orbit)
        return parts

    def _paint(self, depends_on: Any, parts: Parts, seconds: float) -> None:
        """Show the parts of the branches, and which there are."""
        self._drawn = depends_on
        for item, (name, source) in zip(self._items, self.sources.items(), strict=True):
            x, y, orbit = parts[name]
            if name in _MARKERS and x:
                x, y = list(np.concatenate(x)), list(np.concatenate(y))
                orbit = [""] * len(x)
            source.data = {"x": x, "y": y, "orbit": orbit}
            item.visible = bool(len(x))
        self._diagram.show_legend()


def _depends_on(view: View) -> Any:
    """Return what the branches in a window depend on, or None if no branches are wanted."""
    fixed = {name: value for name, value in view.values.items() if name != view.axis}
    return (view.axis, view.ordinate, fixed, view.record["phase"]) if view.exact else None
