"""What is computed of every point of a sweep."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RunSpec:
    """What is computed of every point of a sweep; plain values, equal where all results are."""

    # As for ``integrate``.
    integrator: str
    impact: str
    steps_per_period: int
    transient: int
    periods: int
    phase: float
    impacts: int
    lyapunov: bool
    period: bool  #: Whether to find the period class.
    every: int | None  #: Record the trajectory at so many steps; None for no trajectory.
    #: Whether points that differ in f alone are computed once, see ``scaling.py``.
    scaled: bool
    #: The axis along which each point starts from its neighbour, see ``following.py``, and in which
    #: directions: ``up``, ``down`` or both.
    followed: str | None
    directions: tuple[str, ...]
