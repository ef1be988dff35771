"""Functions of the trial that use the arrays of their caller."""

from __future__ import annotations

from vibroimpact.jit.compiling import inlined, jit, specialised
from vibroimpact.jit.intrinsics import fma, lowest_bit, not_negative, select, widest_vectors

TRIAL_LANES = 64
E = 2.0**-30


@specialised
def _square(x, exactly):  # type: ignore[no-untyped-def]  # numba types it
    return fma(x, x, -1.0 - 2.0 * E) if exactly else x * x - (1.0 + 2.0 * E)


@inlined
def _positive(x):  # type: ignore[no-untyped-def]
    return select(x > 0.0, x, 0.0)


@jit
def _fill_lanes(lanes, x):  # type: ignore[no-untyped-def]
    """Fill the lanes with e squared in odd places and -1 in the others."""
    widest_vectors()
    for i in range(TRIAL_LANES):
        lanes[i] = _positive(_square(x, True) + _square(x, False)) if i & 1 else -1.0


@jit
def run_steps(job, lanes, k):  # type: ignore[no-untyped-def]
    """Add the lanes that are not negative to a point, one by one."""
    point = job.points[k]
    _fill_lanes(lanes, point.x)
    bits = not_negative(lanes, 0)
    while bits:
        i = lowest_bit(bits)
        bits &= bits - 1
        point.total += lanes[i] * job.method[1]
        job.rows[k, i & 1] = i
