"""Tells watchers of compilations, lets them end a wait for one; without the compiler itself."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

#: What a user is told of a compilation.
COMPILING = "compiling, which takes some ten seconds, once on this machine"
#: Called with what is done in the words of a user: at its begin, while it waits, and with ``""`` at
#: its end. Each may raise an exception, which ends the wait or the compilation.
WATCHERS: list[Callable[[str, str], object]] = []


@contextlib.contextmanager
def watched(watcher: Callable[[str, str], object]) -> Iterator[None]:
    """Tell `watcher` of every compilation, and wait for one, that begins or ends in the block."""
    WATCHERS.append(watcher)
    try:
        yield
    finally:
        WATCHERS.remove(watcher)


def tell(text: str, function: str = "") -> None:
    """Tell every watcher, and of a compilation its function."""
    for watcher in list(WATCHERS):
        watcher(text, function)
