"""Work in another thread, so that the main one hears Ctrl-C and SIGTERM at once.

The kernel runs a block to its end, which may take hours for one point of many periods, and Python
handles a signal only between two steps of the main thread.
"""

from __future__ import annotations

import queue
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from typing import Any, TypeVar

T = TypeVar("T")

#: Held by the thread that is in the kernel. Some of numba's threading layers cannot be entered from
#: two threads; so a run waits for the kernel of an interrupted one.
KERNEL = threading.Lock()


@dataclass(frozen=True)
class _End:
    """What ended the items: an error, or nothing."""

    error: BaseException | None = None


def in_background(items: Iterable[T], *, alone: bool = True) -> Iterator[T]:
    """Yield items that are computed in another thread, two ahead at the most.

    The thread is `alone` in the kernel, which items that do not enter it need not wait for. Where
    the iteration is left, it ends with its next item; a process need not wait for it.
    """
    ready: queue.Queue[T | _End] = queue.Queue(maxsize=1)
    left = threading.Event()

    def put(item: T | _End) -> None:
        while not left.is_set():
            try:
                return ready.put(item, timeout=0.1)
            except queue.Full:
                continue

    def work() -> None:
        try:
            with KERNEL if alone else nullcontext():
                for item in items:
                    put(item)
                    if left.is_set():
                        return
        except BaseException as error:
            put(_End(error))
        else:
            put(_End())

    threading.Thread(target=work, daemon=True).start()
    try:
        while not isinstance(item := ready.get(), _End):
            yield item
        if item.error is not None:
            raise item.error
    finally:
        left.set()


@contextmanager
def no_interrupt_lost() -> Iterator[Callable[[], None]]:
    """Yield a check that raises an interrupt which was swallowed, as in callbacks of LLVM or HDF5.

    It is raised at the end, too.
    """
    came = False

    def check() -> None:
        if came:
            raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield check
        return

    def noted(handler: Callable[..., object]) -> Callable[..., None]:
        def handle(number: int, frame: object) -> None:
            nonlocal came
            came = True
            handler(number, frame)

        return handle

    def report(unraisable: Any) -> None:
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            hook(unraisable)

    hook, sys.unraisablehook = sys.unraisablehook, report
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    for number, handler in before.items():
        if callable(handler):
            signal.signal(number, noted(handler))
    try:
        yield check
    finally:
        sys.unraisablehook = hook
        for number, handler in before.items():
            signal.signal(number, handler)
    check()
