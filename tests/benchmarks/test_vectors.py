"""The machine code of the hot loops: packed, fused, and as wide as the processor allows."""

import re

import numba
import numpy as np
import pytest

from limits import cpu_features
from vibroimpact import Oscillator
from vibroimpact.jit.hooks import WholeCompiler
from vibroimpact.lanes.columns import carry_columns, mend_columns, new_columns
from vibroimpact.lanes.exact import glide_lanes
from vibroimpact.lanes.exact_block import force_lanes, new_memory
from vibroimpact.lanes.kernel import Lanes, advance
from vibroimpact.lanes.plain import advance_plain
from vibroimpact.lanes.reduced_step import shorten_steps, take_remainders
from vibroimpact.lanes.tally import SUMS, Tally
from vibroimpact.lanes.workspace import LANES, SIZE, STRIDE
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.phases import one_period
from vibroimpact.step.rules import IMPACT_RULES
from vibroimpact.step.stop import new_scratch

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
    anew = numba.njit(loop.py_func, pipeline_class=WholeCompiler, **options)
    anew.compile(tuple(map(numba.typeof, arguments)))
    code = "\n".join(anew.inspect_asm().values())
    assert ".weak" not in code  # what only compiled code calls is internal
    return len(re.findall(packed_instructions(), code))


def test_the_hot_loops_are_packed_and_fused():
    """Of plain stepping, of the strides of the other rules, and of gliding with exact impacts."""
    points = np.repeat(Oscillator(h=0.1, R=0.8, omega=2.0, f=1.0).at(), LANES)
    grid = one_period(0.0, 100)
    tally = Tally(np.empty((LANES, 1, 2)), np.empty((LANES, 1, 2)), np.zeros(LANES, SUMS))
    w = np.zeros(SIZE)
    assert packed(advance_plain, (w, LANES, grid, False, tally)) >= FUSED
    method = IMPACT_RULES["cubic"].code, INTEGRATORS["rk4"].code
    block = Lanes(w, new_scratch(), points, method, tally)
    assert packed(advance, (block, grid, False)) >= FUSED
    exact = new_memory()
    arguments = exact.w, 64, exact.added[0], grid.step, 0
    assert packed(glide_lanes, arguments) >= 8
    assert packed(force_lanes, (exact.w, exact.added[0], 0.0, 1.0)) >= 4


def test_exact_impacts_side_by_side_are_packed_and_fused():
    """The series of a flight, its root, and the response to the impulse; of tangent vectors two."""
    c = new_columns()
    assert packed(mend_columns, (c, 4, (0.0, 1.0, 0.5, 0.8), 0.5)) >= 130
    assert packed(carry_columns, (c, 4, (0.0, 1.0), 0.5)) >= 70


def test_impacts_side_by_side_are_packed_and_fused():
    """Of the reduced step: the impacts, and the remainders of verlet, newmark and rk4."""
    w, points = np.zeros(SIZE), Oscillator(h=0.1, R=0.8, omega=2.0, f=1.0).at()
    assert packed(shorten_steps, (w, LANES, 0.1)) >= FUSED_IN_SIN_COS
    assert packed(take_remainders, (w, LANES, 2, points)) >= 4 * FUSED_IN_SIN_COS
