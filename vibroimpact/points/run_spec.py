"""What is computed of every point of a sweep."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RunSpec:
    """What is computed of every point of a sweep; plain values, equal where all results are.

    Attributes
    ----------
    integrator, impact, steps_per_period, transient, periods, phase, impacts, lyapunov
        As for `vibroimpact.integrate`.
    period : bool
        Whether to find the period class.
    every : int or None
        Record the trajectory at so many steps; None for no trajectory.
    scaled : bool
        Whether points that differ in f alone are computed once, see ``scaling.py``.
    followed : str or None
        The axis along which each point starts from its neighbour, see ``following.py``.
    directions : tuple of str
        In which it is followed: ``up``, ``down`` or both.
    """

    integrator: str
    impact: str
    steps_per_period: int
    transient: int
    periods: int
    phase: float
    impacts: int
    lyapunov: bool
    period: bool
    every: int | None
    scaled: bool
    followed: str | None
    directions: tuple[str, ...]
