"""The points of a grid: each from its own start, once for all f, or from its neighbour's end.

What determines the numbers of a sweep lies in `vibroimpact`, whose sources ``jit.NUMERICS`` names.
"""

from vibroimpact.points.computation import Computation, compute_box, compute_points
from vibroimpact.points.scaling import scales_with_f

__all__ = ["Computation", "compute_box", "compute_points", "scales_with_f"]
