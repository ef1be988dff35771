"""The options that every function of this project is compiled with.

No fast-math flag is set anywhere. Where a product and a sum should be fused, the code says
``fma``; so scalar and vector code, any block size and any thread count round alike.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from functools import cache
from typing import Any

import numba
from llvmlite.binding import Linkage
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

from vibroimpact.jit.cache import CompiledCode, cache_folder

_config: Any = numba.config  # its settings are made at run time, unseen by a type checker
if _config.DISABLE_JIT:
    raise ImportError("vibroimpact needs numba's compiler, which NUMBA_DISABLE_JIT turns off")


#: Threads that a computation takes by default: one for each core of the process, or as many as
#: the variable NUMBA_NUM_THREADS says.
ALL_THREADS: int = _config.NUMBA_NUM_THREADS


class _MergedLibrary(JITCodeLibrary):
    """The code of a function for its callers, which optimise it and make machine code of it.

    By default numba does both for every function together with all that it calls, so that an
    innermost function is optimised eight times. Only a function that Python calls needs machine
    code; without the others the first run compiles in half the time.
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


class _WholeLibrary(JITCodeLibrary):
    """The code of a function that Python calls, with that of all functions that it calls.

    No other library needs these. LLVM knows it if they are internal, and then passes them what
    they use of their arguments: of an array the address, not the seven numbers that describe it.
    """

    def _optimize_final_module(self) -> None:
        for function in self._final_module.functions:
            if function.linkage == Linkage.linkonce_odr:
                function.linkage = Linkage.internal
        super()._optimize_final_module()


class _MergingCompiler(Compiler):
    """Compiles a function for its callers in compiled code."""

    def __init__(self, typing: Any, target: Any, library: None, *arguments: Any) -> None:
        super().__init__(typing, target, _MergedLibrary(target.codegen(), "merged"), *arguments)


class WholeCompiler(Compiler):
    """Compiles a function for Python."""

    def __init__(self, typing: Any, target: Any, library: None, *arguments: Any) -> None:
        whole = _WholeLibrary(target.codegen(), "whole")
        whole.enable_object_caching()
        super().__init__(typing, target, whole, *arguments)


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
        are constants, and branches that they exclude are not compiled.
    forced_inline : bool
        Make LLVM merge it into the caller, because a loop around a call is not vectorised.
    refcounts : bool
        Count references to arrays. Functions whose arrays are all held by their caller can do
        without, which halves the cost of an impact.
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
    dispatcher: Any = numba.njit(function, pipeline_class=WholeCompiler, **options)
    dispatcher._cache = CompiledCode(function, cache_folder())

    @cache
    def merged() -> Any:
        return numba.njit(function, pipeline_class=_MergingCompiler, **merging)

    merging: Any = options | {"no_cpython_wrapper": True}
    dispatcher.get_call_template = lambda args, kws: merged().get_call_template(args, kws)
    dispatcher.get_overload = lambda signature: merged().get_overload(signature)
    return dispatcher


def compiled(function: Any, *arguments: Any) -> Any:
    """Return a function compiled for such arguments, which takes less time than its first call."""
    signature = tuple(map(numba.typeof, arguments))
    if signature not in function.overloads:
        collecting = gc.isenabled()
        gc.disable()  # it frees next to nothing, and takes a tenth of the time
        try:
            function.compile(signature)
        finally:
            if collecting:
                gc.enable()
    return function
