"""The bifurcation diagram: a coordinate of the section or of the impacts over one swept axis."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure

from sweeps.analysis.regimes import has_result
from sweeps.analysis.rig import in_si, rig_of
from sweeps.analysis.selection import (
    COORDINATES,
    Selection,
    check_diagnostic,
    config_of,
    listed,
    recorded_coordinate,
    split_directions,
)
from sweeps.config.groups import DIAGNOSTICS
from sweeps.config.rig import si_name
from sweeps.errors import Refused
from sweeps.plotting import canvas
from sweeps.plotting.canvas import PAGE, Page, styled
from sweeps.plotting.exact import draw_branches, name_parts
from sweeps.plotting.labels import as_variable, label, label_axis
from sweeps.plotting.lines import (
    cell_edges,
    count_pixels,
    refuse_empty,
    scalars,
    select_line,
)
from sweeps.plotting.style import (
    BOTH_COLOUR,
    DENSITY,
    DIRECTION_COLOURS,
    LEAST_SHARE,
    dots_per_inch,
)

#: More points than this are drawn as a density, because single markers would merge.
DENSITY_FROM = 2_000_000
#: Number of values read at a time.
_PART_SIZE = 1_000_000
#: Height of a panel below the diagram, relative to the height of the diagram.
_LOWER = 0.4
_NORM = LogNorm(LEAST_SHARE, 1.0, clip=True)
_RAMP = LinearSegmentedColormap.from_list("density", DENSITY)
# The ramps for up, down and both end at full colours: the darker ends would all look the same where
# the motion is periodic.
_DIRECTION_RAMPS = [
    LinearSegmentedColormap.from_list("density", colours)
    for colours in (
        ["#A6CBE3", DIRECTION_COLOURS[0]],
        ["#F5D79A", DIRECTION_COLOURS[1]],
        ["#CCCCCC", BOTH_COLOUR],
    )
]


@styled
def bifurcation(
    dataset: xr.Dataset,
    *,
    axes: Sequence[str] = (),
    at: Selection | None = None,
    coordinate: str | None = None,
    exact: xr.Dataset | None = None,
    below: Sequence[str] = (),
    page: Page = PAGE,
    ax: Axes | None = None,
) -> Figure:
    """Draw a coordinate of the section or of the impacts over one swept axis.

    Points that failed or are not computed yet are not drawn, but marked below the diagram.

    Parameters
    ----------
    axes : sequence of str, optional
        The swept axis, by default the one with most values.
    coordinate : str, optional
        One of ``sweeps.analysis.selection.COORDINATES``, by default the first in the file.
    exact : Dataset, optional
        Exact branches to draw over the points: the result of `sweeps.branches` for this axis.
    below : sequence of str, optional
        Scalars of the file, for example ``lyapunov``; each gets a panel below the diagram.
    """
    line, axis, coordinate = select_line(dataset, axes, at, coordinate)
    _check(dataset, axis, exact, below)
    if ax is not None and below:
        raise Refused("panels below a diagram need a figure of their own: leave out ax or below")
    line, axis = in_si(line), si_name(axis, rig_of(dataset))
    exact = None if exact is None else in_si(exact, dataset)
    values, ways = line[axis].values, split_directions(line)
    low, high = value_range(ways, coordinate)
    if low > high:
        refuse_empty(line, coordinate)
    heights = [1.0] + [_LOWER] * len(below)
    panel, *lower = canvas.stacked_panels(page, heights, len(heights)) if ax is None else [ax]
    label_axis(panel.xaxis, line[axis])
    label_axis(panel.yaxis, as_variable(coordinate, dict(config_of(dataset).units.items())))
    computed = int(has_result(line["status"].values).sum())
    dense = computed * line.sizes[COORDINATES[coordinate].dimension] > DENSITY_FROM
    if dense:
        panel.update_datalim([(values.min(), low), (values.max(), high)])
        panel.autoscale_view()
    else:
        _draw_markers(panel, values, ways, coordinate)
    if len(ways) > 1:
        _name_directions(panel, line[axis].attrs["symbol"], dense)
    parts = {} if exact is None else draw_branches(panel, exact, coordinate, len(ways) > 1)
    if parts:
        low, high = panel.dataLim.intervaly
    if len(values) > 100:
        panel.set_xlim(values.min(), values.max())
    canvas.widen_if_constant(panel.set_ylim, low, high)
    page.set_limits(panel)
    name_parts(panel, parts)
    canvas.mark_status(panel, values, line["status"].values)
    for scalar_panel, name in zip(lower, below, strict=True):
        _draw_scalar(scalar_panel, axis, ways, name)
    if lower:
        label_axis(lower[-1].xaxis, line[axis])
        panel.set_xlabel("")
    handles, texts = panel.get_legend_handles_labels()
    of_parts = [handles[texts.index(text)] for text in parts if text in texts]
    others = [handle for handle in handles if handle not in of_parts]
    figure = canvas.finish(panel, page, line, [*others, *of_parts])
    if dense:
        _draw_density(panel, values, ways, coordinate)
    return figure


def _check(dataset: xr.Dataset, axis: str, exact: xr.Dataset | None, below: Sequence[str]) -> None:
    """Refuse branches over another axis, and names that are not scalars or are given twice."""
    if exact is not None and axis not in exact.coords:
        raise Refused(f"the exact branches are over {listed(map(str, exact.coords))}, not {axis}")
    available = scalars(dataset)
    for name in below:
        if name in DIAGNOSTICS:
            check_diagnostic(dataset, name)
        if name not in available:
            raise Refused(
                f"{name or repr(name)} cannot be drawn below a diagram; choose from: "
                f"{listed(available)}"
            )
        if list(below).count(name) > 1:
            raise Refused(f"{name} is asked for twice below the diagram")


def _draw_markers(
    panel: Axes, values: np.ndarray, ways: Sequence[xr.Dataset], coordinate: str
) -> None:
    """Draw markers; those of a second direction are on top and smaller, so that both are seen."""
    scales = (1.0,) if len(ways) == 1 else (1.4, 0.6)
    for way, colour, scale in zip(ways, DIRECTION_COLOURS, scales, strict=False):
        computed = has_result(way["status"].values)
        y = recorded_coordinate(way, coordinate).values[computed]
        x = np.broadcast_to(values[computed, None], y.shape)[np.isfinite(y)]
        canvas.draw_points(panel, x, y[np.isfinite(y)], colour, scale)


def _name_directions(panel: Axes, symbol: str, dense: bool) -> None:
    """Add the colours of the two directions to the legend, with the symbol of the axis."""
    texts = rf"up, ${symbol} \rightarrow$", rf"down, ${symbol} \leftarrow$"
    for text, colour in zip(texts, DIRECTION_COLOURS, strict=True):
        panel.plot([], [], "s" if dense else "o", color=colour, markersize=4, label=text)
    if dense:
        panel.plot([], [], "s", color=BOTH_COLOUR, markersize=4, label="both")


def _draw_scalar(panel: Axes, axis: str, ways: Sequence[xr.Dataset], name: str) -> None:
    """Draw a scalar, or both Lyapunov exponents, over the axis; each direction in its colour."""
    for way, colour in zip(ways, DIRECTION_COLOURS, strict=False):
        x = way[axis].values
        y = np.asarray(way[name].values, float).reshape(len(x), -1)
        if name == "period":
            y = np.where(y > 0.0, y, np.nan)  # 0: no repetition was found
        size = float(np.clip(250.0 / len(x), 0.8, 2.5))
        for column, alpha in zip(y.T, (1.0, 0.45), strict=False):
            (points,) = panel.plot(x, column, "o", color=colour, alpha=alpha, rasterized=True)
            points.set(markersize=size, markeredgewidth=0)
    if name == "lyapunov":
        panel.axhline(0.0, color="black", linewidth=0.6, zorder=1)
    panel.set_title(label(ways[0][name]), loc="left", wrap=True)


def computed_parts(line: xr.Dataset, coordinate: str) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Read a coordinate of the computed points of a line in parts.

    Yields the indices of k points and their values, shapes (k,) and (k, record).
    """
    (axis,), computed = line["status"].dims, has_result(line["status"].values)
    rows = max(1, _PART_SIZE // line.sizes[COORDINATES[coordinate].dimension])
    for start in range(0, len(computed), rows):
        kept = np.flatnonzero(computed[start : start + rows])
        if len(kept):
            part = line.isel({axis: slice(start, start + rows)})
            yield start + kept, recorded_coordinate(part, coordinate).values[kept]


def value_range(lines: Sequence[xr.Dataset], coordinate: str) -> tuple[float, float]:
    """Return the least and the greatest value of a coordinate; inf and -inf without values."""
    low, high = np.inf, -np.inf
    for line in lines:
        for _, values in computed_parts(line, coordinate):
            values = values[np.isfinite(values)]
            low, high = values.min(initial=low), values.max(initial=high)
    return float(low), float(high)


def _draw_density(
    panel: Axes, values: np.ndarray, ways: Sequence[xr.Dataset], coordinate: str
) -> None:
    """Draw the share of each column's points in each of its pixels, with a colour bar.

    Call this last, because the pixels are those of the finished panel in a PNG. A column is one of
    the `values` of the axis, or one pixel wide if there are more values than pixels. With two
    directions, the colour of a pixel tells which direction has points in it, or that both have.
    """
    figure = canvas.figure_of(panel)
    ramps = [_RAMP] if len(ways) == 1 else _DIRECTION_RAMPS
    bar = figure.colorbar(ScalarMappable(_NORM, ramps[-1]), ax=panel, pad=0.01, aspect=40)
    bar.set_label("share of the points of a column")
    figure.draw_without_rendering()  # computes the layout
    box, scale = panel.get_window_extent(), dots_per_inch() / figure.dpi
    columns, rows = (round(size * scale) for size in (box.width, box.height))
    low, high = panel.get_ylim()
    log = panel.get_xscale() == "log"
    left, right = sorted(panel.get_xlim())
    in_view = np.sort(values[(values >= left) & (values <= right)])
    in_view = in_view if len(in_view) > 1 else np.sort(values)
    x_edges = cell_edges(in_view, log)
    if len(in_view) > columns:
        x_edges = (np.geomspace if log else np.linspace)(in_view[0], in_view[-1], columns + 1)
    y_edges = np.linspace(low, high, rows + 1)
    shares = [_column_shares(way, coordinate, values, x_edges, y_edges) for way in ways]
    if len(shares) == 2:
        in_both = (shares[0] > 0.0) & (shares[1] > 0.0)
        mean = np.where(in_both, 0.5 * (shares[0] + shares[1]), 0.0)
        shares = [*(np.where(in_both, 0.0, share) for share in shares), mean]
    for share, ramp in zip(shares, ramps, strict=True):
        cells = np.ma.masked_equal(share, 0.0).T
        panel.pcolormesh(x_edges, y_edges, cells, norm=_NORM, cmap=ramp, rasterized=True)


def _column_shares(
    line: xr.Dataset,
    coordinate: str,
    values: np.ndarray,
    x_edges: np.ndarray,
    y_edges: np.ndarray,
) -> np.ndarray:
    """Return the share of each column's points in each of its pixels, shape (columns, rows)."""
    low, high, rows = y_edges[0], y_edges[-1], len(y_edges) - 1
    counts = np.zeros((len(x_edges) - 1, rows))
    column = np.searchsorted(x_edges, values, side="right") - 1
    column[values == x_edges[-1]] = len(counts) - 1
    in_view = (column >= 0) & (column < len(counts))
    for indices, y in computed_parts(line, coordinate):
        indices, y = indices[in_view[indices]], y[in_view[indices]]
        counts += count_pixels(column[indices], y, (len(counts), rows), low, high)
    return counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
