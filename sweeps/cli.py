"""The command line: arguments and exit codes only.

What a command needs is imported inside it, so that ``--help`` answers at once.
"""

from __future__ import annotations

import os
import shlex
import signal
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from sweeps import cli_bench
from sweeps.exits import FAILED, REFUSED, check_threads, stop

if TYPE_CHECKING:
    import xarray as xr
    from distributed import Client

    from sweeps.config import SweepConfig
    from sweeps.selection import Cut


class _Commands(TyperGroup):
    """The commands, each of which Ctrl-C ends in the same way."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            stop(FAILED, "interrupted")


app = typer.Typer(
    cls=_Commands,
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

app.add_typer(cli_bench.app, name="bench")

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
    configs: Annotated[
        list[Path], typer.Argument(metavar="CONFIG...", help="The YAML file of each sweep.")
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="OUT.h5",
            help="The file to write, instead of CONFIG's; for a single CONFIG.",
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
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Compute on a Dask cluster: tcp://HOST:PORT of its scheduler, or local:N for N "
            "processes of this machine.",
        ),
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
    """Compute the sweep that each CONFIG describes, one after the other."""
    from sweeps.errors import ClusterError, StoreError
    from sweeps.loading import ConfigError, load_config
    from sweeps.store import check_output

    existing = {"overwrite": overwrite, "resume": resume}
    with _termination_as_interrupt():
        try:
            if resume and overwrite:
                stop(REFUSED, "--resume and --overwrite exclude each other; give one of them")
            check_threads(threads)
            _check_cluster(dask, threads)
            sweeps = [load_config(config, overrides or ()) for config in configs]
            paths = _targets(configs, output, [sweep.output for sweep in sweeps])
            for path in paths:
                check_output(path, **existing)
            with _client(dask, quiet) as client:
                if dry_run:
                    texts = [
                        _plan(sweep, path, threads, client, **existing)
                        for sweep, path in zip(sweeps, paths, strict=True)
                    ]
                    typer.echo("\n\n".join(texts))
                    return
                for i, (sweep, path) in enumerate(zip(sweeps, paths, strict=True)):
                    again = _go_on(configs[i:], output, overrides or (), threads, dask, quiet)
                    _run(sweep, path, again, quiet, threads=threads, client=client, **existing)
        except (ConfigError, StoreError, ClusterError) as error:
            stop(REFUSED, error)
    if not quiet:
        from sweeps.reports import next_command

        typer.echo(next_command(paths))


def _check_cluster(address: str | None, threads: int | None) -> None:
    """Refuse an address that is none, and threads beside it."""
    if address is None:
        return
    from sweeps.client import check_address

    check_address(address)
    if threads is not None:
        stop(
            REFUSED,
            f"--threads {threads} is not allowed with --dask, whose workers use the threads that "
            "they were started with; for N processes of this machine give --dask local:N",
        )


@contextmanager
def _client(address: str | None, quiet: bool) -> Iterator[Client | None]:
    """Yield a client of the cluster at an address, and say where its dashboard is."""
    if address is None:
        yield None
        return
    from sweeps.client import connected, dashboard

    with connected(address) as client:
        if not quiet:
            typer.echo(dashboard(client), err=True)
        yield client


def _plan(
    sweep: SweepConfig, path: Path, threads: int | None, client: Client | None, **existing: bool
) -> str:
    """Return what a sweep takes, or refuse it where that is too much."""
    from sweeps.cluster import computer_for
    from sweeps.limits import estimate
    from sweeps.reports import plan
    from sweeps.store import check_output

    computer = computer_for(client, threads)
    cost = estimate(sweep, computer.threads, computer.cores)
    check_output(path, **existing, size=cost.disk)
    return plan(sweep, path, cost)


def _run(sweep: SweepConfig, path: Path, again: str, quiet: bool, **options: Any) -> None:
    from sweeps import reports
    from sweeps.errors import ClusterFailure, StoreFailure

    try:
        from sweeps.runner import run_sweep

        path = run_sweep(sweep, path, progress=not quiet, **options)
    except KeyboardInterrupt:
        stop(FAILED, f"interrupted; {reports.kept(path, again)}")
    except (ClusterFailure, StoreFailure, OSError, MemoryError) as error:
        reason = str(error) or type(error).__name__
        stop(FAILED, f"the run failed: {reason}; {reports.kept(path, again)}")
    if not quiet:
        typer.echo(reports.summary(path))


def _go_on(
    configs: Sequence[Path],
    output: Path | None,
    overrides: Sequence[str],
    threads: int | None,
    dask: str | None,
    quiet: bool,
) -> str:
    """Return the command that goes on with a run."""
    command = ["vibroimpact", "run", *map(str, configs)]
    command += ["-o", str(output)] if output else []
    command += [part for override in overrides for part in ("--set", override)]
    command += ["--threads", str(threads)] if threads else []
    command += ["--dask", dask] if dask else []
    command += ["--quiet"] if quiet else []
    return shlex.join([*command, "--resume"])


def _targets(sources: Sequence[Path], output: Path | None, own: Sequence[Path]) -> list[Path]:
    """Return what is written for each source: `own`, or `output` for a single one."""
    if output is None:
        targets = list(own)
    elif len(sources) == 1:
        targets = [output]
    else:
        stop(
            REFUSED,
            f"-o {output} is not allowed here: it is for a single file, and {len(sources)} are "
            "given; without it each has an output of its own",
        )
    first: dict[str, Path] = {}
    for source, target in zip(sources, targets, strict=True):
        other = first.setdefault(os.path.abspath(target), source)
        if other is not source:
            stop(REFUSED, f"{other} and {source} would both write {target}; give them one by one")
    return targets


@app.command()
def plot(
    files: Annotated[
        list[Path], typer.Argument(metavar="OUT.h5...", help="The file of each sweep.")
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FIGURE",
            help="The picture to write, OUT.png if not given; for a single OUT.h5.",
        ),
    ] = None,
    kind: Annotated[
        str | None,
        typer.Option(
            metavar="KIND",
            help="bifurcation, attractors, basins, map, section, impacts or trajectory.",
        ),
    ] = None,
    axis: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME", help="The swept parameter as abscissa; for a map, then the ordinate."
        ),
    ] = None,
    at: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE",
            help="Where to cut another swept parameter; of a sweep that was followed up and down, "
            "direction=up or down; repeatable.",
        ),
    ] = None,
    coordinate: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="poincare_x, poincare_v, impact_v or impact_phase, as ordinate."
        ),
    ] = None,
    quantity: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="What a map shows: period, impacts_per_period, lyapunov, rest_fraction, "
            "slowest_impact, max_penetration or status.",
        ),
    ] = None,
    exact: Annotated[
        bool,
        typer.Option(
            "--exact",
            help="Draw the closed-form one-impact orbits over a bifurcation diagram, and show how "
            "far the points are from them.",
        ),
    ] = False,
) -> None:
    """Draw a picture from the file of each sweep."""
    from sweeps.errors import StoreError
    from sweeps.store import open_sweep

    cuts = _cuts(at or ())
    options = {
        "axes": tuple(axis or ()),
        "coordinate": coordinate,
        "quantity": quantity,
        "exact": exact,
    }
    figures = _targets(files, output, [file.with_suffix(".png") for file in files])
    try:
        for file in files:
            open_sweep(file).close()  # before any is drawn
        for file, figure in zip(files, figures, strict=True):
            with open_sweep(file) as dataset:
                _plot(dataset, file, figure, kind, cuts, options)
    except StoreError as error:
        stop(REFUSED, error)


def _plot(
    dataset: xr.Dataset,
    file: Path,
    figure: Path,
    kind: str | None,
    cuts: Mapping[str, float | str],
    options: Mapping[str, Any],
) -> None:
    from sweeps import plotting

    try:
        found = plotting.on_grid(dataset, cuts)
        written = plotting.plot(dataset, figure, kind, found, **options)
        told = (
            plotting.compare(dataset, options["axes"], found, options["coordinate"])
            if options["exact"]
            else []
        )
    except plotting.PlotError as error:
        stop(REFUSED, f"{file}: {error}")
    _tell_moved(cuts, found, "drawn")
    for line in told:
        typer.echo(line)
    typer.echo(written)


def _tell_moved(cuts: Cut, found: Cut, done: str) -> None:
    for name, value in cuts.items():
        if value != found[name]:
            text = f"{name} = {value:g} is not on the grid; {done} at {name} = {found[name]:g}"
            typer.echo(text, err=True)


@app.command()
def attractors(
    file: SweepFile,
    at: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="Where to look along a parameter; repeatable."),
    ] = None,
    csv: Annotated[
        Path | None,
        typer.Option("--csv", metavar="FILE", help="Write those of every parameter point to it."),
    ] = None,
) -> None:
    """Show the attractors that the starts of a sweep find, and how many starts find each."""
    from sweeps import attractor_table
    from sweeps.coexisting import attractors
    from sweeps.errors import StoreError
    from sweeps.selection import PlotError, on_grid
    from sweeps.store import open_sweep

    cuts = _cuts(at or ())
    if csv is not None and not (csv.suffix == ".csv" and csv.absolute().parent.is_dir()):
        stop(REFUSED, f"--csv {csv} is not allowed; expected: a .csv file in an existing folder")
    try:
        with open_sweep(file) as dataset:
            cut = attractor_table.cut(dataset, cuts)
            found = attractors(cut)
            _tell_moved(cuts, on_grid(dataset, cuts), "shown")
            typer.echo(attractor_table.told(cut, found))
            if csv is not None:
                attractor_table.write_csv(csv, attractor_table.rows(cut, found))
                typer.echo(csv)
    except (PlotError, StoreError) as error:
        stop(REFUSED, f"{file}: {error}" if isinstance(error, PlotError) else error)
    except OSError as error:
        stop(FAILED, error)


def _cuts(texts: Sequence[str]) -> dict[str, float | str]:
    cuts: dict[str, float | str] = {}
    for text in texts:
        name, value = _cut(text)
        if name in cuts:
            stop(REFUSED, f"--at {text} is not allowed; {name} was given before")
        cuts[name] = value
    return cuts


def _cut(text: str) -> tuple[str, float | str]:
    name, _, value = text.partition("=")
    if name.strip() == "direction":
        return "direction", value.strip()
    try:
        return name.strip(), float(value)
    except ValueError:
        stop(REFUSED, f"--at {text} is not allowed; expected: NAME=VALUE, for example omega=2.5")


@app.command()
def info(
    file: SweepFile,
    bifurcations: Annotated[
        bool,
        typer.Option("--bifurcations", help="List where the class of the motion changes instead."),
    ] = False,
    axis: Annotated[
        str | None, typer.Option(metavar="NAME", help="The swept parameter along which it changes.")
    ] = None,
) -> None:
    """Show what the file of a sweep holds, with its configuration."""
    from sweeps import reports
    from sweeps.errors import StoreError
    from sweeps.store import open_sweep

    if axis is not None and not bifurcations:
        stop(REFUSED, f"--axis {axis} is not allowed here; expected: with --bifurcations")
    try:
        with open_sweep(file) as dataset:
            if bifurcations:
                typer.echo(_bifurcations(dataset, file, axis))
            else:
                typer.echo(reports.contents(dataset), nl=False)
    except StoreError as error:
        stop(REFUSED, error)


def _bifurcations(dataset: xr.Dataset, file: Path, axis: str | None) -> str:
    from sweeps.reports import bifurcations
    from sweeps.selection import PlotError

    try:
        return bifurcations(dataset, axis)
    except PlotError as error:
        stop(REFUSED, f"{file}: {error}")


@app.command()
def schema() -> None:
    """Show the JSON schema of a sweep's configuration, for editors."""
    import json

    from sweeps.config import json_schema

    typer.echo(json.dumps(json_schema(), indent=2))


if __name__ == "__main__":
    main()
