"""The kinds of pictures by name, and the one call that writes one into a file."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import xarray as xr
from matplotlib.figure import Figure

from sweeps.analysis.selection import Cut, listed, swept_axes
from sweeps.analysis.table import parameter_axes
from sweeps.errors import Refused
from sweeps.plotting.attractor_pictures import attractor_diagram, basins
from sweeps.plotting.bifurcation_diagram import bifurcation
from sweeps.plotting.maps import parameter_map
from sweeps.plotting.point import impacts, section, trajectory
from sweeps.plotting.saving import check_picture, save
from sweeps.plotting.style import STYLE


class Kind(NamedTuple):
    """A kind of picture: the function that draws it, and its options beside `at`."""

    draw: Callable[..., Figure]
    options: tuple[str, ...] = ()


#: The pictures by name.
KINDS: Mapping[str, Kind] = {
    "bifurcation": Kind(bifurcation, ("axes", "coordinate", "exact")),
    "attractors": Kind(attractor_diagram, ("axes", "coordinate")),
    "basins": Kind(basins),
    "map": Kind(parameter_map, ("axes", "quantity", "exact")),
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
        From `sweeps.open_sweep`.
    output : str or Path
        The picture; its ending is one of ``sweeps.plotting.saving.FORMATS``.
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
        ``axes``, ``coordinate`` and ``exact`` of a `bifurcation`, ``axes``, ``quantity`` and
        ``exact`` of a `parameter_map`; None, False or nothing leaves the choice to the picture.

    Returns
    -------
    Path
        `output`.

    Raises
    ------
    Refused
        If the request does not fit the file, or the picture cannot be written there.
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
    for option in options:
        kinds = [name for name, taker in KINDS.items() if option in taker.options]
        if kind not in kinds:
            raise Refused(f"{option} can be chosen for a {' or '.join(kinds)} only, not a {kind}")
    with mpl.rc_context(STYLE):
        save(KINDS[kind].draw(dataset, at=at, **options), output)
    return output


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
