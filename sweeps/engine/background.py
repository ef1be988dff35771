"""Compute the items of a run in a second thread, one item ahead of the main thread, which writes.

The main thread waits, and hears Ctrl-C and SIGTERM at once. If it leaves the items, because of a
signal or an error, it sets a flag. The kernel checks the flag in every forcing period, and numba
before each of its passes over a function: a pass takes two seconds at the most, of the 10 that a
first run compiles. So the second thread ends by itself.
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
    """Yield items that are computed in another thread, one ahead.

    Close the generator if you leave it early.

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
    """Run a function in another thread, as `in_background` does, and return its result."""
    (result,) = in_background(function(*arguments) for _ in range(1))
    return result


def _waited(future: Future[T]) -> T:
    """Wait for a result, and look up for signals meanwhile."""
    while not wait([future], _WAIT).done:
        check()
    return future.result()


@contextmanager
def given_up_by(flag: np.ndarray) -> Iterator[None]:
    """Inside the ``with`` block, end this thread's work by KeyboardInterrupt once `flag` is set.

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
    """Return the flag that ends the work of this thread, or None if the thread has no flag."""
    return getattr(_this_thread, "flag", None)


def check_given_up() -> None:
    """Raise KeyboardInterrupt if the work of this thread was given up."""
    flag = interrupt()
    if flag is not None and flag[0]:
        raise KeyboardInterrupt


class _Compilation(event.Listener):
    """Ends a compilation of work that was given up, before the next pass over a function."""

    def on_start(self, event: event.Event) -> None:
        check_given_up()

    def on_end(self, event: event.Event) -> None:
        pass


event.register("numba:run_pass", _Compilation())
