"""Common parts of the pictures: the figure, its title and legend, and marks in its panels."""

from __future__ import annotations

import functools
import inspect
import io
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
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

from sweeps.analysis.doors import takes_sweep
from sweeps.analysis.rig import arguments_in_si
from sweeps.arguments import TEXT, Allowed, integer, is_number, require_all
from sweeps.errors import Refused
from sweeps.plotting.labels import equation, status_name
from sweeps.plotting.labels import title as title_of
from sweeps.plotting.lines import widened
from sweeps.plotting.style import BLUE, MARKS, STATUS_COLOURS, user_style
from vibroimpact.step.scheme import MOST_RECORDED


@dataclass(frozen=True)
class Page:
    """The size, title and limits of a picture.

    Attributes
    ----------
    width : float, optional
        Width of the figure [inch], by default from matplotlib's ``figure.figsize``.
    height : float, optional
        Height of the figure [inch], by default the height of its panels, title and legend.
    dpi : int, optional
        Pixels per inch, by default matplotlib's ``savefig.dpi``.
    title : str, optional
        Title instead of the name, the parameters and the record of the sweep; may be empty.
    xlim, ylim : (float, float), optional
        Limits of the first panel, by default those of the data; the ordinate of a diagram or of a
        motion fits the data within `xlim`.

    Examples
    --------
    >>> import sweeps
    >>> omega = {"start": 2.6, "stop": 2.7, "num": 20}
    >>> scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": omega, "f": 1.0}}
    >>> ds = sweeps.open_sweep(sweeps.run_sweep(scene, "flip.h5", overwrite=True))
    >>> from sweeps import plotting
    >>> page = plotting.Page(width=3.4, title="", xlim=(2.62, 2.68))
    >>> plotting.bifurcation(ds, page=page).savefig("column.pdf")
    """

    width: float | None = None
    height: float | None = None
    dpi: int | None = None
    title: str | None = None
    xlim: tuple[float, float] | None = None
    ylim: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Refuse a size, title or limit that is not allowed."""
        require_all({name: one for name, one in vars(self).items() if one is not None}, _OF_PAGE)

    def set_limits(self, panel: Axes) -> None:
        """Set the given limits; raise Refused if they contain no data."""
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

    def fit_ordinate(self, panel: Axes, *ranges: tuple[float, float]) -> None:
        """Fit the ordinate to the lines, and to further ranges, within the given abscissa."""
        if self.xlim is None:
            return
        low, high = self.xlim
        data = panel.transData  # an `axhline` has another transform
        lines = [line for line in panel.lines if line.get_transform() == data]
        points = [np.asarray(line.get_xydata()) for line in lines]
        seen = [y[(low <= x) & (x <= high)] for x, y in (each.T for each in points)]
        values = np.concatenate([*seen, *ranges, ()])
        values = values[np.isfinite(values)]
        if values.size:
            bottom, top = widened(float(values.min()), float(values.max()))
            margin = mpl.rcParams["axes.ymargin"] * (top - bottom)
            panel.set_ylim(bottom - margin, top + margin)


#: Least and greatest width and height of a picture [inch].
LEAST, MOST = 1.0, 40.0
_LENGTH = Allowed(
    lambda value: is_number(value) and LEAST <= value <= MOST,  # type: ignore[operator]
    f"inches, from {LEAST:g} to {MOST:g}",
)
_LIMITS = Allowed(
    lambda value: (
        isinstance(value, Sequence)
        and len(value) == 2
        and all(map(is_number, value))
        and value[0] < value[1]
    ),
    "two numbers of which the first is smaller, as (2.4, 3.0)",
)
_OF_PAGE = {
    "width": _LENGTH,
    "height": _LENGTH,
    "dpi": integer(1),
    "title": TEXT,
    "xlim": _LIMITS,
    "ylim": _LIMITS,
}

PAGE = Page()
#: Least height of the panels, as a share of the usual one.
_LEAST_PANELS = 0.35
_LEGEND: dict[str, Any] = {"handlelength": 1.4, "handletextpad": 0.5, "columnspacing": 1.0}


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
        """Draw the figure, with room for the tick labels at the final width of the panels.

        The layout engine measures the ticks of panels of another width, and may never converge.
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
        """Increase the height of the figure by the height of a title or a legend."""
        self.set_figheight(self.get_figheight() + part.get_window_extent().height / self.dpi)

    def set_height(self, height: float) -> None:
        """Set the height; refuse one that leaves too little of the panels."""
        beside = self.get_figheight() - self._usual
        least = math.ceil(10.0 * (beside + _LEAST_PANELS * self._usual)) / 10.0
        if height < least:
            raise Refused(
                f"height = {height:g} in is not allowed; expected: at least {least:g} in, of which "
                f"title and legend take {beside:.1f} in"
            )
        self.set_figheight(height)

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


#: Docstring of the common parameters; `styled` appends it to the docstring of each picture.
_COMMON = """\
at : mapping of str to float, optional
    Values of the swept axes that are not drawn. The nearest grid value is used; the default is the
    first. If an axis was followed both ways, ``direction`` selects one direction.
page : Page, optional
    Size, title and limits.
ax : Axes, optional
    The panel to draw into, by default the panel of a new figure.

Returns
-------
Figure
    The figure of `ax`, or the new one.

Raises
------
Refused
    If the file lacks the requested data, or there is nothing to draw."""


def _is_wanted(value: object) -> bool:
    return isinstance(value, str | xr.DataArray)


def _are_wanted(value: object) -> bool:
    return _is_wanted(value) or (isinstance(value, Sequence) and all(map(_is_wanted, value)))


def _are_orbits(value: object) -> bool:
    return isinstance(value, xr.Dataset) and "kind" in value and "point" in value.dims


def _are_panels(value: object, panels: int) -> bool:
    if panels == 1:
        return isinstance(value, Axes)
    several = [*value] if isinstance(value, Sequence | np.ndarray) else []
    return len(several) == panels and all(isinstance(one, Axes) for one in several)


#: What the arguments of pictures may be, besides those of all functions of a sweep.
ARGUMENTS: Mapping[str, Allowed] = {
    "page": Allowed(lambda value: isinstance(value, Page), "a Page, as Page(width=3.4)"),
    "coordinate": TEXT,
    "exact": Allowed(_are_orbits, "the result of sweeps.branches, or for a map of sweeps.curves"),
    "below": Allowed(_are_wanted, "names or DataArrays, as ['lyapunov']"),
    "color": Allowed(_is_wanted, "a name or a DataArray"),
    "quantity": Allowed(_is_wanted, "a name or a DataArray"),
    "axes": Allowed(_are_wanted, "names of axes, as ['omega', 'R']"),
    "periods": integer(1, MOST_RECORDED),
}


def styled(draw: Callable[..., Figure], panels: int = 1) -> Callable[..., Figure]:
    """Decorate a picture function: draw new figures in the common style, complete the docstring.

    The first parameter of the function must be the dataset; `ax` has so many panels.
    """
    panel = "a panel" if panels == 1 else f"{panels} panels"
    of_panels = Allowed(lambda value: _are_panels(value, panels), f"{panel} of matplotlib")

    @takes_sweep({**ARGUMENTS, "ax": of_panels})
    @functools.wraps(draw)
    def _in_style(dataset: xr.Dataset, **options: Any) -> Figure:
        """Draw in SI units if there is a rig, and in the common style, unless `ax` has its own."""
        style = user_style() if options.get("ax") is None else {}
        with mpl.rc_context(style), warnings.catch_warnings():
            # The name of a sweep may have characters that the font lacks, drawn as boxes.
            warnings.filterwarnings("ignore", "Glyph", UserWarning)
            dataset, options = arguments_in_si(dataset, options)
            return draw(dataset, **options)

    written, mark, example = (inspect.getdoc(draw) or "").partition("\n\nExamples\n--------")
    text, _, own = written.partition("\n\nParameters\n----------")
    head = "Parameters\n----------\ndataset : Dataset or str or Path"
    head += "\n    From `sweeps.open_sweep`, or the path of its file."
    _in_style.__doc__ = f"{text}\n\n{head}{own}\n{_COMMON}{mark}{example}"
    return _in_style


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


def finish(
    panel: Axes,
    page: Page,
    drawn: xr.Dataset,
    handles: Sequence[Artist] | None = None,
    legend_title: str | None = None,
    record: str | None = None,
) -> Figure:
    """Put the title above a `Picture` and the legend below it, and return the figure.

    In another figure, the panel gets the legend, and a title only if the page has one. `handles`
    are labelled artists for the legend, by default those of the panel. `drawn` is the part of the
    sweep that is shown. `record` replaces the record of the configuration in the title.
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
            figure.set_height(page.height)
    else:
        if page.title is not None:
            panel.set_title(page.title)
        if handles:
            panel.legend(handles=handles, title=legend_title, **_LEGEND)
    return figure


def draw_points(
    panel: Axes,
    x: np.ndarray,
    y: np.ndarray,
    colour: str | np.ndarray = BLUE,
    size: float | None = None,
    alpha: float | None = None,
    most: float = 3.5,
) -> None:
    """Draw markers in one colour or of a colour each, shape (n, 4).

    The more of the panel they would cover, the smaller they are, and never greater than `most`.
    """
    if not len(y):
        return
    size = marker_size(x, y, 0.5, most) if size is None else size
    alpha = float(np.clip(1e5 / len(y), 0.15, 1.0)) if alpha is None else alpha
    if isinstance(colour, str):
        (points,) = panel.plot(x, y, "o", color=colour, alpha=alpha, rasterized=True)
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
    draw_line(clearance, color="black", linewidth=0.8, linestyle="--", label=text)


def widen_if_constant(set_limits: Callable[..., object], low: float, high: float) -> None:
    """Widen the limits of a panel if the data are constant, so that it does not show rounding."""
    ends = widened(low, high)
    if ends != (low, high):
        set_limits(*ends)


NO_MASKS: Mapping[str, np.ndarray] = {}


def mark_status(
    panel: Axes, values: np.ndarray, status: np.ndarray, masks: Mapping[str, np.ndarray] = NO_MASKS
) -> None:
    """Mark failed and pending points in a strip below the data and in the legend.

    `values` are the abscissas, shape (n,); `status` has the shape (n,) or (directions, n), and so
    have the `masks` of further points, by a name of ``MARKS``.
    """
    kinds = [(status_name(one), colour, status == one) for one, colour in STATUS_COLOURS.items()]
    kinds += [(name, MARKS[name], where) for name, where in masks.items()]
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
