"""The items of a sweep on the workers of a Dask cluster, and their results back.

placeholder
"""

from __future__ import annotations

import math
import queue
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import metadata
from typing import TYPE_CHECKING, Any

import numba
import numpy as np

from sweeps.background import KERNEL, in_background
from sweeps.computer import Computer, Item, Local, Results, Work
from sweeps.config import SweepConfig
from sweeps.errors import ClusterError, ClusterFailure
from vibroimpact.jit import NUMERICS

if TYPE_CHECKING:
    from distributed import Client, Future

#: Items per worker at once: one is computed, one waits for it, one is on its way back.
_PER_WORKER = 3
#: How often the scheduler is asked for its workers [s].
_COUNT = 2.0
#: How long a worker may take to answer this process [s].
_CONNECT = 3.0

#: Work of one core in a block at least [s]: sending it takes 5 ms of processor time.
_LEAST_WORK = 0.5
#: Blocks that all workers together finish in a second at most: each takes 3 ms of the scheduler.
_BLOCK_RATE = 100
#: Blocks per core at least where that leaves work enough in each, so that all end together.
_BLOCKS_PER_CORE = 20


class OtherNumericsError(Exception):
    """A worker computes with another version of the code."""


@dataclass(frozen=True)
class _Job:
    """What all items have in common."""

    work: Work
    config: SweepConfig
    numerics: str


class Cluster:
    """Computes on the workers of a Dask client.

    Parameters
    ----------
    client : distributed.Client
        Synchronous; it is left open.

    Raises
    ------
    ClusterError
        If a worker has another version of the numerics, or none.
    """

    threads: int | None = 1

    def __init__(self, client: Client) -> None:
        self._client = client
        self._address = client.scheduler.address
        self._asked = -math.inf
        self._workers: dict[str, int] = {}
        self._direct: bool | None = None
        with self._scheduler_needed():
            self._count()
            self._refuse_others()

    @property
    def cores(self) -> int:
        """Threads of all workers; 1 while there is none."""
        return max(1, sum(self._workers.values()))

    def described(self) -> str:
        """Say on how many workers the sweep is computed."""
        number = len(self._workers)
        return f", on {number} worker{'s' * (number > 1)}" if number else ", waiting for a worker"

    def block_limits(self, seconds: float, size: int) -> Mapping[str, int]:
        """Return how large blocks are to be, so that sending them costs little."""
        together = max(_LEAST_WORK / self.cores, 1.0 / _BLOCK_RATE)
        least = math.ceil(together * size / seconds)
        return {"least": min(least, size), "blocks": _BLOCKS_PER_CORE * self.cores}

    def computed(
        self, work: Work, config: SweepConfig, items: Sequence[Item]
    ) -> Iterator[tuple[Item, Results]]:
        """Yield every item with its results, as they come in.

        Raises
        ------
        ClusterFailure
            If the scheduler is lost or an item cannot be computed. A lost worker is none: what it
            had is computed again.
        """
        futures: dict[Future, Item] = {}
        results = self._computed(work, config, iter(items), futures)
        try:
            yield from in_background(results, alone=False)
        finally:
            with suppress(Exception):  # where the scheduler is gone
                self._client.cancel(list(futures))

    def _computed(
        self,
        work: Work,
        config: SweepConfig,
        items: Iterator[Item],
        futures: dict[Future, Item],
    ) -> Iterator[tuple[Item, Results]]:
        _ = config.grid  # made here once, so that its values are the same on every machine
        job = _Job(work, config, _own())
        ready: queue.SimpleQueue[Future] = queue.SimpleQueue()
        with self._scheduler_needed():
            # A task, not data: what a lost worker held of a task's result is made again.
            shared = self._client.submit(_itself, job, pure=False)
            while self._refill(shared, items, futures, ready):
                try:
                    future = ready.get(timeout=_COUNT)
                except queue.Empty:
                    continue
                results = self._gathered(future)
                item = futures.pop(future)
                self._refill(shared, items, futures, ready)
                yield item, results

    def _refill(
        self,
        shared: Future,
        items: Iterator[Item],
        futures: dict[Future, Item],
        ready: queue.SimpleQueue[Future],
    ) -> bool:
        """Hand out items until every worker has enough; return whether any are out."""
        if time.monotonic() - self._asked > _COUNT:
            self._count()
        while len(futures) < _PER_WORKER * max(1, len(self._workers)):
            item = next(items, None)
            if item is None:
                break
            future = self._client.submit(_compute, shared, item, pure=False)
            futures[future] = item
            future.add_done_callback(ready.put)
        return bool(futures)

    def _count(self) -> None:
        self._workers = self._client.nthreads()
        self._asked = time.monotonic()

    def _gathered(self, future: Future) -> Results:
        """Fetch the results of a finished task from its worker.

        Past the scheduler where this process can reach the workers, which costs half as much.
        """
        from distributed import CancelledError

        if self._direct is None:
            self._direct = self._client.sync(_reaches, next(iter(self._workers), ""), self._client)
        try:
            results: Results = self._client.gather(future, direct=self._direct)
        except (CancelledError, OSError):
            raise
        except OtherNumericsError as error:
            raise ClusterFailure(str(error)) from error
        except Exception as error:
            text = f"{type(error).__name__}: {error}"
            raise ClusterFailure(f"a worker of {self._address} failed with {text}") from error
        future.release()  # so that the worker forgets the results
        return results

    @contextmanager
    def _scheduler_needed(self) -> Iterator[None]:
        """Turn the loss of the scheduler into a ClusterFailure."""
        from distributed import CancelledError

        try:
            yield
        except (CancelledError, OSError) as error:
            raise ClusterFailure(
                f"the scheduler {self._address} was lost (the run can go on with another one, or "
                "without --dask)"
            ) from error

    def _refuse_others(self) -> None:
        """Refuse workers that compute with another version of the code."""
        told = self._client.run(_asking(), on_error="return")
        for address, numerics in told.items():
            if numerics != _own():
                raise ClusterError(_other(address, str(numerics), _own()))


def computer_for(client: Client | None, threads: int | None) -> Computer:
    """Return what computes: the workers of a client, or so many threads of this machine."""
    return Local(threads) if client is None else Cluster(client)


def _own() -> str:
    """Name the code of this process that computes."""
    try:
        return f"{metadata.version('vibroimpact')} ({NUMERICS})"
    except metadata.PackageNotFoundError:
        return f"of a checkout ({NUMERICS})"


def _other(address: str, there: str, here: str) -> str:
    return (
        f"the worker {address} has another version of the numerics, {there}, than this process, "
        f"{here}; install the same version of vibroimpact and numba on both"
    )


def _asking() -> Callable[[], str]:
    """Return a function that also a worker without this package can be sent."""

    def numerics() -> str:
        try:
            from sweeps.cluster import _own
        except ImportError as error:
            return f"none ({error})"
        return _own()

    return numerics


async def _reaches(address: str, client: Client) -> bool:
    """Whether this process can connect to a worker."""
    from distributed.comm import connect

    try:
        comm = await connect(address, timeout=_CONNECT, **client.connection_args)
    except (OSError, ValueError):
        return False
    await comm.close()
    return True


def _itself(job: _Job) -> _Job:
    return job


def _compute(job: _Job, item: Any) -> Results:
    """Compute an item on a worker, with all threads that the worker has.

    It is alone in the kernel there: the other threads of the worker wait, and lend it their cores.
    """
    from distributed import get_worker

    worker = get_worker()
    if job.numerics != _own():
        raise OtherNumericsError(_other(worker.address, _own(), job.numerics))
    with KERNEL:
        available: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
        results = job.work(job.config, item, min(worker.state.nthreads, available))
        # What is sent as it lies in memory is not copied on the way.
        return {name: np.ascontiguousarray(array) for name, array in results.items()}
