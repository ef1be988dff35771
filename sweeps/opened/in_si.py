"""A sweep of a rig in SI units: axes, results and arguments with the names of the rig.

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

from sweeps.config.nomenclature import Nomenclature
from sweeps.config.rig import MASS, QUANTITIES
from sweeps.config.sweep import SweepConfig
from sweeps.opened.dataset import IN_SI, config_of, nomenclature_of, orbits_on_axes
from sweeps.store.variables import COLUMNS
from vibroimpact.oscillator import PARAMETERS, Parameter

#: Finds the rig in a configuration without reading the table that may belong to it.
_HAS_RIG = re.compile("^rig:", re.MULTILINE)


def in_si(dataset: xr.Dataset) -> xr.Dataset:
    """Return an opened sweep with the axes, names and SI units of its rig, if it has one.

    The axes are those of the rig; the parameters of the model stay as further coordinates. The
    results of the file are still read when they are used.
    """
    text = dataset.attrs["configuration"]
    if IN_SI in dataset.attrs or not (isinstance(text, SweepConfig) or _HAS_RIG.search(text)):
        return dataset
    rig = config_of(dataset).rig
    if rig is None:
        return dataset
    seen = Nomenclature(rig)
    mass = dataset["mass"] if rig.mass_varies else xr.DataArray(rig.mass)
    coordinates: dict[str, Any] = {"mass": (mass.dims, mass.values, _about(MASS))}
    for name in PARAMETERS:
        if name in QUANTITIES:
            own, called = dataset[name], seen.name(name)
            about = {**own.attrs, **_about(seen.about(name))}
            typed = called != name and called in dataset.coords  # a column of the table
            masses = mass.values if rig.mass_varies else None
            values = dataset[called].values if typed else rig.in_si(name, own.values, masses)
            coordinates[called] = own.dims, values, about
    si = dataset.assign_coords(coordinates).assign(_results_in_si(dataset, mass))
    si = si.swap_dims({name: seen.name(name) for name in PARAMETERS if name in dataset.dims})
    if COLUMNS in si.attrs:  # a table: its configuration could not be read under the new names
        columns = dict.fromkeys(seen.name(name) for name in si.attrs[COLUMNS].split())
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


def arguments_in_si(
    dataset: xr.Dataset, options: Mapping[str, Any]
) -> tuple[xr.Dataset, dict[str, Any]]:
    """Return the arguments of a picture in SI units; those of a caller in Python are the model's.

    `options` may have the arguments of `sweeps.plotting.plot`.
    """
    si = in_si(dataset)
    if si is dataset:
        return dataset, dict(options)
    seen = nomenclature_of(si)

    def number(wanted: Any) -> Any:
        """Return a name of the rig, or a DataArray over the axes of the rig."""
        if isinstance(wanted, xr.DataArray):
            name = wanted.name
            if name not in dataset or not wanted.identical(dataset[name]):
                return _on_axes(si, wanted)
            wanted = name
        return seen.name(wanted) if isinstance(wanted, str) else wanted

    converted = dict(options)
    for option, value in options.items():
        if option == "overlay":  # its columns have the names of the picture
            continue
        if option == "at" and value:
            converted[option] = seen.selection(value)
        elif option == "beside" and value:
            converted[option] = seen.selection({name: np.array(of) for name, of in value.items()})
        elif option == "exact" and value is not None:
            converted[option] = orbits_on_axes(si, value)
        elif option in ("quantity", "color") or isinstance(value, str | xr.DataArray):
            converted[option] = number(value)
        elif option in ("below", "axes", "panels"):
            converted[option] = [number(one) for one in value]
    return si, converted


def _on_axes(dataset: xr.Dataset, values: xr.DataArray) -> xr.DataArray:
    """Return numbers over parameters of the model over the axes of a dataset in SI units."""
    for name in map(str, values.dims):
        axis = nomenclature_of(dataset).name(name)
        if axis != name and axis in dataset.dims and np.array_equal(values[name], dataset[name]):
            own = dataset[axis]
            values = values.assign_coords({axis: (name, own.values, own.attrs)})
            values = values.swap_dims({name: axis})
    return values
