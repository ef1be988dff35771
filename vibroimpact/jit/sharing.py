"""Processes that need the same compiled code at once: one compiles it, and the others wait."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from vibroimpact.jit.cache import make_folder

#: Longest wait for another process [s], many times that of a compilation: it may be stopped.
_LONGEST_WAIT = 120.0
_INTERVAL = 0.05  # between two attempts [s]

#: Called while this process waits; each may raise an exception, which ends the wait.
CHECKS: list[Callable[[], object]] = []
#: Called with what is done in the words of a user: at its begin, and with ``""`` at its end.
WATCHERS: list[Callable[[str], object]] = []


@contextmanager
def watched(watcher: Callable[[str], object]) -> Iterator[None]:
    """Tell `watcher` of every compilation, and wait for one, that begins or ends in the block."""
    WATCHERS.append(watcher)
    try:
        yield
    finally:
        WATCHERS.remove(watcher)


def tell(text: str) -> None:
    """Tell every watcher."""
    for watcher in list(WATCHERS):
        watcher(text)


def claimed(path: Path) -> Any:
    """Wait until no other process compiles the code of the file `path`; return a lock.

    It is None if there is no lock to be had, or only after too long a wait. Then this process works
    without one: the same code is compiled twice, and the file is written whole in any case.
    """
    from filelock import FileLock, Timeout  # takes longer to import than code to load

    last = time.monotonic() + _LONGEST_WAIT
    try:
        make_folder(path.parent)
        lock = FileLock(path.with_suffix(".lock"))
        while True:
            with suppress(Timeout):
                return lock.acquire(blocking=False).lock
            if time.monotonic() > last:
                return None
            tell("waiting for another process, which compiles the same")
            for check in list(CHECKS):
                check()
            time.sleep(_INTERVAL)
    except (OSError, NotImplementedError):
        return None


def released(lock: Any) -> None:
    """Let other processes go on."""
    if lock is not None:
        with suppress(OSError):  # on Windows an open file cannot be removed
            Path(lock.lock_file).unlink(missing_ok=True)
        lock.release()
