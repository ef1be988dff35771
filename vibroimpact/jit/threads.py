"""Compiled code on threads, which a signal can end."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from typing import TypeVar

import numpy as np

T = TypeVar("T")


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
