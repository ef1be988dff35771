"""The numbers of ``sweeps.bench.speed`` as a table for the terminal."""

from __future__ import annotations

from rich import box
from rich.table import Table

from sweeps.bench.speed import PER_STEP, Measured


def table(measured: Measured) -> tuple[str, Table]:
    """Return the title and the table of what `speed.measure` returned."""
    threads = list(next(iter(measured.speeds.values())).periods)
    rows = Table(box=box.SIMPLE_HEAD)
    rows.add_column("impact rule", no_wrap=True)
    rows.add_column("steps", justify="right")
    for count in threads:
        rows.add_column("one thread" if count == 1 else f"{count} threads", justify="right")
    if len(threads) > 1:
        rows.add_column("speed-up", justify="right")
    rows.add_column("of peak", justify="right")
    for name, speed in measured.speeds.items():
        rates = [speed.periods[count] for count in threads]
        cells = [f"{rate / 1e6:.3g}" for rate in rates]
        if len(threads) > 1:
            cells.append(f"{rates[-1] / rates[0]:.2f}")
        rows.add_row(name, str(speed.steps), *cells, f"{speed.share:.1%}")
    title = (
        "Million forcing periods per second; steps per period; share of one thread's peak,\n"
        f"{measured.peak / 1e9:.3g}e9 multiply-adds per second, of which a step takes {PER_STEP}"
    )
    return title, rows
