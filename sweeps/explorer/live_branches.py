"""The exact branches over the diagram, with the lines and marks of `plot --exact`."""

from __future__ import annotations

from functools import partial
from typing import Any

import xarray as xr
from bokeh.models import ColumnDataSource, HoverTool, LegendItem

from sweeps.bifurcation.exact_branches import branches_of, check_axis
from sweeps.config.sweep import SweepConfig
from sweeps.explorer.live_diagram import Diagram, numbers
from sweeps.explorer.view import DIAGRAM_TAB, View
from sweeps.explorer.worker import Step
from sweeps.interrupts import check
from sweeps.opened.motions import motions_from
from sweeps.plotting.style import STABLE, UNSTABLE, VERMILION

#: The dash style of each line and the marker of each special point, by name in the legend.
_LINES = {STABLE: "solid", UNSTABLE: "dashed"}
_GLYPHS = {"flip": "circle", "fold": "square", "graze": "triangle"}

#: Columns of data by the same names: abscissas, ordinates and class of every piece or mark.
Columns = dict[str, dict[str, list[Any]]]


class Branches:
    """The lines and marks over the figure of the diagram."""

    def __init__(self, diagram: Diagram) -> None:
        self._diagram = diagram
        #: The `_depends_on` of the view, and of the branches painted last.
        self._wanted: Any = None
        self._painted: Any = None
        #: The branches found last, with the configuration of the points they start from.
        self._found: tuple[SweepConfig, xr.Dataset] | None = None
        figure = diagram.figure
        self.sources = {
            name: ColumnDataSource(columns, name=name) for name, columns in _nothing().items()
        }
        self._items = []
        for name, source in self.sources.items():
            look: Any = {"source": source, "line_color": VERMILION, "visible": False}
            look["name"] = f"{name} marks"
            if name in _LINES:
                marks = figure.multi_line("x", "y", line_dash=_LINES[name], **look)
            else:
                look |= {"marker": _GLYPHS[name], "size": 6, "fill_color": "white"}
                marks = figure.scatter("x", "y", **look)
            said = f"{name}: class @orbit" if name in _LINES else f"{name} at @x{{0.0[000000]}}"
            figure.add_tools(HoverTool(renderers=[marks], tooltips=said, visible=False))
            self._items.append(LegendItem(label=name, renderers=[marks], visible=False))
        diagram.legend.items += self._items

    def show(self, view: View) -> None:
        """Show the painted branches only if they belong to this view."""
        self._wanted = _depends_on(view)
        self._show_wanted()

    def steps(self, view: View, columns: int) -> list[Step]:
        """Return the step that finds the branches, if the view shows them."""
        if not view.exact or view.tab != DIAGRAM_TAB:
            return []
        config = view.diagram(columns)
        find, show = partial(self._find, view, config), partial(self._paint, _depends_on(view))
        return [Step("exact branches", (config, view.ordinate), find, show)]

    def _find(self, view: View, config: SweepConfig) -> Columns:
        """Follow the branches from the points of the diagram; return the data of each part."""
        from sweeps.plotting.exact_lines import parts_of  # this import takes a second

        if self._found is None or self._found[0] != config:
            sweep = config.sweep
            check_axis(view.axis, sweep.grid.axes[view.axis], "it")
            line = motions_from(sweep.spec, sweep.grid.points(), numbers(config))
            phase = config.record.phase
            self._found = config, branches_of([line], view.axis, phase, lambda share: check())
        parts = _nothing()
        for name, x, y, _, orbit in parts_of(self._found[1], view.ordinate):
            columns, x = parts[name], config.nomenclature.value(view.axis, x)
            for column in y.T:
                columns["x"] += [x] if name in _LINES else x.tolist()
                columns["y"] += [column] if name in _LINES else column.tolist()
                columns["orbit"] += [orbit] if name in _LINES else [""] * len(x)
        return parts

    def _paint(self, depends_on: Any, parts: Columns, seconds: float) -> None:
        """Show the parts of the branches."""
        self._painted = depends_on
        for name, source in self.sources.items():
            source.data = parts[name]
        self._show_wanted()

    def _show_wanted(self) -> None:
        """Show the branches if they belong to the view, with a legend of the existing parts."""
        wanted = self._wanted is not None and self._wanted == self._painted
        for item, source in zip(self._items, self.sources.values(), strict=True):
            item.visible = item.renderers[0].visible = wanted and bool(source.data["x"])
        self._diagram.show_legend()


def _nothing() -> Columns:
    """Return the data for no branches: empty columns."""
    return {name: {"x": [], "y": [], "orbit": []} for name in (*_LINES, *_GLYPHS)}


def _depends_on(view: View) -> Any:
    """Return all that determines the shown branches, or None if the view shows none."""
    fixed = {name: value for name, value in view.values.items() if name != view.axis}
    return (view.axis, view.ordinate, fixed, view.record["phase"]) if view.exact else None
