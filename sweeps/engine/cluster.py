"""The blocks of a sweep on the workers of a Dask cluster.

Only the submitting process writes, and its folder is the only record of the finished blocks. So
commit, resume, interrupt, lock and checksums are the same code as on one machine, and a block that
is computed twice, because a worker was lost, is written once. If workers wrote files of their own,
they would need a shared file system.

The configuration is the result of a task on which the task of every block depends: it is sent to
each worker once, and computed again if the worker that holds it is lost. It includes the grid,
because another machine may round a logarithmic axis differently. A worker computes one block at a
time with all its threads and has at most three blocks assigned, so the memory of both sides does
not grow with the sweep. ``configs/clusters-and-ci.md`` reports the measured cost.
"""

from __future__ import annotations

import math
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from copy import copy
from typing import TYPE_CHECKING

import numba
import numpy as np

from sweeps.engine.executors import as_completed, compute_block
from sweeps.errors import Failed, Refused, SweepError
from sweeps.grid import Block, Sweep, block_points
from sweeps.interrupts import raised_at_once
from vibroimpact import __version__
from vibroimpact.jit import NUMERICS
from vibroimpact.points.stages import Results

if TYPE_CHECKING:
    from concurrent.futures import Future

    from distributed import Client

#: Blocks per worker at once: one is computed, one waits, and one is on its way back.
_PER_WORKER = 3
#: Interval between requests to the scheduler for its workers [s].
_COUNT = 2.0

#: Least work of one core in a block [s]: sending a block takes 5 ms of processor time.
_LEAST_WORK = 0.5
#: Most blocks that all workers finish in a second: each takes 3 ms of the scheduler.
_BLOCK_RATE = 100
#: Least number of blocks per core, if each has enough work, so that all cores end together.
_BLOCKS_PER_CORE = 20

#: The lock on a worker of the task that computes.
_KERNEL_LOCK = threading.Lock()


def is_client(value: object) -> bool:
    """Whether a value is a Dask client; nothing is if Dask is not installed."""
    try:
        from distributed import Client
    except ImportError:
        return False
    return isinstance(value, Client)


class ClusterComputer:
    """Computes blocks on the workers of a synchronous Dask client, which stays open.

    Raises Refused if a worker has another version of the numerics, or none.
    """

    threads = 1  #: Threads of a trial on this machine.

    def __init__(self, client: Client) -> None:
        self._client = client
        self._address = client.scheduler.address
        self._asked = -math.inf
        self._workers: dict[str, int] = {}
        with self._scheduler_needed():
            self._count()
            self._refuse_others()

    @property
    def cores(self) -> int:
        """Number of threads of all workers; 1 while there is no worker."""
        return max(1, sum(self._workers.values()))

    def described(self) -> str:
        """Return the number of workers in words, for the progress bar."""
        number = len(self._workers)
        return f" on {number} worker{'s' * (number > 1)}" if number else ", waiting for a worker"

    def block_limits(self, seconds: float, size: int) -> Mapping[str, int]:
        """Return arguments of `block_size`, so that sending blocks costs little."""
        together = max(_LEAST_WORK / self.cores, 1.0 / _BLOCK_RATE)
        least = math.ceil(together * size / seconds)
        return {"least": min(least, size), "blocks": _BLOCKS_PER_CORE * self.cores}

    def computed(
        self,
        sweep: Sweep,
        blocks: Iterable[Block],
        advance: Callable[[int], object] = lambda points: None,
    ) -> Generator[tuple[Block, Results], None, None]:
        """Yield every block with its results as they arrive, and report its points to `advance`.

        A caller that stops early must close the generator. Blocks of a lost worker are computed
        again. Raises Failed if the scheduler is lost or a block cannot be computed.
        """
        numerics, executor = _own_numerics(), self._client.get_executor(pure=False)
        with self._scheduler_needed():
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", "Sending large graph")  # once, of a long axis
                # A task, not data: it runs again if the worker that holds its result is lost.
                shared = self._client.submit(copy, sweep, pure=False)

            def submit(block: Block) -> Future[Results]:
                return executor.submit(_compute, shared, block, numerics)

            try:
                for block, future in as_completed(submit, blocks, self._most):
                    results = self._result(future)
                    advance(block_points(block))
                    yield block, results
            finally:
                with suppress(Exception):  # the scheduler may be lost
                    executor.shutdown(wait=False)

    def _most(self) -> int:
        """Return how many blocks may be pending, by the number of workers, updated regularly."""
        if time.monotonic() - self._asked > _COUNT:
            self._count()
        return _PER_WORKER * max(1, len(self._workers))

    def _count(self) -> None:
        """Ask the scheduler for its workers."""
        with raised_at_once():  # Dask checks no flag while it waits for an answer
            self._workers = self._client.nthreads()
        self._asked = time.monotonic()

    def _result(self, future: Future[Results]) -> Results:
        """Return the results of a finished block; raise Failed with the error of its worker."""
        error = future.exception()
        if error is None:
            return future.result()
        if isinstance(error, Failed):
            raise error
        text = f"{type(error).__name__}: {error}"
        raise Failed(f"a worker of {self._address} failed with {text}") from error

    @contextmanager
    def _scheduler_needed(self) -> Iterator[None]:
        """Raise Failed if the scheduler is lost in the block."""
        try:
            yield
        except SweepError:
            raise
        except Exception as error:
            if self._client.status == "running" and not isinstance(error, CancelledError | OSError):
                raise
            raise Failed(
                f"the scheduler {self._address} was lost, or dropped the work (the run can go on "
                "with another one, or without a cluster)"
            ) from error

    def _refuse_others(self) -> None:
        """Refuse workers that compute with another version of the code."""

        def numerics() -> str:  # imports inside, so that it also runs without this package
            try:
                from sweeps.engine.cluster import _own_numerics
            except ImportError as error:
                return f"none ({error})"
            return _own_numerics()

        versions = self._client.run(numerics, on_error="return")
        for address, version in versions.items():
            if version != _own_numerics():
                raise Refused(_difference(address, str(version), _own_numerics()))


def _own_numerics() -> str:
    """Return the version of the numerics of this process."""
    return f"{__version__} ({NUMERICS})"


def _difference(address: str, there: str, here: str) -> str:
    """Write the error about a worker with another version."""
    return (
        f"the worker {address} has another version of the numerics, {there}, than this process, "
        f"{here}; install the same version of vibroimpact and numba on both"
    )


def _compute(sweep: Sweep, block: Block, numerics: str) -> Results:
    """Compute a block on a worker, with all threads of the worker.

    Only one task of a worker computes at a time; its other threads wait and leave it their cores.
    """
    from distributed import get_worker

    worker = get_worker()
    if numerics != _own_numerics():
        raise Failed(_difference(worker.address, _own_numerics(), numerics))
    with _KERNEL_LOCK:
        available: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
        results = compute_block(sweep, block, min(worker.state.nthreads, available))
        # Contiguous arrays are sent without a copy.
        return {name: np.ascontiguousarray(array) for name, array in results.items()}
