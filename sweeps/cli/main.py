"""The command line: its commands, with ``init``, ``schema`` and ``bench``.

In all files of this room, a command imports its modules inside its function, so that ``--help``
answers at once.
"""

from __future__ import annotations

import os
import textwrap
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from sweeps.cli import common
from sweeps.cli import plot as cli_plot
from sweeps.cli import read as cli_read
from sweeps.cli import run as cli_run
from sweeps.cli import zoom as cli_zoom
from sweeps.errors import Failed, Refused
from sweeps.interrupts import raised_at_once
from sweeps.text import near_misses, progress_shown, shortened, shown_count, suggestion
from vibroimpact import __version__
from vibroimpact.inputs import number


class Command(TyperCommand):
    """A command that every error of its arguments knows."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the arguments; an error gets the context, which typer does not always give it."""
        try:
            return super().parse_args(ctx, args)
        except Exception as error:
            error.ctx = ctx  # type: ignore[attr-defined]
            raise


class InitCommand(Command):
    """The command ``init``, whose help lists the scenes."""

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the names of the scenes at the end of the help."""
        with formatter.section("Scenes"):
            names = textwrap.wrap(", ".join(common.scenes()), 76, break_on_hyphens=False)
            formatter.write("".join(f"  {line}\n" for line in names))


class Commands(TyperGroup):
    """A group of commands: help if none is given, and a refusal of a name that none has."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the arguments before the name of the command; without any, print the help."""
        if not args and not ctx.resilient_parsing:  # a shell completes less than a command
            common.say(ctx.get_help(), error=True)
            raise typer.Exit(2)
        return super().parse_args(ctx, args)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command with this name; refuse a name that no command has."""
        command = super().get_command(ctx, cmd_name)
        if command is None and not ctx.resilient_parsing:
            meant = suggestion(near_misses(cmd_name, self.commands))
            raise Refused(
                f"there is no command {cmd_name}{meant}; expected: {', '.join(self.commands)}"
            )
        return command


app = typer.Typer(
    cls=Commands,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
measurements = typer.Typer(
    cls=Commands, rich_markup_mode=None, help="Measure the methods: accuracy, speed and stability."
)
app.add_typer(measurements, name="bench")


def _show_version(requested: bool) -> None:
    """Show the version and exit, if requested."""
    if requested:
        common.say(f"vibroimpact {__version__}")
        raise typer.Exit


def _check_numba() -> None:
    """Refuse settings that numba cannot read or use, with the error of numba."""
    file = Path(".numba_config.yaml")
    settings = [f"{name}={value}" for name, value in os.environ.items() if name[:6] == "NUMBA_"]
    settings += [f"the file {file}"] if file.exists() else []
    if not settings:
        return  # without importing numba
    problem = ""
    with warnings.catch_warnings(record=True) as unread:
        warnings.simplefilter("always")
        try:
            import vibroimpact.jit.compiling  # noqa: F401
        except Exception as error:
            problem = str(error)
            # A setting causes other errors than a library that cannot be loaded.
            if isinstance(error, MemoryError | OSError) or getattr(error, "path", None):
                raise Failed(
                    "the compiler numba cannot be loaded, perhaps for lack of memory (ulimit -v): "
                    f"{shortened(problem or 'MemoryError', 200)}"
                ) from error
    for warning in unread:
        if "Environment variable" in str(warning.message):
            problem = problem or str(warning.message).partition("\n")[0]
    if problem:
        raise Refused(
            f"numba cannot work with its settings: {shortened(problem, 200)}; one of "
            f"these is wrong, unset or correct it: {shortened(', '.join(settings), 300)}"
        )


@app.callback()
def _common(
    context: typer.Context,
    version: bool = typer.Option(
        False, "--version", callback=_show_version, is_eager=True, help="Show the version and exit."
    ),
) -> None:
    """Sweeps of a forced oscillator with impacts: YAML in, HDF5 and pictures out."""
    from sweeps.store.replacing import absolute

    absolute(Path())
    _check_numba()
    if context.invoked_subcommand not in ("run", "zoom", "explore"):
        context.with_resource(raised_at_once())


def init_command(
    scene: str = common.argument("SCENE", "The name of a scene.", "quickstart", common.scenes),
) -> None:
    """Write a scene to this folder: its configuration with comments, and its table, if any."""
    from sweeps.store.replacing import check_target, writing

    texts = common.scenes()
    if scene not in texts:
        raise Refused(
            f"there is no scene {scene!r}{suggestion(near_misses(scene, texts))}; "
            f"expected: {', '.join(texts)}"
        )
    files = {f"{scene}{ending}": common.scenes(ending).get(scene) for ending in (".csv", ".yaml")}
    new_texts = {Path(name): text for name, text in files.items() if text is not None}
    for path in new_texts:
        check_target(path, "configuration", only_new=True)
    for path, text in new_texts.items():
        with writing(path, "configuration", only_new=True) as new:
            new.write(text.encode())
        common.say(path)
    common.say(f"next: vibroimpact run {scene}.yaml")


def schema_command() -> None:
    """Show the JSON schema of a configuration, for editors."""
    import json

    from sweeps.config.sweep import json_schema

    common.say(json.dumps(json_schema(), indent=2))


# The commands of ``bench``

_QUICK = common.flag("--quick", "Measure less, in under a minute.")


def _picture(path: Path) -> Path:
    """Refuse a path unless a picture can be written there."""
    from sweeps.plotting.saving import check_picture

    check_picture(path)
    return path


def _figure(name: str) -> Any:
    """Return the option of the picture, with its name by default."""
    return common.option(
        "FIGURE", "The picture to write.", "-o", "--output", default=Path(name), callback=_picture
    )


def _save(csv: Path | None, rows: Any, output: Path, draw: Callable, *measured: Any) -> None:
    """Write the picture of a bench and, to a `csv` file, its rows; print the names of the files."""
    from sweeps.plotting.saving import save_chart

    save_chart(output, draw, *measured)
    common.say(output)
    common.save_table(csv, rows)


def accuracy_speed(
    config: Path | None = common.argument(
        "[CONFIG]",
        "The YAML file of a sweep, or a sweep file, on which to compare the methods; if not given, "
        "the scenes of the program, also with other solvers.",
        None,
    ),
    output: Path = _figure("accuracy-speed.png"),
    csv: Path | None = common.CSV,
    quick: bool = _QUICK,
    threads: int = common.option(
        "N", "Threads of the kernel; other solvers use one.", parser=common.read_threads, default=1
    ),
) -> None:
    """Chart the accuracy of every method against its speed."""
    import pandas as pd

    from sweeps.bench import accuracy as bench
    from sweeps.bench import accuracy_results as results
    from sweeps.opened.export import refuse_points

    plan = bench.QUICK if quick else bench.FULL
    if config is not None:
        read = cli_run.read_config(config)
        refuse_points(read.columns, csv)
        plan = bench.plan_for_sweep(read, plan)
        (scene,) = plan.scenes
        points = shown_count(len(scene.points), "point")
        common.say(f"{points} of the {scene.name}, each after one forcing period\n")
    with progress_shown("measuring") as report:
        measured = bench.measure_methods(plan, threads, report)
    if config is None:
        measured = pd.concat([measured, results.means(measured)])
    measured = results.with_orders(measured)
    for name in plan.peers:
        if not bench.installed(name):
            common.say(f"{name} is not installed, so it is not on the chart", error=True)
    common.say(results.of_methods(measured))
    common.say(results.of_targets(measured))
    _save(csv, measured, output, results.accuracy_picture, measured)


def stability(
    output: Path = _figure("stability.png"), csv: Path | None = common.CSV, quick: bool = _QUICK
) -> None:
    """Show how long a step may be, and where each method fails."""
    from sweeps.bench import failures as bench

    figures = bench.measure_failures()
    for text in (bench.limit_table(), *bench.failure_tables(figures)):
        common.say(text)
    _save(csv, bench.figure_table(figures), output, bench.stability_chart, quick)


def paper(output: Path = _figure("paper.png")) -> None:
    """Compute the three cases of the paper, without and with its procedure."""
    from sweeps.bench import paper_cases as bench

    measured = bench.measure_cases()
    common.say(bench.case_tables(measured))
    _save(None, None, output, bench.paper_picture, measured)


def speed(
    quick: bool = _QUICK,
    json: Path | None = common.new_file("--json", ".json", "JSON file", "Write a .json file, too."),
    fail_below: float | None = common.numeric(
        "--fail-below",
        number(lambda share: 0.0 < share <= 1.0, "a number above 0, at most 1, as 0.05"),
        "Exit with 1 if the geometric mean of the shares of the peak is below SHARE.",
        "SHARE",
    ),
) -> None:
    """Show the forcing periods per second of this machine, and the share of its peak."""
    from sweeps.bench import speed
    from sweeps.opened.export import json_text
    from sweeps.store.replacing import writing

    count, periods = (1024, 150) if quick else (4096, 300)
    with progress_shown("measuring") as report:
        record = speed.measure_speed(count, periods, report)
    common.say(speed.speed_text(record))
    if json is not None:
        with writing(json, "JSON file") as new:
            new.write(f"{json_text(record)}\n".encode())
        common.say(json)
    share = record["mean_share"]
    if fail_below is not None and share < fail_below:
        raise Failed(
            f"the geometric mean of the shares of the peak is {share:.4g}, below {fail_below:g}"
        )


def _add(
    group: typer.Typer, *commands: Callable[..., None], cls: type[TyperCommand] = Command
) -> None:
    """Add the command ``run`` for ``run_command``, with its whole first line in the list."""
    for command in commands:
        name = command.__name__.removesuffix("_command").replace("_", "-")
        group.command(name, cls=cls, short_help=command.__doc__)(command)


_add(app, init_command, cls=InitCommand)
_add(
    app,
    cli_run.run_command,
    cli_zoom.zoom_command,
    cli_run.explore_command,
    cli_plot.plot_command,
    cli_read.attractors_command,
    cli_read.integrity_command,
    cli_read.info_command,
    cli_read.compare_command,
    cli_read.export_command,
    schema_command,
)
_add(measurements, accuracy_speed, stability, paper, speed)
