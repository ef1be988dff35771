"""Ctrl-C and SIGTERM set a flag, and the work checks the flag at places where it can end.

A handler that raises an exception raises it between any two steps of Python: inside a lock of h5py,
whose exit then fails, or in a callback of LLVM, which swallows the exception. So while a sweep is
run the handlers only set the flag, and `check` raises ``KeyboardInterrupt`` at known places:
between two blocks, while a file is written or verified, and while the kernel computes.

This file imports nothing that takes time: the command line listens for signals before it imports
anything else.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_came = False


def came() -> bool:
    """Whether a signal came."""
    return _came


def check() -> None:
    """Raise an interrupt that came.

    Raises
    ------
    KeyboardInterrupt
    """
    if _came:
        raise KeyboardInterrupt


def listen() -> None:
    """Let both signals set the flag from now on, if they are not ignored, as under ``nohup``."""
    _handle(_set)


def ignore() -> None:
    """Let neither change how the process ends."""
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)


@contextmanager
def raised_at_once() -> Iterator[None]:
    """Raise where the block is, when a signal comes: for work that writes nothing of value."""
    before = _handle(_raise)
    try:
        check()
        yield
        check()  # where it was swallowed
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def raised_by_check() -> Iterator[None]:
    """Let Ctrl-C set the flag in the block, and raise at its end if nothing else has raised it.

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
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        _came = False


def _handle(handler: Any) -> dict[int, Any]:
    """Install a handler for the signals that are not ignored; return the handlers before."""
    before: dict[int, Any] = {number: signal.getsignal(number) for number in _SIGNALS}
    heard = {number: was for number, was in before.items() if was is not signal.SIG_IGN}
    for number in heard:
        signal.signal(number, handler)
    return heard


def _set(*_: object) -> None:
    global _came
    _came = True


def _raise(*_: object) -> None:
    _set()
    check()
