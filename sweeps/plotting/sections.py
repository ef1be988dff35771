"""Sections of motions: the stroboscopic section and the impacts, of one point or of several."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from sweeps.opened.coordinates import recorded
from sweeps.opened.opened_sweep import OpenedSweep, Selection
from sweeps.plotting import canvas
from sweeps.plotting.colours import Paint, coloured_points
from sweeps.plotting.contents import Wanted
from sweeps.plotting.directions import colours_directions, in_both
from sweeps.plotting.labels import as_variable, label_axis, record_text
from sweeps.plotting.looks import Cells
from sweeps.plotting.page import PAGE, Page, styled
from sweeps.plotting.style import BOTH_COLOUR, Look, visible
from sweeps.store import DIRECTION


class _Records(NamedTuple):
    """Values recorded at one point, or at several points with a colour each, as flat columns."""

    points: OpenedSweep
    columns: Sequence[np.ndarray]
    colours: np.ndarray | None = None
    shown: Paint | None = None
    by_point: Sequence[np.ndarray] = ()  # the columns in the shape of ``status`` and a record
    common: Sequence[Artist] = ()  # for the legend: values that both directions have

    @classmethod
    def of(
        cls,
        sweep: OpenedSweep,
        names: tuple[str, str],
        at: Selection | None,
        color: Wanted | None,
        grey: bool,
    ) -> Self:
        """Read the values of one point or, with a colour, of all points that `at` leaves."""
        if color is None:
            return cls(*recorded(sweep, names, at))
        points, shown = coloured_points(sweep, at, color, grey)
        dims = points.grid
        columns = np.array([points[name].transpose(*dims, ...) for name in names])
        seen = np.isfinite(columns).all(axis=0)
        colours = np.broadcast_to(shown.colours()[..., None, :], (*seen.shape, 4)).copy()
        flat, common = columns[:, seen], list[Artist]()
        if DIRECTION in dims and colours_directions(sweep, color):
            both = in_both(columns, dims.index(DIRECTION))
            look = Look.plain(visible(BOTH_COLOUR))
            colours[both] = to_rgba(look.colour)
            columns[:, both & grey] = np.nan  # without the marker of a direction
            common = [Cells("both", look, both).handle()] * bool(both.any())
        return cls(points, list(flat), colours[seen], shown, list(columns), common)

    def finish(self, panel: Axes, page: Page, coordinate: str) -> Figure:
        """Draw the legend or the colour bar of the colours, if any, and return the figure."""
        handles, title = panel.get_legend_handles_labels()[0], None
        if self.shown is not None:
            self.shown.mark(panel, *self.by_point)
            self.shown.add_bar([panel])
            handles, title = [*self.shown.handles(), *self.common, *handles], self.shown.title
        record = record_text(self.points, coordinate)
        return canvas.finish(panel, page, self.points, handles, title, record)


@styled
def section(
    sweep: OpenedSweep,
    *,
    at: Selection | None = None,
    color: Wanted | None = None,
    page: Page = PAGE,
    ax: Axes | None = None,
) -> Figure:
    """Draw the Poincaré section: velocity over displacement, and the stop.

    It is that of one point or, with `color`, those of all points that `at` does not exclude.

    Parameters
    ----------
    color : str or DataArray, optional
        What colours the sections of several points, as for `sweeps.plotting.bifurcation`.

    Examples
    --------
    >>> import sweeps
    >>> omega = {"start": 2.6, "stop": 2.7, "num": 20}
    >>> scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": omega, "f": 1.0}}
    >>> ds = sweeps.open_sweep(sweeps.run_sweep(scene, "flip.h5", overwrite=True))
    >>> from sweeps import plotting
    >>> plotting.section(ds, at={"omega": 2.7}).savefig("section.png")
    """
    found = _Records.of(sweep, ("poincare_x", "poincare_v"), at, color, page.grey)
    (x, v), clearance = found.columns, found.points["clearance"]
    panel = canvas.new_panel(ax, page)
    canvas.draw_points(panel, x, v, found.colours)
    label_axis(panel.xaxis, found.points["poincare_x"])
    label_axis(panel.yaxis, found.points["poincare_v"])
    ends = [x.min(), x.max()]
    if not clearance.dims:
        stop = as_variable("clearance", sweep.config.nomenclature)
        canvas.draw_stop(panel.axvline, float(clearance), stop)
        ends.append(float(clearance))
    canvas.widen_if_constant(panel.set_xlim, min(ends), max(ends))
    canvas.widen_if_constant(panel.set_ylim, v.min(), v.max())
    page.fit_ordinate(panel)
    page.set_limits(panel)
    return found.finish(panel, page, "poincare_x")


@styled
def impacts(
    sweep: OpenedSweep,
    *,
    at: Selection | None = None,
    color: Wanted | None = None,
    page: Page = PAGE,
    ax: Axes | None = None,
) -> Figure:
    """Draw the impact section: speed before the impact over the forcing phase.

    It is that of one point or, with `color`, those of all points that `at` does not exclude.
    The title says how many impacts of the record were not kept.

    Parameters
    ----------
    color : str or DataArray, optional
        What colours the impacts of several points, as for `sweeps.plotting.bifurcation`.

    Examples
    --------
    >>> import sweeps
    >>> omega = {"start": 2.6, "stop": 2.7, "num": 20}
    >>> scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": omega, "f": 1.0}}
    >>> ds = sweeps.open_sweep(sweeps.run_sweep(scene, "flip.h5", overwrite=True))
    >>> from sweeps import plotting
    >>> plotting.impacts(ds, at={"omega": 2.7}).savefig("impacts.png")
    """
    found = _Records.of(sweep, ("impact_phase", "impact_v"), at, color, page.grey)
    panel = canvas.new_panel(ax, page)
    phase, v = found.columns
    canvas.draw_points(panel, phase, v, found.colours)
    quarters = ["0", r"$\pi/2$", r"$\pi$", r"$3\pi/2$", r"$2\pi$"]
    panel.set_xticks(0.5 * np.pi * np.arange(5), quarters)
    panel.set_xlim(0.0, 2.0 * np.pi)
    panel.set_ylim(bottom=0.0)
    label_axis(panel.xaxis, found.points["impact_phase"])
    label_axis(panel.yaxis, found.points["impact_v"])
    page.set_limits(panel)
    return found.finish(panel, page, "impact_v")
