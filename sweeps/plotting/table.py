"""The picture of a sweep over a table: a result over columns or other results."""

from __future__ import annotations

import math
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from sweeps.analysis.rig import in_si, rig_of
from sweeps.analysis.selection import Selection, listed, select
from sweeps.config.rig import si_name
from sweeps.errors import Refused
from sweeps.grid import TABLE
from sweeps.plotting import canvas
from sweeps.plotting.canvas import PAGE, Page, styled
from sweeps.plotting.labels import CLASSES_TITLE, label, label_axis
from sweeps.plotting.lines import scalars
from sweeps.plotting.maps import period_cells, status_cells
from sweeps.store import columns_of
from sweeps.text import nearest, suggestion

#: Least width of a panel, for its labels [inch].
_NARROWEST = 2.3


@styled
def table_panels(
    dataset: xr.Dataset,
    *,
    axes: Sequence[str] = (),
    at: Selection | None = None,
    quantity: str | None = None,
    page: Page = PAGE,
    ax: Axes | None = None,
) -> Figure:
    """Draw a result over the columns of a table, a panel for each, coloured by class.

    Parameters
    ----------
    axes : sequence of str, optional
        Abscissas: columns of numbers or results, by default the columns that vary; with `ax`, only
        one.
    quantity : str, optional
        The ordinate: a result or a column of numbers, by default the first result.
    """
    if TABLE not in dataset["status"].dims:
        raise Refused("the points of this file are a grid, and not the rows of a table")
    select(dataset, at, free=[TABLE])  # refuses a value of TABLE
    columns = [name for name, values in columns_of(dataset).items() if values.dtype.kind in "iuf"]
    varying = [name for name in columns if np.ptp(dataset[name].values) > 0.0] or columns[:1]
    valid = [*columns, *scalars(dataset)]
    abscissas = [*axes] or varying[: None if ax is None else 1]
    ordinate = quantity or scalars(dataset)[0]
    for name in (*abscissas, ordinate):
        if name not in valid:
            meant = suggestion(nearest(name, valid))
            raise Refused(
                f"there is no numeric column or result {name}{meant}; choose from: {listed(valid)}"
            )
    width = page.width or mpl.rcParams["figure.figsize"][0]
    across = min(math.ceil(math.sqrt(len(abscissas))), max(1, int(width / _NARROWEST)))
    down = math.ceil(len(abscissas) / across)
    if ax is None:
        grid = canvas.Picture(page, 0.75 * down).subplots(down, across, sharey=True, squeeze=False)
        panels = grid.ravel()
    else:
        panels = np.array([ax])
    cells = period_cells(dataset) if "period" in dataset else status_cells(dataset)
    cells = [cell for cell in cells if cell.where.any()]
    dataset = in_si(dataset)
    status = dataset["status"].values
    colours = np.select([cell.where for cell in cells], [cell.colour for cell in cells], "none")
    size = float(np.clip(4e3 / math.sqrt(status.size) / across, 0.3, 4.0))
    rig = rig_of(dataset)
    for panel, name in zip(panels, abscissas, strict=False):
        x, y = (_numbers(dataset, si_name(of, rig)) for of in (name, ordinate))
        panel.scatter(x, y, size, colours, linewidths=0, rasterized=True)
        canvas.mark_status(panel, x.values, status)
        label_axis(panel.xaxis, x)
        panel.locator_params(axis="x", nbins=5 - across)
    if ax is None:  # the panels share the ordinate, whose label may not fit beside one of them
        panels[0].set_title(label(y), loc="left", wrap=True)
    else:
        label_axis(ax.yaxis, y)
    for unused in panels[len(abscissas) :]:
        unused.remove()
    page.set_limits(panels[0])
    handles = [Patch(facecolor=cell.colour, label=cell.label) for cell in cells]
    handles += panels[0].get_legend_handles_labels()[0]
    title = CLASSES_TITLE if "period" in dataset else None
    return canvas.finish(panels[0], page, dataset, handles, title)


def _numbers(dataset: xr.Dataset, name: str) -> xr.DataArray:
    """Return a column or a result; of the Lyapunov exponents, the larger one."""
    return dataset[name].isel(exponent=0) if "exponent" in dataset[name].dims else dataset[name]
