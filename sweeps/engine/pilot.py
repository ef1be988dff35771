"""The cheapest method that reaches an asked accuracy, chosen by a pilot run.

A sample of the sweep's own points is run from the sweep's own start, with the exact engine and
with each candidate, and their sections are compared: ``reference.py`` says how.

The choice has to be the same on every machine, so cost is a model and no stopwatch:
nanoseconds per step and per impact, as ``python -m sweeps.bench.costs`` measures them on the lane
kernel. Only their ratios matter. The impacts are counted in the pilot.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import NamedTuple

import yaml

from sweeps.config.schema import MethodSection
from sweeps.config.sweep import SweepConfig
from sweeps.engine.reference import EXACT, Reference
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.rules import IMPACT_RULES

#: Points of the sample, at the most.
POINTS = 64
#: The asked error is that of every point of the sweep: the sample has to stay this far below it.
MARGIN = 3.0
#: The exact engine certifies what it computes, and the model errs by a tenth: what is to be taken
#: instead has to cost less than this share of its time.
WORTH = 0.9
#: Steps per period that are tried.
STEPS = (
    12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024, 1536, 2048, 3200,
)  # fmt: skip


class Cost(NamedTuple):
    """Time that a method takes, in nanoseconds of one core.

    Attributes
    ----------
    step, recorded_step : float
        Of one point's step, in the transient and in the record.
    impact : float
        Of one impact.
    """

    step: float
    recorded_step: float
    impact: float


#: Integrator and impact rule of every method worth trying, the exact engine last. A step is an
#: affine map and costs the same with each integrator, the exact flow among them: `plain` takes that
#: one, and euler, semi-implicit-euler and verlet have nothing to offer for their bound on the step.
#: At an impact the integrator itself is called, and there the exact flow is dearer than the exact
#: rule.
COSTS: Mapping[tuple[str, str], Cost] = {
    ("exact", "plain"): Cost(0.42, 0.85, 1.0),
    ("newmark", "reduced-step"): Cost(0.31, 0.33, 45.0),
    ("rk4", "reduced-step"): Cost(0.31, 0.33, 47.0),
    ("rk4", "cubic"): Cost(0.30, 0.32, 189.0),
    EXACT: Cost(0.45, 0.47, 139.0),
}


@dataclass(frozen=True)
class Candidate:
    """A method that was tried.

    Attributes
    ----------
    integrator, impact, steps_per_period
        As in the configuration.
    cost : float
        Modelled time, in units of the exact engine's.
    error : float
        The largest of the sample; inf where it failed.
    """

    integrator: str
    impact: str
    steps_per_period: int
    cost: float
    error: float


@dataclass(frozen=True)
class Pilot:
    """The outcome of a pilot.

    Attributes
    ----------
    method : MethodSection
        The method to take.
    summary : str
        The choice and its reason in one line.
    record : str
        What was asked, tried and chosen, as YAML.
    """

    method: MethodSection
    summary: str
    record: str


def choose(config: SweepConfig, threads: int | None = None) -> Pilot:
    """Choose the method of a sweep whose configuration gives an accuracy instead.

    Parameters
    ----------
    config : SweepConfig
        With ``method.accuracy``.
    threads : int, optional
        Threads to use; all cores by default. The choice does not depend on it.

    Returns
    -------
    Pilot
        The same for the same configuration, on every machine.
    """
    asked = config.method.accuracy
    assert asked is not None
    about: dict[str, object] = {"accuracy": asked, "margin": MARGIN}
    best, tried = None, []
    if "lyapunov" in config.record.diagnostics:
        reason = "lyapunov needs the exact engine"
    else:
        reference = Reference(config, config.grid.spread(POINTS), threads)
        about |= reference.about()
        if reference.any_judged:
            tried = _try_all(reference, asked / MARGIN)
            best = _cheapest(tried, asked / MARGIN)
        reason = _reason(reference, best, asked)
    integrator, impact = EXACT if best is None else (best.integrator, best.impact)
    steps = config.steps if best is None else best.steps_per_period
    chosen = {"integrator": integrator, "impact": impact, "steps_per_period": steps}
    about |= {"chosen": chosen, "reason": reason, "candidates": list(map(_rounded, tried))}
    return Pilot(
        method=_method((integrator, impact), steps),
        summary=f"method: {integrator} integrator, {impact} impacts, {steps} steps per period: "
        f"{reason}",
        record=yaml.safe_dump(about, sort_keys=False, default_flow_style=None, width=120),
    )


def _reason(reference: Reference, best: Candidate | None, asked: float) -> str:
    points = f"{reference.points.size} pilot points"
    if not reference.any_judged:
        return f"the exact engine resolves none of the {points}"
    if best is None:
        return (
            f"no other has an error <= {asked:g} / {MARGIN:g} on {points} "
            f"in less than {WORTH:g} of the exact engine's time"
        )
    return (
        f"error {best.error:.2g} <= {asked:g} / {MARGIN:g} on {points}, "
        f"modelled {best.cost:.2g} of the exact engine's time"
    )


def _rounded(one: Candidate) -> dict[str, object]:
    digits = {name: float(f"{getattr(one, name):.2g}") for name in ("cost", "error")}
    return asdict(one) | digits


def _try_all(reference: Reference, target: float) -> list[Candidate]:
    tried: list[Candidate] = []
    for family in COSTS:
        if family != EXACT:
            best = _cheapest(tried, target)
            tried += _climb(reference, family, target, WORTH if best is None else best.cost)
    return tried


def _cheapest(tried: list[Candidate], target: float) -> Candidate | None:
    """Return the cheapest that reaches `target`, if it is worth taking."""
    reached = [one for one in tried if one.error <= target and one.cost < WORTH]
    return min(reached, key=lambda one: one.cost, default=None)


def _climb(
    reference: Reference, family: tuple[str, str], target: float, dearest: float
) -> list[Candidate]:
    """Try a family with more and more steps, until it reaches `target` or is too dear.

    A number of steps is left out where the error of the one before, falling with the family's
    order, would still be ten times too large.
    """
    orders = INTEGRATORS[family[0]].order, IMPACT_RULES[family[1]].order
    order = min(one for one in orders if one is not None)
    least, tried = 0.0, []
    for steps in STEPS:
        if _relative_cost(reference, family, steps, 0.0) >= dearest:
            break
        if steps < least or not _is_allowed(reference.config, family, steps):
            continue
        errors, impacts = reference.errors(family, steps)
        cost = _relative_cost(reference, family, steps, impacts)
        one = Candidate(*family, steps, cost, float(errors.max()))
        tried.append(one)
        if one.error <= target:
            break
        least = steps * (min(one.error, 1.0) / (10.0 * target)) ** (1.0 / order)
    return tried


def _relative_cost(
    reference: Reference, family: tuple[str, str], steps: int, impacts: float
) -> float:
    """Return the modelled time of a method, in units of the exact engine's."""
    record = reference.config.record
    recorded = record.periods / (record.transient + record.periods)

    def period(cost: Cost, steps: int, impacts: float) -> float:
        step = cost.step + recorded * (cost.recorded_step - cost.step)
        return steps * step + impacts * cost.impact

    exact = period(COSTS[EXACT], reference.config.steps, reference.impacts)
    return period(COSTS[family], steps, impacts) / exact


def _is_allowed(config: SweepConfig, family: tuple[str, str], steps: int) -> bool:
    try:
        config.with_method(_method(family, steps))
    except ValueError:
        return False
    return True


def _method(family: tuple[str, str], steps: int) -> MethodSection:
    return MethodSection(integrator=family[0], impact=family[1], steps_per_period=steps)
