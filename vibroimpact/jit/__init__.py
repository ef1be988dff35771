"""Compiled functions: their options, single instructions of LLVM, disk cache, and threads."""

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
from vibroimpact.jit.threads import on_threads

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
    "on_threads",
    "select",
    "widest_vectors",
]
