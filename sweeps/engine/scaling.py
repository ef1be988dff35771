"""A sweep along f as one computation and a scaling.

With the stop at the rest position and a start at rest there, nothing in eq. (1) and in the rules
(2)-(5) has a length but f: x and v are proportional to it, and the times of the impacts do not
depend on it. So is every step of every method; a power of two scales to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sweeps.config.sweep import SweepConfig
from sweeps.store.variables import VARIABLES

#: Beyond these values of f, its square may overflow or lose digits.
_LEAST, _GREATEST = 1e-150, 1e150


def scales_with_f(config: SweepConfig) -> bool:
    """Whether f is swept and the motion is proportional to it all over the grid.

    It is taken not to be where an axis is followed: points then do not start at rest.
    """
    if config.follow is not None:
        return False
    grid = config.grid
    at_rest = all(grid.fixed.get(name) == 0.0 for name in ("clearance", "x0", "v0"))
    if "f" not in grid.axes or not at_rest:
        return False
    f = grid.axes["f"]
    return bool(len(f) > 1 and _LEAST <= f.min() and f.max() <= _GREATEST)


def computed_once(
    points: np.ndarray, compute: Callable[[np.ndarray], dict[str, np.ndarray]]
) -> dict[str, np.ndarray]:
    """Compute points that differ in f alone once, at f = 1, and scale the results.

    Parameters
    ----------
    points : ndarray of dtype ``POINT``, shape (n,)
    compute : callable
        Points to the variables of the file, arrays of shape (n, ...).
    """
    at_one = points.copy()
    at_one["f"] = 1.0
    different, which = np.unique(at_one, return_inverse=True)
    results = {name: values[which] for name, values in compute(different).items()}
    for name, values in results.items():
        if VARIABLES[name].unit.startswith("length"):
            values *= points["f"].reshape(-1, *(1,) * (values.ndim - 1))
    return results
