"""The options that every function of this project is compiled with, and its threads.

No fast-math flag is set anywhere. Where a product and a sum should be fused, the code says
``fma``; so scalar and vector code, any block size and any thread count round alike.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from typing import Any, TypeVar

import numba
import numpy as np

from vibroimpact.jit.cache import cache_folder, make_folder, warn_once
from vibroimpact.jit.hooks import HOOKS, dispatcher

_config: Any = numba.config  # its settings are made at run time, unseen by a type checker
if _config.DISABLE_JIT:
    raise ImportError("vibroimpact needs numba's compiler, which NUMBA_DISABLE_JIT turns off")


#: Threads that a computation takes by default: one for each core of the process, or as many as
#: the variable NUMBA_NUM_THREADS says.
ALL_THREADS: int = _config.NUMBA_NUM_THREADS

T = TypeVar("T")


def jit(
    function: Callable | None = None,
    *,
    inline: bool = False,
    forced_inline: bool = False,
    refcounts: bool = True,
) -> Any:
    """Compile `function` with the options of this project, cached on disk.

    An `inline` function is merged into its caller before types are inferred, so that branches which
    constant arguments exclude are not compiled; one of `forced_inline` by LLVM, since a loop around
    a call is not vectorised. Without `refcounts`, which needs arrays that the caller holds, an
    impact costs half. With Python's error model every division may raise: no loop is vectorised.
    """
    if function is None:
        return partial(jit, inline=inline, forced_inline=forced_inline, refcounts=refcounts)
    options: dict[str, Any] = {
        "error_model": "numpy",
        "nogil": True,  # so that several threads compute, and a main thread hears signals
        "inline": "always" if inline else "never",
        "forceinline": forced_inline,
    }
    if HOOKS:
        return dispatcher(function, options | {"_nrt": refcounts})
    return _public(function, options)


def _public(function: Callable, options: dict[str, Any]) -> Any:
    """Compile with public options alone, and with numba's cache in the folder of this code."""
    folder, before = cache_folder(), _config.CACHE_DIR
    try:
        make_folder(folder)
        _config.CACHE_DIR = str(folder)
        return numba.njit(function, cache=True, **options)
    except OSError as error:
        warn_once(folder, "kept", error.strerror or type(error).__name__)
        return numba.njit(function, **options)
    finally:
        _config.CACHE_DIR = before


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


def on_threads(
    threads: int, interrupt: np.ndarray, function: Callable[..., T], *arguments: object
) -> list[T]:
    """Call a function on so many threads, and wait for what they return.

    The caller only waits, because Python hears no signal while its main thread is in compiled code.
    Whatever ends the wait, as Ctrl-C, sets `interrupt`, which the function checks.

    The threads last as long as the call: a forked process misses none of them, and callers in
    several threads do not meet.
    """
    calls: list[Future[T]] = []
    with ThreadPoolExecutor(threads) as pool:
        try:
            with suppress(RuntimeError):  # if no more can be started, the started ones do the work
                for _ in range(threads):
                    calls.append(pool.submit(function, *arguments))
            return [call.result() for call in calls] or [function(*arguments)]
        except BaseException:
            interrupt[0] = 1
            raise
