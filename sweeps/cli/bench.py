"""The commands below ``vibroimpact bench``: arguments and exit codes only."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from sweeps.cli.options import check_csv, check_threads
from sweeps.cli.terminal import say
from sweeps.messages import Failed

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Measure the methods: accuracy, speed and stability.",
)

Figure = Annotated[
    Path, typer.Option("-o", "--output", metavar="FIGURE", help="The picture to write.")
]
Csv = Annotated[
    Path | None, typer.Option("--csv", metavar="FILE", help="Write every figure to it, too.")
]
Quick = Annotated[bool, typer.Option("--quick", help="Measure less, in under a minute.")]


@contextmanager
def _files(output: Path, csv: Path | None = None) -> Iterator[None]:
    """Refuse files that cannot be written before the work of the block, and say it after."""
    from sweeps.plotting.saving import check_picture

    check_picture(output)
    check_csv(csv)
    try:
        yield
    except OSError as error:
        raise Failed(error) from error
    for path in (output, csv):
        if path is not None:
            say(path)


@app.command("accuracy-speed")
def accuracy_speed(
    output: Figure = Path("accuracy-speed.png"),
    csv: Csv = None,
    quick: Quick = False,
    threads: Annotated[
        int, typer.Option(metavar="N", help="Threads of the kernel; the peers have one.")
    ] = 1,
) -> None:
    """Chart the accuracy of every method against its speed."""
    from rich.console import Console

    from sweeps.bench import work_precision
    from sweeps.bench.accuracy_picture import draw
    from sweeps.bench.accuracy_speed import FULL, QUICK, measure
    from sweeps.bench.accuracy_tables import tables
    from sweeps.bench.peers import PEERS

    check_threads(threads)
    with _files(output, csv):
        measured = measure(QUICK if quick else FULL, threads, progress=True)
        measured += work_precision.means(measured)
        orders = work_precision.orders(measured)
        for peer in PEERS.values():
            if not peer.installed:
                say(f"{peer.name} is not installed, so it is not on the chart", error=True)
        for title, rows in tables(measured, orders):
            say(title)
            Console(width=110).print(rows)
        draw(measured, orders, output)
        if csv is not None:
            work_precision.write_csv(measured, orders, csv)


@app.command()
def stability(
    output: Figure = Path("stability.png"), csv: Csv = None, quick: Quick = False
) -> None:
    """Show how long a step may be, and where each method fails."""
    from rich.console import Console

    from sweeps.bench import failures, stability, stability_tables
    from sweeps.bench.stability_picture import draw

    with _files(output, csv):
        limits, figures = stability.limits(quick), failures.measure()
        for part in stability_tables.report(limits, figures):
            Console().print(part)
        draw(stability.chart(quick), output)
        if csv is not None:
            stability_tables.write(csv, limits, figures)


@app.command()
def paper(output: Figure = Path("paper.png")) -> None:
    """Show what the paper claims, and what it does not say."""
    from rich.console import Console

    from sweeps.bench import paper
    from sweeps.bench.paper_picture import draw
    from sweeps.bench.paper_tables import tables

    with _files(output):
        measured = paper.measure()
        for title, table in tables(measured):
            say(title)
            Console().print(table)
        draw(measured, output)


@app.command()
def speed(quick: Quick = False) -> None:
    """Show the forcing periods per second of this machine, and the share of its peak."""
    from rich.console import Console

    from sweeps.bench import speed
    from sweeps.bench.speed_tables import table

    title, rows = table(speed.measure(quick, progress=True))
    say(title)
    Console().print(rows)
