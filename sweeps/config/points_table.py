"""Reads the points of a sweep from a table; refuses columns and cells."""

from __future__ import annotations

import csv
import math
import os
import re
import stat
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from sweeps.config.groups import OscillatorConfig, StartConfig
from sweeps.config.rig import RIG_PARAMETERS, RigConfig, model_name
from sweeps.config.values import ConflictError, Elsewhere, null
from sweeps.grid import table_values
from sweeps.interrupts import without_waiting
from sweeps.text import missing_text, near_misses, printable, shortened, shown_count, suggestion
from vibroimpact.inputs import number_meant
from vibroimpact.oscillator import PARAMETERS, Parameter

#: Longest header of a table; a file without line breaks would be read as a whole.
_LONGEST_HEADER = 100_000
#: Most columns of a table: HDF5 allows some 64 more variables of one dimension.
_MOST_COLUMNS = 4_000
#: Name of a column; a further one becomes a coordinate, whose name other programs must accept.
COLUMN_NAME = r"^\w(?!.*[^\w.-])"
#: Checks the names of all columns, and says what those may hold that must be numbers.
NamesCheck = Callable[[list[str]], Mapping[str, Parameter]]


def read_points(source: Any, folder: Path, *, of_rig: bool) -> np.ndarray:
    """Read a table into a structured array of shape (rows,), with a field for every column.

    `source` is a CSV file (relative to `folder`), a mapping of columns, a DataFrame or a structured
    array. Columns of parameters, of the rig too if there is one, must hold valid numbers; further
    columns hold numbers or texts. A ValueError names the column and the row, counted from 1.
    """
    parameters = {**PARAMETERS, **(RIG_PARAMETERS if of_rig else {})}
    return read_columns(source, folder, partial(_check_names, parameters=parameters))


def read_columns(source: Any, folder: Path, check_names: NamesCheck) -> np.ndarray:
    """Do the same as `read_points` with a table whose names another function checks."""
    path = folder / source if isinstance(source, str | Path) else None
    try:
        result = _columns(source, check_names) if path is None else _read_csv(path, check_names)
        columns, parameters = result
        valid = {name: _checked(name, column, parameters) for name, column in columns.items()}
        table = table_values(valid)
        if len(table):
            return table
        reason = "the table has no row"
    except FileNotFoundError as error:
        raise ValueError(missing_text(Path(error.filename))) from None
    except OSError as error:
        reason = f"cannot be read ({error.strerror})"
    except UnicodeDecodeError:
        reason = "the text is not in UTF-8; expected: a table saved as CSV UTF-8"
    except ValueError as error:
        reason = str(error)
    raise ValueError(reason if path is None else f"{path}: {reason}")


def with_columns(data: dict[str, Any]) -> dict[str, Any]:
    """Mark the columns of the table in their groups; refuse axes in addition to a table."""
    names, groups = data["points"].dtype.names, {}
    of_rig = null(data.get("rig")) is not None
    parameters = ("rig", RigConfig) if of_rig else ("oscillator", OscillatorConfig)
    for title, group in (parameters, ("start", StartConfig)):
        values = data.get(title, {})
        if not isinstance(values, dict):
            continue  # refused by the check of the group
        columns = {}
        for name in group.model_fields:
            parameter = model_name(name)
            if name != parameter and {name, parameter} <= {*names}:
                problem = f"is {name} in the units of the model"
                raise ConflictError(("points", parameter), problem, "one of both columns")
            is_parameter = parameter in PARAMETERS or name == "mass"
            if is_parameter and not {name, parameter}.isdisjoint(names):
                columns[name] = name if name in names else parameter
        for name, value in values.items():
            if name in columns or isinstance(value, list | tuple | dict):
                expected = f"one number here, or only a column {columns.get(name, name)} of points"
                raise ConflictError((title, name), "conflicts with points", expected)
        force, base = group.FORCES or ("", "")
        if base in columns and force not in {*values, *columns}:
            if not data["points"][columns[base]].any():
                problem = f"is 0 in every row, and there is no {force}"
                expected = f"{title}.{force}, a column {force}, or another {columns[base]}"
                raise ConflictError(("points", columns[base]), problem, expected)
        groups[title] = {**values, **dict.fromkeys(columns, Elsewhere.COLUMN)}
    return {**data, **groups}


def in_model(table: np.ndarray, rig: RigConfig | None) -> np.ndarray:
    """Return a table with the columns of the model behind it that are made from those of a rig."""
    columns = {name: table[name] for name in table.dtype.names or ()}
    for name, values in (rig.columns_in_model(columns) if rig is not None else {}).items():
        parameter = model_name(name)
        wrong = ~(np.isfinite(values) & PARAMETERS[parameter].accepts(values))
        if wrong.any():
            row, key = int(wrong.argmax()), name if name in columns else "mass"
            problem = f"row {row + 1}, {columns[key][row]:g} makes {parameter} = {values[row]:g}"
            raise ConflictError(("points", key), problem, PARAMETERS[parameter].allowed)
        columns[parameter] = values
    return table_values(columns)


def _read_csv(
    path: Path, check_names: NamesCheck
) -> tuple[dict[str, np.ndarray], Mapping[str, Parameter]]:
    """Return the columns of a CSV file, and what those may hold that must be numbers."""
    with open(path, encoding="utf-8-sig", newline="", opener=without_waiting) as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise ValueError("is not a regular file; expected: a CSV file")
        names = header_of(file)
        parameters = check_names(names)
        rows = [*_rows(file, names)]
    table = np.array(rows, object).reshape(-1, len(names))
    return dict(zip(names, table.T, strict=True)), parameters


def header_of(file: TextIO) -> list[str]:
    """Read the names in the first line that is not blank."""
    header = "\n"
    while header and not header.strip():
        header = file.readline(_LONGEST_HEADER + 1)
    if len(header) > _LONGEST_HEADER:
        raise ValueError(f"the header is longer than {_LONGEST_HEADER:,} characters")
    names = next(csv.reader([header, "\n"]), [])
    if any("\n" in name for name in names):
        raise ValueError("a quote in the header is not closed")
    return [name.strip() for name in names]


def _rows(file: TextIO, names: list[str]) -> Iterator[list[str]]:
    """Yield the cells of each row, without blank lines; refuse other numbers of cells."""
    row = 0
    try:
        # A quote that is not closed takes in the next line, or the one that is put at the end.
        for cells in csv.reader(chain(file, ["\n"])):
            if not cells or (len(cells) == 1 and cells[0].isspace()):
                continue
            row += 1
            for name, cell in zip(names, cells, strict=False):
                if "\n" in cell or "\r" in cell:
                    problem = "a quote is not closed; expected: another one in the same line"
                    raise ValueError(f"row {row}, column {name}: {problem}")
            if len(cells) != len(names):
                more = "; a number has a decimal point, and there is no comma at the end of a line"
                more *= len(cells) > len(names)
                count = shown_count(len(cells), "cell")
                raise ValueError(f"row {row} has {count}, and the header {len(names)}{more}")
            yield cells
    except csv.Error:
        most = csv.field_size_limit()
        raise ValueError(f"a cell with a quote has more than {most:,} characters") from None


def _columns(
    source: Any, check_names: NamesCheck
) -> tuple[dict[str, np.ndarray], Mapping[str, Parameter]]:
    """Return the same as `_read_csv` of a mapping, a DataFrame or a structured array."""
    names = getattr(getattr(source, "dtype", None), "names", None)
    if names is None and not hasattr(source, "items"):
        raise ValueError("no table; expected: a CSV file, or a mapping of columns")
    items = source.items() if names is None else ((name, source[name]) for name in names)
    pairs = [(str(name), column) for name, column in items]
    parameters = check_names([name for name, _ in pairs])
    for name, column in pairs:
        if np.ma.is_masked(column):
            row = int(np.ma.getmaskarray(column).argmax()) + 1
            raise ValueError(f"row {row}, column {name} is masked; expected: a value in every row")
    try:
        columns = {name: _array(column) for name, column in pairs}
    except ValueError:  # lists of different lengths in a column
        columns = {}
    shapes = {column.shape for column in columns.values()}
    if len(shapes) != 1 or len(*shapes) != 1:
        sizes = ", ".join(f"{name} of length {column.size}" for name, column in columns.items())
        raise ValueError(f"the columns must be lists of equal length{sizes and '; given: '}{sizes}")
    return columns, parameters


def _array(column: Any) -> np.ndarray:
    """Convert a column to an array: of texts, which keep a NUL at their ends, or of float64."""
    values = np.asarray(column)
    return np.asarray(column, {"U": object, "f": float}.get(values.dtype.kind))


def _check_names(names: list[str], parameters: Mapping[str, Parameter]) -> Mapping[str, Parameter]:
    """Refuse a table without a parameter column, and repeated, misspelt and malformed names."""
    missing = [name for name in parameters if name not in names]
    if len(missing) == len(parameters):
        words = (near_misses(name, parameters, least=0.8) for name in names if name.isidentifier())
        hint = suggestion(next(filter(None, words), []))
        problem = f"no column of {shortened(', '.join(names))} is a parameter{hint}"
        raise ValueError(
            f"{problem if names else 'the table is empty'}; expected: a header with one of "
            f"{', '.join(parameters)}, and commas between the columns"
        )
    check_header(names)
    for name in names:
        meant = near_misses(name, missing, least=0.8) if name not in parameters else []
        # A further column becomes a coordinate of the file, whose name other programs must accept.
        if meant or not re.search(COLUMN_NAME, name):
            raise ValueError(
                f"unknown column {name}{suggestion(meant)}; expected: a parameter "
                f"out of {', '.join(parameters)}, or another word"
            )
    return parameters


def check_header(names: list[str]) -> None:
    """Refuse columns without a name, or with the same, and too many of them."""
    if "" in names:
        raise ValueError(
            f"column {names.index('') + 1} has no name; expected: a name for every column, and no "
            "comma at the end of a line; to_csv of pandas needs index=False"
        )
    if len(names) > _MOST_COLUMNS:
        raise ValueError(
            f"{len(names):,} columns are too many; expected: at most {_MOST_COLUMNS:,}"
        )
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"column {name} is given twice; expected: once")


def _checked(name: str, column: np.ndarray, parameters: Mapping[str, Parameter]) -> np.ndarray:
    """Return the values of a column; refuse the first value that its parameter does not allow."""
    numeric = column.dtype.kind in "iuf"
    values = column if numeric else np.array([_number(cell) for cell in column], float)
    parameter = parameters.get(name)
    if parameter is None:
        wrong = np.array([not numeric and not _is_plain(cell) for cell in column], bool)
        allowed = "a number, or a Unicode text without NUL and carriage return"
    else:
        wrong, allowed = ~parameter.accepts(values), parameter.allowed
    if wrong.any():
        row = int(wrong.argmax())
        typed = shortened(printable(str(column[row]))) or "(nothing)"
        hint = ", with a decimal point" if parameter and "," in typed else ""
        if parameter is None and not isinstance(column[row], str):
            hint = "; astype(str) makes texts of truth values and dates"
        problem = f"{typed} is not allowed; expected: {allowed}{hint}"
        raise ValueError(f"row {row + 1}, column {name} = {problem}")
    if parameter is not None:
        return values.astype(float, copy=False)
    # A float64 would round a longer serial number, and has no leading zeros: these stay texts.
    whole = (np.abs(values) < 2**53).all()
    exact = numeric or (whole and not any(re.match(r"\s*[+-]?0\d", str(cell)) for cell in column))
    return values if exact else np.array([str(cell) for cell in column], object)


def _is_plain(cell: Any) -> bool:
    """Whether a cell is a number or a text that a file can hold."""
    if isinstance(cell, str):
        return not re.search("[\0\r\ud800-\udfff]", cell)
    if isinstance(cell, bool | np.timedelta64):  # integers, too
        return False
    return isinstance(cell, int | float | np.integer | np.floating) and bool(cell == cell)


def _number(cell: Any) -> float:
    """Return the number in a cell, or NaN if the cell is not a number."""
    number = number_meant(cell)
    return math.nan if number is None or not _is_plain(cell) else float(number)
