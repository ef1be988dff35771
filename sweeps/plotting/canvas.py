"""What a picture is drawn on: a figure of a size for paper, its style, its legend, its limits."""

from __future__ import annotations

import functools
import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path

from sweeps.errors import Refused
from sweeps.plotting.style import user_style

#: Height of a line of a title or a legend beyond those that a picture has room for [inch].
_LINE_HEIGHT = 0.15
#: What the handle of an entry of a legend takes, and the gap to the next column [inch].
_HANDLE_WIDTH = 0.5


@dataclass(frozen=True)
class Page:
    """How a picture is set on paper.

    Attributes
    ----------
    width : float, optional
        Of the figure [inch], by default that of the kind of picture. Text keeps its size.
    title : str, optional
        Instead of the name, the parameters and the record of the sweep; may be empty.
    xlim, ylim : (float, float), optional
        Limits of the first panel, by default those of the data.
    """

    width: float | None = None
    title: str | None = None
    xlim: tuple[float, float] | None = None
    ylim: tuple[float, float] | None = None

    def set_limits(self, panel: Axes) -> None:
        """Set the limits that are given."""
        if self.xlim is not None:
            panel.set_xlim(self.xlim)
        if self.ylim is not None:
            panel.set_ylim(self.ylim)


PAGE = Page()


class Picture(Figure):
    """A figure that a function of this room made.

    pyplot does not know it: in Jupyter it is shown once, as the value of a cell.
    """

    def _repr_png_(self) -> bytes:
        """Draw the figure for Jupyter."""
        buffer = io.BytesIO()
        with mpl.rc_context(user_style()):
            self.savefig(buffer, format="png", dpi=150)
        return buffer.getvalue()

    def letters(self, setting: Any) -> int:
        """Return about how many letters of the size in a matplotlib setting fill the width."""
        points = FontProperties(size=mpl.rcParams[setting]).get_size_in_points()
        return int(self.get_figwidth() * 72.0 / (0.55 * points))

    def make_room(self, lines: int) -> None:
        """Make the figure higher by some lines of text."""
        self.set_figheight(self.get_figheight() + _LINE_HEIGHT * max(0, lines))


def figure_of(panel: Axes) -> Figure:
    """Return the figure of a panel; that of the page where the panel is in a part of it."""
    figure = panel.get_figure(root=True)
    assert figure is not None
    return figure


def in_style(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """Let a function that draws onto a figure of its own do so in the style of the pictures."""

    @functools.wraps(draw)
    def _styled(*arguments: Any, **options: Any) -> Figure:
        """Draw in the style, unless the panel is one of another figure."""
        style = user_style() if options.get("ax") is None else {}
        with mpl.rc_context(style):
            return draw(*arguments, **options)

    return _styled


def new_picture(page: Page, width: float, height: float) -> Picture:
    """Return an empty figure, as high on a narrow page, and higher on a wide one."""
    scale = 1.0 if page.width is None else page.width / width
    figsize = (width * scale, height * max(1.0, math.sqrt(scale)))
    return Picture(figsize=figsize, layout="constrained")


def new_panel(ax: Axes | None, page: Page, width: float, height: float) -> Axes:
    """Return the panel to draw into: `ax`, or the only one of a new figure."""
    return new_picture(page, width, height).add_subplot() if ax is None else ax


def new_panels(ax: Axes | None, page: Page, width: float, heights: Sequence[float]) -> list[Axes]:
    """Return panels below each other that share their abscissa; refuse `ax` for several."""
    if len(heights) == 1:
        return [new_panel(ax, page, width, heights[0])]
    if ax is not None:
        raise Refused("panels below a diagram need a figure of their own: leave out ax or below")
    figure = new_picture(page, width, sum(heights))
    panels = figure.subplots(len(heights), sharex=True, height_ratios=heights)
    figure.align_ylabels(panels)
    return list(panels)


def add_legend(
    panel: Axes, handles: Sequence[Artist] | None = None, title: str | None = None, **look: Any
) -> None:
    """Put a legend below the panels of a `Picture`, or into the panel of another figure.

    The `handles` have labels, and are by default those of the panel; `look` is for matplotlib.
    """
    look = {"handlelength": 1.5, "columnspacing": 1.2, **look}
    handles = panel.get_legend_handles_labels()[0] if handles is None else handles
    if not handles:
        return
    figure = figure_of(panel)
    if not isinstance(figure, Picture):
        panel.legend(handles=handles, title=title, **look)
        return
    width = figure.letters("legend.fontsize")
    labels = [str(handle.get_label()) for handle in handles]
    labels = [text if "$" in text else fill(text, width - 6) for text in labels]
    columns, rows = _columns(labels, figure.get_figwidth())
    if title is not None:
        title = "\n".join(fill(line, width) for line in title.split("\n"))
        rows += 1 + title.count("\n")
    figure.make_room(rows - 2)
    legend = figure.legend(
        handles, labels, loc="outside lower center", ncols=columns, frameon=False, title=title,
        **look,
    )  # fmt: skip
    legend.get_title().set_multialignment("center")


def _columns(labels: Sequence[str], width: float) -> tuple[int, int]:
    """Return how many columns fit beside each other, each filled from the top, and their rows."""
    lengths = [max(map(_legend_width, text.split("\n"))) for text in labels]
    for columns in range(min(4, len(labels)), 0, -1):
        if sum(map(max, np.array_split(lengths, columns))) <= width:  # as matplotlib splits them
            break
    return columns, math.ceil(len(labels) / columns) + sum(text.count("\n") for text in labels)


def _legend_width(text: str) -> float:
    """Return the width that an entry of a legend takes with its handle [inch]."""
    return printed_width(text, "legend.fontsize") + _HANDLE_WIDTH


def printed_width(text: str, setting: Any) -> float:
    """Return how wide a text with formulas is printed, in the size of a setting [inch]."""
    font = FontProperties(size=mpl.rcParams[setting])
    return float(text_to_path.get_text_width_height_descent(text, font, True)[0]) / 72.0
