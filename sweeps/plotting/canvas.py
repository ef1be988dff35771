"""The figure, its title and legend, and marks in its panels."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Container, Mapping, Sequence
from contextlib import suppress
from itertools import pairwise
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator

from sweeps.errors import Refused
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting.labels import equation, status_name
from sweeps.plotting.labels import title as title_of
from sweeps.plotting.legend import SHARE, legend_below, legend_of_all, legend_within
from sweeps.plotting.page import Page
from sweeps.plotting.pixels import widened
from sweeps.plotting.style import (
    MARKS,
    STATUS_COLOURS,
    data_colour,
    ground,
    ink,
    user_style,
    visible,
)
from sweeps.text import choice_of, near_miss, shortened, suggestion

#: Greatest height of a picture unless the page gives it, so that it fits a printed page [inch].
HIGHEST = 9.0
#: Least height of the panels, as a share of the usual one.
_LEAST_PANELS = 0.35
#: Least distance between the labels of ticks [inch].
_GAP = 0.06
#: Most markers of one look across a panel.
_MARKS = 20


class _Canvas(FigureCanvasAgg):
    """Measures all texts with one parser, so that a formula is parsed once for all heights."""

    def get_renderer(self) -> RendererAgg:
        """Return the renderer for the size of the figure."""
        renderer = super().get_renderer()
        renderer.mathtext_parser = vars(self).setdefault("parser", renderer.mathtext_parser)
        return renderer


_Text: Any = Text  # its methods are unknown to a type checker


class _Title(_Text):
    """A text whose lines are broken only if one is too wide: that measures them word by word."""

    def _get_wrapped_text(self) -> Any:
        text = self.get_text()
        with suppress(ValueError):  # its parts may be drawable, although it is not
            widths = map(self._get_rendered_text_width, text.split("\n"))
            if max(widths) <= self._get_wrap_line_width():
                return text
        return super()._get_wrapped_text()


class Picture(Figure):
    """A figure made by a function of this room.

    It is not registered with pyplot, so Jupyter shows it only once, as the value of a cell.
    """

    def __init__(self, page: Page, stretch: float = 1.0) -> None:
        """Make a figure with the width of the page, `stretch` times as high as usual."""
        size = (width_of(page), stretch * mpl.rcParams["figure.figsize"][1])
        super().__init__(figsize=size, layout="constrained")
        self._usual = size[1]  #: Height of the panels unless the page has its own [inch].
        _Canvas(self)

    def draw(self, renderer: RendererBase) -> None:
        """Draw the figure, with room for all labels at the final size of the panels.

        The layout engine measures the ticks of panels of another size, and may never converge.
        """
        engine = self.get_layout_engine()
        if isinstance(engine, ConstrainedLayoutEngine):
            engine.execute(self)
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
                engine.set(rect=(room[0], 0.0, 1.0 - room.sum(), 1.0))
            if self.canvas.is_saving():  # draws twice, the first time for the layout only
                engine.execute(self)
                return
        super().draw(renderer)

    def _repr_png_(self) -> bytes:
        """Draw the figure for Jupyter."""
        buffer = io.BytesIO()
        with mpl.rc_context(user_style()):
            self.savefig(buffer, format="png", dpi=150)
        return buffer.getvalue()

    def make_room(self, part: Any) -> None:
        """Increase the height of the figure by the height of a title or a legend."""
        self.set_figheight(self.get_figheight() + part.get_window_extent().height / self.dpi)

    def add_title(self, text: str) -> None:
        """Put a title above the panels; refuse one that matplotlib cannot draw."""
        title = self.suptitle(text, wrap=True)
        title.__class__ = _Title
        refuse_undrawable("title", title)
        self.make_room(title)

    def set_height(self, height: float | None) -> None:
        """Set the height; refuse one that leaves too little of the panels.

        Without one, a higher figure gets the height of a page.
        """
        beside = self.get_figheight() - self._usual
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
        covered: Mapping[Artist, float] | None = None,
        named: Callable[[], Container[str]] = tuple,
        height: float | None = None,
    ) -> None:
        """Put a legend below the panels, and increase the height of the figure.

        It has all entries for which a page has room. If it is known what share of a map each entry
        has `covered`, it takes at most a fifth of the height: as many of those that cover little as
        necessary are left out. If the others need more, the panels become higher, too, but by at
        most a half; then, or at a final `height`, others are left out, first what is `named` in the
        map.
        """
        room = SHARE / (1.0 - SHARE)
        if covered is None:
            beside = self.get_figheight() - (1.0 - _LEAST_PANELS) * self._usual
            most = (HIGHEST if height is None else height) - beside
            usual = room * self.get_figheight()
            self.make_room(legend_of_all(self, handles, title, self.dpi * usual, self.dpi * most))
            return
        least, most = (room * (self.get_figheight() + more * self._usual) for more in (0.0, 0.5))
        if height is not None:
            least = most = SHARE * height

        def named_beside() -> Container[str]:
            """Return what is named in the map beside a legend of a fifth of the height."""
            usual = self.get_figheight()
            self.set_figheight(usual if height is None else (1.0 - SHARE) * height)
            names = named()
            self.set_figheight(usual)
            return names

        heights = self.dpi * least, self.dpi * most
        legend = legend_below(self, handles, title, covered, named_beside, heights)
        taken = legend.get_window_extent().height / self.dpi
        self.set_figheight(max(self.get_figheight() + taken, taken / SHARE))


def refuse_undrawable(name: str, text: Text) -> None:
    """Refuse a text that matplotlib cannot draw."""
    try:
        text.get_window_extent()
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
            refuse_undrawable(name, axis.label)


def width_of(page: Page) -> float:
    """Return the width of a figure [inch]."""
    return float(page.width or mpl.rcParams["figure.figsize"][0])


def new_panel(ax: Axes | None, page: Page) -> Axes:
    """Return the panel to draw into: `ax`, or the only panel of a new figure."""
    return Picture(page).add_subplot() if ax is None else ax


def stacked_panels(page: Page, heights: Sequence[float], shared: Sequence[int]) -> list[Axes]:
    """Return stacked panels of a new figure, with `heights` in units of the usual height.

    The `shared` panels share their abscissa, which only the last of them labels.
    """
    figure = Picture(page, sum(heights))
    panels = figure.subplots(len(heights), height_ratios=heights, squeeze=False)[:, 0]
    for number in shared[:-1]:
        panels[number].sharex(panels[shared[-1]])
        panels[number].tick_params(labelbottom=False)
    return list(panels)


def panel_grid(
    page: Page, count: int, across: int, height: float, sharex: bool = False
) -> list[Axes]:
    """Return so many panels of a new figure, with so many beside each other.

    `height` is that of a row in units of the usual height. The panels share the ordinate.
    """
    down = math.ceil(count / across)
    grid = (
        Picture(page, height * down)
        .subplots(down, across, squeeze=False, sharex=sharex, sharey=True)
        .ravel()
    )
    for unused in grid[count:]:
        unused.remove()
    return list(grid[:count])


def chosen_panels(asked: Sequence[str], there: Sequence[str]) -> list[str]:
    """Return the names of the panels that are asked for, by default all that are there."""
    for name in asked:
        if name not in there:
            meant = suggestion(near_miss(name, there))
            raise Refused(f"there is no panel {name or repr(name)}{meant}; {choice_of(there)}")
        if asked.count(name) > 1:
            raise Refused(f"the panel {name} is asked for twice; expected: once")
    return [*(asked or there)]


def figure_of(panel: Axes) -> Figure:
    """Return the top-level figure of a panel, also if the panel is in a subfigure."""
    figure = panel.get_figure(root=True)
    assert figure is not None
    return figure


def in_panel(panel: Axes, points: np.ndarray) -> np.ndarray:
    """Return points of a panel, shape (n, 2), as shares of its width and height."""
    shares: np.ndarray = panel.transAxes.inverted().transform(panel.transData.transform(points))
    return shares


def lay_out(panel: Axes) -> None:
    """Set the final place and size of a panel."""
    figure = figure_of(panel)
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)


def _thin_ticks(panel: Axes) -> None:
    """Choose fewer ticks of the abscissa where their labels would touch."""
    locator = panel.xaxis.get_major_locator()
    for most in range(7, 1, -1):
        boxes = [
            tick.label1.get_window_extent()
            for tick in panel.xaxis.get_major_ticks()
            if tick.label1.get_visible() and tick.label1.get_text()
        ]
        gaps = [after.x0 - box.x1 for box, after in pairwise(boxes)]
        if min(gaps, default=np.inf) >= _GAP * figure_of(panel).dpi or not isinstance(
            locator, MaxNLocator
        ):
            return
        locator.set_params(nbins=most)
        lay_out(panel)


def finish(
    panel: Axes,
    page: Page,
    drawn: OpenedSweep,
    handles: Sequence[Artist] | None = None,
    legend_title: str | None = None,
    record: str | None = None,
    covered: Mapping[Artist, float] | None = None,
    named: Callable[[], Container[str]] = tuple,
) -> Figure:
    """Put the title above a `Picture` and the legend below it, and return the figure.

    In another figure, the panel gets the legend, and a title only if the page has one. `handles`
    are labelled artists for the legend, by default those of the panel. `drawn` is the part of the
    sweep that is shown. `record` replaces the record of the configuration in the title. Of a map,
    `covered` is the share that each entry of the legend covers, and `named` returns the names that
    the regions have room for: `Picture.add_legend`.
    """
    figure = figure_of(panel)
    handles = panel.get_legend_handles_labels()[0] if handles is None else handles
    handles = handles if page.legend else []
    _set_labels(panel, page)
    if isinstance(figure, Picture):
        text = title_of(drawn, record) if page.title is None else page.title
        if text:
            figure.add_title(text)
        if handles:
            figure.add_legend(handles, legend_title, covered, named, page.height)
        figure.set_height(page.height)
        lay_out(panel)
        for each in figure.axes:
            _thin_ticks(each)
    else:
        if page.title is not None:
            panel.set_title(page.title)
        if handles:
            lay_out(panel)
            legend_within(panel, handles, legend_title, covered)
    return figure


def draw_points(
    panel: Axes,
    x: np.ndarray,
    y: np.ndarray,
    colour: str | np.ndarray | None = None,
    size: float | None = None,
    alpha: float | None = None,
    most: float = 3.5,
    marker: str = "o",
) -> None:
    """Draw markers in one colour, by default the plain one, or of a colour each, shape (n, 4).

    The more of the panel they would cover, the smaller they are, and never greater than `most`.
    """
    if not len(y):
        return
    size = marker_size(x, y, 0.5, most) if size is None else size
    alpha = float(np.clip(1e5 / len(y), 0.15, 1.0)) if alpha is None else alpha
    colour = data_colour() if colour is None else colour
    if isinstance(colour, str):
        (points,) = panel.plot(
            x, y, marker, linestyle="", color=colour, alpha=alpha, rasterized=True
        )
        points.set(markersize=size, markeredgewidth=0)
    else:
        panel.scatter(x, y, size**2, colour, alpha=alpha, linewidths=0, rasterized=True)


def mark_some(panel: Axes, points: np.ndarray, marker: str, colour: str) -> None:
    """Mark some of the points, shape (n, 2), about evenly in a panel that has its limits."""
    panel.autoscale_view()  # matplotlib delays it, and the transformations do not ask for it
    points = points[np.isfinite(points).all(axis=1)]
    _, some = np.unique(np.floor(_MARKS * in_panel(panel, points)), axis=0, return_index=True)
    (marks,) = panel.plot(*points[some].T, marker, color=colour, rasterized=True)
    marks.set(markersize=4.0, markeredgewidth=edge_of(marker), zorder=4.0)
    if edge_of(marker):
        marks.set_path_effects([withStroke(linewidth=2.0, foreground=ground())])


def edge_of(marker: str) -> float:
    """Return the width of the edge of a marker of data [pt], which only crosses have."""
    return 0.8 if marker in "+x" else 0.0


def marker_size(x: np.ndarray, y: np.ndarray, least: float, most: float) -> float:
    """Return the size [pt] of markers that leave parts of the panel around them visible."""
    counts, *_ = np.histogram2d(x, y, bins=(600, 300))
    return float(np.clip(70.0 / math.sqrt(max(1, int(np.count_nonzero(counts)))), least, most))


def draw_stop(
    draw_line: Callable[..., object], clearance: float, about: xr.DataArray | None = None
) -> None:
    """Draw the mechanical stop with a panel's `axhline` or `axvline`.

    The attributes of the clearance, `about`, put the stop into the legend.
    """
    text = None if about is None else f"stop, {equation(f'x={about.symbol}', about, clearance)}"
    draw_line(clearance, color=ink(), linewidth=0.8, linestyle="--", label=text)


def widen_if_constant(set_limits: Callable[..., object], low: float, high: float) -> None:
    """Widen the limits of a panel if the data are constant, so that it does not show rounding."""
    if (ends := widened(low, high)) != (low, high):
        set_limits(*ends)


NO_MASKS: Mapping[str, np.ndarray] = {}


def mark_status(
    panel: Axes,
    values: np.ndarray,
    status: np.ndarray,
    masks: Mapping[str, np.ndarray] = NO_MASKS,
    grey: bool = False,
) -> None:
    """Mark failed and pending points in a strip below the data and in the legend.

    `values` are the abscissas, shape (n,); `status` has the shape (n,) or (directions, n), and so
    have the `masks` of further points, by a name of ``MARKS``, which can be drawn in `grey`.
    """
    kinds = [(status_name(one), colour, status == one) for one, colour in STATUS_COLOURS.items()]
    kinds += [(name, MARKS[name][grey], where) for name, where in masks.items()]
    kinds = [(name, visible(colour), where) for name, colour, where in kinds]
    if np.isin(status, list(STATUS_COLOURS)).any():
        low, high = panel.get_ylim()
        panel.set_ylim(low - 0.04 * (high - low), high)
    strip = panel.get_xaxis_transform()
    for text, colour, where in kinds:
        if not where.any():
            continue
        x = np.broadcast_to(values, status.shape)
        x, count = x[where] if text not in masks else _spread(panel, x, where), np.sum(where)
        (marks,) = panel.plot(x, np.full(x.shape, 0.015), "|", transform=strip, rasterized=True)
        marks.set(markersize=6, color=colour)
        text = f"{text} ({count:,} of {status.size:,})"
        panel.plot([], [], linewidth=5, solid_capstyle="butt", color=colour, label=text)


def _spread(panel: Axes, x: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Return abscissas of marks that cover the same share of the axis as the points have.

    A mark is a point wide. Where several values are in it, those with most marked values have one.
    """
    panel.get_xlim()  # matplotlib delays the limits
    values, place = np.unique(x, return_inverse=True)
    marked = np.bincount(place.ravel(), where.ravel()) > 0.0
    across = panel.transData.transform(np.stack([values, values], axis=1))[:, 0]
    _, column = np.unique(np.floor(across * 72.0 / figure_of(panel).dpi), return_inverse=True)
    counts = np.bincount(column, marked)
    sums = np.bincount(column, np.where(marked, values, 0.0))
    most = math.ceil(marked.mean() * len(counts))
    kept = np.argsort(-counts / np.bincount(column), kind="stable")[:most]
    kept = kept[counts[kept] > 0.0]
    return sums[kept] / counts[kept]
