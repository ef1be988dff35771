"""The copy of a run that compiles on another core meanwhile, and what a run says then."""

from __future__ import annotations

import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache

from rich.console import Console

from sweeps.engine.estimate import COMPILING_MEMORY, available_memory
from vibroimpact.jit import ALL_THREADS, COMPILING, called_before_passes, watched
from vibroimpact.jit.cache import LONGEST_WAIT
from vibroimpact.jit.watching import WATCHERS
from vibroimpact.kernel.threads import compile_search


@contextmanager
def preparing(console: Console, cores: int | None, classes: bool) -> Iterator[None]:
    """Say what is compiled: on a terminal while it is, in a log in one line.

    If the loop of exact impacts is compiled here, and `classes` are asked for, another process
    compiles the search for them meanwhile, where a second core is allowed.
    """
    told, beside = {""}, cache(compile_beside)
    several = min(cores or ALL_THREADS, ALL_THREADS) > 1
    with console.status("preparing") as status:

        def watch(text: str, function: str) -> None:
            status.update(text or "preparing")
            if text not in told and not console.is_terminal:
                console.print(text)
            told.add(text)
            if text == COMPILING and function.startswith("run_exact") and classes and several:
                beside()

        with watched(watch):
            yield


def compile_beside() -> None:
    """Let a copy of this process compile the search for classes, if there is enough memory for it.

    It begins with all that this process has imported, and with what both compile. Only Linux copies
    a process whose libraries run; there no other thread has a lock that the compiler takes, because
    this one has numba's own. Whatever comes of the copy, this process waits for that code, loads
    it, or compiles it itself.
    """
    if sys.platform != "linux" or available_memory() < 2 * COMPILING_MEMORY:
        return
    compile_search(begin=True)
    parent = os.getpid()
    try:
        with suppress(OSError, RuntimeError), warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of threads
            if copy := os.fork():
                threading.Thread(target=_reap, args=(copy,), daemon=True).start()
            else:
                _compile_for(parent)
    finally:
        if os.getpid() != parent:
            os._exit(0)


def _compile_for(parent: int) -> None:
    """Compile the search in a copy of a process, while that runs and waits for it.

    Let go of its files first.
    """

    def check() -> None:
        if os.getppid() != parent:
            raise SystemExit

    # A lock that another thread of the first process had stays locked here for ever.
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGALRM})
    signal.setitimer(signal.ITIMER_REAL, LONGEST_WAIT)
    WATCHERS.clear()
    signal.set_wakeup_fd(-1)
    nothing = os.open(os.devnull, os.O_RDWR)
    for file in range(3):
        os.dup2(nothing, file)
    os.closerange(3, 4096)  # hardly a process has more
    with called_before_passes(check):
        compile_search()


def _reap(process: int) -> None:
    """Wait for the end of a process."""
    with suppress(OSError):
        os.waitpid(process, 0)
