"""What a sweep file contains, as text: its configuration, rig, code, variables and sizes."""

from __future__ import annotations

from itertools import chain, repeat
from typing import TYPE_CHECKING

import yaml

from sweeps.config.rig import RigConfig
from sweeps.reports.run_report import RESULTS, destinations_text, outcomes, shown_axis
from sweeps.store import VARIABLES, columns_of
from sweeps.text import fewest_digits, shown_duration, table

if TYPE_CHECKING:
    import xarray as xr


def contents(dataset: xr.Dataset) -> str:
    """Describe an opened sweep: outcome, axes, variables, attributes and configuration."""
    attributes = dict(dataset.attrs)
    configuration = attributes.pop("configuration")
    impact = yaml.safe_load(attributes.pop("computation"))["impact"]
    for name in ("columns", "in_si"):  # shown in another form
        attributes.pop(name, None)
    dims = dataset["status"].dims
    results = {
        name: dataset[name].transpose(*dims, ...).values for name in RESULTS if name in dataset
    }
    omega = dataset["omega"].broadcast_like(dataset["status"]).transpose(*dims).values
    rows = [
        ("name", str(attributes.pop("name"))),
        ("points", outcomes(dataset, impact)),
        *zip(
            chain(["classes"], repeat("")),
            destinations_text(results, omega, dataset.sizes["section"]),
            strict=False,
        ),
        *(
            ("axis", shown_axis(str(axis), dataset[axis].values, dataset[axis].attrs["units"]))
            for axis in dataset["status"].dims
        ),
        *(
            ("column", shown_axis(name, values, str(dataset[name].attrs["units"])))
            for name, values in columns_of(dataset).items()
        ),
        *_of_rig(dataset),
    ]
    names = [name for name in VARIABLES if name in dataset]
    shapes = [f"{name} ({_sizes(dataset[name])})" for name in names]
    width = max(map(len, shapes))
    rows += [
        ("variable", f"{shape:{width}}  {dataset[name].long_name}{_bracketed(dataset[name])}")
        for name, shape in zip(names, shapes, strict=True)
    ]
    attributes["duration"] = shown_duration(float(attributes["duration"]))
    rows += [(str(name), str(value)) for name, value in attributes.items()]
    if not isinstance(configuration, str):  # of a table in SI units
        configuration = configuration.to_yaml(table=False)
    return f"{table(rows)}\n\n{configuration}"


def _of_rig(dataset: xr.Dataset) -> list[tuple[str, str]]:
    """Return a row for the mass and each fixed quantity of a rig; none without a rig."""
    fixed = [name for name in RigConfig.model_fields if name in dataset and not dataset[name].dims]
    return [
        ("rig", f"{name} = {fewest_digits(dataset[name].item())}{_bracketed(dataset[name])}")
        for name in fixed
        if "mass" in dataset
    ]


def _bracketed(variable: xr.DataArray) -> str:
    """Return the unit of a variable after a space, in brackets; none for a pure number."""
    unit = variable.attrs["units"]
    return "" if unit == "1" else f" [{unit}]"


def _sizes(variable: xr.DataArray) -> str:
    return ", ".join(f"{name}: {size}" for name, size in variable.sizes.items())
