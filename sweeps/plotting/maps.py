"""Maps over two swept axes, one cell per point: the class of the motion or another quantity."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import Colormap, LinearSegmentedColormap, ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from sweeps.analysis.exact_curves import map_axes
from sweeps.analysis.regimes import Regime, classify, frequent_periods, has_result
from sweeps.analysis.rig import in_si
from sweeps.analysis.selection import Selection, check_diagnostic, listed, select
from sweeps.errors import Refused
from sweeps.plotting import canvas
from sweeps.plotting.canvas import PAGE, Page, styled
from sweeps.plotting.exact import draw_curves
from sweeps.plotting.labels import (
    CLASSES_TITLE,
    label,
    label_axis,
    log_spaced,
    status_name,
    tick_in_decades,
)
from sweeps.plotting.lines import cell_edges
from sweeps.plotting.style import (
    BLUE,
    OTHER_PERIODIC,
    PERIODIC,
    REGIMES,
    REST,
    RESULTS,
    STATUS_COLOURS,
    VERMILION,
    WHITE,
    class_colours,
)
from vibroimpact.status import Status

#: Look of points that are not computed yet.
_PENDING: dict[str, Any] = {
    "facecolor": "white", "edgecolor": "#888888", "hatch": "//////", "linewidth": 0.0
}  # fmt: skip
_LOW_IS_DARK = "cividis"
_SIGNED = LinearSegmentedColormap.from_list(
    "signed", ["#00263D", BLUE, "#F7F7F7", VERMILION, "#4A1D00"]
)


class Cells(NamedTuple):
    """The points of a map with the same colour: a label, the colour and the mask of the points."""

    label: str
    colour: str
    where: np.ndarray


def failed_cells(status: np.ndarray) -> list[Cells]:
    """Return the failed points, by outcome."""
    return [
        Cells(status_name(outcome), colour, status == outcome)
        for outcome, colour in STATUS_COLOURS.items()
        if outcome is not Status.PENDING
    ]


def period_cells(cut: xr.Dataset) -> list[Cells]:
    """Return the points of each regime; each of the most frequent classes has its own colour."""
    check_diagnostic(cut, "period")
    regimes, m, q = classify(cut), cut["period"].values, cut["period_impacts"].values
    periodic = regimes == Regime.PERIODIC
    cells = []
    frequent = frequent_periods(m[periodic], q[periodic], len(PERIODIC))
    for (periods, impacts), colour in class_colours(frequent).items():
        where = periodic & (m == periods) & (q == impacts)
        text = f"{periods}/{impacts}" + (", no impact" if impacts == 0 else "")
        cells.append(Cells(text, colour, where))
        periodic = periodic & ~where
    cells.append(Cells("other m/q", OTHER_PERIODIC, periodic))
    for regime, (text, colour) in REGIMES.items():
        if regime is Regime.UNDECIDED and "lyapunov" not in cut:
            text = "no repetition found"
        cells.append(Cells(text, colour, regimes == regime))
    return cells


def status_cells(cut: xr.Dataset) -> list[Cells]:
    """Return the points with a result, by outcome."""
    status = cut["status"].values
    return [
        Cells(status_name(outcome), colour, status == outcome)
        for outcome, colour in RESULTS.items()
    ]


def lyapunov_map(panel: Axes, cut: xr.Dataset) -> list[Cells]:
    """Colour the larger Lyapunov exponent by sign and size, on a scale centred on 0."""
    larger = cut["lyapunov"].isel(exponent=0).values
    finite = larger[np.isfinite(larger)]
    low, high = np.quantile(finite, [0.01, 1.0]) if len(finite) else (-1.0, 1.0)
    limit = max(-low, high, 1e-12)
    norm = Normalize(-limit, limit)
    variable = cut["lyapunov"]
    about = {"long_name": f"larger {variable.long_name}", "symbol": rf"{variable.symbol}_1"}
    exponent = variable.assign_attrs(about)
    _draw_values(panel, cut, np.ma.masked_invalid(larger), norm, _SIGNED, exponent)
    return [Cells(r"with rest, $\lambda_1 = -\infty$", "#F0E442", np.isneginf(larger))]


def rest_map(panel: Axes, cut: xr.Dataset) -> list[Cells]:
    """Colour the fraction of time at rest."""
    fraction = cut["rest_fraction"].values
    rests = np.ma.masked_where(~(fraction > 0.0), fraction)
    norm = Normalize(0.0, float(rests.max()) if rests.count() else 1.0)
    _draw_values(panel, cut, rests, norm, _LOW_IS_DARK, cut["rest_fraction"])
    return [Cells("no rest", WHITE, fraction == 0.0)]


def log_map(
    panel: Axes, cut: xr.Dataset, *, name: str, zero: str = "no impact", at_rest: bool = True
) -> list[Cells]:
    """Colour the quantity `name`, >= 0, on a logarithmic scale; `zero` is the label of value 0.

    With `at_rest`, motions with rest are coloured, too. The number of impacts and the slowest
    impact are not defined for them, because a chatter has infinitely many impacts.
    """
    variable = in_si(cut[[name]])[name]
    values = variable.values
    rests = (cut["rest_fraction"].values > 0.0) & (not at_rest)
    positive = np.ma.masked_where(rests | ~(values > 0.0), values)
    shown = positive.compressed()
    if not len(shown) and not rests.any() and has_result(cut["status"].values).all():
        raise Refused(f"there is nothing to draw: {name} is 0 at every point")
    low, high = (np.quantile(shown, 0.005), shown.max()) if len(shown) else (0.1, 1.0)
    norm = LogNorm(low, max(high, low * 1.001))
    _draw_values(panel, cut, positive, norm, _LOW_IS_DARK, variable)
    return [
        Cells(zero, WHITE, has_result(cut["status"].values) & ~rests & ~(values > 0.0)),
        Cells("with rest", REST, rests),
    ]


#: The variables that a map can show.
QUANTITIES: Mapping[str, Callable[[Axes, xr.Dataset], list[Cells]]] = {
    "period": lambda panel, cut: period_cells(cut),
    "impacts_per_period": partial(log_map, name="impacts_per_period", at_rest=False),
    "lyapunov": lyapunov_map,
    "rest_fraction": rest_map,
    "slowest_impact": partial(log_map, name="slowest_impact", at_rest=False),
    "fastest_impact": partial(log_map, name="fastest_impact"),
    "impulse": partial(log_map, name="impulse"),
    "energy_lost": partial(log_map, name="energy_lost"),
    "max_penetration": partial(log_map, name="max_penetration", zero="none"),
    "status": lambda panel, cut: status_cells(cut),
}


@styled
def parameter_map(
    dataset: xr.Dataset,
    *,
    axes: Sequence[str] = (),
    at: Selection | None = None,
    quantity: str | None = None,
    exact: xr.Dataset | None = None,
    page: Page = PAGE,
    ax: Axes | None = None,
) -> Figure:
    """Draw a quantity over two swept axes, one cell per point.

    A cell reaches halfway to its neighbours. Failed points are grey, and points that are not
    computed yet are hatched.

    Parameters
    ----------
    axes : sequence of str, optional
        Abscissa and ordinate, by default the two with most values; if both have the same number of
        values, the later one is the abscissa.
    quantity : str, optional
        One of ``QUANTITIES``, by default the first in the file.
    exact : Dataset, optional
        Curves of flips, folds and grazes to draw over the map: the result of `sweeps.curves` for
        these axes.
    """
    abscissa, ordinate = chosen = map_axes(dataset, axes)
    if exact is not None and set(exact.coords) != set(chosen):
        over = listed(map(str, exact.coords))
        raise Refused(f"the exact curves are over {over}, not {listed(chosen)}")
    available = [name for name in QUANTITIES if name in dataset]
    if quantity is None:
        quantity = available[0]
    if quantity not in available:
        name, choice = quantity or repr(quantity), f"choose from: {listed(available)}"
        if quantity in dataset:
            raise Refused(f"a map does not show {name}; {choice}")
        raise Refused(f"the file has no {name} to draw; {choice}")
    cut = select(dataset, at, free=chosen).sortby(chosen).transpose(ordinate, abscissa, ...)
    panel = canvas.new_panel(ax, page)
    handles = draw_cells(panel, cut, QUANTITIES[quantity](panel, cut))
    page.set_limits(panel)
    if exact is not None:
        handles += draw_curves(panel, in_si(exact, dataset))
    return canvas.finish(panel, page, cut, handles, CLASSES_TITLE if quantity == "period" else None)


def draw_cells(panel: Axes, cut: xr.Dataset, cells: Iterable[Cells]) -> list[Artist]:
    """Draw the cells and those of failed points, and label the axes; return the legend's patches.

    The dimensions of ``status`` in the cut must be the ordinate and the abscissa, both increasing.
    """
    y, x = _axes_of(cut)
    label_axis(panel.xaxis, x)
    label_axis(panel.yaxis, y)
    status = cut["status"].values
    cells = [cell for cell in (*cells, *failed_cells(status)) if cell.where.any()]
    index = np.full(status.shape, -1)
    for number, cell in enumerate(cells):
        index[cell.where] = number
    if cells:
        colours = ListedColormap([cell.colour for cell in cells])
        norm = Normalize(-0.5, len(cells) - 0.5)
        _draw_mesh(panel, cut, np.ma.masked_equal(index, -1), norm, colours)
    handles: list[Artist] = [
        Patch(facecolor=cell.colour, edgecolor="black", linewidth=0.4, label=cell.label)
        for cell in cells
    ]
    pending = np.count_nonzero(status == Status.PENDING)
    if pending:
        panel.patch.set(**_PENDING)
        text = f"{status_name(Status.PENDING)} ({pending:,} of {status.size:,})"
        handles.append(Patch(label=text, **_PENDING))
    return handles


def _axes_of(cut: xr.Dataset) -> list[xr.DataArray]:
    """Return the ordinate and the abscissa, in SI units for a rig."""
    seen = in_si(cut[["status"]])
    return [seen[name] for name in seen["status"].dims]


def _draw_mesh(
    panel: Axes,
    cut: xr.Dataset,
    values: np.ma.MaskedArray,
    norm: Normalize,
    colours: str | Colormap,
) -> QuadMesh:
    """Draw one cell per point of a cut, except where `values` are masked."""
    y, x = _axes_of(cut)
    edges = [cell_edges(axis.values, log_spaced(axis.values)) for axis in (x, y)]
    mesh = panel.pcolormesh(*edges, values, norm=norm, cmap=colours, rasterized=True)
    panel.set(xlim=edges[0][[0, -1]], ylim=edges[1][[0, -1]])
    return mesh


def _draw_values(
    panel: Axes,
    cut: xr.Dataset,
    values: np.ma.MaskedArray,
    norm: Normalize,
    colours: str | Colormap,
    variable: xr.DataArray,
) -> None:
    """Draw values with a colour bar, which has an arrow if some values lie below its range."""
    mesh = _draw_mesh(panel, cut, values, norm, colours)
    if values.count() == 0:
        return
    low, high = mesh.get_clim()
    extend = "min" if values.min() < low else "neither"
    bar = canvas.figure_of(panel).colorbar(
        mesh, ax=panel, location="bottom", pad=0.02, aspect=35, extend=extend
    )
    bar.set_label(label(variable), wrap=True)
    if isinstance(norm, LogNorm) and high < 100.0 * low:
        tick_in_decades(bar.ax.xaxis)
