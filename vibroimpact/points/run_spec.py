"""What is computed for every point of a sweep."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class RunSpec:
    """What is computed for every point of a sweep; two equal specifications give equal results.

    Its values are valid: the configuration was checked, and has enough steps for every point.
    """

    # As the arguments of ``integrate``.
    integrator: str
    impact: str
    steps_per_period: int
    transient: int
    longest: int | None  #: Longest transient if each point has its own, see ``stages.py``.
    periods: int
    phase: float
    impacts: int
    lyapunov: bool
    period: bool  #: Whether to find the period class.
    every: int | None  #: Steps between samples of the trajectory; None for no trajectory.
    #: Whether points that differ only in f are computed once, see ``computation.py``.
    scaled: bool
    #: The axis along which each point starts from its neighbour, see ``computation.py``, and the
    #: directions: ``up``, ``down`` or both.
    followed: str | None
    directions: tuple[str, ...]
    extremes: bool = False  #: Whether to find the least and the greatest displacement.

    def part(self, transient: int, periods: int, impacts: int, lyapunov: bool) -> RunSpec:
        """Return the specification of a part of the run, without trajectory and extremes."""
        return replace(
            self, transient=transient, longest=None, periods=periods, impacts=impacts,
            lyapunov=lyapunov, every=None, extremes=False, scaled=False,
        )  # fmt: skip
