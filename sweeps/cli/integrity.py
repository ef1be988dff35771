"""The command ``integrity``: arguments and exit codes only.

As in ``main.py``, what a command needs is imported inside it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sweeps.cli.options import SweepFile, check_csv, named, say, say_moved, selection_of


def integrity(
    file: SweepFile,
    at: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="Where to look along a parameter; repeatable."),
    ] = None,
    weight: Annotated[
        float | None,
        typer.Option(metavar="W", help="Of v in distances [time]; 1 / p if not given."),
    ] = None,
    csv: Annotated[
        Path | None, typer.Option("--csv", metavar="FILE", help="Write the table to it.")
    ] = None,
) -> None:
    """Show how large a disturbance each attractor takes, and at one point how hard a knock."""
    from sweeps.analysis import integrity as measures
    from sweeps.analysis.attractor_table import cut
    from sweeps.analysis.knocks import knocks
    from sweeps.analysis.selection import config_of, on_grid
    from sweeps.analysis.tables import write_csv
    from sweeps.store import open_sweep

    cuts = selection_of(at)
    check_csv(csv)
    with open_sweep(file) as dataset, named(file):
        shown = cut(dataset, cuts)
        found = measures.integrity(shown, weight)
        if not found["attractors"].ndim and config_of(dataset).method.impact == "exact":
            found = knocks(shown, found)
        say_moved(cuts, on_grid(dataset, cuts), "shown")
        frame = measures.table_of(found)
        say(measures.describe(frame, weight))
        if csv is not None:
            write_csv(csv, frame)
            say(csv)
