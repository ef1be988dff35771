"""Signals: `check` raises `Cancelled` where work can stop safely; threads without signals.

A signal handler that raises an exception may raise it between any two instructions of Python:
inside a lock of h5py, whose exit then fails, or in a callback of LLVM, which swallows the
exception. Therefore, while a sweep runs, the handlers of signals only set a flag, and
`check` raises `Cancelled` at known places: between two blocks, while a file is written or verified,
and while waiting for a result. Work in another thread has a flag of its own, which the kernel reads
as well.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

#: The names of the signals that end work: Ctrl-C, Ctrl-Break, and those by which a terminal, a
#: scheduler of jobs or a limit of processor time says that the end is near.
SIGNAL_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGUSR1", "SIGUSR2", "SIGXCPU", "SIGBREAK")
#: Those that the system has.
SIGNALS = [signal.Signals[name] for name in SIGNAL_NAMES if hasattr(signal, name)]
_came = False
#: Time after which `raised_at_once` raises again [s].
_AGAIN = 1.0


class _ThisThread(threading.local):
    """What belongs to the thread that asks."""

    #: Once it is set, `check` raises in this thread: an int64 array of shape (1,), or None.
    flag: np.ndarray | None = None


this_thread = _ThisThread()


class Cancelled(BaseException):
    """The work was cancelled by a signal, or because its result is no longer needed.

    It derives from ``BaseException``, so that libraries do not handle it as an ordinary error.
    """


def signal_came() -> bool:
    """Whether a signal was received."""
    return _came


def check() -> None:
    """Raise `Cancelled` if a signal was received or the flag of this thread is set."""
    flag = this_thread.flag
    if _came or (flag is not None and flag[0]):
        raise Cancelled


def without_waiting(path: str, flags: int) -> int:
    """Open a file, but do not wait for the writer of a FIFO, which no `check` could end."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def listen(came: Sequence[int] = ()) -> None:
    """Make the signals set the flag, except those that are ignored, for example by ``nohup``.

    Signals in `came` were received before; the list is read after the handlers are changed.
    """
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _set)
    if came:
        _set()


def ignore() -> None:
    """Ignore the signals, so that they cannot change the exit code of the process."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


@contextmanager
def raised_at_once() -> Iterator[None]:
    """Raise `Cancelled` in the block as soon as a signal arrives, not only at the next `check`.

    This is for work that writes nothing valuable, or that waits for others. It is raised again
    until the block ends: a callback of a library may swallow it, and it may come before the library
    can release a lock, for which the library waits when it closes its files.
    """
    main, running = threading.main_thread(), True
    is_main = threading.current_thread() is main
    noted = [number for number in SIGNALS if is_main and signal.getsignal(number) is _set]
    report = sys.unraisablehook

    def interrupt(number: int, _: object) -> None:
        _set()
        if running:  # an exception after the block would leave its handlers
            _thread.start_new_thread(repeat, (number,))  # without the locks of `threading`
            check()

    def repeat(number: int) -> None:
        time.sleep(_AGAIN)
        if running:  # only a true signal ends the wait for a lock
            kill = getattr(signal, "pthread_kill", lambda _, again: _thread.interrupt_main(again))
            kill(main.ident, number)

    def swallowed(unraisable: Any) -> None:
        if unraisable.exc_type is not Cancelled:
            report(unraisable)

    try:
        sys.unraisablehook = swallowed
        for number in noted:
            signal.signal(number, interrupt)
        check()
        yield
        check()
    finally:
        running = False
        for number in noted:
            signal.signal(number, _set)
        sys.unraisablehook = report


@contextmanager
def raised_by_check() -> Iterator[None]:
    """Make Ctrl-C set the flag in the block; KeyboardInterrupt is raised when the block stops.

    A program that has installed a handler of its own keeps it.
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


@contextmanager
def blocked_signals() -> Iterator[None]:
    """Block signals in the threads that are started in the ``with`` block, and in their processes.

    Ctrl-C in a terminal reaches all processes, but only this one should handle it. Windows has no
    signal mask; there the workers end with this process.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # if started later, it would unblock the signals
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _set(*_: object) -> None:
    global _came
    _came = True
