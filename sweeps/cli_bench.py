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
def stability(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FIGURE", help="The picture to write.")
    ] = Path("stability.png"),
    csv: Annotated[
        Path | None, typer.Option("--csv", metavar="FILE", help="Write every figure to it.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Shorter runs, a coarser chart.")] = False,
) -> None:
    """Show how long a step may be, and where each method fails."""
    from rich.console import Console

    from sweeps.bench import failures, stability, stability_tables
    from sweeps.plotting import PlotError, check_picture
    from sweeps.plotting_stability import draw

    try:
        check_picture(output)
        if csv is not None and not csv.absolute().parent.is_dir():
            raise PlotError(f"the folder {csv.parent} of {csv.name} does not exist")
        limits, figures = stability.limits(quick), failures.measure()
        for part in stability_tables.report(limits, figures):
            Console().print(part)
        draw(stability.chart(quick), output)
        if csv is not None:
            stability_tables.write(csv, limits, figures)
    except (PlotError, OSError) as error:
        typer.echo(f"vibroimpact: error: {error}", err=True)
        raise typer.Exit(2 if isinstance(error, PlotError) else 1) from None
    typer.echo(output)
