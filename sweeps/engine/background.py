"""What a run computes, in a thread of its own: one item ahead of the main one, which writes.

The main thread waits, and hears Ctrl-C and SIGTERM at once. Where it leaves the items, because of
a signal or an error, it sets a flag, which the kernel looks at in every forcing period, and numba
before each of its passes over a function: a pass takes two seconds at the most, of the 10 that a
first run compiles. So the thread ends by itself.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np
from numba.core import event

from sweeps.interrupts import check

T = TypeVar("T")

#: How often the main thread looks up [s]: a signal that another thread took does not wake it.
_WAIT = 0.1

_this_thread = threading.local()
_END: Any = object()


def in_background(items: Iterable[T], *, join: bool = True) -> Generator[T, None, None]:
    """Yield items that are computed in another thread, one ahead; to be closed where it is left.

    Parameters
    ----------
    items : iterable
    join : bool
        Whether to wait for the end of the thread when the items are left.

    Raises
    ------
    KeyboardInterrupt
        After a signal, while an item is waited for.
    """
    given_up = np.zeros(1, np.int64)
    iterator = iter(items)
    thread = ThreadPoolExecutor(1, initializer=setattr, initargs=(_this_thread, "flag", given_up))

    try:
        ahead = thread.submit(next, iterator, _END)
        while (item := _waited(ahead)) is not _END:
            ahead = thread.submit(next, iterator, _END)
            yield item
    finally:
        given_up[0] = 1
        thread.shutdown(wait=join, cancel_futures=True)


def run_in_background(function: Callable[..., T], *arguments: Any) -> T:
    """Return what a function returns, which runs in another thread as `in_background`."""
    (result,) = in_background(function(*arguments) for _ in range(1))
    return result


def _waited(future: Future[T]) -> T:
    """Wait for a result, and look up for signals meanwhile."""
    while not wait([future], _WAIT).done:
        check()
    return future.result()


@contextmanager
def given_up_by(flag: np.ndarray) -> Iterator[None]:
    """End the work of this thread in the block, with a KeyboardInterrupt, once `flag` is set.

    Parameters
    ----------
    flag : ndarray of int64, shape (1,)
        Another thread makes it non-zero.
    """
    _this_thread.flag = flag
    try:
        check_given_up()
        yield
    finally:
        _this_thread.flag = None


def interrupt() -> np.ndarray | None:
    """Return the flag that ends the work of this thread, for the kernel; None in any other."""
    return getattr(_this_thread, "flag", None)


def check_given_up() -> None:
    """Raise a KeyboardInterrupt in the thread of items that were left."""
    flag = interrupt()
    if flag is not None and flag[0]:
        raise KeyboardInterrupt


class _Compilation(event.Listener):
    """Ends a compilation for items that were left, before the next pass over a function."""

    def on_start(self, event: event.Event) -> None:
        check_given_up()

    def on_end(self, event: event.Event) -> None:
        pass


event.register("numba:run_pass", _Compilation())
