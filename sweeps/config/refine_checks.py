"""Check that a sweep can be refined."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sweeps.config.schema import FollowConfig, MethodConfig, RecordConfig
from sweeps.config.values import MisplacedError


def refuse_refinement(
    axis: str,
    axes: Mapping[str, np.ndarray],
    method: MethodConfig,
    record: RecordConfig,
    follow: FollowConfig | None,
) -> None:
    """Refuse to refine a sweep that cannot be refined along an axis.

    Raises
    ------
    MisplacedError
        Names the key that is in the way, and what would be allowed.
    """
    if list(axes) != [axis]:
        swept = ", ".join(axes) or "none"
        raise MisplacedError(
            ("refine", "axis"),
            f"{axis} must be the only swept axis, but these are swept: {swept}; expected: one "
            "axis, and its name here",
        )
    if len(axes[axis]) < 2 or not (np.diff(axes[axis]) > 0.0).all():
        raise MisplacedError(
            ("refine", "axis"),
            f"{axis} cannot be refined; expected: two or more values of it, in increasing order",
        )
    if method.impact != "exact":
        raise MisplacedError(
            ("refine",),
            f"the orbits beside a change are found with the impact rule exact, not "
            f"{method.impact}; expected: method.impact: exact, or no refine",
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
            "is not kept where points are added; expected: false, or no refine",
        )
    if follow is not None and follow.direction == "both":
        raise MisplacedError(
            ("follow", "direction"),
            "both directions cannot be refined at once; expected: up or down, or no refine",
        )
