"""The impact rules by name.

- ``plain``: eqs (2)-(5) at the end of the step, in ``reduced_step.py``.
- ``reduced-step``: eqs (6)-(9), then the remainder of the step, in ``reduced_step.py``.
- ``cubic``: the root of the cubic Hermite interpolant of the step, in ``reduced_step.py``.
- ``exact``: the first root of the closed-form flow, in ``exact.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

# The codes of the rules in compiled code.
PLAIN, REDUCED_STEP, CUBIC, EXACT = range(4)


@dataclass(frozen=True)
class ImpactRule:
    """An impact rule.

    Attributes
    ----------
    code : int
        Its number in compiled code.
    order : int or None
        Order of accuracy through impacts, with an integrator of at least that order; None: exact
        to rounding.
    """

    code: int
    order: int | None


IMPACT_RULES: Mapping[str, ImpactRule] = {
    "plain": ImpactRule(PLAIN, 1),
    "reduced-step": ImpactRule(REDUCED_STEP, 2),
    "cubic": ImpactRule(CUBIC, 4),
    "exact": ImpactRule(EXACT, None),
}
