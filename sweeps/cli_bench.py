"""The commands below ``vibroimpact bench``: arguments and exit codes only."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Measure the methods: accuracy against speed, and stability.",
)


@app.command()
def paper(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FIGURE", help="The picture to write.")
    ] = Path("paper.png"),
) -> None:
    """Show what the paper claims, and what it does not say."""
    from rich.console import Console

    from sweeps.bench import paper
    from sweeps.bench.paper_tables import tables
    from sweeps.plotting import PlotError, check_picture
    from sweeps.plotting_paper import draw

    try:
        check_picture(output)
        measured = paper.measure()
        for title, table in tables(measured):
            typer.echo(title)
            Console().print(table)
        draw(measured, output)
    except PlotError as error:
        typer.echo(f"vibroimpact: error: {error}", err=True)
        raise typer.Exit(2) from None
    typer.echo(output)


@app.command()
def speed(
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer points and periods, in ten seconds.")
    ] = False,
) -> None:
    """Show the forcing periods per second of this machine, and the share of its peak."""
    from rich.console import Console

    from sweeps.bench import speed
    from sweeps.bench.speed_tables import table

    title, rows = table(speed.measure(quick, progress=True))
    typer.echo(title)
    Console().print(rows)
