"""Compiled functions: their options, single LLVM instructions, the disk cache, and threads."""

from vibroimpact.jit.cache import NUMERICS, name_of
from vibroimpact.jit.compiling import ALL_THREADS, compiled, jit, on_threads
from vibroimpact.jit.intrinsics import (
    claim,
    fma,
    is_set,
    lowest_bit,
    not_negative,
    select,
    widest_vectors,
)

__all__ = [
    "ALL_THREADS",
    "NUMERICS",
    "claim",
    "compiled",
    "fma",
    "is_set",
    "jit",
    "lowest_bit",
    "name_of",
    "not_negative",
    "on_threads",
    "select",
    "widest_vectors",
]
