"""A method is an integrator with an impact rule: its check, and its steps."""

from __future__ import annotations

import math
from numbers import Real
from typing import NamedTuple

import numpy as np

from vibroimpact.oscillator import whole
from vibroimpact.step.exact import steps_needed
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.phases import Phases, lead_in, one_period
from vibroimpact.step.rules import IMPACT_RULES
from vibroimpact.step.stability import least_stable_steps

#: More steps per forcing period are not chosen, and the rule ``exact`` is refused if it needs more.
MOST_STEPS = 1_000_000
#: More forcing periods are not left out, and more periods or impacts are not recorded: a slip of
#: the keyboard ends in a message instead of a lack of memory.
MOST_PERIODS, MOST_RECORDED = 1_000_000_000, 1_000_000
#: The steps per forcing period of the paper.
PAPER_STEPS = 100


def default_steps(points: np.ndarray, impact: str, integrator: str = "exact") -> int:
    """Return the steps per forcing period if none are asked for.

    For the rule ``exact``, as few as its Taylor series allow. Otherwise 100 as in the paper, or
    more if the integrator needs more to be stable at every point, unless that is more than
    ``MOST_STEPS``.

    Raises
    ------
    ValueError
        If the rule ``exact`` needs more than ``MOST_STEPS``.
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


class Stepping(NamedTuple):
    """How orbits are stepped.

    Attributes
    ----------
    method : (int, int)
        The codes of the impact rule and of the integrator.
    lead, grid : Phases
        The steps before the first section, and those of a forcing period.
    """

    method: tuple[int, int]
    lead: Phases
    grid: Phases


def stepping(
    points: np.ndarray,
    integrator: str,
    impact: str,
    steps_per_period: int | None,
    phase: float = 0.0,
    at_section: bool = False,
) -> Stepping:
    """Check a method, and lay out its steps; arguments as for ``integrate``.

    Raises
    ------
    ValueError
        If a name is unknown, the rule does not take the integrator, `steps_per_period` or `phase`
        is not in its range, or the rule ``exact`` needs more steps than `steps_per_period` or
        ``MOST_STEPS``.
    """
    if isinstance(phase, bool) or not isinstance(phase, Real) or not 0.0 <= phase < 2.0 * math.pi:
        raise ValueError(f"phase must be a number from 0 to below 2 pi, not {phase!r}")
    for name, value, table in (
        ("integrator", integrator, INTEGRATORS),
        ("impact", impact, IMPACT_RULES),
    ):
        if not isinstance(value, str) or value not in table:
            raise ValueError(f"{name} must be one of {', '.join(table)}, not {value!r}")
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
    return Stepping(
        (IMPACT_RULES[impact].code, INTEGRATORS[integrator].code),
        lead_in(float(phase), steps, at_section),
        one_period(float(phase), steps),
    )
