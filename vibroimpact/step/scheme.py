"""`Scheme`: the table `INTEGRATORS`, impact rules, limits of steps; `PhaseGrid`, a period's steps.

A configuration is checked with this file, without the compiler. An integrator has a limit: the
greatest p T of stable free motion as a function of zeta = h / p, the only parameter of free motion.
Its matrix M is stable where |det M| <= 1 and |trace M| <= 1 + det M (Jury).

A method is an integrator with an impact rule:

- ``plain``: eqs (2)-(5) at the end of the step, in ``time_stepping.py``.
- ``reduced-step``: eqs (6)-(9), then the remainder of the step, in ``time_stepping.py``.
- ``cubic``: the root of the cubic Hermite interpolant of the step, in ``time_stepping.py``.
- ``exact``: the first root of the closed-form flow, in ``exact_step.py``.

The steps per period are an integer, so one table of the phases of the force serves every lane.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from vibroimpact.inputs import PHASE, integer, one_of, refusal


def _eigenvalue(zeta: np.ndarray) -> np.ndarray:
    """Return the eigenvalue of free motion of greatest modulus, over p; any of a complex pair."""
    z = zeta + 0j
    return -z - np.sqrt(z - 1.0) * np.sqrt(z + 1.0)


def rk4_limit(zeta: np.ndarray) -> np.ndarray:
    """Solve |P(lambda T)| = 1 along the ray of the eigenvalue lambda by Newton's iteration.

    P(z) = 1 + z + z^2/2 + z^3/6 + z^4/24. On every ray there is one root. It lies between 2.6 and
    3, where |P|^2 is convex: 2 sqrt 2 without damping, 2.7853 from critical damping on.
    """
    eigenvalue = _eigenvalue(zeta)
    modulus = np.abs(eigenvalue)
    ray = eigenvalue / modulus
    r = np.full_like(zeta, 3.0)
    for _ in range(7):
        z = r * ray
        slope = 1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0))
        P = slope + z**4 / 24.0
        r -= 0.5 * (np.abs(P) ** 2 - 1.0) / (P.conj() * slope * ray).real
    return r / modulus


@dataclass(frozen=True)
class Integrator:
    """A one-step integrator."""

    code: int  #: Its number in compiled code: its position in ``INTEGRATORS``.
    order: int | None  #: Order of accuracy on smooth motion; None: exact to rounding.
    function: str  #: The name of its step in ``integrators.py``.
    #: zeta = h / p -> greatest p T of stable free motion, elementwise; inf where every step is
    #: stable, 0 where no step is. At the limit M is marginal, and motion may grow linearly.
    limit: Callable[[np.ndarray], np.ndarray]

    @property
    def step(self) -> Callable:
        """``(x, v, sin theta, cos theta, T, point) -> (x_T, v_T)``, which alone is compiled."""
        step: Callable = getattr(import_module("vibroimpact.step.integrators"), self.function)
        return step


INTEGRATORS: Mapping[str, Integrator] = {
    name: Integrator(code, order, function, limit)
    for code, (name, order, function, limit) in enumerate(
        (
            ("euler", 1, "euler", lambda z: -2.0 * _eigenvalue(z).real / abs(_eigenvalue(z)) ** 2),
            ("semi-implicit-euler", 1, "semi_implicit_euler", lambda z: 2.0 / (z + np.hypot(z, 1))),
            ("verlet", 2, "verlet", lambda zeta: np.full_like(zeta, 2.0)),
            ("newmark", 2, "newmark", lambda zeta: np.full_like(zeta, math.inf)),
            ("rk4", 4, "rk4", rk4_limit),
            ("exact", None, "closed_form", lambda zeta: np.full_like(zeta, math.inf)),
        )
    )
}

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


def one_period(phase: float, steps_per_period: int) -> PhaseGrid:
    """Return the steps of one forcing period from the section's `phase`."""
    from vibroimpact.jit import compiled
    from vibroimpact.step.elementary import fill_waves

    table = np.empty((3, steps_per_period + 1))
    table[THETA] = phase + math.tau * np.arange(steps_per_period + 1) / steps_per_period
    compiled(fill_waves, *table)(*table)
    table[SIN:, -1] = table[SIN:, 0]  # the start of the next period, to the last bit
    return PhaseGrid(table, math.tau / steps_per_period, steps_per_period)


#: Largest (2h + p + omega) T of exact impacts: the first term that ``polynomial.py`` leaves out is
#: below 1.31^22 / 22! = 4e-19 in y, and 22 times that in its slope.
LONGEST_STEP = 1.31
#: Most steps per forcing period. The program never chooses more, and refuses the rule ``exact``
#: where it needs more.
MOST_STEPS = 1_000_000
#: Most forcing periods of a transient, and most periods or impacts that are recorded: a typing
#: error then ends in a message instead of a lack of memory.
MOST_PERIODS, MOST_RECORDED = 1_000_000_000, 1_000_000
#: Steps per forcing period in the paper.
PAPER_STEPS = 100


def least_stable_steps(integrator: str, h: ArrayLike, p: ArrayLike, omega: ArrayLike) -> np.ndarray:
    """Return the least whole steps per forcing period for which a step is stable; inf for none."""
    # The limits are elementary arithmetic, so this compiles nothing.
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
