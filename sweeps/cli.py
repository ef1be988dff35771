"""The command line: arguments and exit codes only.

What a command needs is imported inside it, so that ``--help`` answers at once.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

if TYPE_CHECKING:
    import numpy as np

    from sweeps.config import SweepConfig
    from vibroimpact.status import Status

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

FAILED, REFUSED = 1, 2

SweepFile = Annotated[Path, typer.Argument(metavar="OUT.h5", help="The file of a sweep.")]


def main() -> None:
    """Run the command line; exits with 0 done, 1 failed or interrupted, 2 request refused."""
    app(prog_name="vibroimpact")


def _stop(code: int, error: object) -> NoReturn:
    typer.echo(f"vibroimpact: error: {error}", err=True)
    raise typer.Exit(code)


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
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the output.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Compute the sweep that CONFIG describes."""
    from sweeps.loading import ConfigError, load_config
    from sweeps.store import StoreError, check_output

    try:
        _check_threads(threads)
        sweep = load_config(config, overrides or ())
        path = output or sweep.output
        check_output(path, overwrite)
    except (ConfigError, StoreError) as error:
        _stop(REFUSED, error)
    if dry_run:
        typer.echo(_plan(sweep, path))
        return

    try:
        from sweeps.runner import run_sweep

        path = run_sweep(sweep, path, threads=threads, overwrite=overwrite, progress=not quiet)
    except KeyboardInterrupt:
        _stop(FAILED, f"interrupted; {_kept(path)}")
    except (StoreError, OSError, MemoryError) as error:
        # The request was accepted above, so this is a full disk or the like.
        _stop(FAILED, f"the run failed: {str(error) or type(error).__name__}; {_kept(path)}")
    if not quiet:
        typer.echo(_summary(path))


def _check_threads(threads: int | None) -> None:
    import numba

    cores: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    if threads is not None and not 1 <= threads <= cores:
        _stop(
            REFUSED, f"--threads {threads} is not allowed; expected: an integer from 1 to {cores}"
        )


def _axis(name: str, values: np.ndarray) -> str:
    from vibroimpact.oscillator import PARAMETERS

    ends = f"{values[0]:g} .. {values[-1]:g}"
    return f"{name} = {ends} [{PARAMETERS[name].unit}], {_count(len(values), 'value')}"


def _count(number: int, noun: str) -> str:
    return f"{number:,} {noun}" if number == 1 else f"{number:,} {noun}s"


def _plan(sweep: SweepConfig, path: Path) -> str:
    """Describe a sweep before it is run."""
    import numpy as np

    from sweeps.store import VARIABLES

    record, steps = sweep.record, sweep.method.steps_per_period
    periods = sweep.grid.size * (record.transient + record.periods)
    samples = 0
    if record.trajectory:
        samples = record.periods * steps // record.trajectory.every + 1
    widths = {None: 1, "section": record.periods, "impact": record.impacts, "sample": samples}
    size = sweep.grid.size * sum(
        np.dtype(variable.dtype).itemsize * widths[variable.record]
        for variable in VARIABLES.values()
    )
    axes = [_axis(name, values) for name, values in sweep.grid.axes.items()]
    return "\n".join(
        [
            f"name             {sweep.name}",
            *(f"axis             {axis}" for axis in axes or ["none, a single point"]),
            f"points           {sweep.grid.size:,}",
            f"forcing periods  {periods:,}",
            f"steps            {periods * steps:,}",
            f"estimated size   {_bytes(size)}",
            f"output           {path}",
        ]
    )


def _bytes(size: float) -> str:
    units = ["B", "kB", "MB", "GB", "TB"]
    while size >= 1000.0 and len(units) > 1:
        size /= 1000.0
        del units[0]
    return f"{size:.3g} {units[0]}"


def _summary(path: Path) -> str:
    """Describe a sweep after it was run, with the command to type next."""
    from sweeps.store import open_sweep, status_counts

    with open_sweep(path) as dataset:
        seconds = float(dataset.attrs["duration"])
        outcome = f"{path}: {_outcomes(status_counts(dataset))}"
    return f"{outcome} in {seconds:.3g} s\nnext: vibroimpact plot {shlex.quote(str(path))}"


def _outcomes(counts: Mapping[Status, int]) -> str:
    """Say how many points there are, and what became of those that were not computed."""
    from vibroimpact.status import Status

    troubles = [
        f"{number:,} {status.name} ({status.meaning})"
        for status, number in counts.items()
        if number and status is not Status.COMPUTED
    ]
    points = _count(sum(counts.values()), "point")
    return f"{points}, of which {'; '.join(troubles)}" if troubles else points


def _kept(path: Path) -> str:
    """Say what a run that ended early left behind."""
    from sweeps.store import StoreError, open_sweep, status_counts
    from vibroimpact.status import Status

    try:
        with open_sweep(path) as dataset:
            counts = status_counts(dataset)
    except StoreError:
        return "nothing is kept"
    points = sum(counts.values())
    return f"{points - counts[Status.PENDING]:,} of {_count(points, 'point')} kept in {path}"


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
    from sweeps.store import StoreError, open_sweep

    figure = output or file.with_suffix(".png")
    if figure.absolute() == file.absolute():
        _stop(REFUSED, f"the picture {figure} would replace the data; give -o another file")
    cuts = dict(map(_cut, at or ()))
    try:
        with open_sweep(file) as dataset:
            from sweeps import plotting

            try:
                written = plotting.plot(dataset, figure, kind, axis, cuts, coordinate)
            except plotting.PlotError as error:
                _stop(REFUSED, error)
    except StoreError as error:
        _stop(REFUSED, error)
    typer.echo(written)


def _cut(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        _stop(REFUSED, f"--at {text} is not allowed; expected: NAME=VALUE, for example omega=2.5")


@app.command()
def info(file: SweepFile) -> None:
    """Show what the file of a sweep holds, with its configuration."""
    from sweeps.store import StoreError, open_sweep, status_counts

    try:
        with open_sweep(file) as dataset:
            attributes = dict(dataset.attrs)
            configuration = attributes.pop("configuration")
            rows = [("points", _outcomes(status_counts(dataset)))]
            axes = dataset["status"].dims
            rows += [("axis", _axis(str(axis), dataset[axis].values)) for axis in axes]
            for name, variable in dataset.data_vars.items():
                sizes = ", ".join(f"{dim}: {size}" for dim, size in variable.sizes.items())
                rows.append(("variable", f"{name} ({sizes})"))
    except StoreError as error:
        _stop(REFUSED, error)
    rows = [*((name, str(value)) for name, value in attributes.items()), *rows]
    for name, text in rows:
        typer.echo(f"{name:20} {text}")
    typer.echo(f"\n{configuration}", nl=False)


@app.command()
def schema() -> None:
    """Show the JSON schema of a sweep's configuration, for editors."""
    import json

    from sweeps.config import json_schema

    typer.echo(json.dumps(json_schema(), indent=2))


if __name__ == "__main__":
    main()
