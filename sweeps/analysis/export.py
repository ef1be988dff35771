"""The points of a sweep as a flat table: a CSV or Parquet file for other programs."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import xarray as xr

from sweeps.analysis.grouping import grid_of
from sweeps.errors import Refused
from sweeps.store import VARIABLES
from sweeps.store.replacing import check_target, writing
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status

#: Points that are held in memory at a time for a CSV file.
_PART = 200_000
ENDINGS = (".csv", ".parquet")


def check_table(path: Path) -> None:
    """Refuse a file that a table cannot be written to.

    Raises
    ------
    Refused
        If its ending is not one of ``ENDINGS``, no file can be there, or a package is missing.
    """
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
    digits are kept, so that a CSV file gives the same numbers back; NaN is an empty field.

    Parameters
    ----------
    dataset : Dataset
        An opened sweep.
    path : Path
        A .csv or .parquet file, which is replaced only when the table is complete.

    Returns
    -------
    int
        The number of rows.

    Raises
    ------
    Refused
        As from `check_table`.
    Failed
        If the file cannot be written.
    """
    check_table(path)
    scalars = _scalars(dataset)
    axes = [str(name) for name in scalars["status"].dims]
    with writing(path, "table") as new:
        if path.suffix == ".parquet":
            _frame(scalars).to_parquet(new, index=False)
        else:
            digits = float.__repr__  # all of them, whatever NumPy prints
            with new.open("w", encoding="utf-8", newline="") as file:
                for i, block in enumerate(grid_of(dataset).blocks(_PART)):
                    part = _frame(scalars.isel(dict(zip(axes, block, strict=True))))
                    part.to_csv(file, index=False, header=i == 0, float_format=digits)
    return int(scalars["status"].size)


def _scalars(dataset: xr.Dataset) -> xr.Dataset:
    """Return the results that are a single number per point."""
    axes = set(dataset["status"].dims)
    columns = {}
    for name in VARIABLES:
        if name not in dataset:
            continue
        if set(dataset[name].dims) == axes:
            columns[name] = dataset[name]
        elif VARIABLES[name].record == "exponent":
            for i in range(dataset.sizes["exponent"]):
                columns[f"{name}_{i + 1}"] = dataset[name].isel(exponent=i, drop=True)
    return xr.Dataset(columns)


def _frame(scalars: xr.Dataset):  # type: ignore[no-untyped-def]
    """Return the rows of points, in C order over the file."""
    names = {int(status): status.name.lower() for status in Status}
    axes = [str(name) for name in scalars["status"].dims]
    fixed = [name for name in PARAMETERS if name in scalars.coords and name not in axes]
    rows = scalars if axes else scalars.expand_dims("point")
    frame = rows.to_dataframe(dim_order=axes or ["point"]).reset_index()
    frame["status"] = frame["status"].map(names)
    return frame[[*axes, *fixed, *scalars.data_vars]]
