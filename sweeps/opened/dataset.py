"""What an opened Dataset says of itself: configuration, names and units, points, results.

`in_si` converts the sweep of a rig once, where a file is opened or a picture is drawn. What is
computed from the sweep is then in SI units, too: the parameters of the model, which computations
need, stay beside those of the rig.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import fields
from functools import lru_cache
from typing import Any

import numpy as np
import xarray as xr

from sweeps.config.groups import DIAGNOSTICS
from sweeps.config.loading import stored_config
from sweeps.config.nomenclature import Nomenclature
from sweeps.config.rig import MASS, QUANTITIES
from sweeps.config.sweep import SweepConfig
from sweeps.errors import Refused
from sweeps.store.variables import COLUMN_NAMES, VARIABLES, columns_of
from sweeps.text import unit_name
from vibroimpact.oscillator import PARAMETERS, POINT, Oscillator, Parameter

#: Attribute that marks a dataset with the names and in the units of its reader.
IN_SI = "in_si"
#: Finds the rig in a configuration without reading the table that may belong to it.
_HAS_RIG = re.compile("^rig:", re.MULTILINE)


def values_of(dataset: xr.Dataset, names: Iterable[str]) -> dict[str, np.ndarray]:
    """Return parameters, swept or not, and those results that are recorded, at every point.

    The arrays have the shape of ``status``, followed by that of a record.
    """
    points = dataset["status"].sizes
    variables = {name: dataset[name].variable for name in names if name in dataset}
    return {name: one.set_dims({**points, **one.sizes}).values for name, one in variables.items()}


def points_of(dataset: xr.Dataset) -> np.ndarray:
    """Return the points of an opened sweep, of dtype POINT, in C order."""
    points = np.empty(dataset["status"].size, POINT)
    for name, values in values_of(dataset, PARAMETERS).items():
        points[name] = values.ravel()
    return points


def config_of(dataset: xr.Dataset) -> SweepConfig:
    """Return the configuration of an opened sweep.

    Raises ConfigError if the configuration in a file is not valid, for example because another
    version wrote it.
    """
    configuration = dataset.attrs["configuration"]
    if isinstance(configuration, SweepConfig):
        return configuration
    table = columns_of(dataset)
    if table:
        return stored_config(configuration, "its configuration", "sweep", table)
    return _parsed(configuration)


def nomenclature_of(dataset: xr.Dataset) -> Nomenclature:
    """Return the names, units and numbers of the axes of an opened sweep."""
    return config_of(dataset).nomenclature if IN_SI in dataset.attrs else Nomenclature()


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
    if COLUMN_NAMES in si.attrs:  # a table: its configuration could not be read under the new names
        columns = dict.fromkeys(seen.name(name) for name in si.attrs[COLUMN_NAMES].split())
        si.attrs |= {"configuration": config_of(dataset), COLUMN_NAMES: " ".join(columns)}
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


def orbits_on_axes(dataset: xr.Dataset, found: xr.Dataset) -> xr.Dataset:
    """Return exact branches or curves, found over parameters of the model, over a sweep's axes."""
    seen, axes = nomenclature_of(dataset), [str(name) for name in found.coords]
    if not seen.in_si or IN_SI in found.attrs:
        return found
    values = {axis: (found[axis].dims, seen.value(axis, found[axis].values)) for axis in axes}
    si = found.assign_coords(values).assign_attrs({IN_SI: 1})
    if "range" in si.attrs:  # of branches
        si.attrs["range"] = seen.value(axes[0], np.array(si.attrs["range"])).tolist()
    return si.rename({axis: seen.name(axis) for axis in axes})


@lru_cache(maxsize=8)
def _parsed(configuration: str) -> SweepConfig:
    """Parse the configuration of a file; the cache avoids doing so for each part of a picture."""
    return stored_config(configuration, "its configuration", "sweep")


def headed(name: str, variable: xr.DataArray) -> str:
    """Return the head of a column, with the unit of the variable in brackets if it has a name."""
    unit = unit_name(variable.attrs.get("units", "1"))
    return f"{name} [{unit}]" if unit else name


def oscillator_of(point: xr.Dataset | np.void | Mapping[str, float]) -> Oscillator:
    """Return the oscillator at a point of a sweep, or with parameters given by name."""
    return Oscillator(**{field.name: float(point[field.name]) for field in fields(Oscillator)})


def check_diagnostic(dataset: xr.Dataset, name: str) -> None:
    """Refuse a file in which the diagnostic of the variable `name` was not recorded."""
    diagnostic = VARIABLES[name].diagnostic
    if name not in dataset and diagnostic is not None:
        again = f"run the sweep again with {diagnostics_with(dataset, diagnostic)}"
        raise Refused(f"the file has no {name}: {again}")


def diagnostics_with(dataset: xr.Dataset, diagnostic: str) -> str:
    """Return the key of a configuration that adds a diagnostic to those of a file."""
    held = {VARIABLES[str(name)].diagnostic for name in dataset if name in VARIABLES}
    return f"record.diagnostics: [{', '.join(d for d in DIAGNOSTICS if d in held | {diagnostic})}]"
