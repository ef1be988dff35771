"""Computes the bifurcation diagram, fills its figure, and follows exact `Branches` over it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np
import xarray as xr
from bokeh import models
from bokeh.palettes import interp_palette

from sweeps.bifurcation.exact_branches import branches_of, check_axis
from sweeps.config.sweep import SweepConfig
from sweeps.engine.estimate import check_memory
from sweeps.engine.executors import Results, compute_all
from sweeps.errors import StoreError
from sweeps.explorer.figures import LEAST_PIXELS, PixelFigure, Report, Step, outer_edges, set_range
from sweeps.explorer.view import DIAGRAM_TAB, View, Window
from sweeps.interrupts import check
from sweeps.opened.coordinates import COORDINATES, coordinate_in
from sweeps.opened.motions import motions_from
from sweeps.plotting import style
from sweeps.plotting.pixels import pixels_of, widened
from sweeps.store.variables import bytes_per_point
from vibroimpact.points.regimes import has_result, shown_in_part
from vibroimpact.status import Status

#: Columns of the fine picture per column of the coarse one.
_COARSER = 4
#: The window of the ordinate before the first picture: values that no user would choose. Undoing
#: the first zoom, and reset, restore it.
_UNSEEN = (-0.123456789, 0.123456789)
#: Below this number of columns the legend has two columns.
_TWO_COLUMNS_BELOW = 480
#: Factors of the recorded periods in successive pictures of an unchanged view.
_RECORDS = (1, 4, 16, 64)
#: Number of colours; 0 stands for no colour.
_SHADES = 255

#: Fits the ordinate to the points of the last picture, unless the user has moved the ordinate. Only
#: the browser knows that at once; it tells the server, which need not know the fitted window.
_FIT = """
const fit = pixels.data.fit?.[0];
const fit_ordinate = () => {
  if (fits.active && fit) y.setv({start: fit[0], end: fit[1]}, {sync: false});
};
"""
#: A window that fits the points, or that before the first picture, is not one of the user.
_MOVED = f"""{_FIT}
const fitted = [{list(_UNSEEN)}, fit ?? []];
fits.active = fitted.some(([start, end]) => y.start === start && y.end === end);
fit_ordinate();
"""


def ramp() -> list[str]:
    """Return the colours of the shares from the least to 1, the same as those of `plot`."""
    return list(interp_palette(style.shades(style.BLUE, style.WHITE, "#000000"), _SHADES))


def ordinates(config: SweepConfig, results: Mapping[str, np.ndarray], ordinate: str) -> np.ndarray:
    """Return the ordinates of each point, shape (n, width); NaN where there is none."""
    clearance = config.sweep.grid.points()["clearance"][:, None]
    values = coordinate_in({**results, "clearance": clearance}, ordinate)
    return np.where(has_result(results["status"])[:, None], values, np.nan)


def fitted(values: np.ndarray) -> Window:
    """Return a window that holds all values, with a margin of 5 % on each side."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0
    low, high = widened(float(finite.min()), float(finite.max()))
    if low == high:  # 0
        return -1.0, 1.0
    margin = 0.05 * (high - low)
    return low - margin, high + margin


def density(values: np.ndarray, window: Window, rows: int) -> np.ndarray:
    """Return the share of a column's values in each pixel: 1 to 255, logarithmic; 0 for none."""
    # They are uint8 of shape (rows, columns): 1 for ``LEAST_SHARE`` or less, 255 for all values of
    # the column.
    columns = len(values)
    _, numbers = pixels_of(np.arange(columns), values, rows, *window)
    counts = np.bincount(numbers, minlength=columns * rows).reshape(columns, rows)
    column, row = np.nonzero(counts)
    share = counts[column, row] / counts.sum(axis=1)[column]
    shade = np.clip(1.0 - np.log(share) / np.log(style.LEAST_SHARE), 0.0, 1.0)
    pixels = np.zeros((rows, columns), np.uint8)
    pixels[row, column] = 1.0 + np.rint(shade * (_SHADES - 1))
    # Two pixels wide and high, so that the line of a periodic motion is visible.
    pixels[1:] = np.maximum(pixels[1:], pixels[:-1])
    pixels[:, 1:] = np.maximum(pixels[:, 1:], pixels[:, :-1])
    return pixels


@dataclass(frozen=True)
class Snapshot:
    """A picture of the diagram."""

    view: View
    config: SweepConfig
    results: Results
    window: Window  # of the ordinate
    pixels: np.ndarray  # uint8, shape (rows, columns)
    seconds: float  # time to compute the results

    @property
    def values(self) -> np.ndarray:
        """The values of the axis, in the units of the page."""
        axis, config = self.view.axis, self.config
        values: np.ndarray = config.nomenclature.value(axis, config.sweep.grid.axes[axis])
        return values

    def has(self, kind: Status | str) -> np.ndarray:
        """Return the mask of points with an outcome, or of those that show a part only."""
        if isinstance(kind, Status):
            return np.asarray(self.results["status"] == kind)
        if COORDINATES[self.view.ordinate].dimension != "impact":
            return np.zeros(len(self.values), bool)
        width = self.results["impact_v"].shape[1]
        return shown_in_part(self.results, self.config.record.periods, width)


class Diagram(PixelFigure):
    """The figure with its picture, the mark and the failed points; `report` as in `PixelFigure`."""

    def __init__(self, report: Report) -> None:
        super().__init__("diagram", report)
        #: The picture computed last.
        self.snapshot: Snapshot | None = None
        #: The window that fits all points of the last picture without a window of its own.
        self._fit: Window = _UNSEEN
        #: Whether the browser fits the ordinate to the points; before the first view it does not.
        self.fits = models.Toggle(visible=False, active=False, name="fits")
        self.figure.xgrid.grid_line_alpha = self.figure.ygrid.grid_line_alpha = 0.4
        self.set_colours(ramp())
        y = self.figure.y_range
        args = {"pixels": self.source, "y": y, "fits": self.fits}
        self.source.js_on_change("data", models.CustomJS(args=args, code=f"{_FIT}fit_ordinate();"))
        for end in ("start", "end"):
            y.js_on_change(end, models.CustomJS(args=args, code=_MOVED))
        self._strips = self._new_strips()
        self.mark = models.Span(
            dimension="height", location=0.0, visible=False, name="mark", line_width=2,
            line_color=style.VERMILION, hover_line_color=style.VERMILION, hover_line_width=4,
        )  # fmt: skip
        self.figure.add_layout(self.mark)

    def _new_strips(self) -> dict[Any, tuple[models.ColumnDataSource, models.LegendItem]]:
        """Return the marks of failed points, and of parts of repetitions, in a strip below."""
        self.figure.extra_y_ranges = {"strip": models.Range1d(0.0, 1.0)}
        strips, items = {}, []
        of_part = style.MARKS[style.PARTIAL][0]
        for kind, colour in (*style.STATUS_COLOURS.items(), (style.PARTIAL, of_part)):
            source = models.ColumnDataSource({"x": [], "y": []}, name=getattr(kind, "name", kind))
            marks = self.figure.scatter(
                "x", "y", source=source, marker="dash", angle=np.pi / 2.0, size=10,
                color=colour, y_range_name="strip",
            )  # fmt: skip
            items.append(models.LegendItem(label="", renderers=[marks], visible=False))
            strips[kind] = source, items[-1]
        self.legend = models.Legend(items=items, visible=False, orientation="horizontal")
        self.legend.update(margin=0, padding=2, border_line_color=None, label_text_font_size="11px")
        self.figure.add_layout(self.legend, "above")
        return strips

    def show(self, view: View) -> None:
        """Set the window, the labels and the mark."""
        self._view = view
        self.legend.ncols = 2 if self.size[0] < _TWO_COLUMNS_BELOW else "auto"
        self.set_axis("x", view.axis, view, view.xlim)
        self._label_ordinate()
        if view.ylim is not None or not self.fits.active:  # else the browser has its own window
            set_range(self.figure.y_range, view.ylim or self._fit)
        self.fits.active = view.ylim is None
        self.mark.update(location=view.values[view.axis], visible=view.marked, editable=view.marked)

    def move(self, across: float, upwards: float, size: float) -> None:
        """Move or scale the window, starting from the one that the browser has fitted."""
        if self.fits.active and (upwards or size != 1.0):
            set_range(self.figure.y_range, self._fit)
            self.fits.active = False
        super().move(across, upwards, size)

    def steps(self, view: View) -> list[Step]:
        """Return the steps that draw a view: first coarse, then fine, then with more periods."""
        columns, rows = self.resolution
        configs = self.configurations(view)
        computed = None if self.snapshot is None else self.snapshot.config
        if computed in configs:  # continue from the results computed last
            configs = configs[configs.index(computed) :]
        else:
            configs = [view.diagram(max(LEAST_PIXELS, columns // _COARSER)), *configs]
        shown = view.axis, view.ordinate, view.ylim, rows
        return [
            Step("diagram", (config, *shown), partial(self._draw, view, config, rows), self._paint)
            for config in configs
        ]

    def configurations(self, view: View) -> list[SweepConfig]:
        """Return the configuration of the view, and those with longer records that memory holds."""
        columns, configs = self.resolution[0], list[SweepConfig]()
        for times in _RECORDS:
            longer = {name: times * view.record[name] for name in ("periods", "impacts")}
            config = replace(view, record={**view.record, **longer}).diagram(columns)
            try:
                results = columns * bytes_per_point(config.sweep.spec)
                check_memory(results, f"a picture of {columns:,} points")
            except StoreError:
                if configs:
                    break
                raise
            configs.append(config)
        return configs

    def saved(self, view: View) -> SweepConfig:
        """Return the configuration to save: with the periods of the view, and the classes."""
        return view.diagram(self.resolution[0], ("period",))

    def _draw(self, view: View, config: SweepConfig, rows: int) -> Snapshot:
        """Compute a picture; if the configuration is the last one, only its pixels."""
        snapshot = self.snapshot
        begin = perf_counter()
        if snapshot is not None and snapshot.config == config:
            results, seconds = snapshot.results, snapshot.seconds
        else:
            results = compute_all(config.sweep)
            seconds = perf_counter() - begin
        values = ordinates(config, results, view.ordinate)
        window = fitted(values) if view.ylim is None else view.ylim
        pixels = density(values, window, rows)
        self.snapshot = Snapshot(view, config, results, window, pixels, seconds)
        return self.snapshot

    def _paint(self, picture: Snapshot, seconds: float) -> None:
        """Show a picture, the window that fits it, and the points that failed."""
        edges = outer_edges(picture.values, picture.view.axis in picture.view.log)
        if picture.view.ylim is None:
            self._fit = picture.window
            self._label_ordinate()
        self.set_pixels(picture.pixels, edges, picture.window, fit=[self._fit])
        for kind, (source, item) in self._strips.items():
            x = picture.values[picture.has(kind)]
            if len(x) or len(source.data["x"]):
                source.data = {"x": x, "y": np.full(len(x), 0.015)}
                text = kind.meaning if isinstance(kind, Status) else kind
                # A text alone would name a column.
                item.label = {"value": f"{text} ({len(x)} of {len(picture.values)})"}
                item.visible = bool(len(x))
        self.show_legend()
        self._report(picture.config, len(picture.values), picture.seconds, seconds)

    def _label_ordinate(self) -> None:
        """Set the label and the ticks of the ordinate for its window."""
        self.label("y", self._view.ordinate, self._view, self._view.ylim or self._fit)

    def show_legend(self) -> None:
        """Show the legend if it has a visible item."""
        self.legend.visible = any(item.visible for item in self.legend.items)


#: The dash style of each line and the marker of each special point, by name in the legend.
_LINES = {style.STABLE: "solid", style.UNSTABLE: "dashed"}
_GLYPHS = {"flip": "circle", "fold": "square", "graze": "triangle"}

#: Columns of data by the same names: abscissas, ordinates and class of every piece or mark.
Columns = dict[str, dict[str, list[Any]]]


class Branches:
    """The lines and marks over the figure of the diagram."""

    def __init__(self, diagram: Diagram) -> None:
        self._diagram = diagram
        #: The `_depends_on` of the view, and of the branches painted last.
        self._requested: Any = None
        self._painted: Any = None
        #: The branches found last, with the configuration of the points they start from.
        self._branches: tuple[SweepConfig, xr.Dataset] | None = None
        figure = diagram.figure
        self.sources = {
            name: models.ColumnDataSource(columns, name=name)
            for name, columns in _nothing().items()
        }
        self._items = []
        for name, source in self.sources.items():
            look: Any = {"source": source, "line_color": style.VERMILION, "visible": False}
            look["name"] = f"{name} marks"
            if name in _LINES:
                marks = figure.multi_line("x", "y", line_dash=_LINES[name], **look)
            else:
                look |= {"marker": _GLYPHS[name], "size": 6, "fill_color": "white"}
                marks = figure.scatter("x", "y", **look)
            said = f"{name}: class @orbit" if name in _LINES else f"{name} at @x{{0.0[000000]}}"
            figure.add_tools(models.HoverTool(renderers=[marks], tooltips=said, visible=False))
            self._items.append(models.LegendItem(label=name, renderers=[marks], visible=False))
        diagram.legend.items += self._items

    def show(self, view: View) -> None:
        """Show the painted branches only if they belong to this view."""
        self._requested = _depends_on(view)
        self._show_current()

    def steps(self, view: View, columns: int) -> list[Step]:
        """Return the step that finds the branches, if the view shows them."""
        if not view.exact or view.tab != DIAGRAM_TAB:
            return []
        config = view.diagram(columns)
        find, show = partial(self._find, view, config), partial(self._paint, _depends_on(view))
        return [Step("exact branches", (config, view.ordinate), find, show)]

    def _find(self, view: View, config: SweepConfig) -> Columns:
        """Follow the branches from the points of the diagram; return the data of each part."""
        from sweeps.plotting.exact_lines import branch_pieces  # this import takes a second

        if self._branches is None or self._branches[0] != config:
            sweep = config.sweep
            check_axis(view.axis, sweep.grid.axes[view.axis], "it")
            line = motions_from(sweep.spec, sweep.grid.points(), compute_all(sweep))
            phase = config.record.phase
            self._branches = config, branches_of([line], view.axis, phase, lambda share: check())
        pieces = _nothing()
        for name, x, y, _, orbit in branch_pieces(self._branches[1], view.ordinate):
            columns, x = pieces[name], config.nomenclature.value(view.axis, x)
            for column in y.T:
                columns["x"] += [x] if name in _LINES else x.tolist()
                columns["y"] += [column] if name in _LINES else column.tolist()
                columns["orbit"] += [orbit] if name in _LINES else [""] * len(x)
        return pieces

    def _paint(self, depends_on: Any, pieces: Columns, seconds: float) -> None:
        """Show the pieces of the branches."""
        self._painted = depends_on
        for name, source in self.sources.items():
            source.data = pieces[name]
        self._show_current()

    def _show_current(self) -> None:
        """Show the branches if they belong to the view, with a legend of the existing pieces."""
        is_current = self._requested is not None and self._requested == self._painted
        for item, source in zip(self._items, self.sources.values(), strict=True):
            item.visible = item.renderers[0].visible = is_current and bool(source.data["x"])
        self._diagram.show_legend()


def _nothing() -> Columns:
    """Return the data for no branches: empty columns."""
    return {name: {"x": [], "y": [], "orbit": []} for name in (*_LINES, *_GLYPHS)}


def _depends_on(view: View) -> Any:
    """Return all that determines the shown branches, or None if the view shows none."""
    fixed = {name: value for name, value in view.values.items() if name != view.axis}
    return (view.axis, view.ordinate, fixed, view.record["phase"]) if view.exact else None
