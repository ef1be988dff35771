"""What computes the blocks of a sweep: a thread here, or a Dask cluster (``cluster.py``).

The main thread only waits for results, and writes them. So it hears Ctrl-C and SIGTERM at once.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from itertools import islice
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numba.core import event

from sweeps.config.sweep import SweepConfig
from sweeps.engine.compute import Results, compute_block
from sweeps.grid import Block
from sweeps.interrupts import check, set_thread_flag
from vibroimpact.jit import ALL_THREADS
from vibroimpact.kernel.run import FEWEST_LANES

if TYPE_CHECKING:
    from distributed import Client

    from sweeps.engine.cluster import Cluster

T = TypeVar("T")
#: How often the main thread looks up [s]: a signal that another thread took does not wake it.
_WAIT = 0.1


class _Compilation(event.Listener):
    """Ends a cancelled compilation before the next pass over a function: each takes 3 s at most."""

    def on_start(self, event: event.Event) -> None:
        check()

    def on_end(self, event: event.Event) -> None:
        pass


@contextmanager
def cancelled_by(flag: np.ndarray) -> Iterator[None]:
    """In the block, end the work of this thread by `Cancelled` once `flag` is set."""
    set_thread_flag(flag)
    try:
        check()
        with event.install_listener("numba:run_pass", _Compilation()):
            yield
    finally:
        set_thread_flag(None)


class LocalExecutor(ThreadPoolExecutor):
    """One thread of this process, whose work is cancelled when the executor is shut down."""

    def __init__(self) -> None:
        super().__init__(1)
        self._cancelled = np.zeros(1, np.int64)

    def submit(self, function: Callable[..., T], /, *arguments: Any, **options: Any) -> Future[T]:
        """Call a function in the thread, after what was submitted before."""

        def call() -> T:
            with cancelled_by(self._cancelled):
                return function(*arguments, **options)

        return super().submit(call)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = True) -> None:
        """Cancel the work, and wait for the end of the thread."""
        self._cancelled[0] = 1
        super().shutdown(wait, cancel_futures=cancel_futures)


def in_thread(function: Callable[..., T], *arguments: Any) -> T:
    """Call a function in another thread, and look up for signals meanwhile."""
    with LocalExecutor() as executor:
        future = executor.submit(function, *arguments)
        while not wait([future], _WAIT).done:
            check()
        return future.result()


def completed(
    submit: Callable[[Block], Future[Results]], blocks: Iterable[Block], most: Callable[[], int]
) -> Iterator[tuple[Block, Future[Results]]]:
    """Submit blocks, so many at a time that `most` are out, and yield each once it is done."""
    remaining, out = iter(blocks), dict[Future[Results], Block]()
    while True:
        for block in islice(remaining, max(0, most() - len(out))):
            out[submit(block)] = block
        if not out:
            return
        wait(out, _WAIT, FIRST_COMPLETED)
        check()
        if done := next((future for future in out if future.done()), None):
            yield out.pop(done), done


class Local:
    """Computes blocks on this machine, one after the other, with so many threads; None for all."""

    cores = 1  #: Number of parallel computations, in units of one trial.

    def __init__(self, threads: int | None = None) -> None:
        self.threads = threads

    def computed(
        self, config: SweepConfig, blocks: Iterable[Block], advance: Callable[[int], object]
    ) -> Generator[tuple[Block, Results], None, None]:
        """Yield every block with its results, in order; `advance` is as for `compute_block`.

        One block is computed while another is written. Close the generator if you leave it early.
        """
        with LocalExecutor() as executor:

            def submit(block: Block) -> Future[Results]:
                return executor.submit(compute_block, config, block, self.threads, advance)

            for block, future in completed(submit, blocks, lambda: 2):
                yield block, future.result()

    def block_limits(self, seconds: float, size: int) -> Mapping[str, int]:
        """Return how large blocks are to be, so that every thread has points."""
        return {"least": min(size, FEWEST_LANES * (self.threads or ALL_THREADS))}

    def described(self) -> str:
        """Say nothing of where the work is done."""
        return ""


def computer_for(client: Client | None, threads: int | None) -> Local | Cluster:
    """Return what computes: the workers of a client, or so many threads of this machine."""
    if client is None:
        return Local(threads)
    from sweeps.engine.cluster import Cluster  # with Dask

    return Cluster(client)
