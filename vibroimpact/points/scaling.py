"""A sweep along f as one computation and a scaling.

With the stop at the rest position and a start at rest there, nothing in eq. (1) and in the rules
(2)-(5) has a length but f: x and v are proportional to it, and the times of the impacts do not
depend on it. So is every step of every method; a power of two scales to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

#: Beyond these values of f, its square may overflow or lose digits.
_LEAST, _GREATEST = 1e-150, 1e150
#: The results with a unit of length or of length per time.
SCALED = (
    "poincare_x",
    "poincare_v",
    "impact_v",
    "trajectory_x",
    "trajectory_v",
    "slowest_impact",
    "fastest_impact",
    "impulse",
    "max_penetration",
)
#: Those with a unit of length squared.
SCALED_SQUARED = ("energy_lost",)


def scales_with_f(axes: Mapping[str, np.ndarray], fixed: Mapping[str, float]) -> bool:
    """Return whether f is swept and the motion is proportional to it all over a grid."""
    at_rest = all(fixed.get(name) == 0.0 for name in ("clearance", "x0", "v0"))
    if "f" not in axes or not at_rest:
        return False
    f = axes["f"]
    return bool(len(f) > 1 and _LEAST <= f.min() and f.max() <= _GREATEST)


def computed_once(
    points: np.ndarray, compute: Callable[[np.ndarray], dict[str, np.ndarray]]
) -> dict[str, np.ndarray]:
    """Compute points that differ in f alone once, at f = 1, and scale the results, (n, ...)."""
    at_one = points.copy()
    at_one["f"] = 1.0
    different, index = np.unique(at_one, return_inverse=True)
    results = {name: values[index] for name, values in compute(different).items()}
    for name, values in results.items():
        if name in SCALED:
            values *= points["f"].reshape(-1, *(1,) * (values.ndim - 1))
        elif name in SCALED_SQUARED:
            values *= points["f"] ** 2
    return results
