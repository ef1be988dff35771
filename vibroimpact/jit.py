"""Compile options, the fused multiply-add, and the disk cache: one place for all three.

No fast-math flag is set anywhere. Where a product and a sum should be fused, the code says
``fma``; so scalar and vector code, any block size and any thread count round alike.
"""

from __future__ import annotations

import gc
import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
import platformdirs
from numba import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.extending import intrinsic

from vibroimpact.cache import CompiledCode

_config: Any = numba.config  # its settings are made at run time, unseen by a type checker
if _config.DISABLE_JIT:
    raise ImportError("vibroimpact needs numba's compiler, which NUMBA_DISABLE_JIT turns off")


#: Threads that a computation takes by default: one for each core of the process, or as many as
#: the variable NUMBA_NUM_THREADS says.
ALL_THREADS: int = _config.NUMBA_NUM_THREADS


def _numerics() -> str:
    digest = hashlib.sha256(numba.__version__.encode())
    package = Path(__file__).parent
    for source in sorted(package.rglob("*.py")):
        name = source.relative_to(package).as_posix()
        digest.update(name.encode() + b"\0" + source.read_bytes())
    return digest.hexdigest()[:16]


#: Names the code that computes: made of every source file of this package, and of numba's version.
NUMERICS = _numerics()


def _cache_folder() -> Path:
    """Return the folder of compiled code, which is named after the code that it was compiled from.

    A cache that looks only at the file that holds a function would serve a stale kernel where a
    helper in another file was edited; a name made of all sources cannot. The folder lies outside
    the package: what pip did not install it would leave behind, to shadow the next one.
    """
    root = _config.CACHE_DIR or platformdirs.user_cache_dir("vibroimpact", appauthor=False)
    return Path(root, f"compiled-{NUMERICS}")


class _MergedLibrary(JITCodeLibrary):
    """The code of a function for its callers, which optimise it and make machine code of it.

    By itself numba does both for every function, with all that it calls: for the innermost of them
    eight times over. Only what Python calls needs machine code; without that of the others the
    first run compiles for half as long.
    """

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        return 0  # there is none

    @property
    def codegen(self) -> Any:
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing: only code that raises exceptions or calls Python needs an environment."""


class _MergingCompiler(Compiler):
    """Compiles a function for its callers in compiled code."""

    def __init__(self, typing: Any, target: Any, library: None, *arguments: Any) -> None:
        super().__init__(typing, target, _MergedLibrary(target.codegen(), "merged"), *arguments)


def jit(
    function: Callable | None = None,
    *,
    inline: bool = False,
    forced_inline: bool = False,
    refcounts: bool = True,
) -> Any:
    """Compile `function` with the options of this project, cached on disk.

    The NumPy error model is needed for vectorisation: with Python's, every division may raise.

    Parameters
    ----------
    inline : bool
        Merge into the caller before numba infers types. A helper then sees which of its arguments
        are constants, and what is left out for them is not compiled.
    forced_inline : bool
        Let LLVM merge it into the caller: a loop around a call is not vectorised.
    refcounts : bool
        Count references to arrays. Functions that only look into arrays that their caller holds
        can do without: an impact costs half as much.
    """
    if function is None:
        return lambda f: jit(
            f,
            inline=inline,
            forced_inline=forced_inline,
            refcounts=refcounts,
        )
    options: dict[str, Any] = {
        "error_model": "numpy",
        "nogil": True,  # so that several threads compute, and a main thread hears signals
        "inline": "always" if inline else "never",
        "_nrt": refcounts,
        "forceinline": forced_inline,
        "no_cfunc_wrapper": True,
    }
    dispatcher: Any = numba.njit(function, **options)
    dispatcher._cache = CompiledCode(function, _cache_folder())

    @cache
    def merged() -> Any:
        return numba.njit(function, pipeline_class=_MergingCompiler, **merging)

    merging: Any = options | {"no_cpython_wrapper": True}
    dispatcher.get_call_template = lambda args, kws: merged().get_call_template(args, kws)
    dispatcher.get_overload = lambda signature: merged().get_overload(signature)
    return dispatcher


def _compile(function: Any, signature: tuple[Any, ...]) -> None:
    collecting = gc.isenabled()
    gc.disable()  # it finds next to nothing, and takes a tenth of the time to compile
    try:
        function.compile(signature)
    finally:
        if collecting:
            gc.enable()


# Python maps and unmaps memory whenever the depth of its calls passes a multiple of 16 kB, which a
# compilation does 100,000 times, or not, by the depth it starts from: 2 s of 13. Below a frame this
# large it takes 1 MB at once.
_compile.__code__ = _compile.__code__.replace(co_stacksize=70_000)


def compiled(function: Any, *arguments: Any) -> Any:
    """Return a function compiled for arguments of these types, sooner than a call would be."""
    signature = tuple(map(numba.typeof, arguments))
    if signature not in function.overloads:
        _compile(function, signature)
    return function


@intrinsic
def fma(context, a, b, c):
    """a * b + c, rounded once."""

    def generate(context, builder, signature, arguments):
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), generate


@intrinsic
def select(context, condition, a, b):
    """`a` where the condition holds, else `b`: without a branch, which would not be vectorised."""

    def generate(context, builder, signature, arguments):
        condition, a, b = arguments
        as_bit = context.cast(builder, condition, types.boolean, types.boolean)
        return builder.select(as_bit, a, b)

    return types.float64(types.boolean, types.float64, types.float64), generate


@intrinsic
def widest_vectors(context):
    """Let LLVM use the widest vectors of the processor in the calling function.

    By default it keeps to 256 bits where the processor has 512.
    """

    def generate(context, builder, signature, arguments):
        attributes = builder.function.attributes
        set.add(attributes, '"prefer-vector-width"="512"')
        attributes.add("noinline")
        return context.get_dummy_value()

    return types.void(), generate


@intrinsic
def claim(context, counter):
    """Count up the first element of an array of int64 for all threads; return what it was."""

    def generate(context, builder, signature, arguments):
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        single = context.get_constant(types.int64, 1)
        return builder.atomic_rmw("add", array.data, single, "monotonic")

    return types.int64(counter), generate


@intrinsic
def is_set(context, flag):
    """Whether another thread has set the first element of an array of int64; read every time."""

    def generate(context, builder, signature, arguments):
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        value = builder.load_atomic(array.data, "monotonic", 8)
        return builder.icmp_unsigned("!=", value, context.get_constant(types.int64, 0))

    return types.boolean(flag), generate


@intrinsic
def bit(context, condition, place):
    """An integer with the bit at `place` set where the condition holds, else 0; no branch."""

    def generate(context, builder, signature, arguments):
        condition, place = arguments
        as_bit = context.cast(builder, condition, types.boolean, types.boolean)
        single = context.get_constant(types.int64, 1)
        return builder.select(
            as_bit, builder.shl(single, place), context.get_constant(types.int64, 0)
        )

    return types.int64(types.boolean, types.int64), generate


@intrinsic
def lowest_bit(context, bits):
    """The place of the lowest bit set in an integer that is not 0."""

    def generate(context, builder, signature, arguments):
        return builder.cttz(arguments[0], context.get_constant(types.boolean, 1))

    return types.int64(types.int64), generate
