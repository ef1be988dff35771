"""What pictures have in common: a figure for paper, its title and legend, marks in its panels."""

from __future__ import annotations

import functools
import inspect
import io
import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
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

from sweeps.errors import Refused
from sweeps.plotting.labels import mathtext, status_name
from sweeps.plotting.labels import title as title_of
from sweeps.plotting.lines import widened
from sweeps.plotting.style import BLUE, STATUS_COLOURS, user_style
from vibroimpact.oscillator import PARAMETERS


@dataclass(frozen=True)
class Page:
    """How a picture is set on paper.

    Attributes
    ----------
    width : float, optional
        Of the figure [inch], by default that of matplotlib's ``figure.figsize``.
    height : float, optional
        Of the figure [inch], by default what its panels, its title and its legend take.
    dpi : int, optional
        Pixels per inch, by default matplotlib's ``savefig.dpi``.
    title : str, optional
        Instead of the name, the parameters and the record of the sweep; may be empty.
    xlim, ylim : (float, float), optional
        Limits of the first panel, by default those of the data.
    """

    width: float | None = None
    height: float | None = None
    dpi: int | None = None
    title: str | None = None
    xlim: tuple[float, float] | None = None
    ylim: tuple[float, float] | None = None

    def set_limits(self, panel: Axes) -> None:
        """Set the limits that are given; Refused if nothing is drawn within them."""
        for name, given, ends in (
            ("xlim", self.xlim, panel.dataLim.intervalx),
            ("ylim", self.ylim, panel.dataLim.intervaly),
        ):
            if given is None:
                continue
            if given[1] < ends[0] or ends[1] < given[0]:
                raise Refused(
                    f"there is nothing to draw with {name} = {given[0]:g}:{given[1]:g}; the data "
                    f"range from {ends[0]:.6g} to {ends[1]:.6g}"
                )
            (panel.set_xlim if name == "xlim" else panel.set_ylim)(given)


PAGE = Page()
_LEGEND: dict[str, Any] = {"handlelength": 1.4, "handletextpad": 0.5, "columnspacing": 1.0}


class Picture(Figure):
    """A figure that a function of this room made.

    pyplot does not know it: in Jupyter it is shown once, as the value of a cell.
    """

    def __init__(self, page: Page, stretch: float = 1.0) -> None:
        """Make a figure of the page's width, and `stretch` times as high as ``figure.figsize``."""
        width, height = mpl.rcParams["figure.figsize"]
        size = (page.width or width, stretch * height)
        super().__init__(figsize=size, layout="constrained")
        FigureCanvasAgg(self)  # which measures all texts with one renderer

    def draw(self, renderer: RendererBase) -> None:
        """Draw, with room for the tick labels that panels of the final width have.

        The layout is for the ticks of narrower or wider panels, and may never settle.
        """
        if (engine := self.get_layout_engine()) is not None:
            engine.execute(self)
            boxes = [
                panel.xaxis.get_tightbbox(renderer, for_layout_only=True) for panel in self.axes
            ]
            beyond = max((box.x1 for box in boxes if box), default=0.0) - self.bbox.x1
            if beyond > 0.0 and isinstance(engine, ConstrainedLayoutEngine):
                room = beyond / self.bbox.width + engine.get()["w_pad"] / self.get_figwidth()
                engine.set(rect=(0.0, 0.0, 1.0 - room, 1.0))
        super().draw(renderer)

    def _repr_png_(self) -> bytes:
        """Draw the figure for Jupyter."""
        buffer = io.BytesIO()
        with mpl.rc_context(user_style()):
            self.savefig(buffer, format="png", dpi=150)
        return buffer.getvalue()

    def make_room(self, part: Any) -> None:
        """Make the figure higher by what a title or a legend takes."""
        self.set_figheight(self.get_figheight() + part.get_window_extent().height / self.dpi)

    def add_legend(self, handles: Sequence[Artist], title: str | None) -> None:
        """Put a legend below the panels, with as many columns as its width allows."""
        look = {"title": title, "frameon": False, "borderpad": 0.2, **_LEGEND}
        for columns in range(min(4, len(handles)), 0, -1):
            legend = self.legend(handles=handles, ncols=columns, loc="outside lower center", **look)
            if columns == 1 or legend.get_window_extent().width <= self.bbox.width:
                break
            legend.remove()
        legend.get_title().set_multialignment("center")
        self.make_room(legend)


#: What the pictures have in common; at the end of the parameters in the docstring of each.
_COMMON = """\
at : mapping of str to float, optional
    Values of the swept axes that are not drawn: the nearest of the grid is taken, by default the
    first. Where an axis was followed both ways, ``direction`` picks one.
page : Page, optional
    Size, title and limits.
ax : Axes, optional
    The panel to draw into, by default that of a new figure.

Returns
-------
Figure
    That of `ax`, or the new one.

Raises
------
Refused
    If the file does not have what is asked for, or there is nothing to draw."""


def styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """Let a function draw a figure of its own in the style of the pictures; complete its docstring.

    Its first parameter is the dataset.
    """

    @functools.wraps(draw)
    def _in_style(*arguments: Any, **options: Any) -> Figure:
        """Draw in the style, unless the panel is one of another figure."""
        style = user_style() if options.get("ax") is None else {}
        with mpl.rc_context(style), warnings.catch_warnings():
            # The name of a sweep may be in a script that the font lacks: it is drawn as boxes.
            warnings.filterwarnings("ignore", "Glyph", UserWarning)
            return draw(*arguments, **options)

    text, _, own = (inspect.getdoc(draw) or "").partition("\n\nParameters\n----------")
    head = "Parameters\n----------\ndataset : Dataset\n    From `sweeps.open_sweep`."
    _in_style.__doc__ = f"{text}\n\n{head}{own}\n{_COMMON}"
    return _in_style


def new_panel(ax: Axes | None, page: Page) -> Axes:
    """Return the panel to draw into: `ax`, or the only one of a new figure."""
    return Picture(page).add_subplot() if ax is None else ax


def stacked_panels(page: Page, heights: Sequence[float], shared: int) -> list[Axes]:
    """Return panels of a new figure, one below the other, in shares of its usual height.

    The first ones, so many, share their abscissa, and the last of these shows it.
    """
    figure = Picture(page, sum(heights))
    panels = figure.subplots(len(heights), height_ratios=heights, squeeze=False)[:, 0]
    for panel in panels[: max(0, shared - 1)]:
        panel.sharex(panels[shared - 1])
        panel.tick_params(labelbottom=False)
    return list(panels)


def figure_of(panel: Axes) -> Figure:
    """Return the figure of a panel; that of the page where the panel is in a part of it."""
    figure = panel.get_figure(root=True)
    assert figure is not None
    return figure


def finish(
    panel: Axes,
    page: Page,
    drawn: xr.Dataset,
    handles: Sequence[Artist] | None = None,
    legend_title: str | None = None,
    record: str | None = None,
) -> Figure:
    """Put the title above a `Picture` and the legend below it, and return the figure.

    The panel of another figure has the legend, and a title only if the page has one. The `handles`
    have labels, and are by default those of the panel; `drawn` is what the picture shows of the
    sweep, and `record` is said instead of what the configuration has.
    """
    figure = figure_of(panel)
    handles = panel.get_legend_handles_labels()[0] if handles is None else handles
    if isinstance(figure, Picture):
        text = title_of(drawn, record) if page.title is None else page.title
        if text:
            figure.make_room(figure.suptitle(text, wrap=True))
        if handles:
            figure.add_legend(handles, legend_title)
        if page.height is not None:
            figure.set_figheight(page.height)
    else:
        if page.title is not None:
            panel.set_title(page.title)
        if handles:
            panel.legend(handles=handles, title=legend_title, **_LEGEND)
    return figure


def draw_points(
    panel: Axes, x: np.ndarray, y: np.ndarray, colour: str = BLUE, scale: float = 1.0
) -> None:
    """Draw markers, the smaller the more of the panel they would cover."""
    counts, *_ = np.histogram2d(x, y, bins=(600, 300))
    size = scale * float(np.clip(70.0 / math.sqrt(np.count_nonzero(counts)), 0.5, 3.5))
    (points,) = panel.plot(x, y, "o", color=colour, rasterized=True)
    points.set(markersize=size, markeredgewidth=0, alpha=float(np.clip(1e5 / len(y), 0.15, 1.0)))


def draw_stop(draw_line: Callable[..., object], clearance: float, label: bool = True) -> None:
    """Draw the mechanical stop with a panel's `axhline` or `axvline`."""
    symbol = PARAMETERS["clearance"].symbol
    text = rf"stop, $x={symbol}={mathtext(clearance)}$" if label else None
    draw_line(clearance, color="black", linewidth=0.8, linestyle="--", label=text)


def widen_if_constant(set_limits: Callable[..., object], low: float, high: float) -> None:
    """Keep rounding errors about a constant from filling the panel whose limits can be set so."""
    ends = widened(low, high)
    if ends != (low, high):
        set_limits(*ends)


def mark_status(panel: Axes, values: np.ndarray, status: np.ndarray) -> None:
    """Mark what failed or was not computed yet in a strip below the data, with labels.

    The status has the shape of the `values` of the abscissa, (n,), or (directions, n).
    """
    present = [outcome for outcome in STATUS_COLOURS if (status == outcome).any()]
    if not present:
        return
    low, high = panel.get_ylim()
    panel.set_ylim(low - 0.04 * (high - low), high)
    strip = panel.get_xaxis_transform()
    for outcome in present:
        x = np.broadcast_to(values, status.shape)[status == outcome]
        (marks,) = panel.plot(x, np.full(x.shape, 0.015), "|", transform=strip, rasterized=True)
        marks.set(markersize=6, color=STATUS_COLOURS[outcome])
        text = f"{status_name(outcome)} ({len(x):,} of {status.size:,})"
        panel.plot([], [], linewidth=5, color=STATUS_COLOURS[outcome], label=text)
