"""Writing tables as CSV and Parquet files, and the tables of exact branches and curves."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from sweeps.analysis.grouping import grid_of
from sweeps.analysis.rig import in_si, rig_of
from sweeps.analysis.selection import COORDINATES
from sweeps.config.rig import si_name
from sweeps.errors import Refused
from sweeps.store import VARIABLES, columns_of
from sweeps.store.replacing import check_target, writing
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status

if TYPE_CHECKING:
    import pandas as pd


def write_csv(path: Path, frame: pd.DataFrame) -> None:
    """Write a table to a CSV file with all digits, either whole or not at all."""
    with writing(path, "table") as new, new.open("w", newline="", encoding="utf-8") as file:
        frame.to_csv(file, index=False, float_format=float.__repr__, lineterminator="\n")


def branch_table(found: xr.Dataset, coordinate: str = "poincare_x") -> pd.DataFrame:
    """Return a row for every section, or for every impact, of the orbits of `branches`.

    The `coordinate` decides between sections and impacts, which are numbered from 1. Each row has
    both Floquet multipliers of its orbit. The special points, which have a kind, come after all
    branches.
    """
    import pandas as pd

    (axis,) = map(str, found.coords)
    dimension = COORDINATES[coordinate].dimension
    number, special = found["branch"].values, found.sizes["special"]

    def column(name: str, of_special: str) -> np.ndarray:
        return np.concatenate([found[name].values, found[of_special].values])

    m = np.concatenate([found["m"].values[number], found["special_m"].values])
    q = np.concatenate([found["q"].values[number], found["special_q"].values])
    multipliers = column("multipliers", "special_multipliers").T
    columns = {
        "branch": column("branch", "special_branch"),
        "m": m,
        "q": q,
        axis: column(axis, "special_value"),
        "stable": [*found["stable"].values.astype(int), *[""] * special],
        "kind": [*[""] * len(number), *found["kind"].values],
    }
    for i, multiplier in enumerate(multipliers, 1):
        columns[f"multiplier_{i}_real"] = multiplier.real
        columns[f"multiplier_{i}_imag"] = multiplier.imag
    counts = m if dimension == "section" else q
    orbit = np.repeat(np.arange(len(m)), counts)
    place = np.arange(len(orbit)) - np.repeat(np.cumsum(counts) - counts, counts)
    frame = pd.DataFrame(columns).iloc[orbit].reset_index(drop=True)
    frame[dimension] = place + 1
    for name, about in COORDINATES.items():
        if about.dimension == dimension:
            frame[name] = column(name, f"special_{name}")[orbit, place]
    return frame


def curve_table(found: xr.Dataset) -> pd.DataFrame:
    """Return the points of `curves`, curve after curve, each followed by its special points."""
    import pandas as pd

    number = np.concatenate([found["curve"].values, found["special_curve"].values])
    points = [np.stack([found[axis] for axis in found.coords], 1), found["special_values"].values]
    columns = {name: found[name].values[number] for name in ("kind", "m", "q")}
    frame = pd.DataFrame({"curve": number, **columns})
    frame[list(found.coords)] = np.concatenate(points)
    frame["special"] = [*[""] * found.sizes["point"], *found["special_kind"].values]
    return frame.sort_values("curve", kind="stable")


#: Number of points in memory at a time while a CSV file is written.
_PART = 200_000
ENDINGS = (".csv", ".parquet")


def check_table(path: Path) -> None:
    """Refuse a file whose ending is not one of ``ENDINGS``, or that cannot be written."""
    if path.suffix not in ENDINGS:
        raise Refused(f"the table {path} is not allowed; expected: a .csv or .parquet file")
    check_target(path, "table")
    if path.suffix == ".parquet" and not find_spec("pyarrow"):
        raise Refused(
            f"the table {path} needs the package pyarrow; install it, or write a .csv file"
        )


def write_points(dataset: xr.Dataset, path: Path) -> int:
    """Write a row for every point: its parameters, and every result that is a single number.

    Lyapunov exponents are ``lyapunov_1`` and ``lyapunov_2``; ``status`` is written as its name. All
    digits are kept, so that reading a CSV file gives the same numbers; NaN is an empty field. The
    file is replaced only when the table is complete. Returns the number of rows.
    """
    check_table(path)
    scalars = in_si(_scalars(dataset))
    axes = [str(name) for name in scalars["status"].dims]
    with writing(path, "table") as new:
        if path.suffix == ".parquet":
            _frame(scalars).to_parquet(new, index=False)
        else:
            digits = float.__repr__  # all digits, whatever the print options of NumPy
            with new.open("w", encoding="utf-8", newline="") as file:
                for i, block in enumerate(grid_of(dataset).blocks(_PART)):
                    part = _frame(scalars.isel(dict(zip(axes, block, strict=True))))
                    part.to_csv(file, index=False, header=i == 0, float_format=digits)
    return int(scalars["status"].size)


def _scalars(dataset: xr.Dataset) -> xr.Dataset:
    """Return the results with a single number per point, and each Lyapunov exponent."""
    axes = set(dataset["status"].dims)
    columns = {}
    for name in VARIABLES:
        if name not in dataset:
            continue
        if set(dataset[name].dims) == axes:
            columns[name] = dataset[name]
        elif VARIABLES[name].dimension == "exponent":
            for i in range(dataset.sizes["exponent"]):
                columns[f"{name}_{i + 1}"] = dataset[name].isel(exponent=i, drop=True)
    return xr.Dataset(columns, attrs=dataset.attrs)


def _frame(scalars: xr.Dataset):  # type: ignore[no-untyped-def]
    """Return a row for each point, in the C order of the file."""
    names = {int(status): status.name.lower() for status in Status}
    axes = [str(name) for name in scalars["status"].dims]
    rig = rig_of(scalars)
    of_rig = (si_name(name, rig) for name in [*PARAMETERS, *columns_of(scalars)])
    columns = dict.fromkeys(of_rig)
    about = [name for name in columns if name in scalars.coords and name not in axes]
    rows = scalars if axes else scalars.expand_dims("point")
    frame = rows.to_dataframe(dim_order=axes or ["point"]).reset_index()
    frame["status"] = frame["status"].map(names)
    return frame[[*axes, *about, *scalars.data_vars]]
