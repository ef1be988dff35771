"""The picture of the paper's cases: without and with its procedure, their orders, and the stall."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from sweeps.bench import paper_cases
from sweeps.plotting.canvas import draw_stop
from sweeps.plotting.labels import mathtext
from sweeps.plotting.style import BLUE, ORANGE, VERMILION
from vibroimpact import simulate

#: Label, colour and marker of the procedures.
_LOOKS = {
    "without": ("without the procedure (plain)", VERMILION, "o"),
    "with": ("with it (reduced-step)", BLUE, "s"),
    "to the letter": ("with it, to the letter", ORANGE, "^"),
    "exact": ("exact", "black", ""),
}
#: The part of the first period that is drawn; it contains all impacts.
_TIMES, _DISPLACEMENTS = (4.3, 6.6), (-0.12, 0.16)


def paper_picture(measured: paper_cases.Measured) -> Figure:
    """Draw a row per case, then the stall."""
    figure = Figure(figsize=(5.4, 8.4), layout="constrained")
    rows = figure.add_gridspec(2, 1, height_ratios=(3.0, 0.9))
    panels = rows[0].subgridspec(3, 2).subplots(squeeze=False)
    for row, name in zip(panels, paper_cases.CASES, strict=True):
        case = measured.cases.loc[name]
        _draw_stop(row[0], name, case)
        _draw_errors(row[1], measured.ladder, case)
    for panel in panels[:2].ravel():
        panel.tick_params(labelbottom=False)
    first = f"of the first {paper_cases.FIRST_IMPACTS} impacts"
    panels[0, 1].set_title(f"error of times and speeds\n{first}")
    panels[2, 0].set_xlabel("time $t$ [time]")
    panels[2, 1].set_xlabel("steps per period")
    _draw_stalls(figure.add_subplot(rows[1]), measured)
    figure.align_ylabels(panels[:, 0])
    handles = [
        Line2D([], [], color=colour, marker=marker, markersize=3.5, label=label)
        for label, colour, marker in _LOOKS.values()
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=2, frameon=False)
    return figure


def _draw_stop(panel: Axes, name: str, case: pd.DataFrame) -> None:
    """Draw the displacement near the stop, in the first period."""
    draw_stop(panel.axhline, 0.0)
    osc = paper_cases.CASES[name]
    fine = simulate(osc, 2, steps_per_period=1000)
    panel.plot(fine.t, fine.x, color="black", linewidth=0.8)
    for key in ("without", "with"):
        _, colour, marker = _LOOKS[key]
        run = paper_cases.PROCEDURES[key](osc, 2, paper_cases.STEPS_OF_PAPER)
        panel.plot(run.t, run.x, color=colour, linewidth=0.9, marker=marker, markersize=2.2)
    panel.set_xlim(_TIMES)
    panel.set_ylim(_DISPLACEMENTS)
    panel.set_ylabel("displacement\n$x$ [length]")
    panel.set_title(f"{name}\n$h = {mathtext(osc.h)}$, $R = {mathtext(osc.R)}$")
    words = (
        f"deepest {case.deepest['without']:.3f}, with it {case.deepest['with']:g}\n"
        f"impacts in {paper_cases.PERIODS} periods: {case.impacts['without']},\n"
        f"with it {case.impacts['with']}, exact {case.impacts['exact']}"
    )
    panel.text(0.98, 0.96, words, transform=panel.transAxes, ha="right", va="top", fontsize=7.5)


def _draw_errors(panel: Axes, ladder: Sequence[int], case: pd.DataFrame) -> None:
    """Draw the error over the steps per period, and write its order."""
    for line, key in enumerate(paper_cases.PROCEDURES):
        _, colour, marker = _LOOKS[key]
        panel.loglog(
            ladder, case.errors[key], color=colour, marker=marker, markersize=3.5, linewidth=1.0
        )
        panel.text(
            0.04, 0.26 - 0.11 * line, f"order {case.order[key]:.1f}", color=colour,
            transform=panel.transAxes,
        )  # fmt: skip
    panel.set_ylim(1e-6, 10.0)


def _draw_stalls(panel: Axes, measured: paper_cases.Measured) -> None:
    """Draw the impact speeds of a chatter over the time left to its end, up to the stall."""
    exact, end = measured.chatter, measured.chatter.rests[0, 0]
    before = exact.impact_t < end
    panel.loglog(end - exact.impact_t[before], exact.impact_v[before], color="black", linewidth=0.8)
    _, colour, marker = _LOOKS["to the letter"]
    for steps, run in measured.stalls.items():
        left = end - run.impact_t
        panel.plot(left, run.impact_v, marker, color=colour, markersize=3.5)
        last = left[-1], run.impact_v[-1]
        panel.plot(*last, "x", color="black", markersize=7, zorder=3)
        words = f"{steps} steps\n$t = {run.stalled_at:.4f}$"
        panel.annotate(words, last, xytext=(8, 0), textcoords="offset points", fontsize=7.5)
    panel.invert_xaxis()
    panel.set_ylim(top=10.0)
    panel.set_xlabel(f"time left until $t = {end:.5f}$ [time]")
    panel.set_ylabel("speed before impact\n[length/time]")
    osc = paper_cases.CHATTER
    panel.set_title(
        "where the procedure stalls\n"
        rf"$h = {mathtext(osc.h)}$, $R = {mathtext(osc.R)}$, $\omega = {mathtext(osc.omega)}$"
    )
