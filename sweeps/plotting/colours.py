"""Colours points by a number (`Paint`): classes, few values with a legend, others with a bar."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, LinearSegmentedColormap, LogNorm, Normalize, to_hex, to_rgba
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

from sweeps.errors import Refused
from sweeps.opened.opened_sweep import OpenedSweep, Selection
from sweeps.plotting import contents, labels, style
from sweeps.plotting.looks import Cells, period_cells
from sweeps.plotting.marks import mark_some
from sweeps.plotting.pixels import figure_of, widened
from sweeps.store.variables import DIRECTION
from vibroimpact.points.regimes import Regime, has_result
from vibroimpact.status import Status

#: Names of the value 0 of quantities that are 0 or not defined without impacts.
_ZERO = {
    **dict.fromkeys(("impacts_per_period", "slowest_impact", "fastest_impact"), "no impact"),
    **dict.fromkeys(("impulse", "energy_lost", contents.MEAN_FORCE), "no impact"),
    "max_penetration": "none",
    "rest_fraction": "no rest",
}
#: Quantities that a motion with rest does not have: a chatter has infinitely many impacts, and the
#: force at rest is not in the file.
_NOT_AT_REST = ("impacts_per_period", "slowest_impact", contents.MEAN_FORCE)
#: Quantities whose numbers stand for words: for each number the word and its colour.
_WORDS: Mapping[str, Mapping[int, tuple[str, str]]] = {
    "status": {
        one: (labels.status_name(one), colour) for one, colour in style.RESULT_COLOURS.items()
    },
    "class_evidence": {one: (one.word, colour) for one, colour in style.EVIDENCE.items()},
}
#: Positive values are on a logarithmic scale if the greatest is this many times the least.
_LOG_FROM = 10.0
#: Lyapunov exponents up to this share of omega are rounding.
_ROUNDING_OF_EXPONENTS = 1e-12
#: The values of an axis with at most so many are named in a legend, instead of a colour bar.
_MOST_NAMED = 6


_SIGNED, _SIGNED_DOTS = (
    LinearSegmentedColormap.from_list(
        "signed", ["#00263D", style.BLUE, middle, style.VERMILION, "#4A1D00"]
    )
    for middle in ("#F7F7F7", "#8C8C8C")
)


class Paint(NamedTuple):
    """The colours of a number per point, each field in the shape of ``status``."""

    variable: xr.DataArray  # describes the values
    cells: list[Cells]  # have a colour in the legend; in grey, dots have markers, curves dashes
    values: np.ma.MaskedArray  # have one of a colour bar; masked elsewhere
    norm: Normalize
    ramp: Colormap
    title: str | None = None  # of the legend
    of_dots: bool = False
    grey: bool = False

    def colours(self) -> np.ndarray:
        """Return the colour of each point, shape (..., 4); transparent without a result."""
        rgba = np.asarray(self.ramp(self.norm(self.values)))
        for cell in self.cells:
            rgba[cell.where] = to_rgba(cell.look.colour)
        return rgba

    def dashes(self) -> np.ndarray:
        """Return the dashes of the curve of each point, an array of objects."""
        dashes = np.full(self.values.shape, "-", object)
        for cell in self.cells if self.grey else ():
            for index in np.argwhere(cell.where).tolist():
                dashes[tuple(index)] = cell.look.dash
        return dashes

    def add_markers(self, panel: Axes, x: np.ndarray, y: np.ndarray) -> None:
        """In grey, give some dots, of which each point has a row, the marker of their cells."""
        # The panel has its limits; `x` and `y` have the shape of ``status`` and one further
        # dimension, with NaN for no value.
        for cell in self.cells if self.grey else ():
            if cell.look.marker != ".":
                points = np.stack([x[cell.where].ravel(), y[cell.where].ravel()], axis=1)
                mark_some(panel, points, cell.look.marker, cell.look.colour)

    def handles(self, curves: bool = False) -> list[Artist]:
        """Return the entries of the legend, of the cells that have points."""
        cells = [cell for cell in self.cells if cell.where.any()]
        if not (self.grey and self.of_dots):
            return [cell.handle() for cell in cells]
        handles: list[Artist] = []
        for cell in cells:
            look = cell.look
            shape: Any = {"ls": look.dash} if curves else {"ls": "", "marker": look.marker}
            line = Line2D([], [], color=look.colour, markersize=4.0, label=cell.label, **shape)
            handles.append(line)
        return handles

    def within(self, visible: np.ndarray) -> Paint:
        """Return the colours of the points within limits, for the legend."""
        return self._replace(cells=[cell.within(visible) for cell in self.cells])

    def add_bar(self, panels: Sequence[Axes]) -> None:
        """Add the colour bar, if any value has a colour; an arrow marks values below its range."""
        if self.values.count() == 0:
            return
        low, high = self.norm.vmin or 0.0, self.norm.vmax or 0.0
        figure, lowest = figure_of(panels[0]), panels[-1]
        pad = 0.02
        if not isinstance(figure.get_layout_engine(), ConstrainedLayoutEngine):
            labels_box = lowest.xaxis.get_tightbbox()  # nothing else keeps the bar clear of them
            pad += (lowest.bbox.y0 - labels_box.y0) / lowest.bbox.height if labels_box else 0.0
        bar = figure.colorbar(
            ScalarMappable(self.norm, self.ramp),
            ax=panels if len(panels) > 1 else lowest,  # a tight layout can move the bar of one
            location="bottom",
            pad=pad,
            aspect=35,
            extend="min" if self.values.min() < low else "neither",
        )
        across = bar.ax.xaxis
        if isinstance(self.norm, LogNorm) and high < 100.0 * low:
            labels.tick_in_decades(across)
        labels.describe(across, self.variable, across.label, across.get_major_formatter())


def has_scale(name: str) -> bool:
    """Whether the values of a number have the colours of a scale, and not those of words."""
    return name != "period" and name not in _WORDS


def paint_of(cut: OpenedSweep, name: str, *, dots: bool = False, grey: bool = False) -> Paint:
    """Return the colours of a number, or of the directions, at the points of a cut."""
    # With `dots` no colour is that of the ground; with `grey` all are greys, hatches or markers.
    variable = contents.number_at(cut, name)
    ramp = style.grey_ramp() if grey else mpl.colormaps[mpl.rcParams["image.cmap"]]
    ramp, title = style.legible(ramp) if dots else ramp, None
    values, norm = np.ma.masked_all(variable.shape, float), Normalize()
    has_value = has_result(cut["status"].values)
    if name == "period":
        cells, title = period_cells(*cut.classes, grey=grey, hatched=not dots), labels.CLASSES_TITLE
    elif name == DIRECTION:
        looks = style.DIRECTION_LOOKS[grey]
        rows = zip(("up", "down"), labels.direction_names(cut), looks, strict=True)
        cells = [
            Cells(text, look, has_value & (variable == word).values) for word, text, look in rows
        ]
    elif name in _WORDS:
        numbers = np.where(has_value, variable.values, Status.PENDING)
        cells = [
            Cells(
                text, style.GREY_SERIES[i] if grey else style.Look.plain(colour), numbers == number
            )
            for i, (number, (text, colour)) in enumerate(_WORDS[name].items())
        ]
    elif dots and name in cut.data.dims and 1 < cut.sizes[name] <= _MOST_NAMED:
        cells = _cells_of_few(cut[name], variable, has_value, None if grey else ramp)
    else:
        numbers = variable.values.astype(float)
        if name in variable.coords:
            labels.refuse_too_large(name, numbers)
        cells = _special_cells(cut, name, numbers, has_value, dots, grey)
        for cell in cells:
            has_value &= ~cell.where
        rounding = _ROUNDING_OF_EXPONENTS * float(cut["omega"].max()) if name == "lyapunov" else 0.0
        norm = _scale(name, numbers[has_value], rounding)
        if isinstance(norm, LogNorm):
            zero = has_value & (numbers == 0.0)
            cells.append(Cells("0", cells[0].look, zero))
            has_value &= ~zero
        elif norm(0.0) == 0.5 and not grey:
            ramp = _SIGNED_DOTS if dots else _SIGNED
        if (cells[0].where | cells[-1].where).all():
            contents.refuse_without_value(numbers, name)
            raise Refused(f"there is nothing to draw: {name} is 0 at every point with a value")
        values = np.ma.masked_where(~has_value, numbers)
    if dots:
        cells = [
            cell._replace(
                look=cell.look._replace(colour=style.dot_colour(cell.look.dots), hatch="")
            )
            for cell in cells
        ]
    return Paint(variable, cells, values, norm, ramp, title, dots, grey)


def coloured_points(
    sweep: OpenedSweep, at: Selection | None, color: contents.NameOrArray, grey: bool
) -> tuple[OpenedSweep, Paint]:
    """Return the points that `at` leaves and their colours; refuse a single point."""
    # They are of one direction, by default the first, unless the colours tell the directions apart.
    sweep, name = contents.with_number(sweep, color, for_colour=True)
    free = {*sweep.grid} - {*(at or {}), *({DIRECTION} - {name})}
    points = sweep.cut(at, free=[*map(str, free)])
    if points["status"].size == 1:
        both = f"; color = {DIRECTION} shows both directions" if sweep.directions else ""
        raise Refused(f"a color tells several motions apart, and only one point is left{both}")
    paint = paint_of(points, name, dots=True, grey=grey)
    contents.refuse_without_result(points["status"].values)
    return points, paint


def legend_entries(
    paint: Paint | None, panels: Sequence[Axes], handles: Sequence[Artist], curves: bool = False
) -> tuple[list[Artist], str | None]:
    """Add the colour bar of colours, if any; return the entries and the title of the legend."""
    if paint is None:
        return [*handles], None
    paint.add_bar(panels)
    return [*paint.handles(curves), *handles], paint.title


def _cells_of_few(
    axis: xr.DataArray, variable: xr.DataArray, has_value: np.ndarray, ramp: Colormap | None
) -> list[Cells]:
    """Return the points at each of the few values of an axis, without a ramp in grey."""
    looks = list(style.GREY_SERIES[: axis.size])
    if ramp is not None:
        looks = [style.Look.plain(to_hex(each)) for each in ramp(np.linspace(0.0, 1.0, axis.size))]
    return [
        Cells(
            labels.equation(variable.symbol or rf"\mathrm{{{axis.name}}}", variable, value),
            look,
            has_value & (variable.values == value),
        )
        for value, look in zip(axis.values.tolist(), looks, strict=True)
    ]


def _special_cells(
    cut: OpenedSweep, name: str, values: np.ndarray, result: np.ndarray, dots: bool, grey: bool
) -> list[Cells]:
    """Return the points with a result whose value is not on a scale, the value 0 first."""
    rests = np.zeros(values.shape, bool)
    if name in _NOT_AT_REST:
        rests = result & (cut["rest_fraction"].transpose(*cut.grid).values > 0.0)
    zero = result & ~rests & ~(values > 0.0) & (name in _ZERO)
    infinite = result & np.isneginf(values) & (name == "lyapunov")
    none = result & ~np.isfinite(values) & ~zero & ~rests & ~infinite
    words = (_ZERO.get(name, ""), Regime.REST.word, r"rest, $\lambda_1 = -\infty$", "no value")
    plain = map(
        style.Look.plain,
        (style.PALE if dots else style.WHITE, style.REST_COLOUR, style.YELLOW, style.NO_VALUE),
    )
    looks = style.GREY_SPECIAL if grey else plain
    return list(map(Cells, words, looks, (zero, rests, infinite, none)))


def _scale(name: str, values: np.ndarray, rounding: float) -> Normalize:
    """Return a scale centred on 0 if both signs occur, else a logarithmic or a linear one."""
    # A scale centred on 0 does not end within the `rounding` of the values.
    if not values.size:
        return Normalize(0.0, 1.0)
    low, high = float(values.min()), float(values.max())
    if name == "lyapunov" or low < 0.0 < high:
        limit = max(-float(np.quantile(values, 0.01)), high, rounding) or -low or 1.0
        return Normalize(-limit, limit)
    positive = values[values > 0.0]
    if low >= 0.0 and positive.size and name != "rest_fraction":
        least = float(np.quantile(positive, 0.005))
        if high > _LOG_FROM * least:
            return LogNorm(least, high)
    return Normalize(*widened(low, high))
