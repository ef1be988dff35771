"""A sweep of a rig as its user reads it: with the axes, names and SI units of the rig.

`in_si` converts a sweep once, where a file is opened or a picture is drawn. What is computed from
the sweep is then in SI units, too: the parameters of the model, which computations need, stay
beside those of the rig.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from sweeps.analysis.dataset import config_of
from sweeps.config.rig import (
    MASS,
    QUANTITIES,
    RigConfig,
    model_name,
    parameter_of,
    si_name,
    si_value,
    si_values,
)
from sweeps.store.variables import COLUMNS
from vibroimpact.oscillator import PARAMETERS, Parameter

#: Attribute that marks a dataset in SI units.
IN_SI = "in_si"


def rig_of(dataset: xr.Dataset) -> RigConfig | None:
    """Return the rig of an opened sweep, if it has one."""
    text = dataset.attrs["configuration"]
    if isinstance(text, str) and not re.search("^rig:", text, re.MULTILINE):
        return None  # without reading a table
    return config_of(dataset).rig


def in_si(dataset: xr.Dataset) -> xr.Dataset:
    """Return an opened sweep with the axes, names and SI units of its rig, if it has one.

    The axes are those of the rig; the parameters of the model stay as further coordinates. The
    results of the file are still read when they are used.
    """
    rig = rig_of(dataset)
    if rig is None or IN_SI in dataset.attrs:
        return dataset
    mass = dataset["mass"] if rig.mass_varies else xr.DataArray(rig.mass)
    coordinates: dict[str, Any] = {"mass": (mass.dims, mass.values, _about(MASS))}
    for name in PARAMETERS:
        if name in QUANTITIES:
            own, called = dataset[name], si_name(name, rig)
            about = {**own.attrs, **_about(QUANTITIES[name].description)}
            typed = called != name and called in dataset.coords  # a column of the table
            masses = mass.values if rig.mass_varies else None
            values = dataset[called].values if typed else rig.in_si(name, own.values, masses)
            coordinates[called] = own.dims, values, about
    si = dataset.assign_coords(coordinates).assign(_results_in_si(dataset, mass))
    si = si.swap_dims({name: si_name(name, rig) for name in PARAMETERS if name in dataset.dims})
    if COLUMNS in si.attrs:  # a table: its configuration could not be read under the new names
        columns = dict.fromkeys(si_name(name, rig) for name in si.attrs[COLUMNS].split())
        si.attrs |= {"configuration": config_of(dataset), COLUMNS: " ".join(columns)}
    return si.assign_attrs({IN_SI: 1})


def _results_in_si(dataset: xr.Dataset, mass: xr.DataArray) -> xr.Dataset:
    """Return the results that are given per mass in a file, multiplied when they are read.

    With a mass of each row of a table, they are multiplied at once.
    """
    scaled = {}
    for name in QUANTITIES.keys() - PARAMETERS.keys():
        if name in dataset:
            scaled[name] = dataset.variables[name].copy(deep=False)
            if mass.dims:
                scaled[name] = scaled[name].copy(data=scaled[name].values * mass.values)
            factor = {} if mass.dims else {"scale_factor": mass.item()}
            scaled[name].attrs |= {**_about(QUANTITIES[name].description), **factor}
    return xr.decode_cf(xr.Dataset(scaled), decode_times=False)


def _about(quantity: Parameter) -> dict[str, str]:
    """Return the attributes of a quantity of the rig, as a file has them for a parameter."""
    return {"long_name": quantity.meaning, "units": quantity.unit, "symbol": quantity.symbol}


def named_parameters(dataset: xr.Dataset) -> Mapping[str, Parameter]:
    """Return the parameters of a sweep by the names that its user reads."""
    if IN_SI not in dataset.attrs:
        return PARAMETERS
    rig = rig_of(dataset)
    own = {si_name(name, rig): parameter_of(name, rig) for name in PARAMETERS}
    return {"mass": MASS, **own}


def on_axis(dataset: xr.Dataset, axis: str, values: Any) -> Any:
    """Convert values of the model's parameter along an axis to the units of the axis."""
    rig = rig_of(dataset) if IN_SI in dataset.attrs else None
    return si_value(model_name(axis), values, rig)


def orbits_on_axes(dataset: xr.Dataset, found: xr.Dataset) -> xr.Dataset:
    """Return exact branches or curves, found over parameters of the model, over a sweep's axes."""
    if IN_SI not in dataset.attrs or IN_SI in found.attrs:
        return found
    rig, axes = rig_of(dataset), [str(name) for name in found.coords]
    values = {axis: (found[axis].dims, on_axis(dataset, axis, found[axis].values)) for axis in axes}
    si = found.assign_coords(values).assign_attrs({IN_SI: 1})
    if "range" in si.attrs:  # of branches
        si.attrs["range"] = on_axis(dataset, axes[0], np.array(si.attrs["range"])).tolist()
    return si.rename({axis: si_name(axis, rig) for axis in axes})


def arguments_in_si(
    dataset: xr.Dataset, options: Mapping[str, Any]
) -> tuple[xr.Dataset, dict[str, Any]]:
    """Return the arguments of a picture in SI units; those of a caller in Python are the model's.

    `options` may have the arguments of `sweeps.plotting.plot`.
    """
    rig, seen = rig_of(dataset), in_si(dataset)
    if rig is None or seen is dataset:
        return dataset, dict(options)

    def number(wanted: Any) -> Any:
        """Return a name of the rig, or a DataArray over the axes of the rig."""
        if isinstance(wanted, xr.DataArray):
            name = wanted.name
            if name not in dataset or not wanted.identical(dataset[name]):
                return _on_axes(seen, wanted, rig)
            wanted = name
        return si_name(wanted, rig) if isinstance(wanted, str) else wanted

    converted = dict(options)
    for option, value in options.items():
        if option == "at" and value:
            converted[option] = si_values(value, rig)
        elif option == "exact" and value is not None:
            converted[option] = orbits_on_axes(seen, value)
        elif option in ("quantity", "color") or isinstance(value, str | xr.DataArray):
            converted[option] = number(value)
        elif option in ("below", "axes"):
            converted[option] = [number(one) for one in value]
    return seen, converted


def _on_axes(dataset: xr.Dataset, values: xr.DataArray, rig: RigConfig) -> xr.DataArray:
    """Return numbers over parameters of the model over the axes of a dataset in SI units."""
    for name in map(str, values.dims):
        axis = si_name(name, rig)
        if axis != name and axis in dataset.dims and np.array_equal(values[name], dataset[name]):
            own = dataset[axis]
            values = values.assign_coords({axis: (name, own.values, own.attrs)})
            values = values.swap_dims({name: axis})
    return values
