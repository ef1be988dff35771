"""The bifurcation diagram: a coordinate of the section or of the impacts over one swept axis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sweeps.analysis.exact_branches import lines_of
from sweeps.analysis.motion import has_result
from sweeps.analysis.selection import Cut, Setting
from sweeps.plotting.canvas import PAGE, Page, add_legend, in_style, new_panels
from sweeps.plotting.density import Record, add_density_bar, draw_density, value_range
from sweeps.plotting.exact_branches import draw_branches, name_parts
from sweeps.plotting.labels import add_title, label_ordinate, set_scale
from sweeps.plotting.lines import refuse_empty, select_line, split_directions
from sweeps.plotting.marks import draw_points, mark_status, widen_if_constant
from sweeps.plotting.palette import BOTH_COLOUR, DIRECTION_COLOURS
from sweeps.plotting.quantity_words import as_variable, label
from sweeps.plotting.scalar_panels import check_scalars, draw_scalar
from vibroimpact.oscillator import PARAMETERS

#: More points than this are drawn as a density: single markers would merge into a blob.
DENSITY_FROM = 2_000_000


@in_style
def bifurcation(
    dataset: xr.Dataset,
    *,
    axes: Sequence[str] = (),
    at: Cut | None = None,
    coordinate: str | None = None,
    exact: bool = False,
    below: Sequence[str] = (),
    page: Page = PAGE,
    ax: Axes | None = None,
) -> Figure:
    """Draw a coordinate of the section or of the impacts over one swept axis.

    Points that failed or were not computed yet are marked below the diagram, not drawn.

    Parameters
    ----------
    dataset : Dataset
        From `sweeps.open_sweep`.
    axes : sequence of str, optional
        The swept axis, by default the longest.
    at : mapping of str to float, optional
        Values of the other swept axes: the nearest of the grid is taken, by default the first.
        Of two directions both are drawn, unless ``direction`` is given.
    coordinate : str, optional
        One of ``sweeps.analysis.coordinates.COORDINATES``, by default the first that the file has.
    exact : bool
        Whether to draw the exact branches of the periodic motions over the points.
    below : sequence of str, optional
        Scalars of the file, as ``lyapunov``, each in a panel below the diagram.
    page : Page, optional
    ax : Axes, optional
        The panel to draw into, by default that of a new figure.

    Returns
    -------
    Figure
        That of `ax`, or the new one.

    Raises
    ------
    Refused
        If the file has no such axis, coordinate or scalar, or nothing to draw.
    """
    line, axis, coordinate = select_line(dataset, axes, at, coordinate)
    check_scalars(dataset, list(below))
    values = line[axis].values
    branches = split_directions(line)
    records = [
        Record(branch, coordinate, has_result(branch["status"].values)) for branch in branches
    ]
    low, high = value_range(records)
    if low > high:
        refuse_empty(line, coordinate)
    orbits = lines_of(dataset, axis, at) if exact else []
    panel, *lower = new_panels(ax, page, 5.0, [3.5] + [1.15] * len(below))
    set_scale(panel.xaxis, values)
    dense = sum(record.size for record in records) > DENSITY_FROM
    if dense:
        panel.update_datalim([(values.min(), low), (values.max(), high)])
        panel.autoscale_view()
    else:
        _draw_markers(panel, values, records)
    if len(records) > 1:
        _name_directions(panel, axis, dense)
    parts = draw_branches(panel, orbits, coordinate) if orbits else {}
    if parts:
        low, high = panel.dataLim.intervaly
    if len(values) > 100:
        panel.set_xlim(values.min(), values.max())
    widen_if_constant(panel.set_ylim, low, high)
    page.set_limits(panel)
    name_parts(panel, parts)
    mark_status(panel, values, line["status"].values)
    for scalar_panel, name in zip(lower, below, strict=True):
        draw_scalar(scalar_panel, axis, branches, name)
    label_ordinate(panel, as_variable(coordinate, Setting.of(dataset).units))
    [panel, *lower][-1].set_xlabel(label(dataset[axis]))
    add_legend(panel)
    figure = add_title(panel, page, line)
    if dense:
        add_density_bar(panel, len(records))
        draw_density(panel, values, records)
    return figure


def _draw_markers(panel: Axes, values: np.ndarray, records: Sequence[Record]) -> None:
    """Draw markers; of two directions the second on top and smaller, so that both are seen."""
    scales = (1.0,) if len(records) == 1 else (1.4, 0.6)
    for record, colour, scale in zip(records, DIRECTION_COLOURS, scales, strict=False):
        y = record.values.values[record.computed]
        x = np.broadcast_to(values[record.computed, None], y.shape)[np.isfinite(y)]
        draw_points(panel, x, y[np.isfinite(y)], colour, scale)


def _name_directions(panel: Axes, axis: str, dense: bool) -> None:
    """Say in the legend which colour is which direction."""
    symbol = PARAMETERS[axis].symbol
    texts = rf"up, ${symbol} \rightarrow$", rf"down, ${symbol} \leftarrow$"
    for text, colour in zip(texts, DIRECTION_COLOURS, strict=True):
        panel.plot([], [], "s" if dense else "o", color=colour, markersize=4, label=text)
    if dense:
        panel.plot([], [], "s", color=BOTH_COLOUR, markersize=4, label="both")
