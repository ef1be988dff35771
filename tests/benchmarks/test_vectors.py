"""The machine code of the hot loops: packed, fused, and as wide as the processor allows."""

import re

import numba
import pytest
from numba.core.registry import cpu_target

from tests.benchmarks.limits import cpu_features
from vibroimpact.jit.hooks import WholeCompiler
from vibroimpact.kernel import exact_lanes
from vibroimpact.kernel import strides as time_stepping
from vibroimpact.kernel.exact_impacts import EXACT_COLUMNS, carry_columns, follow_flights
from vibroimpact.kernel.reduced_step_impacts import shorten_steps, take_remainders
from vibroimpact.kernel.strides import STRIDE
from vibroimpact.kernel.threads import new_workspace
from vibroimpact.kernel.workspace import LANES
from vibroimpact.step.scheme import one_period

#: A step of a lane has eight multiply-adds, of which two begin with a product.
FUSED = 6 * STRIDE
#: A sine and a cosine; rk4 takes two of them, at the half and at the whole step.
FUSED_IN_SIN_COS = 17


def packed_instructions():
    """Return the pattern of a fused multiply-add in the widest registers, or skip."""
    features = cpu_features()
    if "fma" in features:
        registers = "zmm" if "avx512f" in features else "ymm"
        return rf"\bvfn?m(?:add|sub)\d+pd\s.*%{registers}"
    if "neon" in features:
        return r"\bfml[as]\s+v\d+\.2d"
    pytest.skip("a processor without fused multiply-adds")


def packed(loop, arguments):
    """Count the packed fused multiply-adds of a compiled function.

    Compiled anew, since of what comes from the disk cache numba shows no assembly.
    """
    options = {k: v for k, v in loop.targetoptions.items() if k not in ("cache", "nopython")}
    cpu_target.target_context.refresh()  # which the cache does before a compilation
    anew = numba.njit(loop.py_func, pipeline_class=WholeCompiler, **options)
    anew.compile(tuple(map(numba.typeof, arguments)))
    code = "\n".join(anew.inspect_asm().values())
    assert ".weak" not in code  # functions called only by compiled code are internal
    return len(re.findall(packed_instructions(), code))


WORKSPACE = new_workspace(EXACT_COLUMNS)


def test_the_hot_loops_are_packed_and_fused():
    """Of plain stepping, of the strides of the other rules, and of a step with exact impacts."""
    lanes, added, table = WORKSPACE.lanes, WORKSPACE.added[0], one_period(0.0, 100).table
    stride = lanes, LANES, table, 0, STRIDE
    # Also while recording.
    assert packed(time_stepping.plain_lanes, (*stride, False, None)) >= 2 * FUSED
    assert packed(time_stepping.step_lanes, (*stride, None)) >= FUSED
    assert packed(exact_lanes.propagate_lanes, (lanes, 64, added, 0.1, 0, None)) >= 8
    assert packed(exact_lanes.force_lanes, (lanes, added, 0.0, 1.0)) >= 4


def test_exact_impacts_side_by_side_are_packed_and_fused():
    """The series of a flight, its root, and the response to an impulse; of a tangent two."""
    columns = WORKSPACE.columns
    waves = (0.0, 1.0), (0.5, 0.8)
    assert packed(follow_flights, (columns, 4, waves, 0.5, False)) >= 150
    assert packed(carry_columns, (columns, 4, (0.0, 1.0))) >= 70


def test_impacts_side_by_side_are_packed_and_fused():
    """Of the reduced step: the impacts, and the remainders of verlet, newmark and rk4."""
    columns = WORKSPACE.columns
    assert packed(shorten_steps, (columns, 32, 0.1)) >= FUSED_IN_SIN_COS
    assert packed(take_remainders, (columns, 32, 2)) >= 4 * FUSED_IN_SIN_COS
