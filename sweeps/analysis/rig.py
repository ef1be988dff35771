"""Results of a rig as its user reads them, in SI units, for pictures, tables and cuts."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import numpy as np
import xarray as xr

from sweeps.analysis.selection import Selection, config_of
from sweeps.config.rig import QUANTITIES, RigConfig, model_name, si_name, si_values
from sweeps.store.variables import COLUMNS

#: The attribute of a dataset that is in SI units already.
_DONE = "in_si"


def rig_of(dataset: xr.Dataset) -> RigConfig | None:
    """Return the rig of an opened sweep, or of one in memory, if there is one."""
    text = dataset.attrs["configuration"]
    if isinstance(text, str) and not re.search("^rig:", text, re.MULTILINE):
        return None  # without reading a table
    return config_of(dataset).rig


def in_si(dataset: xr.Dataset, of: xr.Dataset | None = None) -> xr.Dataset:
    """Return what was computed of a rig with the names and in the units of the rig.

    It is a sweep, or what an analysis found in the sweep `of`. That of no rig, and what is in SI
    units already, are returned as they are. Analyses need the names of the model.
    """
    rig = rig_of(dataset if of is None else of)
    if rig is None or _DONE in dataset.attrs:
        return dataset
    axes = [str(name) for name in dataset.coords]
    changed: dict[str, Any] = {}
    for name in QUANTITIES:
        if name in dataset.variables:
            about, variable = QUANTITIES[name].about, dataset.variables[name]
            attributes = {"long_name": about.meaning, "units": about.unit, "symbol": about.symbol}
            values = si_values({name: variable.values}, rig)
            changed[name] = (variable.dims, *values.values(), {**variable.attrs, **attributes})
    coordinates = {name: values for name, values in changed.items() if name in axes}
    si = dataset.assign({name: changed[name] for name in changed.keys() - coordinates.keys()})
    si = si.assign_coords(coordinates).assign_attrs({_DONE: 1})
    if COLUMNS in si.attrs:  # of a table, which has other names from here on
        columns = [si_name(name, rig) for name in si.attrs[COLUMNS].split()]
        si.attrs |= {"configuration": config_of(dataset), COLUMNS: " ".join(columns)}
    if "special_value" in si:  # of branches
        si["special_value"] = si["special_value"].copy(data=_of(axes[0], si["special_value"], rig))
        si.attrs["range"] = _of(axes[0], np.array(si.attrs["range"]), rig).tolist()
    if "special_values" in si:  # of curves
        pairs = zip(axes, si["special_values"].values.T, strict=True)
        special = np.stack([_of(axis, column, rig) for axis, column in pairs], axis=1)
        si["special_values"] = si["special_values"].copy(data=special)
    return si.rename({name: si_name(name, rig) for name in coordinates})


def _of(name: str, values: Any, rig: Any) -> np.ndarray:
    """Return values of a parameter of the model in SI units."""
    return np.asarray(si_values({name: values}, rig)[si_name(name, rig)])


def model_axes(dataset: xr.Dataset, names: Iterable[str]) -> list[str]:
    """Return the model's names of axes that are named as in `in_si`."""
    rig = rig_of(dataset)
    return [model_name(name) if rig else name for name in names]


def in_model(dataset: xr.Dataset, at: Selection) -> dict[str, float | str]:
    """Return values of axes that are named and given as in `in_si` as those of the model."""
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
