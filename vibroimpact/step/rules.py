"""The impact rules by name.

``plain``, ``reduced-step`` and ``cubic`` are in ``reduced_step.py``, ``exact`` is in ``exact.py``.
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
    source : str
        Its equations.
    """

    code: int
    order: int | None
    source: str


IMPACT_RULES: Mapping[str, ImpactRule] = {
    "plain": ImpactRule(PLAIN, 1, "eqs (2)-(5), at the end of the step"),
    "reduced-step": ImpactRule(REDUCED_STEP, 2, "eqs (6)-(10), then the remainder of the step"),
    "cubic": ImpactRule(CUBIC, 4, "root of the cubic Hermite interpolant of the step"),
    "exact": ImpactRule(EXACT, None, "first root of the closed-form flow after the launch"),
}
