"""Conversion between the model and the SI units of a rig, for pictures, tables and cuts."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import numpy as np
import xarray as xr

from sweeps.analysis.selection import Selection, config_of
from sweeps.config.rig import MASS, QUANTITIES, RigConfig, model_name, si_name, si_values
from sweeps.store.variables import COLUMNS
from vibroimpact.oscillator import Parameter

#: Attribute that marks a dataset in SI units.
_DONE = "in_si"


def rig_of(dataset: xr.Dataset) -> RigConfig | None:
    """Return the rig of an opened sweep, or of a sweep in memory, if it has one."""
    text = dataset.attrs["configuration"]
    if isinstance(text, str) and not re.search("^rig:", text, re.MULTILINE):
        return None  # without reading a table
    return config_of(dataset).rig


def in_si(dataset: xr.Dataset, of: xr.Dataset | None = None) -> xr.Dataset:
    """Convert the dataset of a rig to the names and SI units of the rig.

    The dataset is a sweep, which gets the mass, or the result of an analysis of the sweep `of`. It
    is returned unchanged if the sweep has no rig, or if it is in SI units already. Analyses need
    the names of the model, so convert only their results.
    """
    rig = rig_of(dataset if of is None else of)
    if rig is None or _DONE in dataset.attrs:
        return dataset
    axes = [str(name) for name in dataset.coords]
    changed: dict[str, Any] = {}
    for name in QUANTITIES:
        if name in dataset.variables:
            variable, about = dataset.variables[name], _about(QUANTITIES[name].description)
            values = rig.in_si(name, variable.values)
            changed[name] = (variable.dims, values, {**variable.attrs, **about})
    coordinates = {name: values for name, values in changed.items() if name in axes}
    si = dataset.assign({name: changed[name] for name in changed.keys() - coordinates.keys()})
    si = si.assign_coords(coordinates).assign_attrs({_DONE: 1})
    if COLUMNS in si.attrs:  # a table: its configuration could not be read under the new names
        columns = [si_name(name, rig) for name in si.attrs[COLUMNS].split()]
        si.attrs |= {"configuration": config_of(dataset), COLUMNS: " ".join(columns)}
    if "range" in si.attrs:  # of branches
        si.attrs["range"] = _of(axes[0], np.array(si.attrs["range"]), rig).tolist()
    if of is None:
        si = si.assign_coords(mass=((), rig.mass, _about(MASS)))
    return si.rename({name: si_name(name, rig) for name in coordinates})


def _about(quantity: Parameter) -> dict[str, str]:
    """Return the attributes of a quantity of the rig, as a file has them for a parameter."""
    return {"long_name": quantity.meaning, "units": quantity.unit, "symbol": quantity.symbol}


def _of(name: str, values: Any, rig: Any) -> np.ndarray:
    """Convert values of a parameter of the model to SI units."""
    return np.asarray(si_values({name: values}, rig)[si_name(name, rig)])


def model_axes(dataset: xr.Dataset, names: Iterable[str]) -> list[str]:
    """Convert names of axes, as in the result of `in_si`, to those of the model."""
    rig = rig_of(dataset)
    return [model_name(name) if rig else name for name in names]


def in_model(dataset: xr.Dataset, at: Selection) -> dict[str, float | str]:
    """Convert values of axes, as in the result of `in_si`, to names and units of the model."""
    rig, values = rig_of(dataset), dict(at)
    if rig is None:
        return values
    own = {model_name(name): value for name, value in values.items()}
    return {
        name: QUANTITIES[name].in_model(rig.mass, value)
        if name in QUANTITIES and not isinstance(value, str)
        else value
        for name, value in own.items()
    }
