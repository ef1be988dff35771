"""Finds what is drawn by its name, or refuses it: line, coordinate, number per point, branches.

This is the only way in which ``quantity``, ``below`` and ``color`` become values, label and units.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NoReturn

import numpy as np
import xarray as xr

from sweeps.config.groups import STARTS
from sweeps.errors import Refused
from sweeps.opened.coordinates import COORDINATES, ORDINATES, SOURCES
from sweeps.opened.opened_sweep import OpenedSweep, Selection
from sweeps.store.variables import DIRECTION, description_in
from sweeps.text import choice_of, listed, near_misses, suggestion
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.points.regimes import has_result
from vibroimpact.status import Status

#: A number for each point: a variable of the file by its name, or values computed from the file.
NameOrArray = str | xr.DataArray

#: The mean force on the stop, which follows from the impulse of the file.
MEAN_FORCE = "mean_force"

#: How far the mass moves, which follows from the extremes of the file.
PEAK_TO_PEAK = "peak_to_peak"


def numbers_of(sweep: OpenedSweep) -> list[str]:
    """List what has a number for each point, results first; the Lyapunov exponents have two."""
    replaced = PARAMETERS.keys() - sweep.nomenclature.parameters.keys()
    variables = [
        str(name)
        for name in (*sweep.data.data_vars, *sweep.data.coords)
        if name not in replaced
        and sweep[name].dtype.kind in "biuf"
        and _is_of_points(sweep, sweep[name], "exponent")
    ]
    follow = [name for name, (sources, _) in _FOLLOWING.items() if set(sources) <= set(variables)]
    return list(dict.fromkeys([*variables, *follow]))


def _mean_force(sweep: OpenedSweep) -> xr.DataArray:
    """Return impulse times omega / (2 pi); no value where the mass rests, which has no impulse."""
    force = sweep["impulse"] * sweep["omega"] / (2.0 * np.pi)
    force = force.where(sweep["rest_fraction"] == 0.0).transpose(*sweep.grid)
    meaning = "mean force on the stop" if sweep.in_rig else "mean force on the stop per mass"
    about = description_in(sweep.attrs, meaning, "N" if sweep.in_rig else "length/time^2")
    return force.assign_attrs(about, symbol=r"\overline{F}")


def _peak_to_peak(sweep: OpenedSweep) -> xr.DataArray:
    """Return the greatest displacement less the least."""
    about, travel = ORDINATES[PEAK_TO_PEAK], sweep["x_max"] - sweep["x_min"]
    described = description_in(sweep.attrs, about.meaning, about.unit)
    return travel.assign_attrs(described, symbol=about.symbol)


# What follows from variables of the file: from which, and how.
_FOLLOWING = {
    MEAN_FORCE: (("impulse", "rest_fraction"), _mean_force),
    PEAK_TO_PEAK: (("x_min", "x_max"), _peak_to_peak),
}


def _is_of_points(sweep: OpenedSweep, values: xr.DataArray, *further: str) -> bool:
    dims = set(values.dims) - set(further)
    return bool(dims) and dims <= set(sweep.grid)


def with_number(
    sweep: OpenedSweep, quantity: NameOrArray, for_colour: bool = False
) -> tuple[OpenedSweep, str]:
    """Return the dataset with a quantity, described like a result, and its name there."""
    sweep, name = (sweep, quantity) if isinstance(quantity, str) else _with_values(sweep, quantity)
    further = [DIRECTION] if for_colour and sweep.directions else []
    if name in further:
        return sweep, name
    sweep.check(*(_FOLLOWING[name][0] if name in _FOLLOWING else [name]), derived=name)
    available = numbers_of(sweep) + further
    if name not in available:
        problem = f"there is no {name or repr(name)}{suggestion(near_misses(name, available))}"
        if name in sweep:
            problem = f"{name} is not a number for each point"
        raise Refused(f"{problem}; {choice_of(available)}")
    if name not in sweep:
        _, computed = _FOLLOWING[name]
        sweep = sweep.with_data(sweep.data.assign({name: computed(sweep)}))
    return sweep, name


def _with_values(sweep: OpenedSweep, values: xr.DataArray) -> tuple[OpenedSweep, str]:
    """Return the dataset with a DataArray computed from it; refuse one that does not fit."""
    name = str("the DataArray" if values.name is None else values.name)
    over = f"expected: numbers over {listed(sweep.grid)}, as in the Dataset"
    if not _is_of_points(sweep, values):
        dims = listed(map(str, values.dims)) or "no dimension"
        raise Refused(f"{name} is over {dims}; {over}")
    if values.dtype.kind not in "biuf":
        raise Refused(f"{name} holds {values.dtype}; {over}")
    for axis in map(sweep.nomenclature.parameter, sweep.grid):
        if axis in values.coords and not values[axis].dims:  # of a cut: no value elsewhere
            is_cut = sweep[axis] == values[axis].item()
            if is_cut.any():  # else refused below
                values = values.drop_vars(axis).astype(float).where(is_cut)
    coords = {*PARAMETERS, *sweep.grid} & {*values.coords} & {*sweep.data.coords}
    is_there = all(values[each].variable.equals(sweep.data[each].variable) for each in coords)
    if not is_there or any(values.sizes[dim] != sweep.sizes[dim] for dim in values.dims):
        raise Refused(f"{name} is at other values of the axes; {over}")
    plain, own = values.drop_vars([*values.coords]), values.attrs
    attrs = {"long_name": name, "symbol": ""}
    if name in sweep and _is_part(plain.variable, sweep[name].variable):
        plain = plain.transpose(*(dim for dim in sweep[name].dims if dim in plain.dims))
        attrs |= sweep[name].attrs
    else:  # calculations keep the attributes of a variable of the file
        of_file = (each.attrs for each in sweep.data.variables.values())
        kept = next((each for each in of_file if each.get("long_name") == own.get("long_name")), {})
        own = {key: value for key, value in own.items() if kept.get(key) != value}
    plain.attrs = attrs | own
    if name in sweep and plain.variable.identical(sweep[name].variable):
        return sweep, name
    while name in sweep:
        name = f"the given {name}"
    return sweep.with_data(sweep.data.assign({name: plain})), name


def _is_part(values: xr.Variable, variable: xr.Variable) -> bool:
    """Whether values are those of a variable, or one of its record, of which some are read."""
    record = {*variable.dims} - {*values.dims}
    some = {dim: slice(None, None, 1 + size // 50) for dim, size in values.sizes.items() if record}
    if not {*values.dims} <= {*variable.dims} or values.dtype.kind != variable.dtype.kind:
        return False
    values = values.isel(some)
    same = (variable.isel(some).astype(values.dtype) == values) | values.isnull()
    return bool(same.all([*values.dims]).any())


def number_at(cut: OpenedSweep, name: str) -> xr.DataArray:
    """Return a number at each point of a cut; the larger exponent of two."""
    number = cut[name]
    if "exponent" in number.dims:
        about = {"symbol": rf"{number.symbol}_1", "long_name": f"larger {number.long_name}"}
        number = number.isel(exponent=0).assign_attrs(about)
    return number.broadcast_like(cut["status"]).transpose(*cut.grid)


def select_line(
    sweep: OpenedSweep,
    axes: Sequence[str] = (),
    at: Selection | None = None,
    coordinate: str | None = None,
) -> tuple[OpenedSweep, str, str]:
    """Return the points that `sweeps.plotting.bifurcation` shows, their axis and coordinate."""
    sweep, coordinate = with_coordinate(sweep, coordinate)
    (axis,) = sweep.chosen_axes(axes, at, 1, "bifurcation")
    return sweep.cut(at, free=[axis, DIRECTION]), axis, coordinate


def with_coordinate(sweep: OpenedSweep, coordinate: str | None) -> tuple[OpenedSweep, str]:
    """Return the dataset with the requested coordinate, by default the first in the file."""
    available = [name for name in COORDINATES if SOURCES.get(name, name) in sweep]
    if coordinate is None:
        coordinate = next(iter([*available, *COORDINATES]))
    if coordinate in available:
        return sweep, coordinate
    available += [name for name in ORDINATES if name not in COORDINATES and "x_min" in sweep]
    choice = choice_of(available, "coordinate")
    if coordinate in ORDINATES and coordinate not in COORDINATES:
        sweep, name = with_number(sweep, coordinate)
        values = sweep[name].expand_dims(ORDINATES[name].dimension, axis=-1)
        return sweep.with_data(sweep.data.assign({name: values})), name
    if coordinate not in sweep:
        meant = suggestion(near_misses(coordinate, available))
        if coordinate in COORDINATES:
            meant, choice = "", f"{choice}; {sweep.to_have(SOURCES.get(coordinate, coordinate))}"
        raise Refused(f"the file has no {coordinate or repr(coordinate)} to draw{meant}; {choice}")
    if coordinate in numbers_of(sweep):
        choice += f"; {coordinate} can be drawn in a panel below the diagram"
    raise Refused(f"{coordinate} is not a coordinate of the motion; {choice}")


def refuse_without_branches(coordinate: str) -> None:
    """Refuse a coordinate that exact branches do not have."""
    if coordinate not in COORDINATES:
        choice = choice_of([*COORDINATES], "coordinate")
        raise Refused(f"exact branches have no {coordinate}; {choice}")


def fitting_orbits(
    exact: xr.Dataset, noun: str, axes: Sequence[str], needed: set[str], cut: OpenedSweep
) -> xr.Dataset:
    """Return exact branches or curves; refuse those of other axes or cuts, or with lost parts."""
    if {*exact.coords} != {*axes}:
        over = listed(map(str, exact.coords))
        raise Refused(f"the exact {noun} are over {over}, not {listed(axes)}")
    if missing := sorted(needed - {*exact, *exact.attrs}):
        raise Refused(f"the exact {noun} have no {listed(missing)}: find them again")
    nomenclature = cut.nomenclature
    for name in sorted(PARAMETERS.keys() & exact.attrs.keys() - {*STARTS}):
        pair = float(exact.attrs[name]), float(cut[name])
        slack = 1e-9 * float(abs(cut.whole[name]).max()) + 1e-15  # linspace passes 0 at 1e-17
        if abs(pair[0] - pair[1]) > slack:
            of_orbits, of_cut = (nomenclature.value(name, value) for value in pair)
            place = f"{nomenclature.name(name)} = {of_orbits:.6g}, not {of_cut:.6g}"
            raise Refused(f"the exact {noun} are at {place}: find them there")
    exact = exact.dropna("point", subset=["m"])  # which `where` may have left out
    typed = {"branch": int, "curve": int, "m": int, "q": int, "stable": bool}
    return exact.assign({name: exact[name].astype(typed[name]) for name in typed.keys() & {*exact}})


def refuse_empty(line: OpenedSweep, coordinate: str) -> NoReturn:
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


def refuse_without_value(values: Any, name: str) -> None:
    """Refuse values of a number or a coordinate, of which none is finite."""
    if not np.isfinite(values).any():
        raise Refused(f"there is nothing to draw: no point has a finite value of {name}")
