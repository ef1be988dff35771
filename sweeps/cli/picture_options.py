"""The options of the command ``plot``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sweeps.cli.options import completion, number_option
from vibroimpact.inputs import integer

Files = Annotated[list[Path], typer.Argument(metavar="OUT.h5...", help="The file of each sweep.")]
FigureFile = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--output",
        metavar="FIGURE",
        help="The picture to write, for a single OUT.h5. If not given, OUT.png, or a name with the "
        "kind, quantity and place that are asked for, as OUT-map-energy_lost-R-0.8.png.",
    ),
]
#: The names of `sweeps.plotting.KINDS`, without the import of matplotlib.
KIND_NAMES = (
    *("bifurcation", "attractors", "basins", "integrity", "map", "section"),
    *("impacts", "trajectory", "table"),
)
PictureKind = Annotated[
    str | None,
    typer.Option(
        metavar="KIND",
        autocompletion=completion(lambda: KIND_NAMES),
        help=f"{', '.join(KIND_NAMES[:-1])} or {KIND_NAMES[-1]}.",
    ),
]
AxisNames = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="The swept parameter as abscissa; for a map, then the ordinate; for a table, a column "
        "or a result; repeatable.",
    ),
]
PictureAt = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUE[,...]",
        help="Value at which a swept parameter is cut, or direction=up or down for a sweep that "
        "was followed both ways; for a section, impacts, trajectory or basins also several "
        "values, as omega=2.7,2.8; repeatable.",
    ),
]
Coordinate = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="poincare_x, poincare_v, poincare_height, impact_v or impact_phase, as ordinate.",
    ),
]
QuantityOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="What a map shows, or the ordinate for a table: a number per point, e.g. period, "
        "lyapunov, energy_lost, mean_force, peak_to_peak, or another that the file has.",
    ),
]
Color = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="What colours the points of a diagram or a table, or the sections, impacts or motions "
        "of several points: a number per point, e.g. period or lyapunov, or direction for a sweep "
        "that was followed both ways.",
    ),
]
Exact = Annotated[
    bool,
    typer.Option(
        "--exact",
        help="Draw the exact branches of periodic motions, stable and unstable, with their "
        "bifurcations; on a map, draw bifurcation curves. --csv writes what is drawn.",
    ),
]
Kinds = Annotated[
    str | None,
    typer.Option(metavar="KIND,...", help="Only curves of these kinds, of flip, fold and graze."),
]
Below = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="A number per point, e.g. lyapunov, in a panel below a bifurcation diagram; "
        "repeatable.",
    ),
]
PanelNames = Annotated[
    str | None,
    typer.Option(
        "--panels",
        metavar="NAME,...",
        help="Only these panels, in this order: of an integrity picture fraction, "
        "integrity_factor, local_integrity, basins; of a table its columns.",
    ),
]
OverlayFile = Annotated[
    Path | None,
    typer.Option(
        "--overlay",
        metavar="FILE",
        help="Draw the points of a .csv file over a diagram, a map or the picture of a table: "
        "columns with the names of its axes and quantities, in its units unless a name has its "
        "own, as 'poincare_x [mm]', and label for the legend.",
    ),
]
Periods = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        parser=number_option("--periods", integer(1)),
        help="For a trajectory, compute N periods from the last stored state.",
    ),
]
Width = Annotated[
    str | None,
    typer.Option(metavar="LENGTH", help="Width of the picture, e.g. 3.4in, 8.6cm or 86mm."),
]
Height = Annotated[
    str | None, typer.Option(metavar="LENGTH", help="Height of the picture, likewise.")
]
Resolution = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        parser=number_option("--dpi", integer(10)),
        help="Pixels per inch, 300 if not given.",
    ),
]
Title = Annotated[
    str | None, typer.Option(metavar="TEXT", help="Title instead of the sweep's; may be empty.")
]
AbscissaLimits = Annotated[
    str | None, typer.Option(metavar="LOW:HIGH", help="Limits of the abscissa.")
]
OrdinateLimits = Annotated[
    str | None, typer.Option(metavar="LOW:HIGH", help="Limits of the ordinate.")
]
AbscissaLabel = Annotated[
    str | None,
    typer.Option(
        metavar="TEXT",
        help="Label of the abscissa; a unit in it, as 'gap [mm]', is that of the ticks.",
    ),
]
OrdinateLabel = Annotated[
    str | None, typer.Option(metavar="TEXT", help="Label of the ordinate, likewise.")
]
Grey = Annotated[
    bool, typer.Option("--grey", help="Draw for print in greys, hatches, markers and dashes.")
]
NoLegend = Annotated[bool, typer.Option("--no-legend", help="Leave out the legend.")]
NoMarks = Annotated[
    bool,
    typer.Option(
        "--no-marks",
        help="On a map or a diagram, do not mark motions on their way to m/q, bifurcations and "
        "other special points, and jumps.",
    ),
]
