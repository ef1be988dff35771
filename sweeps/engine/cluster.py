"""Starts or reaches Dask at a typed address; `ClusterComputer` computes blocks on its workers.

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

import logging
import math
import os
import re
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from copy import copy
from typing import TYPE_CHECKING

import numpy as np

from sweeps.errors import Failed, Refused, SweepError
from sweeps.grid import Block, Sweep, block_points
from sweeps.interrupts import blocked_signals, check, raised_at_once
from sweeps.text import shortened
from vibroimpact import __version__
from vibroimpact.inputs import refusal
from vibroimpact.points.stages import Results

if TYPE_CHECKING:
    from concurrent.futures import Future

    from distributed import Client, LocalCluster

#: Longest wait for the answer of a scheduler [s].
_PATIENCE = 6

_ALLOWED = "tcp://HOST:PORT or tls://HOST:PORT of a Dask scheduler, or local:N for N processes here"
_SCHEDULER = re.compile(r"(tcp|tls)://(\[[0-9a-fA-F:]+\]|[\w.-]+):(\d{1,5})")


def check_address(address: str) -> None:
    """Refuse an address that `connected` does not accept, before it imports or starts anything."""
    if address.startswith("local:"):
        number, cores = address.removeprefix("local:"), os.cpu_count() or 1
        if re.fullmatch("[0-9]{1,9}", number) and 1 <= int(number) <= cores:
            return
        expected = f"local:N with an integer N from 1 to {cores}"
        raise Refused(refusal(f"the address {address}", expected))
    match = _SCHEDULER.fullmatch(address)
    if not match or not 1 <= int(match[3]) <= 65535:
        is_bare = _SCHEDULER.fullmatch(f"tcp://{address}")
        meant = f"; did you mean tcp://{address}?" if is_bare else ""
        raise Refused(refusal(f"the address {address!r}", _ALLOWED + meant))


@contextmanager
def connected(address: str) -> Iterator[Client]:
    """Yield a client of the cluster at an address, and silence all loggers meanwhile.

    `check_address` must have accepted the address: ``tls:`` takes the certificates of Dask's own
    configuration, and ``local:N`` starts N processes, and ends them. Raises Refused if Dask is not
    installed or no scheduler accepts the connection.
    """
    try:
        import distributed
    except ImportError:
        raise Refused(
            "a cluster needs Dask, which is not installed; install it with pip install "
            "'vibroimpact[distributed]', or in a clone pip install '.[distributed]'"
        ) from None
    with _quiet():
        if address.startswith("local:"):
            with _processes(int(address.removeprefix("local:"))) as cluster:
                with distributed.Client(
                    cluster, direct_to_workers=True, set_as_default=False
                ) as client:
                    yield client
            return
        _refuse_silence(address)
        with raised_at_once():  # Dask checks no flag while it waits for an answer
            registered = _registered(address)
        with registered as client:
            yield client


def _registered(address: str) -> Client:
    """Return a client that a scheduler has accepted."""
    import distributed

    class Client(distributed.Client):
        def __del__(self) -> None:
            """Skip Dask's wait for a scheduler that refused it; ``with`` closes all others."""

    try:
        return Client(address, timeout=_PATIENCE, set_as_default=False)
    except Exception as error:  # any program may answer at the address
        reason = shortened(str(error)) or f"no answer in {_PATIENCE} s"
        raise Refused(
            f"the Dask scheduler at {address} answers, but does not accept this process "
            f"({reason}); check its log, and whether it has the same version of Dask"
        ) from None


def _refuse_silence(address: str) -> None:
    """Refuse an address where no scheduler answers in time: a client would wait forever."""
    import asyncio

    from distributed import Security, rpc

    async def kind() -> str:
        """Ask the server at the address for its type."""
        arguments = Security().get_connection_args("client")
        async with rpc(address, timeout=2 * _PATIENCE, connection_args=arguments) as remote:
            return str((await remote.identity())["type"])

    async def awaited() -> str:
        """Check for signals while waiting for the answer."""
        task = asyncio.create_task(asyncio.wait_for(kind(), _PATIENCE))
        while not task.done():
            await asyncio.wait({task}, timeout=0.1)
            check()
        return task.result()

    try:
        server = asyncio.run(awaited())
        why = f"it is the address of a {shortened(server.lower())}"
    except TimeoutError:
        server, why = "", f"no answer in {_PATIENCE} s"
    except Exception as error:  # any program may answer at the address
        server, why = "", shortened(str(error), 200)
    if server != "Scheduler":
        advice = "start one with the command dask scheduler, or give the address that it shows"
        if address.startswith("tls:"):
            advice += "; the certificates are those of distributed.comm.tls in Dask's configuration"
        raise Refused(f"no Dask scheduler answers at {address} ({why}); {advice}")


@contextmanager
def _processes(number: int) -> Iterator[LocalCluster]:
    """Start workers with one thread each; at the end, kill them even in the middle of a task.

    Anybody who can connect to a Dask scheduler or worker can run code there. Therefore these
    processes communicate with a certificate that is made for this run and never leaves them, and
    they serve no web pages.
    """
    import dask
    from distributed import LocalCluster
    from distributed.security import Security

    try:
        security = Security.temporary()
    except ImportError:
        raise Refused(
            "local:N makes a certificate with the package cryptography, which is not "
            "installed; install it with pip install cryptography"
        ) from None
    settings = {
        # The profiler of the workers would interrupt the kernel a hundred times a second.
        "distributed.worker.profile.enabled": False,
        "distributed.scheduler.http.routes": [],
        "distributed.worker.http.routes": [],
    }
    with dask.config.set(settings), ExitStack() as stack:
        with blocked_signals():
            cluster = stack.enter_context(
                LocalCluster(
                    n_workers=number,
                    threads_per_worker=1,
                    host="127.0.0.1",
                    security=security,
                    scheduler_kwargs={"dashboard": False},
                    dashboard_address="127.0.0.1:0",  # any port: 8787 may be taken
                    silence_logs=logging.CRITICAL,
                )
            )
            stack.callback(_kill, cluster)
        yield cluster


def _kill(cluster: LocalCluster) -> None:
    """Kill the workers, which hold no data that is still needed."""
    import psutil

    for worker in list(cluster.workers.values()):
        worker.close_gracefully()  # so that it is not restarted
        with suppress(psutil.NoSuchProcess):
            if worker.pid is not None:  # psutil takes None for this process
                psutil.Process(worker.pid).kill()


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence all loggers, as of Dask and of what it is built on; errors report what matters."""
    before = logging.root.manager.disable
    logging.disable()
    try:
        yield
    finally:
        logging.disable(before)


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


class ClusterComputer:
    """Computes blocks on the workers of a synchronous Dask client, which stays open.

    Raises Refused if a worker has another version of the numerics, or none.
    """

    threads = 1  #: Threads of a trial on this machine.

    def __init__(self, client: Client) -> None:
        self._client = client
        self._address = client.scheduler.address
        with self._scheduler_needed():
            self._count()
            self._refuse_others()

    @property
    def cores(self) -> int:
        """Number of threads of all workers; 1 while there is no worker."""
        return max(1, sum(self._workers.values()))

    def place_text(self) -> str:
        """Return the number of workers in words, for the progress bar."""
        number = len(self._workers)
        return f" on {number} worker{'s' * (number > 1)}" if number else ", waiting for a worker"

    def block_limits(self, seconds: float, size: int) -> Mapping[str, int]:
        """Return arguments of `block_size`, so that sending blocks costs little."""
        together = max(_LEAST_WORK / self.cores, 1.0 / _BLOCK_RATE)
        least = math.ceil(together * size / seconds)
        return {"least": min(least, size), "blocks": _BLOCKS_PER_CORE * self.cores}

    def compute_blocks(
        self,
        sweep: Sweep,
        blocks: Iterable[Block],
        advance: Callable[[int], object] = lambda points: None,
    ) -> Generator[tuple[Block, Results], None, None]:
        """Yield every block with its results as they arrive, and report its points to `advance`.

        A caller that stops early must close the generator. Blocks of a lost worker are computed
        again. Raises Failed if the scheduler is lost or a block cannot be computed.
        """
        from sweeps.engine.executors import submit_blocks  # with the compiler

        numerics, executor = _local_numerics(), self._client.get_executor(pure=False)
        with self._scheduler_needed():
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", "Sending large graph")  # once, of a long axis
                # A task, not data: it runs again if the worker that holds its result is lost.
                shared = self._client.submit(copy, sweep, pure=False)

            def submit(block: Block) -> Future[Results]:
                return executor.submit(_compute, shared, block, numerics)

            try:
                for block, future in submit_blocks(submit, blocks, self._most):
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
            self._workers: dict[str, int] = self._client.nthreads()
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
                from sweeps.engine.cluster import _local_numerics

                return _local_numerics()
            except ImportError as error:
                return f"none ({error})"

        versions = self._client.run(numerics, on_error="return")
        for address, version in versions.items():
            if version != _local_numerics():
                raise Refused(_difference(address, str(version), _local_numerics()))


def _local_numerics() -> str:
    """Return the version of the numerics of this process."""
    from vibroimpact.jit import NUMERICS

    return f"{__version__} ({NUMERICS})"


def _difference(address: str, there: str, here: str) -> str:
    """Write the error about a worker with another version."""
    return (
        f"the worker {address} has another version of the numerics, {there}, than this process, "
        f"{here}; install the same version of vibroimpact and numba on both"
    )


def _compute(sweep: Sweep, block: Block, numerics: str) -> Results:
    """Compute a block on a worker, with all its threads, while no other task of it computes."""
    from distributed import get_worker

    from sweeps.engine.executors import compute_block
    from vibroimpact.jit import ALL_THREADS

    worker = get_worker()
    if numerics != _local_numerics():
        raise Failed(_difference(worker.address, _local_numerics(), numerics))
    with _KERNEL_LOCK:
        results = compute_block(sweep, block, min(worker.state.nthreads, ALL_THREADS))
        # Contiguous arrays are sent without a copy.
        return {name: np.ascontiguousarray(array) for name, array in results.items()}
