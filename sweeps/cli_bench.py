"""The commands below ``vibroimpact bench``: arguments and exit codes only."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, NoReturn

import typer

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Measure the methods: accuracy against speed, and stability.",
)

FAILED, REFUSED = 1, 2


def _stop(code: int, error: object) -> NoReturn:
    typer.echo(f"vibroimpact: error: {error}", err=True)
    raise typer.Exit(code)


@app.command("accuracy-speed")
def accuracy_speed(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FIGURE", help="The picture to write.")
    ] = Path("accuracy-speed.png"),
    table: Annotated[
        Path | None,
        typer.Option("--csv", metavar="FILE", help="Write every measurement as a row, too."),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Measure less, in under a minute.")
    ] = False,
    threads: Annotated[
        int, typer.Option(metavar="N", help="Threads of the kernel; the peers have one.")
    ] = 1,
) -> None:
    """Chart the accuracy of every method against its speed."""
    from rich.console import Console

    from sweeps.bench import work_precision
    from sweeps.bench.accuracy_speed import FULL, QUICK, measure
    from sweeps.bench.accuracy_tables import tables
    from sweeps.bench.peers import PEERS
    from sweeps.plotting import PlotError, check_picture
    from sweeps.plotting_accuracy import draw

    _check_threads(threads)
    try:
        check_picture(output)
    except PlotError as error:
        _stop(REFUSED, error)
    if table is not None and not (table.suffix == ".csv" and table.parent.is_dir()):
        _stop(REFUSED, f"--csv {table} is not allowed; expected: a .csv file in an existing folder")
    measured = measure(QUICK if quick else FULL, threads, progress=True)
    measured += work_precision.means(measured)
    orders = work_precision.orders(measured)
    for peer in PEERS.values():
        if not peer.installed:
            typer.echo(f"{peer.name} is not installed, so it is not on the chart", err=True)
    for title, rows in tables(measured, orders):
        typer.echo(title)
        Console(width=110).print(rows)
    try:
        draw(measured, orders, output)
        typer.echo(output)
        if table is not None:
            work_precision.write_csv(measured, orders, table)
            typer.echo(table)
    except (PlotError, OSError) as error:
        _stop(FAILED, error)


def _check_threads(threads: int) -> None:
    import numba

    cores: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    if not 1 <= threads <= cores:
        _stop(
            REFUSED, f"--threads {threads} is not allowed; expected: an integer from 1 to {cores}"
        )
