"""The erosion profile: integrity measures over a parameter, and basins with discs and knocks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse, Patch

from sweeps.analysis.attractor_table import Row, parameter_axes, rows
from sweeps.analysis.integrity import integrity as measured
from sweeps.analysis.knocks import at_section, knocks
from sweeps.analysis.rig import in_si, rig_of
from sweeps.analysis.selection import Selection, config_of, oscillator_of, select
from sweeps.config.rig import si_name
from sweeps.plotting import canvas
from sweeps.plotting.attractors import basin_cells, class_names, colour_of, mark_attractors
from sweeps.plotting.canvas import PAGE, Page, styled
from sweeps.plotting.labels import CLASSES_TITLE, label_axis, mathtext
from sweeps.plotting.maps import draw_cells

#: The panels of the profile: the measure, the flag that the edge decided it, and the title.
_MEASURES = (
    ("fraction", "", "share of the starts"),
    ("integrity_factor", "factor_at_edge", "integrity factor, a radius"),
    ("local_integrity", "local_at_edge", "local integrity, a distance"),
)


@styled
def integrity(
    dataset: xr.Dataset,
    *,
    at: Selection | None = None,
    page: Page = PAGE,
    ax: Sequence[Axes] | None = None,
) -> Figure:
    """Draw three integrity measures of each attractor over a parameter, and basins at one value.

    The parameter is the swept one with most values; `at` may give its value for the basins. Hollow
    marks are lower bounds, because the edge of the window decided; the other marks set the height
    of the panels. The basins show the largest discs, the attractors at the section, and an arrow
    for each least knock: from the state in which the motion next reaches the section to the state
    in which the knocked motion does. `ax` are four panels, or one panel if only x0 and v0 were
    swept. The limits of the page apply to the basins.
    """
    along = sorted(parameter_axes(dataset), key=lambda name: -dataset.sizes[name])[:1]
    cuts = {name: value for name, value in (at or {}).items() if name not in along}
    line = select(dataset, cuts, free=[*along, "x0", "v0"])
    found = measured(line)
    starts = select(line, {name: at[name] for name in along if at and name in at}, ["x0", "v0"])
    there = found.sel({name: float(starts[name]) for name in along})
    table: dict[int, list[Row]] = {}
    for row in rows(line, found):
        table.setdefault(row.number, []).append(row)
    if ax is None:
        heights = [0.35, 0.5, 0.5, 1.0] if along else [1.0]
        ax = canvas.stacked_panels(page, heights, shared=len(heights) - 1)
    *profile, panel = ax
    if along:
        axis = in_si(line)[si_name(along[0], rig_of(line))]
        here = float(in_si(starts)[axis.name])
        _draw_profile(profile, in_si(found, line), str(axis.name), table)
        for each in profile:
            each.axvline(here, color="black", linewidth=0.6, linestyle=":")
        label_axis(profile[-1].xaxis, axis)
        panel.set_title(f"basins at ${axis.symbol}={mathtext(here)}$", loc="left")
    drawn = starts.sortby(["x0", "v0"]).transpose("v0", "x0", ...)
    rows_there = rows(starts, there)
    handles = draw_cells(panel, drawn, basin_cells(there, rows_there))
    handles += [
        Patch(color=colour_of(appearances[0]), label=class_names(appearances))
        for number, appearances in table.items()
        if number not in there["number"]
    ]
    handles += _draw_disturbances(panel, starts, there, rows_there)
    page.set_limits(panel)
    title = f"{CLASSES_TITLE},\nspeed before each impact; share of the starts"
    return canvas.finish(panel, page, line, handles, title)


def _draw_profile(
    panels: Sequence[Axes], found: xr.Dataset, axis: str, table: dict[int, list[Row]]
) -> None:
    """Draw the measures of each attractor over the axis, in its colour."""
    for panel, (name, at_edge, title) in zip(panels, _MEASURES, strict=True):
        panel.set_title(title, loc="left")
        highest = 0.0
        for number, appearances in table.items():
            mine = (found["number"] == number) & found["integrity_factor"].notnull()
            y = found[name].where(mine).max("coexisting")
            bound = found[at_edge].where(mine, False).any("coexisting") if at_edge else y.isnull()
            highest = float(y.where(~bound).max().fillna(0.0).clip(min=highest))
            colour = colour_of(appearances[0])
            panel.plot(found[axis], y, "o-", color=colour, markersize=2.5, linewidth=1.0)
            (marks,) = panel.plot(found[axis], y.where(bound), "o", color=colour, markersize=2.5)
            marks.set_markerfacecolor("white")
        panel.set_ylim(0.0, 1.1 * highest or 1.0)


def _draw_disturbances(
    panel: Axes, starts: xr.Dataset, there: xr.Dataset, table: Sequence[Row]
) -> list[Artist]:
    """Draw discs, knocks and the attractors at the section; return their handles."""
    oscillator = oscillator_of(starts)
    line: dict[str, Any] = {"color": "black", "linewidth": 0.8}
    exact = config_of(starts).method.impact == "exact"
    there = knocks(starts, there) if exact else there
    handles: list[Artist] = [
        Line2D([], [], marker="o", fillstyle="none", label="largest disc", **line)
    ]
    measures = there.drop_dims(["x0", "v0"]).to_dataframe().to_dict("records")
    for row, one in zip(table, measures, strict=False):
        if not one["integrity_factor"] > 0.0:
            continue  # no attractor
        size = 2.0 * one["integrity_factor"]
        disc = Ellipse((one["disc_x"], one["disc_v"]), size, size * oscillator.p, fill=False)
        panel.add_patch(disc).set(**line)
        if exact and math.isfinite(one["knock_harmful"]):
            at = one["knock_phase"], one["knock_x"]
            size = one["knock_harmful"]
            begin, end = (at_section(oscillator, *at, one["knock_v"] + dv) for dv in (0.0, size))
            panel.annotate("", end, begin, arrowprops={"arrowstyle": "->", **line})
            text = rf"least knock, {row.name}: ${size:+.4g}$ at $\omega t={at[0]:.4g}$"
            text += ", fractal" if one["knock_fractal"] else ""
            arrow = Line2D([], [], marker=r"$\rightarrow$", linestyle="", label=text, **line)
            handles.append(arrow)
    return handles + mark_attractors(panel, starts, table)
