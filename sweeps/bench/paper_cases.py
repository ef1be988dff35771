"""The paper's three cases, measured and drawn: without its procedure, with it, to the letter.

The procedure suppresses the penetration, and is of order 2 instead of 1. Taken literally it is of
order 1 where h > 0, because eq. (10) carries the acceleration across the impact, and it stalls in a
chatter. ``vibroimpact.paper`` is the literal procedure, named ``to the letter`` here; ``plain`` and
``reduced-step`` are the rules of the kernel without and with the procedure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from sweeps.plotting.labels import mathtext
from sweeps.plotting.marks import draw_stop
from sweeps.plotting.style import BLUE, ORANGE, VERMILION
from sweeps.text import table
from vibroimpact import Oscillator, PaperRun, Trajectory, paper_procedure, simulate

#: Steps per period in the paper, and the forcing periods over which impacts are counted.
STEPS_OF_PAPER, PERIODS = 100, 20
#: Steps per period of the errors. Each error is the root mean square over ``SPREAD`` numbers of
#: steps from there to 1.6 times as many, since it jumps with the phase of the impact in its step.
LADDER, SPREAD = (25, 50, 100, 200, 400, 800, 1600), 8
#: Number of first impacts from rest whose times and speeds the error covers.
FIRST_IMPACTS = 4

CASES: Mapping[str, Oscillator] = {
    name: Oscillator(h=h, R=R, omega=1.0, f=1.0)
    for name, h, R in (
        ("conservative impacts", 0.5, 1.0),
        ("conservative inter-impact motion", 0.0, 0.5),
        ("fully dissipative", 0.5, 0.5),
    )
}

#: A motion with a complete chatter, which ends at 12.41264; the mass then rests for 8.53. Below,
#: the steps per period with which it is approached.
CHATTER = Oscillator(h=0.0, R=0.3, omega=0.3, f=1.0)
STALLING = (100, 1000, 10_000)


def _stepped(rule: str) -> Callable[[Oscillator, int, int], Trajectory]:
    return lambda oscillator, periods, steps: simulate(oscillator, periods, "newmark", rule, steps)


#: The three procedures, as functions of oscillator, forcing periods and steps per period.
PROCEDURES: Mapping[str, Callable[[Oscillator, int, int], Trajectory | PaperRun]] = {
    "without": _stepped("plain"),
    "with": _stepped("reduced-step"),
    "to the letter": paper_procedure,
}


class Measured(NamedTuple):
    """All measurements."""

    ladder: Sequence[int]  # steps per period of the errors
    #: By case and procedure: ``deepest``, the deepest penetration, and ``impacts``, the
    #: number of impacts in ``PERIODS`` forcing periods, both at the paper's step; ``errors``,
    #: inf if an impact is missing; and their ``order``, fitted to the three smallest steps.
    #: Also the ``impacts`` of the ``exact`` motion.
    cases: pd.DataFrame
    chatter: Trajectory  # the exact motion of ``CHATTER`` over its first period
    stalls: dict[int, PaperRun]  # the literal procedure, by steps per period


def measure_cases(
    ladder: Sequence[int] = LADDER, spread: int = SPREAD, stalling: Sequence[int] = STALLING
) -> Measured:
    """Measure all cases: errors over a `ladder` of three or more steps, stalls over `stalling`."""
    rows: dict[tuple[str, str], dict[str, Any]] = {}
    for case, oscillator in CASES.items():
        exact = simulate(oscillator, PERIODS)
        for name, run in PROCEDURES.items():
            motion = run(oscillator, PERIODS, STEPS_OF_PAPER)
            errors = _errors(name, oscillator, ladder, spread, exact)
            rows[case, name] = {
                "deepest": motion.max_penetration,
                "impacts": len(motion.impact_t),
                "errors": errors,
                "order": -np.polyfit(np.log(ladder[-3:]), np.log(errors[-3:]), 1)[0],
            }
        rows[case, "exact"] = {"impacts": len(exact.impact_t)}
    stalls = {steps: paper_procedure(CHATTER, 1, steps) for steps in stalling}
    return Measured(
        ladder, pd.DataFrame.from_dict(rows, orient="index"), simulate(CHATTER, 1), stalls
    )


def _errors(
    name: str, oscillator: Oscillator, ladder: Sequence[int], spread: int, exact: Trajectory
) -> np.ndarray:
    """Return the error of the first impacts for every number of steps."""
    true = np.stack([exact.impact_t[:FIRST_IMPACTS], exact.impact_v[:FIRST_IMPACTS]])
    errors = []
    for least in ladder:
        squares = []
        for steps in np.unique(np.rint(least * np.linspace(1.0, 1.6, spread)).astype(int)):
            run = PROCEDURES[name](oscillator, 3, int(steps))
            impacts = np.stack([run.impact_t[:FIRST_IMPACTS], run.impact_v[:FIRST_IMPACTS]])
            squares.append((impacts - true) ** 2 if impacts.shape == true.shape else np.inf)
        errors.append(np.sqrt(np.mean([np.mean(square) for square in squares])))
    return np.array(errors)


def case_tables(measured: Measured) -> str:
    """Return the results of `measure_cases` as tables."""
    at, end = f"with T = 2 pi/{STEPS_OF_PAPER}", measured.chatter.rests[0, 0]
    order = f"Order, from the times and speeds of the first {FIRST_IMPACTS} impacts"
    texts = {}
    for title, column, digits, names in (
        (f"Deepest penetration {at}", "deepest", ".2g", PROCEDURES),
        (f"Impacts in {PERIODS} periods {at}", "impacts", "d", (*PROCEDURES, "exact")),
        (order, "order", ".2f", PROCEDURES),
    ):
        values = measured.cases[column]
        rows = ([case, *(f"{values[case, name]:{digits}}" for name in names)] for case in CASES)
        texts[title] = [["case", *names], *rows]
    scene = f"h = {CHATTER.h:g}, R = {CHATTER.R:g}, omega = {CHATTER.omega:g}"
    stalls = [["steps per period", "stall at t", f"before the rest at t = {end:.5f}"]]
    for steps, run in measured.stalls.items():
        stall = "none" if run.stalled_at is None else f"{run.stalled_at:.5f}"
        stalls.append([f"{steps:,}", stall, f"{end - run.t[-1]:.2g}"])
    texts[f"Where the procedure stalls, to the letter: {scene}"] = stalls
    return "\n".join(f"{title}\n\n{table(rows, words=1)}\n" for title, rows in texts.items())


_LOOKS: Mapping[str, dict[str, Any]] = {
    "without": {"label": "without the procedure (plain)", "color": VERMILION, "marker": "o"},
    "with": {"label": "with it (reduced-step)", "color": BLUE, "marker": "s"},
    "to the letter": {"label": "with it, to the letter", "color": ORANGE, "marker": "^"},
    "exact": {"label": "exact", "color": "black"},
}
#: The part of the first period that is drawn; it contains all impacts.
_TIMES, _DISPLACEMENTS = (4.3, 6.6), (-0.12, 0.16)


def paper_picture(measured: Measured) -> Figure:
    """Draw a row per case, then the stall."""
    figure = Figure(figsize=(5.4, 8.4), layout="constrained")
    rows = figure.add_gridspec(2, 1, height_ratios=(3.0, 0.9))
    panels = rows[0].subgridspec(3, 2).subplots(squeeze=False)
    for (left, right), name in zip(panels, CASES, strict=True):
        case = measured.cases.loc[name]
        _draw_motions(left, name, case)
        for line, key in enumerate(PROCEDURES):
            look = _LOOKS[key]
            right.loglog(measured.ladder, case.errors[key], linewidth=1.0, markersize=3.5, **look)
            point, words = (0.04, 0.26 - 0.11 * line), f"order {case.order[key]:.1f}"
            right.text(*point, words, color=look["color"], transform=right.transAxes)
        right.set_ylim(1e-6, 10.0)
    for panel in panels[:2].ravel():
        panel.tick_params(labelbottom=False)
    panels[0, 1].set_title(f"error of times and speeds\nof the first {FIRST_IMPACTS} impacts")
    panels[2, 0].set_xlabel("time $t$ [time]")
    panels[2, 1].set_xlabel("steps per period")
    _draw_stalls(figure.add_subplot(rows[1]), measured)
    figure.align_ylabels(panels[:, 0])
    handles = [Line2D([], [], markersize=3.5, **look) for look in _LOOKS.values()]
    figure.legend(handles=handles, loc="outside upper center", ncols=2, frameon=False)
    return figure


def _draw_motions(panel: Axes, name: str, case: pd.DataFrame) -> None:
    """Draw the displacement near the stop, in the first period."""
    draw_stop(panel.axhline, 0.0)
    osc = CASES[name]
    fine = simulate(osc, 2, steps_per_period=1000)
    panel.plot(fine.t, fine.x, color="black", linewidth=0.8)
    for key in ("without", "with"):
        run = PROCEDURES[key](osc, 2, STEPS_OF_PAPER)
        panel.plot(run.t, run.x, linewidth=0.9, markersize=2.2, **_LOOKS[key])
    panel.set(
        xlim=_TIMES,
        ylim=_DISPLACEMENTS,
        ylabel="displacement\n$x$ [length]",
        title=f"{name}\n$h = {mathtext(osc.h)}$, $R = {mathtext(osc.R)}$",
    )
    words = (
        f"deepest {case.deepest['without']:.3f}, with it {case.deepest['with']:g}\n"
        f"impacts in {PERIODS} periods: {case.impacts['without']},\n"
        f"with it {case.impacts['with']}, exact {case.impacts['exact']}"
    )
    panel.text(0.98, 0.96, words, transform=panel.transAxes, ha="right", va="top", fontsize="small")


def _draw_stalls(panel: Axes, measured: Measured) -> None:
    """Draw the impact speeds of a chatter over the time left to its end, up to the stall."""
    exact, end = measured.chatter, measured.chatter.rests[0, 0]
    before = exact.impact_t < end
    panel.loglog(end - exact.impact_t[before], exact.impact_v[before], color="black", linewidth=0.8)
    look = _LOOKS["to the letter"] | {"linestyle": "", "markersize": 3.5}
    for steps, run in measured.stalls.items():
        remaining = end - run.impact_t
        panel.plot(remaining, run.impact_v, **look)
        last = remaining[-1], run.impact_v[-1]
        panel.plot(*last, "x", color="black", markersize=7, zorder=3)
        words = f"{steps} steps\n$t = {run.stalled_at:.4f}$"
        panel.annotate(words, last, xytext=(8, 0), textcoords="offset points", fontsize="small")
    panel.invert_xaxis()
    osc = CHATTER
    values = rf"$h = {mathtext(osc.h)}$, $R = {mathtext(osc.R)}$, $\omega = {mathtext(osc.omega)}$"
    panel.set(
        xlabel=f"time left until $t = {end:.5f}$ [time]",
        ylabel="speed before impact\n[length/time]",
        title=f"where the procedure stalls\n{values}",
    )
    panel.set_ylim(top=10.0)
