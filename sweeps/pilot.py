"""The cheapest method that reaches an asked accuracy, chosen by a pilot run.

A sample of the sweep's own points is run from the sweep's own start, with the exact engine and
with each candidate, and their sections are compared.

Error. The largest over the sample of |x - x_exact| / X and |v - v_exact| / V, with X and V the
largest |x| and |v| of the point's exact sections: so it does not change with f, which scales the
motion. Three sections per forcing period are compared, the recorded phase among them, since a mass
at rest at one of them has forgotten every error. A state just before an impact is near one just
after it: they are as far apart as both are from the impact (Biemond, van de Wouw, Heemels &
Nijmeijer 2013, IEEE Trans. Autom. Control 58, 876-890). Where the motion is chaotic, or grazes, two
exact runs part: a section is judged as long as a neighbouring start was amplified less than
``MOST_GROWTH`` times; what follows no method computes. An error that takes more than ``PERIODS``
to build up, at almost no damping, is not seen whole.

Cost. The choice has to be the same on every machine, so the cost is a model and not a stopwatch:
nanoseconds per step and per impact, as ``python -m sweeps.bench.costs`` measures them on the lane
kernel. Only their ratios matter. The impacts are counted in the pilot.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import NamedTuple

import numpy as np
import yaml

from sweeps.config import MethodSection, SweepConfig
from vibroimpact.attractors import integrate
from vibroimpact.impacts import IMPACT_RULES
from vibroimpact.integrators import INTEGRATORS

#: Points of the sample, and forcing periods that they are followed for, at the most.
POINTS, PERIODS = 64, 60
#: Sections per forcing period that are compared.
SECTIONS = 3
#: The asked error is that of every point of the sweep: the sample has to stay this far below it.
MARGIN = 3.0
#: The exact engine certifies what it computes, and the model errs by a tenth: what is to be taken
#: instead has to cost less than this share of its time.
WORTH = 0.9
#: Neighbouring starts that part by more than this are not judged any further, from this distance.
MOST_GROWTH, APART, ROUNDING = 1e3, 1e-9, 1e-13
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


_EXACT = ("exact", "exact")
#: Integrator and impact rule of every method worth trying, the exact engine last. A step is an
#: affine map and costs the same with each integrator, the exact flow among them: so `plain` takes
#: that, and an explicit method, which takes as many steps or more, has nothing to offer. An impact
#: is computed with the scalar integrator, where the exact flow is dearer than the exact rule.
COSTS: Mapping[tuple[str, str], Cost] = {
    ("exact", "plain"): Cost(0.45, 0.86, 4.0),
    ("newmark", "reduced-step"): Cost(0.87, 0.87, 115.0),
    ("rk4", "reduced-step"): Cost(0.87, 0.87, 125.0),
    ("rk4", "cubic"): Cost(0.87, 0.87, 195.0),
    _EXACT: Cost(0.97, 0.97, 150.0),
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
    integrator, impact = _EXACT if best is None else (best.integrator, best.impact)
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
        if family != _EXACT:
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
        if reference.cost(family, steps, 0.0) >= dearest:
            break
        if steps < least or not _is_allowed(reference.config, family, steps):
            continue
        errors, impacts = reference.errors(family, steps)
        one = Candidate(*family, steps, reference.cost(family, steps, impacts), errors.max())
        tried.append(one)
        if one.error <= target:
            break
        least = steps * (min(one.error, 1.0) / (10.0 * target)) ** (1.0 / order)
    return tried


def _is_allowed(config: SweepConfig, family: tuple[str, str], steps: int) -> bool:
    try:
        config.with_method(_method(family, steps))
    except ValueError:
        return False
    return True


def _method(family: tuple[str, str], steps: int) -> MethodSection:
    return MethodSection(integrator=family[0], impact=family[1], steps_per_period=steps)


class Reference:
    """The exact motion of some points of a sweep, and what of it can be compared.

    Parameters
    ----------
    config : SweepConfig
    points : ndarray of dtype ``POINT``, shape (n,)
    threads : int, optional

    Attributes
    ----------
    judged : ndarray of bool, shape (n, periods, SECTIONS)
        Sections up to the one where neighbours have parted.
    """

    def __init__(self, config: SweepConfig, points: np.ndarray, threads: int | None = None) -> None:
        self.config = config
        self.points = points
        self._threads = threads
        record = config.record
        self._share = record.periods / (record.transient + record.periods)
        self._periods = min(PERIODS, record.transient + record.periods)
        self._sections, self._impacts = self._run(self.points, _EXACT, config.steps)
        self._scale = np.nanmax(np.abs(self._sections), axis=(1, 2), keepdims=True, initial=0.0)
        self._scale[self._scale == 0.0] = 1.0  # it never moves
        neighbours = self.points.copy()
        neighbours["x0"] -= APART * self._scale[:, 0, 0, 0]
        apart = self._distance(self._run(neighbours, _EXACT, config.steps)[0])
        apart = np.maximum(apart, ROUNDING).reshape(self.points.size, -1)
        nearest = np.minimum.accumulate(apart, axis=1)
        judged = np.logical_and.accumulate(apart < MOST_GROWTH * nearest, axis=1)
        self.judged = judged.reshape(self._sections.shape[:3])

    @property
    def any_judged(self) -> bool:
        """Whether there is anything to compare."""
        return bool(self.judged.any())

    def about(self) -> dict[str, object]:
        """Describe the sample, and the share of its sections that is judged."""
        return {
            "points": self.points.size,
            "periods": self._periods,
            "judged": round(float(self.judged.mean()), 3),
        }

    def cost(self, family: tuple[str, str], steps: int, impacts: float) -> float:
        """Return the modelled time of a method, in units of the exact engine's."""

        def period(cost: Cost, steps: int, impacts: float) -> float:
            step = cost.step + self._share * (cost.recorded_step - cost.step)
            return steps * step + impacts * cost.impact

        exact = period(COSTS[_EXACT], self.config.steps, self._impacts)
        return period(COSTS[family], steps, impacts) / exact

    def errors(self, method: tuple[str, str], steps: int) -> tuple[np.ndarray, float]:
        """Run a method: the error of every point, and the mean impacts per period."""
        sections, impacts = self._run(self.points, method, steps)
        errors = np.max(self._distance(sections), axis=(1, 2), where=self.judged, initial=0.0)
        return errors, impacts

    def _run(
        self, points: np.ndarray, method: tuple[str, str], steps: int
    ) -> tuple[np.ndarray, float]:
        """Return sections, shape (n, periods, SECTIONS, 2), and the mean impacts per period."""
        sections, impacts = [], 0.0
        for k in range(SECTIONS):
            results = integrate(
                points,
                integrator=method[0],
                impact=method[1],
                steps_per_period=steps,
                transient=0,
                periods=self._periods,
                phase=(self.config.record.phase + 2.0 * math.pi * k / SECTIONS) % (2.0 * math.pi),
                impacts=0,
                threads=self._threads,
            )
            sections.append(np.stack([results["poincare_x"], results["poincare_v"]], axis=-1))
            impacts += float(np.nan_to_num(results["impacts_per_period"]).mean()) / SECTIONS
        return np.stack(sections, axis=2), impacts

    def _distance(self, sections: np.ndarray) -> np.ndarray:
        """Return the error of every section; inf where there is none."""
        R = self.points["R"][:, None, None]
        stop = self.points["clearance"][:, None, None]
        (x, v), (x_0, v_0) = np.moveaxis(sections, -1, 0), np.moveaxis(self._sections, -1, 0)
        X, V = np.moveaxis(self._scale, -1, 0)
        with np.errstate(all="ignore"):
            direct = np.maximum(np.abs(x - x_0) / X, np.abs(v - v_0) / V)
            to_stop = np.maximum(np.abs(x - stop), np.abs(x_0 - stop)) / X
            rebound = np.abs(np.minimum(v, v_0) + R * np.maximum(v, v_0)) / V
            apart = np.minimum(direct, np.maximum(to_stop, rebound))
        return np.where(np.isfinite(apart), apart, np.inf)
