"""One way to cancel work: a flag is set, and the work looks at it at places where it can end.

A handler of a signal that raises an exception raises it between any two steps of Python: inside a
lock of h5py, whose exit then fails, or in a callback of LLVM, which swallows the exception. So
while a sweep is run the handlers of Ctrl-C and SIGTERM only set a flag, and `check` raises
`Cancelled` at known places: between two blocks, while a file is written or verified, and while a
result is waited for. The work of another thread has a flag of its own, which also the kernel reads.

This file imports nothing that takes time: the command line listens for signals before it imports
anything else.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

_SIGNALS = [signal.SIGINT, signal.SIGTERM]
if sys.platform == "win32":
    _SIGNALS.append(signal.SIGBREAK)  # Ctrl-Break, and what ends a group of processes
_came = False
_this_thread = threading.local()


class Cancelled(BaseException):
    """The work was cancelled, because a signal came or nobody needs the result any more.

    It is no ``Exception``, so that no library takes it for a failure.
    """


def came() -> bool:
    """Whether a signal came."""
    return _came


def check() -> None:
    """Raise `Cancelled` if a signal came, or the flag of this thread is set."""
    flag = thread_flag()
    if _came or (flag is not None and flag[0]):
        raise Cancelled


def thread_flag() -> np.ndarray | None:
    """Return the flag that ends the work of this thread, or None if the thread has no flag."""
    return getattr(_this_thread, "flag", None)


def set_thread_flag(flag: np.ndarray | None) -> None:
    """Let `check` raise in this thread once `flag`, int64 of shape (1,), is set."""
    _this_thread.flag = flag


def listen() -> None:
    """Let both signals set the flag from now on, if they are not ignored, as under ``nohup``."""
    for number in _SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _set)


def ignore() -> None:
    """Let neither change how the process ends."""
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)


@contextmanager
def raised_at_once() -> Iterator[None]:
    """Raise where the block is when a signal comes that otherwise sets the flag.

    This is for work that writes nothing of value, or waits for others.
    """
    noted = [number for number in _SIGNALS if signal.getsignal(number) is _set]
    if threading.current_thread() is not threading.main_thread():
        noted = []
    try:
        for number in noted:
            signal.signal(number, _raise)
        check()
        yield
        check()  # where it was swallowed
    finally:
        for number in noted:
            signal.signal(number, _set)


@contextmanager
def raised_by_check() -> Iterator[None]:
    """Let Ctrl-C set the flag in the block, which then ends by KeyboardInterrupt as without it.

    In the main thread, and only where the handler of Python itself would raise: another program
    that has handlers of its own keeps them.
    """
    global _came
    if (
        threading.current_thread() is not threading.main_thread()
        or signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    ):
        yield
        return
    signal.signal(signal.SIGINT, _set)
    try:
        yield
        check()
    except Cancelled:
        raise KeyboardInterrupt from None
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        _came = False


def _set(*_: object) -> None:
    global _came
    _came = True


def _raise(*_: object) -> Any:
    _set()
    check()
