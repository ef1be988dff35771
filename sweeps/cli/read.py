"""Commands that read files: ``info``, ``compare``, ``attractors``, ``integrity``, ``export``."""

from __future__ import annotations

import codecs
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from sweeps.cli import common
from sweeps.errors import Refused
from sweeps.text import progress_shown, shown_count
from vibroimpact.inputs import number, one_of

if TYPE_CHECKING:
    import xarray as xr

    from sweeps.opened.opened_sweep import OpenedSweep, Selection


def attractors_command(
    file: Path = common.SWEEP_FILE,
    at: list[str] = common.CUT_AT,
    csv: Path | None = common.CSV,
    json: bool = common.JSON,
) -> None:
    """List the attractors of a sweep, their impact speeds, and how many starts reach each."""
    from sweeps.attractor.attractors import attractors

    _show_attractors(file, at, csv, json, "looking for attractors", attractors)


def integrity_command(
    file: Path = common.SWEEP_FILE,
    at: list[str] = common.CUT_AT,
    csv: Path | None = common.CSV,
    json: bool = common.JSON,
) -> None:
    """Show how large a disturbance each attractor takes, and at one point the least knock."""
    from sweeps.attractor.integrity import integrity
    from sweeps.attractor.knocks import knocks
    from sweeps.opened.result_cache import with_cache

    notes = list[str]()

    def find(starts: OpenedSweep) -> xr.Dataset:
        result = integrity(starts)
        alone = not result["attractors"].ndim and starts.spec.impact == "exact"
        return with_cache(knocks, notes.append)(starts, result) if alone else result

    _show_attractors(file, at, csv, json, "measuring the integrity of attractors", find)
    for note in notes:
        common.say(note, error=json)


def _show_attractors(
    file: Path,
    at: Sequence[str],
    csv: Path | None,
    json: bool,
    work: str,
    find: Callable[[OpenedSweep], xr.Dataset],
) -> None:
    """Show the attractors that are found in a part of a sweep, and write them to a CSV file."""
    from sweeps.attractor import attractor_table as text
    from sweeps.opened.export import json_rows, json_text, refuse_points

    cuts = common.selection_of(at)
    with common.opened_in_si(file) as sweep, common.named(file):
        refuse_points(sweep.whole.columns, csv)
        part = text.starts_at(sweep, cuts)
        with progress_shown(work):
            result = find(part)
        common.say_moved(sweep, cuts, "shown")
        rows = text.attractor_rows(part, result)
        table = text.attractor_frame(rows)
        if json:
            common.say(json_text({"attractors": json_rows(table)}))
        else:
            common.say(text.attractor_report(part, result, rows))
        common.save_table(csv, table, error=json)


def info_command(
    file: Path = common.SWEEP_FILE,
    bifurcations: bool = common.flag(
        "--bifurcations",
        "List instead where the class of the motion changes, and the exact bifurcations.",
    ),
    axis: str | None = common.option("NAME", "The swept parameter along which to look."),
    at: list[str] = common.CUT_AT,
    classes: str | None = common.OF_CLASSES,
    most: int | None = common.MOST_FOLLOWED,
    csv: Path | None = common.CSV,
    config: bool = common.flag("--config", "Print only the configuration, as YAML to run again."),
    json: bool = common.JSON,
) -> None:
    """Show the contents of a sweep file, with its configuration."""
    for other, is_set in (("--bifurcations", bifurcations), ("--json", json)):
        if config and is_set:
            raise Refused(f"--config and {other} exclude each other; give one of them")
    options = {"axis": axis, "at": " ".join(at), "csv": csv, "classes": classes, "most": most}
    for name, value in options.items():
        if value and not bifurcations:
            raise Refused(f"--{name} {value} is not allowed here; expected: with --bifurcations")
    cuts = common.selection_of(at)
    with common.opened_in_si(file) as sweep, common.named(file):
        if bifurcations:
            chosen = common.exact_options(classes, most)
            _show_bifurcations(sweep, file, axis, cuts, csv, json, chosen)
        elif config:
            _show_configuration(sweep)
        else:
            from sweeps.opened.export import contents, contents_by_key, json_text

            if json:
                common.say(json_text(contents_by_key(sweep)))
            else:
                common.say(contents(sweep), end=False)


def _show_configuration(sweep: OpenedSweep) -> None:
    """Show the configuration, including its table; refuse a table that is too long for YAML."""
    rows = sweep.sizes.get("point", 0)
    if rows > 1000:
        raise Refused(f"{rows:,} rows are too many for YAML; run also accepts the file itself")
    encoding = getattr(sys.stdout, "encoding", "utf-8")  # without stdout nothing is shown
    # In ASCII `run` reads it also if PowerShell has written it to a file.
    in_utf_8 = codecs.lookup(encoding).name == "utf-8"
    common.say(sweep.config.to_yaml(ascii=not in_utf_8), end=False)


def _show_bifurcations(
    sweep: OpenedSweep,
    file: Path,
    axis: str | None,
    cuts: Selection,
    csv: Path | None,
    json: bool,
    chosen: Mapping[str, Any],
) -> None:
    """Show the bifurcations along an axis, and write them to a CSV file if one is given."""
    from sweeps.bifurcation.bifurcation_report import bifurcation_report
    from sweeps.bifurcation.bifurcation_table import find_bifurcations, public_table
    from sweeps.opened.export import json_rows, json_text
    from sweeps.opened.result_cache import with_cache

    notes = list[str]()
    with progress_shown("following exact orbits") as report:
        keep = partial(with_cache, say=notes.append)
        changes = find_bifurcations(sweep, axis, cuts, report, keep, **chosen)
    common.say_moved(sweep, cuts, "listed")
    listed = public_table(changes)
    if json:
        common.say(json_text(listed.attrs | {"bifurcations": json_rows(listed)}))
    else:
        common.say(bifurcation_report(sweep, file, changes))
    for note in dict.fromkeys(notes):  # of changes of class and of exact orbits
        common.say(note, error=json)
    common.save_table(csv, listed, error=json)


def compare_command(
    first: Path = common.SWEEP_FILE,
    second: Path = common.argument("OTHER.h5", "The file of another sweep."),
    rtol: float = common.numeric(
        "--rtol",
        number(lambda value: 0.0 <= value < 1.0, "a number from 0 to below 1, as 1e-9"),
        "Relative difference of two numbers that still counts as equal.",
        "NUMBER",
        0.0,
    ),
    atol: float = common.numeric(
        "--atol",
        number(lambda value: value >= 0.0, "a number from 0, as 1e-9"),
        "Difference of two numbers that still counts as equal, in addition to --rtol.",
        "NUMBER",
        0.0,
    ),
) -> None:
    """Say what differs in two sweeps, where first and by how much; exit with 1 if anything does."""
    from sweeps.opened.comparison import comparison_report

    with common.opened_sweep(first) as data, common.opened_sweep(second) as other_data:
        with common.named(f"{first}, {second}"):
            text, differ = comparison_report(
                data, other_data, (str(first), str(second)), rtol, atol
            )
        common.say(text)
    if differ:
        raise typer.Exit(1)


def export_command(
    file: Path = common.SWEEP_FILE,
    output: Path = common.new_file(
        "-o", ".csv", "table", "The .csv file to write.", "--output", default=...
    ),
    rows: str = common.option(
        "NAME",
        "What has a row: points, sections or impacts.",
        names=lambda: ("points", "sections", "impacts"),
        default="points",
    ),
    at: list[str] = common.CUT_AT,
) -> None:
    """Write a row for every point, with its class and numbers, or every section or impact."""
    from sweeps.opened.export import ROWS, write_rows

    one_of(ROWS).checked("--rows", rows, Refused)
    cuts = common.selection_of(at)
    with common.opened_in_si(file) as sweep, common.named(file):
        cut = sweep.at_values({name: [value] for name, value in cuts.items()})
        written = write_rows(cut, output, rows)
        left_out = cut.left_out("impact") if rows == "impacts" else ""
        common.say_moved(sweep, cuts, "written")
    points = "; the file has only the " + left_out + " of a point" if left_out else ""
    common.say(f"{output}: {shown_count(written, 'row')}{points}")
