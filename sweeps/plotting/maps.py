"""Draws the cells of a map over two swept axes, and chooses entries of its legend."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from sweeps.opened.opened_sweep import OpenedSweep, Selection
from sweeps.plotting import canvas, labels
from sweeps.plotting.colours import paint_of
from sweeps.plotting.contents import NameOrArray, fitting_orbits, with_number
from sweeps.plotting.exact_lines import draw_curves
from sweeps.plotting.legend import COMMON
from sweeps.plotting.looks import OTHERS, Cells, class_numbers, failed_cells, patch_named
from sweeps.plotting.page import PAGE, Page, styled
from sweeps.plotting.pixels import cell_edges
from sweeps.plotting.placed_names import draw_boundaries, name_regions
from sweeps.plotting.style import CLASSES, ground, hatch_on
from sweeps.plotting.table_points import draw_overlay, read_overlay
from vibroimpact.points.regimes import ON_ITS_WAY, RESTING, has_result
from vibroimpact.status import Status

#: Look of points that are not computed yet.
_PENDING: dict[str, Any] = {"edgecolor": "#888888", "hatch": "//////", "linewidth": 0.0}
#: Look of the lines over points that are not on their orbit yet.
_APPROACHING: dict[str, Any] = {"edgecolor": "white", "hatch": "////////", "linewidth": 0.0}
#: Most classes that the entry of other classes names.
_MOST_OTHERS = 3


@functools.partial(styled, marks=True)
def parameter_map(
    sweep: OpenedSweep,
    *,
    axes: Sequence[str] = (),
    at: Selection | None = None,
    quantity: NameOrArray | None = None,
    exact: xr.Dataset | None = None,
    overlay: Any = None,
    page: Page = PAGE,
    ax: Axes | None = None,
) -> Figure:
    """Draw a quantity over two swept axes, one cell per point.

    A cell reaches halfway to its neighbours. Failed points are grey, and points that are not
    computed yet are hatched. In a map of classes, white lines mark motions on their way to m/q, and
    regions have the name of their class where there is room for it.

    Parameters
    ----------
    axes : str or sequence of str, optional
        Abscissa and ordinate, by default the two with most values; if both have the same number of
        values, the later one is the abscissa.
    quantity : str or DataArray, optional
        A variable of the file with a number per point, by default ``period``; ``mean_force``, that
        on the stop; ``peak_to_peak``, where the file has ``x_min`` and ``x_max``; or numbers
        computed from the Dataset, with ``long_name`` and ``units``.
    exact : Dataset, optional
        Curves of flips, folds and grazes to draw over the map: the result of `sweeps.curves` for
        these axes.

    Examples
    --------
    >>> ds = sweeps.open_sweep("map.h5")  # of the example of `curves`
    >>> sweeps.plotting.parameter_map(ds, exact=sweeps.curves(ds)).savefig("map.png")
    """
    abscissa, ordinate = chosen = sweep.map_axes(axes, at)
    if exact is not None:
        needed = {"curve", "m", "q", "special"}
        exact = fitting_orbits(exact, "curves", chosen, needed, sweep.cut(at, free=chosen))
    sweep, name = with_number(sweep, shown_quantity(sweep, quantity))
    points = read_overlay(overlay, sweep, [[abscissa], [ordinate]], name)
    cut = sweep.cut(at, free=chosen).sortby(chosen).transpose(ordinate, abscissa)
    paint = paint_of(cut, name, grey=page.grey)
    panel = canvas.new_panel(ax, page)
    if paint.values.count():
        mesh = panel.pcolormesh(*_edges_of(cut), paint.values, norm=paint.norm, cmap=paint.ramp)
        mesh.set_rasterized(True)
    status, hatched = cut["status"].values, page.grey and name != "period"
    cells = [*paint.cells, *failed_cells(status, hatched)]
    draw_cells(panel, cut, cells)
    paint.add_bar([panel])
    is_marked = name == "period" and page.marks
    approaching = cut.on_its_way if is_marked else np.zeros(cut.shape, bool)
    if approaching.any():
        _draw_hatch(panel, cut, approaching, **_APPROACHING)
    page = page.set_limits(panel)
    view = view_of(panel, cut)
    shares = entries_of(cut, cells, view)
    if (visible := approaching[view]).any():
        share = 100.0 * visible.sum() / has_result(status[view]).sum()
        text = f"{ON_ITS_WAY} ({share:.3g} %)"
        shares[patch_named(text, facecolor="#888888", **_APPROACHING)] = float(visible.mean())
    if exact is not None:
        shares |= draw_curves(panel, exact, cut, page.marks)
    scale = (name, paint.ramp, paint.norm)
    measured = draw_overlay(points, [(panel, abscissa, ordinate)], page, scale)
    shares |= dict.fromkeys(measured, 1.0)
    if name != "period":
        return canvas.finish(panel, page, cut, [*shares], paint.title)
    numbers, names = class_numbers(*cut.classes)
    _name_others(shares, numbers[view], names)
    figure = canvas.finish(panel, page, cut, [*shares], paint.title, shares=shares)
    name_and_bound(panel, page, cut, numbers, names)
    return figure


def shown_quantity(sweep: OpenedSweep, quantity: NameOrArray | None) -> NameOrArray:
    """Return the quantity of a map, by default the class if the file has it."""
    if quantity is not None:
        return quantity
    return "period" if "period" in sweep else "impacts_per_period"


def view_of(panel: Axes, cut: OpenedSweep) -> tuple[np.ndarray, ...]:
    """Return the indices of the cells that are within the limits of a map."""
    limits = map(sorted, (panel.get_xlim(), panel.get_ylim()))
    x, y = (
        (edges[1:] > low) & (edges[:-1] < high)
        for edges, (low, high) in zip(_edges_of(cut), limits, strict=True)
    )
    return np.ix_(y, x)


def entries_of(cut: OpenedSweep, cells: Iterable[Cells], view: Any = ...) -> dict[Artist, float]:
    """Return the entries of a legend for the cells in view, and the share that each explains."""
    # That of the commonest rest explains the colour of all; failed points are no less than common.
    status, shares = cut["status"].values[view], dict[Artist, float]()
    for cell in (cell.within(view) for cell in cells):
        if cell.where.any():
            is_result = has_result(status[cell.where]).any()
            shares[cell.handle()] = float(cell.where.mean()) if is_result else COMMON
    rests = {e: share for e, share in shares.items() if str(e.get_label()).startswith(RESTING)}
    shares |= {max(rests, key=rests.__getitem__): sum(rests.values())} if rests else {}
    if pending := np.count_nonzero(status == Status.PENDING):
        text = f"{labels.status_name(Status.PENDING)} ({pending:,} of {status.size:,})"
        shares[patch_named(text, facecolor=ground(), **_PENDING)] = COMMON
    return shares


def _name_others(patches: Iterable[Artist], numbers: np.ndarray, names: Mapping[int, str]) -> None:
    """Name, in the entry of other classes, the commonest of those that cover much."""
    every, counts = np.unique(numbers, return_counts=True)
    common = every[np.argsort(-counts)][: np.count_nonzero(counts >= COMMON * numbers.size)]
    classes = [name for number in common.tolist() if (name := names.get(number, ""))[:1].isdigit()]
    if others := [name for name in classes if name not in {f"{m}/{q}" for m, q in CLASSES}]:
        (patch,) = (patch for patch in patches if patch.get_label() == OTHERS)
        more = ", ..." if len(others) > _MOST_OTHERS else ""
        patch.set_label(f"{OTHERS}: {', '.join(others[:_MOST_OTHERS])}{more}")


def name_and_bound(
    panel: Axes, page: Page, cut: OpenedSweep, classes: np.ndarray, names: Mapping[int, str]
) -> None:
    """Write the names of classes into their regions; in grey, draw the boundaries."""
    edges = _edges_of(cut)
    if page.grey:
        draw_boundaries(panel, edges, classes)
    name_regions(panel, edges, classes, names)


def draw_cells(panel: Axes, cut: OpenedSweep, cells: Iterable[Cells]) -> None:
    """Draw the cells of a cut with increasing axes, hatch pending points, and label the axes."""
    # The dimensions of ``status`` must be the ordinate and the abscissa, both increasing.
    x, y = _edges_of(cut)
    for axis, name, edges in zip((panel.yaxis, panel.xaxis), cut.grid, (y, x), strict=True):
        labels.label_axis(axis, cut[name])
        labels.set_lim(axis, edges[0], edges[-1])
    panel.update_datalim([(x[0], y[0]), (x[-1], y[-1])])  # also without a cell
    status = cut["status"].values
    cells = [cell for cell in cells if cell.where.any()]
    index = np.full(status.shape, -1)
    for number, cell in enumerate(cells):
        index[cell.where] = number
    if cells:
        colours = ListedColormap([cell.look.colour for cell in cells])
        norm, image = Normalize(-0.5, len(cells) - 0.5), np.ma.masked_equal(index, -1)
        panel.pcolormesh(x, y, image, norm=norm, cmap=colours, rasterized=True)
    for cell in cells:
        if cell.look.hatch:
            edge = hatch_on(cell.look.colour)
            _draw_hatch(panel, cut, cell.where, hatch=cell.look.hatch, edgecolor=edge)
    if (status == Status.PENDING).any():
        panel.patch.set(facecolor=ground(), **_PENDING)


def _draw_hatch(panel: Axes, cut: OpenedSweep, where: np.ndarray, **props: Any) -> None:
    """Hatch the cells of a mask."""
    x, y = _edges_of(cut)
    changes = np.diff(np.pad(where, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    (rows, first), (_, last) = np.nonzero(changes == 1), np.nonzero(changes == -1)
    left, right, low, high = x[first], x[last], y[rows], y[rows + 1]
    corners = np.stack([left, low, right, low, right, high, left, high, left, low], axis=1)
    codes = np.tile([Path.MOVETO, *[Path.LINETO] * 3, Path.CLOSEPOLY], len(rows))
    # One path, so that the lines pass from cell to cell.
    outline = Path(corners.reshape(-1, 2), codes)
    props = {"linewidth": 0.0, **props}
    panel.add_artist(PathPatch(outline, facecolor="none", rasterized=True, **props))


def _edges_of(cut: OpenedSweep) -> list[np.ndarray]:
    """Return the edges of the cells along the abscissa and along the ordinate."""
    edges = []
    for name in cut.grid[::-1]:
        values = cut[name].values
        labels.refuse_too_large(name, values)
        with np.errstate(over="ignore"):
            bounds = cell_edges(values, labels.log_spaced(values))
        if not np.isfinite(bounds).all():  # of so many decades
            labels.refuse_too_large(f"a cell of {name}", bounds)
        edges.append(bounds)
    return edges
