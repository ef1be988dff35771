"""A sweep along f as one computation and a scaling.

With the stop at the rest position, a start at rest there and a = 0, f is the only quantity in eq.
(1) and the rules (2)-(5) whose unit has a length. So x and v are proportional to f, and the times
of the impacts do not depend on it. The same holds for every step of every method. Scaling by a
power of two is exact to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

#: Range of f in which its square neither overflows nor loses digits.
_LEAST, _GREATEST = 1e-150, 1e150
#: Results proportional to f: their unit is a length, or a length per time.
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
    "x_min",
    "x_max",
    "orbit_x",
    "orbit_v",
)
#: Results proportional to f squared.
SCALED_SQUARED = ("energy_lost",)


def scales_with_f(axes: Mapping[str, np.ndarray], fixed: Mapping[str, float]) -> bool:
    """Return whether f is swept and the motion is proportional to f over the whole grid."""
    at_rest = all(fixed.get(name) == 0.0 for name in ("clearance", "a", "x0", "v0"))
    if "f" not in axes or not at_rest:
        return False
    f = axes["f"]
    return bool(len(f) > 1 and _LEAST <= f.min() and f.max() <= _GREATEST)


def computed_once(
    points: np.ndarray, compute: Callable[[np.ndarray], dict[str, np.ndarray]]
) -> dict[str, np.ndarray]:
    """Compute points that differ only in f once, at f = 1, and scale the results, (n, ...)."""
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
