"""The impact rules by name, and the one place that tells them apart.

The rules themselves are in ``reduced_step.py`` (``plain``, ``reduced-step`` and ``cubic``) and
``exact.py`` (``exact``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from vibroimpact.jit import jit
from vibroimpact.status import Status
from vibroimpact.step.reduced_step import CUBIC, REDUCED_STEP, plain, reduced_step

PLAIN, EXACT = 0, 3

_COMPUTED = int(Status.COMPUTED)


@dataclass(frozen=True)
class ImpactRule:
    """An impact rule.

    Attributes
    ----------
    code : int
        Its number in the kernel.
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


@jit(inline=True)
def mend(rule, integrator, start, end, at, step, pt, scratch):
    """Apply an impact rule other than ``exact`` to one step that met the stop.

    Parameters
    ----------
    start : (float, float, bool)
        x, v at the start of the step, and whether the mass is at rest on the stop there.
    end : (float, float)
        x, v at its undisturbed end.
    at : (float, float, float)
        omega t at the start, its sine and its cosine.
    step : float
        omega T.
    scratch : Scratch
        Receives the events.

    Returns
    -------
    x, v : float
        State at the end of the step.
    resting : bool
    n : int
        Number of events.
    rested : float
        Time spent at rest.
    status : int
    """
    T = step / pt.omega
    if rule == PLAIN:
        x, v, n = plain(end[0], end[1], T, pt, scratch)
        return x, v, False, n, 0.0, _COMPUTED
    return reduced_step((rule, integrator), start, end, at, T, pt, scratch)
