"""What the commands write to a terminal: one line for a warning, nothing that it would obey."""

from __future__ import annotations

import io
import sys
import warnings

import typer

from sweeps.text import printable


def say(text: object, *, error: bool = False, end: bool = True) -> None:
    """Write a text to stdout, or stderr for an error, with control characters escaped."""
    typer.echo(printable(str(text)), err=error, nl=end)


def _show_warning(message: Warning | str, *_: object) -> None:
    say(f"vibroimpact: warning: {message}", error=True)


def prepare_streams() -> None:
    """Escape what an encoding lacks, and write a warning of Python as one line."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    warnings.showwarning = _show_warning  # type: ignore[assignment]
