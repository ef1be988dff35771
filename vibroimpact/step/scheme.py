"""How orbits are stepped: the impact rules by name, the common grid of steps, and their scheme.

A method is an integrator with an impact rule:

- ``plain``: eqs (2)-(5) at the end of the step, in ``time_stepping.py``.
- ``reduced-step``: eqs (6)-(9), then the remainder of the step, in ``time_stepping.py``.
- ``cubic``: the root of the cubic Hermite interpolant of the step, in ``time_stepping.py``.
- ``exact``: the first root of the closed-form flow, in ``exact.py``.

The steps per period are an integer, so that one table of the force's phases serves every lane.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import jit
from vibroimpact.oscillator import one_of, whole
from vibroimpact.step.exact import steps_needed
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.stability import least_stable_steps

# The codes of the rules in compiled code.
PLAIN, REDUCED_STEP, CUBIC, EXACT = range(4)


@dataclass(frozen=True)
class ImpactRule:
    """An impact rule: its number in compiled code, and its order of accuracy through impacts.

    The order holds with an integrator of at least that order; None is exact to rounding.
    """

    code: int
    order: int | None


IMPACT_RULES: Mapping[str, ImpactRule] = {
    "plain": ImpactRule(PLAIN, 1),
    "reduced-step": ImpactRule(REDUCED_STEP, 2),
    "cubic": ImpactRule(CUBIC, 4),
    "exact": ImpactRule(EXACT, None),
}

# Rows of the table.
THETA, SIN, COS = range(3)


class PhaseGrid(NamedTuple):
    """A run of equal steps, as phases of the force.

    ``table`` has the shape (3, size + 1): theta = omega t at the start of each step, and at the end
    of the last one, its sine and its cosine. ``step`` is omega T, ``size`` the number of steps.
    """

    table: np.ndarray
    step: float
    size: int


def _grid(start: float, span: float, count: int) -> PhaseGrid:
    """Return `count` equal steps over a span of phases."""
    theta = start + span * np.arange(count + 1) / max(count, 1)
    table = np.stack([theta, np.sin(theta), np.cos(theta)])
    return PhaseGrid(table, span / max(count, 1), count)


def lead_in(phase: float, steps_per_period: int, at_section: bool = False) -> PhaseGrid:
    """Return the steps from t = 0 to the section's `phase`, none longer than the grid's.

    No steps if the start is `at_section` already.
    """
    if at_section:
        return _grid(phase, 0.0, 0)
    n = phase / (2.0 * math.pi) * steps_per_period
    return _grid(0.0, phase, math.ceil(n * (1.0 - 1e-12)))


def one_period(phase: float, steps_per_period: int) -> PhaseGrid:
    """Return the steps of one forcing period from the section's `phase`."""
    phases = _grid(phase, 2.0 * math.pi, steps_per_period)
    phases.table[SIN:, -1] = phases.table[SIN:, 0]  # where the next period begins
    return phases


@jit
def sine_at_start(lead: PhaseGrid, grid: PhaseGrid) -> float:
    """Return the sine of the phase at which a lead-in and the periods after it begin."""
    first = lead if lead.size > 0 else grid
    return first.table[SIN, 0]


#: More steps per forcing period are not chosen, and the rule ``exact`` is refused if it needs more.
MOST_STEPS = 1_000_000
#: More forcing periods are not left out, and more periods or impacts are not recorded: a slip of
#: the keyboard ends in a message instead of a lack of memory.
MOST_PERIODS, MOST_RECORDED = 1_000_000_000, 1_000_000
#: The steps per forcing period of the paper.
PAPER_STEPS = 100


def default_steps(points: np.ndarray, impact: str, integrator: str = "exact") -> int:
    """Return the steps per forcing period if none are asked for.

    For the rule ``exact``, as few as its Taylor series allow; a ValueError says if these are more
    than ``MOST_STEPS``. Otherwise 100 as in the paper, or more if the integrator needs more to be
    stable at every point, unless that is more than ``MOST_STEPS``.
    """
    h, p, omega = points["h"], points["p"], points["omega"]
    if impact != "exact":
        stable = least_stable_steps(integrator, h, p, omega).max(initial=1.0)
        return max(PAPER_STEPS, int(stable)) if stable <= MOST_STEPS else PAPER_STEPS
    with np.errstate(over="ignore"):
        steps = float(steps_needed(h, p, omega).max(initial=1.0))
    if not steps <= MOST_STEPS:
        raise ValueError(
            f"exact impacts would need {steps:.3g} steps per forcing period here, expected: "
            f"at most {MOST_STEPS}; omega is too small against p and h"
        )
    return int(steps)


class Scheme(NamedTuple):
    """How orbits are stepped.

    ``method`` is the codes of the impact rule and of the integrator, ``lead`` the steps before the
    first section, and ``grid`` those of a forcing period.
    """

    method: tuple[int, int]
    lead: PhaseGrid
    grid: PhaseGrid


def scheme_of(
    points: np.ndarray,
    integrator: str,
    impact: str,
    steps_per_period: int | None,
    phase: float = 0.0,
    at_section: bool = False,
) -> Scheme:
    """Check a method, and lay out its steps; arguments as for ``integrate``.

    A ValueError says which name is unknown or which number is not in its range, that the rule does
    not take the integrator, or that the rule ``exact`` needs more steps.
    """
    first = _phase(phase)
    one_of("integrator", integrator, INTEGRATORS)
    one_of("impact", impact, IMPACT_RULES)
    if impact == "exact" and integrator != "exact":
        raise ValueError(f"impact 'exact' needs the integrator 'exact', not {integrator!r}")
    steps = steps_per_period
    if steps is not None:
        steps = whole("steps_per_period", steps, 1, MOST_STEPS)
    if steps is None or impact == "exact":
        least = default_steps(points, impact, integrator)
        steps = least if steps is None else steps
        if impact == "exact" and steps < least:
            raise ValueError(
                f"steps_per_period must be >= {least} for exact impacts here, not {steps}"
            )
    return Scheme(
        (IMPACT_RULES[impact].code, INTEGRATORS[integrator].code),
        lead_in(first, steps, at_section),
        one_period(first, steps),
    )


def _phase(phase: object) -> float:
    """Return the phase of a section as a float, or refuse it."""
    if not isinstance(phase, bool) and isinstance(phase, Real):
        if phase < 2.0 * math.pi and not phase < 0.0:
            return float(phase)
    raise ValueError(f"phase must be a number from 0 to below 2 pi, not {phase!r}")
