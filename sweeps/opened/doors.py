"""`takes_sweep`, the door of every public function: a path, unfit arguments, a rig in SI units.

A file has the names and units of the model. `in_si` gives those of a rig, once, where a command
opens a file or a picture is drawn; the parameters of the model, which computations need, stay
beside those of the rig.
"""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
import xarray as xr

from sweeps.config.rig import MASS, QUANTITIES, Nomenclature
from sweeps.errors import Refused
from sweeps.grid import TABLE
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.store.variables import COLUMN_NAMES, DIRECTION, FLAGS, RECORDS, VARIABLES, attributes_of
from sweeps.store.xarray_engine import open_sweep
from sweeps.text import listed
from vibroimpact.inputs import TEXT, Allowed, input_text, integer, is_number, number, of_python
from vibroimpact.oscillator import PARAMETERS, Parameter

P = ParamSpec("P")
Out = TypeVar("Out")
#: An opened sweep, or the path of its file.
AnySweep = OpenedSweep | xr.Dataset | str | Path

_EXPECTED = "an opened sweep, a selection from one, or the path of its file"


def _is_selection(value: object) -> bool:
    return isinstance(value, Mapping) and all(
        isinstance(name, str) and (is_number(at) or (name == DIRECTION and isinstance(at, str)))
        for name, at in value.items()
    )


def _are_names(value: object) -> bool:
    return isinstance(value, Sequence) and all(map(TEXT.fits, value))


def _is_class(value: object) -> bool:
    several = isinstance(value, Sequence) and len(value) == 2
    return several and integer(1).fits(value[0]) and integer(0).fits(value[1])  # type: ignore[index]


def _collection(fits: Callable[[object], bool], expected: str) -> Allowed:
    """Allow collections, in any order, of what `fits`."""

    def all_fit(value: Any) -> bool:
        several = isinstance(value, Sequence | set | frozenset) and not isinstance(value, str)
        return several and all(map(fits, value))

    return Allowed(all_fit, expected)


def _are_attractors(value: object) -> bool:
    needed = {"attractor", "number", "motion", "m", "q", "section_x", "section_v"}
    return isinstance(value, xr.Dataset) and needed <= set(value)


#: What the arguments of functions of an opened sweep may be, by their names.
ARGUMENTS: Mapping[str, Allowed] = {
    "at": Allowed(_is_selection, "a number for each axis by its name, as {'omega': 2.5}"),
    "axis": Allowed(lambda value: isinstance(value, str), "the name of a swept axis"),
    "axes": Allowed(_are_names, "names of axes, as ['omega', 'R']"),
    "classes": _collection(_is_class, "periods and impacts of classes, as [(1, 1), (3, 3)]"),
    "report": Allowed(callable, "a function of the share of the work that is done"),
    "most": integer(1),
    "kinds": _collection(TEXT.fits, "names of kinds, as ['flip', 'fold', 'graze']"),
    "tolerance": number(lambda value: value > 0.0, "a number > 0"),
    "extensions": integer(0),
    "found": Allowed(_are_attractors, "the result of sweeps.attractors or sweeps.integrity"),
    "numbers": _collection(integer(0).fits, "numbers of attractors, as [0, 1]"),
}
#: The arguments with several names, or DataArrays: one alone means a list of it.
_SEVERAL = ("axes", "kinds", "below", "panels")


#: A function behind the door, and the same with its door.
Inner = Callable[Concatenate[OpenedSweep, P], Out]
Outer = Callable[Concatenate[AnySweep, P], Out]


def takes_sweep(allowed: Mapping[str, Allowed]) -> Callable[[Inner[P, Out]], Outer[P, Out]]:
    """Decorate a function of a sweep: open the file of a path, and refuse unfit arguments.

    What the arguments may be is in ``ARGUMENTS``, or in `allowed` for those of this function.
    """

    def decorated(function: Inner[P, Out]) -> Outer[P, Out]:
        signature = inspect.signature(function)
        first = next(iter(signature.parameters))
        defaults = {name: parameter.default for name, parameter in signature.parameters.items()}
        known = {**ARGUMENTS, **allowed}

        @functools.wraps(function)
        def checked(*arguments: Any, **options: Any) -> Out:
            try:
                bound = signature.bind(*arguments, **options)
            except TypeError as error:  # a wrong number or name
                called = f"{function.__name__}: {error}"
                raise Refused(f"{called}; expected: {', '.join(defaults)}") from None
            sweep = bound.arguments[first]
            for named in (bound.arguments, bound.arguments.get("options", {})):  # of `plot`
                for name, value in named.items():
                    if name in _SEVERAL and isinstance(value, str | xr.DataArray):
                        named[name] = value = [value]
                    if name in known and name != first and value is not defaults.get(name):
                        known[name].checked(name, value, Refused)
            if isinstance(at := bound.arguments.get("at"), Mapping):
                bound.arguments["at"] = {name: of_python(value) for name, value in at.items()}
            if isinstance(sweep, str | Path):
                with open_sweep(sweep) as dataset:
                    bound.arguments[first] = OpenedSweep(dataset)
                    result = function(*bound.args, **bound.kwargs)
                    return result.load() if isinstance(result, xr.Dataset) else result
            if not isinstance(sweep, OpenedSweep):
                bound.arguments[first] = _opened(sweep)
            return function(*bound.args, **bound.kwargs)

        return checked

    return decorated


def _opened(dataset: object) -> OpenedSweep:
    """Return a Dataset as an opened sweep; refuse a part that lacks what was in its file."""
    if not isinstance(dataset, xr.Dataset):
        raise Refused(f"{input_text(dataset)} is no sweep; expected: {_EXPECTED}")
    if not isinstance(dataset.attrs.get("configuration"), str):
        raise Refused(f"the Dataset has no attribute configuration; expected: {_EXPECTED}")
    if "status" not in dataset:
        raise Refused(f"the Dataset has no status; expected: {_EXPECTED}")
    for problem in chain(_axis_problems(dataset), _result_problems(dataset)):
        raise Refused(f"the Dataset {problem}; expected: {_EXPECTED}")
    if DIRECTION in dataset.dims and dataset[DIRECTION][0] == "down":  # sorted by name
        dataset = dataset.isel({DIRECTION: slice(None, None, -1)})
    variables = dataset.variables
    types: dict[Any, Any] = {name: float for name, v in variables.items() if v.dtype.kind == "f"}
    types |= dict.fromkeys(RECORDS.keys() & {*dataset.coords}, int)
    others = (name for name in types if variables[name].dtype != types[name])
    typed = {name: variables[name].astype(types[name]) for name in others}
    integers = {name: each.astype(VARIABLES[name].dtype) for name, each in _integers(dataset)}
    grid = sorted(dataset["status"].dims, key=lambda name: name != DIRECTION)  # as in a file
    ordered = dataset.assign(typed | integers).transpose(*grid, ...)
    for called, variable in ordered.variables.items():  # pandas keeps no attributes
        variable.attrs = attributes_of(str(called), ordered.attrs) | variable.attrs
    return OpenedSweep(ordered)


def _integers(dataset: xr.Dataset) -> Iterator[tuple[str, xr.DataArray]]:
    """Yield each result of integers that is of another type, and flags; `where` left NaN there."""
    for name, variable in VARIABLES.items():
        if name in dataset and variable.dtype[0] == "i":
            if name in FLAGS or dataset.variables[name].dtype != variable.dtype:
                each = dataset[name]
                yield name, each.fillna(variable.fill_value) if each.dtype.kind == "f" else each


def _axis_problems(dataset: xr.Dataset) -> Iterator[str]:
    """Yield what no sweep has in its axes and parameters, and what this Dataset lacks there."""
    dims, coords = [str(name) for name in dataset["status"].dims], dataset.coords
    for name in (*dims, "section", "impact", "exponent"):  # no point may have a sample
        if not dataset.sizes.get(name, 1):
            yield f"has no value of {name}"
    for name in sorted(RECORDS.keys() & {*map(str, coords)}):
        numbers = np.array(coords[name].values.tolist(), ndmin=1)  # also of dtype object
        is_cut = numbers.dtype.kind not in "iuf" or (np.diff(numbers) != 1).any()
        if is_cut or (name == "exponent" and numbers[0] != 0):
            taken = f"isel({name}=slice({'2' if name == 'exponent' else '-8, None'}))"
            yield f"has values of {name} that are not consecutive as in a file: take {taken}"
    for name in (*dims, *PARAMETERS):
        if name not in (*PARAMETERS, DIRECTION, TABLE):
            yield f"has the axis {name}, which no sweep has"
        if name not in coords:
            yield f"has no coordinate {name}"
        if coords[name].dims not in ([(name,)] if name in dims else [(), (TABLE,)]):
            over = listed([*map(str, coords[name].dims)]) or "no axis"
            yield f"has {name} over {over}, as no sweep has"
        values, parameter = coords[name].values, PARAMETERS.get(name)
        if parameter and (values.dtype.kind not in "fiu" or not parameter.accepts(values).all()):
            yield f"has a value of {name} that is not {parameter.allowed}"


def _result_problems(dataset: xr.Dataset) -> Iterator[str]:
    """Yield what no sweep has in its results."""
    dims = (*map(str, dataset["status"].dims),)
    for name, variable in VARIABLES.items():
        expected = {*dims, *([variable.dimension] if variable.dimension else [])}
        if name in dataset and {*dataset.variables[name].dims} != expected:
            yield f"has {name} without its dimensions {', '.join(sorted(expected))}"
        if name in dataset and dataset.variables[name].dtype.kind not in "fiu":
            yield f"has no numbers in {name}"
    for name, numbers in _integers(dataset):
        values = numbers.values
        fits = np.isin(values, [*FLAGS[name]]) if name in FLAGS else values % 1.0 == 0.0
        if not (fits & (abs(values) < 2.0**53)).all():
            yield f"has numbers in {name} that are no integers of a sweep"


# A rig in SI units


def in_si(sweep: OpenedSweep) -> OpenedSweep:
    """Return the sweep with the axes, names and SI units of its rig, if it has one.

    The axes are those of the rig; the parameters of the model stay as further coordinates. The
    results of the file are still read when they are used.
    """
    # Without a rig no table that belongs to a configuration is read.
    has_rig = re.search("^rig:", sweep.attrs["configuration"], re.MULTILINE)
    if sweep.in_rig or not has_rig or (rig := sweep.config.rig) is None:
        return sweep
    dataset, nomenclature = sweep.data, Nomenclature(rig)
    mass = dataset["mass"] if rig.mass_varies else xr.DataArray(rig.mass)
    coordinates: dict[str, Any] = {"mass": (mass.dims, mass.values, _attributes(MASS))}
    for name in PARAMETERS:
        if name in QUANTITIES:
            model, called = dataset[name], nomenclature.name(name)
            attributes = {**model.attrs, **_attributes(nomenclature.about(name))}
            typed = called != name and called in dataset.coords  # a column of the table
            masses = mass.values if rig.mass_varies else None
            values = dataset[called].values if typed else rig.in_si(name, model.values, masses)
            coordinates[called] = model.dims, values, attributes
    si = dataset.assign_coords(coordinates).assign(_results_in_si(dataset, mass))
    axes = (name for name in PARAMETERS if name in dataset.dims)
    si = si.swap_dims({name: nomenclature.name(name) for name in axes})
    if COLUMN_NAMES in si.attrs:
        columns = dict.fromkeys(nomenclature.name(name) for name in si.attrs[COLUMN_NAMES].split())
        si.attrs[COLUMN_NAMES] = " ".join(columns)
    return OpenedSweep(si, sweep, in_rig=True)


def orbits_on_axes(sweep: OpenedSweep, orbits: xr.Dataset) -> xr.Dataset:
    """Return exact branches or curves, over parameters of the model, over the axes."""
    nomenclature = sweep.nomenclature
    axes = {str(k): v for k, v in orbits.coords.items() if k in PARAMETERS}
    if not (nomenclature.rig and axes):  # or they are over those of the rig already
        return orbits
    values = {axis: (v.dims, nomenclature.value(axis, v.values)) for axis, v in axes.items()}
    si = orbits.assign_coords(values)
    if "range" in si.attrs:  # of branches
        limits = np.array(si.attrs["range"])
        si.attrs["range"] = nomenclature.value(next(iter(axes)), limits).tolist()
    return si.rename({axis: nomenclature.name(axis) for axis in axes})


def _results_in_si(dataset: xr.Dataset, mass: xr.DataArray) -> xr.Dataset:
    """Return the results that are given per mass in a file, multiplied when they are read."""
    scaled = {}
    for name in QUANTITIES.keys() - PARAMETERS.keys():
        if name in dataset:
            scaled[name] = dataset.variables[name].copy(deep=False)
            if mass.dims:
                scaled[name] = scaled[name].copy(data=scaled[name].values * mass.values)
            factor = {} if mass.dims else {"scale_factor": mass.item()}
            scaled[name].attrs |= {**_attributes(QUANTITIES[name].description), **factor}
    return xr.decode_cf(xr.Dataset(scaled), decode_times=False)


def _attributes(quantity: Parameter) -> dict[str, str]:
    """Return the attributes of a quantity of the rig, as a file has them for a parameter."""
    return {"long_name": quantity.meaning, "units": quantity.unit, "symbol": quantity.symbol}
