"""Compiled functions: their options, single instructions of LLVM, and the disk cache."""

from vibroimpact.jit.cache import NUMERICS
from vibroimpact.jit.compiling import ALL_THREADS, compiled, jit
from vibroimpact.jit.intrinsics import (
    bit,
    claim,
    fma,
    is_set,
    lowest_bit,
    not_negative,
    select,
    widest_vectors,
)
from vibroimpact.jit.sources import name_of

__all__ = [
    "ALL_THREADS",
    "NUMERICS",
    "bit",
    "claim",
    "compiled",
    "fma",
    "is_set",
    "jit",
    "lowest_bit",
    "name_of",
    "not_negative",
    "select",
    "widest_vectors",
]
