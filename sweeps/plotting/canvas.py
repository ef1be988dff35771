"""Common parts of the pictures: the figure, its title and legend, and marks in its panels."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.text import Text

from sweeps.errors import Refused
from sweeps.plotting.labels import equation, status_name
from sweeps.plotting.labels import title as title_of
from sweeps.plotting.legend import SHARE, legend_below, legend_within
from sweeps.plotting.page import Page
from sweeps.plotting.pixels import widened
from sweeps.plotting.style import (
    GREY_MARKS,
    MARKS,
    STATUS_COLOURS,
    data_colour,
    ink,
    user_style,
    visible,
)
from sweeps.text import shortened

#: Greatest height of a picture unless the page gives it, so that it fits a printed page [inch].
HIGHEST = 9.0
#: Least height of the panels, as a share of the usual one.
_LEAST_PANELS = 0.35


class Picture(Figure):
    """A figure made by a function of this room.

    It is not registered with pyplot, so Jupyter shows it only once, as the value of a cell.
    """

    def __init__(self, page: Page, stretch: float = 1.0) -> None:
        """Make a figure with the width of the page, `stretch` times as high as usual."""
        width, height = mpl.rcParams["figure.figsize"]
        size = (page.width or width, stretch * height)
        super().__init__(figsize=size, layout="constrained")
        self._usual = size[1]  #: Height of the panels unless the page has its own [inch].
        FigureCanvasAgg(self)  # measures all texts with the same renderer

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
        refuse_undrawable("title", title)
        self.make_room(title)

    def set_height(self, height: float | None) -> None:
        """Set the height; refuse one that leaves too little of the panels.

        Without one, a higher figure gets the height of a page, or the least that the panels take.
        """
        beside = self.get_figheight() - self._usual
        least = math.ceil(10.0 * (beside + _LEAST_PANELS * self._usual)) / 10.0
        if height is None:
            height = min(self.get_figheight(), max(HIGHEST, least))
        elif height < least:
            raise Refused(
                f"height = {height:g} in is not allowed; expected: at least {least:g} in, of which "
                f"title and legend take {beside:.1f} in"
            )
        self.set_figheight(height)

    def add_legend(
        self,
        handles: Sequence[Artist],
        title: str | None,
        rarest: Sequence[str] | None = None,
        height: float | None = None,
    ) -> None:
        """Put a legend below the panels, and increase the height of the figure.

        If labels of the `rarest` entries are given, it takes at most a fifth of the height: as many
        of these entries as necessary are left out. If the others need more, the panels become
        higher, too, but by at most a half; then, or at a final `height`, others are left out.
        """
        if rarest is None:
            self.make_room(legend_below(self, handles, title, math.inf))
            return
        below = partial(legend_below, self, handles, title, rarest=rarest)
        room = SHARE / (1.0 - SHARE)
        least, most = (room * (self.get_figheight() + more * self._usual) for more in (0.0, 0.5))
        if height is not None:
            least = most = SHARE * height
        legend = below(self.dpi * least)
        if legend.get_window_extent().height > self.dpi * most:
            legend.remove()
            legend = below(self.dpi * most, final=True)
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


def new_panel(ax: Axes | None, page: Page) -> Axes:
    """Return the panel to draw into: `ax`, or the only panel of a new figure."""
    return Picture(page).add_subplot() if ax is None else ax


def stacked_panels(page: Page, heights: Sequence[float], shared: int) -> list[Axes]:
    """Return stacked panels of a new figure, with `heights` in units of the usual height.

    The first `shared` panels share their abscissa, which only the last of them labels.
    """
    figure = Picture(page, sum(heights))
    panels = figure.subplots(len(heights), height_ratios=heights, squeeze=False)[:, 0]
    for panel in panels[: max(0, shared - 1)]:
        panel.sharex(panels[shared - 1])
        panel.tick_params(labelbottom=False)
    return list(panels)


def figure_of(panel: Axes) -> Figure:
    """Return the top-level figure of a panel, also if the panel is in a subfigure."""
    figure = panel.get_figure(root=True)
    assert figure is not None
    return figure


def lay_out(panel: Axes) -> None:
    """Set the final place and size of a panel."""
    figure = figure_of(panel)
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)


def finish(
    panel: Axes,
    page: Page,
    drawn: xr.Dataset,
    handles: Sequence[Artist] | None = None,
    legend_title: str | None = None,
    record: str | None = None,
    rarest: Sequence[str] | None = None,
) -> Figure:
    """Put the title above a `Picture` and the legend below it, and return the figure.

    In another figure, the panel gets the legend, and a title only if the page has one. `handles`
    are labelled artists for the legend, by default those of the panel. `drawn` is the part of the
    sweep that is shown. `record` replaces the record of the configuration in the title. `rarest`
    are the labels that a legend of at most a fifth of the height may leave out, rarest first.
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
            figure.add_legend(handles, legend_title, rarest, page.height)
        figure.set_height(page.height)
    else:
        if page.title is not None:
            panel.set_title(page.title)
        if handles:
            lay_out(panel)
            legend_within(panel, handles, legend_title, rarest)
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


def marker_size(x: np.ndarray, y: np.ndarray, least: float, most: float) -> float:
    """Return the size [pt] of markers that leave parts of the panel around them visible."""
    counts, *_ = np.histogram2d(x, y, bins=(600, 300))
    return float(np.clip(70.0 / math.sqrt(np.count_nonzero(counts)), least, most))


def draw_stop(
    draw_line: Callable[..., object], clearance: float, about: xr.DataArray | None = None
) -> None:
    """Draw the mechanical stop with a panel's `axhline` or `axvline`.

    The attributes of the clearance, `about`, put the stop into the legend.
    """
    text = None
    if about is not None:
        text = f"stop, {equation(f'x={about.symbol}', about, clearance)}"
    draw_line(clearance, color=ink(), linewidth=0.8, linestyle="--", label=text)


def widen_if_constant(set_limits: Callable[..., object], low: float, high: float) -> None:
    """Widen the limits of a panel if the data are constant, so that it does not show rounding."""
    ends = widened(low, high)
    if ends != (low, high):
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
    colours = GREY_MARKS if grey else MARKS
    kinds += [(name, colours[name], where) for name, where in masks.items()]
    kinds = [(name, visible(colour), where) for name, colour, where in kinds]
    if np.isin(status, list(STATUS_COLOURS)).any():
        low, high = panel.get_ylim()
        panel.set_ylim(low - 0.04 * (high - low), high)
    strip = panel.get_xaxis_transform()
    for text, colour, where in kinds:
        if not where.any():
            continue
        x = np.broadcast_to(values, status.shape)[where]
        (marks,) = panel.plot(x, np.full(x.shape, 0.015), "|", transform=strip, rasterized=True)
        marks.set(markersize=6, color=colour)
        text = f"{text} ({len(x):,} of {status.size:,})"
        panel.plot([], [], linewidth=5, color=colour, label=text)
