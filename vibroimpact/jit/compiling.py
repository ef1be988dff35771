"""Compiles every function with its options (`jit`), and calls it on threads.

No fast-math flag is set anywhere. Where a product and a sum should be fused, the code calls
``fma``. So scalar and vector code, and all block sizes and thread counts, give the same rounding.
"""

from __future__ import annotations

import gc
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import cache
from typing import Any, TypeVar

import llvmlite.binding
import numba
import numpy as np

from vibroimpact.jit.cache import cache_folder, make_folder, warn_once
from vibroimpact.jit.watching import watched
from vibroimpact.jit.way import WAY

if WAY.name == "private":
    from vibroimpact.jit.hooks import dispatcher

_config: Any = numba.config  # its settings are made at run time, unknown to a type checker
if _config.DISABLE_JIT:
    raise ImportError("vibroimpact needs numba's compiler, which NUMBA_DISABLE_JIT turns off")


#: Default number of threads: one for each core of the process, or the value of the variable
#: NUMBA_NUM_THREADS.
ALL_THREADS: int = _config.NUMBA_NUM_THREADS

T = TypeVar("T")


#: In these modules an array belongs to the caller, and the references to it are not counted: with
#: them an impact costs twice as much.
_BORROWING = (
    "vibroimpact.destination.",
    "vibroimpact.jit.trial.",
    "vibroimpact.kernel.",
    "vibroimpact.step.",
)
#: These parts of theirs create arrays, so they count.
_CREATING = (
    "vibroimpact.jit.trial._take",
    "vibroimpact.step.contact.",
    "vibroimpact.step.recorder.",
)


def jit(function: Callable) -> Any:
    """Compile a function with the options of this project, cached on disk."""
    return _compiled(function)


def inlined(function: Callable) -> Any:
    """Compile a function once for each type of its arguments, and let LLVM merge it into callers.

    So no call ends the vectorisation of a loop.
    """
    return _compiled(function, forceinline=True)


def specialised(function: Callable) -> Any:
    """Merge a function into its compiled callers before types are inferred, so anew for each call.

    It takes longer to compile than ``inlined``. It is for functions that take functions, return
    records, or have branches that constant arguments exclude, which are not compiled.
    """
    return _compiled(function, inline="always")


def _compiled(function: Callable, **inlining: Any) -> Any:
    """Compile a function in the way of this process."""
    options: dict[str, Any] = {
        "error_model": "numpy",  # with Python's a division may raise, and no loop is vectorised
        "nogil": True,  # so that several threads compute, and the main thread receives signals
        **inlining,
    }
    if WAY.name != "plain":
        name = f"{function.__module__}.{function.__qualname__}"
        counted = not name.startswith(_BORROWING) or name.startswith(_CREATING)
        options |= {"_nrt": counted, "no_cfunc_wrapper": True}  # no C code calls the function
    if WAY.name == "private":
        return dispatcher(function, options)
    return _public(function, options)


def _public(function: Callable, options: dict[str, Any]) -> Any:
    """Compile without private parts, and with numba's cache in the folder of this code."""
    folder, before = cache_folder(WAY.name), _config.CACHE_DIR
    try:
        make_folder(folder)
        _config.CACHE_DIR = str(folder)
        return numba.njit(function, cache=True, **options)
    except OSError as error:
        warn_once(folder, "kept", error.strerror or type(error).__name__)
        return numba.njit(function, **options)
    finally:
        _config.CACHE_DIR = before


class ProcessorWarning(UserWarning):
    """The processor lacks what makes the code fast; the text is one line for the user."""


@cache
def _warn_without_fma() -> None:
    """Warn, once per process, if the C library computes ``fma`` in software.

    Only x86 has processors without it: kvm64 and other virtual ones, and older Atoms. A sum of
    branch-free operations in place of ``fma`` would be a second arithmetic for them alone.
    """
    there = llvmlite.binding.get_host_cpu_features()
    if not (there.get("fma", True) or there.get("fma4", False)):
        warnings.warn(
            "this processor has no fused multiply-add (FMA), so that a run takes hundreds of times "
            "as long as on others; in a virtual machine, choose the processor type 'host'",
            ProcessorWarning,
            stacklevel=3,
        )


def _in_one_frame(function: Any, types: Any) -> None:
    """Compile in a frame with room for all frames in it."""
    function.compile(types)


# Else, where Python's stack begins a new piece, each of 100,000 calls maps and unmaps that piece.
_in_one_frame.__code__ = _in_one_frame.__code__.replace(co_stacksize=140_000)


def compiled(function: Any, *arguments: Any) -> Any:
    """Compile a function for such arguments, in less time than its first call takes; return it."""
    _warn_without_fma()
    if not function.overloads:  # its types are the same at every call; to find them takes .27 ms
        collecting = gc.isenabled()
        gc.disable()  # it would free next to nothing, and take a tenth of the time
        try:
            _in_one_frame(function, tuple(map(numba.typeof, arguments)))
        finally:
            if collecting:
                gc.enable()
    return function


def translate(function: Any, *arguments: Any) -> None:
    """Translate a function, for such arguments, for the functions that will call it."""
    function.get_call_template(tuple(map(numba.typeof, arguments)), {})


@contextmanager
def called_before_passes(check: Callable[[], None]) -> Iterator[None]:
    """Call `check` before every pass of the compiler in the block, so that it can end the work.

    Like every watcher it is called, too, while another process compiles the same code.
    """
    try:
        from numba.core.event import Listener, install_listener
    except ImportError:  # in another version; then a compilation runs to its end
        yield
        return

    class Check(Listener):
        def on_start(self, event: object) -> None:
            check()

        def on_end(self, event: object) -> None:
            pass

    with watched(lambda *_: check()), install_listener("numba:run_pass", Check()):
        yield


def on_threads(
    threads: int, interrupt: np.ndarray, function: Callable[..., T], *arguments: object
) -> list[T]:
    """Call a function on `threads` threads, and return the list of their results.

    The caller only waits, because Python receives no signal while its main thread is in compiled
    code. Whatever ends the wait, for example Ctrl-C, sets `interrupt`, which the function checks.

    The threads exist only during the call. So a forked process lacks none of them, and calls from
    several threads do not interfere.
    """
    calls: list[Future[T]] = []
    with ThreadPoolExecutor(threads) as pool:
        try:
            with suppress(RuntimeError):  # if no more threads can start, the others do the work
                for _ in range(threads):
                    calls.append(pool.submit(function, *arguments))
            return [call.result() for call in calls] or [function(*arguments)]
        except BaseException:
            interrupt[0] = 1
            raise
