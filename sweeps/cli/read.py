"""The commands that read the files of sweeps: arguments and exit codes only.

As in ``cli.py``, what a command needs is imported inside it.
"""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sweeps.cli.options import check_csv, inches, limits
from sweeps.cli.terminal import say
from sweeps.errors import Failed, Refused

if TYPE_CHECKING:
    import xarray as xr

    from sweeps.analysis.selection import Cut

SweepFile = Annotated[Path, typer.Argument(metavar="OUT.h5", help="The file of a sweep.")]


def targets(sources: Sequence[Path], output: Path | None, own: Sequence[Path]) -> list[Path]:
    """Return what is written for each source: `own`, or `output` for a single one."""
    if output is None:
        targets = list(own)
    elif len(sources) == 1:
        targets = [output]
    else:
        raise Refused(
            f"-o {output} is not allowed here: it is for a single file, and {len(sources)} are "
            "given; without it each has an output of its own"
        )
    first: dict[str, Path] = {}
    for source, target in zip(sources, targets, strict=True):
        other = first.setdefault(os.path.abspath(target), source)
        if other is not source:
            raise Refused(f"{other} and {source} would both write {target}; give them one by one")
    return targets


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
            help="Draw the exact branches of the periodic motions, stable and not, with their "
            "bifurcations, and show how far the points are from them; over a map, the curves of "
            "these.",
        ),
    ] = False,
    csv: Annotated[
        Path | None,
        typer.Option("--csv", metavar="FILE", help="With --exact: write what is drawn to it."),
    ] = None,
    below: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="A scalar of the file, as lyapunov, in a panel below a bifurcation diagram; "
            "repeatable.",
        ),
    ] = None,
    periods: Annotated[
        int | None,
        typer.Option(
            metavar="N", help="Of a trajectory: compute N periods from the last state stored."
        ),
    ] = None,
    width: Annotated[
        str | None,
        typer.Option(metavar="LENGTH", help="Width of the picture, e.g. 3.4in, 8.6cm or 86mm."),
    ] = None,
    title: Annotated[
        str | None, typer.Option(metavar="TEXT", help="Instead of that of the sweep; may be empty.")
    ] = None,
    xlim: Annotated[
        str | None, typer.Option(metavar="LOW:HIGH", help="Limits of the abscissa.")
    ] = None,
    ylim: Annotated[
        str | None, typer.Option(metavar="LOW:HIGH", help="Limits of the ordinate.")
    ] = None,
) -> None:
    """Draw a picture from the file of each sweep."""
    from sweeps.store import open_sweep

    cuts = _cuts(at or ())
    check_csv(csv)
    if csv is not None and (not exact or len(files) > 1):
        raise Refused(f"--csv {csv} is not allowed here; expected: with --exact, for a single file")
    page = {
        "width": None if width is None else inches(width),
        "title": title,
        "xlim": None if xlim is None else limits("--xlim", xlim),
        "ylim": None if ylim is None else limits("--ylim", ylim),
    }
    if periods is not None and periods < 1:
        raise Refused(f"--periods {periods} is not allowed; expected: an integer >= 1")
    options = {
        "axes": tuple(axis or ()),
        "coordinate": coordinate,
        "quantity": quantity,
        "exact": exact,
        "below": tuple(below or ()),
        "periods": periods,
    }
    figures = targets(files, output, [file.parent / f"{file.stem}.png" for file in files])
    for file in files:
        open_sweep(file).close()  # before any is drawn
    for file, figure in zip(files, figures, strict=True):
        with open_sweep(file, verify=False) as dataset, _named(file):
            _plot(dataset, figure, kind, cuts, dict(options), page, csv)


@contextmanager
def _named(file: Path) -> Iterator[None]:
    """Name the file in a refusal of the block, which knows its data only."""
    try:
        yield
    except Refused as error:
        raise Refused(f"{file}: {error}") from error


def _plot(
    dataset: xr.Dataset,
    figure: Path,
    kind: str | None,
    cuts: Mapping[str, float | str],
    options: dict[str, Any],
    page: Mapping[str, Any],
    csv: Path | None,
) -> None:
    from sweeps.analysis.selection import on_grid
    from sweeps.plotting import Page, plot
    from sweeps.plotting.kinds import default_kind, silent_cuts

    cut = on_grid(dataset, cuts)
    chosen = {name: value for name, value in options.items() if value not in (None, False, ())}
    kind = default_kind(dataset, cut, **chosen) if kind is None else kind
    lines, write = _exact(dataset, kind, cut, options) if options["exact"] else ([], None)
    command = shlex.join(["vibroimpact", *sys.argv[1:]])
    written = plot(dataset, figure, kind, cut, page=Page(**page), command=command, **options)
    _tell_moved(cuts, cut, "drawn")
    for name, value in silent_cuts(dataset, kind, cut, options["axes"]).items():
        shown, size = f"{value:g}" if isinstance(value, float) else value, dataset.sizes[name]
        say(f"{name} = {shown}, the first of {size}: --at {name}=VALUE takes another", error=True)
    for line in lines:
        say(line)
    if csv is not None and write is not None:
        try:
            write(csv)
        except OSError as error:
            raise Failed(error) from error
        say(csv)
    say(written)


def _exact(
    dataset: xr.Dataset, kind: str | None, cut: Cut, options: dict[str, Any]
) -> tuple[list[str], Callable[[Path], None]]:
    """Find the exact branches, or the curves of a map; return what to say, and to write a CSV."""
    if kind == "map" or (kind is None and options["quantity"]):
        from sweeps.analysis.exact_curves import find_curves, write_curves

        search = options["exact"] = find_curves(dataset, options["axes"], cut)
        return search.told(), lambda path: write_curves(path, search)
    from sweeps.plotting.exact_branches import compare, write_exact

    axes = options["axes"]
    texts = compare(dataset, axes, cut, options["coordinate"])
    return texts, lambda path: write_exact(path, dataset, axes, cut)


def _tell_moved(asked: Cut, cut: Cut, verb: str) -> None:
    """Say where a value that was asked for is not on the grid, and which one was taken."""
    for name, value in asked.items():
        if value != cut[name]:
            text = f"{name} = {value:g} is not on the grid; {verb} at {name} = {cut[name]:g}"
            say(text, error=True)


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
    from sweeps.analysis import table as attractor_table
    from sweeps.analysis.distinct_attractors import attractors
    from sweeps.analysis.selection import on_grid
    from sweeps.store import open_sweep

    cuts = _cuts(at or ())
    check_csv(csv)
    with open_sweep(file) as dataset, _named(file):
        cut = attractor_table.cut(dataset, cuts)
        result = attractors(cut)
        _tell_moved(cuts, on_grid(dataset, cuts), "shown")
        say(attractor_table.describe(cut, result))
        if csv is not None:
            try:
                attractor_table.write_csv(csv, attractor_table.rows(cut, result))
            except OSError as error:
                raise Failed(error) from error
            say(csv)


def _cuts(texts: Sequence[str]) -> dict[str, float | str]:
    cuts: dict[str, float | str] = {}
    for text in texts:
        name, value = _cut(text)
        if name in cuts:
            raise Refused(f"--at {text} is not allowed; {name} was given before")
        cuts[name] = value
    return cuts


def _cut(text: str) -> tuple[str, float | str]:
    name, _, value = text.partition("=")
    if name.strip() == "direction":
        return "direction", value.strip()
    try:
        return name.strip(), float(value)
    except ValueError:
        raise Refused(
            f"--at {text} is not allowed; expected: NAME=VALUE, for example omega=2.5"
        ) from None


def info(
    file: SweepFile,
    bifurcations: Annotated[
        bool,
        typer.Option(
            "--bifurcations",
            help="List where the class of the motion changes, and the exact bifurcations, instead.",
        ),
    ] = False,
    axis: Annotated[
        str | None, typer.Option(metavar="NAME", help="The swept parameter along which it changes.")
    ] = None,
    at: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="Where to cut another parameter; repeatable."),
    ] = None,
    csv: Annotated[
        Path | None,
        typer.Option("--csv", metavar="FILE", help="Write every bifurcation to it."),
    ] = None,
) -> None:
    """Show what the file of a sweep holds, with its configuration."""
    from sweeps.store import open_sweep

    for option, value in (("axis", axis), ("at", " ".join(at or ())), ("csv", csv)):
        if value and not bifurcations:
            raise Refused(f"--{option} {value} is not allowed here; expected: with --bifurcations")
    check_csv(csv)
    cuts = _cuts(at or ())
    with open_sweep(file) as dataset, _named(file):
        if bifurcations:
            _show_bifurcations(dataset, axis, cuts, csv)
        else:
            from sweeps.engine import reports

            say(reports.contents(dataset), end=False)


def _show_bifurcations(dataset: xr.Dataset, axis: str | None, cuts: Cut, csv: Path | None) -> None:
    from sweeps.analysis import bifurcations, exact_tables
    from sweeps.analysis.selection import on_grid

    along, items = bifurcations.find_bifurcations(dataset, axis, cuts)
    _tell_moved(cuts, on_grid(dataset, cuts), "listed")
    say(bifurcations.describe(along, items))
    if text := exact_tables.describe(dataset, along, cuts):
        say(text)
    if csv is not None:
        try:
            bifurcations.write_csv(csv, along, items)
        except OSError as error:
            raise Failed(error) from error
        say(csv)


def export(
    file: SweepFile,
    output: Annotated[
        Path,
        typer.Option("-o", "--output", metavar="FILE", help="The .csv or .parquet file to write."),
    ],
) -> None:
    """Write a row for every point: its parameters, and every result that is a single number."""
    from sweeps.analysis.export import check_table, write_points
    from sweeps.store import open_sweep

    check_table(output)
    with open_sweep(file) as dataset, _named(file):
        try:
            rows = write_points(dataset, output)
        except OSError as error:
            raise Failed(error) from error
    say(f"{output}: {rows:,} {'row' if rows == 1 else 'rows'}")
