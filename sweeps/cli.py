"""The command line: arguments and exit codes only.

What a command needs is imported inside it, so that ``--help`` answers at once.
"""

from __future__ import annotations

import os
import shlex
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from sweeps import cli_bench

if TYPE_CHECKING:
    from sweeps.config import SweepConfig


class _Commands(TyperGroup):
    """The commands, each of which Ctrl-C ends in the same way."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            _stop(FAILED, "interrupted")


app = typer.Typer(
    cls=_Commands,
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

app.add_typer(cli_bench.app, name="bench")

FAILED, REFUSED = 1, 2

SweepFile = Annotated[Path, typer.Argument(metavar="OUT.h5", help="The file of a sweep.")]


def main() -> None:
    """Run the command line; exits with 0 done, 1 failed or interrupted, 2 request refused."""
    try:
        app(prog_name="vibroimpact")
    except SystemExit as end:
        if threading.active_count() > 1 and isinstance(end.code, int):
            # An interrupted run is still in the kernel, and its file is closed.
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(end.code)
        raise


def _stop(code: int, error: object) -> NoReturn:
    typer.echo(f"vibroimpact: error: {error}", err=True)
    raise typer.Exit(code)


@contextmanager
def _termination_as_interrupt() -> Iterator[None]:
    """Let SIGTERM end the block like Ctrl-C."""

    def interrupt(*_: object) -> NoReturn:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _show_version(asked: bool) -> None:
    if asked:
        from importlib import metadata

        try:
            typer.echo(f"vibroimpact {metadata.version('vibroimpact')}")
        except metadata.PackageNotFoundError:
            typer.echo("vibroimpact, run from a checkout that was not installed")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Sweeps of a forced oscillator with impacts: YAML in, HDF5 and pictures out."""


@app.command()
def run(
    config: Annotated[Path, typer.Argument(metavar="CONFIG", help="The YAML file of the sweep.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="OUT.h5", help="The file to write, instead of CONFIG's."
        ),
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Replace a value, e.g. oscillator.h=0.2; repeatable."
        ),
    ] = None,
    threads: Annotated[
        int | None, typer.Option(metavar="N", help="Threads to use; all cores if not given.")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show what would be computed, and compute nothing.")
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Compute only what is missing in the output.")
    ] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the output.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Compute the sweep that CONFIG describes."""
    from sweeps.errors import StoreError
    from sweeps.loading import ConfigError, load_config

    with _termination_as_interrupt():
        try:
            if resume and overwrite:
                _stop(REFUSED, "--resume and --overwrite exclude each other; give one of them")
            _check_threads(threads)
            sweep = load_config(config, overrides or ())
            path = output or sweep.output
            if dry_run:
                typer.echo(_dry_run(sweep, path, threads, overwrite=overwrite, resume=resume))
            else:
                again = _go_on(config, output, overrides or (), threads, quiet)
                _run(sweep, path, again, threads, quiet, overwrite=overwrite, resume=resume)
        except (ConfigError, StoreError) as error:
            _stop(REFUSED, error)


def _dry_run(sweep: SweepConfig, path: Path, threads: int | None, **existing: bool) -> str:
    from sweeps.limits import estimate
    from sweeps.reports import plan
    from sweeps.store import check_output

    check_output(path, **existing)
    cost = estimate(sweep, threads)
    check_output(path, **existing, size=cost.disk)
    return plan(sweep, path, cost)


def _run(
    sweep: SweepConfig,
    path: Path,
    again: str,
    threads: int | None,
    quiet: bool,
    **existing: bool,
) -> None:
    from sweeps import reports
    from sweeps.errors import StoreFailure

    try:
        from sweeps.runner import run_sweep

        path = run_sweep(sweep, path, threads=threads, progress=not quiet, **existing)
    except KeyboardInterrupt:
        _stop(FAILED, f"interrupted; {reports.kept(path, again)}")
    except (StoreFailure, OSError, MemoryError) as error:
        reason = str(error) or type(error).__name__
        _stop(FAILED, f"the run failed: {reason}; {reports.kept(path, again)}")
    if not quiet:
        typer.echo(reports.summary(path))


def _go_on(
    config: Path,
    output: Path | None,
    overrides: Sequence[str],
    threads: int | None,
    quiet: bool,
) -> str:
    """Return the command that goes on with a run."""
    command = ["vibroimpact", "run", str(config)]
    command += ["-o", str(output)] if output else []
    command += [part for override in overrides for part in ("--set", override)]
    command += ["--threads", str(threads)] if threads else []
    command += ["--quiet"] if quiet else []
    return shlex.join([*command, "--resume"])


def _check_threads(threads: int | None) -> None:
    import numba

    cores: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    if threads is not None and not 1 <= threads <= cores:
        _stop(
            REFUSED, f"--threads {threads} is not allowed; expected: an integer from 1 to {cores}"
        )


@app.command()
def plot(
    file: SweepFile,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="FIGURE", help="The picture to write, OUT.png if not given."
        ),
    ] = None,
    kind: Annotated[
        str | None, typer.Option(metavar="KIND", help="bifurcation, section or trajectory.")
    ] = None,
    axis: Annotated[
        str | None, typer.Option(metavar="NAME", help="The swept parameter along the abscissa.")
    ] = None,
    at: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE", help="Where to cut another swept parameter; repeatable."
        ),
    ] = None,
    coordinate: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="poincare_x, poincare_v, impact_v or impact_phase, as ordinate."
        ),
    ] = None,
) -> None:
    """Draw a picture from the file of a sweep."""
    from sweeps.errors import StoreError
    from sweeps.store import open_sweep

    cuts = _cuts(at or ())
    try:
        with open_sweep(file) as dataset:
            from sweeps import plotting

            try:
                found = plotting.on_grid(dataset, cuts)
                figure = output or file.with_suffix(".png")
                written = plotting.plot(dataset, figure, kind, axis, found, coordinate)
            except plotting.PlotError as error:
                _stop(REFUSED, error)
    except StoreError as error:
        _stop(REFUSED, error)
    for name, value in cuts.items():
        if value != found[name]:
            text = f"{name} = {value:g} is not on the grid; drawn at {name} = {found[name]:g}"
            typer.echo(text, err=True)
    typer.echo(written)


def _cuts(texts: Sequence[str]) -> dict[str, float]:
    cuts: dict[str, float] = {}
    for text in texts:
        name, value = _cut(text)
        if name in cuts:
            _stop(REFUSED, f"--at {text} is not allowed; {name} was given before")
        cuts[name] = value
    return cuts


def _cut(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        _stop(REFUSED, f"--at {text} is not allowed; expected: NAME=VALUE, for example omega=2.5")


@app.command()
def info(file: SweepFile) -> None:
    """Show what the file of a sweep holds, with its configuration."""
    from sweeps.errors import StoreError
    from sweeps.reports import contents
    from sweeps.store import open_sweep

    try:
        with open_sweep(file) as dataset:
            typer.echo(contents(dataset), nl=False)
    except StoreError as error:
        _stop(REFUSED, error)


@app.command()
def schema() -> None:
    """Show the JSON schema of a sweep's configuration, for editors."""
    import json

    from sweeps.config import json_schema

    typer.echo(json.dumps(json_schema(), indent=2))


if __name__ == "__main__":
    main()
