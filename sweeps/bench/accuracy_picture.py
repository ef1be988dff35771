"""The work-precision diagram: error over cost, a line for each method."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from sweeps.bench.accuracy import MEAN, METHOD, NO_DIGIT, efficient_frontier, main_scene
from sweeps.bench.method_scenes import CHATTER_SCENE, GRAZING, ORBIT_ERRORS, Method
from sweeps.plotting.style import BLUE, ORANGE, VERMILION
from vibroimpact.step.integrators import INTEGRATORS

#: Title, scene and kind of error of each panel; the first panel is the wide one.
PANELS = (
    ("section state, geometric mean of five scenes", MEAN, ORBIT_ERRORS[0]),
    ("impact time, same scenes", MEAN, ORBIT_ERRORS[1]),
    ("penetration, same scenes", MEAN, ORBIT_ERRORS[3]),
    ("section state: chatter and rest", CHATTER_SCENE.name, ORBIT_ERRORS[0]),
    ("section state: near grazing", GRAZING.name, ORBIT_ERRORS[0]),
)
# Colours of Okabe and Ito. Each rule has a colour, each integrator a marker.
_GREEN, _PURPLE, _SKY, _YELLOW = "#009E73", "#CC79A7", "#56B4E9", "#F0E442"
RULES = {"plain": VERMILION, "reduced-step": BLUE, "cubic": _GREEN, "exact": "black"}
MARKER_OF_INTEGRATOR = dict(zip(INTEGRATORS, "x+^sDov<>PXp", strict=False))
PEER_COLOURS = {"SciPy RK45": ORANGE, "SciPy DOP853": _PURPLE, "heyoka": _SKY}
# The methods whose order is written next to their line.
_LABELLED = (
    Method("exact", "plain"),
    Method("exact", "reduced-step"),
    Method("exact", "cubic"),
    Method("verlet", "cubic"),
    Method("euler", "cubic"),
)
_SMALL_MARKS = {
    "linewidth": 0.7,
    "markersize": 3.0,
    "markerfacecolor": "none",
    "markeredgewidth": 0.6,
}
_BAND: dict[str, Any] = {"color": _YELLOW, "linewidth": 6.0, "alpha": 0.6}


def accuracy_picture(measured: pd.DataFrame) -> Figure:
    """Draw a panel per kind of error, with its lines, their orders and the efficient frontier.

    `measured` is from `work_precision.with_orders`. For a single scene, such as a sweep, only the
    first three of ``PANELS`` are drawn.
    """
    main = main_scene(measured)
    panels: Sequence[tuple[str, str, str]] = PANELS
    if main != MEAN:
        name = main.replace("$", r"\$")
        words = (f"section state: {name}", "impact time", "penetration")
        panels = [(title, main, kind) for title, (_, _, kind) in zip(words, PANELS, strict=False)]
    rows = len(panels) // 2
    figure = Figure(figsize=(5.6, 3.2 + 2.0 * rows), layout="constrained")
    grid = figure.add_gridspec(1 + rows, 2, height_ratios=(1.25, *[1.0] * rows))
    wide = figure.add_subplot(grid[0, :])
    small = [figure.add_subplot(grid[1 + k // 2, k % 2]) for k in range(2 * rows)]
    for panel, (title, scene, kind) in zip([wide, *small], panels, strict=True):
        good = measured["error"].between(0.0, NO_DIGIT, inclusive="neither")
        line = (measured["scene"] == scene) & (measured["error_kind"] == kind)
        panel.set_title(title)
        panel.set_xlim(_seconds(measured, peers=panel is wide))
        _draw_panel(panel, measured[line & good])
    for panel in (wide, *small[::2]):
        panel.set_ylabel("relative error")
    for panel in small[:-2]:
        panel.tick_params(labelbottom=False)
    for panel in (wide, *small[-2:]):
        panel.set_xlabel("seconds per forcing period")
    handles, columns = _handles(measured)
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)
    return figure


def _seconds(measured: pd.DataFrame, peers: bool) -> tuple[float, float]:
    """Return the range of the abscissa, with or without the peers, which may be far slower."""
    ours = measured if peers else measured[measured["steps_per_period"].notna()]
    return 0.7 * ours["seconds_per_period"].min(), 3.0 * ours["seconds_per_period"].max()


def _draw_panel(panel: Axes, lines: pd.DataFrame) -> None:
    """Draw the errors that have a right digit and a place on a logarithmic chart."""
    panel.set(xscale="log", yscale="log")
    panel.grid(color="#DDDDDD", linewidth=0.4)
    slowest = panel.get_xlim()[1]
    here = lines[lines["seconds_per_period"] < slowest]
    if not here.empty:
        panel.set_ylim(0.3 * here["error"].min(), 3.0 * here["error"].max())
    frontier = efficient_frontier(here)
    panel.plot(*_coordinates(frontier), **_BAND, solid_joinstyle="round", zorder=1.0)
    for method, group in lines.groupby(METHOD, sort=False):
        panel.plot(*_coordinates(group), **_look(Method(*method)))
    panel.yaxis.set_major_locator(LogLocator(numticks=6))
    panel.yaxis.set_minor_formatter(NullFormatter())
    _label_orders(panel, lines)
    _name_missing(panel, lines)


def _coordinates(group: pd.DataFrame) -> tuple[pd.Series, pd.Series]:
    return group["seconds_per_period"], group["error"]


def _look(method: Method) -> dict[str, Any]:
    name, rule = method
    if rule in RULES:
        return {"color": RULES[rule], "marker": MARKER_OF_INTEGRATOR[name], **_SMALL_MARKS}
    return {"color": PEER_COLOURS[name], "marker": "*", "linestyle": "--", **_SMALL_MARKS}


def _label_orders(panel: Axes, lines: pd.DataFrame) -> None:
    """Write orders at the fine ends of their lines, clear of one another and of points."""
    finest = lines.groupby(METHOD, sort=False).tail(1).dropna(subset="measured_order")
    ends = [one for one in finest.itertuples() if (one.integrator, one.impact) in _LABELLED]
    ours = lines[lines["impact"].isin(list(RULES))]
    low, high = map(math.log10, panel.get_ylim())
    height = panel.bbox.height * 72.0 / panel.figure.dpi  # [pt]
    apart, above = 9.0 / height * (high - low), math.inf
    for last in sorted(ends, key=lambda end: -end.error):
        above = min(math.log10(last.error), above - apart)
        same_height = (np.log10(ours["error"]) - above).abs() < 0.7 * apart
        beside = ours["seconds_per_period"][same_height].max()
        panel.annotate(
            f"{last.measured_order:.1f}",
            (max(last.seconds_per_period, beside), 10.0**above),
            xytext=(5, 0),
            textcoords="offset points",
            va="center",
            fontsize=7.5,
            color=RULES[last.impact],
        )


def _name_missing(panel: Axes, lines: pd.DataFrame) -> None:
    """Name the rules without an error to draw, and the peers beyond the right edge."""
    for k, rule in enumerate(rule for rule in RULES if rule not in set(lines["impact"])):
        _note(panel, 0.88 - 0.1 * k, f"{rule}: none", RULES[rule])
    slower = lines[lines["seconds_per_period"] > panel.get_xlim()[1]]
    beyond = slower["integrator"].str.split().str[0].unique()
    if len(beyond):
        _note(panel, 0.4, f"{', '.join(beyond)} \N{RIGHTWARDS ARROW}", "#555555")


def _note(panel: Axes, height: float, text: str, colour: str) -> None:
    panel.text(
        0.97, height, text, transform=panel.transAxes, ha="right", fontsize=7.5, color=colour
    )


def _handles(measured: pd.DataFrame) -> tuple[list[Line2D], int]:
    """Return the entries of the legend, and the number of its columns, with one for any peers."""
    rows = measured[METHOD].drop_duplicates().itertuples(index=False)
    peers = [Method(*row) for row in rows if row.impact not in RULES]
    columns = [
        [
            _entry_without_line("impact rule"),
            *(Line2D([], [], color=colour, label=rule) for rule, colour in RULES.items()),
            Line2D([], [], **_BAND, label="efficient frontier"),
        ],
        [
            _entry_without_line("integrator"),
            *(
                Line2D([], [], **_look(Method(name, "exact")) | {"linestyle": ""}, label=name)
                for name in MARKER_OF_INTEGRATOR
            ),
        ],
    ]
    if peers:
        looks = [Line2D([], [], **_look(peer), label=peer.integrator) for peer in peers]
        columns.append([_entry_without_line("solver with events"), *looks])
    length = max(map(len, columns))
    filled = [
        m
        for column in columns
        for m in (*column, *[_entry_without_line(" ")] * (length - len(column)))
    ]
    return filled, len(columns)


def _entry_without_line(words: str) -> Line2D:
    """Return an entry of the legend without a line."""
    return Line2D([], [], linestyle="", label=words)
