"""The comparison of methods, shown: means, orders, tables, the work-precision diagram.

The diagram shows the error over the cost, a line for each scene, kind of error and method.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import zip_longest
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter
from scipy.stats import gmean

from sweeps.bench.accuracy import (
    CHATTER_SCENE,
    EVENTS,
    EXACT_METHOD,
    GRAZING,
    MEASURED_COLUMNS,
    ORBIT_ERRORS,
    PENETRATION,
    REGULAR,
    STATE,
    Method,
)
from sweeps.plotting.style import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, YELLOW
from sweeps.text import table
from vibroimpact.step.integrators import INTEGRATORS

#: The columns that identify a method, and a line of the chart.
METHOD, LINE = MEASURED_COLUMNS[2:4], MEASURED_COLUMNS[:4]
#: Name of the scene that stands for the mean of all regular scenes.
MEAN = "regular scenes"
#: An error above this has no right digit.
NO_DIGIT = 1.0

# An order is fitted to the finest steps whose errors are small but far above the reference's error.
_FITTED, _LARGEST, _ABOVE_FLOOR = 5, 0.1, 10.0

#: The steps per period, and for peers the tolerance, at which errors are shown.
COMPARED_STEPS, SOLVER_TOLERANCE = 100, 1e-9
#: The errors for which the cheapest method is named.
TARGETS = (1e-2, 1e-4, 1e-8, 1e-12)


def means(measured: pd.DataFrame) -> pd.DataFrame:
    """Return geometric means over the regular scenes, of the methods that failed in none."""
    regular = measured[measured["scene"].isin([scene.name for scene in REGULAR])]
    same = [*LINE[1:], "steps_per_period", "tolerance"]
    groups = regular.groupby(same, sort=False, dropna=False)
    mean = groups[["error", "seconds_per_period"]].agg(gmean)
    sizes = groups.size()
    return mean[sizes == sizes.max()].reset_index().assign(scene=MEAN)[list(measured)]


def main_scene(measured: pd.DataFrame) -> str:
    """Return the scene to show first: the mean of the regular scenes, or else the first scene."""
    return MEAN if (measured["scene"] == MEAN).any() else str(measured["scene"].iloc[0])


def measured_order(steps: Sequence[int], errors: Sequence[float], floor: float = 0.0) -> float:
    """Return minus the slope of log error over log steps, by least squares, from coarse to fine.

    Only errors ten times above `floor`, the error of the reference, are fitted; NaN if fewer than
    three are left.
    """
    e = np.array(errors)
    good = np.flatnonzero((e > _ABOVE_FLOOR * floor) & (e < _LARGEST) & (e > 0.0))[-_FITTED:]
    if len(good) < 3:
        return math.nan
    return -float(np.polyfit(np.log(np.array(steps, float)[good]), np.log(e[good]), 1)[0])


def with_orders(measured: pd.DataFrame) -> pd.DataFrame:
    """Return the measurements line by line, from coarse to fine, and add ``measured_order``."""
    exact = measured[measured["impact"] == EXACT_METHOD.impact]
    floors = exact.groupby(LINE[:2])["error"].max()
    lines = []
    for line, group in measured.groupby(LINE, sort=False):
        group = group.sort_values(["steps_per_period", "tolerance"], ascending=[True, False])
        order = math.nan
        if line[3] not in (EXACT_METHOD.impact, EVENTS):
            steps, errors = group["steps_per_period"].tolist(), group["error"].tolist()
            order = measured_order(steps, errors, floors.get(line[:2], 0.0))
        lines.append(group.assign(measured_order=order))
    return pd.concat(lines, ignore_index=True)


def efficient_frontier(measured: pd.DataFrame) -> pd.DataFrame:
    """Return the measurements with the least error at the same or lower cost, cheapest first."""
    by_cost = measured.dropna(subset="error").sort_values(["seconds_per_period", "error"])
    least = by_cost["error"].clip(upper=NO_DIGIT).cummin().shift(fill_value=NO_DIGIT)
    return by_cost[by_cost["error"] < least]


def of_methods(measured: pd.DataFrame) -> str:
    """Return a table of the orders, the errors and the cost of every method, from `with_orders`."""
    main, columns = main_scene(measured), {"order": main_scene(measured)}
    if main == MEAN:
        columns = {"regular": MEAN, "chatter": CHATTER_SCENE.name, "graze": GRAZING.name}
    taken = measured["steps_per_period"]
    exact = taken[(measured["impact"] == EXACT_METHOD.impact) & (taken >= COMPARED_STEPS)]
    steps = COMPARED_STEPS if exact.empty else exact.min()
    orders = measured[measured["error_kind"] == STATE].groupby(["scene", *METHOD])
    order = orders["measured_order"].first()
    compared = (taken == steps) | (measured["tolerance"] == SOLVER_TOLERANCE)
    rows = [(*METHOD, *columns, "error", "penetration", "ns/period")]
    compared = measured[compared & (measured["scene"] == main)]
    for method, group in compared.groupby(METHOD, sort=False):
        errors = group.set_index("error_kind")["error"]
        values = (order.get((scene, *method), math.nan) for scene in columns.values())
        shown_orders = ("" if math.isnan(value) else f"{value:.1f}" for value in values)
        deepest = _error(errors[PENETRATION]) if PENETRATION in errors else ""
        rows.append((*method, *shown_orders, _error(errors[STATE]), deepest, _cost(group)))
    of = f"(solvers: tolerance {SOLVER_TOLERANCE:g}), geometric mean of the regular scenes"
    return (
        f"Measured orders of the section state; errors and cost with {steps} steps per period\n"
        f"{of if main == MEAN else f'of the {main}'}\n\n"
        f"{table(rows, words=2)}\n\n"
        "No order: fewer than three errors below 0.1 and above rounding.\n"
        "Steps beyond a limit of stability are run, too; impacts may limit the growth.\n"
    )


def of_targets(measured: pd.DataFrame) -> str:
    """Return a table of the cheapest method for each of ``TARGETS``."""
    rows = [("error", *METHOD, "steps", "ns/period")]
    states = (measured["scene"] == main_scene(measured)) & (measured["error_kind"] == STATE)
    for target in TARGETS:
        fastest = measured[states & (measured["error"] <= target)]
        best = fastest.nsmallest(1, "seconds_per_period")
        if best.empty:
            rows.append((f"{target:g}", "none", "", "", ""))
        for *method, steps, tolerance in best[MEASURED_COLUMNS[2:6]].itertuples(index=False):
            taken = f"tolerance {tolerance:g}" if pd.isna(steps) else str(steps)
            rows.append((f"{target:g}", *method, taken, _cost(best)))
    title = "The cheapest way to an error of the section state (as above)"
    return f"{title}\n\n{table(rows, words=4)}\n"


def _cost(measured: pd.DataFrame) -> str:
    return f"{measured['seconds_per_period'].iloc[0] * 1e9:,.0f}"


def _error(value: float) -> str:
    if not math.isfinite(value):
        return "failed"
    if value == 0.0:
        return "0"
    return f"{value:.1e}" if value < NO_DIGIT else "> 1"


#: Title, scene and kind of error of each panel; the first panel is the wide one.
PANELS = (
    ("section state, geometric mean of five scenes", MEAN, ORBIT_ERRORS[0]),
    ("impact time, same scenes", MEAN, ORBIT_ERRORS[1]),
    ("penetration, same scenes", MEAN, ORBIT_ERRORS[3]),
    ("section state: chatter and rest", CHATTER_SCENE.name, ORBIT_ERRORS[0]),
    ("section state: near grazing", GRAZING.name, ORBIT_ERRORS[0]),
)
# Each rule has a colour, each integrator a marker.
RULES = {"plain": VERMILION, "reduced-step": BLUE, "cubic": GREEN, "exact": "black"}
MARKER_OF_INTEGRATOR = dict(zip(INTEGRATORS, "x+^sDov<>PXp", strict=False))
PEER_COLOURS = {"SciPy RK45": ORANGE, "SciPy DOP853": PURPLE, "heyoka": SKY}
# The methods whose order is written next to their line.
_LABELLED = (
    *(Method("exact", rule) for rule in ("plain", "reduced-step", "cubic")),
    Method("verlet", "cubic"),
    Method("euler", "cubic"),
)
_BAND: dict[str, Any] = {"color": YELLOW, "linewidth": 6.0, "alpha": 0.6}


def accuracy_picture(measured: pd.DataFrame) -> Figure:
    """Draw a panel per kind of error, with its lines, their orders and the efficient frontier."""
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
    good = measured["error"].between(0.0, NO_DIGIT, inclusive="neither")
    for panel, (title, scene, kind) in zip([wide, *small], panels, strict=True):
        # Peers may be far slower.
        ours = measured if panel is wide else measured[measured["steps_per_period"].notna()]
        seconds = ours["seconds_per_period"]
        panel.set(title=title, xscale="log", xlim=(0.7 * seconds.min(), 3.0 * seconds.max()))
        line = (measured["scene"] == scene) & (measured["error_kind"] == kind)
        _draw_panel(panel, measured[line & good])
    for panel in (wide, *small[::2]):
        panel.set_ylabel("relative error")
    for panel in small[:-2]:
        panel.tick_params(labelbottom=False)
    for panel in (wide, *small[-2:]):
        panel.set_xlabel("seconds per forcing period")
    columns = list(zip(*zip_longest(*_legend(measured), fillvalue=_entry(" ")), strict=True))
    figure.legend(
        handles=[entry for column in columns for entry in column],
        loc="outside lower center",
        ncols=len(columns),
        frameon=False,
    )
    return figure


def _draw_panel(panel: Axes, lines: pd.DataFrame) -> None:
    """Draw the errors that have a right digit and a place on a logarithmic chart."""
    panel.set_yscale("log")
    panel.grid(color="#DDDDDD", linewidth=0.4)
    here = lines[lines["seconds_per_period"] < panel.get_xlim()[1]]
    if not here.empty:
        panel.set_ylim(0.3 * here["error"].min(), 3.0 * here["error"].max())
    coordinates = ["seconds_per_period", "error"]
    frontier = efficient_frontier(here)[coordinates].to_numpy()
    panel.plot(*frontier.T, **_BAND, solid_joinstyle="round", zorder=1.0)
    for method, group in lines.groupby(METHOD, sort=False):
        panel.plot(*group[coordinates].to_numpy().T, **_look(*method))
    panel.yaxis.set_major_locator(LogLocator(numticks=6))
    panel.yaxis.set_minor_formatter(NullFormatter())
    _label_orders(panel, lines)
    _name_missing(panel, lines)


def _look(integrator: str, rule: str) -> dict[str, Any]:
    look: dict[str, Any] = {"color": PEER_COLOURS.get(integrator), "marker": "*", "linestyle": "--"}
    if rule in RULES:
        look = {"color": RULES[rule], "marker": MARKER_OF_INTEGRATOR[integrator]}
    small = {"linewidth": 0.7, "markersize": 3.0, "markerfacecolor": "none", "markeredgewidth": 0.6}
    return look | small


def _label_orders(panel: Axes, lines: pd.DataFrame) -> None:
    """Write orders at the fine ends of their lines, clear of one another and of points."""
    finest = lines.groupby(METHOD, sort=False).tail(1).dropna(subset="measured_order")
    points = [end for end in finest.itertuples() if (end.integrator, end.impact) in _LABELLED]
    ours = lines[lines["impact"].isin(list(RULES))]
    low, high = map(math.log10, panel.get_ylim())
    height = panel.bbox.height * 72.0 / panel.figure.dpi  # [pt]
    apart, above = 9.0 / height * (high - low), math.inf
    for last in sorted(points, key=lambda end: -end.error):
        above = min(math.log10(last.error), above - apart)
        same_height = (np.log10(ours["error"]) - above).abs() < 0.7 * apart
        beside = ours["seconds_per_period"][same_height].max()
        panel.annotate(
            f"{last.measured_order:.1f}",
            (max(last.seconds_per_period, beside), 10.0**above),
            xytext=(5, 0),
            textcoords="offset points",
            va="center",
            fontsize="small",
            color=RULES[last.impact],
        )


def _name_missing(panel: Axes, lines: pd.DataFrame) -> None:
    """Name the rules without an error to draw, and the peers beyond the right edge."""
    rules = [rule for rule in RULES if rule not in set(lines["impact"])]
    notes = [(0.88 - 0.1 * k, f"{rule}: none", RULES[rule]) for k, rule in enumerate(rules)]
    slower = lines[lines["seconds_per_period"] > panel.get_xlim()[1]]
    beyond = ", ".join(slower["integrator"].str.split().str[0].unique())
    if beyond:
        notes.append((0.4, f"{beyond} \N{RIGHTWARDS ARROW}", "#555555"))
    look: dict[str, Any] = {"transform": panel.transAxes, "ha": "right", "fontsize": "small"}
    for height, words, colour in notes:
        panel.text(0.97, height, words, color=colour, **look)


def _legend(measured: pd.DataFrame) -> list[list[Line2D]]:
    """Return the columns of the legend, with one for any peers."""
    columns = [
        [
            _entry("impact rule"),
            *(Line2D([], [], color=colour, label=rule) for rule, colour in RULES.items()),
            Line2D([], [], **_BAND, label="efficient frontier"),
        ],
        [
            _entry("integrator"),
            *(_entry(name, **_look(name, "exact")) for name in MARKER_OF_INTEGRATOR),
        ],
    ]
    methods = measured[METHOD].drop_duplicates().itertuples(index=False)
    peers = [
        Line2D([], [], **_look(*method), label=method.integrator)
        for method in methods
        if method.impact not in RULES
    ]
    return [*columns, [_entry("solver with events"), *peers]] if peers else columns


def _entry(words: str, **look: Any) -> Line2D:
    """Return an entry of the legend without a line."""
    return Line2D([], [], **look | {"linestyle": ""}, label=words)
