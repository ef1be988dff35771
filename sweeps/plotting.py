"""Pictures of an opened sweep: bifurcation diagram, Poincaré section, trajectory.

Every function of ``KINDS`` draws onto a ``Figure`` of its own, without pyplot and its global state.
"""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from textwrap import fill
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from sweeps.plotting_marks import (
    BLUE,
    VERMILION,
    draw_density,
    draw_points,
    draw_stop,
    guard,
    mark_status,
    mathtext,
)
from sweeps.selection import PlotError, Setting, listed, on_grid, recorded, select, swept_axes
from sweeps.variables import is_remarkable
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status

__all__ = ["KINDS", "PlotError", "bifurcation", "on_grid", "plot", "section", "trajectory"]

FORMATS = ("png", "svg", "pdf")
DPI = 200

#: What a bifurcation diagram can show over the swept axis.
COORDINATES = ("poincare_x", "poincare_v", "impact_v", "impact_phase")

#: More points than this are drawn as a density: single markers would merge into a blob.
DENSITY_FROM = 2_000_000

STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "axes.linewidth": 0.6,
    "axes.formatter.useoffset": False,
    "agg.path.chunksize": 10000,
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
}


def plot(
    dataset: xr.Dataset,
    output: str | Path,
    kind: str | None = None,
    axis: str | None = None,
    at: Mapping[str, float] | None = None,
    coordinate: str | None = None,
) -> Path:
    """Draw one picture of an opened sweep into a file.

    Parameters
    ----------
    dataset : Dataset
        From `sweeps.store.open_sweep`.
    output : str or Path
        The picture; its ending is one of ``FORMATS``.
    kind : str, optional
        One of ``KINDS``. By default ``bifurcation`` where an axis was swept, otherwise
        ``trajectory`` if there is one, otherwise ``section``.
    axis, coordinate : str, optional
        See `bifurcation`; the other kinds have neither.
    at : mapping of str to float, optional
        Values of the swept axes that are not drawn: the nearest of the grid is taken, and by
        default the first.

    Returns
    -------
    Path
        `output`.

    Raises
    ------
    PlotError
        If the request does not fit the file, or the picture cannot be written.
    """
    output = Path(output)
    data = Path(str(dataset.encoding.get("source", "")))
    if output.exists() and data.is_file() and output.samefile(data):
        raise PlotError(f"the picture {output} would replace the data; give -o another file")
    check_picture(output)
    kind = _default_kind(dataset) if kind is None else kind
    if kind not in KINDS:
        raise PlotError(f"there is no picture {kind!r}; choose one of {listed(KINDS)}")
    options = {"axis": axis, "coordinate": coordinate}
    options = {name: value for name, value in options.items() if value is not None}
    if options and kind != "bifurcation":
        raise PlotError(f"{listed(options)} can be chosen for a bifurcation only, not a {kind}")
    with mpl.rc_context(STYLE):
        save(KINDS[kind](dataset, at=at, **options), output)
    return output


def check_picture(output: Path) -> None:
    """Refuse a path that no picture can be written to.

    Raises
    ------
    PlotError
        If its ending is none of ``FORMATS``, or its folder does not exist.
    """
    if output.suffix.lower().lstrip(".") not in FORMATS:
        raise PlotError(f"{output} must end in one of {listed('.' + f for f in FORMATS)}")
    if not output.parent.is_dir():
        raise PlotError(f"the folder {output.parent} of the picture {output.name} does not exist")


def save(figure: Figure, output: Path) -> None:
    """Write a figure beside `output` and put it there whole.

    Raises
    ------
    PlotError
        If it cannot be written.
    """
    target = output.resolve()
    draft = target.with_name(f".{target.stem}-{os.getpid()}{output.suffix}")
    try:
        with warnings.catch_warnings():
            # The name of a sweep may be in a script that the font lacks: it is drawn as boxes.
            warnings.filterwarnings("ignore", "Glyph", UserWarning)
            figure.savefig(draft, dpi=DPI)
        os.replace(draft, target)
    except OSError as error:
        raise PlotError(f"{output} cannot be written: {error.strerror or error}") from error
    finally:
        draft.unlink(missing_ok=True)


def bifurcation(
    dataset: xr.Dataset,
    *,
    axis: str | None = None,
    at: Mapping[str, float] | None = None,
    coordinate: str | None = None,
) -> Figure:
    """Draw a coordinate of the section or of the impacts over one swept axis.

    Points that failed or were not computed yet are marked below the diagram, not drawn.

    Parameters
    ----------
    axis : str, optional
        The swept axis, by default the longest.
    coordinate : str, optional
        One of ``COORDINATES``, by default the first that the file has.

    Raises
    ------
    PlotError
        If the file has no such axis or coordinate, or nothing to draw.
    """
    axes = swept_axes(dataset)
    if not axes:
        raise PlotError("the file holds a single point: a bifurcation needs a swept axis")
    if axis is None:
        axis = max(axes, key=lambda name: dataset.sizes[name])
    if axis not in axes:
        raise PlotError(f"{axis or repr(axis)} is not a swept axis; the file has {listed(axes)}")
    held = [name for name in COORDINATES if name in dataset]
    if coordinate is None:
        coordinate = next(iter(held), COORDINATES[0])
    if coordinate not in held:
        asked = coordinate or repr(coordinate)
        raise PlotError(f"the file has no {asked} to draw; it has {listed(held) or 'none'}")
    line = select(dataset[[coordinate, "status"]], at, free=axis)
    values, status = line[axis].values, line["status"].values
    good = np.isin(status, [one for one in Status if not one.failed])
    y = line[coordinate].values[good]
    x = np.broadcast_to(values[good, None], y.shape)[np.isfinite(y)]
    y = y[np.isfinite(y)]
    if not len(y):
        raise PlotError(f"there is nothing to draw: no point has a {coordinate}")
    figure = Figure(figsize=(7.0, 3.8), layout="constrained")
    panel = figure.add_subplot()
    if _log_spaced(values):
        panel.set_xscale("log")
        panel.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        panel.xaxis.set_major_formatter("{x:g}")
        panel.xaxis.set_minor_formatter(NullFormatter())
    if len(y) > DENSITY_FROM:
        draw_density(figure, panel, x, y, len(values))
    else:
        draw_points(panel, x, y)
    if len(values) > 100:
        panel.set_xlim(values.min(), values.max())
    panel.set_xlabel(_label(dataset[axis]))
    panel.set_ylabel(_label(dataset[coordinate]))
    guard(panel.set_ylim, y)
    mark_status(figure, panel, values, status)
    _entitle(figure, Setting.of(dataset), line, 100)
    return figure


def section(dataset: xr.Dataset, *, at: Mapping[str, float] | None = None) -> Figure:
    """Draw the Poincaré section at one point: velocity over displacement, and the stop.

    Raises
    ------
    PlotError
        If the file has no section, or nothing was recorded at this point.
    """
    point, (x, v) = recorded(dataset, ("poincare_x", "poincare_v"), at)
    setting = Setting.of(dataset)
    clearance = setting.value("clearance", point)
    figure = Figure(figsize=(4.5, 4.0), layout="constrained")
    panel = figure.add_subplot()
    draw_points(panel, x, v)
    draw_stop(panel.axvline, clearance)
    panel.set_xlabel(_label(dataset["poincare_x"]))
    panel.set_ylabel(_label(dataset["poincare_v"]))
    guard(panel.set_xlim, np.append(x, clearance))
    guard(panel.set_ylim, v)
    _entitle(figure, setting, point, 64)
    figure.legend(loc="outside lower center", frameon=False)
    return figure


def trajectory(dataset: xr.Dataset, *, at: Mapping[str, float] | None = None) -> Figure:
    """Draw the trajectory of one point as the paper does: x over t, v over t, v over x.

    Samples beyond the stop are marked, and the deepest is stated.

    Raises
    ------
    PlotError
        If the file has no trajectory, or nothing was recorded at this point.
    """
    names = ("trajectory_t", "trajectory_x", "trajectory_v")
    point, (t, x, v) = recorded(dataset, names, at)
    setting = Setting.of(dataset)
    clearance = setting.value("clearance", point)
    beyond = x > clearance
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    panels = figure.subplot_mosaic([["x", "phase"], ["v", "phase"]])
    panels["v"].sharex(panels["x"])
    drawn = {"x": (t, x), "v": (t, v), "phase": (x, v)}
    for name, (across, up) in drawn.items():
        panel = panels[name]
        width = 0.9 if len(t) < 5000 else 0.4
        panel.plot(across, up, color=BLUE, linewidth=width, rasterized=len(t) > 50_000)
        if beyond.any():
            (marks,) = panel.plot(across[beyond], up[beyond], "o", color=VERMILION)
            marks.set(markersize=2.5, markeredgewidth=0, zorder=3)
            marks.set_label("_" if across is t else "samples beyond the stop")
    panels["x"].tick_params(labelbottom=False)
    panels["x"].set_ylabel(_label(dataset["trajectory_x"], "\n"))
    panels["v"].set_ylabel(_label(dataset["trajectory_v"], "\n"))
    panels["v"].set_xlabel(_label(dataset["trajectory_t"]))
    panels["phase"].set_xlabel(_label(dataset["trajectory_x"]))
    panels["phase"].set_ylabel(_label(dataset["trajectory_v"]))
    draw_stop(panels["x"].axhline, clearance, label=False)
    draw_stop(panels["phase"].axvline, clearance)
    panels["x"].margins(x=0.01)
    panels["phase"].locator_params(axis="x", nbins=6)
    panels["phase"].set_title(_deepest(x - clearance))
    _entitle(figure, setting, point, 100)
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    return figure


#: The pictures by name.
KINDS: Mapping[str, Callable[..., Figure]] = {
    "bifurcation": bifurcation,
    "section": section,
    "trajectory": trajectory,
}


def _default_kind(dataset: xr.Dataset) -> str:
    if swept_axes(dataset):
        return "bifurcation"
    return "trajectory" if "trajectory_x" in dataset else "section"


def _label(variable: xr.DataArray, gap: str = " ") -> str:
    """Write meaning, symbol and unit."""
    about = variable.attrs
    unit = "" if about["units"] == "1" else f" [{about['units'].replace('^2', '$^2$')}]"
    return f"{about['long_name']}{gap}${about['symbol']}${unit}"


def _log_spaced(values: np.ndarray) -> bool:
    """Whether neighbours have a constant ratio, over a range wide enough for a log axis."""
    if len(values) < 3 or values.min() <= 0.0 or values.max() < 5.0 * values.min():
        return False
    ratios = values[1:] / values[:-1]
    return np.allclose(ratios, ratios[0], rtol=1e-6)


def _deepest(depth: np.ndarray) -> str:
    if depth.max() <= 0.0:
        return "no sample beyond the stop"
    mantissa, exponent = f"{depth.max():.1e}".split("e")
    return f"deepest penetration {mantissa}e{int(exponent)}"


def _entitle(figure: Figure, setting: Setting, drawn: xr.Dataset, width: int) -> None:
    """Put the sweep's name, the parameters of what is drawn, and the method above it."""
    parameters = [
        f"${PARAMETERS[name].symbol} = {mathtext(setting.value(name, drawn))}$"
        for name in PARAMETERS
        if name not in drawn.dims
    ]
    method = setting.method
    words = (
        f"integrator {method['integrator']}, impact rule {method['impact']}, "
        f"{method['steps_per_period']} steps per period"
    )
    if not drawn["status"].dims:
        status = Status(int(drawn["status"]))
        words += f"\n{fill(status.meaning, width)}" if is_remarkable(status) else ""
    name = fill(setting.name, width).replace("$", r"\$")
    figure.suptitle(f"{name}\n{_joined(parameters, width)}\n{words}", fontsize=8.5)


def _joined(formulas: list[str], width: int) -> str:
    """Join formulas into lines of about `width` letters as printed."""
    lines: list[list[str]] = [[]]
    used = 0
    for formula in formulas:
        printed = len(re.sub(r"\\\w+|_", "", formula))
        if used + printed > width:
            lines.append([])
            used = 0
        lines[-1].append(formula)
        used += printed
    return "\n".join(", ".join(line) for line in lines)
