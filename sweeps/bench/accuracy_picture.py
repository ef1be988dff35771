"""The work-precision diagram: errors over the cost of a forcing period, one line per method."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from sweeps.bench.accuracy_speed import Measurement
from sweeps.bench.scenes import CHATTER, GRAZING, ORBIT_ERRORS, Method
from sweeps.bench.work_precision import MEAN, Line, efficient_frontier, is_drawn, lines, main_scene
from sweeps.plotting.style import BLUE, ORANGE, VERMILION
from vibroimpact.step.integrators import INTEGRATORS

#: Title, scene and kind of error of the panels; the first is the wide one.
PANELS = (
    ("section state, geometric mean of five scenes", MEAN, ORBIT_ERRORS[0]),
    ("impact time, same scenes", MEAN, ORBIT_ERRORS[1]),
    ("penetration, same scenes", MEAN, ORBIT_ERRORS[3]),
    ("section state: chatter and rest", CHATTER.name, ORBIT_ERRORS[0]),
    ("section state: near grazing", GRAZING.name, ORBIT_ERRORS[0]),
)
# Colours of Okabe and Ito. A rule has a colour, an integrator a marker.
_GREEN, _PURPLE, _SKY, _YELLOW = "#009E73", "#CC79A7", "#56B4E9", "#F0E442"
RULES = {"plain": VERMILION, "reduced-step": BLUE, "cubic": _GREEN, "exact": "black"}
MARKERS = dict(zip(INTEGRATORS, "x+^sDov<>PXp", strict=False))
PEER_COLOURS = {"SciPy RK45": ORANGE, "SciPy DOP853": _PURPLE, "heyoka": _SKY}
# The methods whose order is written beside their line.
_LABELLED = (
    Method("exact", "plain"),
    Method("exact", "reduced-step"),
    Method("exact", "cubic"),
    Method("verlet", "cubic"),
    Method("euler", "cubic"),
)
_THIN = {"linewidth": 0.7, "markersize": 3.0, "markerfacecolor": "none", "markeredgewidth": 0.6}
_BAND: dict[str, Any] = {"color": _YELLOW, "linewidth": 6.0, "alpha": 0.6}
_Drawn = Mapping[Method, Sequence[Measurement]]


def picture(measurements: Sequence[Measurement], orders: Mapping[Line, float]) -> Figure:
    """Draw a panel per kind of error, with its lines, their orders and the efficient frontier.

    Of a single scene, as a sweep, there are the first three of ``PANELS``.
    """
    groups, main = lines(measurements), main_scene(measurements)
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
        drawn = {
            method: [m for m in group if is_drawn(m)]
            for (scene_name, error_kind, method), group in groups.items()
            if (scene_name, error_kind) == (scene, kind)
        }
        panel_orders = {method: orders[scene, kind, method] for method in drawn}
        panel.set_title(title)
        panel.set_xlim(_seconds(measurements, peers=panel is wide))
        _draw_panel(panel, drawn, panel_orders)
    for panel in (wide, *small[::2]):
        panel.set_ylabel("relative error")
    for panel in small[:-2]:
        panel.tick_params(labelbottom=False)
    for panel in (wide, *small[-2:]):
        panel.set_xlabel("seconds per forcing period")
    handles, columns = _handles(groups)
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)
    return figure


def _seconds(measurements: Sequence[Measurement], peers: bool) -> tuple[float, float]:
    """Return a range of the abscissa: with the peers, which may be far slower, or without."""
    seconds = [m.seconds for m in measurements if peers or m.steps is not None]
    return 0.7 * min(seconds), 3.0 * max(seconds)


def _draw_panel(panel: Axes, drawn: _Drawn, orders: Mapping[Method, float]) -> None:
    panel.set(xscale="log", yscale="log")
    panel.grid(color="#DDDDDD", linewidth=0.4)
    slowest = panel.get_xlim()[1]
    here = [m for group in drawn.values() for m in group if m.seconds < slowest]
    if here:
        errors = [m.error for m in here]
        panel.set_ylim(0.3 * min(errors), 3.0 * max(errors))
    frontier = efficient_frontier(here)
    panel.plot(*_coordinates(frontier), **_BAND, solid_joinstyle="round", zorder=1.0)
    for method, group in drawn.items():
        panel.plot(*_coordinates(group), **_look(method))
    panel.yaxis.set_major_locator(LogLocator(numticks=6))
    panel.yaxis.set_minor_formatter(NullFormatter())
    _label_orders(panel, drawn, orders)
    _name_missing(panel, drawn)


def _coordinates(group: Sequence[Measurement]) -> tuple[list[float], list[float]]:
    return [m.seconds for m in group], [m.error for m in group]


def _look(method: Method) -> dict[str, Any]:
    name, rule = method
    if rule in RULES:
        return {"color": RULES[rule], "marker": MARKERS[name], **_THIN}
    return {"color": PEER_COLOURS[name], "marker": "*", "linestyle": "--", **_THIN}


def _label_orders(panel: Axes, drawn: _Drawn, orders: Mapping[Method, float]) -> None:
    """Write orders beyond the fine ends of their lines, apart from one another."""
    ends = [
        (drawn[method][-1], f"{orders[method]:.1f}", RULES[method.impact])
        for method in _LABELLED
        if drawn.get(method) and not math.isnan(orders[method])
    ]
    low, high = map(math.log10, panel.get_ylim())
    apart, above = 0.07 * (high - low), math.inf
    for last, text, colour in sorted(ends, key=lambda end: -end[0].error):
        above = min(math.log10(last.error), above - apart)
        panel.annotate(
            text,
            (last.seconds, 10.0**above),
            xytext=(5, 5),
            textcoords="offset points",
            va="center",
            fontsize=7.5,
            color=colour,
        )


def _name_missing(panel: Axes, drawn: _Drawn) -> None:
    """Name the rules without an error to draw, and the peers beyond the right edge."""
    there = {method.impact for method, group in drawn.items() if group}
    for k, rule in enumerate(rule for rule in RULES if rule not in there):
        _note(panel, 0.88 - 0.1 * k, f"{rule}: none", RULES[rule])
    slowest = panel.get_xlim()[1]
    beyond = {
        method.integrator.split()[0]: None
        for method, group in drawn.items()
        if any(m.seconds > slowest for m in group)
    }
    if beyond:
        _note(panel, 0.4, f"{', '.join(beyond)} \N{RIGHTWARDS ARROW}", "#555555")


def _note(panel: Axes, height: float, text: str, colour: str) -> None:
    panel.text(
        0.97, height, text, transform=panel.transAxes, ha="right", fontsize=7.5, color=colour
    )


def _handles(groups: Mapping[Line, object]) -> tuple[list[Line2D], int]:
    """Return the legend, and its columns: of rules, of integrators, and of peers if any."""
    peers = dict.fromkeys(method for _, _, method in groups if method.impact not in RULES)
    columns = [
        [
            _text("impact rule"),
            *(Line2D([], [], color=colour, label=rule) for rule, colour in RULES.items()),
            Line2D([], [], **_BAND, label="efficient frontier"),
        ],
        [
            _text("integrator"),
            *(
                Line2D([], [], **_look(Method(name, "exact")) | {"linestyle": ""}, label=name)
                for name in MARKERS
            ),
        ],
    ]
    if peers:
        looks = [Line2D([], [], **_look(peer), label=peer.integrator) for peer in peers]
        columns.append([_text("solver with events"), *looks])
    length = max(map(len, columns))
    filled = [m for column in columns for m in (*column, *[_text(" ")] * (length - len(column)))]
    return filled, len(columns)


def _text(words: str) -> Line2D:
    """Return an entry of the legend without a line."""
    return Line2D([], [], linestyle="", label=words)
