"""Checks of several keys together, at all points: exclusions, steps, stability, sizes.

What a key may be on its own is in ``groups.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from sweeps.config.groups import STARTS, UnitsConfig
from sweeps.config.rig import SI_UNITS
from sweeps.config.sweep import SweepConfig
from sweeps.config.values import Axis, ConflictError, Key
from sweeps.grid import TABLE
from sweeps.text import fewest_digits, listed
from vibroimpact.inputs import integer
from vibroimpact.oscillator import mesh, with_one_force
from vibroimpact.step.scheme import (
    IMPACT_RULES,
    INTEGRATORS,
    MOST_STEPS,
    default_steps,
    least_stable_steps,
)

# Limits that turn a typing error into a message instead of a lack of memory.
_MOST_POINTS = 1_000_000_000
_MOST_SAMPLES = 10_000_000
#: The key that allows a step that is too long for the integrator.
_UNSTABLE = "method.allow_unstable: true"


def with_defaults(config: SweepConfig) -> SweepConfig:
    """Return a configuration with the steps per period and the units that its groups determine.

    Its keys have no `conflicts`. Raises ConflictError if its points and sizes are not allowed.
    """
    axes = config.parameters()
    points = _extreme_points(config, axes)
    _refuse_points(config, points)
    steps = _chosen_steps(config, points)
    _refuse_large(config, axes, steps)
    _refuse_repeated(config, axes)
    units = _chosen_units(config)
    method = config.method.model_copy(update={"steps_per_period": steps})
    return config.model_copy(update={"method": method, "units": units})


def conflicts(config: SweepConfig) -> Iterator[ConflictError]:
    """Yield an error for each key whose value does not go together with that of another key."""
    method, record, follow = config.method, config.record, config.follow
    exact, auto = method.impact == "exact", record.transient == "auto"
    if exact and method.integrator != "exact":
        rules = ", ".join(rule for rule in IMPACT_RULES if rule != "exact")
        problem = f"impact exact needs the integrator exact, not {method.integrator}"
        expected = f"integrator exact, or one of the impact rules {rules}"
        yield ConflictError(("method", "integrator"), problem, expected)
    if not exact and "lyapunov" in record.diagnostics:
        problem = f"lyapunov needs the impact rule exact, not {method.impact}"
        expected = "method.impact: exact, or diagnostics without lyapunov"
        yield ConflictError(("record", "diagnostics"), problem, expected)
    if record.longest is not None and not auto:
        yield ConflictError(
            ("record", "longest"), "is only for transient: auto", "no longest, or auto"
        )
    if auto and "period" not in record.diagnostics:
        problem = "auto needs the classes of motions"
        yield ConflictError(("record", "transient"), problem, "diagnostics: [period]")
    if auto and (record.trajectory or follow):
        problem = f"auto cannot be used with {'trajectory' if record.trajectory else 'follow'}"
        yield ConflictError(("record", "transient"), problem, "an integer")
    if follow and config.points is not None:
        problem = "needs an axis, but points has none"
        yield ConflictError(("follow",), problem, "a range instead of points")
    elif follow and (axes := config.parameters())[follow.axis].size == 1:
        name = config.nomenclature.name
        others = [name(key) for key, axis in axes.items() if axis.size > 1 and key not in STARTS]
        expected = f"a swept axis out of {listed(others)}" if others else "an axis that is swept"
        problem = f"{name(follow.axis)} has only one value, so that there is nothing to follow"
        yield ConflictError(("follow", "axis"), problem, expected)


def _key_of(config: SweepConfig, name: str) -> Key:
    """Return the key of a parameter of the model in its group."""
    if name in STARTS:
        return "start", name
    return config.nomenclature.group, config.nomenclature.name(name)


def _extreme_points(config: SweepConfig, axes: Mapping[str, Axis]) -> np.ndarray:
    """Return points at which every check fails that fails at a point of the sweep.

    Of a table these are all. Of a grid they are three, whose start is the one closest to the stop
    or farthest beyond it. The first has the largest h and p and the least omega, where exact
    impacts need the shortest step. At the second, the integrator needs the most steps to be stable.
    Every value of h is examined, because the longest stable step T is not monotone in h: for Euler
    T rises as 2h / p^2 and then falls, and for Runge-Kutta it has a minimum at h = 0.54 p. Of p the
    two ends suffice: at any h, T has no minimum between them. The third has the largest force.
    """
    if config.table is not None:
        return mesh({TABLE: config.table}, {name: axis.first for name, axis in axes.items()})
    points = mesh({}, {name: axis.high for name, axis in axes.items()}).repeat(3)
    points["clearance"] = axes["clearance"].low
    h, omega = axes["h"].values(), axes["omega"].low
    points["omega"][:2] = omega
    most = 0.0
    for p in (axes["p"].low, axes["p"].high):
        steps = least_stable_steps(config.method.integrator, h, p, omega)
        k = int(steps.argmax())
        if steps[k] > most:
            most, points[1]["h"], points[1]["p"] = steps[k], h[k], p
    return points


def _refuse_points(config: SweepConfig, points: np.ndarray) -> None:
    """Refuse starts beyond the stop, and a force f + a omega^2 that is not a finite number."""
    beyond = points["x0"] > points["clearance"]
    wrong = beyond if beyond.any() else ~np.isfinite(with_one_force(points)["f"])
    if not wrong.any():
        return
    row = int(wrong.argmax())
    where = "" if config.points is None else f"row {row + 1} of points: "
    if not beyond.any():
        problem = "the force f + a omega^2 must be a finite number"
        raise ConflictError(_key_of(config, "a"), where + problem)
    x0, clearance = points["x0"][row], points["clearance"][row]
    typed, stop = "x0" in config.start.model_fields_set, config.nomenclature.name("clearance")
    raise ConflictError(
        _key_of(config, "x0" if typed else "clearance"),
        f"{where}x0 = {fewest_digits(x0)} lies beyond the stop at {stop} = "
        f"{fewest_digits(clearance)}; every x0 must be <= every {stop}",
    )


def _chosen_steps(config: SweepConfig, points: np.ndarray) -> int:
    """Return the steps per period, chosen if no number is given; refuse too few."""
    method, steps = config.method, config.method.steps_per_period
    try:
        needed = default_steps(points, method.impact, method.integrator)
    except ValueError as error:
        raise ConflictError(_key_of(config, "omega"), str(error)) from None
    if steps is not None and method.impact == "exact" and steps < needed:
        expected = f"{integer(needed, MOST_STEPS).expected}, or null"
        problem = f"{steps} are not enough for exact impacts here"
        raise ConflictError(("method", "steps_per_period"), problem, expected)
    if not method.allow_unstable:
        _refuse_unstable(method.integrator, steps or needed, points)
    return steps or needed


def _refuse_unstable(integrator: str, steps: int, points: np.ndarray) -> None:
    """Refuse `steps` per period if they make the integrator unstable at one of `points`."""
    all_least = least_stable_steps(integrator, points["h"], points["p"], points["omega"])
    least = all_least.max()
    if steps >= least:
        return
    worst = points[all_least.argmax()]
    h, p, omega = worst["h"], worst["p"], worst["omega"]
    point = f"h = {h:g}, p = {p:g}, omega = {omega:g}"
    if least > MOST_STEPS:
        stable = [
            name for name in INTEGRATORS if least_stable_steps(name, h, p, omega) <= MOST_STEPS
        ]
        need = "with no step"
        if least < math.inf:
            need = f"only from {least:.3g} steps per period on, of {MOST_STEPS:,} at most,"
        expected = f"{'h > 0, ' if h == 0.0 else ''}one of {listed(stable)}, or {_UNSTABLE}"
        problem = f"{integrator} is stable {need} at {point}"
        raise ConflictError(("method", "integrator"), problem, expected)
    phase, limit = 2.0 * math.pi * p / (omega * steps), INTEGRATORS[integrator].limit(h / p)
    raise ConflictError(
        ("method", "steps_per_period"),
        f"{steps} are not enough for {integrator} to be stable at {point}: p T = {phase:.4g} "
        f"there must be below {limit:.4g}",
        f"{integer(int(least), MOST_STEPS).expected}, null, or {_UNSTABLE}",
    )


def _refuse_large(config: SweepConfig, axes: Mapping[str, Axis], steps: int) -> None:
    """Refuse a grid of too many points, and trajectories of too many samples."""
    points = math.prod(axis.size for axis in axes.values())
    if points > _MOST_POINTS:
        longest = _key_of(config, max(axes, key=lambda name: axes[name].size))
        problem = f"the axes make a grid of {points:,} points"
        raise ConflictError(longest, problem, f"at most {_MOST_POINTS:,}")
    if not config.record.trajectory:
        return
    samples = config.record.periods * steps // config.record.trajectory.every + 1
    if samples > _MOST_SAMPLES:
        problem = f"{samples:,} samples per point are too many"
        raise ConflictError(("record", "trajectory"), problem, f"at most {_MOST_SAMPLES:,}")


def _refuse_repeated(config: SweepConfig, axes: Mapping[str, Axis]) -> None:
    """Refuse an axis of more values than there are floating-point numbers between its ends.

    At most 1e7 values repeat only in a range that is narrow, or next to 0.
    """
    for name, axis in axes.items():
        size = max(abs(axis.low), abs(axis.high))
        least = axis.low if axis.spacing == "log" else size
        may = axis.high - axis.low < 1e-6 * size or least < 1e-300
        if axis.size > 1 and may and not np.diff(axis.values()).all():
            problem = f"two of {axis.size:,} values are the same floating-point number"
            raise ConflictError(_key_of(config, name), problem, "fewer values, or a wider range")


def _chosen_units(config: SweepConfig) -> UnitsConfig:
    """Return the names of the units; refuse non-SI names for a rig, and mass without a rig."""
    units = config.units
    if config.rig is None:
        if "mass" in units.model_fields_set:
            problem = "without a rig there is no mass"
            raise ConflictError(("units", "mass"), problem, "rig in place of oscillator")
        return units
    for name, unit in units.items():
        if unit not in (SI_UNITS[name], name):
            problem = f"{unit} is not the unit of a rig"
            raise ConflictError(("units", name), problem, SI_UNITS[name])
    return UnitsConfig.model_validate(SI_UNITS)
