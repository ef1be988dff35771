"""The commands below ``vibroimpact bench``: arguments and exit codes only."""

from __future__ import annotations

import typer

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Measure the methods: accuracy against speed, and stability.",
)
