"""`run_sweep`: compute the blocks, store them, show the progress, compile meanwhile."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Column

from sweeps.config.loading import load_config
from sweeps.config.sweep import SweepConfig
from sweeps.engine.cluster import ClusterComputer
from sweeps.engine.estimate import COMPILING_MEMORY, available_memory, expected_cost
from sweeps.engine.executors import LocalComputer
from sweeps.errors import Refused
from sweeps.grid import block_points
from sweeps.interrupts import check, raised_by_check
from sweeps.reports import plan
from sweeps.store.schema import Schema, refuse_columns
from sweeps.store.writer import sweep_writer
from sweeps.text import printable, progress_shown
from vibroimpact.inputs import FLAG, PATH, Allowed, integer
from vibroimpact.jit import ALL_THREADS, COMPILING, called_before_passes, watched
from vibroimpact.jit.cache import LONGEST_WAIT
from vibroimpact.jit.watching import WATCHERS
from vibroimpact.kernel.threads import compile_search

if TYPE_CHECKING:
    from distributed import Client


def _is_client(value: object) -> bool:  # nothing is one before Dask is imported
    return isinstance(value, getattr(sys.modules.get("distributed"), "Client", ()))


_ARGUMENTS = {
    "output": PATH,
    "threads": integer(1, ALL_THREADS),
    "client": Allowed(_is_client, "a distributed.Client"),
    **dict.fromkeys(("overwrite", "resume", "progress"), FLAG),
}


def run_sweep(
    config: SweepConfig | Mapping[str, Any] | str | Path,
    output: str | Path | None = None,
    *,
    threads: int | None = None,
    overwrite: bool = False,
    resume: bool = False,
    progress: bool = False,
    client: Client | None = None,
) -> Path:
    """Compute a sweep and write it, block by block.

    Parameters
    ----------
    config : SweepConfig, mapping, str or Path
        From `load_config`, or an argument for it: a mapping of the keys, or a YAML file.
    output : str or Path, optional
        The HDF5 file to write, instead of the output of the configuration.
    threads : int, optional
        Number of threads; all cores by default. The data do not depend on it. It is not allowed
        with a client, whose workers use their own threads.
    overwrite : bool
        Whether an existing file may be replaced.
    resume : bool
        Whether to compute the missing points of an existing file. The data are then the same, to
        the last bit, as after an uninterrupted run.
    progress : bool
        Whether to show the expected cost on stderr, and then the points done, the forcing periods
        per second, if all points have the same number, and the time left.
    client : distributed.Client, optional
        Compute on the workers of its cluster. Only this process writes the file, block by block as
        on one machine. A run started on one machine can be resumed on a cluster, and vice versa.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    ConfigError
        As raised by `load_config`.
    StoreError
        If the output is refused, is being written by another process or belongs to another
        sweep, or if there is too little disk space or memory.
    Refused
        If a worker has another version of the numerics.
    Failed
        If the output cannot be written, the scheduler is lost, or a block fails on a worker. All
        finished blocks are kept.
    ValueError
        If `threads` is given with a client.

    Examples
    --------
    >>> import sweeps
    >>> omega = {"start": 2.6, "stop": 2.7, "num": 20}
    >>> scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": omega, "f": 1.0}}
    >>> sweeps.run_sweep(scene, "flip.h5", overwrite=True).name
    'flip.h5'
    """
    values = output, threads, client, overwrite, resume, progress
    for (name, allowed), value in zip(_ARGUMENTS.items(), values, strict=True):
        if value is not None or allowed is FLAG:
            allowed.checked(name, value, Refused)
    if client is not None and threads is not None:
        raise ValueError("threads is not allowed with a client, whose workers have their own")
    if not isinstance(config, SweepConfig):
        config = load_config(config)
    refuse_columns(config.columns)
    path = Path(output) if output is not None else config.output
    console = Console(
        stderr=True, quiet=not progress, soft_wrap=True, highlight=False, markup=False, emoji=False
    )
    with raised_by_check(), sweep_writer(path, overwrite=overwrite, resume=resume) as writer:
        computer = LocalComputer(threads) if client is None else ClusterComputer(client)
        beside = compiling_beside(threads, config.sweep.spec.period)
        with beside, progress_shown(f"estimating the cost of {config.name}", not progress):
            cost = expected_cost(config.sweep, path, computer, resume)
        text, units = config.to_yaml(table=False), config.units.model_dump()
        schema = Schema.of(config.sweep, cost.block, config.name, text, units, config.column_units)
        pending = writer.begin(schema)
        if pending is None:
            console.print(printable(f"{path} is complete: nothing was left to do"))
            return path
        remaining = sum(map(block_points, pending))
        console.print(printable(plan(config, path, cost, remaining)))
        if writer.damaged:
            console.print(f"damaged blocks, which are computed again: {writer.damaged}")
        with _progress(config, remaining, computer, console) as advance:
            with closing(computer.compute_blocks(config.sweep, pending, advance)) as blocks:
                for block, results in blocks:
                    check()
                    writer.write(block, results)
        writer.finish(compressed=config.compression != "none")
    return path


@contextmanager
def _progress(
    config: SweepConfig, remaining: int, computer: LocalComputer | ClusterComputer, console: Console
) -> Iterator[Callable[[int], None]]:
    """Show points done, forcing periods per second if known, time left; yield what advances."""
    periods = config.sweep.known_periods
    scaled = ", one f computed and the others scaled" if config.sweep.spec.scaled else ""
    name, start, count = printable(config.name) + scaled, time.monotonic(), 0
    names = Column(no_wrap=True, max_width=max(8, console.width - 62))  # the others need so much
    with Progress(
        TextColumn("{task.description}", markup=False, table_column=names),
        BarColumn(),
        MofNCompleteColumn(table_column=Column(no_wrap=True)),
        TextColumn("points  {task.fields[speed]}"),
        TimeRemainingColumn(table_column=Column(no_wrap=True)),
        console=console,
        disable=console.quiet,
    ) as bar:
        text, size = name + computer.place_text(), config.sweep.size
        task = bar.add_task(text, total=size, completed=size - remaining, speed="")

        def advance(points: int) -> None:
            nonlocal count
            count += points
            rate = count * (periods or 0) / (time.monotonic() - start)
            speed = f"{rate:,.0f} periods/s" if periods else ""
            bar.update(task, advance=points, description=name + computer.place_text(), speed=speed)

        yield advance


# What is compiled meanwhile


def compiling_beside(cores: int | None, classes: bool) -> AbstractContextManager[None]:
    """Let another process compile the search for `classes`, if any, beside exact impacts."""
    begin, several = cache(compile_beside), min(cores or ALL_THREADS, ALL_THREADS) > 1

    def watch(text: str, function: str) -> None:
        if text == COMPILING and function.startswith("run_exact") and classes and several:
            begin()

    return watched(watch)


def compile_beside() -> None:
    """Let a copy of this process compile the search for classes, if there is enough memory for it.

    It begins with all that this process has imported, and with what both compile. Only Linux copies
    a process whose libraries run; there no other thread has a lock that the compiler takes, because
    this one has numba's own. Whatever comes of the copy, this process waits for that code, loads
    it, or compiles it itself.
    """
    if sys.platform != "linux" or available_memory() < 2 * COMPILING_MEMORY:
        return
    compile_search(begin=True)
    parent = os.getpid()
    try:
        with suppress(OSError, RuntimeError), warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of threads
            if copy := os.fork():
                threading.Thread(target=_reap, args=(copy,), daemon=True).start()
            else:
                _compile_for(parent)
    finally:
        if os.getpid() != parent:
            os._exit(0)


def _compile_for(parent: int) -> None:
    """Compile the search in a copy of a process, while that runs and waits for it."""

    def check() -> None:
        if os.getppid() != parent:
            raise SystemExit

    # A lock that another thread of the first process had stays locked here for ever.
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGALRM})
    signal.setitimer(signal.ITIMER_REAL, LONGEST_WAIT)
    WATCHERS.clear()
    signal.set_wakeup_fd(-1)
    nothing = os.open(os.devnull, os.O_RDWR)
    for file in range(3):
        os.dup2(nothing, file)
    os.closerange(3, 4096)  # hardly a process has more
    with called_before_passes(check):
        compile_search()


def _reap(process: int) -> None:
    """Wait for the end of a process."""
    with suppress(OSError):
        os.waitpid(process, 0)
