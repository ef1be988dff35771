"""The cheapest method that reaches an asked accuracy, chosen by a pilot run.

A sample of the sweep's own points is run from the sweep's own start, with the exact engine and
with each candidate, and their sections are compared (``method_error.py``).

The choice must be the same on every machine, so the time of a method is not measured but modelled,
from nanoseconds per step and per impact that ``python -m sweeps.bench.costs`` has measured. Only
their ratios matter. The impacts are counted in the pilot.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import NamedTuple

import yaml

from sweeps.config.schema import MethodConfig
from sweeps.config.sweep import SweepConfig
from sweeps.engine.method_error import EXACT_METHOD, ExactSample
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.rules import IMPACT_RULES

#: Points of the sample, at the most.
SAMPLE_SIZE = 64
#: The asked error is for every point of the sweep, so the error of the sample must be smaller by
#: this factor.
SAFETY_FACTOR = 3.0
#: A method replaces the exact engine, which certifies its results, only if its modelled time is
#: less than this share of the exact engine's. The model itself is accurate to a sixth.
MAX_RELATIVE_COST = 0.9
#: Numbers of steps per period that are tried.
TRIED_STEPS = (
    12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024, 1536, 2048, 3200,
)  # fmt: skip


class MethodCost(NamedTuple):
    """Time of one core [ns].

    Attributes
    ----------
    period : float
        What a forcing period takes beside its steps and impacts.
    step, recorded_step : float
        A step in the transient, and in the record.
    impact : float
    """

    period: float
    step: float
    recorded_step: float
    impact: float


#: Integrator and impact rule of every method worth trying, the exact engine last. A step is an
#: affine map and costs the same with each integrator: so `plain` is tried with the exact flow only,
#: and euler, semi-implicit-euler and verlet, whose step is limited by stability, are left out. At
#: an impact the integrator itself is called, and the exact flow would cost more there than the
#: exact rule. In a chatter an exact impact takes three times as long as here, one of `reduced-step`
#: twice: there the pilot keeps to the exact engine.
COSTS: Mapping[tuple[str, str], MethodCost] = {
    ("exact", "plain"): MethodCost(7.0, 0.33, 0.70, 1.0),
    ("newmark", "reduced-step"): MethodCost(6.0, 0.23, 0.25, 33.0),
    ("rk4", "reduced-step"): MethodCost(6.0, 0.23, 0.25, 35.0),
    ("rk4", "cubic"): MethodCost(7.0, 0.22, 0.24, 165.0),
    EXACT_METHOD: MethodCost(8.0, 0.48, 0.66, 20.0),
}


@dataclass(frozen=True)
class Candidate:
    """A method that was tried, with its modelled time in units of the exact engine's.

    The error is the largest of the sample, inf where the method failed.
    """

    integrator: str
    impact: str
    steps_per_period: int
    cost: float
    error: float


class Pilot(NamedTuple):
    """The method to take, why in one line, and what was asked, tried and chosen, as YAML."""

    method: MethodConfig
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
    accuracy = config.method.accuracy
    assert accuracy is not None
    about: dict[str, object] = {"accuracy": accuracy, "margin": SAFETY_FACTOR}
    best, tried = None, []
    if "lyapunov" in config.record.diagnostics:
        reason = "lyapunov needs the exact engine"
    else:
        sample = ExactSample(config, config.grid.spread(SAMPLE_SIZE), threads)
        about |= sample.summary()
        if sample.judged.any():
            tried = _try_all(sample, accuracy / SAFETY_FACTOR)
            best = _cheapest(tried, accuracy / SAFETY_FACTOR)
        reason = _reason(sample, best, accuracy)
    integrator, impact = EXACT_METHOD if best is None else (best.integrator, best.impact)
    steps = config.steps if best is None else best.steps_per_period
    chosen = {"integrator": integrator, "impact": impact, "steps_per_period": steps}
    about |= {"chosen": chosen, "reason": reason, "candidates": list(map(_rounded, tried))}
    return Pilot(
        method=_method((integrator, impact), steps),
        summary=f"method: {integrator} integrator, {impact} impacts, {steps} steps per period: "
        f"{reason}",
        record=yaml.safe_dump(about, sort_keys=False, default_flow_style=None, width=120),
    )


def _reason(sample: ExactSample, best: Candidate | None, accuracy: float) -> str:
    """Say why the best candidate was chosen, or none."""
    points = f"{sample.points.size} pilot points"
    if not sample.judged.any():
        return f"the exact engine resolves none of the {points}"
    if best is None:
        return (
            f"no other has an error <= {accuracy:g} / {SAFETY_FACTOR:g} on {points} "
            f"in less than {MAX_RELATIVE_COST:g} of the exact engine's time"
        )
    return (
        f"error {best.error:.2g} <= {accuracy:g} / {SAFETY_FACTOR:g} on {points}, "
        f"modelled {best.cost:.2g} of the exact engine's time"
    )


def _rounded(candidate: Candidate) -> dict[str, object]:
    """Return a candidate for the record, with two digits."""
    digits = {name: float(f"{getattr(candidate, name):.2g}") for name in ("cost", "error")}
    return asdict(candidate) | digits


def _try_all(sample: ExactSample, target: float) -> list[Candidate]:
    """Try every method but the exact engine, each up to the cost of the best before it."""
    tried: list[Candidate] = []
    for family in COSTS:
        if family != EXACT_METHOD:
            best = _cheapest(tried, target)
            limit = MAX_RELATIVE_COST if best is None else best.cost
            tried += _try_family(sample, family, target, limit)
    return tried


def _cheapest(tried: list[Candidate], target: float) -> Candidate | None:
    """Return the cheapest that reaches `target`, if it is worth taking."""
    accurate = [c for c in tried if c.error <= target and c.cost < MAX_RELATIVE_COST]
    return min(accurate, key=lambda candidate: candidate.cost, default=None)


def _try_family(
    sample: ExactSample, family: tuple[str, str], target: float, limit: float
) -> list[Candidate]:
    """Try a method with more and more steps, until it reaches `target` or its cost the `limit`.

    A number of steps is left out where the error of the one before, falling with the family's
    order, would still be ten times too large.
    """
    orders = INTEGRATORS[family[0]].order, IMPACT_RULES[family[1]].order
    order = min(order for order in orders if order is not None)
    least, tried = 0.0, []
    for steps in TRIED_STEPS:
        if _relative_cost(sample, family, steps, 0.0) >= limit:
            break
        if steps < least or not _is_allowed(sample.config, family, steps):
            continue
        errors, impacts = sample.errors(family, steps)
        cost = _relative_cost(sample, family, steps, impacts)
        error = float(errors.max())
        tried.append(Candidate(*family, steps, cost, error))
        if error <= target:
            break
        least = steps * (min(error, 1.0) / (10.0 * target)) ** (1.0 / order)
    return tried


def _relative_cost(
    sample: ExactSample, family: tuple[str, str], steps: int, impacts: float
) -> float:
    """Return the modelled time of a method, in units of the exact engine's."""
    record = sample.config.record
    recorded = record.periods / (record.transient + record.periods)

    def time_per_period(cost: MethodCost, steps: int, impacts: float) -> float:
        step = cost.step + recorded * (cost.recorded_step - cost.step)
        return cost.period + steps * step + impacts * cost.impact

    exact = time_per_period(COSTS[EXACT_METHOD], sample.config.steps, sample.impacts)
    return time_per_period(COSTS[family], steps, impacts) / exact


def _is_allowed(config: SweepConfig, family: tuple[str, str], steps: int) -> bool:
    """Return whether the configuration accepts a method."""
    try:
        config.with_method(_method(family, steps))
    except ValueError:
        return False
    return True


def _method(family: tuple[str, str], steps: int) -> MethodConfig:
    return MethodConfig(integrator=family[0], impact=family[1], steps_per_period=steps)
