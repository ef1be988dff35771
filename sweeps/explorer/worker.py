"""A thread that computes the newest request and cancels the older."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from sweeps.errors import SweepError
from sweeps.interrupts import Cancelled, check, this_thread
from vibroimpact.jit import called_before_passes


@dataclass(frozen=True)
class Step:
    """One piece of work."""

    name: str  # of the place in the page that it fills; a later step may have a better result
    key: Any  # determines the result; if its place has this or a better one, the step is skipped
    compute: Callable[[], Any]  # returns the result; called in the thread of the worker
    show: Callable[[Any, float], None]  # of the result and its seconds; in that of the document


class Worker(ThreadPoolExecutor):
    """One thread that computes the steps of the newest request one after the other.

    `post` runs a function in the thread of the document; `fail` is called there with the text of an
    error.
    """

    def __init__(
        self, post: Callable[[Callable[[], None]], None], fail: Callable[[str], None]
    ) -> None:
        super().__init__(1, "explore")
        self._post, self._fail = post, fail
        self._stale, self._closed = np.zeros((2, 1), np.int64)
        #: The result that each place holds, and those that it waits for, by their keys.
        self._done: dict[str, Any] = {}
        self._wanted: dict[str, list[Any]] = {}
        #: The current step: its name, whether it is the first of that name, and its start time.
        self.busy: tuple[str, bool, float] | None = None

    def ask(self, steps: Sequence[Step]) -> None:
        """Replace the waiting steps, and cancel the current one.

        The first step of a name is not cancelled, because it compiles.
        """
        self._stale[0] = 1
        self._wanted = {}
        for step in steps:
            self._wanted.setdefault(step.name, []).append(step.key)
        if not self._closed[0]:
            self._stale = np.zeros(1, np.int64)
            self.submit(self._take_all, steps, self._stale)

    def is_late(self, name: str) -> bool:
        """Whether a place still holds a result of an earlier request."""
        wanted = self._wanted.get(name, [])
        return bool(wanted) and self._done.get(name) not in wanted

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = True) -> None:
        """Cancel all steps, and end the thread."""
        self._closed[0] = self._stale[0] = 1
        super().shutdown(wait, cancel_futures=cancel_futures)

    def _take_all(self, steps: Sequence[Step], stale: np.ndarray) -> None:
        """Compute the steps of a request until a newer one arrives."""
        for i, step in enumerate(steps):
            if stale[0]:
                return
            keys = [later.key for later in steps[i:] if later.name == step.name]
            if self._done.get(step.name) not in keys:
                self._take(step, stale)

    def _take(self, step: Step, stale: np.ndarray) -> None:
        """Compute a step and post its result or its error, unless it is cancelled."""
        first = step.name not in self._done
        begin = perf_counter()
        self.busy = step.name, first, begin
        try:
            this_thread.flag = self._closed if first else stale
            check()
            with called_before_passes(check):  # a pass takes 3 s at most
                result = step.compute()
        except Cancelled:
            return
        except (SweepError, ValueError, ArithmeticError, MemoryError) as error:
            self._post(partial(self._fail, str(error) or type(error).__name__))
        else:
            self._post(partial(step.show, result, perf_counter() - begin))
        finally:
            self.busy = None
        self._done[step.name] = step.key
