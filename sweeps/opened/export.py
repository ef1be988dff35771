"""Describes a sweep as text; writes points, branches and curves as CSV, results as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from itertools import chain, repeat
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from sweeps.config.points_table import header_of
from sweeps.config.rig import RigConfig
from sweeps.errors import Refused
from sweeps.opened.coordinates import COORDINATES, in_chunks
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.reports import RESULTS, destinations_text, outcomes, shown_axis, status_counts
from sweeps.store.replacing import writing
from sweeps.store.variables import FLAGS, VARIABLES, unit_in
from sweeps.text import fewest_digits, in_brackets, shown_duration, table, unit_name
from sweeps.yaml_text import yaml_mapping
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.points.regimes import by_destination, regimes_of

if TYPE_CHECKING:
    import pandas as pd


def branch_table(branches: xr.Dataset, coordinate: str) -> pd.DataFrame:
    """Return a row for every section, or for every impact, of the orbits of `branches`.

    The `coordinate` decides between sections and impacts, which are numbered from 1. Each row has
    both Floquet multipliers of its orbit. A special point, which has a kind, has no ``stable``.
    Phases are omega t mod 2 pi.
    """
    import pandas as pd

    (axis,) = map(str, branches.coords)
    dimension = COORDINATES[coordinate].dimension
    columns = {name: branches[name].values for name in ("branch", "m", "q", axis, "stable", "kind")}
    columns["stable"] = np.where(columns["kind"] == "", columns["stable"].astype(int), "")
    for i, multiplier in enumerate(branches["multipliers"].values.T, 1):
        columns[f"multiplier_{i}_real"] = multiplier.real
        columns[f"multiplier_{i}_imag"] = multiplier.imag
    orbits = pd.DataFrame(columns)
    frame = orbits.loc[orbits.index.repeat(orbits["m" if dimension == "section" else "q"])]
    index = frame.groupby(level=0).cumcount()
    frame[dimension] = index + 1
    for name, variable in COORDINATES.items():
        if variable.dimension == dimension:
            values = branches[name].values[frame.index, index]
            frame[name] = values % (2.0 * np.pi) if name == "impact_phase" else values
    return frame.reset_index(drop=True)


def curve_table(curves: xr.Dataset) -> pd.DataFrame:
    """Return the points of `curves`, curve after curve, each followed by its special points."""
    import pandas as pd

    names = ["curve", "kind", "m", "q", *map(str, curves.coords), "special"]
    return pd.DataFrame({name: curves[name].values for name in names})


#: What a table can have a row for, with the record dimension of its rows; None for points.
ROWS: Mapping[str, str | None] = {"points": None, "sections": "section", "impacts": "impact"}


def refuse_points(columns: Collection[str], path: Path | None) -> None:
    """Refuse to replace the table that a sweep was made from: it has no other columns."""
    if not columns or path is None or not path.is_file():
        return
    names = set[str]()
    file = path.open(encoding="utf-8-sig", errors="replace", newline="")
    with file, suppress(ValueError):  # of no table of points
        names = {*header_of(file)}
    if names and names <= {*columns}:
        raise Refused(
            f"{path} is a table of points like that of the sweep, and is not replaced; give the "
            "new table another name"
        )


def write_csv(path: Path, chunks: Iterable[pd.DataFrame]) -> int:
    """Write a table in chunks, whole or not at all, with all digits; return its number of rows."""
    count = 0
    with writing(path, "table") as new:
        for i, chunk in enumerate(chunks):
            digits = float.__repr__  # all, whatever the print options of NumPy
            chunk.to_csv(new, index=False, header=i == 0, float_format=digits, lineterminator="\n")
            count += len(chunk)
    return count


def write_rows(sweep: OpenedSweep, path: Path, rows: str) -> int:
    """Write a row for every point, section or impact of a sweep, and return their number.

    The row of a point has its parameters, its class and every result that is a single number:
    Lyapunov exponents as ``lyapunov_1`` and ``lyapunov_2``, words for ``status`` and
    ``class_evidence``. The row of a section or an impact has the axes, or the columns of a table,
    its number and its values; what was not recorded has no row. All digits are kept, so that
    reading the file gives the same numbers; NaN is an empty field.
    """
    refuse_points(sweep.whole.columns, path)
    data = _scalars(sweep) if ROWS[rows] is None else _records(sweep, rows)
    width = len(data.data_vars) if ROWS[rows] is None else data.sizes[ROWS[rows]]
    chunks = (_frame(sweep.with_data(chunk), ROWS[rows]) for chunk, _ in in_chunks(data, width))
    return write_csv(path, chunks)


def _records(sweep: OpenedSweep, rows: str) -> xr.Dataset:
    """Return the results at sections or impacts; refuse a file that has none."""
    variables = filter(sweep.__contains__, VARIABLES)
    names = [name for name in variables if VARIABLES[name].dimension == ROWS[rows]]
    if not names:
        raise Refused(f"the file has no {rows}: run the sweep again with record.{rows}")
    return sweep.data[["status", *names]]


def _scalars(sweep: OpenedSweep) -> xr.Dataset:
    """Return the class, all results of a single number per point, and each Lyapunov exponent."""
    columns = {}
    if "period" in sweep and "class" not in sweep.columns:  # of a table
        classes = [str(label or "?") for label in sweep.labels]
        columns["class"] = sweep["status"].copy(data=np.reshape(classes, sweep["status"].shape))
    for name in filter(sweep.__contains__, VARIABLES):
        if VARIABLES[name].dimension is None:
            columns[name] = sweep[name]
        elif VARIABLES[name].dimension == "exponent":
            for i in range(sweep.sizes["exponent"]):
                columns[f"{name}_{i + 1}"] = sweep[name].isel(exponent=i, drop=True)
    return xr.Dataset(columns, attrs=sweep.attrs)


def _frame(cut: OpenedSweep, dimension: str | None) -> pd.DataFrame:
    """Return a row for each point, in the C order of the file, or for each record of a point."""
    data, dims = cut.data, [*cut.grid, *([dimension] if dimension else [])]
    names = dict.fromkeys([*cut.nomenclature.parameters, *cut.columns])
    parameters = [name for name in names if name in data.coords and name not in dims]
    if dimension is None:
        rows = data if dims else data.expand_dims("point")
        frame = rows.to_dataframe(dim_order=dims or ["point"]).reset_index()
        for name in FLAGS.keys() & set(frame):
            frame[name] = frame[name].map({int(flag): flag.name.lower() for flag in FLAGS[name]})
        return frame[[*dims, *parameters, *data.data_vars]]
    results = [str(name) for name in data.data_vars if name != "status"]
    columns = [name for name in parameters if data[name].dims]  # of a table
    frame = data[results].to_dataframe(dim_order=dims).reset_index().dropna(subset=results)
    return frame[[*dims[:-1], *columns, dimension, *results]]


def contents(sweep: OpenedSweep) -> str:
    """Describe a sweep: outcome, axes, variables, attributes and configuration."""
    attributes = dict(sweep.attrs)
    configuration = attributes.pop("configuration")
    impact = str(yaml_mapping(attributes.pop("computation"), "the computation").get("impact"))
    attributes.pop("columns", None)  # shown in another form
    results = sweep.values(["omega"], RESULTS)
    classes = destinations_text(results, results["omega"], sweep.sizes["section"], impact)
    axes = {axis: sweep[axis].values for axis in sweep.grid}
    of_rig = [name for name in RigConfig.model_fields if name in sweep and "mass" in sweep]
    fixed = {name: fewest_digits(sweep[name].item()) for name in of_rig if not sweep[name].dims}
    rows = [
        ("name", str(attributes.pop("name"))),
        ("points", outcomes(results, impact)),
        *zip(chain(["classes"], repeat("")), classes, strict=False),
        *(
            (kind, shown_axis(name, values, _unit(sweep, name)))
            for kind, arrays in (("axis", axes), ("column", sweep.columns))
            for name, values in arrays.items()
        ),
        *(("rig", f"{name} = {v}{in_brackets(_unit(sweep, name))}") for name, v in fixed.items()),
    ]
    shapes = {name: f"{name} ({_sizes(sweep[name])})" for name in VARIABLES if name in sweep}
    width = max(map(len, shapes.values()))
    rows += [
        ("variable", f"{shape:{width}}  {sweep[name].long_name}{in_brackets(_unit(sweep, name))}")
        for name, shape in shapes.items()
    ]
    attributes["duration"] = shown_duration(float(attributes["duration"]))
    rows += [(str(name), str(value)) for name, value in attributes.items()]
    return f"{table(rows)}\n\n{configuration}"


def contents_by_key(sweep: OpenedSweep) -> dict[str, Any]:
    """Return the same for other programs: numbers, texts and mappings by the names of keys."""
    attributes = dict(sweep.attrs)
    configuration = attributes.pop("configuration")
    classes = {}
    if "class_evidence" in sweep:
        results = sweep.values(["omega"], RESULTS)
        regimes = regimes_of(results, results["omega"], sweep.sizes["section"])
        classes = by_destination(regimes, results["orbit_distance"])
    return {
        "name": attributes.pop("name"),
        "points": sweep["status"].size,
        "outcomes": {
            status.word: number
            for status, number in status_counts(sweep.values(["status"])).items()
            if number
        },
        "classes": {word: int(mask.sum()) for word, mask in classes.items()},
        "axes": {
            axis: {"units": sweep[axis].attrs.get("units"), "values": sweep[axis].values}
            for axis in sweep.grid
        },
        "columns": [*sweep.columns],
        "variables": {
            name: {
                "dimensions": {str(dim): size for dim, size in sweep[name].sizes.items()},
                "long_name": sweep[name].attrs["long_name"],
                "units": sweep[name].attrs.get("units"),
            }
            for name in VARIABLES
            if name in sweep
        },
        "attributes": attributes,
        "configuration": yaml_mapping(configuration, "the configuration"),
    }


def headed(name: str, variable: xr.DataArray) -> str:
    """Return the head of a column, with the unit of the variable in brackets if it has a name."""
    return name + in_brackets(unit_name(variable.attrs.get("units", "1")))


def _unit(sweep: OpenedSweep, name: str) -> str:
    """Return the unit of a variable, in which a length or a time may have no name."""
    entry = PARAMETERS.get(name) or VARIABLES.get(name)
    return sweep[name].attrs.get("units") or unit_in(sweep.attrs, entry.unit if entry else "1")


def _sizes(variable: xr.DataArray) -> str:
    return ", ".join(f"{name}: {size}" for name, size in variable.sizes.items())


def json_rows(rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of a table for JSON, with impact speeds as numbers in place of a text."""
    records = rows.to_dict("records")
    return [row | {"impact_v": [*map(float, row["impact_v"].split())]} for row in records]


def json_text(value: object) -> str:
    """Write mappings, lists, texts and numbers as strict JSON, with all digits.

    NaN, which is no value, becomes null, and an infinite number the text "inf" or "-inf". All other
    characters than printable ASCII are escaped: no terminal and no encoding changes the text.
    """
    text = json.dumps(_in_json(value), indent=2, allow_nan=False)
    return text.replace("\x7f", "\\u007f")


def _in_json(value: Any) -> Any:
    """Convert a value to the types of JSON."""
    if isinstance(value, Mapping):
        return {str(name): _in_json(item) for name, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _in_json(value.tolist())
    if isinstance(value, list | tuple):
        return [_in_json(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value if isinstance(value, bool | int | float | str | None) else str(value)
