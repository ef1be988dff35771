"""The contents of a picture, asked for by name: the line of a diagram, and numbers per point.

This is the only way in which ``quantity``, ``below`` and ``color`` become values, label and units.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

import numpy as np
import xarray as xr

from sweeps.config.groups import DIAGNOSTICS
from sweeps.errors import Refused
from sweeps.opened.coordinates import COORDINATES
from sweeps.opened.cuts import Selection, chosen_axes, cut_at
from sweeps.opened.dataset import check_diagnostic, nomenclature_of
from sweeps.store import DIRECTION, VARIABLES
from sweeps.store.variables import description_in
from sweeps.text import choice_of, listed, near_miss, suggestion
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.points.regimes import has_result
from vibroimpact.status import Status

#: A variable of the file by its name, or values computed from the file.
Wanted = str | xr.DataArray

#: The mean force on the stop, which follows from the impulse of the file.
MEAN_FORCE = "mean_force"

#: How far the mass moves, which follows from the extremes of the file.
PEAK_TO_PEAK = "peak_to_peak"


def numbers_of(dataset: xr.Dataset) -> list[str]:
    """List what has a number for each point, results first; the Lyapunov exponents have two."""
    replaced = PARAMETERS.keys() - nomenclature_of(dataset).parameters.keys()
    held = [
        str(name)
        for name in (*dataset.data_vars, *dataset.coords)
        if name not in replaced
        and dataset[name].dtype.kind in "biuf"
        and _is_of_points(dataset, dataset[name], "exponent")
    ]
    follow = [name for name, (sources, _) in _FOLLOWING.items() if sources <= set(held)]
    return list(dict.fromkeys([*held, *follow]))


def _mean_force(dataset: xr.Dataset) -> xr.DataArray:
    """Return impulse times omega / (2 pi), without a value where the mass rests on the stop.

    The impulse of the file has no part of the force at rest.
    """
    force = dataset["impulse"] * dataset["omega"] / (2.0 * np.pi)
    force = force.where(dataset["rest_fraction"] == 0.0).transpose(*dataset["status"].dims)
    in_si = nomenclature_of(dataset).in_si
    meaning = "mean force on the stop" if in_si else "mean force on the stop per mass"
    about = description_in(dataset.attrs, meaning, "N" if in_si else "length/time^2")
    return force.assign_attrs(about, symbol=r"\overline{F}")


def _peak_to_peak(dataset: xr.Dataset) -> xr.DataArray:
    """Return the greatest displacement less the least."""
    about = description_in(dataset.attrs, "peak-to-peak displacement", "length")
    travel = dataset["x_max"] - dataset["x_min"]
    return travel.assign_attrs(about, symbol=r"x_\mathrm{pp}")


# What follows from variables of the file: from which, and how.
_FOLLOWING = {
    MEAN_FORCE: ({"impulse", "rest_fraction"}, _mean_force),
    PEAK_TO_PEAK: ({"x_min", "x_max"}, _peak_to_peak),
}


def _is_of_points(dataset: xr.Dataset, values: xr.DataArray, *further: str) -> bool:
    own = set(values.dims) - set(further)
    return bool(own) and own <= set(dataset["status"].dims)


def with_number(
    dataset: xr.Dataset, wanted: Wanted, further: Sequence[str] = ()
) -> tuple[xr.Dataset, str]:
    """Return the dataset with what is wanted, described like a result, and its name there.

    A refusal also names what else is allowed, the `further` names.
    """
    if isinstance(wanted, str):
        name = wanted
    else:
        dataset, name = _with_own(dataset, wanted)
    needed = "x_min" if name == PEAK_TO_PEAK else name
    if needed in VARIABLES and VARIABLES[needed].diagnostic in DIAGNOSTICS:
        check_diagnostic(dataset, needed)
    available = numbers_of(dataset)
    if name not in available:
        available += further
        problem = f"there is no {name or repr(name)}{suggestion(near_miss(name, available))}"
        if name in dataset:
            problem = f"{name} is not a number for each point"
        raise Refused(f"{problem}; {choice_of(available)}")
    if name not in dataset:
        _, computed = _FOLLOWING[name]
        dataset = dataset.assign({name: computed(dataset)})
    about = {"long_name": name, "symbol": ""} | dataset[name].attrs
    described = dataset.copy()
    described[name].attrs = about
    return described, name


def _with_own(dataset: xr.Dataset, values: xr.DataArray) -> tuple[xr.Dataset, str]:
    """Return the dataset with a DataArray computed from it; refuse one that does not fit."""
    name, dims = (
        str("the DataArray" if values.name is None else values.name),
        dataset["status"].dims,
    )
    if name in dataset and values.identical(dataset[name]):
        return dataset, name
    over = f"expected: numbers over {listed(map(str, dims))}, as in the Dataset"
    if not _is_of_points(dataset, values):
        own = listed(map(str, values.dims)) or "no dimension"
        raise Refused(f"{name} is over {own}; {over}")
    if values.dtype.kind not in "biuf":
        raise Refused(f"{name} holds {values.dtype}; {over}")
    try:
        xr.align(dataset["status"], values, join="exact")
    except ValueError:
        raise Refused(f"{name} is at other values of the axes; {over}") from None
    about = {"long_name": name} | values.attrs
    while name in dataset:
        name += "'"
    plain = values.drop_vars([one for one in values.coords if one not in values.dims])
    return dataset.assign({name: plain.assign_attrs(about)}), name


def number_at(cut: xr.Dataset, name: str) -> xr.DataArray:
    """Return a number at each point of a cut; the larger exponent of two."""
    number = cut[name]
    if "exponent" in number.dims:
        about = {"symbol": rf"{number.symbol}_1", "long_name": f"larger {number.long_name}"}
        number = number.isel(exponent=0).assign_attrs(about)
    return number.broadcast_like(cut["status"]).transpose(*cut["status"].dims)


def select_line(
    dataset: xr.Dataset,
    axes: Sequence[str] = (),
    at: Selection | None = None,
    coordinate: str | None = None,
) -> tuple[xr.Dataset, str, str]:
    """Return the points that `sweeps.plotting.bifurcation` shows, their axis and coordinate."""
    (axis,) = chosen_axes(dataset, axes, at, 1, "bifurcation")
    coordinate = choose_coordinate(dataset, coordinate)
    return cut_at(dataset, at, free=[axis, DIRECTION]), axis, coordinate


def choose_coordinate(dataset: xr.Dataset, coordinate: str | None) -> str:
    """Return the requested coordinate, by default the first in the file; refuse unknown ones."""
    available = [name for name, about in COORDINATES.items() if about.dimension in dataset.dims]
    if coordinate is None:
        coordinate = next(iter([*available, *COORDINATES]))
    if coordinate in available:
        return coordinate
    choice = choice_of(available, "coordinate")
    if coordinate not in dataset:
        raise Refused(f"the file has no {coordinate or repr(coordinate)} to draw; {choice}")
    if coordinate in numbers_of(dataset):
        choice += f"; {coordinate} can be drawn in a panel below the diagram"
    raise Refused(f"{coordinate} is not a coordinate of the motion; {choice}")


def refuse_empty(line: xr.Dataset, coordinate: str) -> NoReturn:
    """Refuse a line that has no value of a coordinate, and say why."""
    refuse_without_result(line["status"].values)
    raise Refused(
        f"there is nothing to draw: no impact was recorded, so no point has {coordinate}; "
        "the coordinate poincare_x shows the motion"
    )


def refuse_without_result(status: np.ndarray) -> None:
    """Refuse points of which none has a result, and say why."""
    if has_result(status).any():
        return
    reasons = [
        f"{Status(outcome).meaning} ({count:,})"
        for outcome, count in zip(*np.unique(status, return_counts=True), strict=True)
    ]
    raise Refused(f"there is nothing to draw, no point has a result: {listed(reasons)}")
