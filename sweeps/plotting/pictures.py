"""Pictures of an opened sweep: their kinds by name, their style, and how they are written.

Every function of ``KINDS`` draws onto a ``Figure`` of its own, without pyplot and its global state.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import xarray as xr
from matplotlib.figure import Figure

from sweeps.analysis.overlay import Line, deviations
from sweeps.analysis.selection import Cut, listed, on_grid, swept_axes
from sweeps.analysis.table import parameter_axes
from sweeps.errors import Failed, Refused
from sweeps.plotting.attractors import attractor_diagram, basins
from sweeps.plotting.bifurcation import bifurcation, branches_of, line_of
from sweeps.plotting.maps import parameter_map
from sweeps.plotting.marks import DPI
from sweeps.plotting.point import impacts, section, trajectory
from sweeps.store.variables import DIRECTION

__all__ = ["KINDS", "compare", "on_grid", "plot"]

FORMATS = ("png", "svg", "pdf")

STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "axes.linewidth": 0.6,
    "axes.formatter.useoffset": False,
    "agg.path.chunksize": 10000,
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
}


class Kind(NamedTuple):
    """A kind of picture: what draws it, and what can be chosen beside the cut through the grid."""

    draw: Callable[..., Figure]
    options: tuple[str, ...] = ()


#: The pictures by name.
KINDS: Mapping[str, Kind] = {
    "bifurcation": Kind(bifurcation, ("axes", "coordinate", "exact")),
    "attractors": Kind(attractor_diagram, ("axes", "coordinate")),
    "basins": Kind(basins),
    "map": Kind(parameter_map, ("axes", "quantity")),
    "section": Kind(section),
    "impacts": Kind(impacts),
    "trajectory": Kind(trajectory),
}


def plot(
    dataset: xr.Dataset,
    output: str | Path,
    kind: str | None = None,
    at: Cut | None = None,
    **options: Any,
) -> Path:
    """Draw one picture of an opened sweep into a file.

    Parameters
    ----------
    dataset : Dataset
        From `sweeps.store.reader.open_sweep`.
    output : str or Path
        The picture; its ending is one of ``FORMATS``.
    kind : str, optional
        One of ``KINDS``. By default ``map`` if a `quantity` is given; otherwise, where x0 or v0
        was swept, the period recorded, and no start chosen by the options, ``basins`` if nothing
        else was swept and ``attractors`` if a parameter was; otherwise ``bifurcation`` where an
        axis was swept, ``trajectory`` if there is one, and ``section``.
    at : mapping of str to float, optional
        Values of the swept axes that are not drawn: the nearest of the grid is taken, and by
        default the first. Where an axis was followed up and down, ``direction`` picks one; by
        default a `bifurcation` shows both, the other pictures the first.
    **options
        ``axes``, ``coordinate`` and ``exact`` of a `bifurcation`, ``axes`` and ``quantity`` of a
        `parameter_map`; None, False or nothing leaves the choice to the picture.

    Returns
    -------
    Path
        `output`.

    Raises
    ------
    Refused
        If the request does not fit the file, or the picture cannot be written.
    """
    output = Path(output)
    data = Path(str(dataset.encoding.get("source", "")))
    if os.path.exists(output) and os.path.isfile(data) and output.samefile(data):
        raise Refused(f"the picture {output} would replace the data; give -o another file")
    check_picture(output)
    options = {name: value for name, value in options.items() if value not in (None, False, ())}
    if kind is None:
        kind = "map" if "quantity" in options else _default_kind(dataset, at or {}, options)
    if kind not in KINDS:
        raise Refused(f"there is no picture {kind!r}; choose one of {listed(KINDS)}")
    for name in options:
        takers = [one for one, its in KINDS.items() if name in its.options]
        if kind not in takers:
            raise Refused(f"{name} can be chosen for a {' or '.join(takers)} only, not a {kind}")
    with mpl.rc_context(STYLE):
        save(KINDS[kind].draw(dataset, at=at, **options), output)
    return output


def compare(
    dataset: xr.Dataset,
    axes: Sequence[str] = (),
    at: Cut | None = None,
    coordinate: str | None = None,
) -> list[str]:
    """Say how far the points of a diagram are from the exact branches that they follow.

    The arguments are those of `bifurcation`.

    Raises
    ------
    Refused
        As from `bifurcation`.
    """
    line, axis, coordinate = line_of(dataset, axes, at, coordinate)
    told = []
    for branch in branches_of(line):
        way = f"{branch[DIRECTION].item()}: " if DIRECTION in branch.coords else ""
        found = [one.told(axis) for one in deviations(Line.of(branch, axis, coordinate))]
        told += [way + text for text in found or ["no point follows a stable one-impact orbit"]]
    return told


def check_picture(output: Path) -> None:
    """Refuse a path that no picture can be written to.

    Raises
    ------
    Refused
        If its ending is none of ``FORMATS``, or its folder does not exist.
    """
    if output.suffix.lower().lstrip(".") not in FORMATS:
        raise Refused(f"{output} must end in one of {listed('.' + f for f in FORMATS)}")
    if not os.path.isdir(output.parent):  # which, unlike Path.is_dir(), never raises
        raise Refused(f"the folder {output.parent} of the picture {output.name} does not exist")
    if os.path.isdir(output):
        raise Refused(f"{output} is a directory; give -o the name of a file")


def save(figure: Figure, output: Path) -> None:
    """Write a figure beside `output` and put it there whole.

    Raises
    ------
    Failed
        If it cannot be written.
    """
    target = Path(os.path.realpath(output))  # resolve() raises where links make a loop
    draft = target.with_name(f".picture-{os.getpid()}{output.suffix}")
    try:
        with warnings.catch_warnings():
            # The name of a sweep may be in a script that the font lacks: it is drawn as boxes.
            warnings.filterwarnings("ignore", "Glyph", UserWarning)
            figure.savefig(draft, dpi=DPI)
        os.replace(draft, target)
    except OSError as error:
        raise Failed(f"{output} cannot be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):  # which must not hide why there is none
            draft.unlink()


def _default_kind(dataset: xr.Dataset, at: Cut, options: Mapping[str, Any]) -> str:
    starts = {"x0", "v0"} & set(swept_axes(dataset))
    chosen = starts & {*at, *options.get("axes", ())} or "exact" in options
    if starts and not chosen and "period" in dataset:
        if parameter_axes(dataset):
            return "attractors"
        if len(starts) == 2 and not options:
            return "basins"
    if swept_axes(dataset):
        return "bifurcation"
    return "trajectory" if "trajectory_x" in dataset else "section"
