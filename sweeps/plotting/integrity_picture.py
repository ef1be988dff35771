"""Draws measures of integrity over a parameter; basins with discs, knocks."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from matplotlib.patheffects import withStroke

from sweeps.attractor.attractor_table import AttractorRow, attractor_rows
from sweeps.attractor.integrity import refuse_unfit, with_measures
from sweeps.attractor.knocks import knocks
from sweeps.config.groups import STARTS
from sweeps.errors import Refused
from sweeps.opened.opened_sweep import OpenedSweep, Selection
from sweeps.opened.result_cache import with_cache
from sweeps.plotting import canvas, labels
from sweeps.plotting.attractor_pictures import Basins, attractors_in
from sweeps.plotting.contents import refuse_without_result
from sweeps.plotting.looks import Looks, names_of
from sweeps.plotting.maps import entries_of, view_of
from sweeps.plotting.page import PAGE, Page, styled
from sweeps.plotting.style import Look, ground, ink
from sweeps.text import shown_count
from vibroimpact import Oscillator, simulate
from vibroimpact.trajectory import exact_samples

#: The panels of the profile: for each measure the flag that the edge decided it, and the title.
_MEASURES = {
    "fraction": ("", "share of the starts"),
    "integrity_factor": ("factor_at_edge", "integrity factor, a radius"),
    "local_integrity": ("local_at_edge", "local integrity, a distance"),
}
#: The panel of the basins, and the heights of all.
BASINS = "basins"
_HEIGHTS = {"fraction": 0.35, "integrity_factor": 0.5, "local_integrity": 0.5, BASINS: 1.0}
#: Marker of a lower bound unless each attractor has one.
_BOUND_MARKER = "^"


@functools.partial(styled, panels=range(1, 5))
def integrity(
    sweep: OpenedSweep,
    *,
    at: Selection | None = None,
    panels: Sequence[str] = (),
    page: Page = PAGE,
    ax: Axes | Sequence[Axes] | None = None,
) -> Figure:
    """Draw three integrity measures of each attractor over a parameter, and basins at one value.

    The parameter is the swept one with most values; `at` may give its value for the basins. Hollow
    marks are lower bounds, because the edge of the window decided. The basins show the attractors
    at the section, and for those with a colour of their own the largest discs and an arrow for each
    least knock: from the state in which the motion next reaches the section to the state in which
    the knocked motion does. `ax` has as many panels as are drawn: all four by default, or one if
    only x0 and v0 were swept. The limits of the page apply to the basins.

    Parameters
    ----------
    panels : str or sequence of str, optional
        Which panels there are, from top to bottom, out of ``fraction``, ``integrity_factor``,
        ``local_integrity`` and ``basins``; by default all.

    Examples
    --------
    >>> import sweeps
    >>> x0 = {"start": -3, "stop": 0, "num": 12}
    >>> v0 = {"start": -2, "stop": 2, "num": 12}
    >>> starts = {"x0": x0, "v0": v0}
    >>> oscillator = {"h": 0.0, "R": 0.8, "omega": [1.3, 1.35], "f": 1.0}
    >>> scene = {"oscillator": oscillator, "start": starts}
    >>> ds = sweeps.open_sweep(sweeps.run_sweep(scene, "two_basins.h5", overwrite=True))
    >>> sweeps.plotting.integrity(ds).savefig("integrity.png")
    """
    others = [name for name in sweep.axes if name not in STARTS]
    along = sorted(others, key=lambda name: -sweep.sizes[name])[:1]
    cuts = {name: value for name, value in (at or {}).items() if name not in along}
    line = sweep.cut(cuts, free=[*along, "x0", "v0"])
    refuse_unfit(line)
    refuse_without_result(line["status"].values)
    names = canvas.chosen_panels(panels, [*(_MEASURES if along else ()), BASINS])
    by_name = dict(zip(names, _panels_for(names, page, ax), strict=True))
    basins, profile = by_name.get(BASINS), {n: by_name[n] for n in names if n != BASINS}
    line_result, looks = attractors_in(line, sweep, page.grey)
    line_result = with_measures(line, line_result)
    starts = line.cut({name: at[name] for name in along if at and name in at}, ["x0", "v0"])
    point_result = line_result.sel({name: float(starts[name]) for name in along})
    regions = Basins.of(starts, point_result, looks, "x0", "v0")
    handles = list[Artist]()
    if basins is not None:
        regions.draw(basins, page)
        # The lines of a profile have the colours of all basins, and the shares of all starts.
        view = ... if profile else view_of(basins, regions.starts)
        handles += entries_of(regions.starts, regions.cells(), view)
    if profile:
        if line_result["integrity_factor"].isnull().all():
            raise Refused("there is nothing to draw: no start reaches an attractor")
        table, ordered = attractor_rows(line, line_result), line_result.sortby(along)
        _draw_profile(profile, ordered, along[0], table, looks)
        labels.label_axis([*profile.values()][-1].xaxis, line[along[0]])
        if basins is None:
            page.set_limits(by_name[names[0]])
        handles += _handles_of_profile(profile.values(), table, looks, line, along[0])
    if basins is not None:
        if along:
            handles += _mark_value(profile.values(), basins, line[along[0]], starts)
        handles += _draw_disturbances(basins, starts, point_result, regions)
    panel = by_name[names[0]] if basins is None else basins
    title = labels.CLASSES_TITLE if basins is None else labels.basins_title(line)
    figure = canvas.finish(panel, page, line, handles, title)
    if basins is not None:
        regions.write_names(basins, page)
    return figure


def _panels_for(
    names: Sequence[str], page: Page, ax: Axes | Sequence[Axes] | None
) -> Sequence[Axes]:
    """Return the panels to draw into, or refuse an `ax` with another number of them."""
    if ax is None:
        profile = [i for i, name in enumerate(names) if name != BASINS]
        return canvas.stacked_panels(page, [_HEIGHTS[name] for name in names], profile)
    panels = [ax] if isinstance(ax, Axes) else [*ax]
    if len(panels) != len(names):
        raise Refused(f"ax has {shown_count(len(panels), 'panel')}; expected: {len(names)}")
    return panels


def _mark_value(
    profile: Iterable[Axes], basins: Axes, axis: xr.DataArray, starts: OpenedSweep
) -> list[Artist]:
    """Mark the value of the axis at which the basins are; return a handle if there is a mark."""
    here = float(starts[str(axis.name)])
    text = f"basins at {labels.equation(axis.symbol, axis, here)}"
    basins.set_title(text, loc="left")
    props: dict[str, Any] = {"color": ink(), "linewidth": 0.6, "linestyle": ":"}
    lines = [panel.axvline(here, **props) for panel in profile]
    return [Line2D([], [], label=text, **props)] if lines else []


def _handles_of_profile(
    panels: Iterable[Axes],
    table: Sequence[AttractorRow],
    looks: Looks,
    line: OpenedSweep,
    axis: str,
) -> list[Artist]:
    """Return the entries of the legend for the lines of the profile, and for lower bounds."""
    lines = [each for panel in panels for each in panel.lines if canvas.is_in_view(each)]
    visible = {(each.get_color(), looks.grey and each.get_marker()) for each in lines}
    handles, series = list[Artist](), looks.by_look(table)
    for rows, names in zip(series, names_of(series, line, line[axis]), strict=True):
        look = looks.look(rows[0])
        if (look.dots, looks.grey and look.marker) in visible:
            text = "".join(names) if looks.has_own(rows[0]) else "other periodic attractors"
            dashes: dict[str, Any] = {"linestyle": look.dash, "linewidth": 1.0}
            handles.append(Line2D([], [], label=text, **dashes, **_marker_of(look, looks.grey)))
    if any(each.get_markerfacecolor() == ground() for each in lines):
        text, marker = ("hollow: ", "o") if looks.grey else ("", _BOUND_MARKER)
        shape: dict[str, Any] = {"marker": marker, "ls": "", "markersize": 4.0, "mfc": ground()}
        handles.append(Line2D([], [], color=ink(), label=f"{text}lower bound", **shape))
    return handles


def _marker_of(look: Look, grey: bool) -> dict[str, Any]:
    """Return the settings of matplotlib for the marks of a line; in grey, they have a shape."""
    return {"color": look.dots, "marker": look.marker, "markersize": 3.0 if grey else 2.5}


def _draw_profile(
    panels: Mapping[str, Axes],
    line_result: xr.Dataset,
    axis: str,
    table: Sequence[AttractorRow],
    looks: Looks,
) -> None:
    """Draw the measures of attractors."""
    for name, panel in panels.items():
        at_edge, title = _MEASURES[name]
        panel.set_title(title, loc="left", wrap=True)
        if labels.named_unit(line_result[name]):
            labels.label_axis(panel.yaxis, line_result[name].assign_attrs(long_name="", symbol=""))
        is_bound = line_result[at_edge] if at_edge else line_result[name].isnull()
        values = line_result[name].where(line_result["integrity_factor"].notnull())
        for number in {row.number: None for row in table}:
            of_attractor = line_result["number"] == number
            y = values.where(of_attractor).max("coexisting").values
            bound = (of_attractor & is_bound & values.notnull()).any("coexisting").values
            rows = [row for row in table if row.number == number]
            _draw_lines(panel, line_result[axis].values, y, bound, rows, axis, looks)
        labels.set_lim(panel.yaxis, 0.0, 1.1 * float(values.max().fillna(0.0)) or 1.0)


def _draw_lines(
    panel: Axes,
    x: np.ndarray,
    y: np.ndarray,
    bound: np.ndarray,
    rows: Sequence[AttractorRow],
    axis: str,
    looks: Looks,
) -> None:
    """Draw a measure of one attractor over the axis, a line for each of its looks."""
    for series in looks.by_look(rows):
        of_series = np.isin(x, [row.parameters[axis] for row in series])
        to_next = of_series | np.append(False, of_series[:-1])
        look = looks.look(series[0])
        markers = _marker_of(look, looks.grey)
        line: dict[str, Any] = {"linewidth": 1.0, "linestyle": look.dash, "color": look.dots}
        panel.plot(x, np.where(to_next, y, np.nan), **line)
        panel.plot(x, np.where(of_series & ~bound, y, np.nan), linestyle="", **markers)
        markers |= {"marker": look.marker if looks.grey else _BOUND_MARKER}
        markers |= {"markersize": 4.0, "markerfacecolor": ground()}
        panel.plot(x, np.where(of_series & bound, y, np.nan), linestyle="", **markers)


def _draw_disturbances(
    panel: Axes, starts: OpenedSweep, result: xr.Dataset, regions: Basins
) -> list[Artist]:
    """Draw discs, knocks and the attractors at the section; return their handles."""
    looks, is_exact = regions.looks, starts.spec.impact == "exact"
    props: dict[str, Any] = {"color": ink(), "linewidth": 0.8}
    props["path_effects"] = [withStroke(linewidth=2.0, foreground=ground())]  # on a dark basin
    rows, others = looks.split(regions.table)
    names = names_of([[row] for row in rows], starts)
    locations = {
        row.number: location.replace("\n", " ")
        for row, (_, location) in zip(rows, names, strict=True)
    }
    if is_exact:
        result = with_cache(knocks)(starts, result, list(locations))
    handles, discs = list[Artist](), list[Ellipse]()
    for row in attractor_rows(starts, result):
        measures = row.measures
        if row.number not in locations or not measures["integrity_factor"] > 0.0:
            continue  # no attractor, or none with a colour of its own
        centre, size = (measures["disc_x"], measures["disc_v"]), 2.0 * measures["integrity_factor"]
        discs.append(Ellipse(centre, size, size * starts.oscillator.p, fill=False))
        panel.add_patch(discs[-1]).set(**props)
        if is_exact and math.isfinite(measures["knock_harmful"]):
            number = len(handles) + 1 if looks.grey else None
            colour = looks.look(row).dots
            handles.append(_draw_knock(panel, starts, row, locations[row.number], colour, number))
    if any(panel.bbox.overlaps(disc.get_window_extent()) for disc in discs):
        disc_handle = Line2D([], [], marker="o", fillstyle="none", label="largest disc", **props)
        handles.insert(0, disc_handle)
    if others:
        text = f"no disc and no knock for {shown_count(len(others), 'other attractor')}"
        handles.append(Line2D([], [], linestyle="", label=text))
    return handles + regions.mark_attractors(panel)


def _draw_knock(
    panel: Axes,
    starts: OpenedSweep,
    row: AttractorRow,
    location: str,
    colour: str,
    number: int | None,
) -> Line2D:
    """Draw the least knock of an attractor as an arrow, in grey with a number; return a handle."""
    phase, x, v, size = (row.measures[f"knock_{name}"] for name in ("phase", "x", "v", "harmful"))
    begin, end = (
        _at_section(starts.oscillator, phase, x, v + dv, starts.spec.phase) for dv in (0.0, size)
    )
    colour, edge = (colour, ink()) if number is None else (ink(), ground())
    props: dict[str, Any] = {"color": colour, "linewidth": 1.2}
    around = [withStroke(linewidth=2.4, foreground=edge)]
    arrow = {"arrowstyle": "->", "path_effects": around, **props}
    panel.annotate("", end, begin, size="small", arrowprops=arrow)
    if number is not None:  # which arrow it is, beside the mark where it begins
        middle = float(np.mean(panel.get_xlim()))
        beside = 8.0 * np.sign(middle - begin[0]), 8.0 * np.sign(begin[1] - end[1])
        circle = {"boxstyle": "circle,pad=0.15", "fc": edge, "ec": colour, "lw": 0.6}
        digit = panel.annotate(str(number), begin, beside, textcoords="offset points")
        digit.set(size="x-small", ha="center", va="center", bbox=circle)
    unit = labels.named_unit(labels.as_variable("v0", starts))
    change, turned = labels.mathtext(size, "+.4g"), labels.mathtext(phase, ".4g")
    text = f"least knock, {row.name}{location}:" + ("\n" if location else " ")
    text += rf"${change}${unit and f' {unit}'} at $\omega t={turned}$"
    text += ", fractal" if row.measures["knock_fractal"] else ""
    # matplotlib draws no arrow to a state beyond the limits.
    text += "" if panel.viewLim.contains(*end) else ", beyond the limits"
    marker = r"$\rightarrow$" if number is None else f"${number}$"
    return Line2D([], [], marker=marker, linestyle="", label=text, **props)


def _at_section(
    oscillator: Oscillator, phase: float, x: float, v: float, section: float
) -> tuple[float, float]:
    """Return the state of a motion from a phase when it next passes the section, to 1e-4."""
    phase %= math.tau
    motion = simulate(oscillator, 1, x0=x, v0=v, phase=phase)
    t, x_t, v_t = exact_samples(oscillator, motion.t, motion.x, motion.v)
    at = (section if section > phase else section + math.tau) / oscillator.omega
    return float(np.interp(at, t, x_t)), float(np.interp(at, t, v_t))
