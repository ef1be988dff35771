"""What a sweep file contains, as text: its configuration, rig, code, variables and sizes."""

from __future__ import annotations

from itertools import chain, repeat
from typing import TYPE_CHECKING, Any

import numpy as np

from sweeps.config.rig import RigConfig
from sweeps.reports.run_report import (
    RESULTS,
    destination_counts,
    destinations_text,
    outcomes,
    shown_axis,
    status_counts,
)
from sweeps.store import VARIABLES, columns_of
from sweeps.store.variables import unit_in
from sweeps.text import fewest_digits, shown_duration, table
from sweeps.yaml_text import yaml_mapping
from vibroimpact.oscillator import PARAMETERS

if TYPE_CHECKING:
    import xarray as xr


def contents(dataset: xr.Dataset) -> str:
    """Describe an opened sweep: outcome, axes, variables, attributes and configuration."""
    attributes = dict(dataset.attrs)
    configuration = attributes.pop("configuration")
    impact = str(yaml_mapping(attributes.pop("computation"), "the computation").get("impact"))
    attributes.pop("columns", None)  # shown in another form
    rows = [
        ("name", str(attributes.pop("name"))),
        ("points", outcomes(dataset, impact)),
        *zip(
            chain(["classes"], repeat("")),
            destinations_text(_results(dataset), *_record_of(dataset)),
            strict=False,
        ),
        *(
            ("axis", shown_axis(str(axis), dataset[axis].values, _unit(dataset, str(axis))))
            for axis in dataset["status"].dims
        ),
        *(
            ("column", shown_axis(name, values, _unit(dataset, name)))
            for name, values in columns_of(dataset).items()
        ),
        *_of_rig(dataset),
    ]
    names = [name for name in VARIABLES if name in dataset]
    shapes = [f"{name} ({_sizes(dataset[name])})" for name in names]
    width = max(map(len, shapes))
    rows += [
        ("variable", f"{shape:{width}}  {dataset[name].long_name}{_bracketed(dataset, name)}")
        for name, shape in zip(names, shapes, strict=True)
    ]
    attributes["duration"] = shown_duration(float(attributes["duration"]))
    rows += [(str(name), str(value)) for name, value in attributes.items()]
    return f"{table(rows)}\n\n{configuration}"


def contents_by_key(dataset: xr.Dataset) -> dict[str, Any]:
    """Return the same for other programs: numbers, texts and mappings by the names of keys."""
    attributes = dict(dataset.attrs)
    configuration = attributes.pop("configuration")
    return {
        "name": attributes.pop("name"),
        "points": dataset["status"].size,
        "outcomes": {
            status.name.lower().replace("_", "-"): number
            for status, number in status_counts(dataset).items()
            if number
        },
        "classes": destination_counts(_results(dataset), *_record_of(dataset)),
        "axes": {
            str(axis): {"units": dataset[axis].attrs.get("units"), "values": dataset[axis].values}
            for axis in dataset["status"].dims
        },
        "columns": [*columns_of(dataset)],
        "variables": {
            name: {
                "dimensions": {str(dim): size for dim, size in dataset[name].sizes.items()},
                "long_name": dataset[name].attrs["long_name"],
                "units": dataset[name].attrs.get("units"),
            }
            for name in VARIABLES
            if name in dataset
        },
        "attributes": attributes,
        "configuration": yaml_mapping(configuration, "the configuration"),
    }


def _results(dataset: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the results that say where motions go, in the shape of ``status``."""
    dims = dataset["status"].dims
    return {name: dataset[name].transpose(*dims, ...).values for name in RESULTS if name in dataset}


def _record_of(dataset: xr.Dataset) -> tuple[np.ndarray, int]:
    """Return omega of each point, in the shape of ``status``, and the periods of a record."""
    omega = dataset["omega"].broadcast_like(dataset["status"])
    return omega.transpose(*dataset["status"].dims).values, dataset.sizes["section"]


def _of_rig(dataset: xr.Dataset) -> list[tuple[str, str]]:
    """Return a row for the mass and each fixed quantity of a rig; none without a rig."""
    fixed = [name for name in RigConfig.model_fields if name in dataset and not dataset[name].dims]
    return [
        ("rig", f"{name} = {fewest_digits(dataset[name].item())}{_bracketed(dataset, name)}")
        for name in fixed
        if "mass" in dataset
    ]


def _unit(dataset: xr.Dataset, name: str) -> str:
    """Return the unit of a variable, in which a length or a time may have no name."""
    about = PARAMETERS.get(name) or VARIABLES.get(name)
    return dataset[name].attrs.get("units") or unit_in(dataset.attrs, about.unit if about else "1")


def _bracketed(dataset: xr.Dataset, name: str) -> str:
    """Return the unit of a variable after a space, in brackets; none for a pure number."""
    unit = _unit(dataset, name)
    return "" if unit == "1" else f" [{unit}]"


def _sizes(variable: xr.DataArray) -> str:
    return ", ".join(f"{name}: {size}" for name, size in variable.sizes.items())
