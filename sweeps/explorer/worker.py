"""A thread that computes the newest request, and cancels work that a newer request replaces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from sweeps.engine.executors import cancelled_by
from sweeps.errors import SweepError
from sweeps.interrupts import Cancelled


@dataclass(frozen=True)
class Step:
    """One piece of work.

    Attributes
    ----------
    name : str
        Of the place in the page that it fills; several steps may fill one, each better.
    key : object
        What the result depends on: a step is skipped if its place already holds this result or a
        better one of the same request.
    compute : callable
        Returns the result; in the thread of the worker.
    show : callable
        Is given the result and the seconds that it took; in the thread of the document.
    """

    name: str
    key: Any
    compute: Callable[[], Any]
    show: Callable[[Any, float], None]


class Worker(ThreadPoolExecutor):
    """One thread, which takes the steps of the newest request, one after the other.

    `post` runs a function in the thread of the document; `fail` is given the text of an error
    there.
    """

    def __init__(
        self, post: Callable[[Callable[[], None]], None], fail: Callable[[str], None]
    ) -> None:
        super().__init__(1, "explore")
        self._post, self._fail = post, fail
        self._stale, self._closed = np.zeros((2, 1), np.int64)
        self._done: dict[str, Any] = {}
        #: The name of the step that is computed, whether for the first time, and since when.
        self.busy: tuple[str, bool, float] | None = None

    def ask(self, steps: Sequence[Step]) -> None:
        """Replace what is to be done, and cancel what is being done.

        A step that is being computed for the first time is not cancelled: it compiles.
        """
        self._stale[0] = 1
        if not self._closed[0]:
            self._stale = np.zeros(1, np.int64)
            self.submit(self._take_all, steps, self._stale)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = True) -> None:
        """Cancel everything, and end the thread."""
        self._closed[0] = self._stale[0] = 1
        super().shutdown(wait, cancel_futures=cancel_futures)

    def _take_all(self, steps: Sequence[Step], stale: np.ndarray) -> None:
        """Take the steps of a request, until a newer one comes."""
        for i, step in enumerate(steps):
            if stale[0]:
                return
            keys = [later.key for later in steps[i:] if later.name == step.name]
            if self._done.get(step.name) not in keys:
                self._take(step, stale)

    def _take(self, step: Step, stale: np.ndarray) -> None:
        """Compute a step and post what it shows, unless it is cancelled."""
        first = step.name not in self._done
        begin = perf_counter()
        self.busy = step.name, first, begin
        try:
            with cancelled_by(self._closed if first else stale):
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
