"""A thread that computes the newest request, and abandons work that a newer request replaces."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from sweeps.engine.background import given_up_by
from sweeps.errors import SweepError


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


class Worker:
    """Takes the steps of the newest request, one after the other.

    Parameters
    ----------
    post : callable
        Runs a function in the thread of the document.
    fail : callable
        Is given the text of an error of a step, there.
    """

    def __init__(
        self, post: Callable[[Callable[[], None]], None], fail: Callable[[str], None]
    ) -> None:
        self._post, self._fail = post, fail
        self._changed = threading.Condition()
        self._steps: Sequence[Step] | None = None
        self._stale = np.zeros(1, np.int64)
        self._closed = np.zeros(1, np.int64)
        self._working = False
        self._done: dict[str, Any] = {}
        self._compiled: set[str] = set()
        #: The name of the step that is computed, whether for the first time, and since when.
        self.busy: tuple[str, bool, float] | None = None
        self._thread = threading.Thread(target=self._run, name="explore", daemon=True)
        self._thread.start()

    def ask(self, steps: Sequence[Step]) -> None:
        """Replace what is to be done, and give up what is being done.

        A step that is being computed for the first time is not given up: it compiles.
        """
        with self._changed:
            self._stale[0] = 1
            self._stale = np.zeros(1, np.int64)
            self._steps = steps
            self._changed.notify()

    @property
    def idle(self) -> bool:
        """Whether all that was asked for is done."""
        with self._changed:
            return self._steps is None and not self._working

    def close(self) -> None:
        """End the thread."""
        with self._changed:
            self._closed[0] = self._stale[0] = 1
            self._changed.notify()
        self._thread.join(2.0)

    def _run(self) -> None:
        """Take the steps of each request, until a newer one comes."""
        while True:
            with self._changed:
                self._working = False
                while self._steps is None and not self._closed[0]:
                    self._changed.wait()
                if self._closed[0]:
                    return
                steps, stale = self._steps or (), self._stale
                self._steps, self._working = None, True
            for i, step in enumerate(steps):
                if stale[0] or self._closed[0]:
                    break
                keys = [later.key for later in steps[i:] if later.name == step.name]
                if self._done.get(step.name) not in keys:
                    self._take(step, stale)

    def _take(self, step: Step, stale: np.ndarray) -> None:
        """Compute a step and post what it shows, unless it is given up."""
        first = step.name not in self._compiled
        begin = perf_counter()
        self.busy = step.name, first, begin
        try:
            with given_up_by(self._closed if first else stale):
                result = step.compute()
        except KeyboardInterrupt:
            return
        except (SweepError, ValueError, ArithmeticError, MemoryError) as error:
            self._post(partial(self._fail, str(error) or type(error).__name__))
        else:
            self._compiled.add(step.name)
            self._post(partial(step.show, result, perf_counter() - begin))
        finally:
            self.busy = None
        self._done[step.name] = step.key
