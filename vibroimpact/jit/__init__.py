"""Compiled functions: their options, single LLVM instructions, the disk cache, and threads."""

from vibroimpact.jit.cache import COMPILING, NUMERICS, name_of, numerics_of, watched
from vibroimpact.jit.compiling import (
    ALL_THREADS,
    called_before_passes,
    compiled,
    inlined,
    jit,
    on_threads,
    specialised,
)
from vibroimpact.jit.intrinsics import (
    claim,
    fma,
    is_set,
    lowest_bit,
    not_negative,
    select,
    transpose,
    widest_vectors,
)
from vibroimpact.jit.way import WAY

__all__ = [
    "ALL_THREADS",
    "COMPILING",
    "NUMERICS",
    "WAY",
    "called_before_passes",
    "claim",
    "compiled",
    "fma",
    "inlined",
    "is_set",
    "jit",
    "lowest_bit",
    "name_of",
    "not_negative",
    "numerics_of",
    "on_threads",
    "select",
    "specialised",
    "transpose",
    "watched",
    "widest_vectors",
]
