"""The command ``plot``: its options, and `draw_picture` of each file."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sweeps.cli import common
from sweeps.errors import Refused
from sweeps.text import command, fewest_digits, progress_shown
from vibroimpact.inputs import integer

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from sweeps.opened.opened_sweep import OpenedSweep, Selection
    from sweeps.plotting import Page

#: The names of `sweeps.plotting.KINDS`, without the import of matplotlib.
KIND_NAMES = (
    *("bifurcation", "attractors", "basins", "integrity", "map", "section"),
    *("impacts", "trajectory", "table"),
)


def _numbers() -> list[str]:
    """Return the names of the numbers of each point that a file can have."""
    from sweeps.store.variables import VARIABLES

    single = (None, "exponent")
    variables = [name for name, variable in VARIABLES.items() if variable.dimension in single]
    return [*variables, "mean_force", "peak_to_peak"]


# Options that ``zoom`` has, too.
COORDINATE = common.option(
    "NAME",
    "poincare_x, poincare_v, poincare_height, impact_v or impact_phase, or peak_to_peak, x_min or "
    "x_max, as ordinate.",
)
DRAW_EXACT = common.flag(
    "--exact",
    "Draw the exact branches of periodic motions, stable and unstable, with their bifurcations; on "
    "a map, draw bifurcation curves.",
)
PAGE_WIDTH = common.option("LENGTH", "Width of the picture, e.g. 3.4in, 8.6cm or 86mm.")
PAGE_TITLE = common.option("TEXT", "Title instead of the sweep's; may be empty.")
IN_GREY = common.flag("--grey", "Draw for print in greys, hatches, markers and dashes.")
NO_MARKS = common.flag(
    "--no-marks",
    "On a map or a diagram, do not mark motions on their way to m/q, bifurcations and other "
    "special points, and jumps.",
)

#: The kinds of pictures that show several values of an axis.
_OF_SEVERAL = ("section", "impacts", "trajectory", "basins")


def plot_command(
    files: list[Path] = common.argument("OUT.h5...", "The file of each sweep."),
    output: Path | None = common.option(
        "FIGURE",
        "The picture to write, for a single OUT.h5. If not given, OUT.png, or a name with the "
        "kind, quantity and place that are asked for, as OUT-map-energy_lost-R-0.8.png; a motion "
        "also as .gif or .mp4.",
        "-o",
        "--output",
    ),
    kind: str | None = common.option(
        "KIND", f"{', '.join(KIND_NAMES[:-1])} or {KIND_NAMES[-1]}.", names=lambda: KIND_NAMES
    ),
    axis: list[str] | None = common.option(
        "NAME",
        "The swept parameter as abscissa; for a map, then the ordinate; for a table, a column or a "
        "result; repeatable.",
    ),
    at: list[str] = common.option(
        "NAME=VALUE[,...]",
        "Value at which a swept parameter is cut, or direction=up or down for a sweep that was "
        "followed both ways; for a section, impacts, trajectory or basins also several values, as "
        "omega=2.7,2.8; repeatable.",
        default=[],
    ),
    coordinate: str | None = COORDINATE,
    quantity: str | None = common.option(
        "NAME",
        "What a map shows, or the ordinate for a table: a number per point, e.g. period, lyapunov, "
        "energy_lost, mean_force, peak_to_peak, or another that the file has.",
        names=_numbers,
    ),
    exact: bool = DRAW_EXACT,
    classes: str | None = common.OF_CLASSES,
    most: int | None = common.MOST_FOLLOWED,
    kinds: str | None = common.option(
        "KIND,...", "Only curves of these kinds, of flip, fold and graze."
    ),
    csv: Path | None = common.CSV,
    below: list[str] | None = common.option(
        "NAME",
        "A number per point, e.g. lyapunov, in a panel below a bifurcation diagram; repeatable.",
        names=_numbers,
    ),
    color: str | None = common.option(
        "NAME",
        "What colours the points of a diagram or a table, or the sections, impacts or motions of "
        "several points: a number per point, e.g. period or lyapunov, or direction for a sweep "
        "that was followed both ways.",
        names=_numbers,
    ),
    overlay: Path | None = common.option(
        "FILE",
        "Draw the points of a .csv file over a diagram, a map or the picture of a table: columns "
        "with the names of its axes and quantities, in its units unless a name has its own, as "
        "'poincare_x [mm]', and label for the legend.",
    ),
    panels: str | None = common.option(
        "NAME,...",
        "Only these panels, in this order: of an integrity picture fraction, integrity_factor, "
        "local_integrity, basins; of a table its columns.",
    ),
    periods: int | None = common.numeric(
        "--periods", integer(1), "For a trajectory, compute N periods from the last stored state."
    ),
    fps: int | None = common.numeric(
        "--fps", integer(1, 50), "Frames per second of a .gif or .mp4, 25 if not given."
    ),
    width: str | None = PAGE_WIDTH,
    height: str | None = common.option("LENGTH", "Height of the picture, likewise."),
    dpi: int | None = common.numeric("--dpi", integer(10), "Pixels per inch, 300; animations 130."),
    title: str | None = PAGE_TITLE,
    xlim: str | None = common.option(
        "LOW:HIGH",
        "Limits of the abscissa, in the unit that it shows or in one that is given, as 2:3mm.",
    ),
    ylim: str | None = common.option("LOW:HIGH", "Limits of the ordinate, likewise."),
    xlabel: str | None = common.option(
        "TEXT", "Label of the abscissa; a unit in it, as 'gap [mm]', is that of the ticks."
    ),
    ylabel: str | None = common.option("TEXT", "Label of the ordinate, likewise."),
    grey: bool = IN_GREY,
    no_legend: bool = common.flag("--no-legend", "Leave out the legend."),
    no_marks: bool = NO_MARKS,
) -> None:
    """Draw a picture from the file of each sweep."""
    from sweeps.plotting import Page
    from sweeps.plotting.api import check_kind
    from sweeps.plotting.saving import check_picture, refuse_replacing

    if kind is not None:
        check_kind(kind)
    cuts, lists = common.several_of(at)
    if lists:
        _check_several(lists, kind, color)
    if csv is not None and (not exact or len(files) > 1):
        raise Refused(f"--csv {csv} is not allowed here; expected: with --exact, for a single file")
    if not exact and (classes or kinds or most is not None):
        raise Refused("--classes, --kinds and --most are not allowed here; expected: with --exact")
    if csv is not None and overlay is not None:
        refuse_replacing(overlay, csv, "table")
    page = Page(
        width=common.inches("--width", width),
        height=common.inches("--height", height),
        dpi=dpi,
        title=title,
        **common.limits_option("x", xlim),
        **common.limits_option("y", ylim),
        xlabel=xlabel,
        ylabel=ylabel,
        legend=not no_legend,
        marks=not no_marks,
        grey=grey,
    )
    options: dict[str, Any] = {
        "axes": tuple(axis) if axis else None,
        "coordinate": coordinate,
        "quantity": quantity,
        "exact": common.exact_options(classes, most, kinds) if exact else None,
        "below": tuple(below) if below else None,
        "color": color,
        "overlay": overlay,
        "panels": common.at_commas(panels) if panels is not None else None,
        "periods": periods,
        "fps": fps,
    }
    values = {name: "-".join(map(fewest_digits, numbers)) for name, numbers in lists.items()}
    names = [_name(file, kind, cuts | values, options) for file in files]
    figures = common.targets(files, output, names)
    if kind == "basins":
        options["beside"] = lists or None
    else:
        options["color"] = color or next(iter(lists), None)
    with ExitStack() as stack:
        datasets = []
        for file, figure in zip(files, figures, strict=True):  # check all before drawing any
            read = [file] if overlay is None else [file, overlay]
            datasets.append(stack.enter_context(common.opened_in_si(file)))
            check_picture(figure, *read, animated=True)
        for file, figure, dataset in zip(files, figures, datasets, strict=True):
            with common.named(file):
                cut = dataset if kind == "basins" else dataset.at_values(lists)
                draw_picture(cut, figure, kind, cuts, page, csv, **options)
                for name, value in ((axis, number) for axis in lists for number in lists[axis]):
                    common.say_moved(dataset, {name: value}, "drawn")


def _check_several(lists: Mapping[str, list[float]], kind: str | None, color: str | None) -> None:
    """Refuse several values of an axis in a picture that does not show single motions."""
    text = " ".join(f"--at {name}={','.join(map(fewest_digits, lists[name]))}" for name in lists)
    if kind not in _OF_SEVERAL:
        raise Refused(
            f"{text} is not allowed here; expected: with --kind {' or '.join(_OF_SEVERAL)}"
        )
    if len(lists) > 1 and kind != "basins" and color is None:
        raise Refused(f"{text} is not allowed here; expected: with --color, as --color period")


def _name(file: Path, kind: str | None, cuts: Selection, options: Mapping[str, Any]) -> Path:
    """Name a picture after the kind, the quantity and the place that are asked for."""
    words = [] if kind is None else [kind]
    for name, value in options.items():
        if value is None:
            continue
        if name == "exact":
            classes = [f"{m}/{q}" for m, q in value.get("classes", ())]
            most = [f"{value['most']}-branches"] if "most" in value else []
            words += ["exact", *classes, *value.get("kinds", ()), *most]
        elif name in ("periods", "fps"):
            words.append(f"{value}-{name}")
        else:
            # A panel below and a colour have the same names as a quantity.
            words += [name] if name in ("below", "color", "overlay") else []
            value = value.stem if isinstance(value, Path) else value
            words += [value] if isinstance(value, str) else value
    for name, value in cuts.items():
        words += [name, value if isinstance(value, str) else fewest_digits(value)]
    return file.parent / common.name_after(file.stem, words, ".png")


def draw_picture(
    sweep: OpenedSweep,
    figure: Path,
    kind: str | None,
    cuts: Selection,
    page: Page,
    csv: Path | None = None,
    quiet: bool = False,
    **options: Any,
) -> None:
    """Write a picture of an opened sweep; unless `quiet`, report its file and choices for it."""
    from sweeps.plotting import plot
    from sweeps.plotting.api import check_options, default_kind, silent_cuts

    chosen = {name: value for name, value in options.items() if value is not None}
    kind = default_kind(sweep, cuts, **chosen) if kind is None else kind
    check_options(kind, chosen, figure)
    lines: list[str] = []
    table: pd.DataFrame | None = None
    if "exact" in chosen:
        chosen["exact"], lines, table = _exact(sweep, kind, cuts, chosen, quiet)
    with progress_shown("drawing", quiet):
        typed = command(*sys.argv[1:])
        written = plot(sweep, figure, kind, cuts, page=page, command=typed, **chosen)
    if quiet:
        return
    common.say_moved(sweep, cuts, "drawn")
    picks = chosen.get("axes", ()), chosen.get("color")
    fixed = {**cuts, **dict.fromkeys(chosen.get("beside", ()), 0.0)}
    for name, value in silent_cuts(sweep, kind, fixed, *picks).items():
        first, size = f"{value:g}" if isinstance(value, float) else value, sweep.sizes[name]
        common.say(
            f"{name} = {first}, the first of {size}: plot --at {name}=VALUE takes another",
            error=True,
        )
    for line in lines:
        common.say(line)
    common.save_table(csv, table)
    common.say(written)


def _exact(
    sweep: OpenedSweep, kind: str, cut: Selection, options: Mapping[str, Any], quiet: bool
) -> tuple[xr.Dataset, list[str], pd.DataFrame]:
    """Find the exact branches, or the curves of a map; return them, lines to print and a table."""
    from sweeps.bifurcation.exact_branches import MOST_BRANCHES, branches
    from sweeps.bifurcation.exact_curves import curves
    from sweeps.opened import export
    from sweeps.opened.result_cache import with_cache
    from sweeps.plotting.contents import refuse_without_branches, select_line
    from sweeps.plotting.exact_lines import without_idle
    from sweeps.plotting.maps import shown_quantity
    from sweeps.plotting.table_points import read_overlay

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
        read_overlay(overlay, sweep, [[pair[0]], [pair[1]]], name)  # before all is computed
        with progress_shown("following exact orbits", quiet) as report:
            orbits = with_cache(curves, notes.append)(sweep, pair, cut, report, **chosen)
        return orbits, [*orbits.attrs["summary"].split("\n"), *notes], export.curve_table(orbits)
    if "kinds" in chosen:
        raise Refused("--kinds chooses curves over a map, and a diagram shows branches")
    line, axis, coordinate = select_line(sweep, axes, cut, options.get("coordinate"))
    refuse_without_branches(coordinate)
    read_overlay(overlay, sweep, [[axis], [coordinate, *options.get("below", ())]])
    with progress_shown("following exact orbits", quiet) as report:
        orbits = with_cache(branches, notes.append)(sweep, axis, cut, report, **chosen)
    lines = [*orbits.attrs["summary"].split("\n"), *notes]
    if idle := without_idle(orbits, line)[1]:
        lines.append(
            f"branches not drawn, because no motion goes to them: {idle}; "
            f"--most {MOST_BRANCHES + 1} draws them, and --classes those of some classes"
        )
    return orbits, lines, export.branch_table(orbits, coordinate)
