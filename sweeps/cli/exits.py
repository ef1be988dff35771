"""How a command ends early: exit code 1 failed or interrupted, 2 request refused."""

from __future__ import annotations

from typing import NoReturn

import typer

FAILED, REFUSED = 1, 2


def stop(code: int, error: object) -> NoReturn:
    """Say why on stderr, and exit with that code."""
    typer.echo(f"vibroimpact: error: {error}", err=True)
    raise typer.Exit(code)


def check_threads(threads: int | None) -> None:
    """Refuse a number of threads that numba does not have."""
    import numba

    cores: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    if threads is not None and not 1 <= threads <= cores:
        stop(REFUSED, f"--threads {threads} is not allowed; expected: an integer from 1 to {cores}")
