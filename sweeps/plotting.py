"""Pictures of an opened sweep: bifurcation diagram, Poincaré section, trajectory.

Every function of ``KINDS`` draws onto a ``Figure`` of its own, without pyplot and its global state.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from textwrap import fill
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
import yaml
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status

FORMATS = ("png", "svg", "pdf")
DPI = 200

#: What a bifurcation diagram can show over the swept axis.
COORDINATES = ("poincare_x", "poincare_v", "impact_v", "impact_phase")

#: More points than this are drawn as a density: single markers would merge into a blob.
DENSITY_FROM = 2_000_000

# Okabe and Ito's colours, told apart with every kind of colour vision.
BLUE, VERMILION = "#0072B2", "#D55E00"
STATUS_COLOURS = {
    Status.PENDING: "#CCCCCC",
    Status.UNRESOLVED: "#777777",
    Status.NON_FINITE: "#333333",
}
# Starts well away from white, so that a pixel met once is still seen.
DENSITY_COLOURS = LinearSegmentedColormap.from_list("density", ["#A6CBE3", BLUE, "#00263D"])

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


class PlotError(Exception):
    """A picture cannot be drawn as asked; the text is one paragraph for the user."""


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
    if output.suffix.lower().lstrip(".") not in FORMATS:
        raise PlotError(f"{output} must end in one of {_listed('.' + f for f in FORMATS)}")
    if not output.parent.is_dir():
        raise PlotError(f"the folder {output.parent} of the picture {output.name} does not exist")
    kind = kind or _default_kind(dataset)
    if kind not in KINDS:
        raise PlotError(f"there is no picture {kind!r}; choose one of {_listed(KINDS)}")
    options = {"axis": axis, "coordinate": coordinate}
    options = {name: value for name, value in options.items() if value is not None}
    if options and kind != "bifurcation":
        raise PlotError(f"{_listed(options)} can be chosen for a bifurcation only, not a {kind}")
    with mpl.rc_context(STYLE):
        figure = KINDS[kind](dataset, at=at, **options)
        try:
            figure.savefig(output, dpi=DPI)
        except OSError as error:
            raise PlotError(f"{output} cannot be written: {error}") from error
    return output


def bifurcation(
    dataset: xr.Dataset,
    *,
    axis: str | None = None,
    at: Mapping[str, float] | None = None,
    coordinate: str | None = None,
) -> Figure:
    """Draw a coordinate of the section or of the impacts over one swept axis.

    Points that were not computed to the end are marked below the diagram, not drawn.

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
    axes = _axes(dataset)
    if not axes:
        raise PlotError("the file holds a single point: a bifurcation needs a swept axis")
    axis = axis or max(axes, key=lambda name: dataset.sizes[name])
    if axis not in axes:
        raise PlotError(f"{axis} is not a swept axis; the file has {_listed(axes)}")
    held = [name for name in COORDINATES if name in dataset]
    coordinate = coordinate or next(iter(held), COORDINATES[0])
    if coordinate not in held:
        raise PlotError(f"the file has no {coordinate} to draw; it has {_listed(held) or 'none'}")
    line = _select(dataset[[coordinate, "status"]], at, free=axis)
    values, status = line[axis].values, line["status"].values
    y = line[coordinate].values[status == Status.COMPUTED]
    x = np.broadcast_to(values[status == Status.COMPUTED, None], y.shape)[np.isfinite(y)]
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
        _draw_density(figure, panel, x, y, len(values))
    else:
        _draw_points(panel, x, y)
    if len(values) > 100:
        panel.set_xlim(values.min(), values.max())
    panel.set_xlabel(_label(dataset[axis]))
    panel.set_ylabel(_label(dataset[coordinate]))
    _guard(panel.set_ylim, y)
    _mark_status(figure, panel, values, status)
    _entitle(figure, dataset, line, 100)
    return figure


def section(dataset: xr.Dataset, *, at: Mapping[str, float] | None = None) -> Figure:
    """Draw the Poincaré section at one point: velocity over displacement, and the stop.

    Raises
    ------
    PlotError
        If the file has no section, or nothing was recorded at this point.
    """
    point, (x, v) = _recorded(dataset, ("poincare_x", "poincare_v"), at)
    figure = Figure(figsize=(4.5, 4.0), layout="constrained")
    panel = figure.add_subplot()
    _draw_points(panel, x, v)
    _draw_stop(panel.axvline, dataset, point)
    panel.set_xlabel(_label(dataset["poincare_x"]))
    panel.set_ylabel(_label(dataset["poincare_v"]))
    _guard(panel.set_xlim, np.append(x, _value(dataset, point, "clearance")))
    _guard(panel.set_ylim, v)
    _entitle(figure, dataset, point, 64)
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
    point, (t, x, v) = _recorded(dataset, names, at)
    clearance = _value(dataset, point, "clearance")
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
    _draw_stop(panels["x"].axhline, dataset, point, label=False)
    _draw_stop(panels["phase"].axvline, dataset, point)
    panels["x"].margins(x=0.01)
    panels["phase"].locator_params(axis="x", nbins=6)
    panels["phase"].set_title(_deepest(x - clearance))
    _entitle(figure, dataset, point, 100)
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    return figure


#: The pictures by name.
KINDS: Mapping[str, Callable[..., Figure]] = {
    "bifurcation": bifurcation,
    "section": section,
    "trajectory": trajectory,
}


def _default_kind(dataset: xr.Dataset) -> str:
    if _axes(dataset):
        return "bifurcation"
    return "trajectory" if "trajectory_x" in dataset else "section"


def _axes(dataset: xr.Dataset) -> tuple[str, ...]:
    """Name the swept axes in the order of the file."""
    return tuple(str(name) for name in dataset["status"].dims)


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names)


def _select(
    dataset: xr.Dataset, at: Mapping[str, float] | None, free: str | None = None
) -> xr.Dataset:
    """Fix every swept axis but `free` at the grid value nearest to `at`, or at its first."""
    at = at or {}
    axes = [name for name in _axes(dataset) if name != free]
    for name, value in at.items():
        if name not in axes:
            raise PlotError(f"{name} cannot be fixed here; choose from: {_listed(axes) or 'none'}")
        low, high = float(dataset[name].min()), float(dataset[name].max())
        slack = 1e-9 * max(abs(low), abs(high))  # the user's 0.3 may be the grid's 0.1 * 3
        if not low - slack <= value <= high + slack:
            raise PlotError(f"{name} = {value:g} is outside the sweep: {low:g} to {high:g}")
    index = {name: 0 for name in axes}
    for name, value in at.items():
        index[name] = int(np.argmin(np.abs(dataset[name].values - value)))
    return dataset.isel(index)


def _recorded(
    dataset: xr.Dataset, names: tuple[str, ...], at: Mapping[str, float] | None
) -> tuple[xr.Dataset, list[np.ndarray]]:
    """Read variables at one point, without the padding."""
    missing = [name for name in names if name not in dataset]
    if missing:
        raise PlotError(f"the file has no {_listed(missing)}: record it and run the sweep again")
    point = _select(dataset[[*names, "status"]], at)
    columns = np.array([point[name].values for name in names])
    columns = columns[:, np.isfinite(columns).all(axis=0)]
    if not columns.size:
        outcome = Status(int(point["status"])).meaning
        raise PlotError(f"there is nothing to draw at this point: {outcome}")
    return point, list(columns)


def _value(dataset: xr.Dataset, point: xr.Dataset, name: str) -> float:
    """Return a parameter's value: of the point if it was swept, else of the configuration."""
    if name in _axes(dataset):
        return float(point[name])
    configuration = yaml.safe_load(dataset.attrs["configuration"])
    defaults = {key: parameter.default for key, parameter in PARAMETERS.items()}
    given = {**defaults, **configuration["oscillator"], **(configuration.get("start") or {})}
    return float(given[name])


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


def _draw_points(panel: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """Draw markers, the smaller the more of the panel they would cover."""
    counts, *_ = np.histogram2d(x, y, bins=(600, 300))
    size = float(np.clip(70.0 / math.sqrt(np.count_nonzero(counts)), 0.5, 3.5))
    (points,) = panel.plot(x, y, "o", color=BLUE, rasterized=True)
    points.set(markersize=size, markeredgewidth=0, alpha=float(np.clip(1e5 / len(y), 0.15, 1.0)))


def _draw_density(figure: Figure, panel: Axes, x: np.ndarray, y: np.ndarray, columns: int) -> None:
    """Draw the share of each column's points that fall into each of its pixels."""
    space = np.geomspace if panel.get_xscale() == "log" else np.linspace
    edges = space(x.min(), x.max(), min(columns, 700) + 1), np.linspace(y.min(), y.max(), 351)
    counts, *_ = np.histogram2d(x, y, bins=edges)
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    share = np.ma.masked_equal(share, 0.0)
    mesh = panel.pcolormesh(
        *edges, share.T, norm=LogNorm(1e-3, 1.0, clip=True), cmap=DENSITY_COLOURS, rasterized=True
    )
    panel.use_sticky_edges = False  # leave the usual margin around the outermost values
    bar = figure.colorbar(mesh, ax=panel, pad=0.01, aspect=40)
    bar.set_label("share of the points of a column")


def _draw_stop(
    draw: Callable[..., object], dataset: xr.Dataset, point: xr.Dataset, label: bool = True
) -> None:
    clearance = _value(dataset, point, "clearance")
    symbol = PARAMETERS["clearance"].symbol
    text = rf"stop, $x = {symbol} = {clearance:.6g}$" if label else None
    draw(clearance, color="black", linewidth=0.8, linestyle="--", label=text)


def _deepest(depth: np.ndarray) -> str:
    if depth.max() <= 0.0:
        return "no sample beyond the stop"
    mantissa, exponent = f"{depth.max():.1e}".split("e")
    return f"deepest penetration {mantissa}e{int(exponent)}"


def _guard(limit: Callable[..., object], values: np.ndarray) -> None:
    """Keep rounding errors about a constant from being blown up to the panel's size."""
    size = float(np.abs(values).max())
    if np.ptp(values) < 1e-6 * size:
        limit(values.mean() - 0.5 * size, values.mean() + 0.5 * size)


def _mark_status(figure: Figure, panel: Axes, values: np.ndarray, status: np.ndarray) -> None:
    """Mark what was not computed in a strip below the data."""
    found = [s for s in STATUS_COLOURS if (status == s).any()]
    if not found:
        return
    low, high = panel.get_ylim()
    panel.set_ylim(low - 0.04 * (high - low), high)
    strip = panel.get_xaxis_transform()
    for one in found:
        at = values[status == one]
        (marks,) = panel.plot(at, np.full(at.shape, 0.015), "|", transform=strip, rasterized=True)
        marks.set(markersize=6, color=STATUS_COLOURS[one])
        text = f"{one.meaning} ({len(at)} of {len(values)})"
        panel.plot([], [], linewidth=5, color=STATUS_COLOURS[one], label=text)
    figure.legend(loc="outside lower center", ncols=1, frameon=False)


def _entitle(figure: Figure, dataset: xr.Dataset, drawn: xr.Dataset, width: int) -> None:
    """Put the sweep's name, the parameters of what is drawn, and the method above it."""
    parameters = [
        f"${PARAMETERS[name].symbol} = {_value(dataset, drawn, name):.6g}$"
        for name in PARAMETERS
        if name not in drawn.dims
    ]
    configuration = yaml.safe_load(dataset.attrs["configuration"])
    method = configuration["method"]
    words = (
        f"integrator {method['integrator']}, impact rule {method['impact']}, "
        f"{method['steps_per_period']} steps per period"
    )
    if "status" in drawn and not drawn["status"].dims and int(drawn["status"]) != Status.COMPUTED:
        words += f"\n{fill(Status(int(drawn['status'])).meaning, width)}"
    name = fill(str(dataset.attrs["name"]), width).replace("$", r"\$")
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
