"""The paper's three cases: without its procedure, with it, and with it taken literally.

The procedure suppresses the penetration, and is of order 2 instead of 1. Taken literally it is of
order 1 where h > 0, because eq. (10) carries the acceleration across the impact, and it stalls in a
chatter. ``vibroimpact.paper`` is the literal procedure, named ``to the letter`` here; ``plain`` and
``reduced-step`` are the rules of the kernel without and with the procedure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

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

#: The three procedures, as functions of oscillator, forcing periods and steps per period.
PROCEDURES: Mapping[str, Callable[[Oscillator, int, int], Trajectory | PaperRun]] = {
    "without": lambda osc, periods, steps: simulate(osc, periods, "newmark", "plain", steps),
    "with": lambda osc, periods, steps: simulate(osc, periods, "newmark", "reduced-step", steps),
    "to the letter": paper_procedure,
}


@dataclass(frozen=True)
class Measured:
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
    return Measured(
        ladder=ladder,
        cases=_cases(ladder, spread),
        chatter=simulate(CHATTER, 1),
        stalls={steps: paper_procedure(CHATTER, 1, steps) for steps in stalling},
    )


def _cases(ladder: Sequence[int], spread: int) -> pd.DataFrame:
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
                "order": _order(ladder[-3:], errors[-3:]),
            }
        rows[case, "exact"] = {"impacts": len(exact.impact_t)}
    return pd.DataFrame.from_dict(rows, orient="index")


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


def _order(steps: Sequence[int], errors: np.ndarray) -> float:
    return float(-np.polyfit(np.log(steps), np.log(errors), 1)[0])


def case_tables(measured: Measured) -> str:
    """Return the results of `measure_cases` as tables."""
    at, end = f"with T = 2 pi/{STEPS_OF_PAPER}", measured.chatter.rests[0, 0]
    names = list(PROCEDURES)
    scene = f"h = {CHATTER.h:g}, R = {CHATTER.R:g}, omega = {CHATTER.omega:g}"
    parts = {
        f"Deepest penetration {at}": _by_case(measured, names, lambda row: f"{row.deepest:.2g}"),
        f"Impacts in {PERIODS} periods {at}": _by_case(
            measured, [*names, "exact"], lambda row: f"{row.impacts}"
        ),
        f"Order, from the times and speeds of the first {FIRST_IMPACTS} impacts": _by_case(
            measured, names, lambda row: f"{row.order:.2f}"
        ),
        f"Where the procedure stalls, to the letter: {scene}": [
            ["steps per period", "stall at t", f"before the rest at t = {end:.5f}"],
            *(
                [
                    f"{steps:,}",
                    "none" if run.stalled_at is None else f"{run.stalled_at:.5f}",
                    f"{end - run.t[-1]:.2g}",
                ]
                for steps, run in measured.stalls.items()
            ),
        ],
    }
    return "\n".join(f"{title}\n\n{table(rows, words=1)}\n" for title, rows in parts.items())


def _by_case(
    measured: Measured, columns: Sequence[str], cell: Callable[[pd.Series], str]
) -> list[list[str]]:
    rows = [[case, *(cell(measured.cases.loc[(case, name)]) for name in columns)] for case in CASES]
    return [["case", *columns], *rows]
