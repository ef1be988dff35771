"""The command ``plot``: a picture of each file, with its name, limits and exact orbits.

As in ``main.py``, modules are imported inside the command.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sweeps.cli.options import (
    Classes,
    Csv,
    MostBranches,
    branch_options,
    inches,
    limits_option,
    named,
    opened_in_si,
    progress_shown,
    say,
    say_moved,
    several_of,
    targets,
)
from sweeps.cli.picture_options import (
    AbscissaLabel,
    AbscissaLimits,
    AxisNames,
    Below,
    Color,
    Coordinate,
    Exact,
    FigureFile,
    Files,
    Grey,
    Height,
    Kinds,
    NoLegend,
    NoMarks,
    OrdinateLabel,
    OrdinateLimits,
    OverlayFile,
    PanelNames,
    Periods,
    PictureAt,
    PictureKind,
    QuantityOption,
    Resolution,
    Title,
    Width,
)
from sweeps.errors import Refused
from sweeps.text import command, fewest_digits

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from sweeps.opened.opened_sweep import OpenedSweep, Selection


#: The kinds of pictures that show several values of an axis.
_OF_SEVERAL = ("section", "impacts", "trajectory", "basins")


def plot_command(
    files: Files,
    output: FigureFile = None,
    kind: PictureKind = None,
    axis: AxisNames = None,
    at: PictureAt = None,
    coordinate: Coordinate = None,
    quantity: QuantityOption = None,
    exact: Exact = False,
    classes: Classes = None,
    most: MostBranches = None,
    kinds: Kinds = None,
    csv: Csv = None,
    below: Below = None,
    color: Color = None,
    overlay: OverlayFile = None,
    panels: PanelNames = None,
    periods: Periods = None,
    width: Width = None,
    height: Height = None,
    dpi: Resolution = None,
    title: Title = None,
    xlim: AbscissaLimits = None,
    ylim: OrdinateLimits = None,
    xlabel: AbscissaLabel = None,
    ylabel: OrdinateLabel = None,
    grey: Grey = False,
    no_legend: NoLegend = False,
    no_marks: NoMarks = False,
) -> None:
    """Draw a picture from the file of each sweep."""
    from sweeps.plotting.api import check_kind
    from sweeps.plotting.saving import check_picture, refuse_replacing

    if kind is not None:
        check_kind(kind)
    cuts, lists = several_of(at)
    if lists:
        _check_several(lists, kind, color)
    if csv is not None and (not exact or len(files) > 1):
        raise Refused(f"--csv {csv} is not allowed here; expected: with --exact, for a single file")
    if not exact and (classes or kinds or most is not None):
        raise Refused("--classes, --kinds and --most are not allowed here; expected: with --exact")
    if csv is not None and overlay is not None:
        refuse_replacing(overlay, csv, "table")
    page = {
        "width": inches("--width", width),
        "height": inches("--height", height),
        "dpi": dpi,
        "title": title,
        "xlim": limits_option("--xlim", xlim),
        "ylim": limits_option("--ylim", ylim),
        "xlabel": xlabel,
        "ylabel": ylabel,
        "legend": not no_legend,
        "marks": not no_marks,
        "grey": grey,
    }
    options = {
        "axes": tuple(axis) if axis else None,
        "coordinate": coordinate,
        "quantity": quantity,
        "exact": _chosen_orbits(classes, most, kinds) if exact else None,
        "below": tuple(below) if below else None,
        "color": color,
        "overlay": overlay,
        "panels": _at_commas(panels) if panels is not None else None,
        "periods": periods,
    }
    values = {name: "-".join(map(fewest_digits, given)) for name, given in lists.items()}
    names = [_name(file, kind, cuts | values, options) for file in files]
    figures = targets(files, output, names)
    if kind == "basins":
        options["beside"] = lists or None
    else:
        options["color"] = color or next(iter(lists), None)
    with ExitStack() as stack:
        datasets = []
        for file, figure in zip(files, figures, strict=True):  # check all before drawing any
            check_picture(figure, file, *([] if overlay is None else [overlay]))
            datasets.append(stack.enter_context(opened_in_si(file)))
        for file, figure, dataset in zip(files, figures, datasets, strict=True):
            with named(file):
                shown = dataset if kind == "basins" else dataset.several(lists)
                draw_picture(shown, figure, kind, cuts, page, csv, **options)
                for name, value in ((axis, one) for axis in lists for one in lists[axis]):
                    say_moved(dataset, {name: value}, "drawn")


def _check_several(lists: Mapping[str, list[float]], kind: str | None, color: str | None) -> None:
    """Refuse several values of an axis in a picture that does not show single motions."""
    given = " ".join(f"--at {name}={','.join(map(fewest_digits, lists[name]))}" for name in lists)
    if kind not in _OF_SEVERAL:
        raise Refused(
            f"{given} is not allowed here; expected: with --kind {' or '.join(_OF_SEVERAL)}"
        )
    if len(lists) > 1 and kind != "basins" and color is None:
        raise Refused(f"{given} is not allowed here; expected: with --color, as --color period")


def _chosen_orbits(classes: str | None, most: int | None, kinds: str | None) -> dict[str, Any]:
    """Convert the choice of exact branches or curves to arguments of `branches` or `curves`."""
    chosen = branch_options(classes, most)
    return chosen if kinds is None else chosen | {"kinds": _at_commas(kinds)}


def _at_commas(text: str) -> list[str]:
    """Split a text at its commas."""
    return re.split(r"\s*,\s*", text.strip())


def _name(file: Path, kind: str | None, cuts: Selection, options: Mapping[str, Any]) -> Path:
    """Name a picture after the kind, the quantity and the place that are asked for."""
    words = [] if kind is None else [kind]
    for option, value in options.items():
        if value is None:
            continue
        if option == "exact":
            classes = [f"{m}/{q}" for m, q in value.get("classes", ())]
            most = [f"{value['most']}-branches"] if "most" in value else []
            words += ["exact", *classes, *value.get("kinds", ()), *most]
        elif option in ("below", "color"):  # these take the same names as a quantity
            words += [option, *([value] if isinstance(value, str) else value)]
        elif option == "overlay":
            words += [option, value.stem]
        elif option == "periods":
            words.append(f"{value}-periods")
        else:
            words += [value] if isinstance(value, str) else value
    for name, value in cuts.items():
        words += [name, value if isinstance(value, str) else fewest_digits(value)]
    asked = re.sub(r"[^\w.+-]", "_", "-".join(words))  # valid in a name on every system
    return file.parent / (f"{file.stem}-{asked}.png" if asked else f"{file.stem}.png")


def draw_picture(
    sweep: OpenedSweep,
    figure: Path,
    kind: str | None,
    cuts: Selection,
    page: Mapping[str, Any],
    csv: Path | None = None,
    **options: Any,
) -> None:
    """Write a picture of an opened sweep; report its file and the choices made for it."""
    from sweeps.plotting import Page, plot
    from sweeps.plotting.api import check_options, default_kind, silent_cuts

    chosen = {name: value for name, value in options.items() if value is not None}
    kind = default_kind(sweep, cuts, **chosen) if kind is None else kind
    check_options(kind, chosen)
    lines: list[str] = []
    table: pd.DataFrame | None = None
    if "exact" in chosen:
        chosen["exact"], lines, table = _exact(sweep, kind, cuts, chosen)
    with progress_shown("drawing"):
        written = plot(
            sweep, figure, kind, cuts, page=Page(**page), command=command(*sys.argv[1:]), **chosen
        )
    say_moved(sweep, cuts, "drawn")
    picks = chosen.get("axes", ()), chosen.get("color")
    fixed = {**cuts, **dict.fromkeys(chosen.get("beside", ()), 0.0)}
    for name, value in silent_cuts(sweep, kind, fixed, *picks).items():
        shown, size = f"{value:g}" if isinstance(value, float) else value, sweep.sizes[name]
        say(f"{name} = {shown}, the first of {size}: --at {name}=VALUE takes another", error=True)
    for line in lines:
        say(line)
    if csv is not None and table is not None:
        from sweeps.opened.tables import write_csv

        write_csv(csv, table)
        say(csv)
    say(written)


def _exact(
    sweep: OpenedSweep, kind: str, cut: Selection, options: Mapping[str, Any]
) -> tuple[xr.Dataset, list[str], pd.DataFrame]:
    """Find the exact branches, or the curves of a map; return them, lines to print and a table."""
    from sweeps.bifurcation.exact_branches import MOST_BRANCHES, branches
    from sweeps.bifurcation.exact_curves import curves
    from sweeps.bifurcation.kept import with_cache
    from sweeps.opened import tables
    from sweeps.plotting.contents import select_line
    from sweeps.plotting.exact_lines import without_idle
    from sweeps.plotting.maps import shown_quantity
    from sweeps.plotting.overlay import read_overlay

    axes, chosen, notes = options.get("axes", ()), options["exact"], list[str]()
    overlay = options.get("overlay")
    if kind == "map":
        if "most" in chosen:
            raise Refused(
                f"--most {chosen['most']} limits exact branches, and a map shows curves; expected: "
                "--exact, with or without --classes"
            )
        pair = sweep.map_axes(axes, cut)
        name = str(shown_quantity(sweep, options.get("quantity")))
        read_overlay(overlay, sweep, [[one] for one in pair], name)  # before all is computed
        with progress_shown("following exact orbits") as report:
            found = with_cache(curves, notes.append)(sweep, pair, cut, report, **chosen)
        return found, [*found.attrs["summary"].split("\n"), *notes], tables.curve_table(found)
    if "kinds" in chosen:
        raise Refused("--kinds chooses curves over a map, and a diagram shows branches")
    line, axis, coordinate = select_line(sweep, axes, cut, options.get("coordinate"))
    read_overlay(overlay, sweep, [[axis], [coordinate, *options.get("below", ())]])
    with progress_shown("following exact orbits") as report:
        found = with_cache(branches, notes.append)(sweep, axis, cut, report, **chosen)
    lines = [*found.attrs["summary"].split("\n"), *notes]
    if idle := without_idle(found, line)[1]:
        lines.append(
            f"branches not drawn, because no motion goes to them: {idle}; "
            f"--most {MOST_BRANCHES + 1} draws all, and --classes those of some classes"
        )
    return found, lines, tables.branch_table(found, coordinate)
