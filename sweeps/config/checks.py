"""Checks that involve several groups of a configuration: enough steps, and allowed refinement."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from sweeps.config.groups import FollowConfig, MethodConfig, OscillatorConfig, RecordConfig
from sweeps.config.values import MisplacedError, as_array, extremes
from vibroimpact.oscillator import POINT
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.scheme import MOST_STEPS
from vibroimpact.step.stability import least_stable_steps

# Number of values of h examined at once, to bound the memory for a long axis.
_CHUNK = 1 << 16


def worst_points(oscillator: OscillatorConfig, integrator: str) -> np.ndarray:
    """Return the two points of a grid that need the most steps, with only h, p and omega set.

    For a table, all points are returned. For a grid, the first point has the largest h and p, where
    exact impacts need the shortest step. At the second, the integrator needs the most steps to be
    stable. Every value of h is examined, because the longest stable step T is not monotone in h:
    for Euler T rises as 2h / p^2 and then falls, and for Runge-Kutta it has a minimum at
    h = 0.54 p. Of p the two ends suffice: at any h, T has no minimum between them.
    """
    if any(isinstance(value, np.ndarray) for _, value in oscillator.items()):
        columns = {name: as_array(value) for name, value in oscillator.items()}
        points = np.zeros(max(map(len, columns.values())), POINT)
        for name in ("h", "p", "omega"):
            points[name] = columns[name]
        return points
    h, omega = as_array(oscillator.h), min(extremes(oscillator.omega))
    least_p, most_p = min(extremes(oscillator.p)), max(extremes(oscillator.p))
    points = np.zeros(2, POINT)
    points["h"], points["p"], points["omega"] = h.max(), most_p, omega
    most = 0.0
    for end in (least_p, most_p):
        for part in np.array_split(h, math.ceil(h.size / _CHUNK)):
            steps = least_stable_steps(integrator, part, end, omega)
            k = int(steps.argmax())
            if steps[k] > most:
                most, points[1]["h"], points[1]["p"] = steps[k], part[k], end
    return points


def refuse_unstable(integrator: str, steps: int, points: np.ndarray) -> None:
    """Refuse `steps` per period if they make the integrator unstable at one of `points`."""
    all_least = least_stable_steps(integrator, points["h"], points["p"], points["omega"])
    least = all_least.max()
    if steps >= least:
        return
    worst = points[all_least.argmax()]
    h, p, omega = worst["h"], worst["p"], worst["omega"]
    there = f"h = {h:g}, p = {p:g}, omega = {omega:g}"
    if least > MOST_STEPS:
        stable = [
            name for name in INTEGRATORS if least_stable_steps(name, h, p, omega) <= MOST_STEPS
        ]
        need = "with no step"
        if least < math.inf:
            need = f"only from {least:.3g} steps per period on, more than the {MOST_STEPS} allowed,"
        raise MisplacedError(
            ("method", "integrator"),
            f"{integrator} is stable {need} at {there}; expected: {'h > 0, ' if h == 0.0 else ''}"
            f"one of {', '.join(stable)}, or method.allow_unstable: true",
        )
    phase, limit = 2.0 * math.pi * p / (omega * steps), INTEGRATORS[integrator].limit(h / p)
    raise MisplacedError(
        ("method", "steps_per_period"),
        f"{steps} are not enough for {integrator} to be stable at {there}: p T = {phase:.4g} "
        f"there must be below {limit:.4g}; expected: an integer from {least:.0f} to {MOST_STEPS}, "
        "null, or method.allow_unstable: true",
    )


def refuse_refinement(
    name: str,
    axes: Mapping[str, np.ndarray],
    method: MethodConfig,
    record: RecordConfig,
    follow: FollowConfig | None,
) -> None:
    """Refuse refinement along the axis `name`, one of the swept `axes`, if that is not possible."""
    if list(axes) != [name]:
        swept = ", ".join(axes) or "none"
        raise MisplacedError(
            ("refine", "axis"),
            f"{name} must be the only swept axis, but these are swept: {swept}; expected: one "
            "axis, and its name here",
        )
    if len(axes[name]) < 2 or not (np.diff(axes[name]) > 0.0).all():
        raise MisplacedError(
            ("refine", "axis"),
            f"{name} cannot be refined; expected: two or more values of it, in increasing order",
        )
    if method.impact != "exact":
        raise MisplacedError(
            ("refine",),
            f"refine needs the impact rule exact, not {method.impact}; "
            "expected: method.impact: exact, or no refine",
        )
    if "period" not in record.diagnostics:
        raise MisplacedError(
            ("refine",),
            "the class of the motion is not recorded; expected: record.diagnostics: [period] or "
            "[period, lyapunov], or no refine",
        )
    if record.trajectory:
        raise MisplacedError(
            ("record", "trajectory"),
            "cannot be recorded with refine; expected: false, or no refine",
        )
    if follow is not None and follow.direction == "both":
        raise MisplacedError(
            ("follow", "direction"),
            "both directions cannot be refined at once; expected: up or down, or no refine",
        )
