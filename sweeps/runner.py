"""The run of a sweep: blocks of points through the kernel into the store, with progress."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)

from sweeps.config import SweepConfig
from sweeps.pilot import choose
from sweeps.store import SweepWriter
from sweeps.variables import bytes_per_point
from vibroimpact.attractors import integrate
from vibroimpact.diagnostics import period_class
from vibroimpact.lanes import LANES
from vibroimpact.oscillator import POINT
from vibroimpact.trajectory import trajectories

#: Results of one block held in memory at most [bytes].
_BLOCK_MEMORY = 64 * 2**20
#: Time steps of one block at most, all points together, so that it takes about a second.
_BLOCK_STEPS = 200_000_000
#: A sweep is reported and written in at least this many blocks where it has the points.
_BLOCKS = 50


def run_sweep(
    config: SweepConfig,
    output: str | Path | None = None,
    *,
    threads: int | None = None,
    overwrite: bool = False,
    progress: bool = False,
) -> Path:
    """Compute a sweep and write it, block by block.

    Parameters
    ----------
    config : SweepConfig
        From `load_config`. Where it gives an accuracy, a pilot chooses the method, and the file
        keeps the method with the record of the pilot.
    output : str or Path, optional
        The HDF5 file to write, instead of the configuration's.
    threads : int, optional
        Threads to use; all cores by default. The data do not depend on it.
    overwrite : bool
        Whether an existing file may be replaced.
    progress : bool
        Whether to show points done, forcing periods per second and time left on stderr.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    StoreError
        If the output is refused or cannot be written.
    """
    path = Path(output) if output is not None else config.output
    with _no_interrupt_lost() as check:
        pilot = None
        if config.method.accuracy is not None:
            pilot = choose(config, threads)
            config = config.with_method(pilot.method)
            if progress:
                print(pilot.summary, file=sys.stderr)
        writer = SweepWriter(
            path,
            config.grid,
            name=config.name,
            configuration=config.to_yaml(),
            pilot=pilot.record if pilot else None,
            widths=config.widths,
            first_section=config.record.transient + 1,
            diagnostics=config.record.diagnostics,
            overwrite=overwrite,
        )
        with writer, _Display(config, shown=progress) as display:
            _compute(config, np.empty(0, POINT), threads)  # compiles, if need be
            check()
            display.start_clock()
            for block in config.grid.blocks(block_size(config)):
                points = config.grid.points(block)
                writer.write(block, _compute(config, points, threads))
                display.advance(points.size)
                check()
    return path


def block_size(config: SweepConfig) -> int:
    """Return the points per block: few enough for memory, and for signs of progress."""
    record = config.record
    memory = bytes_per_point(config.widths, record.diagnostics)
    if record.trajectory:  # the logs that the samples are taken from, with room for impacts
        memory += 32 * (config.widths["sample"] + 8 * record.periods)
    fits = max(1, _BLOCK_MEMORY // memory)
    work = _BLOCK_STEPS // ((record.transient + record.periods) * config.steps)
    wanted = min(max(config.grid.size // _BLOCKS, 4 * LANES), max(work, 2 * LANES))
    # Whole blocks of lanes, where there is room for one: a short one costs as much as a full one.
    return min(fits, wanted) // LANES * LANES or fits


def _compute(config: SweepConfig, points: np.ndarray, threads: int | None) -> dict[str, np.ndarray]:
    """Run the points of one block; the names of the results are those of the store."""
    method, record = config.method, config.record
    common: dict[str, Any] = {
        "integrator": method.integrator,
        "impact": method.impact,
        "steps_per_period": config.steps,
        "transient": record.transient,
        "periods": record.periods,
        "phase": record.phase,
    }
    results = integrate(
        points,
        impacts=record.impacts,
        lyapunov="lyapunov" in record.diagnostics,
        threads=threads,
        **common,
    )
    if "period" in record.diagnostics:
        found = period_class(
            results["poincare_x"], results["poincare_v"], results["impacts_per_period"]
        )
        results |= dict(zip(("period", "period_impacts"), found, strict=True))
    if record.trajectory:
        results |= trajectories(points, every=record.trajectory.every, **common)
    return results


@contextmanager
def _no_interrupt_lost() -> Iterator[Callable[[], None]]:
    """Yield a check that raises an interrupt which was swallowed, as in callbacks of LLVM or HDF5.

    It is raised at the end, too.
    """
    came = False

    def check() -> None:
        if came:
            raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield check
        return

    def noted(handler: Callable[..., object]) -> Callable[..., None]:
        def handle(number: int, frame: object) -> None:
            nonlocal came
            came = True
            handler(number, frame)

        return handle

    def report(unraisable: Any) -> None:
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            hook(unraisable)

    hook, sys.unraisablehook = sys.unraisablehook, report
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    for number, handler in before.items():
        if callable(handler):
            signal.signal(number, noted(handler))
    try:
        yield check
    finally:
        sys.unraisablehook = hook
        for number, handler in before.items():
            signal.signal(number, handler)
    check()


class _Display:
    """A progress line on stderr: points done, forcing periods per second, time left."""

    def __init__(self, config: SweepConfig, shown: bool) -> None:
        self._periods = config.record.transient + config.record.periods
        self._size = config.grid.size
        self._name = config.name
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("points  {task.fields[speed]}"),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            disable=not shown,
        )
        self._task = TaskID(0)
        self._began = 0.0
        self._done = 0

    def __enter__(self) -> _Display:
        self._bar.start()
        self._task = self._bar.add_task(
            "compiling (kept for the next run)", total=self._size, speed=""
        )
        return self

    def start_clock(self) -> None:
        """Time the sweep from here; compilation is not part of its speed."""
        self._began = time.monotonic()

    def advance(self, points: int) -> None:
        """Count the points of a finished block."""
        self._done += points
        elapsed = time.monotonic() - self._began
        speed = self._done * self._periods / elapsed
        self._bar.update(
            self._task,
            advance=points,
            description=self._name,
            speed=f"{speed:,.0f} forcing periods/s",
        )

    def __exit__(self, *_: object) -> None:
        self._bar.stop()
