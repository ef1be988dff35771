"""`Picture`: figure and panels of the asked size, room for title and legend; what is in view."""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any, NoReturn

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.ticker import FixedLocator, LogLocator, MaxNLocator

from sweeps.errors import Refused
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting.labels import title as title_of
from sweeps.plotting.legend import SHARE, WIDTH, fit_legend, in_two_lines, legend_within
from sweeps.plotting.page import Page
from sweeps.plotting.pixels import figure_of, in_view, points_in
from sweeps.plotting.style import in_style
from sweeps.text import choice_of, listed, near_misses, shortened, suggestion, told_apart

#: Greatest height of a picture unless the page gives it, so that it fits a printed page [inch].
HIGHEST = 9.0
#: Least height of the panels, as a share of the usual one.
_LEAST_PANELS = 0.35
#: Least distance between the labels of ticks [inch].
_GAP = 0.06


class Picture(Figure):
    """A figure of this room, unknown to pyplot: Jupyter shows it once, as the value of a cell."""

    def __init__(self, page: Page, stretch: float = 1.0) -> None:
        """Make a figure with the width of the page, `stretch` times as high as usual."""
        size = (width_of(page), stretch * mpl.rcParams["figure.figsize"][1])
        super().__init__(figsize=size, layout="constrained")
        self._usual = size[1]  #: Height of the panels unless the page has its own [inch].
        self._height = page.height
        FigureCanvasAgg(self)  # measures texts

    def draw(self, renderer: RendererBase) -> None:
        """Draw the figure, with room for all labels at the final size of the panels."""
        # The engine measures ticks of panels of another size, and may never converge.
        engine = self.get_layout_engine()
        if isinstance(engine, ConstrainedLayoutEngine):
            self._lay_out()
            for panel in self.axes:
                panel.apply_aspect()  # a bar beside a panel fills only a part of its place
            boxes = [
                axis.get_tightbbox(renderer, for_layout_only=True)
                for panel in self.axes
                for axis in (panel.xaxis, panel.yaxis)
            ]
            sides = [(self.bbox.x0 - box.x0, box.x1 - self.bbox.x1) for box in boxes if box]
            beyond = np.max([(0.0, 0.0), *sides], axis=0)
            if beyond.any():
                room = beyond / self.bbox.width
                room[beyond > 0.0] += engine.get()["w_pad"] / self.get_figwidth()
                engine.set(rect=(room[0], 0.0, max(0.0, 1.0 - room.sum()), 1.0))
            if self.canvas.is_saving():  # draws twice, the first time for the layout only
                self._lay_out()
                return
        super().draw(renderer)

    def _lay_out(self) -> None:
        """Set the places of the panels; refuse a size in which labels leave no room for them."""
        with warnings.catch_warnings():
            warnings.filterwarnings("error", "constrained_layout not applied")
            try:
                lay_out(self.axes[0])
            except UserWarning:
                self._refuse_size("labels leave")

    def savefig(self, *arguments: Any, **options: Any) -> None:
        """Write the figure as matplotlib does, while other threads wait."""
        with in_style(common=False):
            super().savefig(*arguments, **options)

    def _repr_png_(self) -> bytes:
        """Draw the figure for Jupyter."""
        buffer = io.BytesIO()
        with in_style():
            self.savefig(buffer, format="png", dpi=150)
        return buffer.getvalue()

    def _refuse_size(self, what: str) -> NoReturn:
        """Refuse a size in which the labels leave or the legend has no room."""
        size, larger = f"a width of {self.get_figwidth():g} in", "a larger width"
        if self._height is not None:
            size, larger = f"{size} and a height of {self._height:g} in", f"{larger} or height"
        raise Refused(f"the {what} no room in {size}; expected: {larger}")

    def add_title(self, text: str) -> None:
        """Put a title above the panels, for which the figure becomes higher."""
        title = self.suptitle(text, wrap=True)
        fit_text("title", title)
        self.set_figheight(self.get_figheight() + title.get_window_extent().height / self.dpi)

    def set_height(self) -> None:
        """Set the height of the page; refuse one that leaves too little of the panels."""
        height, beside = self._height, self.get_figheight() - self._usual
        least = math.ceil(10.0 * (beside + _LEAST_PANELS * self._usual)) / 10.0
        if height is None and least > HIGHEST:
            raise Refused(
                f"the picture would be at least {least:g} in high; expected: at most {HIGHEST:g} "
                "in, with fewer panels or a larger width, or a height that is given"
            )
        if height is not None and height < least:
            raise Refused(
                f"height = {height:g} in is not allowed; expected: at least {least:g} in, of which "
                f"title and legend take {beside:.1f} in"
            )
        self.set_figheight(min(self.get_figheight(), HIGHEST) if height is None else height)

    def add_legend(
        self,
        handles: Sequence[Artist],
        title: str | None,
        shares: Mapping[Artist, float] | None = None,
    ) -> None:
        """Put a legend below the panels, for which the figure becomes higher."""
        # It shrinks to fit a page, but that of a map, whose entries have `shares` of it, takes a
        # fifth of the height. If what covers much needs more, the panels become higher, too, but by
        # at most a half.
        room = SHARE / (1.0 - SHARE)
        heights = [room * (self.get_figheight() + more * self._usual) for more in (0.0, 0.5)]
        if shares is None:
            beside = self.get_figheight() - (1.0 - _LEAST_PANELS) * self._usual
            heights[1] = (self._height or HIGHEST) - beside
        elif self._height is not None:
            heights = [SHARE * self._height] * 2
        rooms = [(WIDTH * self.bbox.width, self.dpi * each) for each in heights]
        make = partial(self.legend, loc="outside lower center")
        whole = shares is None
        legend = fit_legend(make, handles, title, rooms, shares, whole)
        box = legend.get_window_extent()
        if box.width > self.bbox.width:
            self._refuse_size("legend has")
        legend_height = box.height / self.dpi
        least = 0.0 if whole else legend_height / SHARE
        self.set_figheight(max(self.get_figheight() + legend_height, least))


def fit_text(name: str, text: Text) -> None:
    """Refuse a text that matplotlib cannot draw; write one with too long a word smaller."""
    try:
        box, page = text.get_window_extent(), figure_of(text).bbox
        if (excess := max(box.width / page.width, box.height / page.height)) > 1.0:
            text.set_fontsize(0.8 * float(text.get_fontsize()) / excess)
    except (TypeError, ValueError, RecursionError):
        raise Refused(
            f"{name} = {shortened(repr(text.get_text()))} is not allowed; expected: a text with "
            f"formulas between $ and $, and \\$ for the sign, but matplotlib cannot draw it"
        ) from None


def _set_labels(panel: Axes, page: Page) -> None:
    """Set the labels of the page, where the panels that share an axis have theirs."""
    for name, text, beside in (
        ("xlabel", page.xlabel, panel.get_shared_x_axes()),
        ("ylabel", page.ylabel, panel.get_shared_y_axes()),
    ):
        if text is None:
            continue
        panels = [each for each in beside.get_siblings(panel) if getattr(each, f"get_{name}")()]
        for each in panels or [panel]:
            axis = each.xaxis if name == "xlabel" else each.yaxis
            axis.set_label_text(text, wrap=True)
            fit_text(name, axis.label)


def width_of(page: Page) -> float:
    """Return the width of a figure [inch]."""
    return float(page.width or mpl.rcParams["figure.figsize"][0])


def new_panel(ax: Axes | None, page: Page) -> Axes:
    """Return the panel to draw into: `ax`, or the only panel of a new figure."""
    return Picture(page).add_subplot() if ax is None else ax


def stacked_panels(page: Page, heights: Sequence[float], shared: Sequence[int]) -> list[Axes]:
    """Return panels of these relative heights; of those `shared` the last labels the abscissa."""
    # The `heights` are in units of the usual height.
    figure = Picture(page, sum(heights))
    panels = figure.subplots(len(heights), height_ratios=heights, squeeze=False)[:, 0]
    for number in shared[:-1]:
        panels[number].sharex(panels[shared[-1]])
        panels[number].tick_params(labelbottom=False)
    return list(panels)


def panel_grid(
    page: Page, count: int, across: int, height: float, sharex: bool = False
) -> list[Axes]:
    """Return so many panels with one ordinate, so many beside each other, of a relative height."""
    # The `height` is that of a row in units of the usual height.
    down = math.ceil(count / across)
    figure = Picture(page, height * down)
    grid = figure.subplots(down, across, squeeze=False, sharex=sharex, sharey=True).ravel()
    for unused in grid[count:]:
        unused.remove()
    return list(grid[:count])


def chosen_panels(requested: Sequence[str], available: Sequence[str]) -> list[str]:
    """Return the names of the panels that are requested, by default all that are available."""
    for name in requested:
        if name not in available:
            meant = suggestion(near_misses(name, available))
            raise Refused(f"there is no panel {name or repr(name)}{meant}; {choice_of(available)}")
        if requested.count(name) > 1:
            raise Refused(f"the panel {name} is asked for twice; expected: once")
    return [*(requested or available)]


def is_in_view(artist: Artist) -> bool:
    """Whether a line is within the limits, or at them; True for what only stands in a legend."""
    if not isinstance(artist, Line2D) or artist.axes is None or not len(artist.get_path()):
        return True
    artist.axes.get_xlim()  # matplotlib delays the limits
    path = artist.get_transform().transform_path(artist.get_path())
    view = artist.axes.bbox.padded(0.01)  # [px], for dots at the limits
    if artist.get_linestyle() == "None":
        return bool(view.count_contains(path.vertices))
    return bool(path.intersects_bbox(view, filled=False))


def _shows_data(panel: Axes) -> bool:
    """Whether cells, lines, dots or marks of failed points are within the limits of a panel."""
    if not all(line.get_visible() for line in panel.lines):  # of a density, whose pixels tell
        return True
    points, data = points_in(panel), panel.transData
    has_cells = not len(points) or any(isinstance(each, QuadMesh) for each in panel.collections)
    if has_cells or in_view(panel, *points.T).any():
        return True
    lines = [each for each in panel.lines if len(each.get_path()) and is_in_view(each)]
    return any(each.get_linestyle() == "None" or each.get_transform() == data for each in lines)


def _refuse_gap(panel: Axes, page: Page) -> None:
    """Refuse limits that show nothing of the data; name the values beside one range of a page."""
    panels = [panel] if page.ylim else panel.get_shared_x_axes().get_siblings(panel)
    if not any(map(_shows_data, panels)):
        points = points_in(panel)
        refuse_limits(page, points[np.isfinite(points).all(axis=1)][:, int(page.xlim is None)])


def refuse_limits(page: Page, values: np.ndarray) -> NoReturn:
    """Refuse the limits of a page; name those of the values that are beside a single range."""
    limits, ranges, values = {"xlim": page.xlim, "ylim": page.ylim}, list[str](), np.unique(values)
    for name, lim in limits.items():
        if lim is not None:
            after = int(values.searchsorted(lim[0]))
            low, high, *beside = told_apart(*lim, *values[max(0, after - 1) : after + 1])
            ranges.append(f"{name} = {low}:{high}")
    nearest = f"; the nearest values are {listed(beside)}" if beside and len(ranges) == 1 else ""
    raise Refused(f"there is nothing to draw with {' and '.join(ranges)}{nearest}")


def lay_out(panel: Axes) -> None:
    """Set the final place and size of a panel."""
    figure = figure_of(panel)
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)


def _thin_ticks(axis: Axis) -> None:
    """Choose fewer ticks of an axis where their labels would touch."""
    panel, locator = axis.axes, axis.get_major_locator()
    is_across = axis is panel.xaxis
    for fewer in range(len(axis.get_majorticklocs()) - 1, 0, -1):
        texts = [text for text in axis.get_majorticklabels() if text.get_text()]
        boxes = [text.get_window_extent() for text in texts if text.get_visible()]
        intervals = sorted(tuple(box.intervalx if is_across else box.intervaly) for box in boxes)
        gap = min((after[0] - before[1] for before, after in pairwise(intervals)), default=np.inf)
        if gap >= (_GAP * figure_of(panel).dpi if is_across else 0.0):
            return
        if isinstance(locator, MaxNLocator | FixedLocator):
            locator.set_params(nbins=fewer)
        elif isinstance(locator, LogLocator):
            locator.set_params(numticks=fewer)
        else:
            return
        lay_out(panel)


def _break_labels(figure: Figure) -> None:
    """Break labels longer than their panels into lines where they collide with others."""
    every = [axis for panel in figure.axes for axis in (panel.xaxis, panel.yaxis)]
    axes = [axis for axis in every if axis.label.get_text()]
    texts = [*(axis.label for axis in axes), *figure.texts]
    boxes = [text.get_window_extent() for text in texts]
    for axis, box in zip(axes, boxes, strict=False):
        room = axis.axes.bbox
        is_long = box.width > room.width or box.height > room.height
        if is_long and box.count_overlaps(boxes) > 1:  # with more than itself
            axis.label.set_text(in_two_lines(axis.label.get_text()))
            lay_out(axis.axes)


def _clear_offset(axis: Axis) -> None:
    """Put the label of an abscissa below the common part of its ticks where they would collide."""
    offset = axis.get_offset_text()
    box = offset.get_window_extent()
    if offset.get_text() and box.overlaps(axis.label.get_window_extent()):
        axis.labelpad += box.height * 72.0 / figure_of(axis).dpi
        lay_out(axis.axes)


def finish(
    panel: Axes,
    page: Page,
    cut: OpenedSweep,
    handles: Sequence[Artist] | None = None,
    legend_title: str | None = None,
    record: str | None = None,
    shares: Mapping[Artist, float] | None = None,
) -> Figure:
    """Put the title of a `cut` above a `Picture` and the legend below it; return the figure."""
    # In another figure, the panel gets the legend, and a title only if the page has one. `handles`
    # are by default those of the panel; `record` replaces that of the configuration in the title; a
    # map has `shares`.
    figure = figure_of(panel)
    handles = panel.get_legend_handles_labels()[0] if handles is None else handles
    handles = [handle for handle in handles if is_in_view(handle)]
    if page.xlim or page.ylim:
        _refuse_gap(panel, page)
    _set_labels(panel, page)
    if isinstance(figure, Picture):
        text = title_of(cut, record) if page.title is None else page.title
        if text:
            figure.add_title(text)
        if handles and page.legend:
            figure.add_legend(handles, legend_title, shares)
        figure.set_height()
        lay_out(panel)
        _break_labels(figure)
        for each in figure.axes:
            _thin_ticks(each.xaxis)
            _thin_ticks(each.yaxis)
            _clear_offset(each.xaxis)
    else:
        if page.title is not None:
            panel.set_title(page.title)
        if handles and page.legend:
            lay_out(panel)
            legend_within(panel, handles, legend_title, shares)
        for handle in handles:
            if handle.axes is None and not page.legend:
                panel.add_artist(handle)  # for a legend of the user
    return figure
