"""How orbits are stepped: the impact rules by name, the grid of steps, and the scheme of a run.

A method is an integrator with an impact rule:

- ``plain``: eqs (2)-(5) at the end of the step, in ``time_stepping.py``.
- ``reduced-step``: eqs (6)-(9), then the remainder of the step, in ``time_stepping.py``.
- ``cubic``: the root of the cubic Hermite interpolant of the step, in ``time_stepping.py``.
- ``exact``: the first root of the closed-form flow, in ``exact_step.py``.

The steps per period are an integer, so one table of the phases of the force serves every lane.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from vibroimpact.inputs import PHASE, integer, one_of, refusal
from vibroimpact.jit import compiled, jit
from vibroimpact.step.elementary import sin_cos
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.polynomial import LONGEST_STEP

# The codes of the impact rules in compiled code.
PLAIN, REDUCED_STEP, CUBIC, EXACT = range(4)


@dataclass(frozen=True)
class ImpactRule:
    """An impact rule."""

    code: int  # in compiled code
    #: Order of accuracy through impacts, with an integrator of at least that order; None if exact
    #: to rounding.
    order: int | None


IMPACT_RULES: Mapping[str, ImpactRule] = {
    "plain": ImpactRule(PLAIN, 1),
    "reduced-step": ImpactRule(REDUCED_STEP, 2),
    "cubic": ImpactRule(CUBIC, 4),
    "exact": ImpactRule(EXACT, None),
}

# Rows of ``PhaseGrid.table``.
THETA, SIN, COS = range(3)


class PhaseGrid(NamedTuple):
    """A run of equal steps, given by the phases of the force."""

    #: theta = omega t, its sine and its cosine, at the start of each step and at the end of the
    #: last one, shape (3, size + 1).
    table: np.ndarray
    phase_step: float  # omega T
    size: int  # number of steps


@jit
def _fill_waves(table):
    """Fill the rows of sines and cosines of a table."""
    for n in range(table.shape[1]):
        table[SIN, n], table[COS, n] = sin_cos(table[THETA, n])


def one_period(phase: float, steps_per_period: int) -> PhaseGrid:
    """Return the steps of one forcing period from the section's `phase`."""
    table = np.empty((3, steps_per_period + 1))
    table[THETA] = phase + math.tau * np.arange(steps_per_period + 1) / steps_per_period
    compiled(_fill_waves, table)(table)
    table[SIN:, -1] = table[SIN:, 0]  # the start of the next period, to the last bit
    return PhaseGrid(table, math.tau / steps_per_period, steps_per_period)


#: Most steps per forcing period. The program never chooses more, and refuses the rule ``exact``
#: where it needs more.
MOST_STEPS = 1_000_000
#: Most forcing periods of a transient, and most periods or impacts that are recorded: a typing
#: error then ends in a message instead of a lack of memory.
MOST_PERIODS, MOST_RECORDED = 1_000_000_000, 1_000_000
#: Steps per forcing period in the paper.
PAPER_STEPS = 100


def least_stable_steps(integrator: str, h: ArrayLike, p: ArrayLike, omega: ArrayLike) -> np.ndarray:
    """Return the least steps per forcing period for which T = 2 pi / (omega steps) is stable.

    The shapes of the parameters must broadcast. Steps are whole numbers; inf if none is stable.
    The closed forms of ``INTEGRATORS`` are elementary arithmetic, so this compiles nothing.
    """
    h, p, omega = (np.asarray(value, float) for value in (h, p, omega))
    with np.errstate(all="ignore"):  # extreme ratios, which need too many steps anyway
        steps = np.floor(2.0 * np.pi * p / (omega * INTEGRATORS[integrator].limit(h / p))) + 1.0
    return np.where(np.isnan(steps), np.inf, steps)


def default_steps(points: np.ndarray, impact: str, integrator: str = "exact") -> int:
    """Return the steps per forcing period to take where none are given.

    For the rule ``exact``, as few as its Taylor series allow; a ValueError if these are more than
    ``MOST_STEPS``. Otherwise 100 as in the paper, or more if the integrator needs more to be stable
    at every point; but 100 where it would need more than ``MOST_STEPS``.
    """
    h, p, omega = points["h"], points["p"], points["omega"]
    if impact != "exact":
        stable = least_stable_steps(integrator, h, p, omega).max(initial=1.0)
        return max(PAPER_STEPS, int(stable)) if stable <= MOST_STEPS else PAPER_STEPS
    with np.errstate(over="ignore"):
        needed = np.ceil(2.0 * np.pi * ((2.0 * h + p) / omega + 1.0) / LONGEST_STEP)
    steps = float(needed.max(initial=1.0))
    if not steps <= MOST_STEPS:
        raise ValueError(
            f"exact impacts would need {steps:.3g} steps per forcing period here, expected: "
            f"at most {MOST_STEPS:,}; omega is too small against p and h"
        )
    return int(steps)


class Scheme(NamedTuple):
    """How orbits are stepped."""

    method: tuple[int, int]  # codes of the impact rule and of the integrator
    grid: PhaseGrid  # the steps of a forcing period

    @classmethod
    def of(cls, integrator: str, impact: str, steps_per_period: int, phase: float) -> Self:
        """Lay out the steps of a method that is known to be valid, from the section's `phase`."""
        codes = IMPACT_RULES[impact].code, INTEGRATORS[integrator].code
        return cls(codes, one_period(phase, steps_per_period))


def scheme_of(
    points: np.ndarray,
    integrator: str,
    impact: str,
    steps_per_period: int | None,
    phase: float = 0.0,
) -> Scheme:
    """Check a method and lay out its steps; arguments as for ``integrate``.

    A ValueError says which name is unknown, which number is out of range, that the impact rule does
    not work with the integrator, or that the rule ``exact`` needs more steps.
    """
    phase = float(PHASE.checked("phase", phase))
    one_of(INTEGRATORS).checked("integrator", integrator)
    one_of(IMPACT_RULES).checked("impact", impact)
    if impact == "exact" and integrator != "exact":
        raise ValueError(f"impact 'exact' needs the integrator 'exact', not {integrator!r}")
    steps = steps_per_period
    if steps is not None:
        steps = integer(1, MOST_STEPS).checked("steps_per_period", steps)
    if steps is None or impact == "exact":
        least = default_steps(points, impact, integrator)
        steps = least if steps is None else steps
        if impact == "exact" and steps < least:
            allowed = integer(least, MOST_STEPS).expected
            raise ValueError(refusal(f"steps_per_period = {steps}", f"{allowed} for exact impacts"))
    return Scheme.of(integrator, impact, steps, phase)
